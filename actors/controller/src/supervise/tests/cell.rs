//! Supervise and reflex together with a guard and a plant of one motor: the system under test of the pure core.

use super::*;
use std::hash::{Hash, Hasher};

/// Kinds of controllers: straight, under forces, these without a reflex, and on a board that takes velocities only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Straight,
    Fields,
    NoReflex,
    Velocities,
}

fn rules(kind: Kind) -> Arc<Rules> {
    let period = Duration::from_millis(10);
    let board =
        Board { axes: vec![axis()], period, latency: Duration::ZERO, position_direct: kind != Kind::Velocities };
    let fields = FieldsSettings { reflex: kind != Kind::NoReflex, ..FieldsSettings::default() };
    let drive = if kind == Kind::Straight { Drive::Straight } else { Drive::Fields(fields) };
    let controller = ControllerSettings { drive, ..ControllerSettings::default() };
    let rules = Rules::new("r", vec!["p".into()], &controller, &board);
    Arc::new(rules.driving(&controller, &one_motor()))
}

fn one_motor() -> Robot {
    let part = Part { name: "p".into(), motors: 0..1, root_node: None, clauses: Vec::new() };
    let (parts, motors, pairs) = (vec![part], Vec::new(), NodePairs::default());
    Robot {
        name: "r".into(),
        parts,
        motors,
        nodes: Vec::new(),
        markers: Vec::new(),
        pairs,
        left_out: None,
        near: Vec::new(),
        bare: Vec::new(),
    }
}

#[derive(Clone, Debug)]
pub(super) enum Op {
    Commit(f64, bool),
    /// A position set-point at this distance from the motor, or a velocity.
    Position(f64, bool),
    Velocity(f64, bool),
    /// This number of velocity set-points, one per two readings.
    Stream(f64, u8),
    /// This number of readings.
    Samples(u8),
    /// Time without readings, in which the motor stands still, as in a paused simulator.
    Silence(u8),
    /// An obstacle is beyond this position, or is removed.
    Wall(Option<f64>),
    Stop,
    /// The board reports a fault.
    Fault,
    AgentDies,
    SuperviseDies,
    ReflexDies,
    Recover,
    Halt,
    Release,
    /// Deliver one message on this link.
    Deliver(u8),
}

#[derive(Clone, Debug)]
enum ToSupervise {
    Pulse(Box<Pulse>),
    Closed(u64, Cause),
    ReflexReport(ReflexReport),
}
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a queue of a test holds a few of them")]
enum ToReflex {
    Pulse(Pulse),
    RollBack(u64, Underway, bool),
}

/// Two cores, a guard and a plant that moves at a constant speed and stops at once. It checks the promises itself.
pub(super) struct Cell {
    pub rules: Arc<Rules>,
    pub gate: Gate,
    pub book: TransactionState,
    pub supervise: SuperviseCore,
    pub reflex: ReflexCore,
    pub joint_retreat: JointRetreat,
    scene: Arc<Scene>,
    guard: CommandGuard,
    driver: VecDeque<(u64, Writer, Command)>,
    to_supervise: VecDeque<ToSupervise>,
    to_reflex: VecDeque<ToReflex>,
    pub now: Time,
    /// Time between two readings, and whether they have the motor's present speed rather than an estimate.
    step: (Duration, bool),
    seq: u64,
    pub q: f64,
    pub goal: f64,
    speed: f64,
    /// True if it moved as it was read: a step within the tolerance that ends at the goal is over, and no reading can
    /// show it.
    moves: bool,
    /// Its velocity, and the time until which it moves.
    running: Option<(f64, Time)>,
    pub mode: ControlMode,
    /// Last set-point of supervise: token, position, time.
    written: Option<(u64, f64, Time)>,
    pub wall: Option<f64>,
    /// An obstacle touches it while it is moving.
    pub touching: bool,
    pub commits: u64,
    pub outcomes: Vec<CommitId>,
    /// Journaled refusals.
    pub refused: u64,
    /// Last outcome.
    pub outcome: Option<Outcome>,
    /// An actor was restarted since the last commit (I10).
    restarted: bool,
    /// A retreat is being driven: its token, and the distance of the wall as it began (I9).
    way: Option<(u64, f64)>,
    /// Distance of the wall in the last reading of the reflex, and the least one since the filter was closed.
    pub near_at: f64,
    least: f64,
    /// Hash of everything that was read.
    read: u64,
}

impl Cell {
    /// With readings every 10 ms.
    pub fn new() -> Cell {
        Cell::of(Kind::Straight)
    }

    /// The same with a controller of this kind.
    pub fn of(kind: Kind) -> Cell {
        Cell::with(kind, Duration::from_millis(10), false, 3000)
    }

    /// With readings so far apart that each shows the effect of the commands at the previous one, and exact speeds.
    pub fn coarse() -> Cell {
        Cell::with(Kind::Straight, Duration::from_millis(40), true, 32)
    }

    /// With readings so far apart, exact or estimated speeds, and a history of this length.
    pub fn with(kind: Kind, step: Duration, exact: bool, history: usize) -> Cell {
        let (rules, gate, mut book) = (rules(kind), Gate::default(), TransactionState::new(history));
        let joint_retreat = JointRetreat::default();
        let shared = &mut Shared { rules: &rules, gate: &gate, book: &mut book, joint_retreat: &joint_retreat };
        let (supervise, first) = SuperviseCore::new(shared, Time::ZERO);
        let mut cell = Cell {
            reflex: ReflexCore::new(0, shared),
            joint_retreat,
            scene: Arc::new(Scene::new(vec![(Arc::new(one_motor()), Isometry3::identity())], Vec::new()).unwrap()),
            guard: CommandGuard::new(rules.clone()),
            rules,
            gate,
            book,
            supervise,
            driver: VecDeque::new(),
            to_supervise: VecDeque::new(),
            to_reflex: VecDeque::new(),
            now: Time::ZERO,
            step: (step, exact),
            seq: 0,
            q: 0.0,
            goal: 0.0,
            speed: 0.0,
            moves: false,
            running: None,
            mode: ControlMode::Position,
            written: None,
            wall: None,
            touching: false,
            commits: 0,
            outcomes: Vec::new(),
            refused: 0,
            outcome: None,
            restarted: false,
            way: None,
            near_at: f64::INFINITY,
            least: f64::INFINITY,
            read: 0,
        };
        cell.supervise_out(first);
        cell
    }

    /// A copy in the same state.
    pub fn fork(&self) -> Cell {
        Cell {
            supervise: self.supervise.clone(),
            reflex: self.reflex.clone(),
            joint_retreat: self.joint_retreat.fork(),
            guard: CommandGuard::new(self.rules.clone()),
            gate: Gate::resumed(self.gate.token()),
            book: self.book.clone(),
            rules: self.rules.clone(),
            scene: self.scene.clone(),
            driver: self.driver.clone(),
            to_supervise: self.to_supervise.clone(),
            to_reflex: self.to_reflex.clone(),
            outcomes: self.outcomes.clone(),
            ..*self
        }
    }

    /// Hash of everything that its future depends on.
    pub fn state(&self) -> u64 {
        let cores = (&self.supervise, &self.reflex, &self.book, &self.joint_retreat, &self.gate);
        let queues = (&self.driver, &self.to_supervise, &self.to_reflex);
        let plant = (self.now, self.q, self.goal, self.speed, self.moves, self.mode, self.wall);
        let watched = (self.written, self.restarted, self.way, (self.near_at, self.least), self.read);
        let mut hasher = std::hash::DefaultHasher::new();
        format!("{:?}", (cores, queues, plant, watched)).hash(&mut hasher);
        hasher.finish()
    }

    fn near(&self) -> Arc<[Contact]> {
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let contact = |distance: f64| Contact { pair, distance, points: Default::default() };
        let touching = (self.touching && self.q > 0.1).then_some(0.005);
        let walls = self.wall.map(|wall| (wall - self.q).abs() - 0.05).into_iter().chain(touching);
        walls.map(contact).filter(|c| c.distance < 0.012).collect()
    }

    /// Performs a step of supervise.
    pub fn on(&mut self, input: SuperviseIn, now: Time) -> Vec<SuperviseOut> {
        let Cell { rules, gate, book, joint_retreat, .. } = self;
        self.supervise.on(input, now, &mut Shared { rules, gate, book, joint_retreat })
    }

    /// The same, and returns its actions.
    pub fn supervise_on(&mut self, input: SuperviseIn) {
        let outputs = self.on(input, self.now);
        self.supervise_out(outputs);
    }

    fn supervise_out(&mut self, outputs: Vec<SuperviseOut>) {
        for output in outputs {
            match output {
                SuperviseOut::Command(token, writer, command) => {
                    let q = if let Command::Direct { q, .. } = &command { Some((token, q[0], self.now)) } else { None };
                    if let (Some((before, old, at)), Some((token, q, now))) = (self.written, q)
                        && before == token
                    {
                        let most = 1.7 * now.since(at).as_secs_f64();
                        assert!((q - old).abs() <= most + 1e-9, "I5: a step from {old} to {q}, {most} is allowed");
                    }
                    self.written = q;
                    if let Command::Velocity { speed, .. } = &command {
                        self.abandoned_at(speed[0]);
                    }
                    self.driver.push_back((token, writer, command));
                }
                SuperviseOut::RollBack { token, motion, again } => {
                    self.to_reflex.push_back(ToReflex::RollBack(token, motion, again));
                }
                SuperviseOut::Event(Event::Commit { id, .. }) => {
                    self.commits += 1;
                    assert_eq!(id, CommitId(self.commits), "I2: numbers are counted");
                    assert_eq!(self.commits - 1, self.outcomes.len() as u64, "I2: accepted while another was open");
                    self.restarted = false;
                }
                SuperviseOut::Event(Event::Outcome { id, outcome, .. }) => {
                    self.outcomes.push(id);
                    assert_eq!(self.outcomes.len() as u64, self.commits, "I2: an outcome that is not due");
                    assert!(!self.moves, "I17: the motor moves as commit {} ends: {outcome:?}", id.0);
                    self.outcome = Some(outcome);
                }
                SuperviseOut::Event(Event::Refused { .. }) => self.refused += 1,
                SuperviseOut::Event(Event::SafePose { q, age, .. }) => {
                    assert!(age <= self.rules.fresh.as_secs_f64(), "I4: the reading is {age} s old");
                    assert!((q[0] - self.q).abs() < 0.01, "I4: {q:?} while the motor is at {}", self.q);
                    assert!(
                        self.supervise.newest.as_ref().is_some_and(|n| n.free),
                        "I4: the newest reading is not free"
                    );
                    assert!(self.supervise.newest.as_ref().is_some_and(|n| n.at_rest), "I4: the robot does not rest");
                    assert_eq!(self.commits, self.outcomes.len() as u64, "I4: taken with a transaction open");
                }
                _ => {}
            }
        }
    }

    /// No further commands after this velocity was written: the motor moves on until its lease expires, then it
    /// brakes.
    fn abandoned_at(&self, speed: f64) {
        let lease = self.supervise.newest.as_ref().map_or(self.now, |newest| newest.sampled_at + self.rules.fresh);
        let most = self.rules.axes[0].max_acceleration;
        let rest = self.q + speed * (lease.since(self.now).as_secs_f64() + speed.abs() / (2.0 * most));
        assert!(rest.abs() <= 3.0, "I5: abandoned at {speed} rad/s, the motor rests past the limit, at {rest}");
    }

    fn reflex_on(&mut self, input: ReflexIn) {
        let read = if let ReflexIn::Pulse(pulse) = &input { Some(pulse.contacts.clone()) } else { None };
        let near = |c: &Arc<[Contact]>| c.first().map_or(f64::INFINITY, |c| c.distance);
        let distance = read.as_ref().map_or(self.near_at, near);
        self.near_at = distance;
        self.least = if self.gate.is_open() { distance } else { self.least.min(distance) };
        let watched = self.way.filter(|(token, _)| read.is_some() && *token == self.gate.token());
        let blocked = watched.is_some_and(|(_, start)| distance < start.min(self.rules.margin) - 0.001);
        let moving = read.is_some() && self.gate.is_open() && self.book.status == Status::Moving;
        let (mut stops, mut drives) = (false, false);
        let Cell { rules, gate, book, joint_retreat, .. } = self;
        let shared = &Shared { rules, gate, book, joint_retreat };
        for output in self.reflex.on(input, self.now, shared, &|_| Default::default()) {
            match output {
                ReflexOut::Command(token, command) => {
                    stops |= matches!(command, Command::Stop { .. });
                    drives |= matches!(command, Command::Direct { .. } | Command::Move(_));
                    self.driver.push_back((token, Writer::Reflex, command));
                }
                ReflexOut::Closed { token, cause } => self.to_supervise.push_back(ToSupervise::Closed(token, cause)),
                ReflexOut::ReflexReport(report) => {
                    if matches!(report, ReflexReport::Back | ReflexReport::GaveUp(_)) {
                        self.way = None;
                    }
                    self.to_supervise.push_back(ToSupervise::ReflexReport(report));
                }
                ReflexOut::Bring(asked) => {
                    let who = asked.participant(
                        self.rules.clone(),
                        &self.book.history,
                        self.scene.clone(),
                        vec![vec![self.q].into()],
                    );
                    let enrolled = who.map(|who| self.joint_retreat.enroll(who, self.now));
                    self.reflex_on(ReflexIn::Brought(enrolled));
                }
                ReflexOut::Event(Event::RetreatBegan { .. }) => {
                    self.way = Some((self.gate.token(), self.least));
                    assert!(self.commits > self.outcomes.len() as u64 || !self.restarted, "I10: nothing is open");
                    self.restarted = false;
                }
                ReflexOut::Event(Event::RetreatStopped { .. }) => self.way = None,
                ReflexOut::Event(_) => {}
            }
        }
        let ignored = self.rules.reflex && moving && distance < self.rules.margin && self.gate.is_open();
        assert!(!ignored, "a contact in mid-motion, {distance} m, closed nothing");
        assert!(!blocked || (stops && !drives), "I9: drives on, {distance} m from what is in the retreat");
    }

    pub fn deliver(&mut self, link: u8) {
        match link {
            0 => {
                let Some((token, writer, command)) = self.driver.pop_front() else { return };
                let Ok(()) = self.guard.admit(&self.gate, token, writer, &command) else { return };
                assert_eq!(token, self.gate.token(), "I1: a command under an old token");
                assert!(
                    writer != Writer::Agent || self.gate.is_open(),
                    "I1: an agent's command passed a closed filter"
                );
                let drives = matches!(command, Command::Move(_) | Command::Direct { .. } | Command::Velocity { .. });
                assert!(!(drives && self.restarted), "I10: {command:?} after a restart, before a new commit");
                self.guard.took(token, writer, &command, self.now);
                let runs = self.running.take();
                match command {
                    Command::Move(m) => {
                        self.mode = ControlMode::Position;
                        self.goal = m.q[0];
                        self.speed = m.speed.map_or(1.0, |s| s[0]);
                    }
                    Command::Direct { q, .. } => {
                        assert_eq!(self.mode, ControlMode::PositionDirect, "a set-point in the wrong mode");
                        self.goal = q[0];
                        self.speed = 1.7;
                    }
                    Command::Velocity { speed, .. } => {
                        assert_eq!(self.mode, ControlMode::Velocity, "a velocity in the wrong mode");
                        self.running = Some((speed[0], self.now + Duration::from_millis(100)));
                    }
                    Command::Stop { .. } => self.goal = self.q,
                    Command::Mode { mode, .. } if mode != self.mode => {
                        self.mode = mode;
                        self.goal = self.q;
                    }
                    _ => self.running = runs,
                }
            }
            1 => match self.to_reflex.pop_front() {
                Some(ToReflex::Pulse(mut pulse)) => {
                    self.reflex_on(ReflexIn::Pulse(&mut pulse));
                    self.to_supervise.push_back(ToSupervise::Pulse(Box::new(pulse)));
                }
                Some(ToReflex::RollBack(token, motion, again)) => {
                    self.reflex_on(ReflexIn::RollBack { token, motion, again });
                }
                None => {}
            },
            _ => match self.to_supervise.pop_front() {
                Some(ToSupervise::Pulse(pulse)) => self.supervise_on(SuperviseIn::Pulse(&pulse)),
                Some(ToSupervise::Closed(token, cause)) => {
                    self.supervise_on(SuperviseIn::Closed(token, cause, None));
                }
                Some(ToSupervise::ReflexReport(report)) => self.supervise_on(SuperviseIn::ReflexReport(report)),
                None => {}
            },
        }
    }

    /// Drops the messages that wait for the driver.
    pub fn lose(&mut self) {
        self.driver.clear();
    }

    /// Returns whether a message waits to be delivered on this link.
    pub fn waits(&self, link: u8) -> bool {
        match link {
            0 => !self.driver.is_empty(),
            1 => !self.to_reflex.is_empty(),
            _ => !self.to_supervise.is_empty(),
        }
    }

    pub fn flush(&mut self) {
        while !(self.driver.is_empty() && self.to_reflex.is_empty() && self.to_supervise.is_empty()) {
            (0..3).for_each(|link| self.deliver(link));
        }
    }

    /// Advances time to the next reading, which waits for the reflex.
    pub fn sample(&mut self) {
        assert!(self.seq < 100_000, "whatever is waited for does not come");
        self.now = self.now + self.step.0;
        let secs = self.step.0.as_secs_f64();
        if let Some((v, until)) = self.running {
            if self.now <= until {
                self.goal = self.q + v * secs;
                self.speed = 1.7;
            } else {
                (self.running, self.goal) = (None, self.q);
            }
        }
        let way = (self.goal - self.q).clamp(-self.speed * secs, self.speed * secs);
        self.q += way;
        let done = self.q == self.goal && self.running.is_none();
        self.moves = way.abs() >= self.rules.rest_speed * secs && !(done && way.abs() <= self.rules.tolerance);
        assert!(self.q.abs() <= 3.0 + 1e-9, "I5: past the limit, at {}", self.q);
        self.seq += 1;
        let sample =
            Sample { seq: self.seq, at: self.now, q: vec![self.q].into(), done: vec![done], ..Sample::default() };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        self.book.history.push(&mut pulse, self.rules.fresh);
        if self.step.1 {
            pulse.speed = way.abs() / secs;
        }
        pulse.contacts = self.near();
        // for a motion under forces, a field with a range of 0.3 rad pushes the reference off the wall
        let ahead = self.book.ahead.as_ref().map_or(self.q, |q| q[0]);
        pulse.push = self.wall.filter(|wall| (wall - ahead).abs() < 0.3).map(|wall| {
            let torque = 0.1 * (0.3 - (wall - ahead).abs());
            vec![if wall > ahead { -torque } else { torque }].into()
        });
        let mut hasher = std::hash::DefaultHasher::new();
        (self.read, self.now.0, self.q.to_bits()).hash(&mut hasher);
        self.read = hasher.finish();
        self.to_reflex.push_back(ToReflex::Pulse(pulse));
    }

    /// Delivers the waiting messages of reflex and supervise in order.
    pub fn settle_chain(&mut self) {
        while !self.to_reflex.is_empty() {
            self.deliver(1);
        }
        while !self.to_supervise.is_empty() {
            self.deliver(2);
        }
    }

    pub fn tick(&mut self) {
        self.supervise_on(SuperviseIn::Tick);
    }

    fn dies(&mut self, supervise: bool) {
        self.gate.close();
        self.book.died = Some("somebody".into());
        self.to_reflex.clear();
        (self.restarted, self.way, self.near_at, self.least) = (true, None, f64::INFINITY, f64::INFINITY);
        let Cell { rules, gate, book, joint_retreat, .. } = self;
        let shared = &mut Shared { rules, gate, book, joint_retreat };
        self.reflex = ReflexCore::new(0, shared);
        if supervise {
            let (core, first) = SuperviseCore::new(shared, self.now);
            self.to_supervise.clear();
            self.supervise = core;
            self.supervise_out(first);
        }
    }

    /// Readings until it is settled: two hundred seconds at most, since an escape from one end to the other takes
    /// long.
    pub fn heal(&mut self) {
        for round in 0..200 {
            self.apply(Op::Samples(100));
            if round > 0 && self.supervise.is_settled() {
                return;
            }
        }
    }

    pub fn commit(&mut self, q: f64, own: bool) -> Verdict {
        let agent: Arc<str> = if own { "a" } else { "b" }.into();
        let commit = Commit { agent, target: Target { motors: vec![0], q: vec![q], speed: 0.5 }, speeds: None };
        let out = self.on(SuperviseIn::Commit(commit), self.now);
        self.answered(out)
    }

    fn answered(&mut self, out: Vec<SuperviseOut>) -> Verdict {
        let verdict = match out.first() {
            Some(SuperviseOut::Verdict(verdict)) => verdict.clone(),
            other => panic!("no verdict but {other:?}"),
        };
        self.supervise_out(out);
        verdict
    }

    pub fn stream(&mut self, own: bool, values: Values) -> Verdict {
        let agent: Arc<str> = if own { "a" } else { "b" }.into();
        let setpoints = Setpoints { motors: vec![0], values };
        let out = self.on(SuperviseIn::Stream(agent, setpoints), self.now);
        self.answered(out)
    }

    pub fn apply(&mut self, op: Op) {
        match op {
            Op::Position(by, own) => {
                let _ = self.stream(own, Values::Position(vec![self.q + by]));
            }
            Op::Velocity(v, own) => {
                let _ = self.stream(own, Values::Velocity(vec![v]));
            }
            Op::Stream(v, n) => (0..n).for_each(|_| {
                let _ = self.stream(true, Values::Velocity(vec![v]));
                self.apply(Op::Samples(2));
            }),
            Op::Commit(q, own) => {
                let _ = self.commit(q, own);
            }
            Op::Samples(n) => (0..n).for_each(|i| {
                self.sample();
                if i % 8 == 7 {
                    self.tick();
                }
                self.flush();
            }),
            Op::Silence(n) => {
                // a driver without readings still accepts commands, well within the reaction time
                while !self.driver.is_empty() {
                    self.deliver(0);
                }
                self.now = self.now + self.step.0 * u32::from(n);
                self.tick();
            }
            Op::Wall(wall) => self.wall = wall,
            Op::Stop => {
                self.supervise_on(SuperviseIn::Stop("a".into()));
            }
            Op::Fault => {
                self.supervise_on(SuperviseIn::Fault("hot".into()));
            }
            Op::AgentDies => {
                self.supervise_on(SuperviseIn::AgentDied("a".into()));
            }
            Op::SuperviseDies => self.dies(true),
            Op::ReflexDies => self.dies(false),
            Op::Recover => {
                self.restarted = false;
                self.supervise_on(SuperviseIn::Recover);
            }
            Op::Halt => {
                self.book.halted = true;
                self.supervise_on(SuperviseIn::Halt);
            }
            Op::Release => {
                self.book.halted = false;
                self.supervise_on(SuperviseIn::Release);
            }
            Op::Deliver(link) => self.deliver(link),
        }
    }
}
