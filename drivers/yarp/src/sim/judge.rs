//! Judge of the driver's obligations towards its boards, with access to the ground truth.
//!
//! The judge sees more than any program can: the commands that supervise gives the driver, the messages that
//! the driver sends on each connection, and the true motion of the motors. Violations that can't be avoided
//! are excused: a stop does not get through a wire that is cut.

use super::board::JointSettings;
use super::faults::{Faults, WireFault};
use super::watched::WatchedBoard;
use mobee_contract::{AnswerTime, Command, MotorUnits, Sample, Time};
use mobee_yarp::board::{Ask, Joints, Set, Streamed};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// Time within which a stop has to be sent.
const AT_ONCE: Duration = Duration::from_millis(45);
/// Time within which a stop without effect has to be repeated: one check of its effect may find a motor that
/// was slowing down anyway.
const REPEAT_WITHIN: Duration = Duration::from_millis(400);
/// Time after a stop during which waiting setpoints may still go out: the hand discards them once its request
/// has been answered.
const HUSHED: Duration = Duration::from_millis(700);
/// Time after a stop within which motors have to rest: messages in transit, two stops without effect,
/// braking.
const RESTS: Duration = Duration::from_millis(2000);
/// Speed below which a motor rests, deg/s.
const REST: f64 = 2.0;
/// Time that the driver needs to recover a board after a disturbance: its pauses grow to 2 s.
const BACK: Duration = Duration::from_millis(2600);
/// Time without a reading after which the driver counts as blind.
const UNHEARD: Duration = Duration::from_millis(200);
/// Lateness of timers: a lease renewed this soon after its end has not ended.
const TIMER: Duration = Duration::from_millis(2);
/// Time for which a command to a motor allows the driver to send orders to that motor.
const NAMED: Duration = Duration::from_secs(5);
/// The same for a move made of setpoints: longer than any move in these behaviors.
const MOVED: Duration = Duration::from_secs(60);
/// Time for which a motor may exceed its commanded speed before the driver has to report it.
const TOO_FAST: Duration = Duration::from_millis(800);
/// Least time after the death of a task during which the boards must not be used.
const MOURNS: Duration = Duration::from_millis(180);
/// Time for which a resting board that is not driven may differ from the settings found: several messages in
/// a row, each of which may be lost.
const GIVEN_BACK: Duration = Duration::from_millis(1500);
/// Time between two checks beyond which the process was suspended.
const SUSPENDED: Duration = Duration::from_millis(60);

/// Connection that a message is sent on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JudgedConnection {
    Orders,
    Stops,
}

/// Judges the driver of one robot.
#[derive(Debug)]
pub(super) struct Judge {
    boards: Vec<WatchedBoard>,
    units: MotorUnits,
    /// Violations found.
    pub found: Vec<String>,
    looked: Time,
    lease: Option<Time>,
    /// Motors of each command, with the time until which it covers them.
    named: VecDeque<(Time, Vec<usize>)>,
    /// Time for which a move covers its motors.
    move_names: Duration,
    /// Recent speed limits per motor, deg/s.
    limits: Vec<VecDeque<(Time, f64)>>,
    died: Option<Time>,
    /// Time of the driver's last reading. Without readings the driver can't detect that a board rests.
    last_reading: Time,
}

impl Judge {
    /// Creates a judge of these boards, given by port and motors. A command covers its motors for longer
    /// where moves are `led` by setpoints.
    pub fn new(
        boards: impl IntoIterator<Item = (String, Range<usize>)>,
        units: MotorUnits,
        motors: usize,
        led: bool,
    ) -> Judge {
        Judge {
            boards: boards.into_iter().map(|(port, motors)| WatchedBoard::new(port, motors)).collect(),
            units,
            found: Vec::new(),
            looked: Time::ZERO,
            lease: None,
            named: VecDeque::new(),
            move_names: if led { MOVED } else { NAMED },
            limits: vec![VecDeque::new(); motors],
            died: None,
            last_reading: Time::ZERO,
        }
    }

    /// Records a command that the driver has accepted.
    pub fn commanded(&mut self, now: Time, command: &Command) {
        let (motors, speeds) = match command {
            Command::Stop { motors } if motors.is_empty() => return self.stop(now),
            Command::Move(m) => (&m.motors, m.speed.clone()),
            Command::Stop { motors }
            | Command::Direct { motors, .. }
            | Command::Velocity { motors, .. }
            | Command::Reference { motors, .. }
            | Command::Mode { motors, .. } => (motors, None),
        };
        let names = if matches!(command, Command::Move(_)) { self.move_names } else { NAMED };
        self.named.retain(|(until, _)| now <= *until);
        self.named.push_back((now + names, motors.clone()));
        if !matches!(command, Command::Move(_) | Command::Direct { .. } | Command::Velocity { .. }) {
            return;
        }
        for (i, motor) in motors.iter().enumerate() {
            let most = speeds.as_ref().and_then(|s| s.get(i)).map_or(f64::INFINITY, |v| v.to_degrees());
            if let Some(limits) = self.limits.get_mut(*motor) {
                limits.push_back((now, most));
                while limits.get(1).is_some_and(|(at, _)| now.since(*at) > TOO_FAST * 2) {
                    limits.pop_front();
                }
            }
        }
        for board in self.boards.iter_mut().filter(|b| motors.iter().any(|m| b.motors.contains(m))) {
            // a stop being sent when it became due is sufficient
            if board.is_being_stopped() {
                board.owed = None;
            }
            (board.stopped, board.moved) = (None, now);
        }
    }

    /// Records that everything has to stop from then on.
    fn stop(&mut self, since: Time) {
        for board in &mut self.boards {
            // the end of a lease is recorded later than it is acted on
            if board.stop_sent.is_none_or(|sent| sent + TIMER < since) {
                board.owed.get_or_insert(since);
            }
            board.stopped.get_or_insert(since);
        }
    }

    /// Records a new lease of the driver.
    pub fn leased(&mut self, now: Time, until: Time) {
        self.look_at_the_lease(now);
        if until > now {
            self.lease = Some(until);
        } else if self.lease.take().is_some() {
            self.stop(now);
        }
    }

    fn look_at_the_lease(&mut self, now: Time) {
        if let Some(ended) = self.lease.filter(|until| *until + TIMER < now) {
            self.lease = None;
            self.stop(ended);
        }
    }

    /// Records the death of a task of the driver.
    pub fn died(&mut self, now: Time) {
        self.died = Some(now);
    }

    /// Records a new connection to a board.
    pub fn linked(&mut self, board: usize) {
        if let Some(board) = self.boards.get_mut(board) {
            board.fresh = true;
        }
    }

    /// Records that a board ignores a stop.
    pub fn ignored(&mut self, board: usize, now: Time) {
        if let Some(board) = self.boards.get_mut(board) {
            board.ignored = Some(now);
        }
    }

    /// Records that a board's references were set by another program, or sent or read by ours.
    pub fn meddled(&mut self, board: usize, by_another: bool) {
        if let Some(board) = self.boards.get_mut(board) {
            board.meddled = by_another;
        }
    }

    /// Checks a move of the driver that arrives at a board.
    pub fn moves(&mut self, board: usize, now: Time) {
        if let Some(board) = self.boards.get(board).filter(|b| b.meddled) {
            self.found.push(format!(
                "{}: it is moved at {now} by references that another set, and nobody looked",
                board.port
            ));
        }
    }

    /// Checks a message that the driver sends.
    pub fn sent(&mut self, board: usize, line: JudgedConnection, ask: &Ask, now: Time) {
        let touched = touched(ask).map(|joints| self.strangers(board, joints, now));
        let Some(watched) = self.boards.get_mut(board) else { return };
        let is_stop = matches!(ask, Ask::Set(Set::Stop(_)));
        if is_stop {
            (watched.owed, watched.stop_sent, watched.ignored) = (None, Some(now), None);
        }
        if let Some(slot) = watched.in_transit.get_mut(line as usize) {
            *slot = Some((now, is_stop));
        }
        let port = watched.port.clone();
        if let (Some(since), Ask::Set(Set::Move { .. })) = (watched.stopped.filter(|since| *since < now), ask) {
            self.found.push(format!("{port}: stopped at {since}, it is told to move at {now}"));
        }
        if let (JudgedConnection::Orders, Ask::Set(set)) = (line, ask) {
            let first = std::mem::take(&mut watched.fresh);
            if first && !is_stop {
                self.found
                    .push(format!("{port}: the first order on a new connection is {set:?} at {now}, and no stop"));
            }
        }
        let as_found = watched.is_as_found(ask);
        if let Some(strangers) = touched.filter(|s| !s.is_empty() && !as_found) {
            self.found
                .push(format!("{port}: joints {strangers:?} are told {ask:?} at {now}, and no command names them"));
        }
    }

    /// Checks setpoints that the driver streams.
    pub fn streamed(&mut self, board: usize, command: &Streamed, now: Time) {
        let joints = match command {
            Streamed::Velocity(joints, _) | Streamed::Direct(joints, _) => joints,
            Streamed::Move(_) => &Joints::All,
        };
        let strangers = self.strangers(board, joints, now);
        let Some(watched) = self.boards.get(board) else { return };
        let port = &watched.port;
        if let Some(since) = watched.stopped.filter(|since| now.since(*since) > HUSHED) {
            self.found.push(format!("{port}: stopped at {since}, it gets set-points at {now}"));
        }
        if !strangers.is_empty() {
            self.found.push(format!("{port}: joints {strangers:?} get set-points at {now}, and no command names them"));
        }
    }

    /// Joints of a board that no present command covers.
    fn strangers(&self, board: usize, joints: &Joints, now: Time) -> Vec<usize> {
        let Some(watched) = self.boards.get(board) else { return Vec::new() };
        let first = watched.motors.start;
        let n = watched.motors.len();
        let named = |j: &usize| {
            let of_late = self.named.iter().filter(|(until, _)| now <= *until);
            of_late.into_iter().any(|(_, motors)| motors.contains(&(first + j)))
        };
        joints.on(n).unwrap_or_default().into_iter().filter(|j| !named(j)).collect()
    }

    /// Records that a message has been answered, or that its sender has stopped waiting.
    pub fn exchange_ended(&mut self, board: usize, line: JudgedConnection, now: Time, answered: bool) {
        let Some(watched) = self.boards.get_mut(board) else { return };
        let sent = watched.in_transit.get_mut(line as usize).and_then(Option::take);
        if let Some((since, _)) = sent.filter(|_| answered) {
            watched.answers.push_back((now, now.since(since).as_secs_f64()));
            while watched.answers.len() > 128 {
                watched.answers.pop_front();
            }
        }
    }

    /// Checks the lease and the clock; to be called before the boards are checked.
    pub fn look(&mut self, now: Time) {
        self.look_at_the_lease(now);
        if now.since(self.looked) > SUSPENDED {
            for board in &mut self.boards {
                board.excused = board.excused.max(now);
                board.truth.clear();
            }
        }
        self.looked = now;
    }

    /// Checks a board, given the true positions of its motors, rad, and their speeds, rad/s.
    pub fn see(&mut self, board: usize, now: Time, (q, v): (&[f64], &[f64]), faults: &Faults) {
        let died = self.died.is_some_and(|at| now.since(at) < BACK);
        let Some(watched) = self.boards.get_mut(board) else { return };
        watched.excused = watched.excused.max(faults.disturbed_until(now));
        watched.truth.push_back((now, q.to_vec()));
        while watched.truth.front().is_some_and(|(at, _)| now.since(*at) > Duration::from_secs(3)) {
            watched.truth.pop_front();
        }
        let excused = died || now < watched.excused + BACK;
        let mut found = Vec::new();
        let stop_in_transit = watched.is_being_stopped();
        let fastest = v.iter().map(|v| v.abs().to_degrees()).fold(0.0, f64::max);
        if let Some(since) = watched.owed.filter(|since| now.since(*since) > AT_ONCE) {
            // a resting board is sent no stop
            if !excused && !stop_in_transit && fastest > REST {
                found.push(format!("{}: a stop of {since} was not said until {now}", watched.port));
            }
            if !stop_in_transit {
                watched.owed = None;
            }
        }
        if let Some(since) = watched.stopped.filter(|since| !excused && now.since(*since) > RESTS && fastest > REST) {
            let late = now.since(watched.excused + BACK) > RESTS;
            if late {
                found.push(format!(
                    "{}: stopped at {since}, moves at {} at {now}",
                    watched.port,
                    self.units.told_speed(fastest.to_radians(), 1)
                ));
            }
        }
        if let Some(since) = watched.ignored.filter(|since| now.since(*since) > REPEAT_WITHIN) {
            watched.ignored = None;
            if !excused && watched.stopped.is_some() && fastest > 2.5 * REST {
                found.push(format!(
                    "{}: a stop of {since} had no effect, and was not said again until {now}",
                    watched.port
                ));
            }
        }
        let blind = faults.any_since(Time(now.0.saturating_sub(1_500_000_000)), now, |f| {
            matches!(f, WireFault::Silent | WireFault::Behind(_) | WireFault::Shuffled(_) | WireFault::Stamps(_))
        });
        let limits = self.limits.get(watched.motors.clone()).unwrap_or_default();
        for (joint, (slot, (v, limits))) in watched.fast.iter_mut().zip(v.iter().zip(limits)).enumerate() {
            let most = limits.iter().map(|(_, most)| *most).fold(f64::NEG_INFINITY, f64::max);
            let is_fast = most.is_finite() && v.abs().to_degrees() > 2.0 * most + 6.0;
            if !is_fast || excused || blind || watched.stopped.is_some() {
                *slot = None;
            } else if now.since(*slot.get_or_insert(now)) > TOO_FAST {
                let v = v.abs().to_degrees();
                let most = self.units.of(watched.motors.start + joint).told_speed(most.to_radians(), 1);
                found.push(format!("{}: joint {joint} was told {most} and goes at {v:.1} at {now}", watched.port));
            }
        }
        self.found.extend(found);
    }

    /// Checks that the settings of a board's joints equal those found, once they have rested without a
    /// command to move for a while. The driver may change modes as long as it drives.
    pub fn see_settings(
        &mut self,
        board: usize,
        now: Time,
        (settings, rests): (Vec<JointSettings>, bool),
        faults: &Faults,
    ) {
        let died = self.died.is_some_and(|at| now.since(at) < BACK);
        let is_leased = self.lease.is_some();
        let Some(watched) = self.boards.get_mut(board) else { return };
        if watched.found.is_empty() {
            watched.found = settings;
            return;
        }
        let since = Time(now.0.saturating_sub(GIVEN_BACK.as_nanos() as u64));
        // settings by another program are not the driver's fault
        let meddled = faults.any_since(Time::ZERO, now, |f| matches!(f, WireFault::Meddled(_)));
        let is_blind = now.since(self.last_reading) > UNHEARD;
        let disturbed =
            died || meddled || is_blind || now < watched.excused + BACK || faults.any_since(since, now, |_| true);
        let is_left = |(found, left): (&JointSettings, &JointSettings)| {
            let other = |a: f64, b: f64| (a - b).abs() > 1e-6;
            let modes = (found.mode, found.interaction) != (left.mode, left.interaction);
            other(found.speed, left.speed) || other(found.acceleration, left.acceleration) || (!is_leased && modes)
        };
        let left = watched.found.iter().zip(&settings).position(is_left);
        if left.is_none() || disturbed || !rests {
            watched.still = None;
        } else if now.since((*watched.still.get_or_insert(now)).max(watched.moved)) > GIVEN_BACK {
            watched.still = None;
            let joint = left.unwrap_or_default();
            let found = watched.found.get(joint);
            let left = settings.get(joint);
            self.found.push(format!(
                "{}: joint {joint} was found as {found:?} and is left as {left:?} at {now}",
                watched.port
            ));
        }
    }

    /// Checks a reading and the answer times that the driver reports. `lies` is true for boards with faulty
    /// encoders.
    pub fn read(&mut self, now: Time, sample: &Sample, answers: Option<AnswerTime>, lies: impl Fn(usize) -> bool) {
        self.last_reading = now;
        if let Some(died) = self.died.filter(|at| now > *at + AT_ONCE && now.since(*at) < MOURNS) {
            self.found.push(format!("a task died at {died}, and the boards are read as ever at {now}"));
        }
        for (board, watched) in self.boards.iter().enumerate() {
            if !lies(board) && watched.is_older(sample) {
                let port = &watched.port;
                let at = sample.at;
                self.found.push(format!("{port}: a reading that is told to be of {at} is older, at {now}"));
            }
        }
        let slowest = self.boards.iter().filter_map(|b| b.median(now)).fold(0.0, f64::max);
        if slowest > 0.02 && answers.is_none_or(|a| a.most.as_secs_f64() < 0.8 * slowest) {
            self.found
                .push(format!("half of the answers take {slowest:.3} s, and the driver tells {answers:?} at {now}"));
        }
    }

    /// True if a stop would reach this board, and would have for a while.
    pub fn is_in_reach(&self, board: usize, now: Time) -> bool {
        let died = self.died.is_some_and(|at| now.since(at) < BACK + RESTS);
        !died && self.boards.get(board).is_some_and(|b| now > b.excused + BACK + RESTS)
    }
}

/// Joints that an order affects, except for stops.
fn touched(ask: &Ask) -> Option<&Joints> {
    match ask {
        Ask::Set(
            Set::Move { joints, .. }
            | Set::Speed(joints, _)
            | Set::Acceleration(joints, _)
            | Set::Mode(joints, _)
            | Set::Interaction(joints, _),
        ) => Some(joints),
        _ => None,
    }
}
