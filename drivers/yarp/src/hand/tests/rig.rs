//! A hand and a scripted board of two joints. Runs in virtual time, without a network.

use super::super::super::YarpDriverSettings;
use super::super::super::cell::{BoardFacts, describe, instant, word};
use super::super::super::layout::{Layout, Patch};
use super::super::super::remote::{Later, Remote};
use super::super::super::states::states;
use super::super::{Do, Halt, Hand, Order};
use super::*;
use mobee_yarp::board::{AxisFacts, JointKind, RemoteState, Shadow, ShadowAxis};
use mobee_yarp::{Bottle, CallError, JointField, Stamp};

/// Answer time of the board.
const ANSWERS: Duration = Duration::from_millis(1);
/// Period of the board's states.
const PUBLISHES: Duration = Duration::from_millis(10);

/// A message that the board received.
#[derive(Clone, Debug, PartialEq)]
pub enum Received {
    Request(Ask),
    Streamed(Streamed),
    Hushed,
}

/// Scripted behavior of a board that differs from that of real ones.
pub enum Trick {
    Refuses,
    /// Answers this, without effect.
    Says(Bottle),
    /// Breaks the connection before the answer.
    Breaks,
    /// Acts at once, and answers this much later.
    Late(Duration),
}

type Tricks = Box<dyn FnMut(&FakeBoard, &Ask) -> Option<Trick> + Send>;

/// A scripted board with a record of all messages.
pub struct FakeBoard {
    pub shadow: Mutex<Shadow>,
    received: Mutex<Vec<(u64, Received)>>,
    tricks: Mutex<Tricks>,
    pub link: watch::Sender<LinkState>,
    facts: watch::Sender<Option<Arc<[AxisFacts]>>>,
    state: watch::Sender<Option<Arc<RemoteState>>>,
    /// True if its states contain modes.
    pub tells_modes: Mutex<bool>,
    base: Instant,
}

impl FakeBoard {
    fn new(base: Instant) -> FakeBoard {
        let axis = |name| ShadowAxis::at_rest(name, -90.0, 90.0, 50.0, 0.0);
        let fact = |axis: &ShadowAxis| AxisFacts {
            name: axis.name.clone(),
            kind: JointKind::Revolute,
            limits: Some((axis.min, axis.max)),
            max_speed: Some(axis.max_speed),
        };
        let axes = vec![axis("shoulder"), axis("elbow")];
        FakeBoard {
            facts: watch::Sender::new(Some(axes.iter().map(fact).collect())),
            shadow: Mutex::new(Shadow { axes }),
            received: Mutex::default(),
            tricks: Mutex::new(Box::new(|_, _| None)),
            link: watch::Sender::new(LinkState::Down("not connected yet".into())),
            state: watch::Sender::new(None),
            tells_modes: Mutex::new(true),
            base,
        }
    }

    fn record(&self, what: Received) {
        let ms = (instant().duration_since(self.base).as_secs_f64() * 1e3).round() as u64;
        self.received.lock().unwrap().push((ms, what));
    }

    /// Sets the scripted behavior from now on.
    pub fn plays(&self, trick: impl FnMut(&FakeBoard, &Ask) -> Option<Trick> + Send + 'static) {
        *self.tricks.lock().unwrap() = Box::new(trick);
    }

    /// Changes a joint.
    pub fn with(&self, joint: usize, change: impl FnOnce(&mut ShadowAxis)) {
        change(&mut self.shadow.lock().unwrap().axes[joint]);
    }

    fn takes(&self, ask: &Ask) -> Bottle {
        let mut shadow = self.shadow.lock().unwrap();
        let time = 5.0 + instant().duration_since(self.base).as_secs_f64();
        if let Some(answer) = shadow.answer(&ask.bottle(), Stamp { count: 1, time }) {
            return answer;
        }
        let mut each = |joints: &Joints, set: &dyn Fn(usize, &mut ShadowAxis)| {
            for (i, j) in joints.on(2).unwrap().into_iter().enumerate() {
                set(i, &mut shadow.axes[j]);
            }
        };
        match ask {
            Ask::Set(Set::Move { joints, values, .. }) => each(joints, &|i, axis| {
                (axis.target, axis.done) = (values[i], false);
            }),
            Ask::Set(Set::Stop(joints)) => each(joints, &|_, axis| (axis.target, axis.done) = (axis.q, true)),
            Ask::Set(Set::Speed(joints, values)) => each(joints, &|i, axis| axis.ref_speed = values[i]),
            Ask::Set(Set::Acceleration(joints, values)) => each(joints, &|i, axis| axis.ref_acc = values[i]),
            Ask::Set(Set::Mode(joints, words)) => each(joints, &|i, axis| axis.mode = words[i]),
            Ask::Set(Set::Interaction(joints, words)) => each(joints, &|i, axis| axis.interaction = words[i]),
            _ => return reply::fail(),
        }
        reply::ok()
    }

    fn publish(&self, count: u32) {
        let mut joints = self.shadow.lock().unwrap().joint_data();
        if !*self.tells_modes.lock().unwrap() {
            (joints.control_modes, joints.interaction_modes) = (JointField::unknown(2), JointField::unknown(2));
        }
        let time = 5.0 + instant().duration_since(self.base).as_secs_f64();
        let stamp = Some(Stamp { count, time });
        self.state.send_replace(Some(Arc::new(RemoteState {
            seq: u64::from(count),
            stamp,
            arrived: instant(),
            joints,
        })));
    }
}

impl Remote for FakeBoard {
    fn port(&self) -> &str {
        "/arm"
    }
    fn link(&self) -> watch::Receiver<LinkState> {
        self.link.subscribe()
    }
    fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>> {
        self.facts.subscribe()
    }
    fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>> {
        self.state.subscribe()
    }
    fn lost(&self) -> u64 {
        0
    }
    fn ask<'a>(&'a self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        self.record(Received::Request(request.clone()));
        Box::pin(async move {
            let trick = (self.tricks.lock().unwrap())(self, request);
            let answer = match trick {
                None => Ok(self.takes(request)),
                Some(Trick::Refuses) => Ok(reply::fail()),
                Some(Trick::Says(answer)) => Ok(answer),
                Some(Trick::Breaks) => Err(CallError::NoReply("/arm/rpc:i".into())),
                Some(Trick::Late(late)) => {
                    let answer = self.takes(request);
                    sleep(late).await;
                    Ok(answer)
                }
            };
            sleep(ANSWERS).await;
            answer
        })
    }
    fn stream(&self, command: Streamed) -> bool {
        self.record(Received::Streamed(command));
        true
    }
    fn hush(&self) {
        self.record(Received::Hushed);
    }
    fn died(&self) -> Later<'_, ()> {
        Box::pin(std::future::pending())
    }
    fn close(&self) -> Later<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}

/// A hand at the second board of a robot whose first board has a single motor.
pub struct Rig {
    pub cell: Arc<SharedBoards>,
    pub board: Arc<FakeBoard>,
    orders: mpsc::Sender<Order>,
    halt: watch::Sender<Arc<Halt>>,
    _lease: watch::Sender<Option<Instant>>,
    pub end: watch::Sender<bool>,
}

impl Rig {
    /// Creates the rig without a connection.
    pub fn new() -> Rig {
        let patch = |part: &str, motors| Patch {
            part: part.into(),
            port: format!("/{part}"),
            motors,
            units: Default::default(),
        };
        let layout = Arc::new(Layout {
            patches: vec![patch("neck", 0..1), patch("arm", 1..3)],
            home: vec![0.0; 3],
            names: ["nod", "shoulder", "elbow"].map(String::from).into(),
            limits: vec![(-1.0, 1.0); 3],
            speeds: Vec::new(),
            motions: Vec::new(),
        });
        let settings = YarpDriverSettings::of([("neck", "/neck"), ("arm", "/arm")]);
        let cell = Arc::new(SharedBoards::new(&layout));
        cell.take();
        let board = Arc::new(FakeBoard::new(cell.base));
        let facts = board.facts.borrow().clone();
        let mut inner = cell.lock();
        inner.boards.iter_mut().for_each(|known| known.facts = facts.clone());
        inner.board = describe(&layout, &inner.boards, &settings).unwrap();
        drop(inner);
        let (halt, halts) = watch::channel(Arc::new(Halt::default()));
        let (lease, leases) = watch::channel(None);
        let (end, ends) = watch::channel(false);
        let (orders, queue) = mpsc::channel(16);
        let shared = (cell.clone(), layout.clone());
        let queue = Arc::new(tokio::sync::Mutex::new(queue));
        let hand = Hand::new(shared, 1, board.clone(), (halts, leases), queue, 0.05);
        tokio::spawn(hand.work(ends));
        tokio::spawn(states(cell.clone(), layout, 1, board.clone(), settings));
        let publishes = board.clone();
        tokio::spawn(async move {
            for count in 0.. {
                publishes.publish(count);
                sleep(PUBLISHES).await;
            }
        });
        Rig { cell, board, orders, halt, _lease: lease, end }
    }

    /// Creates a rig whose board was taken over and rests. No settings have to be restored, so that all
    /// messages come from orders.
    pub async fn up() -> Rig {
        let rig = Rig::owing().await;
        rig.known(|known| known.owed = Owed::new(2));
        rig
    }

    /// Creates a rig whose board was taken over and whose settings have to be restored.
    pub async fn owing() -> Rig {
        let rig = Rig::new();
        rig.board.link.send_replace(LinkState::Up(1));
        rig.after(200).await;
        assert_eq!(rig.trouble(), None);
        rig.received();
        rig
    }

    /// Waits for this time, ms.
    pub async fn after(&self, ms: u64) {
        sleep(Duration::from_millis(ms)).await;
    }

    pub fn known<T>(&self, look: impl FnOnce(&mut BoardFacts) -> T) -> T {
        look(&mut self.cell.lock().boards[1])
    }

    pub fn trouble(&self) -> Option<Trouble> {
        self.known(|known| known.trouble.clone())
    }

    /// Gives an order, as a driver does.
    pub fn order(&self, what: Do) {
        let epoch = self.halt.borrow().epoch;
        self.order_in(epoch, what);
    }

    /// Gives an order of this epoch.
    pub fn order_in(&self, epoch: u64, what: Do) {
        let (joints, end) = what.disturbs();
        let mut inner = self.cell.lock();
        let ticket = inner.boards[1].motions.order(&joints, end);
        if let Do::Mode { mode, .. } = &what {
            joints.iter().for_each(|j| (inner.expected[1 + j], inner.switching[1 + j]) = (*mode, Some(ticket)));
        }
        self.orders.try_send(Order { epoch, ticket, what }).unwrap();
    }

    /// Stops everything, as a driver does.
    pub fn halts(&self) {
        let ticket = self.known(|known| known.motions.order(&[0, 1], End::Seen));
        self.halt.send_modify(|halt| {
            *halt = Arc::new(Halt { epoch: halt.epoch + 1, tickets: vec![0, ticket], joints: Vec::new() });
        });
    }

    /// Messages that the board received since the last call, each with its time, ms.
    pub fn received(&self) -> Vec<(u64, Received)> {
        std::mem::take(&mut *self.board.received.lock().unwrap())
    }

    /// Settings and commands among them, without queries.
    pub fn commands(&self) -> Vec<Set> {
        let set = |(_, received)| if let Received::Request(Ask::Set(set)) = received { Some(set) } else { None };
        self.received().into_iter().filter_map(set).collect()
    }

    /// Setpoints and velocities among them.
    pub fn streamed(&self) -> Vec<Streamed> {
        let sent = |(_, received)| if let Received::Streamed(sent) = received { Some(sent) } else { None };
        self.received().into_iter().filter_map(sent).collect()
    }

    /// End of motion, per joint.
    pub fn done(&self) -> Vec<bool> {
        self.known(|known| known.motions.done().collect())
    }

    /// Lets the board report this mode for both joints.
    pub async fn is_in(&self, mode: ControlMode) {
        (0..2).for_each(|joint| self.board.with(joint, |axis| axis.mode = word(mode)));
        self.after(20).await;
        self.received();
    }
}

/// Stop of a whole board.
pub fn stop() -> Set {
    Set::Stop(Joints::All)
}

/// Group of these joints.
pub fn group(joints: &[usize]) -> Joints {
    Joints::Group(joints.to_vec())
}

/// Move of the elbow to 20 deg at 10 deg/s.
pub fn to_20() -> Do {
    Do::Move { joints: vec![1], to: vec![20.0], speed: Some(vec![10.0]), acceleration: None }
}

/// Command that the board receives for it once it may move.
pub fn moves() -> Set {
    Set::Move { joints: group(&[1]), values: vec![20.0], relative: false }
}
