//! `mobee new --arm`: a behavior for an arm of servos on a bus.

use super::driver::reserve;
use super::{MARGIN_MM, files_text};
use crate::arms::KnownArm;
use crate::doctor::included;
use crate::new::{SCHEMA, file_stem, save_new};
use crate::terminal::shell_word;
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_contract::{Axis, KindError};
use mobee_feetech::{BusMotorSettings, FEETECH, FeetechSettings};
use mobee_model::Robot;
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

/// Control period of the written behavior.
const PERIOD: Duration = Duration::from_millis(10);
/// Age at which a reading is stale.
const STALE: Duration = Duration::from_millis(200);
/// Share of the maximum speeds with which it explores: 12 deg/s.
const SPEED: f64 = 0.2;
/// The middle of a range that no calibration states, counts, as LeRobot homes an arm.
const MIDDLE_COUNT: f64 = 2047.0;
/// Counts per degree, as LeRobot counts.
const COUNTS_PER_DEG: f64 = 4095.0 / 360.0;
/// Distance of the rest pose from the ends of the ranges, deg.
const REST_ROOM_DEG: f64 = 2.0;

/// Writes the arm's model, a world with a table and a behavior that explores; returns a summary of the decisions.
///
/// # Errors
/// If the calibration does not fit the arm, or a file would be overwritten. Nothing is written then.
pub(super) fn command(name: &str, arm: &KnownArm, port: &str, calibration: Option<&Path>) -> Result<String, Report> {
    let (dir, stem) = file_stem(name)?;
    let behavior = dir.join(format!("{stem}.toml"));
    let robot = arm.robot()?;
    let settings = FeetechSettings {
        calibration: calibration.map(Path::to_owned),
        motors: motors(arm, &robot, calibration.is_some()),
        ..FeetechSettings::at(port)
    };
    let unusable = |e: KindError| ConfigError::plain(e.what, e.help);
    settings.validate().map_err(unusable)?;
    let axes = settings.joints(&robot).and_then(|joints| settings.axes(&robot, &joints)).map_err(unusable)?;
    let filed = calibration.map(|file| included(file, &behavior)).transpose()?;
    let text = behavior_text(arm, &stem, &robot, &settings, (&axes, filed.as_deref()));
    let files = vec![
        (behavior.clone(), text),
        (dir.join(arm.model.0), arm.model.1.to_owned()),
        (dir.join(format!("{stem}-world.xml")), WORLD.to_owned()),
        (dir.join(SCHEMA), mobee_compose::schema::text()),
    ];
    let mut out = files_text(&save_new(files)?);
    if calibration.is_none() {
        let (port, json) = (shell_word(Path::new(port)), shell_word(&dir.join(format!("{stem}.json"))));
        let _ = writeln!(
            out,
            "no calibration: the file takes {MIDDLE_COUNT} for the count of each joint's middle, which is right only for an arm that was \
             homed so. Calibrate it, then write the behavior again:\n  \
             mobee calibrate --port {port} --out {json}\n  mobee new NAME --arm {} --port {port} --calibration {json}",
            arm.name
        );
    }
    let file = shell_word(&behavior);
    Ok(out
        + &format!("now: mobee doctor {file}, which reads the arm and moves nothing; then mobee run {file} --for 60\n"))
}

/// The settings of the motors: with a calibration only the offsets, without one all of them.
fn motors(arm: &KnownArm, robot: &Robot, is_calibrated: bool) -> Vec<BusMotorSettings> {
    let each = robot.motors.iter().zip(1..).filter_map(|(motor, id)| {
        let offset_deg = arm.middle_deg(&motor.name);
        let plain = BusMotorSettings { joint: motor.name.clone(), offset_deg, ..BusMotorSettings::default() };
        if is_calibrated {
            return (offset_deg != 0.0).then_some(plain);
        }
        let [low, high] = [motor.min, motor.max].map(f64::to_degrees);
        let half = (offset_deg - low).min(high - offset_deg) * COUNTS_PER_DEG;
        let range = [MIDDLE_COUNT - half.floor(), MIDDLE_COUNT + half.floor()].map(|count| count as i32);
        Some(BusMotorSettings { id: Some(id), range: Some(range), ..plain })
    });
    each.collect()
}

/// A world with the table that the arm is mounted on.
const WORLD: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<!-- What the arm could touch but itself. Meters, in the frame of its base: x forward, y to its left, z up from the table. -->
<WorldList version="1.0">
  <object name="table" type="obstacle" persistent="1" px="0.2" pz="-0.01"><box width="1.2" height="1.2" depth="0.02"/></object>
</WorldList>
"#;

fn behavior_text(
    arm: &KnownArm,
    stem: &str,
    robot: &Robot,
    settings: &FeetechSettings,
    (axes, filed): (&[Axis], Option<&str>),
) -> String {
    // quote as TOML requires
    let text = |s: &str| toml::Value::String(s.to_owned()).to_string();
    let KnownArm { name, model: (model, _), .. } = arm;
    let (reserve, remark) = reserve(robot, axes, settings.latency() + PERIOD * 2, MARGIN_MM, SPEED);
    let rest = rest_pose(arm, robot, axes);
    let rest_deg: Vec<String> = rest.iter().map(|(_, deg)| deg.to_string()).collect();
    let by_name: Vec<String> = rest.iter().map(|(motor, deg)| format!("{motor} = {deg}")).collect();
    let explored: Vec<String> = arm.explored.iter().map(|motor| text(motor)).collect();
    let calibration = match filed {
        Some(file) => format!("calibration = {}\n", text(file)),
        None => "# NOT CALIBRATED: nominal ranges about the count that homing leaves at the middle (docs/feetech.md)\n"
            .into(),
    };
    format!(
        r#"#:schema ./{SCHEMA}
# An arm of servos ({name}) builds a roadmap: random configurations of the motors below, each joined to its nearest. A path is
# certified in the model before it is driven (validation = "lazy"), and the first motions are slow.
#
#   mobee check {stem}.toml             reads files
#   mobee doctor {stem}.toml            reads the arm as well, and moves nothing
#   mobee run {stem}.toml --for 60      hold the arm off the table: servos get torque where they are
#
# A research safety layer, not a certified one: keep the switch of the arm's power supply within reach.

seed = 1
clock = "real"
world.file = "{stem}-world.xml"

[[robot]]
name = "{name}"
model = {model}
{remark}# hobby servos lag by degrees: a greater lag is a stall. A busy machine may pause for longer than five periods, the default of stale_ms:
# the arm moves by no more than {blind_deg} deg meanwhile.
controller = {{ period_ms = {period}, history = 6000, stall_deg = 8, stale_ms = {stale}{reserve} }} # the history holds a minute of poses
# folded; where the arm goes when the run ends. Its servos then hold it there.
rest = {{ q_deg = {{ {by_name} }} }}

[robot.driver]
kind = "{FEETECH}"
port = {port}
{calibration}motors = [
{motors}]
# To release the torque at the rest pose, once you have seen that the arm lies there without power:
# release_torque = true
# rest_deg = [{rest_deg}]

[robot.agent]
kind = "explorer"
motors = [{explored}]
vertices = 20
neighbors = 10
speed = {SPEED}
validation = "lazy"
"#,
        model = text(model),
        period = PERIOD.as_millis(),
        stale = STALE.as_millis(),
        blind_deg = (SPEED * settings.max_speed_deg_per_s * STALE.as_secs_f64()).ceil(),
        by_name = by_name.join(", "),
        port = text(&settings.port),
        motors = settings.motors.iter().map(motor_text).collect::<String>(),
        rest_deg = rest_deg.join(", "),
        explored = explored.join(", "),
    )
}

fn motor_text(motor: &BusMotorSettings) -> String {
    let mut line = format!("    {{ joint = {}", toml::Value::String(motor.joint.clone()));
    if let (Some(id), Some([min, max])) = (motor.id, motor.range) {
        let _ = write!(line, ", id = {id}, range = [{min}, {max}]");
    }
    if motor.offset_deg != 0.0 {
        let _ = write!(line, ", offset_deg = {}", motor.offset_deg);
    }
    line + " },\n"
}

/// The rest pose, whole degrees of each motor, within the ranges of this arm.
fn rest_pose<'a>(arm: &KnownArm, robot: &'a Robot, axes: &[Axis]) -> Vec<(&'a str, f64)> {
    let each = robot.motors.iter().zip(axes).map(|(motor, axis)| {
        let (least, most) = (axis.min.to_degrees() + REST_ROOM_DEG, axis.max.to_degrees() - REST_ROOM_DEG);
        (motor.name.as_str(), arm.rest_of(&motor.name).min(most.floor()).max(least.ceil()))
    });
    each.collect()
}
