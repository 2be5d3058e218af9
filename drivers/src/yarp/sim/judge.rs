//! What the driver owes its boards, judged by what really happens there.
//!
//! The judge stands where no program stands: it hears what supervise tells the driver, what the driver says on each line, and sees
//! how the motors really move. What can't be helped is excused: a stop does not get through a wire that is cut.

use super::faults::{Faults, WireFault};
use super::watched::Watched;
use crate::sim::JointSettings;
use mobee_contract::{AnswerTime, Command, MotorUnits, Sample, Time};
use mobee_yarp::board::{Ask, Joints, Set, Streamed};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// How soon a stop is said.
const AT_ONCE: Duration = Duration::from_millis(45);
/// How soon a stop without effect is said again: one look at its effect may find a motor that was slowing down anyway.
const AGAIN: Duration = Duration::from_millis(400);
/// How long set-points that wait may go out after a stop: the hand hushes them once its question is answered.
const HUSHED: Duration = Duration::from_millis(700);
/// How soon after a stop motors rest: words on their way, two stops without effect, braking.
const RESTS: Duration = Duration::from_millis(2000);
/// What counts as rest, deg/s.
const REST: f64 = 2.0;
/// How long the driver takes to be back at a board after a disturbance: its pauses grow to 2 s.
const BACK: Duration = Duration::from_millis(2600);
/// A driver that has given no reading for so long sees nothing.
const UNHEARD: Duration = Duration::from_millis(200);
/// By how much a timer may be late: a lease that is renewed so soon after its end has not ended.
const TIMER: Duration = Duration::from_millis(2);
/// For how long an order that names a motor lets the driver tell that motor something.
const NAMED: Duration = Duration::from_secs(5);
/// For how long a move does where it is made of set-points: longer than any in these behaviors.
const MOVED: Duration = Duration::from_secs(60);
/// How long a motor may outrun what it was told before the driver has said so.
const TOO_FAST: Duration = Duration::from_millis(800);
/// After the death of a task nobody uses the boards for as long as this, at least.
const MOURNS: Duration = Duration::from_millis(180);
/// How long a board that rests, and is not driven, may be otherwise than it was found: words one after the other, each of which may be lost.
const GIVEN_BACK: Duration = Duration::from_millis(1500);
/// A longer time between two looks is a process that was suspended.
const SUSPENDED: Duration = Duration::from_millis(60);

/// Which line something is said on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Line {
    Orders,
    Stops,
}

/// Judges the driver of one robot.
#[derive(Debug)]
pub(super) struct Judge {
    boards: Vec<Watched>,
    units: MotorUnits,
    /// What was seen to be broken.
    pub found: Vec<String>,
    looked: Time,
    lease: Option<Time>,
    /// Until when each command names its motors.
    named: VecDeque<(Time, Vec<usize>)>,
    /// For how long a move does.
    move_names: Duration,
    /// Per motor the speeds it was told of late, deg/s.
    told: Vec<VecDeque<(Time, f64)>>,
    died: Option<Time>,
    /// When the driver gave its last reading: without any it does not know that a board rests.
    heard_of: Time,
}

impl Judge {
    /// A judge of these boards: port and motors of each. A command names its motors for longer where moves are `led` by set-points.
    pub fn new(
        boards: impl IntoIterator<Item = (String, Range<usize>)>,
        units: MotorUnits,
        motors: usize,
        led: bool,
    ) -> Judge {
        Judge {
            boards: boards.into_iter().map(|(port, motors)| Watched::new(port, motors)).collect(),
            units,
            found: Vec::new(),
            looked: Time::ZERO,
            lease: None,
            named: VecDeque::new(),
            move_names: if led { MOVED } else { NAMED },
            told: vec![VecDeque::new(); motors],
            died: None,
            heard_of: Time::ZERO,
        }
    }

    /// The driver has taken a command.
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
            if let Some(told) = self.told.get_mut(*motor) {
                told.push_back((now, most));
                while told.get(1).is_some_and(|(at, _)| now.since(*at) > TOO_FAST * 2) {
                    told.pop_front();
                }
            }
        }
        for board in self.boards.iter_mut().filter(|b| motors.iter().any(|m| b.motors.contains(m))) {
            // one that was being said when it was owed has done what it should
            if board.is_being_stopped() {
                board.owed = None;
            }
            (board.stopped, board.moved) = (None, now);
        }
    }

    /// Everything is to stop since then.
    fn stop(&mut self, since: Time) {
        for board in &mut self.boards {
            // the end of a lease is heard of later than it is answered
            if board.said.is_none_or(|said| said + TIMER < since) {
                board.owed.get_or_insert(since);
            }
            board.stopped.get_or_insert(since);
        }
    }

    /// The driver has a new lease.
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

    /// A task of the driver dies.
    pub fn died(&mut self, now: Time) {
        self.died = Some(now);
    }

    /// There is a new connection to a board.
    pub fn linked(&mut self, board: usize) {
        if let Some(board) = self.boards.get_mut(board) {
            board.fresh = true;
        }
    }

    /// A board does not heed a stop.
    pub fn ignored(&mut self, board: usize, now: Time) {
        if let Some(board) = self.boards.get_mut(board) {
            board.ignored = Some(now);
        }
    }

    /// A board's references were set by another program, or were told or read by ours.
    pub fn meddled(&mut self, board: usize, by_another: bool) {
        if let Some(board) = self.boards.get_mut(board) {
            board.meddled = by_another;
        }
    }

    /// The driver's move arrives at a board.
    pub fn moves(&mut self, board: usize, now: Time) {
        if let Some(board) = self.boards.get(board).filter(|b| b.meddled) {
            self.found.push(format!(
                "{}: it is moved at {now} by references that another set, and nobody looked",
                board.port
            ));
        }
    }

    /// The driver says something on a line.
    pub fn said(&mut self, board: usize, line: Line, ask: &Ask, now: Time) {
        let touched = touched(ask).map(|joints| self.strangers(board, joints, now));
        let Some(watched) = self.boards.get_mut(board) else { return };
        let is_stop = matches!(ask, Ask::Set(Set::Stop(_)));
        if is_stop {
            (watched.owed, watched.said, watched.ignored) = (None, Some(now), None);
        }
        if let Some(slot) = watched.saying.get_mut(line as usize) {
            *slot = Some((now, is_stop));
        }
        let port = watched.port.clone();
        if let (Some(since), Ask::Set(Set::Move { .. })) = (watched.stopped.filter(|since| *since < now), ask) {
            self.found.push(format!("{port}: stopped at {since}, it is told to move at {now}"));
        }
        if let (Line::Orders, Ask::Set(set)) = (line, ask) {
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

    /// The driver streams set-points.
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

    /// Those of a board's joints that no command names.
    fn strangers(&self, board: usize, joints: &Joints, now: Time) -> Vec<usize> {
        let Some(watched) = self.boards.get(board) else { return Vec::new() };
        let (first, n) = (watched.motors.start, watched.motors.len());
        let named = |j: &usize| {
            let of_late = self.named.iter().filter(|(until, _)| now <= *until);
            of_late.into_iter().any(|(_, motors)| motors.contains(&(first + j)))
        };
        joints.on(n).unwrap_or_default().into_iter().filter(|j| !named(j)).collect()
    }

    /// What was said on a line is answered, or is given up.
    pub fn heard(&mut self, board: usize, line: Line, now: Time, answered: bool) {
        let Some(watched) = self.boards.get_mut(board) else { return };
        let said = watched.saying.get_mut(line as usize).and_then(Option::take);
        if let Some((since, _)) = said.filter(|_| answered) {
            watched.answers.push_back((now, now.since(since).as_secs_f64()));
            while watched.answers.len() > 128 {
                watched.answers.pop_front();
            }
        }
    }

    /// A look at the lease and at the clock; to be called before the boards are looked at.
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

    /// A look at a board: where its motors really are, rad, and how fast, rad/s.
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
        let saying_one = watched.is_being_stopped();
        let fastest = v.iter().map(|v| v.abs().to_degrees()).fold(0.0, f64::max);
        if let Some(since) = watched.owed.filter(|since| now.since(*since) > AT_ONCE) {
            // a board that rests is sent none
            if !excused && !saying_one && fastest > REST {
                found.push(format!("{}: a stop of {since} was not said until {now}", watched.port));
            }
            if !saying_one {
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
        if let Some(since) = watched.ignored.filter(|since| now.since(*since) > AGAIN) {
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
        let told = self.told.get(watched.motors.clone()).unwrap_or_default();
        for (joint, (slot, (v, told))) in watched.fast.iter_mut().zip(v.iter().zip(told)).enumerate() {
            let most = told.iter().map(|(_, most)| *most).fold(f64::NEG_INFINITY, f64::max);
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

    /// A look at what is set in a board's joints: as it was found, once they have rested and were not told to move for a while. Modes
    /// are a program's own as long as it drives.
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
        // what another program sets is its own
        let meddled = faults.any_since(Time::ZERO, now, |f| matches!(f, WireFault::Meddled(_)));
        let is_blind = now.since(self.heard_of) > UNHEARD;
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
            let (found, left) = (watched.found.get(joint), settings.get(joint));
            self.found.push(format!(
                "{}: joint {joint} was found as {found:?} and is left as {left:?} at {now}",
                watched.port
            ));
        }
    }

    /// The driver gives a reading, and tells how long its boards take to answer. `lies`: encoders lie.
    pub fn read(&mut self, now: Time, sample: &Sample, answers: Option<AnswerTime>, lies: impl Fn(usize) -> bool) {
        self.heard_of = now;
        if let Some(died) = self.died.filter(|at| now > *at + AT_ONCE && now.since(*at) < MOURNS) {
            self.found.push(format!("a task died at {died}, and the boards are read as ever at {now}"));
        }
        for (board, watched) in self.boards.iter().enumerate() {
            if !lies(board) && watched.is_older(sample) {
                let (port, at) = (&watched.port, sample.at);
                self.found.push(format!("{port}: a reading that is told to be of {at} is older, at {now}"));
            }
        }
        let slowest = self.boards.iter().filter_map(|b| b.median(now)).fold(0.0, f64::max);
        if slowest > 0.02 && answers.is_none_or(|a| a.most.as_secs_f64() < 0.8 * slowest) {
            self.found
                .push(format!("half of the answers take {slowest:.3} s, and the driver tells {answers:?} at {now}"));
        }
    }

    /// Whether a stop would get to this board, and would have for a while.
    pub fn is_in_reach(&self, board: usize, now: Time) -> bool {
        let died = self.died.is_some_and(|at| now.since(at) < BACK + RESTS);
        !died && self.boards.get(board).is_some_and(|b| now > b.excused + BACK + RESTS)
    }
}

/// The joints that an order does something to, but for stops.
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
