//! The driver in the behavior of a new robot: a similar simulated arm, by our physics or MuJoCo's, or its boards behind
//! YARP.

use super::{EXPLORE_SPEED, PERIOD_MS};
use mobee_compose::clearance_needed;
use mobee_contract::Axis;
use mobee_controller::look_ahead::braking_clearance;
use mobee_model::Robot;
use mobee_sim::{ArmProfile, SimSettings};
use std::time::Duration;

/// The kinds of drivers that `mobee new --driver` writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum NewDriver {
    /// A simulated robot.
    #[default]
    Sim,
    /// Control boards behind YARP.
    Yarp,
    /// A simulated robot that MuJoCo moves.
    Mujoco,
}

/// The driver's parts of a behavior file.
pub(super) struct DriverText {
    /// Settings of the run, one per line.
    pub top: String,
    /// Settings of the controller that depend on the arm.
    pub controller: String,
    /// The driver's table, with comments.
    pub table: String,
    /// The line for the terminal.
    pub note: String,
}

/// The driver of a robot named `name` in the behavior, with the file name `model` and this margin.
pub(super) fn text(driver: NewDriver, robot: &Robot, (name, model): (&str, &str), margin_mm: f64) -> DriverText {
    let profile = ArmProfile::of_robot([robot.name.as_str(), model]);
    let [word, controller, like] = match profile {
        // hobby servos lag by degrees: a greater lag is a stall
        ArmProfile::So101 => ["so101", ", stall_deg = 8", "an SO-101"],
        ArmProfile::Panda => ["panda", "", "a Panda"],
        ArmProfile::Ur5 => ["ur5", "", "a UR5"],
        ArmProfile::Icub => ["icub", "", "an iCub"],
        ArmProfile::Arm | ArmProfile::Ideal => ["arm", "", "an arm of no particular make"],
    };
    let settings = SimSettings { profile: Some(profile), ..SimSettings::default() };
    let reaction = settings.latency() + Duration::from_millis(PERIOD_MS) * 2;
    let (reserve, remark) = reserve(robot, &settings.axes(robot), reaction, margin_mm, EXPLORE_SPEED);
    let controller = reserve + controller;
    match driver {
        NewDriver::Sim => DriverText {
            top: String::new(),
            controller,
            table: remark
                + &format!(
                    "driver = {{ kind = \"sim\", profile = \"{word}\" }} # simulated as {like}; kinematic joints: profile = \"ideal\"\n"
                ),
            note: format!("  driver: simulated as {like} (profile `{word}`)\n"),
        },
        NewDriver::Mujoco => DriverText {
            top: String::new(),
            controller,
            table: remark + &mujoco(word),
            note: format!(
                "  driver: simulated as {like} (profile `{word}`) by MuJoCo; the program needs the feature `mujoco`, which this one {}\n",
                if cfg!(feature = "mujoco") { "has" } else { "lacks: cargo build --release --features mujoco" }
            ),
        },
        NewDriver::Yarp => yarp(robot, name),
    }
}

/// The braking clearance of an arm that explores at this share of its full speed, as a setting of its controller and a comment. The
/// default is that of full speed, and grows with the speed: the reflex then tracks pairs that are far apart, at many times the processor
/// time. Empty if the margin is too small for it. `reaction` is the time from a reading to the effect of a command.
pub(super) fn reserve(
    robot: &Robot,
    axes: &[Axis],
    reaction: Duration,
    margin_mm: f64,
    explores: f64,
) -> (String, String) {
    let needed = |speed: f64| clearance_needed(robot, axes, reaction, speed) * 1e3;
    let usual = braking_clearance(robot, axes, reaction, margin_mm * 1e-3) * 1e3;
    let exact = usual.max(needed(explores));
    if exact > margin_mm + 1e-6 {
        return (String::new(), String::new());
    }
    let mm = ((exact * 10.0).ceil() / 10.0).min(margin_mm);
    let fast = (1..=20_u8).map(|n| f64::from(n) / 20.0).take_while(|speed| needed(*speed) <= mm).last();
    let remark = match fast {
        Some(1.0) => String::new(),
        fast => format!(
            "# `reserve_mm` is the braking clearance up to speed = {}. Without it, it grows with the speed, at many times the processor time.\n",
            fast.unwrap_or(explores)
        ),
    };
    (format!(", reserve_mm = {mm}"), remark)
}

fn mujoco(profile: &str) -> String {
    let table = format!("driver = {{ kind = \"sim\", profile = \"{profile}\", physics = \"mujoco\"");
    format!(
        "# The program needs the feature `mujoco`: docs/simulation.md.\n{table} }}\n\
         # The same beside an obstacle that only the physics has, and the model does not:\n\
         # {table}, unknown = [{{ name = \"post\", size_m = [0.06, 0.06, 0.6], at_m = [0.5, 0.1, 0.3] }}] }}\n"
    )
}

fn yarp(robot: &Robot, name: &str) -> DriverText {
    // names of URDFs may have any characters
    let quoted = |text: String| toml::Value::String(text).to_string();
    let part = |p: &mobee_model::Part| {
        format!("{{ part = {}, port = {} }}", quoted(p.name.clone()), quoted(format!("/{name}Sim/{}", p.name)))
    };
    let parts: Vec<String> = robot.parts.iter().filter(|p| !p.motors.is_empty()).map(part).collect();
    DriverText {
        top: "clock = \"real\"\n".into(),
        controller: String::new(),
        table: format!(
            "# The ports of the robot's own boards, or, as here, of those that `mobee sim FILE` serves.\n\
             driver = {{ kind = \"yarp\", parts = [{}] }}\n",
            parts.join(", ")
        ),
        note: "  driver: control boards behind YARP; give their ports in the file\n".into(),
    }
}
