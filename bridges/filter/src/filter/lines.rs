//! Connections of the clients: their shares in motions, and the failures that they have not been informed of.

use super::{BoardClient, RobotSnapshot};
use mobee_contract::{CommitId, MotionEnd, SILENCE, Time};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Default)]
pub(super) struct ConnectionStates(BTreeMap<u64, ConnectionState>);

#[derive(Default)]
struct ConnectionState {
    /// Client's name, if its connections can be recognized as related.
    family: Option<String>,
    /// Present motion, and the motors that the client moved in it.
    open: Option<(CommitId, BTreeSet<usize>)>,
    /// True if that motion failed and the client has not been informed.
    failed: bool,
    /// True if its motors had no part in that failure.
    innocent: bool,
    heard: Option<Time>,
}

/// Common prefix of a client's connections: `/local/rpc:o` and `/local/command:o` belong to `/local`.
fn family(from: &str) -> Option<String> {
    let (head, tail) = from.rsplit_once('/')?;
    (matches!(tail, "rpc:o" | "command:o") && !head.is_empty()).then(|| head.to_owned())
}

impl ConnectionStates {
    /// Updates a connection and its motion when something arrives on it.
    pub(super) fn update(&mut self, client: &BoardClient, seen: &RobotSnapshot) {
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

    /// True if the client has not been informed of a failure.
    pub(super) fn failed(&self, client: &BoardClient) -> bool {
        self.0.get(&client.connection).is_some_and(|l| l.failed)
    }

    /// True if a stream has to be ignored, because it took part in a failure and has not been silent since.
    /// Counts as receiving a command.
    pub(super) fn deaf(&mut self, client: &BoardClient, now: Time) -> bool {
        let Some(line) = self.0.get_mut(&client.connection) else { return false };
        let silent = line.heard.replace(now).is_some_and(|heard| now.since(heard) >= SILENCE);
        if silent || line.innocent {
            line.failed = false;
        }
        line.failed
    }

    /// Records that the client was informed by a refusal, on this connection and on related ones without
    /// replies.
    pub(super) fn inform_family(&mut self, client: &BoardClient) {
        let Some(line) = self.0.get_mut(&client.connection) else { return };
        (line.open, line.failed) = (None, false);
        let Some(family) = line.family.clone() else { return };
        for line in self.0.values_mut().filter(|l| l.heard.is_some() && l.family.as_ref() == Some(&family)) {
            (line.open, line.failed) = (None, false);
        }
    }

    /// Records that the client moves these motors in this motion, and so does its RPC connection if this one
    /// has no replies.
    pub(super) fn moves(&mut self, client: &BoardClient, id: CommitId, motors: &[usize]) {
        let Some(line) = self.0.get(&client.connection) else { return };
        let family = line.family.clone().filter(|_| !client.listens);
        for (connection, line) in &mut self.0 {
            let own = *connection == client.connection;
            if !(own || family.is_some() && line.family == family) {
                continue;
            }
            match &mut line.open {
                Some((open, all)) if *open == id => all.extend(motors),
                // an earlier motion of this client whose end was not processed yet is evaluated first
                Some(_) if !own => {}
                slot => *slot = Some((id, motors.iter().copied().collect())),
            }
        }
    }

    /// Motors that clients move in present motions.
    pub(super) fn moving(&self, seen: &RobotSnapshot) -> BTreeSet<usize> {
        let under_way =
            |line: &&ConnectionState| line.open.as_ref().is_some_and(|(id, _)| (seen.end_of)(*id).is_none());
        self.0.values().filter(under_way).filter_map(|l| l.open.as_ref()).flat_map(|(_, m)| m.iter().copied()).collect()
    }

    /// Same as [`ConnectionStates::moving`], without clients whose motors have all arrived while other clients continue
    /// in the same motion.
    pub(super) fn under_way(&self, seen: &RobotSnapshot, arrived: impl Fn(usize) -> bool) -> BTreeSet<usize> {
        let open = |(connection, line): (&u64, &'_ ConnectionState)| {
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

    /// Records that a client stopped all present motions, so that ending short of the target is not a
    /// failure.
    pub(super) fn stopped(&mut self, seen: &RobotSnapshot) {
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
