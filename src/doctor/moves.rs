//! `mobee doctor FILE --move MOTOR`: whether reference speeds mean speeds, timed on a few small moves.
//!
//! The only thing that moves here, and it moves as in every run: in transactions, under the reflex that the file sets, with a journal.

use super::Finding;
use crate::compose::{Composition, compose};
use crate::config::Config;
use crate::run::{CtlAt, Extras, Folder, Output, show};
use miette::Report;
use mobee_actors::system::AgentMaker;
use mobee_contract::{Agent, Hardware, Intent, MotionEnd, Paces, Refusal, Snapshot, Summary, Target, View};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::mpsc;

/// How far a motor is moved, rad.
const WAY: f64 = 6.0 * std::f64::consts::PI / 180.0;
/// How often: each move is timed twice, and a dozen times tell.
const MOVES: u32 = 6;
/// Share of the motor's greatest speed.
const SPEED: f64 = 0.05;

/// To and fro.
struct ToAndFro {
    motor: usize,
    /// Where it begins, rad.
    begin: Option<f64>,
    made: u32,
    reached: u32,
}

impl Agent for ToAndFro {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        self.reached += u32::from(last == Some(MotionEnd::Reached));
        let here = view.pose().get(self.motor).copied();
        if let (None, Some(axis), Some(here)) = (self.begin, view.axes.get(self.motor), here) {
            self.begin = Some(here.clamp(axis.min, axis.max));
        }
        let (Some(begin), Some(axis)) = (self.begin.filter(|_| self.made < MOVES), view.axes.get(self.motor)) else {
            return Intent::Done(Summary {
                text: format!("{} of {MOVES} moves arrived", self.reached),
                figures: Vec::new(),
            });
        };
        let away = if axis.max - begin > begin - axis.min { WAY } else { -WAY };
        let to = if self.made.is_multiple_of(2) { (begin + away).clamp(axis.min, axis.max) } else { begin };
        self.made += 1;
        Intent::MoveTo(Target { motors: vec![self.motor], q: vec![to], speed: SPEED })
    }

    fn export(&self) -> Snapshot {
        Snapshot { kind: "to and fro".into(), version: 1, state: Value::Null }
    }

    fn import(&mut self, _: Snapshot) -> Result<(), Refusal> {
        Err(Refusal::State { what: "it takes nothing over".into() })
    }
}

/// Moves the motor, and says what was seen.
///
/// # Errors
/// If the run can't be begun.
pub(super) fn measure(file: &Path, set: &[String], motor: &str) -> Result<Finding, Report> {
    let (mut config, source) = Config::load(file, set)?;
    config.name = format!("doctor-{motor}");
    let mut composition = compose(config, &source)?;
    let hardware = only(&mut composition, motor).ok_or_else(|| Report::msg(format!("{motor} is gone")))?;
    let folder = Folder::create(&composition.config.name, None)?;
    show(composition, &folder, Extras::default(), Output::default(), CtlAt::Folder, mpsc::channel(16))?;
    Ok(told(&hardware.paces(), motor, folder.path()))
}

/// Leaves nothing in the composition that moves but this motor; the hardware that it belongs to.
fn only(composition: &mut Composition, motor: &str) -> Option<Arc<dyn Hardware>> {
    composition.bridges.clear();
    composition.services.clear();
    composition.script.clear();
    composition.robots.iter_mut().for_each(|setup| setup.agent = None);
    let mut setups = composition.scene.robots().iter().zip(&mut composition.robots);
    let (motor, setup) =
        setups.find_map(|(robot, setup)| Some((robot.motors.iter().position(|m| m.name == motor)?, setup)))?;
    let agent: AgentMaker = Arc::new(move || Ok(Box::new(ToAndFro { motor, begin: None, made: 0, reached: 0 })));
    setup.agent = Some(agent);
    Some(setup.hardware.clone())
}

/// What the moves came to.
fn told(paces: &[Paces], motor: &str, folder: &Path) -> Finding {
    let measured = paces.iter().find(|paces| !paces.fair || paces.seen.len() > MOVES as usize);
    let Some(Paces { board, seen, fair }) = measured else {
        let what = format!("the speed of {motor} against its commands could not be measured");
        return Finding::bad(
            what,
            format!(
                "see why in {}: the moves did not arrive, were made of set-points or no board\'s, or are too quick for its states",
                folder.display()
            ),
        );
    };
    let (least, most) = seen.iter().fold((f64::INFINITY, 0.0f64), |(least, most), v| (least.min(*v), most.max(*v)));
    let what =
        format!("{motor} moved at {least:.2} to {most:.2} times the commanded speeds, in {} stretches", seen.len());
    if *fair {
        Finding::ok(format!("{what}: {board} honors reference speeds"))
    } else {
        Finding::bad(
            format!("{what}: {board} does not honor reference speeds"),
            "set moves = \"set-points\" in the driver's table",
        )
    }
}
