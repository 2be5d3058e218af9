//! `mobee doctor FILE --move MOTOR`: measures a board's reaction to commands on a few small motions of one motor.
//!
//! Nothing else moves, and the motor moves as in every run: in transactions, under the file's reflex, with a journal.
//!
//! ```text
//! ToAndFro (agent) ──> the run ──> RecordingDriver ──> board       moves, setpoints to and fro, a move that is halted halfway
//!                                       └──> Record ──> Figures ──> findings, settings
//! ```

use super::Finding;
use super::measures::Figures;
use super::verdict::{Measured, Settings, verdict};
use super::watched::{Observed, RecordingHardware, Shared, StopTrial, lock};
use crate::run::{CtlAt, Extras, Folder, Output, run_in_terminal};
use miette::Report;
use mobee_compose::config::Config;
use mobee_compose::{Composition, compose};
use mobee_contract::{
    Agent, Hardware, Intent, MotionEnd, Refusal, Setpoints, Snapshot, Summary, Target, Time, Values, View,
};
use mobee_runtime::system::{AgentMaker, Control};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;

/// Distance of a move, rad; the halted move is twice as long.
const MOVE_RAD: f64 = 6.0 * std::f64::consts::PI / 180.0;
/// Number of slow moves: each is timed twice, and a dozen times show whether speeds are honored.
pub(super) const MOVES: usize = 6;
/// Share of the motor's maximum speed of slow moves.
const SLOW_SPEED: f64 = 0.05;
/// Share of the motor's maximum speed of quick moves.
const QUICK_SPEED: f64 = 0.2;
/// Distance from its target within which a joint has arrived: its sag is measured, and must not cause a rollback.
const TOLERANCE_DEG: f64 = 6.0;
/// Duration of the setpoints to and fro, unless that is too fast for the motor, s.
const STREAM_S: f64 = 5.0;
/// Rest of the motor after each motion.
const REST_TIME: Duration = Duration::from_millis(1200);

/// One motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Act {
    Away,
    Back,
    Stream,
    QuickAway,
    QuickBack,
    Halted,
}

/// All motions; the slow moves first.
const ACTS: [Act; MOVES + 5] = {
    use Act::{Away, Back, Halted, QuickAway, QuickBack, Stream};
    [Away, Back, Away, Back, Away, Back, Stream, QuickAway, QuickBack, Halted, QuickBack]
};

/// Commits the motions, with a rest after each.
struct ToAndFro {
    motor: usize,
    shared: Shared,
    /// Position at the start, rad.
    begin: Option<f64>,
    made: usize,
    /// True if the motor has rested since the last motion.
    rested: bool,
    arrived: u32,
    stream: Option<Stream>,
}

/// Setpoints to and fro, at a constant speed.
struct Stream {
    since: Time,
    from: f64,
    away: f64,
    /// Speed, rad/s.
    speed: f64,
}

impl Stream {
    /// The setpoint at this time; `None` once the motor is back.
    fn point(&self, at: Time) -> Option<f64> {
        let gone = self.speed * at.since(self.since).as_secs_f64();
        let most = self.away.abs();
        let left = if gone <= most { gone } else { 2.0 * most - gone };
        (left >= 0.0).then(|| self.from + left.copysign(self.away))
    }
}

impl ToAndFro {
    fn done(&self) -> Intent {
        let text = format!("{} of {} motions arrived", self.arrived, ACTS.len());
        Intent::Done(Summary { text, figures: Vec::new() })
    }

    fn points(&self, q: f64) -> Intent {
        Intent::Stream(Setpoints { motors: vec![self.motor], values: Values::Position(vec![q]) })
    }
}

impl Agent for ToAndFro {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        self.arrived += u32::from(last == Some(MotionEnd::Reached));
        self.stream = None;
        if !std::mem::replace(&mut self.rested, true) {
            return Intent::Wait(REST_TIME);
        }
        let (Some(axis), Some(here)) = (view.axes.get(self.motor), view.pose().get(self.motor)) else {
            return self.done();
        };
        let begin = *self.begin.get_or_insert(here.clamp(axis.min, axis.max));
        let sign = if axis.max - begin > begin - axis.min { 1.0 } else { -1.0 };
        let to = |way: f64| (begin + sign * way).clamp(axis.min, axis.max);
        let streams = lock(&self.shared).board.as_ref().is_some_and(|board| board.position_direct);
        self.made += usize::from(!streams && ACTS.get(self.made) == Some(&Act::Stream));
        let Some(act) = ACTS.get(self.made) else { return self.done() };
        self.made += 1;
        self.rested = false;
        let halted = *act == Act::Halted;
        lock(&self.shared).trial = if halted { StopTrial::Armed(here.to_degrees()) } else { StopTrial::Off };
        let (q, speed) = match act {
            Act::Away => (to(MOVE_RAD), SLOW_SPEED),
            Act::Back => (begin, SLOW_SPEED),
            Act::QuickAway => (to(MOVE_RAD), QUICK_SPEED),
            Act::QuickBack => (begin, QUICK_SPEED),
            Act::Halted => (to(2.0 * MOVE_RAD), QUICK_SPEED),
            Act::Stream => {
                let away = to(MOVE_RAD) - here;
                let speed = (2.0 * away.abs() / STREAM_S).min(QUICK_SPEED * axis.max_speed);
                self.stream = Some(Stream { since: view.at, from: *here, away, speed });
                return self.points(*here);
            }
        };
        Intent::MoveTo(Target { motors: vec![self.motor], q: vec![q], speed })
    }

    fn revise(&mut self, view: &View) -> Option<Intent> {
        let point = self.stream.as_ref()?.point(view.at);
        point.map(|q| self.points(q))
    }

    fn export(&self) -> Snapshot {
        Snapshot { kind: "to and fro".into(), version: 1, state: Value::Null }
    }

    fn import(&mut self, _: Snapshot) -> Result<(), Refusal> {
        Err(Refusal::State { what: "it takes nothing over".into() })
    }
}

/// Moves the motor; returns the findings, and the settings that follow from them.
///
/// # Errors
/// If the run can't be started.
pub(super) fn measure(file: &Path, set: &[String], motor: &str) -> Result<(Vec<Finding>, Settings), Report> {
    let (mut config, source) = Config::load(file, set)?;
    config.name = format!("doctor-{motor}");
    // the run ends when all is measured
    config.for_s = None;
    let file_has = config.robot.clone();
    for controller in config.robot.iter_mut().map(|robot| &mut robot.controller) {
        let most = controller.stall_deg.unwrap_or(f64::INFINITY).min(TOLERANCE_DEG);
        controller.tolerance_deg = controller.tolerance_deg.max(most);
    }
    let mut composition = compose(config, &source)?;
    let (controls, receiver) = mpsc::channel(16);
    let (robot, hardware, shared) =
        only(&mut composition, motor, &controls).ok_or_else(|| Report::msg(format!("{motor} is gone")))?;
    let config = file_has.get(robot).ok_or_else(|| Report::msg(format!("the robot of {motor} is gone")))?;
    let folder = Folder::create(&composition.config.name, None)?;
    run_in_terminal(composition, &folder, Extras::default(), Output::default(), CtlAt::Folder, (controls, receiver))?;
    let seen = lock(&shared);
    let figures: Figures = seen.record.figures();
    let axis = seen.board.as_ref().and_then(|board| board.axes.iter().find(|axis| axis.name == motor)).cloned();
    let axis = axis.ok_or_else(|| Report::msg(format!("the board of {motor} was not reached")))?;
    let paces = hardware.paces();
    let coarse = seen.coarse();
    Ok(verdict(&Measured {
        figures: &figures,
        axis: &axis,
        paces: &paces,
        robot: config,
        folder: folder.path(),
        coarse,
    }))
}

/// Leaves only this motor to move in the composition. Returns its robot, the robot's hardware, and its observations.
fn only(
    composition: &mut Composition,
    motor: &str,
    controls: &mpsc::Sender<Control>,
) -> Option<(usize, Arc<dyn Hardware>, Shared)> {
    composition.bridges.clear();
    composition.services.clear();
    composition.script.clear();
    composition.robots.iter_mut().for_each(|setup| setup.agent = None);
    let setups = composition.scene.robots().iter().zip(&mut composition.robots).enumerate();
    let of = |robot: &mobee_model::Robot| robot.motors.iter().position(|m| m.name == motor);
    let (robot, motor, setup) = setups.into_iter().find_map(|(i, (robot, setup))| Some((i, of(robot)?, setup)))?;
    let shared = Observed::new(&setup.name, motor, controls.clone());
    let watched = RecordingHardware { inner: setup.hardware.clone(), shared: shared.clone() };
    let hardware = std::mem::replace(&mut setup.hardware, Arc::new(watched));
    let seen = shared.clone();
    let agent: AgentMaker = Arc::new(move || {
        let shared = seen.clone();
        Ok(Box::new(ToAndFro { motor, shared, begin: None, made: 0, rested: true, arrived: 0, stream: None }))
    });
    setup.agent = Some(agent);
    Some((robot, hardware, shared))
}
