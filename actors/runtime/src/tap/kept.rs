//! The present state, for a sink that is attached late.

use mobee_contract::{Entry, Event, Note, Time};
use std::collections::BTreeMap;

/// The newest entry of each kind that describes the present: the world, and per robot its state, its open or
/// last transaction, and its roadmap. It is as large as the roadmap, however long the run.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    newest: BTreeMap<KeptKey, (Time, Entry)>,
    robots: Vec<String>,
    now: Time,
}

/// Subject of an entry, for the robot with this index. Entries of one instant are reported in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum KeptKey {
    Started,
    Scene,
    State(usize),
    Transaction(usize),
    Vertex(usize, u32),
    Edge(usize, u32, u32),
    Plan(usize),
}

/// Configuration of the vertex in an event.
fn pose(event: &Event) -> Option<&[f64]> {
    match event {
        Event::Note { note: Note::Vertex { q, .. }, .. } => Some(q),
        _ => None,
    }
}

fn pose_of(entry: &Entry) -> Option<&[f64]> {
    match entry {
        Entry::Event(event) => pose(event),
        _ => None,
    }
}

impl Kept {
    /// Stores an entry if it is the newest of its kind.
    pub fn note(&mut self, at: Time, entry: &Entry) {
        self.now = self.now.max(at);
        if let Some(key) = self.key(entry) {
            let before = self.newest.insert(key, (at, entry.clone()));
            if let (KeptKey::Vertex(robot, id), Some((_, Entry::Event(before)))) = (key, before)
                && pose(&before) != pose_of(entry)
            {
                // It is another vertex now: its old edges are void.
                let its =
                    |k: &KeptKey| matches!(k, KeptKey::Edge(r, from, to) if *r == robot && (*from == id || *to == id));
                self.newest.retain(|key, _| !its(key));
            }
        }
    }

    /// Returns the entries, each with its own time; first the present scene, in which the others are drawn.
    pub fn entries(self) -> Vec<(Time, Entry)> {
        let mut entries: Vec<_> = self.newest.into_values().collect();
        let is_event = |entry: &Entry| matches!(entry, Entry::Event(_));
        entries.sort_by_key(|(at, entry)| (is_event(entry), *at));
        entries.iter_mut().filter(|(_, e)| !is_event(e)).for_each(|(at, _)| *at = self.now);
        entries
    }

    fn key(&mut self, entry: &Entry) -> Option<KeptKey> {
        let event = match entry {
            Entry::Scene(_) => return Some(KeptKey::Scene),
            Entry::Pose { .. } | Entry::Picture { .. } => return None,
            Entry::Event(event) => event,
        };
        Some(match &**event {
            Event::Started { .. } => KeptKey::Started,
            Event::State { robot, .. } => KeptKey::State(self.index(robot)),
            Event::Commit { robot, .. } | Event::Outcome { robot, .. } => KeptKey::Transaction(self.index(robot)),
            Event::Note { robot, note } => match note {
                Note::Vertex { id, .. } => KeptKey::Vertex(self.index(robot), *id),
                Note::Edge { from, to, .. } => KeptKey::Edge(self.index(robot), *from, *to),
                Note::Plan { .. } => KeptKey::Plan(self.index(robot)),
                Note::Tried { .. } | Note::Log { .. } => return None,
            },
            _ => return None,
        })
    }

    fn index(&mut self, robot: &str) -> usize {
        let known = self.robots.iter().position(|r| r == robot);
        known.unwrap_or_else(|| {
            self.robots.push(robot.to_owned());
            self.robots.len() - 1
        })
    }
}
