//! `mobee doctor FILE --move MOTOR`: what a board does with its commands, measured on a few small motions of one motor.
//!
//! The only thing that moves here, and it moves as in every run: in transactions, under the reflex that the file sets, with a journal.
//!
//! ```text
//! ToAndFro (agent) ──> the run ──> WatchedDriver ──> board         moves, set-points to and fro, a move that is halted halfway
//!                                       └──> Record ──> Figures ──> findings, settings
//! ```

use super::Finding;
use super::measures::Figures;
use super::verdict::{Measured, Settings, verdict};
use super::watched::{Observed, Shared, StopTrial, Watched, lock};
use crate::compose::{Composition, compose};
use crate::config::Config;
use crate::run::{CtlAt, Extras, Folder, Output, show};
use miette::Report;
use mobee_actors::system::{AgentMaker, Control};
use mobee_contract::{
    Agent, Hardware, Intent, MotionEnd, Refusal, Setpoints, Snapshot, Summary, Target, Time, Values, View,
};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;

/// How far a motor is moved, rad; a move that is halted on its way is twice as long.
const WAY: f64 = 6.0 * std::f64::consts::PI / 180.0;
/// Slow moves: each is timed twice, and a dozen times show whether speeds are honored.
pub(super) const MOVES: usize = 6;
/// Shares of the motor's greatest speed: of slow moves, and of quick moves.
const SPEED: f64 = 0.05;
const QUICK: f64 = 0.2;
/// A joint that rests this far beside its target has arrived: its sag is measured, and no reason to take a motion back.
const TOLERANCE_DEG: f64 = 6.0;
/// Set-points go to and fro in this time, unless that were too quick for the motor, s.
const STREAM_S: f64 = 5.0;
/// How long the motor rests after each motion.
const REST: Duration = Duration::from_millis(1200);

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

/// All of them; the slow moves first.
const ACTS: [Act; MOVES + 5] = {
    use Act::{Away, Back, Halted, QuickAway, QuickBack, Stream};
    [Away, Back, Away, Back, Away, Back, Stream, QuickAway, QuickBack, Halted, QuickBack]
};

/// Makes them, with a rest after each.
struct ToAndFro {
    motor: usize,
    shared: Shared,
    /// Where it began, rad.
    begin: Option<f64>,
    made: usize,
    /// Whether it has rested since.
    rested: bool,
    arrived: u32,
    stream: Option<Stream>,
}

/// Set-points to and fro, at a constant speed.
struct Stream {
    since: Time,
    from: f64,
    away: f64,
    /// Rad/s.
    speed: f64,
}

impl Stream {
    /// The set-point of this time; `None`: the motor is back.
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
            return Intent::Wait(REST);
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
            Act::Away => (to(WAY), SPEED),
            Act::Back => (begin, SPEED),
            Act::QuickAway => (to(WAY), QUICK),
            Act::QuickBack => (begin, QUICK),
            Act::Halted => (to(2.0 * WAY), QUICK),
            Act::Stream => {
                let away = to(WAY) - here;
                let speed = (2.0 * away.abs() / STREAM_S).min(QUICK * axis.max_speed);
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

/// Moves the motor; what was found, and the settings that follow from it.
///
/// # Errors
/// If the run can't be begun.
pub(super) fn measure(file: &Path, set: &[String], motor: &str) -> Result<(Vec<Finding>, Settings), Report> {
    let (mut config, source) = Config::load(file, set)?;
    config.name = format!("doctor-{motor}");
    // it ends when all is measured
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
    show(composition, &folder, Extras::default(), Output::default(), CtlAt::Folder, (controls, receiver))?;
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

/// Leaves nothing in the composition that moves but this motor. Its robot, the robot's hardware, and what will be seen of it.
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
    let watched = Watched { inner: setup.hardware.clone(), shared: shared.clone() };
    let hardware = std::mem::replace(&mut setup.hardware, Arc::new(watched));
    let seen = shared.clone();
    let agent: AgentMaker = Arc::new(move || {
        let shared = seen.clone();
        Ok(Box::new(ToAndFro { motor, shared, begin: None, made: 0, rested: true, arrived: 0, stream: None }))
    });
    setup.agent = Some(agent);
    Some((robot, hardware, shared))
}
