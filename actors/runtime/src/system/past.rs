//! State of an earlier process of a run, read from its journal for the process that resumes it.

use super::RunCounts;
use mobee_contract::{AsFound, Cause, CommitId, EdgeState, Event, Note, Pose, Status, Time};
use mobee_controller::gate::Gate;
use mobee_controller::ledger::{Extent, Ledger, Motion, Open, Places, SafePose};
use mobee_journal::journal::JournalLine;
use mobee_model::{Edit, Scene};
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::Duration;

/// Greatest time between a safe pose and the recorded configuration that it was taken from.
const SAFE_POSE_TOLERANCE: Duration = Duration::from_secs(1);
/// Time on the run's clock between the last event and the resuming process: earlier events are then strictly
/// older.
const RESUME_GAP: Duration = Duration::from_secs(1);

/// State of an earlier process.
#[derive(Clone, Debug, Default)]
pub struct Past {
    /// Time at which the run continues, on its own clock.
    pub at: Time,
    /// Number of events in the journal.
    pub events: u64,
    /// Counters of the run.
    pub counts: RunCounts,
    /// Configuration at the start of the run; `None` if the journal does not contain it.
    pub begun: Option<Value>,
    /// Configuration of the newest process.
    pub config: Option<Value>,
    robots: BTreeMap<String, PastRobot>,
    world: BTreeMap<String, Event>,
}

/// State of one robot from an earlier process.
#[derive(Clone, Debug, Default)]
pub struct PastRobot {
    /// Last token of the gate.
    pub token: u64,
    /// Number of the last accepted commit.
    pub last_id: u64,
    /// Transaction that was left open.
    pub open: Option<Open>,
    /// Last commanded positions of the motors.
    pub places: Places,
    /// Distance at which a motor counts as having arrived, rad.
    tolerance: f64,
    /// State in which the driver found the motors.
    pub found: Vec<AsFound>,
    /// Newest known configuration, rad: recorded, or from the last outcome.
    pub q: Option<Pose>,
    /// Recorded configurations, oldest first.
    pub recorded: Vec<(Time, Pose)>,
    /// The agent's notes on its map: vertices in order, edges in their last state, and the attempted motions.
    pub notes: Vec<Note>,
    /// True if a person had halted it, and not released it.
    halted: bool,
    safe: Option<SafePose>,
    outcomes: u64,
    /// Indices of the map's notes in the list.
    vertices: BTreeMap<u32, usize>,
    edges: BTreeMap<(u32, u32), usize>,
}

impl Past {
    /// Takes the next line of the journal.
    pub fn on(&mut self, line: &JournalLine) {
        self.at = line.at + RESUME_GAP;
        self.events = line.n + 1;
        self.counts.note(&line.event);
        match &line.event {
            Event::Started { config, .. } => {
                (self.begun, self.config) = (Some(config.clone()), Some(config.clone()));
            }
            // An older program stored the configuration of a resumed run in config.json only.
            Event::Resumed { config: None, .. } => (self.begun, self.config) = (None, None),
            Event::Resumed { config, .. } => self.config = config.clone(),
            Event::World { object, .. } => drop(self.world.insert(object.clone(), line.event.clone())),
            Event::Enabled { robot, token } | Event::Disabled { robot, token, .. } => self.of(robot).token = *token,
            Event::SafePose { robot, q, age, .. } => {
                let since = Time(
                    line.at.0.saturating_sub(Duration::try_from_secs_f64(*age).unwrap_or_default().as_nanos() as u64),
                );
                self.of(robot).safe = Some(SafePose { since, q: q.clone() });
            }
            Event::SafePoseMoved { robot, q, recorded, .. } => {
                if let Some(open) = &mut self.of(robot).open {
                    open.safe = Some(SafePose { since: recorded.unwrap_or(line.at), q: q.clone() });
                }
            }
            Event::Found { robot, motors } => self.of(robot).found = motors.clone(),
            Event::Robot { robot, tolerance, .. } => self.of(robot).tolerance = *tolerance,
            Event::Commit { robot, id: CommitId(id), agent, target, escape, motors, stream } => {
                let past = self.of(robot);
                let named = |motors: &[(usize, f64)]| motors.iter().map(|(m, _)| *m).collect();
                // An old journal does not list the motors.
                let named = if motors.is_empty() { (0..target.len()).collect() } else { named(motors) };
                past.last_id = *id;
                past.open = Some(Open {
                    id: CommitId(*id),
                    agent: agent.as_str().into(),
                    target: target.clone(),
                    named,
                    safe: past.safe.clone().filter(|_| !escape),
                    since: line.at,
                    motion: if *escape { Motion::Escape { due: line.at } } else { Motion::Move { due: line.at } },
                    cause: Some(Cause::Crashed),
                    retreated: false,
                    extent: if *stream { Extent::Stream } else { Extent::Whole },
                });
            }
            Event::State { robot, status: Status::Retreating } => {
                self.of(robot).open.iter_mut().for_each(|open| open.retreated = true);
            }
            Event::Amended { robot, target, motors, stream, .. } => {
                if let Some(open) = &mut self.of(robot).open {
                    if !stream && !motors.is_empty() {
                        open.extent = Extent::Whole;
                    }
                    open.target = target.clone();
                    open.name(&motors.iter().map(|(m, _)| *m).collect::<Vec<_>>());
                }
            }
            Event::RetreatJoined { robot, motors, .. } => {
                self.of(robot).open.iter_mut().for_each(|open| open.name(motors));
            }
            Event::Outcome { robot, outcome, q, .. } => {
                let past = self.of(robot);
                if let Some(open) = past.open.take() {
                    past.places = open.places_after(&past.places, *outcome, q, past.tolerance);
                }
                past.outcomes += 1;
                past.q = Some(q.clone());
            }
            Event::Halted { robot } => self.of(robot).halted = true,
            Event::Released { robot } => self.of(robot).halted = false,
            Event::Note { robot, note } => self.of(robot).note(note),
            _ => {}
        }
    }

    fn of(&mut self, robot: &str) -> &mut PastRobot {
        self.robots.entry(robot.to_owned()).or_default()
    }

    /// Sets the configurations from a robot's ring file, oldest first.
    pub fn recorded(&mut self, robot: &str, poses: Vec<(Time, Pose)>) {
        if let Some((at, q)) = poses.last() {
            self.at = self.at.max(*at + RESUME_GAP);
            self.of(robot).q = Some(q.clone());
        }
        self.of(robot).recorded = poses;
    }

    /// Takes the time of the last reading beside the journal: the run continues after it.
    pub fn read_until(&mut self, last: Option<Time>) {
        self.at = self.at.max(last.map_or(Time::ZERO, |last| last + RESUME_GAP));
    }

    /// State of this robot.
    pub fn robot(&self, name: &str) -> PastRobot {
        self.robots.get(name).cloned().unwrap_or_default()
    }

    /// Number of outcomes, by robot.
    pub(crate) fn outcomes(&self) -> impl Iterator<Item = (&str, u64)> {
        self.robots.iter().map(|(name, robot)| (name.as_str(), robot.outcomes))
    }

    /// Applies the recorded edits to the initial world: moves, changes and removals. Returns it with the names
    /// of the objects that were added during the run; their shapes are not in the journal.
    pub fn world(&self, scene: Scene) -> (Scene, Vec<String>) {
        let mut missing = Vec::new();
        let mut scene = scene;
        for (name, event) in &self.world {
            let Event::World { class, at, .. } = event else { continue };
            let Some((_, object)) = scene.object(name) else {
                missing.extend(class.is_some().then(|| name.clone()));
                continue;
            };
            let stood = object.pose;
            let mut edits = Vec::new();
            match (class, at) {
                (None, _) => edits.push(Edit::Remove { name: name.clone() }),
                (Some(class), at) => {
                    edits.push(Edit::Class { name: name.clone(), class: *class });
                    let moved = at.map(|at| {
                        let mut pose = stood;
                        pose.translation.vector = at.into();
                        Edit::Move { name: name.clone(), pose }
                    });
                    edits.extend(moved);
                }
            }
            for edit in edits {
                scene = scene.edit(&edit).unwrap_or(scene);
            }
        }
        (scene, missing)
    }
}

impl PastRobot {
    fn note(&mut self, note: &Note) {
        match note {
            Note::Vertex { id, q, .. } => {
                let known = *self.vertices.entry(*id).or_insert(self.notes.len());
                match self.notes.get_mut(known) {
                    // An agent that restarted reports its whole map again.
                    Some(Note::Vertex { q: before, .. }) if before == q => {}
                    Some(slot) => {
                        *slot = note.clone();
                        self.forget_edges(*id);
                    }
                    None => self.notes.push(note.clone()),
                }
            }
            // Obstructions are determined again; the robot's own knowledge of the edge is retained.
            Note::Edge { state: EdgeState::Blocked, from, to, .. } if self.edges.contains_key(&(*from, *to)) => {}
            Note::Edge { from, to, .. } => {
                let known = *self.edges.entry((*from, *to)).or_insert(self.notes.len());
                match self.notes.get_mut(known) {
                    Some(slot) => *slot = note.clone(),
                    None => self.notes.push(note.clone()),
                }
            }
            // The map itself limits these to the newest.
            Note::Tried { .. } => self.notes.push(note.clone()),
            Note::Plan { .. } | Note::Log { .. } => {}
        }
    }

    /// Drops the notes on the edges of a vertex that was replaced.
    fn forget_edges(&mut self, id: u32) {
        let of_it = |n: &Note| matches!(n, Note::Edge { from, to, .. } | Note::Tried { from, to, .. } if *from == id || *to == id);
        self.notes.retain(|n| !of_it(n));
        self.vertices.clear();
        self.edges.clear();
        for (i, note) in self.notes.iter().enumerate() {
            match note {
                Note::Vertex { id, .. } => drop(self.vertices.insert(*id, i)),
                Note::Edge { from, to, .. } => drop(self.edges.insert((*from, *to), i)),
                _ => {}
            }
        }
    }

    /// True if the gate was left open.
    pub fn was_open(&self) -> bool {
        Gate::opens(self.token)
    }

    /// Creates a ledger with this state.
    pub(crate) fn ledger(&self, history: usize) -> Ledger {
        let ledger = Ledger::new(history);
        {
            let mut book = ledger.book();
            book.history.restore(&self.recorded);
            book.last_id = self.last_id;
            book.halted = self.halted;
            book.open = self.open.clone();
            book.places = self.places.clone();
            let safe = book.open.as_ref().and_then(|o| o.safe.clone());
            let found = safe.and_then(|SafePose { since, q }| {
                book.history.recorded_near(since, &q, SAFE_POSE_TOLERANCE).map(|r| SafePose { since: r.at, q })
            });
            if let (Some(open), Some(found)) = (book.open.as_mut(), found) {
                open.safe = Some(found);
            }
        }
        ledger
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::Outcome;

    /// Journal of a run in which the second of three motors was sent to 1, and was on its way to 2 when the
    /// process died.
    #[test]
    fn places_are_known_again_from_what_was_committed() {
        let r = || "r".to_owned();
        let pose = |q: [f64; 3]| -> Pose { q.to_vec().into() };
        let commit = |id: u64, q: f64| {
            let target = pose([0.0, q, 0.5]);
            Event::Commit {
                robot: r(),
                id: CommitId(id),
                agent: "a".into(),
                target,
                escape: false,
                motors: vec![(1, 0.3)],
                stream: false,
            }
        };
        let safe = |q: f64| {
            let q = pose([0.0, q, 0.5]);
            Event::SafePose { robot: r(), q, age: 0.0, speed: 0.0, free: true }
        };
        let robot = Event::Robot {
            robot: r(),
            motors: vec![r(), r(), r()],
            sliding: Vec::new(),
            min: vec![-3.0; 3],
            max: vec![3.0; 3],
            max_speed: vec![1.0; 3],
            period: 0.02,
            fresh: 0.1,
            margin: 0.01,
            tolerance: 0.002,
            rest_speed: 0.01,
            resolution: 0.0,
            hold_error: 0.0,
            deflection: 0.0,
            constraints: Vec::new(),
        };
        let reached = Event::Outcome {
            robot: r(),
            id: CommitId(1),
            outcome: Outcome::Committed,
            q: pose([0.0, 0.999, 0.5]),
            safe: None,
            cause: None,
        };
        let found = AsFound { motor: 1, mode: None, compliant: None, speed: Some(0.2), acceleration: None };
        let found = Event::Found { robot: r(), motors: vec![found] };
        let mut past = Past::default();
        for (n, event) in (0..).zip([robot, found, safe(0.0), commit(1, 1.0), reached, safe(0.999), commit(2, 2.0)]) {
            past.on(&JournalLine { line: n + 2, n, at: Time(n), event, hash: String::new() });
        }
        let robot = past.robot("r");
        assert_eq!(robot.found[0].speed, Some(0.2));
        assert_eq!(robot.places.to_vec(), [None, Some(1.0), None]);
        let ledger = robot.ledger(100);
        let motion = ledger.book().motion().unwrap();
        assert_eq!((motion.named.to_vec(), motion.places.to_vec()), (vec![1], vec![None, Some(1.0), None]));
        // Killed during its retreat: a rest beside the target does not count as reaching it.
        let back = Event::State { robot: r(), status: Status::Retreating };
        past.on(&JournalLine { line: 9, n: 7, at: Time(7), event: back, hash: String::new() });
        assert!(past.robot("r").open.is_some_and(|open| open.retreated));
    }
}
