//! Test bench of the filter: a board, and motions whose end the test sets.

use mobee_contract::{Axis, Board, CommitId, MotionEnd, Status, Time};
use mobee_filter::filter::*;
use mobee_model::{JointMotion, Motor, Part, Robot};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

/// A robot of two parts (2 and 1 motors) behind a filter, with motions whose end the test sets.
pub struct Bench {
    pub core: FilterCore,
    pub status: Status,
    pub now: Time,
    pub q: Vec<f64>,
    pub ends: RefCell<BTreeMap<u64, MotionEnd>>,
    pub blamed: Option<BTreeSet<usize>>,
    pub next: u64,
    pub stopped: usize,
}

impl Bench {
    pub fn new() -> Bench {
        Bench::of([JointMotion::Turn; 3])
    }

    /// Creates a bench with these joint kinds, whose limits are 90 deg or mm to either side.
    pub fn of(motions: [JointMotion; 3]) -> Bench {
        let axis = |name: &str| Axis {
            name: name.into(),
            min: (-90.0_f64).to_radians(),
            max: 90.0_f64.to_radians(),
            max_speed: 50.0_f64.to_radians(),
            max_acceleration: 1.0,
            ..Default::default()
        };
        let motor = |motion| Motor {
            name: String::new(),
            part: 0,
            min: -1.0,
            max: 1.0,
            home: 0.0,
            motion,
            max_speed: None,
            continuous: false,
            joints: vec![],
            is_part_root: false,
        };
        let part = |name: &str, motors| Part { name: name.into(), motors, root_node: None, clauses: vec![] };
        let robot = Robot {
            name: "toy".into(),
            parts: vec![part("arm", 0..2), part("head", 2..3)],
            motors: motions.map(motor).to_vec(),
            nodes: vec![],
            markers: vec![],
            pairs: Default::default(),
            left_out: None,
            near: Vec::new(),
            bare: Vec::new(),
        };
        let axes = vec![axis("a"), axis("b"), axis("c")];
        let period = std::time::Duration::from_millis(10);
        let board = Board { axes, period, latency: period, position_direct: true };
        let q = vec![0.1, 0.2, 0.3];
        Bench {
            core: FilterCore::new("toy", &robot, &board, &q, 1.0),
            status: Status::Rest,
            now: Time::from_secs(1.0),
            q,
            ends: RefCell::default(),
            blamed: None,
            next: 1,
            stopped: 0,
        }
    }

    pub fn seen<T>(&mut self, f: impl FnOnce(&mut FilterCore, &RobotSnapshot) -> T) -> T {
        let ends = self.ends.borrow();
        let end_of = |id: CommitId| ends.get(&id.0).copied();
        let blamed = self.blamed.clone();
        let seen = RobotSnapshot {
            now: self.now,
            status: self.status,
            q: &self.q,
            end_of: &end_of,
            to_blame: &|_| blamed.clone(),
        };
        f(&mut self.core, &seen)
    }

    /// Executes a request on a connection as the service does. A question counts as answered.
    pub fn ask(&mut self, connection: u64, request: &BoardRequest) -> Result<KnownBetter, BoardReply> {
        let client = BoardClient { part: 0, connection, from: "/me/rpc:o", listens: true };
        let step = self.seen(|core, seen| core.request(&client, request, seen));
        match &step {
            FilterDecision::Question(question) => self.seen(|core, seen| core.knows_better(&client, question, seen)),
            step => Err(self.act(&client, step)),
        }
    }

    /// Executes a step other than a question as the service does.
    pub fn act(&mut self, client: &BoardClient, step: &FilterDecision) -> BoardReply {
        match step {
            FilterDecision::Reply(reply) => *reply,
            FilterDecision::Question(_) => BoardReply::Refused,
            FilterDecision::Stop => {
                self.stopped += 1;
                BoardReply::Accepted
            }
            FilterDecision::Commit(_) | FilterDecision::Stream(_) => {
                let verdict = Ok(CommitId(self.next));
                self.status = Status::Moving;
                self.seen(|core, seen| core.accepted(client, step, &verdict, seen))
            }
        }
    }

    /// Executes a streamed command on a connection without replies, with its motion committed.
    pub fn stream(&mut self, connection: u64, request: &BoardRequest) -> Option<FilterDecision> {
        let client = BoardClient { part: 0, connection, from: "/me/command:o", listens: false };
        let step = self.seen(|core, seen| core.streamed(&client, request, seen));
        if let Some(step) = &step {
            let verdict = Ok(CommitId(self.next));
            self.status = Status::Moving;
            self.seen(|core, seen| core.accepted(&client, step, &verdict, seen));
        }
        step
    }

    pub fn end(&mut self, end: MotionEnd) {
        self.ends.borrow_mut().insert(self.next, end);
        self.next += 1;
        self.status = Status::Rest;
    }
}
