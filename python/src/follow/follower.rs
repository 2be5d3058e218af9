//! One life of the service: programs' set-points become a stream of the robot's filtered interface. No Python here.

use super::course::{FollowCourse, FollowLimits};
use super::guard::FollowGuard;
use super::{FollowCommand, FollowReply, FollowRequest, FollowSettings, FollowStatus};
use crate::motion_book::MotionBook;
use mobee_contract::{
    Commit, CommitId, Filtered, Hold, Latest, Pose, Refusal, Running, SILENCE, Setpoints, Status, Target, Time, Values,
};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Added to the silence after a contact: readings and clocks differ by some periods.
const SILENCE_RESERVE: Duration = Duration::from_millis(60);
/// Pause between two attempts at freeing a robot that holds.
const FREEING_PAUSE: Duration = Duration::from_secs(1);
/// Configurations at rest that are remembered as ends of escapes.
const MAX_RESTS: usize = 16;
/// Shares of the velocities toward a set-point that are tried in front of an obstacle; the last: the motors brake.
const SHARES: [f64; 4] = [1.0, 0.5, 0.2, 0.0];
/// Periods within which a chunk may reach its last set-point after its time.
const MAX_MORE: usize = 100;
/// Distance within which a set-point is reached, rad of encoder.
const ARRIVED: f64 = 1e-6;
/// Distance between the reading at rest and the last set-point within which the set-point is continued, beyond the hold error, rad of encoder.
const SAME_PLACE: f64 = 0.02;
/// Factor on the caution at a stop, its greatest value, and the time constant with which it falls, s.
const MORE_CAUTION: f64 = 1.3;
const MAX_CAUTION: f64 = 3.0;
const CAUTION_S: f64 = 60.0;
/// Speed below which readings show by how much the robot sags, rad/s of encoder; and the time constant of that, s.
const SLOW: f64 = 0.1;
const SAG_S: f64 = 0.1;
/// Time for which a robot first moves slowly, until that is known.
const FIRST_SAG: Duration = Duration::from_millis(400);
/// Distance of plans beyond the margin, m: contacts end there.
const ALLOWANCE_M: f64 = 0.002;

/// A robot that follows set-points.
pub(super) struct Follower {
    settings: FollowSettings,
    running: Arc<dyn Running>,
    robot: Arc<dyn Filtered>,
    agent: Arc<str>,
    book: MotionBook,
    motors: Vec<usize>,
    limits: FollowLimits,
    guard: FollowGuard,
    /// The course under way; `None`: nothing is streamed.
    course: Option<FollowCourse>,
    /// The last set-point that was streamed, rad of encoder.
    last: Option<Vec<f64>>,
    /// Difference between the readings and the set-points, rad of encoder, while the robot is slow: an arm without gravity compensation
    /// hangs below its set-points.
    sag: Vec<f64>,
    /// Time for which it has been measured.
    measured: Duration,
    /// Factor on predicted stopping ways: raised when the filter closes on the stream, as the controller then predicts longer ones, too.
    caution: f64,
    /// Reason for which the last chunk was ended early.
    pub cut: Option<String>,
    /// The last set-point of a program that sends them one by one, and its time.
    wanted: Option<(Time, Vec<f64>)>,
    /// True if the filter has closed on the stream: it must be silent for a while.
    interrupted: bool,
    silent_until: Time,
    /// Configurations at rest, free of contact, newest last.
    rests: VecDeque<Vec<f64>>,
    next_freeing: Time,
}

impl Follower {
    pub fn new(
        settings: FollowSettings,
        running: Arc<dyn Running>,
        robot: Arc<dyn Filtered>,
        book: MotionBook,
    ) -> Self {
        let board = robot.board();
        let limits = FollowLimits {
            axes: board.axes.clone(),
            speed: settings.speed,
            reaction: (board.latency + settings.tick * 2).as_secs_f64(),
        };
        Self {
            agent: format!("{}/follow", robot.name()).into(),
            motors: (0..board.axes.len()).collect(),
            sag: vec![0.0; board.axes.len()],
            // a board that holds its position has nothing to measure
            measured: if board.axes.iter().all(|axis| axis.hold_error < SAME_PLACE) {
                FIRST_SAG
            } else {
                Duration::ZERO
            },
            guard: FollowGuard::new(robot.index(), settings.margin + ALLOWANCE_M),
            limits,
            course: None,
            last: None,
            caution: 1.0,
            cut: None,
            wanted: None,
            interrupted: false,
            silent_until: Time::ZERO,
            rests: VecDeque::new(),
            next_freeing: Time::ZERO,
            settings,
            running,
            robot,
            book,
        }
    }

    /// True if the robot rests and takes set-points.
    pub fn is_ready(&self) -> bool {
        let latest = self.robot.latest();
        latest.ready && latest.status == Status::Rest
    }

    /// Streams the set-point that is due, or notes that the robot was stopped.
    ///
    /// # Errors
    /// If the scene can't be compiled.
    pub async fn tick(&mut self, now: Time) -> Result<(), String> {
        let latest = self.robot.latest();
        match latest.status {
            Status::Rest => {
                if std::mem::take(&mut self.interrupted) {
                    self.silent_until = now + SILENCE + SILENCE_RESERVE;
                }
            }
            Status::Moving | Status::Escaping => {}
            Status::Holding(hold) => {
                self.interrupt();
                self.free(hold, now).await;
            }
            Status::Starting | Status::Stopping | Status::Retreating | Status::Settling => self.interrupt(),
        }
        if latest.status == Status::Rest && latest.ready && latest.contacts.is_empty() && self.course.is_none() {
            self.remember(&latest.q);
        }
        self.caution += (1.0 - self.caution) * self.settings.tick.as_secs_f64() / CAUTION_S;
        self.learn_sag(&latest, now);
        self.look_again(now)?;
        let Some(course) = &self.course else { return Ok(()) };
        if now >= course.end() + self.settings.hold_after {
            // the program stalls: the stream ends by its silence, and the robot holds
            self.course = None;
            return Ok(());
        }
        let q = course.at(now + self.settings.tick);
        if let Err(refusal) = self.stream(q, now).await {
            self.course = None;
            if refusal == Refusal::Closed {
                self.closed();
            }
        }
        Ok(())
    }

    /// Compares the readings with the set-points, while both are slow.
    fn learn_sag(&mut self, latest: &Latest, now: Time) {
        let slow =
            self.course.as_ref().is_none_or(|c| c.velocities(now, Duration::ZERO).iter().all(|v| v.abs() < 1.1 * SLOW));
        let Some(last) = self.last.as_ref().filter(|_| slow && latest.status != Status::Starting) else { return };
        let share = (self.settings.tick.as_secs_f64() / SAG_S).min(1.0);
        self.measured = (self.measured + self.settings.tick).min(FIRST_SAG);
        for ((sag, axis), (q, last)) in self.sag.iter_mut().zip(&self.limits.axes).zip(latest.q.iter().zip(last)) {
            *sag += share * ((q - last).clamp(-axis.hold_error, axis.hold_error) - *sag);
        }
    }

    /// Configuration in which an arm hangs at these set-points, rad of encoder. `sags`: 1, or 2 after a stop, by which a board may hold the
    /// reading: the arm then hangs below it again.
    fn hanging(&self, q: &[f64], sags: f64) -> Vec<f64> {
        let mut q: Vec<f64> = q.iter().zip(&self.sag).map(|(q, sag)| q + sags * sag).collect();
        self.limits.clip(&mut q);
        q
    }

    /// Ends the stream of a robot that something else moves.
    fn interrupt(&mut self) {
        if self.course.take().is_some() {
            self.closed();
        }
        self.last = None;
    }

    /// Notes that the filter has closed on the stream.
    fn closed(&mut self) {
        if !std::mem::replace(&mut self.interrupted, true) {
            self.caution = (self.caution * MORE_CAUTION).min(MAX_CAUTION);
        }
    }

    fn remember(&mut self, q: &[f64]) {
        let is_new = self.rests.back().is_none_or(|last| last.iter().zip(q).any(|(a, b)| (a - b).abs() > SAME_PLACE));
        if is_new {
            if self.rests.len() >= MAX_RESTS {
                self.rests.pop_front();
            }
            self.rests.push_back(q.to_vec());
        }
    }

    /// Tries to free a robot that holds: a failed retreat is repeated, and a robot in contact goes where it rested before.
    async fn free(&mut self, hold: Hold, now: Time) {
        if !self.settings.recover || now < self.next_freeing {
            return;
        }
        self.next_freeing = now + FREEING_PAUSE;
        let by_escape =
            matches!(hold, Hold::InContact | Hold::RetreatBlocked | Hold::HistoryTooShort | Hold::RetreatMissed);
        if !by_escape || self.robot.recover().is_ok() {
            return;
        }
        let Some(q) = self.rests.pop_back() else { return };
        let target = Target { motors: self.motors.clone(), q, speed: 1.0 };
        // refused: the next attempt goes elsewhere
        let _ = self.robot.commit(Commit { agent: self.agent.clone(), target, speeds: None }).await;
    }

    async fn stream(&mut self, q: Vec<f64>, now: Time) -> Result<CommitId, Refusal> {
        let setpoints = Setpoints { motors: self.motors.clone(), values: Values::Position(q.clone()) };
        let verdict = self.robot.stream(self.agent.clone(), setpoints).await;
        match &verdict {
            Ok(_) => self.last = Some(q),
            Err(Refusal::Pushing) => self.silent_until = now + SILENCE + SILENCE_RESERVE,
            Err(_) => {}
        }
        verdict
    }

    /// Carries out a command; `None` if its program has withdrawn it.
    ///
    /// # Errors
    /// If the scene can't be compiled.
    pub async fn obey(&mut self, request: &FollowRequest, now: Time) -> Result<Option<FollowReply>, String> {
        let (goals, period) = match &request.command {
            FollowCommand::Pause => return Ok(Some(self.held(&self.robot.latest(), now, "waited", String::new()))),
            FollowCommand::Finish => {
                self.brake(now);
                self.settings.hold_after = Duration::ZERO;
                return Ok(Some(self.held(&self.robot.latest(), now, "finished", String::new())));
            }
            FollowCommand::Target(q) => (std::slice::from_ref(q), self.settings.period),
            FollowCommand::Chunk(goals, period) => (goals.as_slice(), *period),
        };
        let latest = self.robot.latest();
        if let Err((code, reason)) = self.available(&latest, goals, now) {
            return Ok(Some(self.held(&latest, now, code, reason)));
        }
        self.set_scene()?;
        let velocities = match &self.course {
            Some(course) => course.velocities(now, self.settings.period / 2),
            None => vec![0.0; self.motors.len()],
        };
        let mut course = FollowCourse::begin(now, self.base(&latest, now));
        let (limited, blocked) = self.plan(&mut course, goals, period, velocities);
        if course.len() == 0 {
            return Ok(Some(self.held(&latest, now, "blocked", blocked.unwrap_or_default())));
        }
        if !request.take() {
            return Ok(None);
        }
        Ok(Some(match self.stream(course.at(now + self.settings.tick), now).await {
            Err(refusal) => {
                if refusal == Refusal::Closed && self.course.take().is_some() {
                    self.closed();
                }
                let reason = format!("{refusal}; {}", refusal.remedy());
                self.held(&self.robot.latest(), now, refusal.code(), reason)
            }
            Ok(id) => {
                let q = course.goals().flatten().copied().collect();
                self.course = Some(course);
                self.cut = None;
                let (status, code) = match (&blocked, limited) {
                    (Some(_), _) => (FollowStatus::Limited, "blocked"),
                    (None, Some(code)) => (FollowStatus::Limited, code),
                    (None, None) => (FollowStatus::Sent, ""),
                };
                FollowReply { q, status, code, reason: blocked.unwrap_or_default(), id: Some(id) }
            }
        }))
    }

    /// Checks whether set-points can be followed now.
    fn available(&self, latest: &Latest, goals: &[Vec<f64>], now: Time) -> Result<(), (&'static str, String)> {
        if let Some(at) = goals.iter().flatten().position(|x| !x.is_finite()) {
            let joint = self.limits.axes.get(at % self.motors.len().max(1)).map_or("?", |axis| axis.name.as_str());
            return Err(("not_finite", format!("the position of joint {joint} is not a finite number")));
        }
        match latest.status {
            Status::Starting => Err(("not_ready", "the controller is not complete yet".into())),
            Status::Stopping | Status::Retreating | Status::Settling => {
                Err(("rolling_back", self.book.stopped().unwrap_or_else(|| "the motion is being rolled back".into())))
            }
            Status::Holding(hold) => Err(("holding", hold.to_string())),
            Status::Escaping => Err(("holding", "the robot escapes from a contact".into())),
            _ if now < self.silent_until => {
                let why = self.book.stopped().map_or(String::new(), |why| format!(": {why}"));
                Err(("pause", format!("half a second of silence after a stop{why}")))
            }
            Status::Moving if self.course.is_none() => {
                Err(("not_ready", "the last stream has ended by its silence, and the robot comes to rest".into()))
            }
            Status::Rest if !latest.ready => Err(("not_ready", "the outcome of the last motion is awaited".into())),
            Status::Rest | Status::Moving => Ok(()),
        }
    }

    /// Set-point at which a new course begins, rad of encoder: that of the course under way; else the last one, if the robot rests there;
    /// else the one that holds it where it rests.
    fn base(&self, latest: &Latest, now: Time) -> Vec<f64> {
        if let Some(course) = &self.course {
            return course.at(now);
        }
        let near = |last: &&Vec<f64>| {
            let each = last.iter().zip(latest.q.iter()).zip(&self.limits.axes);
            each.into_iter().all(|((a, b), axis)| (a - b).abs() <= axis.hold_error + SAME_PLACE)
        };
        let holding = || latest.q.iter().zip(&self.sag).map(|(q, sag)| q - sag).collect();
        let mut q = self.last.as_ref().filter(near).cloned().unwrap_or_else(holding);
        self.limits.clip(&mut q);
        q
    }

    /// Simulates set-points ahead, each a period after the one before: a course as far as it is free. Returns why it differs from what is
    /// wanted, in a word, and what is in the way.
    fn plan(
        &mut self,
        course: &mut FollowCourse,
        goals: &[Vec<f64>],
        period: Duration,
        velocities: Vec<f64>,
    ) -> (Option<&'static str>, Option<String>) {
        let poses = self.poses();
        let (mut limited, mut before) = (None, velocities);
        let (secs, begins) = (period.as_secs_f64(), course.end());
        let recent = self.wanted.take().filter(|(at, _)| course.end().since(*at) < period * 2);
        // a chunk goes on until its last set-point is reached
        let more = if goals.len() > 1 { MAX_MORE } else { 0 };
        let last = goals.last().into_iter().cycle().take(more);
        for (k, goal) in goals.iter().chain(last).enumerate() {
            if k >= goals.len() && course.goal().iter().zip(goal).all(|(a, b)| (a - b).abs() < ARRIVED) {
                break;
            }
            let mut goal = goal.clone();
            if self.limits.clip(&mut goal) {
                limited = limited.or(Some("limits"));
            }
            // set-points of a program move on as they did, those of a chunk as they will
            let on = match (&recent, goals.get(k + 1)) {
                (_, Some(later)) => self.limits.moves_on(&goal, later, secs),
                (Some((_, before)), None) if goals.len() == 1 => self.limits.moves_on(before, &goal, secs),
                _ => vec![0.0; goal.len()],
            };
            if goals.len() == 1 {
                self.wanted = Some((course.end(), goal.clone()));
            }
            let known = course.end() >= begins + (FIRST_SAG - self.measured);
            let top = if known { f64::INFINITY } else { SLOW };
            let (to, next, blocked) = self.step((course.goal(), &before), (&goal, &on), (period, &poses), top);
            if to.iter().zip(&goal).any(|(a, b)| (a - b).abs() > ARRIVED) {
                limited = limited.or(Some("speed"));
            }
            let rests = next.iter().all(|v| v.abs() < 1e-6);
            if !(rests && blocked.is_some()) {
                course.push(course.end() + period, to);
            }
            if blocked.is_some() && (rests || goals.len() == 1) {
                return (limited, blocked);
            }
            before = next;
        }
        (limited, None)
    }

    /// One period toward a set-point: its end, the velocities there, and what is in the way if it is shorter for that. The way on which the
    /// motors would stop after it is free; if there is no such period, they brake on the way that was tested before.
    fn step(
        &mut self,
        (from, before): (&[f64], &[f64]),
        goal: (&[f64], &[f64]),
        (period, poses): (Duration, &[Pose]),
        top: f64,
    ) -> (Vec<f64>, Vec<f64>, Option<String>) {
        let secs = period.as_secs_f64();
        let mut blocked = None;
        for share in SHARES {
            let velocities = self.limits.velocities((from, before), goal, (share, top), secs);
            let to = self.limits.after(from, &velocities, secs);
            let stop = self.limits.stop(&to, &velocities, self.caution);
            let free = match blocked {
                // the way on was tested before, and there is nothing better
                Some(_) if share == 0.0 => Ok(()),
                _ => self.test(poses, from, &stop),
            };
            match free {
                Ok(()) => return (to, velocities, blocked),
                Err(why) => blocked = Some(why),
            }
        }
        (from.to_vec(), vec![0.0; from.len()], blocked)
    }

    /// Tests the way from a set-point to the configuration of a stop. Where even a stop at once would be too near, only the way itself.
    fn test(&mut self, poses: &[Pose], from: &[f64], stop: &[f64]) -> Result<(), String> {
        let (here, stopped) = (self.hanging(from, 1.0), self.hanging(from, 2.0));
        let sags = if self.guard.test(poses, &here, &stopped).is_ok() { 2.0 } else { 1.0 };
        let stop = self.hanging(stop, sags);
        self.guard.test(poses, &here, &stop)
    }

    /// Tests the next period of a chunk again, with the objects and the sag of now. If it is not free any more, the robot brakes.
    ///
    /// # Errors
    /// If the scene can't be compiled.
    fn look_again(&mut self, now: Time) -> Result<(), String> {
        let Some(course) = self.course.as_ref().filter(|course| course.len() > 1 && now < course.end()) else {
            return Ok(());
        };
        let period = self.settings.period;
        let (from, next) = (course.at(now), course.at(now + period));
        let velocities = course.velocities(now + period, Duration::ZERO);
        let stop = self.limits.stop(&next, &velocities, self.caution);
        self.set_scene()?;
        let poses = self.poses();
        let Err(why) = self.test(&poses, &from, &stop) else { return Ok(()) };
        self.brake(now);
        self.cut = Some(why);
        Ok(())
    }

    /// Ends the course under way as soon as the motors can.
    fn brake(&mut self, now: Time) {
        let Some(course) = &self.course else { return };
        let period = self.settings.period;
        let mut brakes = FollowCourse::begin(now, course.at(now));
        let mut before = course.velocities(now, Duration::ZERO);
        for _ in 0..MAX_MORE {
            let here = brakes.goal().to_vec();
            let none = (0.0, f64::INFINITY);
            before = self.limits.velocities((&here, &before), (&here, &before), none, period.as_secs_f64());
            let to = self.limits.after(&here, &before, period.as_secs_f64());
            brakes.push(brakes.end() + period, to);
            if before.iter().all(|v| v.abs() < 1e-6) {
                break;
            }
        }
        self.course = Some(brakes);
    }

    /// Takes over the scene and the clearance of now.
    ///
    /// # Errors
    /// If the scene can't be compiled.
    pub fn set_scene(&mut self) -> Result<(), String> {
        let clearance = self.settings.margin.max(self.book.braking_clearance()) + ALLOWANCE_M + self.settings.extra;
        self.guard.set(&self.running.scene(), clearance)
    }

    /// Configurations of all robots.
    fn poses(&self) -> Vec<Pose> {
        self.running.robots().iter().map(|robot| robot.latest().q).collect()
    }

    /// Reply for a command that is not carried out, with the configuration that is held.
    fn held(&self, latest: &Latest, now: Time, code: &'static str, reason: String) -> FollowReply {
        let q = match latest.status {
            Status::Rest | Status::Moving => self.base(latest, now),
            _ => latest.q.to_vec(),
        };
        FollowReply { q, status: FollowStatus::Held, code, reason, id: None }
    }
}
