//! Driver of a robot behind YARP: checks, marks and queues commands, and never waits.

use super::cell::{BoardsState, Joined, SharedBoards, Trouble, holds, instant};
use super::check::{CheckedAgainst, CheckedCommand};
use super::fan::Fan;
use super::hand::{Do, Halt, Order};
use super::layout::Layout;
use super::legs::Legs;
use super::motion::End;
use super::settings::Moves;
use mobee_contract::{AnswerTime, AsFound, Board, Command, ControlMode, Driver, DriverFault, Sample, Time};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;

/// Handle of a driver to the network thread.
#[derive(Clone, Debug)]
pub struct Reach {
    /// Assignment of motors to boards and joints.
    pub layout: Arc<Layout>,
    /// State shared with the network thread.
    pub cell: Arc<SharedBoards>,
    /// Queue of orders per board.
    pub orders: Vec<mpsc::Sender<Order>>,
    /// Stop of all boards.
    pub halt: Fan<Arc<Halt>>,
    /// Time until which the robot may move.
    pub lease: watch::Sender<Option<Instant>>,
}

/// Connection to a robot behind YARP.
#[derive(Debug)]
pub struct YarpDriver {
    reach: Reach,
    board: Board,
    /// Time of the run at the base of the readings' seconds, s.
    base: Option<f64>,
    last: Time,
    leased: Option<Time>,
    moves: Moves,
    /// Moves that are made of setpoints, and their latest reference speeds, rad/s by motor.
    legs: Legs,
    references: BTreeMap<usize, f64>,
    /// Epoch of the latest halt when the newest of these moves began.
    halts: u64,
}

impl YarpDriver {
    /// Creates a driver of boards that have been reached.
    pub fn new(reach: Reach, board: Board, moves: Moves) -> YarpDriver {
        YarpDriver {
            reach,
            board,
            base: None,
            last: Time::ZERO,
            leased: None,
            moves,
            legs: Legs::default(),
            references: BTreeMap::new(),
            halts: 0,
        }
    }

    /// Begins a move that is made of setpoints, by switching the mode of its motors.
    fn begin(
        &mut self,
        inner: &mut BoardsState,
        motors: &[usize],
        to: &[f64],
        speeds: Option<&[f64]>,
        q: &[f64],
    ) -> Result<(), DriverFault> {
        self.refer(motors, speeds);
        let mut moved = Vec::new();
        let mut from = Vec::new();
        let mut target = Vec::new();
        let mut fast = Vec::new();
        for (m, to) in motors.iter().zip(to) {
            let (Some(here), Some(axis)) = (q.get(*m), self.board.axes.get(*m)) else { continue };
            // a motor without a board rests at home
            if self.reach.layout.joint(*m).is_some() {
                moved.push(*m);
                from.push(*here);
                target.push(*to);
                fast.push(self.references.get(m).copied().unwrap_or(axis.max_speed));
            }
        }
        let other = |m: &&usize| inner.expected.get(**m) != Some(&ControlMode::PositionDirect);
        let switched: Vec<usize> = moved.iter().filter(other).copied().collect();
        if !switched.is_empty() {
            self.reach.clone().queue(inner, CheckedCommand::Mode(switched, ControlMode::PositionDirect))?;
        }
        self.halts = self.reach.halt.newest().epoch;
        self.legs.begin(moved, (from, target), &fast, &self.board);
        Ok(())
    }

    /// True if moves are made of setpoints: because of the setting, or since the boards' own moves turned out
    /// not to follow speeds.
    fn makes_moves(&self, inner: &BoardsState) -> bool {
        let is_unfair = |board: &super::cell::BoardFacts| board.gauge.is_unfair();
        self.moves == Moves::SetPoints || (self.board.position_direct && inner.boards.iter().any(is_unfair))
    }

    /// Stores reference speeds of moves made of setpoints, which are not sent to a board.
    fn refer(&mut self, motors: &[usize], speeds: Option<&[f64]>) {
        self.references.extend(motors.iter().copied().zip(speeds.unwrap_or_default().iter().copied()));
    }

    /// Continues or ends the moves made of setpoints after a new reading.
    fn go_on(&mut self, inner: &mut BoardsState, now: Time, (q, done): (&[f64], &[bool])) -> Result<(), DriverFault> {
        // the lease watch may have stopped the boards, and a new lease may have come since
        if !self.is_leased(now) || self.halts != self.reach.halt.newest().epoch {
            self.legs.stop(&[]);
        }
        for (motors, q) in self.legs.step(now, self.board.period, q) {
            self.reach.queue(inner, CheckedCommand::Direct(motors, q))?;
        }
        let rested = self.legs.rested(|m| done.get(m) == Some(&true));
        if !rested.is_empty() {
            self.reach.queue(inner, CheckedCommand::Mode(rested, ControlMode::Position))?;
        }
        Ok(())
    }

    /// Time of a reading on the run's clock. Both clocks have the same rate; the smallest delay between them
    /// gives their offset.
    fn time_of(&mut self, at: f64, now: Time) -> Time {
        let base = now.secs() - self.reach.cell.secs(instant());
        let base = self.base.map_or(base, |b| b.max(base));
        self.base = Some(base);
        let read = Time::from_secs((at + base).max(0.0)).min(now);
        self.last = if read > self.last { read } else { (self.last + Duration::from_nanos(1)).min(now) };
        self.last
    }

    /// True if the lease holds by the time of the run and by the clock of the lease watch, so that a lease
    /// that the watch has ended does not come back.
    fn is_leased(&self, now: Time) -> bool {
        self.leased.is_some_and(|until| until > now) && holds(*self.reach.lease.borrow())
    }
}

impl Driver for YarpDriver {
    fn board(&self) -> &Board {
        &self.board
    }

    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        let reach = self.reach.clone();
        let mut inner = reach.cell.lock();
        usable(&inner, &reach.layout)?;
        if !inner.taken {
            return Err(DriverFault::Refused("this driver only reads: the robot has not been connected to".into()));
        }
        let q = inner.joined.as_ref().map(|j| j.q.clone()).ok_or(DriverFault::Lost)?;
        let driven: Vec<bool> = (0..reach.layout.motors()).map(|m| reach.layout.joint(m).is_some()).collect();
        let known = CheckedAgainst { axes: &self.board.axes, driven: &driven, q: &q, modes: &inner.expected };
        let checked = known.check(command).map_err(DriverFault::Refused)?;
        if checked.moves() && !self.is_leased(now) {
            return Err(DriverFault::Refused("there is no lease to move under".into()));
        }
        match &checked {
            CheckedCommand::Stop(motors) => self.legs.stop(motors),
            CheckedCommand::Direct(motors, _)
            | CheckedCommand::Velocity(motors, _)
            | CheckedCommand::Mode(motors, _) => self.legs.forget(motors),
            CheckedCommand::Move(motors, to, speeds, _) if self.makes_moves(&inner) => {
                return self.begin(&mut inner, motors, to, speeds.as_deref(), &q);
            }
            CheckedCommand::Reference(motors, speeds, _) if self.makes_moves(&inner) => {
                self.refer(motors, Some(speeds));
                return Ok(());
            }
            CheckedCommand::Move(..) => {
                inner.unfair(&reach.layout).map_or(Ok(()), |why| Err(DriverFault::Hardware(why)))?
            }
            CheckedCommand::Reference(..) => {}
        }
        if matches!(&checked, CheckedCommand::Stop(motors) if motors.is_empty()) {
            reach.stop_all(&mut inner);
            return Ok(());
        }
        reach.queue(&mut inner, checked)
    }

    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let cell = self.reach.cell.clone();
        let mut inner = cell.lock();
        usable(&inner, &self.reach.layout)?;
        if let Some(fault) = inner.boards.iter_mut().find_map(|b| b.alarm.take()) {
            return Err(fault);
        }
        if !std::mem::take(&mut inner.unread) {
            return Ok(None);
        }
        let Some(mut joined) = inner.joined.clone() else { return Ok(None) };
        if !self.legs.is_empty() {
            // a motor whose mode is about to be restored is not done before
            let named: Vec<bool> = (0..joined.done.len()).map(|m| self.legs.names(m)).collect();
            self.go_on(&mut inner, now, (&joined.q, &joined.done))?;
            joined.done.iter_mut().zip(named).for_each(|(done, named)| *done &= !named);
        }
        drop(inner);
        let at = self.time_of(joined.at, now);
        let Joined { seq, q, done, external, .. } = joined;
        Ok(Some(Sample { seq, at, q, done, external, ..Sample::default() }))
    }

    fn next_sample(&self, now: Time) -> Time {
        if self.reach.cell.lock().unread {
            return now;
        }
        let due = self.last + self.board.period + self.board.period / 10;
        // polls for an overdue reading several times a period
        if due > now { due } else { now + self.board.period / 5 }
    }

    fn lease(&mut self, now: Time, until: Time) {
        let leased = until > now;
        let end = leased.then(|| instant() + until.since(now));
        self.leased = leased.then_some(until);
        self.reach.lease.send_if_modified(|lease| {
            let changed = *lease != end;
            *lease = end;
            changed
        });
    }

    fn answer_time(&self) -> Option<AnswerTime> {
        self.reach.cell.lock().answer_time(self.reach.cell.secs(instant()))
    }

    fn leads(&self) -> bool {
        self.makes_moves(&self.reach.cell.lock())
    }

    fn news(&mut self) -> Option<String> {
        self.reach.cell.lock().news.take()
    }

    fn found(&self) -> Vec<AsFound> {
        self.reach.found()
    }

    fn modes(&self) -> Vec<ControlMode> {
        self.reach.cell.lock().modes(&self.reach.layout)
    }
}

/// Fails unless all boards can be used.
fn usable(inner: &BoardsState, layout: &Layout) -> Result<(), DriverFault> {
    match inner.trouble() {
        Some(Trouble::Lost(_)) => Err(DriverFault::Lost),
        Some(Trouble::Forbidden(why)) => Err(DriverFault::Hardware(why)),
        None => inner.fault(layout).map_or(Ok(()), |fault| Err(DriverFault::Hardware(fault))),
    }
}

impl Reach {
    /// Settings of the motors as found, for boards that report them.
    pub fn found(&self) -> Vec<AsFound> {
        let inner = self.cell.lock();
        let boards = self.layout.patches.iter().zip(&inner.boards);
        let all = boards.flat_map(|(patch, known)| patch.motors.clone().zip(known.owed.findings()));
        all.map(|(motor, finding)| finding.to_contract(motor)).collect()
    }

    /// Stops all boards before anything else; motions waiting in their queues are dropped.
    pub fn stop_all(&self, inner: &mut BoardsState) {
        let now = self.cell.secs(instant());
        let joints = inner.boards.iter().map(|b| b.motions.to_stop(now)).collect();
        let all = |b: &mut super::cell::BoardFacts| {
            let joints: Vec<usize> = (0..b.q.len()).collect();
            b.motions.order(&joints, End::Seen)
        };
        let tickets: Vec<u64> = inner.boards.iter_mut().map(all).collect();
        self.halt.update(|halt| Arc::new(Halt { epoch: halt.epoch + 1, tickets, joints }));
    }

    /// Queues a command with all the boards it concerns, or with none.
    fn queue(&self, inner: &mut BoardsState, checked: CheckedCommand) -> Result<(), DriverFault> {
        let epoch = self.halt.newest().epoch;
        let orders = split(&self.layout, &checked);
        let reserve = |(board, _): &(usize, Do)| {
            self.orders
                .get(*board)
                .and_then(|q| q.try_reserve().ok())
                .ok_or_else(|| DriverFault::Refused("too many commands wait for the board".into()))
        };
        let permits: Vec<_> = orders.iter().map(reserve).collect::<Result<_, _>>()?;
        let switched = match &checked {
            CheckedCommand::Move(motors, ..) => Some((motors.clone(), ControlMode::Position)),
            CheckedCommand::Velocity(motors, _) => Some((motors.clone(), ControlMode::Velocity)),
            CheckedCommand::Mode(motors, mode) => Some((motors.clone(), *mode)),
            _ => None,
        };
        for (permit, (board, what)) in permits.into_iter().zip(orders) {
            let (joints, end) = what.disturbs();
            let Some(known) = inner.boards.get_mut(board) else { continue };
            let ticket = known.motions.order(&joints, end);
            if what.moves() {
                known.moved = ticket;
            }
            let first = self.layout.patches.get(board).map_or(0, |p| p.motors.start);
            if switched.is_some() {
                for j in &joints {
                    if let Some(slot) = inner.switching.get_mut(first + j) {
                        *slot = Some(ticket);
                    }
                }
            }
            permit.send(Order { epoch, ticket, what });
        }
        if let Some((motors, mode)) = switched {
            for m in motors {
                if let Some(slot) = inner.expected.get_mut(m) {
                    *slot = mode;
                }
            }
        }
        Ok(())
    }
}

/// Splits a command into orders for its boards, in joints and degrees or millimeters.
fn split(layout: &Layout, checked: &CheckedCommand) -> Vec<(usize, Do)> {
    let nothing = |motors: &[usize]| vec![0.0; motors.len()];
    let second = |motors: &[usize], values: &Option<Vec<f64>>| {
        values.as_ref().map(|v| layout.split(motors, v)).unwrap_or_default()
    };
    let of = |all: &[(usize, Vec<usize>, Vec<f64>)], board: usize| {
        all.iter().find(|(b, ..)| *b == board).map(|(_, _, v)| v.clone())
    };
    match checked {
        CheckedCommand::Move(motors, q, speed, acceleration) => {
            let speed = second(motors, speed);
            let acceleration = second(motors, acceleration);
            let to = layout.split(motors, q).into_iter();
            to.map(|(b, joints, to)| {
                (b, Do::Move { joints, to, speed: of(&speed, b), acceleration: of(&acceleration, b) })
            })
            .collect()
        }
        CheckedCommand::Direct(motors, q) => {
            layout.split(motors, q).into_iter().map(|(b, joints, to)| (b, Do::Direct { joints, to })).collect()
        }
        CheckedCommand::Velocity(motors, speed) => {
            let split = layout.split(motors, speed).into_iter();
            split.map(|(b, joints, speed)| (b, Do::Velocity { joints, speed })).collect()
        }
        CheckedCommand::Stop(motors) => {
            let split = layout.split(motors, &nothing(motors)).into_iter();
            split.map(|(b, joints, _)| (b, Do::Stop { joints })).collect()
        }
        CheckedCommand::Reference(motors, speed, acceleration) => {
            let acceleration = layout.split(motors, acceleration);
            let split = layout.split(motors, speed).into_iter();
            split
                .map(|(b, joints, speed)| {
                    (b, Do::Reference { joints, speed, acceleration: of(&acceleration, b).unwrap_or_default() })
                })
                .collect()
        }
        CheckedCommand::Mode(motors, mode) => {
            let split = layout.split(motors, &nothing(motors)).into_iter();
            split.map(|(b, joints, _)| (b, Do::Mode { joints, mode: *mode })).collect()
        }
    }
}

#[cfg(test)]
mod tests;
