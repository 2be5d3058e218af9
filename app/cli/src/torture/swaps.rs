//! Swaps (F21, F22): a part of a robot is swapped at any time, as by `mobee ctl swap` and `mobee run --watch`, for a
//! working or a flawed one.

use crate::ctl::swap_offer::{BuiltPart, PartRequest, take};
use mobee_compose::config::{Config, Source};
use mobee_contract::{
    Agent, Board, Command, ControlMode, Driver, DriverFault, Hardware, Intent, MotionEnd, Note, Refusal, Sample,
    Snapshot, SwapPart, Time, View,
};
use mobee_model::Robot;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{Control, NewPart, PartOffer};
use mobee_runtime::wiring::Maker;
use mobee_sim::SimHardware;
use serde_json::Value;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::oneshot;

/// The flaw of a new part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// It can't be used, and is refused: the old part stays.
    Unusable,
    /// It fails at its first use, and is reverted.
    Fails,
}

/// A part that is offered in place of another. The result is not awaited.
#[derive(Clone, Debug, PartialEq)]
pub struct Swap {
    /// The robot.
    pub robot: usize,
    /// The part.
    pub part: SwapPart,
    /// Settings that differ from those of the configuration.
    pub edits: Vec<(&'static str, Value)>,
    /// True if a new agent starts without the old one's state.
    pub fresh: bool,
    /// The flaw, of agents and drivers only.
    pub flaw: Option<Flaw>,
    /// Shadow, probation and budget.
    pub terms: SwapPolicy,
}

impl Swap {
    /// The control that offers the part; `board` is the robot's board. `None` if the edited configuration is refused
    /// before the offer.
    pub(super) fn control(
        &self,
        config: &Config,
        source: &Source,
        robots: &[Arc<Robot>],
        board: Option<&SimHardware>,
    ) -> Option<Control> {
        let (robot, model) = config.robot.get(self.robot).zip(robots.get(self.robot))?;
        let offered = match self.part {
            SwapPart::Driver => BuiltPart::Part(PartOffer {
                part: NewPart::Driver(driver(board?, self.flaw)),
                what: "another driver of the same board".into(),
                terms: self.terms,
            }),
            part => {
                let mut edited = serde_json::to_value(config).ok()?;
                for (key, value) in &self.edits {
                    edited["robot"][self.robot][part.to_string()][*key] = value.clone();
                }
                let wanted = PartRequest { part, name: &robot.name, model, fresh: self.fresh, terms: self.terms };
                take(serde_json::from_value(edited).ok()?, source, &wanted).ok()?
            }
        };
        let offered = match (offered, self.flaw) {
            (BuiltPart::Agent(mut offer), Some(flaw)) => {
                offer.maker = flawed(offer.maker, flaw);
                BuiltPart::Agent(offer)
            }
            (offered, _) => offered,
        };
        let (reply, _nobody_waits) = oneshot::channel();
        Some(offered.control(robot.name.clone(), reply))
    }
}

impl fmt::Display for Swap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Swap { robot, part, fresh, flaw, terms, .. } = self;
        write!(f, "the {part} of robot {robot} is exchanged")?;
        for (key, value) in &self.edits {
            write!(f, ", {key} = {value}")?;
        }
        match flaw {
            None if *fresh => f.write_str(", by one with fresh state")?,
            None => {}
            Some(Flaw::Unusable) => f.write_str(", by an unusable one")?,
            Some(Flaw::Fails) => f.write_str(", by one that breaks")?,
        }
        let [shadow, probation] = [terms.shadow, terms.probation].map(|t| t.as_secs_f64());
        write!(f, "; it observes for {shadow:.3} s, and is on probation for {probation:.3} s")
    }
}

fn flawed(maker: Maker, flaw: Flaw) -> Maker {
    Maker(Arc::new(move || match flaw {
        Flaw::Unusable => Err("planted".into()),
        Flaw::Fails => Ok(Box::new(PanickingAgent((maker.0)()?))),
    }))
}

/// An agent that panics when its next intent is requested.
struct PanickingAgent(Box<dyn Agent>);

impl Agent for PanickingAgent {
    fn next(&mut self, _last: Option<MotionEnd>, _view: &View) -> Intent {
        // unwinds like any panic, but prints nothing
        std::panic::resume_unwind(Box::new("planted"))
    }
    fn notes(&mut self) -> Vec<Note> {
        self.0.notes()
    }
    fn export(&self) -> Snapshot {
        self.0.export()
    }
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.0.import(from)
    }
}

fn driver(board: &SimHardware, flaw: Option<Flaw>) -> Arc<dyn Hardware> {
    let board = board.clone();
    match flaw {
        None => Arc::new(board),
        Some(flaw) => Arc::new(SilentHardware { board, is_silent: AtomicBool::new(flaw == Flaw::Unusable) }),
    }
}

/// Hardware that gives no readings: from the first connection on, or from the second, which is made at the takeover.
struct SilentHardware {
    board: SimHardware,
    is_silent: AtomicBool,
}

impl Hardware for SilentHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        let driver = self.board.connect()?;
        let is_silent = self.is_silent.swap(true, Ordering::SeqCst);
        Ok(Box::new(SilentDriver { driver, is_silent }))
    }
}

struct SilentDriver {
    driver: Box<dyn Driver>,
    is_silent: bool,
}

impl Driver for SilentDriver {
    fn board(&self) -> &Board {
        self.driver.board()
    }
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        self.driver.command(now, command)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        Ok(self.driver.sample(now)?.filter(|_| !self.is_silent))
    }
    fn next_sample(&self, now: Time) -> Time {
        self.driver.next_sample(now)
    }
    fn lease(&mut self, now: Time, until: Time) {
        self.driver.lease(now, until);
    }
    fn modes(&self) -> Vec<ControlMode> {
        self.driver.modes()
    }
}
