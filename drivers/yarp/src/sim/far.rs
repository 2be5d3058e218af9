//! A simulated board and the simulated connection to it.

use super::board::{SimBoard, SimClock};
use super::faults::{Faults, Who, WireFault};
use super::judge::{Judge, JudgedConnection};
use mobee_contract::Time;
use mobee_sim::SimHardware;
use mobee_yarp::board::{Ask, AxisFacts, Device, Get, Joints, Quantity, Set, Streamed, Units, reply};
use mobee_yarp::{Bottle, CallError, JointData, Stamp};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::{sleep, timeout};

/// Shortest and longest pause between two attempts to connect.
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(2));

/// One board at the far end of its wire.
pub(super) struct Far {
    /// Index of the board.
    pub index: usize,
    /// Prefix of its port names.
    pub port: String,
    /// The board's YARP interface.
    pub board: SimBoard,
    /// The simulated hardware.
    pub hardware: SimHardware,
    /// Units of its joints.
    pub units: Units,
    pub clock: SimClock,
    pub faults: Arc<Mutex<Faults>>,
    pub judge: Arc<Mutex<Judge>>,
}

/// Locks a value. A poisoned lock is used anyway, because hardware is intact when a program crashed
/// while holding it.
pub(super) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Far {
    pub fn now(&self) -> Time {
        self.clock.now()
    }

    /// True if a fault that matches is active now.
    pub fn suffers(&self, which: impl Fn(&WireFault) -> bool) -> bool {
        lock(&self.faults).on(self.now()).any(|f| which(&f))
    }

    /// True if connections break now.
    pub fn is_cut(&self) -> bool {
        self.suffers(|f| *f == WireFault::Cut)
    }

    /// Panics, without output on the terminal, if this task is to die now.
    pub fn may_kill(&self, who: Who) {
        if self.dies(who) {
            std::panic::resume_unwind(Box::new("planted"));
        }
    }

    /// True if this task is to die now.
    pub fn dies(&self, who: Who) -> bool {
        let now = self.now();
        let dies = lock(&self.faults).take(now, |f| *f == WireFault::Dies(who));
        if dies {
            lock(&self.judge).died(now);
        }
        dies
    }

    /// Sends a request on one of the connections and waits for the answer. The request arrives even if the
    /// caller no longer waits.
    pub async fn exchange(
        self: &Arc<Far>,
        line: JudgedConnection,
        ask: &Ask,
        patience: Duration,
    ) -> Result<Bottle, CallError> {
        let now = self.now();
        lock(&self.judge).sent(self.index, line, ask, now);
        let fate = lock(&self.faults).fate(now);
        let (reply_to, answer) = oneshot::channel();
        let far = self.clone();
        let request = ask.clone();
        tokio::spawn(async move {
            if !fate.there.is_zero() {
                sleep(fate.there).await;
            }
            if fate.lost || far.is_cut() {
                return far.withhold_answer(reply_to).await;
            }
            let answer = far.carry_out(&request, fate.nack);
            sleep(fate.back).await;
            if fate.unanswered || far.is_cut() {
                return far.withhold_answer(reply_to).await;
            }
            let _ = reply_to.send(answer);
        });
        let ended = timeout(patience, answer).await;
        let to = self.port.clone();
        let now = self.now();
        lock(&self.judge).exchange_ended(self.index, line, now, matches!(ended, Ok(Ok(_))));
        match ended {
            Ok(Ok(answer)) => Ok(answer),
            Ok(Err(_)) => Err(CallError::Broken { to, why: "the wire was cut".into() }),
            Err(_) => Err(CallError::Late { to, after: patience }),
        }
    }

    /// Withholds the answer; a connection that is cut breaks.
    async fn withhold_answer(&self, reply_to: oneshot::Sender<Bottle>) {
        while !reply_to.is_closed() && !self.is_cut() {
            sleep(Duration::from_millis(10)).await;
        }
    }

    fn carry_out(&self, ask: &Ask, nack: bool) -> Bottle {
        let now = self.now();
        if matches!(ask, Ask::Set(Set::Move { .. })) {
            lock(&self.judge).moves(self.index, now);
            self.may_meddle(now);
        }
        let is_stop = matches!(ask, Ask::Set(Set::Stop(_)));
        if is_stop && lock(&self.faults).take(now, |f| matches!(f, WireFault::Deaf(_))) {
            lock(&self.judge).ignored(self.index, now);
            return reply::ok();
        }
        if nack && matches!(ask, Ask::Set(_)) {
            return reply::fail();
        }
        let answer = self.board.answer(&ask.bottle());
        let reads = matches!(ask, Ask::Get(Get::Values(Quantity::ReferenceSpeed, _)));
        if reads || matches!(ask, Ask::Set(Set::Speed(..))) {
            lock(&self.judge).meddled(self.index, false);
        }
        if matches!(ask, Ask::Set(Set::Speed(..))) {
            self.may_meddle(now);
        }
        answer
    }

    /// Lets another program set the references to their maximum, if such a fault is active.
    fn may_meddle(&self, now: Time) {
        if lock(&self.faults).meddles(now) {
            lock(&self.judge).meddled(self.index, true);
            let greatest = self.facts().iter().map(|axis| axis.max_speed.unwrap_or_default()).collect();
            self.board.answer(&Ask::Set(Set::Speed(Joints::All, greatest)).bottle());
        }
    }

    /// Sends setpoints; ready once they have arrived or are lost.
    pub async fn stream(&self, command: &Streamed) {
        let now = self.now();
        let fate = lock(&self.faults).fate(now);
        lock(&self.judge).streamed(self.index, command, now);
        if !fate.there.is_zero() {
            sleep(fate.there).await;
        }
        if !(fate.lost || fate.unanswered || self.is_cut()) {
            let (head, body) = command.pair();
            self.board.command("driver", 0, head, body);
        }
    }

    /// State now, with the transit times of its copies; `None` if nothing is published.
    pub fn state(&self) -> Option<(Vec<Duration>, Stamp, JointData)> {
        let now = self.now();
        let (mut stamp, joints) = self.board.state()?;
        let (ways, off) = lock(&self.faults).states(now);
        stamp.time += off;
        // rejects invalid positions, as the client of a real board does
        let q = &joints.position.values;
        let fits = q.len() == self.facts().len() && q.iter().all(|q| q.is_finite());
        (fits && !ways.is_empty()).then_some((ways, stamp, joints))
    }

    /// Reports the true state of the motors to the judge.
    pub fn look(&self) {
        let now = self.now();
        let q = self.hardware.positions(now);
        let speeds = self.hardware.speeds(now);
        let settings = self.board.joint_settings();
        let faults = lock(&self.faults);
        let mut judge = lock(&self.judge);
        judge.see(self.index, now, (&q, &speeds), &faults);
        // a delayed motor stands still without having reached its end
        let held = self.hardware.held(now).into_iter().flatten().any(|(_, ahead)| ahead > 0.0);
        let rests = !held && speeds.iter().all(|v| *v == 0.0);
        judge.see_settings(self.index, now, (settings, rests), &faults);
    }

    /// Facts of the board's axes.
    pub fn facts(&self) -> Arc<[AxisFacts]> {
        facts(&self.hardware, &self.units)
    }
}

/// Facts of a simulated board's axes.
pub(super) fn facts(hardware: &SimHardware, units: &Units) -> Arc<[AxisFacts]> {
    let axis = |(j, a): (usize, &mobee_contract::Axis)| {
        let wire = |rad: f64| units.kind(j).to_wire(rad.to_degrees());
        AxisFacts {
            name: a.name.clone(),
            kind: units.kind(j),
            limits: Some((wire(a.min), wire(a.max))),
            max_speed: Some(wire(a.max_speed)),
        }
    };
    hardware.axes().iter().enumerate().map(axis).collect()
}

/// A connection that is re-established after every loss, with growing pauses.
#[derive(Debug)]
pub(super) struct KeptConnection {
    is_up: bool,
    until: Time,
    pause: Duration,
}

impl KeptConnection {
    pub fn new() -> KeptConnection {
        KeptConnection { is_up: false, until: Time::ZERO, pause: PAUSES.0 }
    }

    /// Time of the next attempt.
    pub fn until(&self) -> Time {
        if self.is_up { Time::ZERO } else { self.until }
    }

    /// Sends a request, if there is a connection or one can be made now.
    pub async fn send(
        &mut self,
        far: &Arc<Far>,
        line: JudgedConnection,
        ask: &Ask,
        patience: Duration,
    ) -> Result<Bottle, CallError> {
        let now = far.now();
        let broken = |why: &str| CallError::Broken { to: far.port.clone(), why: why.to_owned() };
        if !self.is_up {
            if now < self.until {
                return Err(broken("waiting before the next attempt"));
            }
            (self.until, self.pause) = (now + self.pause, (self.pause * 2).min(PAUSES.1));
            if far.is_cut() {
                return Err(broken("no connection"));
            }
            self.is_up = true;
        }
        // a canceled exchange leaves no connection
        self.is_up = false;
        let answer = far.exchange(line, ask, patience).await;
        self.is_up = answer.is_ok();
        if self.is_up {
            self.pause = PAUSES.0;
        }
        answer
    }
}
