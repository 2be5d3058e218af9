//! `mobee plan`: a certified path of a robot from one pose to another among the objects of a world, without a configuration file.

use crate::roadmap::{Speeds, Trajectory, may_write, positive, share};
use crate::terminal;
use miette::{Report, miette};
use mobee_compose::config::ConfigError;
use mobee_compose::maps::{robot, save_text, scene};
use mobee_contract::KindError;
use mobee_model::{Robot, Scene};
use mobee_planning::group;
use mobee_planning::hand_goal::{HandGoal, HandGoals, ResolvedGoal};
use mobee_planning::pair_rules::{pair_rules, rule_error};
use mobee_planning::planners::{
    AoRrtConnect, JointPath, JointSpace, NoPath, Planner, PlannerKind, PlanningProblem, shorten,
};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

mod record;

use record::RecordedPath;

/// From where to where, and among what.
#[derive(clap::Args, Clone, Debug)]
pub struct PlanArgs {
    /// Robot XML (`mobee model convert` makes one of a URDF).
    robot: PathBuf,
    /// World XML: objects to plan around.
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// Where the robot is: `home`, values of all motors of --motors in degrees (mm where a motor slides) such as 0,-45,0, or
    /// NAME=VALUE,NAME=VALUE with all others at home.
    #[arg(long, value_name = "Q", default_value = "home", allow_hyphen_values = true)]
    from: String,
    /// Where it is to go: as --from, but motors that NAME=VALUE does not name stay where they are. Repeat it for several
    /// goals, any of which will do.
    #[arg(long, value_name = "Q", allow_hyphen_values = true, required_unless_present = "to_hand")]
    to: Vec<String>,
    /// Instead: where its hand is to go, meters and degrees, in the world's frame; without roll, pitch and yaw in any orientation.
    #[arg(long, value_name = "X,Y,Z[,R,P,Y]", allow_hyphen_values = true, conflicts_with = "to")]
    to_hand: Option<String>,
    /// The marker that stands for the hand, if the robot has several.
    #[arg(long, value_name = "MARKER", requires = "to_hand")]
    hand: Option<String>,
    /// Parts and motors that move, separated by commas; default: all.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    motors: Vec<String>,
    /// Nearer than this to anything is not free.
    #[arg(long, value_name = "MM", default_value_t = 12.0, value_parser = crate::robot_import::millimeters(0.0, 1000.0))]
    clearance_mm: f64,
    /// A pair that may touch, such as the gripper and the object to be picked: names of links, parts, markers or objects.
    /// May be repeated.
    #[arg(long, value_name = "A:B")]
    may_touch: Vec<String>,
    /// A pair with a clearance of its own, lower than --clearance-mm. May be repeated.
    #[arg(long, value_name = "A:B=MM", value_parser = pair_clearance)]
    pair_clearance_mm: Vec<(String, f64)>,
    /// The seed of all randomness: equal questions have equal answers.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    planner: PlannerArgs,
    /// Processor time for the search.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = positive)]
    time: f64,
    /// Do not make the path shorter.
    #[arg(long)]
    raw: bool,
    /// Also write joint values with times as a table; `-`: standard output. The header names each motor with its unit.
    #[arg(long, value_name = "FILE|-")]
    csv: Option<PathBuf>,
    /// Also write them as JSON; `-`: standard output.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Also write a recording: the robot along the path, for the Rerun viewer.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Share of each motor's maximum speed. Between two way-points the motors move at constant speed and arrive together.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, value_parser = share)]
    speed: f64,
    /// Maximum speed of motors whose robot file states none, deg/s or mm/s.
    #[arg(long, value_name = "DEG_PER_S", default_value_t = 100.0, value_parser = positive)]
    max_speed: f64,
    /// Write joint values every so many seconds, and at the end, instead of at each way-point.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    every: Option<f64>,
    /// Replace the written files if they exist.
    #[arg(long)]
    force: bool,
}

/// The planner, for `mobee plan` and `mobee bench plan`.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct PlannerArgs {
    /// `rrt_connect`: the first path; `aorrtc`: shorter paths for more time.
    #[arg(long, value_name = "PLANNER", default_value = "rrt_connect", value_parser = str::parse::<PlannerKind>)]
    planner: PlannerKind,
    /// Random configurations that `aorrtc` spends after the first path; default: 2000. It ends earlier when --time is spent.
    #[arg(long, value_name = "N")]
    iterations: Option<u64>,
}

impl PlannerArgs {
    /// The planner.
    ///
    /// # Errors
    /// If iterations are given to a planner that has none.
    pub(crate) fn planner(&self) -> Result<Box<dyn Planner + Send>, ConfigError> {
        if self.iterations.is_some() && self.planner != PlannerKind::Aorrtc {
            let what = "--iterations is given, and `rrt_connect` stops at its first path";
            return Err(ConfigError::plain(what, "add --planner aorrtc, or leave --iterations out"));
        }
        Ok(self.planner.planner(self.iterations.unwrap_or(AoRrtConnect::default().iterations)))
    }
}

/// The most lines that are judged to make a path shorter.
const SHORTEN_LINES: u64 = 5000;

/// Plans, prints what was found, and writes it.
///
/// # Errors
/// If a file can't be read or written, or an argument fits neither robot nor world.
pub fn command(args: &PlanArgs) -> Result<ExitCode, Report> {
    let is_terminal = |file: &&Option<PathBuf>| file.as_deref() == Some(Path::new("-"));
    let to_terminal = [&args.csv, &args.json].iter().filter(|file| is_terminal(file)).count();
    if to_terminal > 1 || (args.csv.is_some() && args.csv == args.json) {
        let what = "a table and JSON can't be written to one place";
        return Err(ConfigError::plain(what, "name a file for one of --csv and --json").into());
    }
    if args.every.is_some() && args.csv.is_none() && args.json.is_none() {
        let what = "--every says how often joint values are written, and nothing writes them";
        return Err(ConfigError::plain(what, "add --csv FILE or --json FILE").into());
    }
    if let Some(record) = args.record.as_ref().filter(|file| {
        *file == Path::new("-") || [&args.csv, &args.json].into_iter().any(|other| other.as_ref() == Some(*file))
    }) {
        let what = format!("a recording can't be written to {}", record.display());
        return Err(ConfigError::plain(what, "name a file of its own by --record FILE.rrd").into());
    }
    let planner = args.planner.planner()?;
    let files = [&args.csv, &args.json].into_iter().flatten().filter(|file| *file != Path::new("-"));
    for file in files.chain(&args.record) {
        may_write(file, args.force)?;
    }
    let scene = ruled_scene(args)?;
    let robot = robot(&scene)?;
    let motors = match args.motors.as_slice() {
        [] => (0..robot.motors.len()).collect(),
        names => group::motors("--motors", names, robot).map_err(complaint)?,
    };
    let from = pose("--from", &args.from, robot, &motors, &robot.home())?;
    let to = goals(args, &scene, &motors, &from)?;
    let found = search(args, planner.as_ref(), &scene, &motors, (&from, &to))?;
    let (path, how) = match found {
        Ok(found) => found,
        Err(why) => {
            let text = match why {
                NoPath::Cancelled => format!(
                    "no path was found within {} s; there may be one: give more --time, or another --seed",
                    args.time
                ),
                why => format!("there is no path: {}", why.text(&scene, 0)),
            };
            // Nothing but data goes to a standard output that a program reads.
            if to_terminal > 0 {
                terminal::err(&text)
            } else {
                terminal::out(&(text + "\n"))
            }
            return Ok(ExitCode::FAILURE);
        }
    };
    let speeds = Speeds { share: args.speed, unstated_deg_per_s: args.max_speed };
    let mut trajectory = Trajectory::through(&path.poses, &motors, robot, speeds);
    if to_terminal == 0 {
        let time = format!("{:.2} s at {} of the maximum speeds\n", trajectory.duration_s(), args.speed);
        terminal::out(&(text(&path, robot, &motors) + &how + &time));
    }
    if let Some(every) = args.every {
        trajectory = trajectory.sampled(every)?;
    }
    for (file, table) in [(&args.csv, trajectory.csv()), (&args.json, trajectory.json())] {
        match file.as_deref() {
            Some(file) if file == Path::new("-") => terminal::out(&table),
            Some(file) => save_text(file, &table)?,
            None => {}
        }
    }
    if let Some(file) = &args.record {
        record::write(args, &scene, &RecordedPath::along(&from, &motors, &path), file)?;
        if to_terminal == 0 {
            terminal::out(&format!("now: mobee view {}\n", terminal::shell_word(file)));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The path, with the time of the search; or the reason for which there is none.
fn search(
    args: &PlanArgs,
    planner: &dyn Planner,
    scene: &Scene,
    motors: &[usize],
    (from, to): (&[f64], &[Vec<f64>]),
) -> Result<Result<(JointPath, String), NoPath>, Report> {
    let compiled = JointSpace::new(scene, 0, &[from], motors, &[], args.clearance_mm / 1e3);
    let mut space = compiled.map_err(|e| miette!("{e}"))?;
    let of = |pose: &[f64]| motors.iter().filter_map(|m| pose.get(*m).copied()).collect::<Vec<f64>>();
    let goals = to.iter().map(|to| of(to)).collect();
    let problem = PlanningProblem { start: of(from), goals, seed: args.seed, budget: u64::MAX };
    for (goal, why) in space.ends(&problem).map(|ends| ends.refused).unwrap_or_default() {
        terminal::err(&format!("goal {} of {} is left out: {}", goal + 1, to.len(), why.text(scene, 0)));
    }
    let begun = processor_s();
    let found = planner.plan(&mut space, &problem, &mut |_| {
        if processor_s() - begun > args.time { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    Ok(found.map(|path| {
        let searched = processor_s();
        let path = if args.raw { path } else { shorten(&mut space, path, args.seed, SHORTEN_LINES) };
        let [search, short] = [searched - begun, processor_s() - searched].map(|s| s * 1e3);
        let goal = if args.to.len() > 1 { format!("goal {} of {}\n", path.goal + 1, to.len()) } else { String::new() };
        let how = format!(
            "{goal}{} straight lines, certified free at {} mm; searched in {search:.2} ms, made shorter in {short:.2} ms, {} lines judged\n",
            path.poses.len().saturating_sub(1),
            args.clearance_mm,
            path.evaluations
        );
        (path, how)
    }))
}

/// A whole pose as arguments have it, rad of encoder.
fn pose(argument: &str, text: &str, robot: &Robot, motors: &[usize], others: &[f64]) -> Result<Vec<f64>, Report> {
    let mut pose = others.to_vec();
    if text == "home" {
        return Ok(robot.home());
    }
    let values: Vec<(usize, f64)> = if text.contains('=') {
        let mut table = BTreeMap::new();
        for part in text.split(',') {
            let number = part.split_once('=').and_then(|(name, value)| Some((name.trim(), value.trim().parse().ok()?)));
            let Some((name, value)) = number else {
                let help = "give NAME=VALUE,NAME=VALUE in degrees (mm where a motor slides)";
                return Err(ConfigError::plain(format!("{argument}: {part:?} is not NAME=VALUE"), help).into());
            };
            if table.insert(name.to_owned(), value).is_some() {
                return Err(ConfigError::plain(format!("{argument}: {name} is there twice"), "name it once").into());
            }
        }
        group::positions(argument, &table, robot).map_err(complaint)?
    } else {
        let numbers = numbers(argument, text)?;
        if numbers.len() != motors.len() {
            let names: Vec<&str> = motors.iter().filter_map(|m| Some(robot.motors.get(*m)?.name.as_str())).collect();
            let help = format!("give one for each of {}, or NAME=VALUE for some", names.join(", "));
            let what = format!("{argument} has {} numbers for {} motors", numbers.len(), motors.len());
            return Err(ConfigError::plain(what, help).into());
        }
        let each = motors.iter().zip(numbers);
        let each = each.map(|(m, deg)| Ok((*m, group::within_limits(argument, *m, deg, robot)?)));
        KindError::gather(each).map_err(complaint)?
    };
    for (m, q) in values {
        if let Some(slot) = pose.get_mut(m) {
            *slot = q;
        }
    }
    Ok(pose)
}

/// A pair with its clearance, as an argument has it.
fn pair_clearance(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(pair, mm)| Some((pair.to_owned(), mm.trim().parse().ok()?)));
    parts.ok_or_else(|| "give two names and a clearance in mm, such as finger_1:finger_2=1".to_owned())
}

/// The scene of the robot and the world, with the rules for pairs.
fn ruled_scene(args: &PlanArgs) -> Result<Scene, Report> {
    let scene = scene(&args.robot, args.world.as_deref())?;
    let mut clearances = BTreeMap::new();
    for (pair, mm) in &args.pair_clearance_mm {
        if clearances.insert(pair.clone(), *mm).is_some() {
            let what = format!("--pair-clearance-mm: {pair} is there twice");
            return Err(ConfigError::plain(what, "give one clearance").into());
        }
    }
    if let Some((pair, mm)) = clearances.iter().find(|(_, mm)| **mm > args.clearance_mm) {
        let what =
            format!("--pair-clearance-mm: {pair} has {mm} mm, more than the {} mm of all pairs", args.clearance_mm);
        return Err(ConfigError::plain(what, "give a lower clearance, or raise --clearance-mm").into());
    }
    let rules = pair_rules(&args.may_touch, &clearances).map_err(complaint)?;
    for rule in &rules {
        if !scene.tests_pair_of(0, rule).map_err(|e| complaint(rule_error(&e)))? {
            let [a, b] = &rule.names;
            terminal::err(&format!("no pair of {a} and {b} is tested, so a rule for them has no effect"));
        }
    }
    scene.with_pair_rules(0, &rules).map_err(|e| complaint(rule_error(&e)))
}

/// The goals: whole poses, of which only motors that move differ from the start.
fn goals(args: &PlanArgs, scene: &Scene, motors: &[usize], from: &[f64]) -> Result<Vec<Vec<f64>>, Report> {
    let robot = robot(scene)?;
    let to = match &args.to_hand {
        Some(hand) => hand_poses(hand, args, scene, motors, from)?,
        None => args.to.iter().map(|to| pose("--to", to, robot, motors, from)).collect::<Result<_, _>>()?,
    };
    for goal in &to {
        if let Some(m) = (0..from.len()).find(|m| from[*m] != goal[*m] && !motors.contains(m)) {
            let name = robot.motors.get(m).map_or("", |m| m.name.as_str());
            let help = "name it in --motors, or leave it where it is";
            return Err(ConfigError::plain(format!("the goal moves {name}, which is not in --motors"), help).into());
        }
    }
    Ok(to)
}

/// The poses at which the hand is where it is to be: found by inverse kinematics, nearest to home first.
fn hand_poses(
    text: &str,
    args: &PlanArgs,
    scene: &Scene,
    motors: &[usize],
    from: &[f64],
) -> Result<Vec<Vec<f64>>, Report> {
    let robot = robot(scene)?;
    let numbers = numbers("--to-hand", text)?;
    let mut goal = match numbers.as_slice() {
        [x, y, z] => json!({ "position_m": [x, y, z] }),
        [x, y, z, r, p, yaw] => json!({ "position_m": [x, y, z], "rpy_deg": [r, p, yaw] }),
        other => {
            let help = "give x, y and z in meters, and if wanted roll, pitch and yaw in degrees";
            return Err(ConfigError::plain(format!("--to-hand has {} numbers", other.len()), help).into());
        }
    };
    if let Some(hand) = &args.hand {
        goal["hand"] = Value::from(hand.as_str());
    }
    let goal: HandGoal = mobee_contract::settings(&goal).map_err(complaint)?;
    let goals = HandGoals { scene, robot: 0, clearance: args.clearance_mm / 1e3, seed: args.seed };
    let found = goals.solutions(&goal, motors).map_err(complaint)?;
    let whole = |found: &ResolvedGoal| {
        let values: BTreeMap<String, f64> = found.q_deg.iter().cloned().collect();
        let mut pose = from.to_vec();
        for (m, q) in group::positions("--to-hand", &values, robot).map_err(complaint)? {
            if let Some(slot) = pose.get_mut(m) {
                *slot = q;
            }
        }
        Ok(pose)
    };
    found.iter().map(whole).collect()
}

fn numbers(argument: &str, text: &str) -> Result<Vec<f64>, ConfigError> {
    let number = |part: &str| {
        let number = part.trim().parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| {
            let help = "give numbers separated by commas, NAME=VALUE, or `home`";
            ConfigError::plain(format!("{argument}: {part:?} is not a number"), help)
        })
    };
    text.split(',').map(number).collect()
}

fn complaint(error: KindError) -> Report {
    let place = if error.path.is_empty() { String::new() } else { format!("{}: ", error.path) };
    ConfigError::plain(format!("{place}{}", error.what), error.help).into()
}

/// Way-points, one on a line, in degrees or mm.
fn text(path: &JointPath, robot: &Robot, motors: &[usize]) -> String {
    let names: Vec<&str> = motors.iter().filter_map(|m| Some(robot.motors.get(*m)?.name.as_str())).collect();
    let mut out = names.join(" ") + "\n";
    for pose in &path.poses {
        let values: Vec<String> = pose.iter().map(|q| format!("{:.2}", q.to_degrees())).collect();
        out += &(values.join(" ") + "\n");
    }
    out
}

/// Processor time of this thread, seconds.
fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
