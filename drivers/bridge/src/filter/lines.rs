//! The clients' connections: who takes part in which motion, and who still has to learn that it failed.

use super::{Client, Seen};
use mobee_contract::{CommitId, MotionEnd, SILENCE, Time};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Default)]
pub(super) struct Lines(BTreeMap<u64, Line>);

#[derive(Default)]
struct Line {
    /// The client's name, if connections of it can be told to belong together.
    family: Option<String>,
    /// The motion that it takes part in, and the motors that it moved in it.
    open: Option<(CommitId, BTreeSet<usize>)>,
    /// Whether that motion failed, and the client does not know yet.
    failed: bool,
    /// Whether what it moved had no part in that.
    innocent: bool,
    heard: Option<Time>,
}

/// What connections of one client have in common: those that call themselves `/local/rpc:o` and `/local/command:o` belong to `/local`.
fn family(from: &str) -> Option<String> {
    let (head, tail) = from.rsplit_once('/')?;
    (matches!(tail, "rpc:o" | "command:o") && !head.is_empty()).then(|| head.to_owned())
}

impl Lines {
    /// Something came on a connection: it and its motion are brought up to date.
    pub(super) fn hear(&mut self, client: &Client, seen: &Seen) {
        let line = self.0.entry(client.connection).or_default();
        if line.family.is_none() {
            line.family = family(client.from);
        }
        if let Some((id, motors)) = &line.open {
            match (seen.end_of)(*id) {
                None => {}
                Some(MotionEnd::Reached) => line.open = None,
                Some(MotionEnd::Failed) => {
                    line.innocent = (seen.to_blame)(*id).is_some_and(|blamed| blamed.is_disjoint(motors));
                    (line.open, line.failed) = (None, true);
                }
            }
        }
    }

    /// Whether the client has yet to learn of a failure.
    pub(super) fn failed(&self, client: &Client) -> bool {
        self.0.get(&client.connection).is_some_and(|l| l.failed)
    }

    /// Whether a stream is not to be heard: it failed, had a part in that, and has not been silent since. Counts as hearing it.
    pub(super) fn deaf(&mut self, client: &Client, now: Time) -> bool {
        let Some(line) = self.0.get_mut(&client.connection) else { return false };
        let silent = line.heard.replace(now).is_some_and(|heard| now.since(heard) >= SILENCE);
        if silent || line.innocent {
            line.failed = false;
        }
        line.failed
    }

    /// The client was refused: it knows, on this connection and on those that get no replies.
    pub(super) fn told(&mut self, client: &Client) {
        let Some(line) = self.0.get_mut(&client.connection) else { return };
        (line.open, line.failed) = (None, false);
        let Some(family) = line.family.clone() else { return };
        for line in self.0.values_mut().filter(|l| l.heard.is_some() && l.family.as_ref() == Some(&family)) {
            (line.open, line.failed) = (None, false);
        }
    }

    /// The client moves these motors as part of this motion; so does its RPC connection, if this one has no replies.
    pub(super) fn moves(&mut self, client: &Client, id: CommitId, motors: &[usize]) {
        let Some(line) = self.0.get(&client.connection) else { return };
        let family = line.family.clone().filter(|_| !client.listens);
        for (connection, line) in &mut self.0 {
            let own = *connection == client.connection;
            if !(own || family.is_some() && line.family == family) {
                continue;
            }
            match &mut line.open {
                Some((open, all)) if *open == id => all.extend(motors),
                // another motion of this client that ended unheard is judged first
                Some(_) if !own => {}
                slot => *slot = Some((id, motors.iter().copied().collect())),
            }
        }
    }

    /// The motors that clients move in motions under way.
    pub(super) fn moving(&self, seen: &Seen) -> BTreeSet<usize> {
        let under_way = |line: &&Line| line.open.as_ref().is_some_and(|(id, _)| (seen.end_of)(*id).is_none());
        self.0.values().filter(under_way).filter_map(|l| l.open.as_ref()).flat_map(|(_, m)| m.iter().copied()).collect()
    }

    /// The same without those of clients whose motors have all arrived, while other clients' go on in the same motion.
    pub(super) fn under_way(&self, seen: &Seen, arrived: impl Fn(usize) -> bool) -> BTreeSet<usize> {
        let open = |(connection, line): (&u64, &'_ Line)| {
            let (id, motors) = line.open.clone().filter(|(id, _)| (seen.end_of)(*id).is_none())?;
            Some((*connection, line.family.clone(), id, motors))
        };
        let all: Vec<_> = self.0.iter().filter_map(open).collect();
        let waits = |(connection, family, id, motors): &&(u64, Option<String>, CommitId, BTreeSet<usize>)| {
            let shared = all.iter().any(|(other, others, with, theirs)| {
                let own = other == connection || family.is_some() && others == family;
                !own && with == id && !theirs.is_subset(motors)
            });
            !(shared && motors.iter().all(|m| arrived(*m)))
        };
        all.iter().filter(waits).flat_map(|(.., motors)| motors.iter().copied()).collect()
    }

    /// A client stopped the motions under way: that they then end short of their target is no failure.
    pub(super) fn stopped(&mut self, seen: &Seen) {
        for line in self.0.values_mut() {
            if line.open.as_ref().is_some_and(|(id, _)| (seen.end_of)(*id).is_none()) {
                line.open = None;
            }
        }
    }

    pub(super) fn gone(&mut self, connection: u64) {
        self.0.remove(&connection);
    }
}
