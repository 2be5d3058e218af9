//! Worker of one board: executes the orders that drivers queued one after the other, and stops before
//! anything else.

mod modes;
pub mod put_back;
mod references;
mod speed;

use super::cell::SharedBoards;
use super::layout::{Layout, Patch};
use super::motion::End;
use super::remote::Remote;
use mobee_contract::ControlMode;
use mobee_yarp::board::{Ask, Get, Joints, LinkState, Set, Streamed, Units, reply};
use mobee_yarp::{Bottle, CallError};
use speed::JointVelocities;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Mutex, mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};

/// Period of queries whether a motion has ended.
const QUERY_PERIOD: Duration = Duration::from_millis(10);
/// Period at which velocities are sent again: real boards stop a joint that receives nothing for 0.1 s.
const REFRESH: Duration = Duration::from_millis(40);
/// Age of the newest answer at which the board is queried to measure its answer time, s.
const UNASKED: f64 = 0.1;
/// Least reference speed, deg/s, because some boards ignore a zero.
const SLOWEST: f64 = 0.01;

/// Stop of everything: orders of earlier epochs that would move a joint are dropped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Halt {
    /// Counter of halts.
    pub epoch: u64,
    /// Newest ticket of each board at the time of the halt.
    pub tickets: Vec<u64>,
    /// Joints of each board that moved or were commanded to. Only these are stopped, because a joint that
    /// rests under its weight would sink with each stop that makes the measured position its target. `None`,
    /// or no entry: all.
    pub joints: Vec<Option<Vec<usize>>>,
}

impl Halt {
    /// Joints of a board to stop; `None` if none of them moves.
    pub fn stops(&self, board: usize) -> Option<Joints> {
        match self.joints.get(board).cloned().flatten() {
            Some(joints) if joints.is_empty() => None,
            Some(joints) => Some(Joints::Group(joints)),
            None => Some(Joints::All),
        }
    }
}

/// Order for one board.
#[derive(Clone, Debug)]
pub struct Order {
    /// Epoch in which it was issued.
    pub epoch: u64,
    /// Its number among the board's motions.
    pub ticket: u64,
    /// Action.
    pub what: Do,
}

/// Command to one board, in joints and degrees or millimeters. Lists have the length of `joints`.
#[derive(Clone, Debug)]
pub enum Do {
    /// A position move.
    Move { joints: Vec<usize>, to: Vec<f64>, speed: Option<Vec<f64>>, acceleration: Option<Vec<f64>> },
    /// Setpoints.
    Direct { joints: Vec<usize>, to: Vec<f64> },
    /// Velocities, sent repeatedly until another command.
    Velocity { joints: Vec<usize>, speed: Vec<f64> },
    /// Stop of these joints.
    Stop { joints: Vec<usize> },
    /// Reference speeds and accelerations.
    Reference { joints: Vec<usize>, speed: Vec<f64>, acceleration: Vec<f64> },
    /// A control mode.
    Mode { joints: Vec<usize>, mode: ControlMode },
}

impl Do {
    /// Joints whose motion it changes, and how the end of that motion is detected.
    pub fn disturbs(&self) -> (Vec<usize>, End) {
        match self {
            Do::Move { joints, .. } => (joints.clone(), End::Reported),
            Do::Direct { joints, .. } | Do::Velocity { joints, .. } | Do::Stop { joints } | Do::Mode { joints, .. } => {
                (joints.clone(), End::Seen)
            }
            Do::Reference { .. } => (Vec::new(), End::Seen),
        }
    }

    /// True if it moves a joint.
    pub fn moves(&self) -> bool {
        matches!(self, Do::Move { .. } | Do::Direct { .. } | Do::Velocity { .. })
    }
}

/// Worker of one board.
pub struct Hand {
    pub cell: Arc<SharedBoards>,
    pub layout: Arc<Layout>,
    /// Index of the board.
    pub index: usize,
    pub board: Arc<dyn Remote>,
    pub halt: watch::Receiver<Arc<Halt>>,
    /// Time until which the robot may move.
    pub lease: watch::Receiver<Option<Instant>>,
    /// Queue of orders; a successor continues with the same one.
    pub orders: Arc<Mutex<mpsc::Receiver<Order>>>,
    /// Latest delay after which the board may act, s; velocities stop this early before limits.
    pub latency: f64,
    /// Time at which to retry a board that did not stop when it was reached, s.
    again: Option<f64>,
    handled: u64,
    /// Connection whose first message was our stop.
    link: Option<LinkState>,
    speeds: JointVelocities,
}

impl Hand {
    pub fn new(
        (cell, layout): (Arc<SharedBoards>, Arc<Layout>),
        index: usize,
        board: Arc<dyn Remote>,
        (halt, lease): (watch::Receiver<Arc<Halt>>, watch::Receiver<Option<Instant>>),
        orders: Arc<Mutex<mpsc::Receiver<Order>>>,
        latency: f64,
    ) -> Hand {
        Hand {
            cell,
            layout,
            index,
            board,
            halt,
            lease,
            orders,
            latency,
            again: None,
            handled: 0,
            link: None,
            speeds: JointVelocities::default(),
        }
    }

    /// Runs until `end` changes, then stops the board and restores its settings.
    pub async fn work(mut self, mut end: watch::Receiver<bool>) {
        let orders = self.orders.clone();
        let mut orders = orders.lock().await;
        let mut link = self.board.link();
        let mut taking = self.cell.taking();
        let mut queries = interval(QUERY_PERIOD);
        let mut refresh = interval(REFRESH);
        queries.set_missed_tick_behavior(MissedTickBehavior::Delay);
        refresh.set_missed_tick_behavior(MissedTickBehavior::Delay);
        link.mark_changed();
        loop {
            tokio::select! {
                biased;
                _ = end.changed() => break,
                _ = self.halt.changed() => self.handle_halt().await,
                Ok(()) = taking.changed() => link.mark_changed(),
                _ = link.changed() => {
                    let now = link.borrow_and_update().clone();
                    if let LinkState::Up(_) = now {
                        while let Ok(order) = orders.try_recv() {
                            self.finish(&order);
                        }
                    }
                    self.linked(now).await;
                }
                order = orders.recv() => {
                    let Some(order) = order else { break };
                    self.carry_out(order).await;
                }
                _ = refresh.tick() => self.send_velocities(),
                _ = queries.tick() => {
                    if self.again.is_some_and(|at| self.cell.secs(super::cell::instant()) >= at) {
                        let now = link.borrow().clone();
                        self.linked(now).await;
                    }
                    if self.is_usable() {
                        self.query_done().await;
                        self.confirm().await;
                        self.put_back(false).await;
                        self.query_if_idle().await;
                    }
                }
            }
        }
        self.stop_all().await;
        self.leave().await;
    }

    fn patch(&self) -> Option<&Patch> {
        self.layout.patches.get(self.index)
    }

    /// True if the board is reached and this program drives it.
    fn is_usable(&self) -> bool {
        let is_there = self.cell.lock().boards.get(self.index).is_some_and(|known| known.trouble.is_none());
        is_there && self.cell.is_ours(self.index)
    }

    fn motors(&self, joints: &[usize]) -> Vec<usize> {
        let first = self.patch().map_or(0, |p| p.motors.start);
        joints.iter().map(|j| first + j).collect()
    }

    /// Handles a change of the connection. A new connection begins with a stop, whatever the board was doing;
    /// drivers may use it after that.
    async fn linked(&mut self, link: LinkState) {
        use super::cell::Trouble;
        let port = self.board.port().to_owned();
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.reached = matches!(link, LinkState::Up(_)) || (known.reached && !matches!(link, LinkState::Taken(_)));
            // the stop connection broke too, or may have: it counts again once a stop has been answered on it
            known.brake = Some(format!("{port}: no stop was answered yet on the line for stops"));
        }
        self.again = None;
        let trouble = match &link {
            LinkState::Down(why) => Some(Trouble::Lost(format!("{port}: {why}"))),
            LinkState::Taken(why) => Some(Trouble::Forbidden(format!("{port}: {why}"))),
            // a robot that is only observed is not stopped, because another program may be moving it
            LinkState::Up(_) if !self.cell.lock().taken => None,
            LinkState::Up(_) => {
                self.speeds.clear();
                match self.take_over().await {
                    Ok(()) => None,
                    Err(why) => {
                        self.again = Some(self.cell.secs(super::cell::instant()) + UNASKED);
                        Some(Trouble::Lost(format!("{port}: {why}")))
                    }
                }
            }
        };
        self.link = Some(link).filter(|_| trouble.is_none());
        let now = self.cell.secs(super::cell::instant());
        let mut inner = self.cell.lock();
        if let Some(known) = inner.boards.get_mut(self.index) {
            known.motions.forget();
            // ends earlier orders, even those not executed: no driver commands a board in trouble
            known.motions.given(u64::MAX, now);
            known.fresh = false;
            known.trouble = trouble;
        }
        drop(inner);
        self.cell.ring();
    }

    /// Stops the board and reads its state.
    async fn take_over(&mut self) -> Result<(), String> {
        if !self.stop_all().await {
            return Err("it does not stop when told".into());
        }
        self.learn_modes().await;
        self.learn_findings().await.map_err(|error| format!("it does not tell how it was found: {error}"))
    }

    /// Executes a new halt, if any.
    async fn handle_halt(&mut self) {
        let halt = self.halt.borrow_and_update().clone();
        if halt.epoch == self.handled {
            return;
        }
        self.handled = halt.epoch;
        match halt.stops(self.index) {
            Some(joints) => drop(self.stop(joints).await),
            None => {
                self.speeds.clear();
                self.board.hush();
            }
        }
        let ticket = halt.tickets.get(self.index).copied().unwrap_or_default();
        let now = self.cell.secs(super::cell::instant());
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.motions.given(ticket, now);
        }
    }

    async fn stop_all(&mut self) -> bool {
        self.stop(Joints::All).await
    }

    /// Stops joints and returns whether the board confirmed it. A board that is not ours is left alone: even
    /// connecting under another run's port name would break that run's connection.
    async fn stop(&mut self, joints: Joints) -> bool {
        self.speeds.clear();
        if !self.cell.is_ours(self.index) {
            return true;
        }
        self.board.hush();
        for _ in 0..3 {
            match self.send(&Ask::Set(Set::Stop(joints.clone()))).await {
                Ok(answer) if reply::is_ok(&answer) => return true,
                Ok(_) => tracing::warn!(board = self.board.port(), "the board answers [fail] to stop"),
                Err(error) => {
                    tracing::warn!(board = self.board.port(), error = error.to_string(), "the board can't be stopped");
                    return false;
                }
            }
        }
        false
    }

    async fn carry_out(&mut self, order: Order) {
        self.handle_halt().await;
        let dropped = order.epoch < self.handled && order.what.moves();
        if !dropped && let Err(why) = self.attempt(&order).await {
            tracing::warn!(board = self.board.port(), why, "an order was not carried out");
        }
        self.finish(&order);
    }

    /// Records that the order has been executed, or never will be.
    fn finish(&self, order: &Order) {
        let (joints, _) = order.what.disturbs();
        let now = self.cell.secs(super::cell::instant());
        let mut inner = self.cell.lock();
        inner.switched(self.motors(&joints).into_iter(), order.ticket);
        if let Some(known) = inner.boards.get_mut(self.index) {
            known.motions.given(order.ticket, now);
        }
    }

    async fn attempt(&mut self, order: &Order) -> Result<(), String> {
        let (joints, _) = order.what.disturbs();
        self.speeds.forget(&joints);
        match &order.what {
            Do::Move { joints, to, speed, acceleration } => {
                self.bring(joints, ControlMode::Position, Some(order.epoch)).await?;
                self.refer(joints, speed.as_deref(), acceleration.as_deref()).await?;
                self.interrupted(order.epoch).await?;
                let most = speed.clone().unwrap_or_else(|| self.cell.greatest(&self.layout, self.index, joints));
                self.paced(joints, &most);
                self.timed(joints, to, speed.as_deref().unwrap_or_default());
                let group = Joints::Group(joints.clone());
                self.set(Set::Move { joints: group, values: to.clone(), relative: false }).await
            }
            Do::Direct { joints, to } => {
                if !self.are_in(joints, ControlMode::PositionDirect) {
                    return Err("it is not in the mode for set-points".into());
                }
                self.paced(joints, &self.cell.greatest(&self.layout, self.index, joints));
                self.stream(Streamed::Direct(Joints::Group(joints.clone()), to.clone()));
                Ok(())
            }
            Do::Velocity { joints, speed } => {
                self.bring(joints, ControlMode::Velocity, Some(order.epoch)).await?;
                self.interrupted(order.epoch).await?;
                self.paced(joints, &self.cell.greatest(&self.layout, self.index, joints));
                self.speeds.set(joints, speed, self.cell.secs(super::cell::instant()));
                self.send_velocities();
                Ok(())
            }
            Do::Stop { joints } => self.set(Set::Stop(Joints::Group(joints.clone()))).await,
            Do::Reference { joints, speed, acceleration } => self.refer(joints, Some(speed), Some(acceleration)).await,
            Do::Mode { joints, mode } => self.bring(joints, *mode, None).await,
        }
    }

    async fn set(&self, set: Set) -> Result<(), String> {
        if self.link.as_ref() != Some(&*self.board.link().borrow()) {
            return Err("the connection is another one, and begins with a stop".into());
        }
        let request = Ask::Set(set);
        match self.send(&request).await {
            Ok(answer) if reply::is_ok(&answer) => Ok(()),
            Ok(_) => Err(format!("the board answers [fail] to {}", self.units().ask_to_wire(&request).bottle())),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Units of the board's joints.
    fn units(&self) -> Units {
        self.patch().map(|patch| patch.units.clone()).unwrap_or_default()
    }

    /// Streams setpoints, which have no answer.
    fn stream(&self, command: Streamed) {
        self.board.stream(self.units().streamed_to_wire(command));
    }

    /// Sends a request to the board, and records its answer time.
    async fn send(&self, ask: &Ask) -> Result<Bottle, CallError> {
        let now = || self.cell.secs(super::cell::instant());
        let units = self.units();
        let sent_at = now();
        let answer = self.board.ask(&units.ask_to_wire(ask)).await.map(|answer| units.answer_from_wire(ask, answer));
        let came = now();
        if let (Ok(answer), Some(known)) = (&answer, self.cell.lock().boards.get_mut(self.index)) {
            known.answered(sent_at, came, answer);
        }
        answer
    }

    /// Sets the speed limits of these joints, deg/s or mm/s.
    fn paced(&self, joints: &[usize], most: &[f64]) {
        let now = self.cell.secs(super::cell::instant());
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.pace.set_limit(joints, most, now);
            known.gauge.forget(joints);
        }
    }

    /// Starts timing joints that are about to move to `to`, deg or mm, at reference speeds, deg/s or mm/s.
    fn timed(&self, joints: &[usize], to: &[f64], speed: &[f64]) {
        let mut inner = self.cell.lock();
        let Some(known) = inner.boards.get_mut(self.index) else { return };
        known.gauge.begin();
        for ((joint, to), speed) in joints.iter().zip(to).zip(speed) {
            let from = known.q.get(*joint).copied().unwrap_or(*to);
            known.gauge.commanded(*joint, from, *to, *speed);
        }
    }

    /// Handles a halt that came since; fails if the halt ends the present order.
    async fn interrupted(&mut self, epoch: u64) -> Result<(), String> {
        self.handle_halt().await;
        if epoch < self.handled { Err("a stop came first".into()) } else { Ok(()) }
    }

    fn send_velocities(&mut self) {
        let limits = self.cell.limits(&self.layout, self.index);
        let now = self.cell.secs(super::cell::instant());
        let mut inner = self.cell.lock();
        let Some(known) = inner.boards.get_mut(self.index) else { return };
        let Some((joints, speeds)) = self.speeds.due(&known.q, &limits, self.latency, now) else { return };
        let moving: Vec<usize> = joints.iter().zip(&speeds).filter(|(_, v)| **v != 0.0).map(|(j, _)| *j).collect();
        if !moving.is_empty() {
            let ticket = known.motions.order(&moving, End::Seen);
            known.motions.given(ticket, now);
        }
        drop(inner);
        self.stream(Streamed::Velocity(Joints::Group(joints), speeds));
    }

    /// Sends a query if there was none for a while, so that the answer time is always up to date.
    async fn query_if_idle(&mut self) {
        let now = self.cell.secs(super::cell::instant());
        let due = self
            .cell
            .lock()
            .boards
            .get(self.index)
            .is_some_and(|known| known.answers.newest().is_none_or(|newest| now >= newest + UNASKED));
        if due {
            let _ = self.send(&Ask::Get(Get::Axes)).await;
        }
    }

    /// Queries the end of motions that only the board can detect.
    async fn query_done(&mut self) {
        let query = self.cell.lock().boards.get(self.index).and_then(|b| b.motions.due_query());
        let Some((joints, ticket)) = query else { return };
        let group = Joints::Group(joints.clone());
        let Ok(answer) = self.send(&Ask::Get(Get::Done(group))).await else { return };
        let mut inner = self.cell.lock();
        let Some(known) = inner.boards.get_mut(self.index) else { return };
        match answer.get(2).and_then(mobee_yarp::Value::as_i64) {
            Some(done) => known.motions.answered(&joints, ticket, done != 0),
            None if reply::is_fail(&answer) => known.motions.use_encoders_only(),
            None => {}
        }
    }
}

#[cfg(test)]
mod tests;
