//! `mobee doctor [FILE]`: checks that this machine can run it. One line per check, with a remedy.
//!
//! It only reads and queries: it writes nothing to a board and moves no robot, unless `--move` requests that.

mod boards;
mod machine;
mod measures;
mod moves;
mod verdict;
mod watched;

use crate::new::save_all;
use crate::roadmap::may_write;
use mobee_compose::config::{Config, Source};
use mobee_compose::{compose, driver_of};
use mobee_contract::{Hardware, JointLimits, Time, suggestion};
use mobee_driver_yarp::{YARP, YarpDriverSettings};
use mobee_model::JointMotion;
use mobee_yarp::Network;
use mobee_yarp::config::{self, Env};
use std::cell::Cell;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Time limit for an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(3);

/// The arguments of `mobee doctor`.
#[derive(clap::Args)]
pub struct DoctorArgs {
    /// A configuration file whose robots to check as well.
    file: Option<PathBuf>,
    /// Override a setting: --set robot.icub.agent.vertices=30
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Move this motor back and forth by a few degrees, in transactions under the file's reflex, to measure what its board does: encoder
    /// resolution and noise, sag, lag, *done*, stop, reference speeds and accelerations. Prints the settings that the file lacks. The motor
    /// needs 12 degrees (or mm) of free space toward the middle of its range; at 20 % of its maximum speed it is stopped halfway.
    #[arg(long = "move", value_name = "MOTOR", requires = "file")]
    moves: Option<String>,
    /// Write the settings that the file lacks into this new file, which includes the measured one: a run of it uses both.
    #[arg(long, value_name = "NEW.toml", requires = "moves")]
    write: Option<PathBuf>,
}

/// Result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Grade {
    Ok,
    Warn,
    Bad,
}

impl fmt::Display for Grade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Grade::Ok => "ok",
            Grade::Warn => "warn",
            Grade::Bad => "bad",
        })
    }
}

/// The result of a check as a sentence, with its remedy.
#[derive(Clone, Debug, PartialEq)]
struct Finding {
    grade: Grade,
    what: String,
    remedy: String,
}

impl Finding {
    fn ok(what: impl Into<String>) -> Finding {
        Finding { grade: Grade::Ok, what: what.into(), remedy: String::new() }
    }
    fn warn(what: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding { grade: Grade::Warn, what: what.into(), remedy: remedy.into() }
    }
    fn bad(what: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding { grade: Grade::Bad, what: what.into(), remedy: remedy.into() }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:5} {}", self.grade, self.what)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "\n      -> {}", self.remedy) }
    }
}

/// Runs all checks and prints their results as they come; exit code 1 if any is bad.
///
/// # Errors
/// If there is no asynchronous runtime, or the file of `--write` exists or can't be written.
pub fn command(args: &DoctorArgs) -> Result<ExitCode, miette::Report> {
    if let Some(new) = &args.write {
        may_write(new, false)?;
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|e| miette::Report::msg(format!("no asynchronous runtime: {e}")))?;
    let worst = Cell::new(Grade::Ok);
    let report = |findings: Vec<Finding>| {
        for finding in findings {
            worst.set(worst.get().max(finding.grade));
            println!("{finding}");
        }
    };
    report(vec![machine::processors(), runtime.block_on(machine::timers())]);
    report(machine::folder(Path::new("runs")));
    report(vec![machine::viewer()]);
    let CheckedFile { found, robots, motors } =
        args.file.as_deref().map(|file| configuration(file, &args.set)).unwrap_or_default();
    report(found);
    let needed = robots.iter().any(|r| r.settings.server.is_none());
    let own = if needed { config::network_or_default(&Env::real()) } else { Network::from_env() };
    report(vec![match own {
        Ok(network) => runtime.block_on(boards::name_server(&network, needed)),
        Err(e) if needed => {
            let remedy = "fix yarp.conf (`mobee yarp conf HOST PORT`), or set `server` in the driver's table";
            Finding::bad(e.to_string(), remedy)
        }
        Err(_) => {
            let why = if robots.is_empty() { "none is needed" } else { "each driver names its server" };
            Finding::ok(format!("no YARP network is set up; {why}"))
        }
    }]);
    for robot in &robots {
        report(runtime.block_on(boards::robot(robot)));
    }
    if let (Some(file), Some(motor)) = (&args.file, &args.moves) {
        let motors: Vec<&str> = motors.iter().map(String::as_str).collect();
        let not = |why: String| Finding::bad(format!("{motor} was not moved"), why);
        if worst.get() == Grade::Bad {
            report(vec![not("fix what is bad first".into())]);
        } else if motors.contains(&motor.as_str()) {
            let (findings, settings) = moves::measure(file, &args.set, motor)?;
            report(findings);
            if !settings.is_empty() {
                let printed = settings.toml();
                println!("\nsettings for {}, as measured with {motor}:\n\n{printed}", file.display());
            }
            match &args.write {
                Some(_) if settings.is_empty() => println!("no file is written: {} lacks no setting", file.display()),
                Some(new) => {
                    let text = settings.layer(&included(file, new)?, motor);
                    save_all(&[(new.as_path(), text.as_str())])?;
                    println!("written into {}, which includes {}", new.display(), file.display());
                }
                None => {}
            }
        } else {
            report(vec![not(suggestion(motor, "motor with a board", &motors))]);
        }
    }
    Ok(if worst.get() == Grade::Bad { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The path by which a new file includes this one: its name in the same folder, or the full path.
pub(crate) fn included(file: &Path, new: &Path) -> Result<String, miette::Report> {
    let whole = |path: &Path| {
        let why = |e: std::io::Error| miette::Report::msg(format!("can't find {}: {e}", path.display()));
        path.canonicalize().map_err(why)
    };
    let parent = new.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = whole(file)?;
    let folder = whole(parent)?;
    let path = file.strip_prefix(&folder).unwrap_or(&file);
    Ok(path.to_string_lossy().into_owned())
}

/// A robot behind YARP.
struct YarpRobot {
    name: String,
    settings: YarpDriverSettings,
    /// The motors of each of its parts in the model.
    motors: Vec<Vec<ModelMotor>>,
}

/// A motor of the model.
struct ModelMotor {
    name: String,
    motion: JointMotion,
    /// Limits, rad of encoder.
    limits: JointLimits,
}

/// The results for a file.
#[derive(Default)]
struct CheckedFile {
    found: Vec<Finding>,
    /// Its robots behind YARP.
    robots: Vec<YarpRobot>,
    /// The motors that have a board, real or simulated.
    motors: Vec<String>,
}

/// Checks a file as `mobee check` does.
fn configuration(file: &Path, set: &[String]) -> CheckedFile {
    let bad = |report: miette::Report| {
        let remedy = "fix the file; `mobee check` reports the same";
        let found = vec![Finding::bad(format!("{}: {report:?}", file.display()), remedy)];
        CheckedFile { found, ..CheckedFile::default() }
    };
    let (config, source) = match Config::load(file, set) {
        Ok(loaded) => loaded,
        Err(e) => return bad(e.into()),
    };
    let composition = match compose(config, &source) {
        Ok(composition) => composition,
        Err(report) => return bad(report.into()),
    };
    let mut found = vec![Finding::ok(format!("{} is right", file.display()))];
    found.extend(composition.warnings.iter().map(|w| Finding::warn(w.clone(), "see docs/configuration.md")));
    let mut robots = Vec::new();
    let mut motors = Vec::new();
    for (robot, setup) in composition.scene.robots().iter().zip(&composition.robots) {
        let driven = setup.hardware.known().motors;
        let has_board = |m: &usize| driven.as_ref().is_none_or(|driven| driven.contains(m));
        let all = robot.motors.iter().enumerate().filter(|(m, _)| has_board(m));
        motors.extend(all.map(|(_, motor)| motor.name.clone()));
    }
    for (i, robot) in composition.config.robot.iter().enumerate() {
        match remote(&source, i, &robot.driver) {
            Some(settings) => {
                let model = composition.scene.robots().get(i);
                let of = |part: &str| {
                    let part = model?.parts.iter().find(|p| p.name == part)?;
                    let motors = model?.motors.get(part.motors.clone())?.iter();
                    let motor = |m: &mobee_model::Motor| ModelMotor {
                        name: m.name.clone(),
                        motion: m.motion,
                        limits: (m.min, m.max),
                    };
                    Some(motors.map(motor).collect())
                };
                let motors = settings.parts.iter().map(|p| of(&p.part).unwrap_or_default()).collect();
                robots.push(YarpRobot { name: robot.name.clone(), settings, motors });
            }
            None => found.extend(composition.robots.get(i).map(|setup| seen(&robot.name, setup.hardware.as_ref()))),
        }
    }
    CheckedFile { found, robots, motors }
}

/// Reads a robot that is not behind YARP, if there is something to read; nothing moves.
fn seen(name: &str, hardware: &dyn Hardware) -> Finding {
    let Some(look) = hardware.look() else {
        return Finding::ok(format!("{name} is simulated: there is nothing to reach"));
    };
    match look.and_then(|mut driver| Ok((driver.sample(Time::ZERO)?, driver))) {
        Err(e) => Finding::bad(format!("{name}: {e}"), "nothing was moved; see the guide of its driver"),
        Ok((None, _)) => Finding::ok(format!("{name} answers")),
        Ok((Some(sample), driver)) => {
            let motors = driver.board().axes.iter().zip(sample.q.iter());
            let motors: Vec<String> =
                motors.map(|(axis, q)| format!("{} {}", axis.name, axis.motion.told(*q, 1))).collect();
            Finding::ok(format!("{name} is at {}", motors.join(", ")))
        }
    }
}

fn remote(source: &Source, robot: usize, driver: &serde_json::Value) -> Option<YarpDriverSettings> {
    let (kind, settings) = driver_of(source, &format!("robot[{robot}].driver"), driver).ok()?;
    if kind == YARP { mobee_contract::settings(&settings).ok() } else { None }
}
