//! Interprets the figures of a motor: findings, and settings to copy into the file.

use super::Finding;
use super::measures::{Figures, StopEnd, StopFigures};
use super::moves::MOVES;
use mobee_compose::config::RobotConfig;
use mobee_contract::{Axis, Paces};
use mobee_driver_yarp::{Moves, YARP, YarpDriverSettings};
use std::path::Path;

/// Sag below which no setting is suggested, deg.
const MIN_SAG_DEG: f64 = 0.1;
/// Resolution below which no setting is suggested, deg.
const FINE_RESOLUTION_DEG: f64 = 0.02;
/// Factor between the sag or torque that was seen and that at other poses, where the load may be greater.
const POSE_FACTOR: f64 = 2.0;
/// Maximum deviation of a single reading in standard deviations of the noise.
const NOISE_SIGMAS: f64 = 4.0;
/// Step of settings in degrees and N m.
const SETTING_STEP: f64 = 0.5;
/// Ratio of the driver's to the measured resolution above which they count as equal: both are measured.
const EQUAL_RATIO: f64 = 0.7;
/// Time for which the controller waits for a joint to settle after *done*, s.
const SETTLE_S: f64 = 1.0;
/// Ratios of measured and commanded speed of a board that honors reference speeds.
const HONORED_RATIOS: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// The inputs of a verdict.
pub(super) struct Measured<'a> {
    pub figures: &'a Figures,
    pub axis: &'a Axis,
    pub paces: &'a [Paces],
    pub robot: &'a RobotConfig,
    pub folder: &'a Path,
    /// Of the motors whose encoders are coarser than the driver's setting: the one with the greatest count, and that
    /// count.
    pub coarse: Option<(String, f64)>,
}

/// Settings that the file lacks, as lines of TOML with the reason for each.
#[derive(Default)]
pub(super) struct Settings {
    /// The robot's name.
    robot: String,
    driver: Vec<String>,
    controller: Vec<String>,
}

/// One finding per measure, and the settings to write into the file; empty if it needs none.
pub(super) fn verdict(measured: &Measured) -> (Vec<Finding>, Settings) {
    let mut settings = Settings { robot: measured.robot.name.clone(), ..Settings::default() };
    let findings = [
        resolution(measured, &mut settings),
        sag(measured, &mut settings),
        lag(measured),
        done(measured),
        stop(measured),
        speeds(measured, &mut settings),
        accelerations(measured),
        torque(measured, &mut settings),
    ];
    stall(measured, &mut settings);
    (findings.into_iter().flatten().collect(), settings)
}

impl Settings {
    pub(super) fn is_empty(&self) -> bool {
        self.driver.is_empty() && self.controller.is_empty()
    }

    /// The settings as text for a user to copy.
    pub(super) fn toml(&self) -> String {
        let table = |name: &str, lines: &[String]| match lines {
            [] => String::new(),
            lines => format!("# in the table `{name}` of robot {}\n{}\n", self.robot, lines.join("\n")),
        };
        table("driver", &self.driver) + &table("controller", &self.controller)
    }

    /// A configuration that includes the measured one and adds these settings.
    pub(super) fn layer(&self, included: &str, motor: &str) -> String {
        let text = |s: &str| toml::Value::String(s.into()).to_string();
        let table = |name: &str, lines: &[String]| match lines {
            [] => String::new(),
            lines => format!("\n[robot.{name}]\n{}\n", lines.join("\n")),
        };
        let head = format!("# As `mobee doctor --move {motor}` measured.\ninclude = [{}]\n", text(included));
        let robot = format!("\n[[robot]]\nname = {}\n", text(&self.robot));
        head + &robot + &table("driver", &self.driver) + &table("controller", &self.controller)
    }
}

impl Measured<'_> {
    fn unit(&self) -> &'static str {
        self.axis.motion.unit()
    }

    /// The settings of the driver, if it is of the kind `yarp`.
    fn yarp(&self) -> Option<YarpDriverSettings> {
        let mut settings = self.robot.driver.as_object()?.clone();
        let kind = settings.remove("kind")?;
        (kind == YARP).then(|| mobee_contract::settings(&settings.into()).ok()).flatten()
    }

    fn sag(&self) -> f64 {
        self.figures.sags.iter().fold(0.0, |most, sag| most.max(sag.abs()))
    }
}

/// Rounds up to the next step.
fn up(x: f64) -> f64 {
    ((x / SETTING_STEP).ceil() * SETTING_STEP).max(SETTING_STEP)
}

fn resolution(m: &Measured, settings: &mut Settings) -> Option<Finding> {
    let name = &m.axis.name;
    let unit = m.unit();
    let count = m.figures.count;
    let noise = m.figures.noise;
    let counts = if count > 0.0 { format!("counts in steps of {count:.4} {unit}") } else { "shows no steps".into() };
    let what = format!("the encoder of {name} {counts}, with noise of {noise:.4} {unit} at rest");
    let off = count.max(NOISE_SIGMAS * noise);
    let stated = m.axis.resolution.to_degrees();
    let is_finer = off > FINE_RESOLUTION_DEG && stated < EQUAL_RATIO * off;
    let coarse = m.coarse.as_ref().filter(|(_, count)| *count > FINE_RESOLUTION_DEG);
    if !is_finer && coarse.is_none() || m.yarp().is_none() {
        return Some(Finding::ok(what));
    }
    let (taken, least) = match coarse {
        Some((other, count)) => {
            (format!("{other} counts in steps of {count:.4}, which the driver takes for finer"), *count)
        }
        None => (format!("the driver takes it for {stated:.4} {unit}"), 0.0),
    };
    settings.driver.push(format!("resolution_deg = {:.4}", off.max(least)));
    Some(Finding::warn(what, format!("{taken}, so that it may not know a rest: state resolution_deg")))
}

fn sag(m: &Measured, settings: &mut Settings) -> Option<Finding> {
    let name = &m.axis.name;
    let unit = m.unit();
    let most = m.sag();
    let sags = &m.figures.sags;
    if sags.is_empty() {
        let remedy = format!("see why in {}: it did not come to rest after any move", m.folder.display());
        return Some(Finding::warn(format!("how {name} rests was not measured"), remedy));
    }
    let what = format!("{name} rests up to {most:.2} {unit} from its commanded position, in {} rests", sags.len());
    let stated = m.axis.hold_error.to_degrees();
    if most <= MIN_SAG_DEG.max(1.5 * m.figures.count) || stated >= most {
        return Some(Finding::ok(what));
    }
    let yarp = m.yarp().filter(|_| m.axis.motion.is_turn());
    let remedy = match yarp {
        Some(_) => {
            settings.driver.push(format!("hold_error_deg = {:.1}    # twice what was seen", up(POSE_FACTOR * most)));
            format!(
                "the driver expects {stated:.2} {unit}: state hold_error_deg, and the controller learns the difference per joint"
            )
        }
        None => "keep the controller's tolerance_deg above that".to_owned(),
    };
    Some(Finding::warn(what, remedy))
}

fn lag(m: &Measured) -> Option<Finding> {
    let name = &m.axis.name;
    let unit = m.unit();
    let early = m.figures.done.iter().fold(0.0_f64, |most, (by, _)| most.max(*by));
    Some(match m.figures.lag {
        Some((lag, speed)) => {
            let ms = lag * 1e3;
            let behind = lag * speed;
            Finding::ok(format!(
                "{name} is {ms:.0} ms behind its set-points, {behind:.2} {unit} at {speed:.1} {unit}/s"
            ))
        }
        None if early > 0.0 => Finding::ok(format!(
            "{name} is about {:.0} ms behind its commanded path, if *done* means the end of that",
            early * 1e3
        )),
        None => {
            let remedy = "lag shows in set-points, which its board does not take or which ended early";
            Finding::warn(format!("how far {name} lags was not measured"), remedy)
        }
    })
}

fn done(m: &Measured) -> Option<Finding> {
    let name = &m.axis.name;
    let unit = m.unit();
    let tolerance = m.robot.controller.tolerance_deg;
    let worst = m.figures.done.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((early, off)) = worst else {
        let what = format!("when *done* is reported for {name} was not measured");
        return Some(Finding::warn(what, format!("see why in {}", m.folder.display())));
    };
    if off <= tolerance.max(2.0 * m.figures.count) {
        let after = m.figures.done.iter().fold(0.0_f64, |most, (by, _)| most.max(-by));
        return Some(Finding::ok(format!("*done* is reported once {name} has arrived, up to {after:.2} s after")));
    }
    let what = format!(
        "*done* is reported {early:.2} s before {name} has arrived, {off:.2} {unit} from where it comes to rest"
    );
    Some(if early < SETTLE_S {
        Finding::ok(format!("{what}; the controller waits for that"))
    } else {
        Finding::warn(
            what,
            "the controller waits for a second, and then judges the target as missed: move at lower speeds",
        )
    })
}

fn stop(m: &Measured) -> Option<Finding> {
    let name = &m.axis.name;
    let unit = m.unit();
    let Some(StopFigures { speed, on, took, drift, end }) = m.figures.stop else {
        let what = format!("what a stop does to {name} was not measured");
        return Some(Finding::warn(
            what,
            format!("see why in {}: it was not stopped in mid-motion", m.folder.display()),
        ));
    };
    let stopped = format!("{name}, stopped at {speed:.1} {unit}/s,");
    let took = took.map_or("did not come to rest".to_owned(), |took| format!("came to rest within {took:.2} s"));
    let way = if on < 0.0 { format!("{:.2} {unit} back", -on) } else { format!("{on:.2} {unit} further on") };
    Some(match end {
        StopEnd::Stays => {
            Finding::ok(format!("{stopped} {took}, {way}, and stays there ({drift:+.2} {unit} in the next second)"))
        }
        StopEnd::RunsOn => Finding::bad(
            format!("{stopped} ran on to its target, {way}: a stop has no effect"),
            "find out which stop the board carries out; until then nothing but a hardware stop ends a move",
        ),
        StopEnd::Sinks => Finding::bad(
            format!("{stopped} {took}, {way}, and moves on by {drift:+.2} {unit} in the next second"),
            "let the board compensate the weight, or hold the commanded position at a stop",
        ),
    })
}

fn speeds(m: &Measured, settings: &mut Settings) -> Option<Finding> {
    let name = &m.axis.name;
    let seen = &m.figures.speeds;
    let of_board = m.paces.iter().find(|paces| !paces.fair || paces.seen.len() > MOVES);
    let (seen, fair, board) = match of_board {
        Some(paces) => (&paces.seen, paces.fair, paces.board.as_str()),
        // a simulation counts no stretches, and a driver may have counted too few
        None if !seen.is_empty() && m.yarp().is_none_or(|yarp| yarp.moves == Moves::Position) => {
            (seen, seen.iter().all(|ratio| HONORED_RATIOS.contains(ratio)), "its board")
        }
        None => {
            let what = format!("the speed of {name} against its commands could not be measured");
            let why =
                "the moves did not arrive, were made of set-points or no board's, or are too quick for its states";
            return Some(Finding::bad(what, format!("see why in {}: {why}", m.folder.display())));
        }
    };
    let (least, most) = seen.iter().fold((f64::INFINITY, 0.0f64), |(least, most), v| (least.min(*v), most.max(*v)));
    let what =
        format!("{name} moved at {least:.2} to {most:.2} times the commanded speeds, in {} stretches", seen.len());
    if fair {
        return Some(Finding::ok(format!("{what}: {board} honors reference speeds")));
    }
    let remedy = match m.yarp().map(|yarp| yarp.moves) {
        Some(Moves::Position) => {
            settings.driver.push("moves = \"set-points\"".into());
            "set moves = \"set-points\" in the driver's table"
        }
        _ => "nothing to set: see what its board makes of a reference speed",
    };
    Some(Finding::bad(format!("{what}: {board} does not honor reference speeds"), remedy))
}

fn accelerations(m: &Measured) -> Option<Finding> {
    let board = m.paces.iter().find(|paces| paces.own_acceleration || paces.seen.len() > MOVES)?;
    let board_name = &board.board;
    Some(if board.own_acceleration {
        Finding::warn(
            format!("{board_name} accepts reference accelerations and keeps its own"),
            "nothing to set: the driver no longer sends them; lower the board's own if its moves begin or end too hard",
        )
    } else {
        Finding::ok(format!("{board_name} has the reference accelerations that it is sent"))
    })
}

fn torque(m: &Measured, settings: &mut Settings) -> Option<Finding> {
    let (most, change) = m.figures.torque?;
    let name = &m.axis.name;
    let unit = m.axis.motion.effort_unit();
    let what =
        format!("its board reports up to {most:.2} {unit} on {name} in free motion, changing by {change:.2} {unit}");
    let rated = m.axis.contact_effort > 0.0 && m.axis.contact_effort < Axis::UNRATED;
    if rated || m.robot.controller.contact_nm.is_some() {
        return Some(Finding::ok(what));
    }
    let limit = up(POSE_FACTOR * change);
    settings
        .controller
        .push(format!("contact_nm = {limit:.1}    # twice what {name} shows in free motion; measure the others, too"));
    Some(Finding::warn(what, "state contact_nm for the controller to take greater changes for contacts"))
}

/// Suggests the least stall threshold that free motions don't reach.
fn stall(m: &Measured, settings: &mut Settings) {
    if m.figures.sags.is_empty() {
        return;
    }
    let behind = m.figures.lag.map_or(0.0, |(lag, speed)| lag * speed);
    let least = up(POSE_FACTOR * (behind + m.sag()).max(m.robot.controller.tolerance_deg));
    match m.robot.controller.stall_deg {
        Some(stated) if stated < least => {
            settings
                .controller
                .push(format!("stall_deg = {least:.1}    # twice its lag and sag; less stops free motions"));
        }
        Some(_) => {}
        None => settings.controller.push(format!("stall_deg = {least:.1}    # if stalls are to count as contacts")),
    }
}

#[cfg(test)]
mod tests;
