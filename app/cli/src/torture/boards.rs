//! The boards of a robot under torture: simulated ones with direct access, or behind YARP over a simulated wire.

use super::faults::FaultAction;
use super::plan::Planned;
use mobee_compose::config::{Config, ConfigError, RobotConfig, Source, simulated};
use mobee_compose::derive_seed;
use mobee_contract::{Context, Hardware, KindError, Time};
use mobee_driver_yarp::{YARP, YarpDriverSettings, YarpSim};
use mobee_sim::{ArmProfile, DoneRule, SIM, SimHardware, SimSettings, StopRule};
use serde_json::{Value, json};
use std::sync::Arc;

/// The driver of a robot under torture.
#[derive(Clone, Debug)]
pub enum Driven {
    /// A simulated robot.
    Sim(SimSettings),
    /// The driver of robots behind YARP.
    Yarp(YarpDriverSettings),
}

impl Driven {
    /// Chooses the driver of each robot: robots of kind `yarp` retain their driver, all others are simulated.
    /// Afterwards the configuration has simulated robots only.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn all(config: &mut Config, source: &Source) -> Result<Vec<Driven>, ConfigError> {
        config.robot.iter_mut().enumerate().map(|(i, robot)| Driven::of(i, robot, source)).collect()
    }

    /// The robots whose driver is replaced by the simulated one, each with the kind of its own driver.
    pub fn replaced(config: &Config) -> Vec<(String, String)> {
        let kind =
            |robot: &RobotConfig| robot.driver.get("kind").and_then(Value::as_str).unwrap_or_default().to_owned();
        let robots = config.robot.iter().map(|robot| (robot.name.clone(), kind(robot)));
        robots.filter(|(_, kind)| ![SIM, YARP].contains(&kind.as_str())).collect()
    }

    fn of(i: usize, robot: &mut RobotConfig, source: &Source) -> Result<Driven, ConfigError> {
        let wrong = |e: KindError| source.error(&format!("robot[{i}].driver.{}", e.path), e.what, e.help);
        let mut settings = robot.driver.clone();
        let kind = settings.as_object_mut().and_then(|map| map.remove("kind"));
        let kind = kind.as_ref().and_then(Value::as_str).unwrap_or_default();
        if kind == YARP {
            let yarp: YarpDriverSettings = mobee_contract::settings(&settings).map_err(wrong)?;
            yarp.validate().map_err(wrong)?;
            let speed = yarp.max_speed_deg_per_s;
            let acceleration = yarp.max_acceleration_deg_per_s2;
            robot.driver = json!({ "kind": SIM, "profile": "ideal", "max_speed_deg_per_s": speed, "max_acceleration_deg_per_s2": acceleration });
            return Ok(Driven::Yarp(yarp));
        }
        if kind != SIM {
            robot.driver = simulated();
            return Ok(Driven::Sim(SimSettings::ideal()));
        }
        Ok(Driven::Sim(mobee_contract::settings(&settings).map_err(wrong)?))
    }

    /// Number of boards behind wires.
    pub fn wires(&self) -> usize {
        match self {
            Driven::Sim(_) => 0,
            Driven::Yarp(settings) => settings.parts.len(),
        }
    }

    /// The hardware for a run.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn boards(&self, context: &Context) -> Result<Boards, KindError> {
        Ok(match self {
            Driven::Sim(settings) => Boards::Sim(SimHardware::new(&drawn(settings, context.seed), context)?),
            Driven::Yarp(settings) => Boards::Yarp(Arc::new(YarpSim::new(settings, context)?)),
        })
    }
}

/// The settings of a simulated robot in the run of this seed. Real boards with servos differ in what a stop holds, when
/// a move is done, and whether they honor accelerations: what the file leaves open is drawn.
fn drawn(settings: &SimSettings, seed: u64) -> SimSettings {
    let mut settings = settings.clone();
    if settings.profile == Some(ArmProfile::Ideal) || settings.imitates.is_some() {
        return settings;
    }
    let mut servo = settings.servo.take().unwrap_or_default();
    let bit = |k: u32| derive_seed(seed, "board") >> k & 1 == 1;
    servo.stop.get_or_insert(if bit(0) { StopRule::Measured } else { StopRule::Commanded });
    servo.done.get_or_insert(if bit(1) { DoneRule::Arrived } else { DoneRule::Trajectory });
    servo.honors_acceleration.get_or_insert(bit(2));
    settings.servo = Some(servo);
    settings
}

/// The boards of one robot in one run.
pub enum Boards {
    /// With direct access.
    Sim(SimHardware),
    /// Behind wires.
    Yarp(Arc<YarpSim>),
}

impl Boards {
    /// The robot's hardware.
    pub fn hardware(&self) -> Arc<dyn Hardware> {
        match self {
            Boards::Sim(hardware) => Arc::new(hardware.clone()),
            Boards::Yarp(hardware) => hardware.clone(),
        }
    }

    /// The simulated hardware to which drivers can be swapped during the run; `None` behind wires.
    pub fn simulated(&self) -> Option<&SimHardware> {
        if let Boards::Sim(hardware) = self { Some(hardware) } else { None }
    }

    /// Plans a fault if it is one of a board or a wire of this robot.
    pub fn plan_fault(&self, this: usize, Planned { at, what }: &Planned) {
        match (what, self) {
            (FaultAction::Board { robot, fault, lasts, .. }, Boards::Sim(hardware)) if *robot == this => {
                hardware.faults().plan(fault.clone(), *at, *at + *lasts);
            }
            (FaultAction::Board { robot, fault, lasts, .. }, Boards::Yarp(hardware)) if *robot == this => {
                hardware.plan_hardware(fault, *at, *at + *lasts);
            }
            (FaultAction::Wire { robot, board, fault, lasts }, Boards::Yarp(hardware)) if *robot == this => {
                hardware.plan(*board, *fault, *at, *at + *lasts);
            }
            _ => {}
        }
    }

    /// True speed of the fastest motor that can be stopped, rad/s.
    pub fn fastest(&self, at: Time) -> f64 {
        let speeds = match self {
            Boards::Sim(hardware) => hardware.speeds(at),
            Boards::Yarp(hardware) => hardware.speeds(at),
        };
        speeds.into_iter().map(f64::abs).fold(0.0, f64::max)
    }

    /// Violations of I30 by its driver, as sentences.
    pub fn found(&self) -> Vec<String> {
        match self {
            Boards::Sim(_) => Vec::new(),
            Boards::Yarp(hardware) => hardware.found(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::torture::report::Tally;
    use mobee_sim::ServoSettings;
    use std::path::Path;

    #[test]
    fn a_driver_that_torture_does_not_test_is_named_in_the_report() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/behaviors/collide.toml");
        let other = "robot.left.driver={kind=\"replay\", file=\"poses.csv\"}".to_owned();
        let (config, _) = Config::load(&file, &[other]).unwrap();
        let replaced = Driven::replaced(&config);
        assert_eq!(replaced, [("left".to_owned(), "replay".to_owned())], "and not the simulated one");
        let report = Tally { replaced, ..Tally::default() }.to_string();
        assert!(report.contains("left was simulated: its driver `replay` was not tested"), "{report}");
    }

    #[test]
    fn boards_with_servos_are_drawn_by_the_seed_and_keep_what_the_file_states() {
        let of = |profile, seed| drawn(&SimSettings { profile, ..SimSettings::default() }, seed).servo;
        assert!((0..20).all(|seed| of(Some(ArmProfile::Ideal), seed).is_none()));
        let stops: Vec<_> = (0..20).filter_map(|seed| of(Some(ArmProfile::So101), seed)?.stop).collect();
        assert!(stops.len() == 20 && stops.contains(&StopRule::Measured) && stops.contains(&StopRule::Commanded));
        let servo = ServoSettings { stop: Some(StopRule::Commanded), ..ServoSettings::default() };
        let stated = SimSettings { profile: Some(ArmProfile::So101), servo: Some(servo), ..SimSettings::default() };
        let stop = |seed| drawn(&stated, seed).servo.and_then(|servo| servo.stop);
        assert!((0..20).all(|seed| stop(seed) == Some(StopRule::Commanded)));
    }
}
