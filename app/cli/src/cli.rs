//! The command line: parses the arguments, calls the library, and turns errors into exit code 2.

use crate::new_robot::{ArmArgs, NewDriver};
use crate::robot_import::ImportArgs;
use crate::{
    agent, bench, calibrate, check, ctl, detector, doctor, eyes, inspect, locator, model_compare, model_convert,
    model_eval, model_info, model_view, new, new_crate, new_robot, plan, replay, roadmap, run, sim, terminal, torture,
    view, yarp,
};
use clap::{Parser, Subcommand};
use miette::Report;
use mobee_compose::config::{ClockMode, ConfigError};
use mobee_compose::{config, kinds, schema};
use mobee_sensing::detectors::onnx;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

#[cfg(test)]
mod tests;

/// Modular Behavioral Environment: robots that explore, collide, undo their motion and plan again.
///
/// A research safety layer, not a certified one: keep a hardware stop above it.
#[derive(Parser)]
#[command(name = "mobee", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run a behavior from its configuration file.
    Run(RunArgs),
    /// Check a configuration file, or a run's journal and its invariants.
    Check {
        /// A configuration file, a run's folder, or a journal.
        path: PathBuf,
        /// Override a setting: --set robot.icub.agent.vertices=30
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
        /// Also check every attempted edge offline, along its straight line (a run's folder only).
        #[arg(long)]
        edges: bool,
    },
    /// Inspect, evaluate or convert robot models.
    Model {
        #[command(subcommand)]
        command: ModelCommand,
    },
    /// Plan a certified path of a robot among the objects of a world.
    Plan(Box<plan::PlanArgs>),
    /// Build, show, validate, merge and plan on roadmaps in files.
    Roadmap {
        #[command(subcommand)]
        command: roadmap::RoadmapCommand,
    },
    /// Train detectors of an object on images with masks, evaluate them, and show them.
    Detector {
        #[command(subcommand)]
        command: detector::DetectorCommand,
    },
    /// Train locators on recorded views of known positions, evaluate them, and show them.
    Locator {
        #[command(subcommand)]
        command: locator::LocatorCommand,
    },
    /// Render images of simulated cameras, as training data for detectors and locators.
    Eyes {
        #[command(subcommand)]
        command: eyes::EyesCommand,
    },
    /// Summarize a run from its journal.
    Inspect {
        /// A run's folder, or a journal.
        run: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
        /// Write the recorded poses into this file, as a table for the driver kind `replay`.
        #[arg(long, value_name = "FILE", conflicts_with = "json")]
        poses: Option<PathBuf>,
        /// The robot, if there are several.
        #[arg(long, requires = "poses")]
        robot: Option<String>,
    },
    /// Open a run's recording in the Rerun viewer.
    View {
        /// A run's folder, or a recording.
        run: PathBuf,
    },
    /// Repeat a run in virtual time: unchanged, or from a given time on with another agent, world or script.
    Replay(replay::ReplayArgs),
    /// Serve the simulated robots of a configuration file as YARP devices, until Ctrl-C.
    Sim(sim::SimArgs),
    /// Search for faults: run a behavior in virtual time under seeded random faults, checking all invariants.
    Torture(torture::TortureArgs),
    /// Measure the success of a behavior in many random scenes, in virtual time, or the speed of planners.
    Bench {
        #[command(subcommand)]
        command: bench::BenchCommand,
    },
    /// List the kinds of agents, bridges, controllers, drivers and sensors, with their settings.
    Kinds {
        /// Show this kind with its settings.
        name: Option<String>,
        /// Show the settings for experts as well.
        #[arg(long, requires = "name")]
        all: bool,
    },
    /// Write a starting file for your own behavior, together with the robot and world that it names; or a crate of your own.
    New(NewArgs),
    /// Print the JSON Schema of configuration files, for editors.
    Schema,
    /// Run only the agent of a behavior, against the filtered control boards of a system running elsewhere.
    Agent(agent::AgentArgs),
    /// Show a configuration with all its layers merged.
    Config {
        #[command(subcommand)]
        command: ConfigCommand,
    },
    /// Inspect a running `mobee run`, swap its parts, pause it, stop it.
    Ctl(ctl::CtlArgs),
    /// Check that this machine is fit: processors, timers, disk, viewer, name server, and the robots of a file.
    Doctor(doctor::DoctorArgs),
    /// Run a network of a detector of the kind `onnx`, for the process that starts this one.
    #[command(hide = true)]
    OnnxWorker,
    /// Make the calibration of an arm of servos, whose joints you move by hand.
    Calibrate(calibrate::CalibrateArgs),
    /// Use YARP: a name server, and tools to inspect, read, write and connect ports.
    Yarp(yarp::YarpArgs),
}

#[derive(clap::Args)]
struct NewArgs {
    /// Its name: NAME.toml is written.
    #[arg(required_unless_present = "crate_name")]
    name: Option<String>,
    /// Write a Rust crate into the new folder NAME: a driver, an agent and a camera of your own, a behavior, and a program with every
    /// subcommand.
    #[arg(long = "crate", value_name = "NAME", conflicts_with_all = ["name", "robot", "from"])]
    crate_name: Option<String>,
    /// The checkout of MoBeE that the crate builds on. Default: the one that this program was built from.
    #[arg(long, value_name = "FOLDER", requires = "crate_name")]
    mobee: Option<PathBuf>,
    /// The behavior to start from: explore, ball, filter, torture or explore-yarp.
    #[arg(long, value_name = "BEHAVIOR", default_value = "explore")]
    from: String,
    /// The URDF of your own robot: it is converted, and explores.
    #[arg(long, value_name = "URDF")]
    robot: Option<PathBuf>,
    /// The kind of driver.
    #[arg(long, value_name = "DRIVER", value_enum, default_value_t, requires = "robot", conflicts_with = "crate_name")]
    driver: NewDriver,
    #[command(flatten)]
    arm: ArmArgs,
    #[command(flatten)]
    import: Box<ImportArgs>,
}

#[derive(clap::Args)]
struct RunArgs {
    /// The configuration file, such as configs/behaviors/explore.toml
    #[arg(required_unless_present = "resume")]
    file: Option<PathBuf>,
    /// Continue the run in this folder from where it ended or its process died.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["file", "out"])]
    resume: Option<PathBuf>,
    /// The seed of all randomness.
    #[arg(long)]
    seed: Option<u64>,
    /// `virtual` (as fast as the machine allows) or `real`.
    #[arg(long, value_parser = clock)]
    clock: Option<ClockMode>,
    /// End after this many seconds on the run's clock.
    #[arg(long = "for", value_name = "SECONDS", allow_negative_numbers = true)]
    secs: Option<f64>,
    /// Write the run into this new folder instead of runs/NAME-TIME.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Override a setting: --set robot.icub.agent.vertices=30
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Control port of a run with a real clock: ADDRESS:PORT (with a key in the run's folder) or `off`; default: a
    /// socket in the run's folder, for its own user only.
    #[arg(long, value_name = "WHERE", value_parser = ctl_at)]
    ctl: Option<run::CtlAt>,
    /// Apply edits of FILE during the run by swapping agents, controllers and drivers. Needs a real clock.
    #[arg(long, conflicts_with = "resume")]
    watch: bool,
    /// Make no recording (the journal is always written).
    #[arg(long)]
    no_record: bool,
    /// Print only the summary, as JSON, on standard output.
    #[arg(long)]
    json: bool,
    /// Print only warnings during the run.
    #[arg(long)]
    quiet: bool,
    /// Show all counters in the summary, including those that are zero.
    #[arg(long)]
    verbose: bool,
}

#[derive(Subcommand)]
enum ConfigCommand {
    /// Print the resolved file, with the origin of each value: a file's line, the environment, --set, or the default.
    Show {
        /// The configuration file.
        file: PathBuf,
        /// Override a setting: --set robot.icub.agent.vertices=30
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
}

#[derive(Subcommand)]
enum ModelCommand {
    /// Show a robot's parts, motors, markers and shapes.
    Info {
        /// Robot XML.
        robot: PathBuf,
    },
    /// Evaluate poses: markers, transforms, constraints and colliding pairs, as CSV files.
    Eval {
        /// Robot XML.
        #[arg(long)]
        robot: PathBuf,
        /// World XML.
        #[arg(long)]
        world: Option<PathBuf>,
        /// Poses as CSV: `pose_id`, then a column `part.motor` per motor, in encoder units (degrees; millimeters where it slides); others are at home.
        #[arg(long)]
        poses: PathBuf,
        /// Folder for the CSV files.
        #[arg(long)]
        out: PathBuf,
    },
    /// Convert a URDF file to robot XML.
    Convert(model_convert::ConvertArgs),
    /// Compare a converted robot with the meshes of its URDF: false contacts of its shapes, and missed ones.
    Compare(model_compare::CompareArgs),
    /// Show a robot in the Rerun viewer: shapes over meshes, each motor through its range, close pairs in red.
    View(model_view::ViewArgs),
}

fn ctl_at(text: &str) -> Result<run::CtlAt, String> {
    match text {
        "off" => Ok(run::CtlAt::Off),
        address => address
            .parse()
            .map(run::CtlAt::Address)
            .map_err(|_| "give ADDRESS:PORT, such as 127.0.0.1:10010, or off".into()),
    }
}

fn clock(text: &str) -> Result<ClockMode, String> {
    match text {
        "virtual" => Ok(ClockMode::Virtual),
        "real" => Ok(ClockMode::Real),
        _ => Err("the clocks are `virtual` and `real`".into()),
    }
}

/// Prefix of the panic message of a failed print.
const NO_OUTPUT: &str = "failed printing to stdout";
/// The log filter unless `MOBEE_LOG` is set: warnings, except those of Rerun's encoder and of its connection to a viewer, whose
/// errors the recorder reports, and of the kd-tree, which warns about its own leaves although its results are exact.
const LOG: &str = "warn,re_log_encoding=error,re_grpc_client=off,kiddo=off";
/// The same for `mobee torture`, where parts fail on purpose.
const TORTURE_LOG: &str = "off";

/// Runs the program: every subcommand, with all kinds that are linked into the binary.
///
/// A crate of your own registers its kinds (agents, drivers, cameras, ...) with `inventory::submit!`, and this call is
/// its whole program: `run`, `check`, `kinds`, `ctl`, `torture`, `replay` and `doctor` work with those kinds. `mobee
/// new --crate NAME` writes such a crate.
///
/// # Examples
/// ```no_run
/// fn main() -> std::process::ExitCode {
///     mobee_cli::cli::main()
/// }
/// ```
pub fn main() -> ExitCode {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| match info.payload_as_str() {
        // `mobee kinds | head` ends quietly: a closed pipe is not an error
        Some(what) if what.starts_with(NO_OUTPUT) && what.contains("Broken pipe") => std::process::exit(0),
        Some(what) if what.starts_with(NO_OUTPUT) => {
            let _ = writeln!(std::io::stderr(), "{what}");
            std::process::exit(1);
        }
        _ => usual(info),
    }));
    let cli = Cli::parse();
    // the file of the program may be replaced while it runs
    let own = if cfg!(target_os = "linux") { Ok(PathBuf::from("/proc/self/exe")) } else { std::env::current_exe() };
    if let Ok(own) = own {
        onnx::use_process(own, &["onnx-worker"]);
    }
    let log = if matches!(cli.command, Command::Torture(_)) { TORTURE_LOG } else { LOG };
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::try_from_env("MOBEE_LOG").unwrap_or_else(|_| log.into()))
        .with_writer(std::io::stderr)
        .init();
    match dispatch(cli.command) {
        Ok(code) => code,
        Err(report) => {
            terminal::complain(&report);
            ExitCode::from(2)
        }
    }
}

fn dispatch(command: Command) -> Result<ExitCode, Report> {
    match command {
        Command::Run(a) => {
            let mut set = a.set;
            // named options are overrides like any other, applied last
            set.extend(a.seed.map(|s| format!("seed={s}")));
            set.extend(a.clock.map(|c| format!("clock={}", if c == ClockMode::Real { "real" } else { "virtual" })));
            set.extend(a.secs.map(|s| format!("for_s={s:?}")));
            if a.no_record {
                set.push("record.enabled=false".into());
            }
            let ctl = a.ctl.unwrap_or_default();
            let output = run::Output { json: a.json, quiet: a.quiet, verbose: a.verbose };
            match (a.resume, a.file) {
                (Some(dir), _) => run::resume(&dir, &set, output, ctl),
                (None, file) => run::command(&file.unwrap_or_default(), &set, a.out.as_deref(), output, ctl, a.watch),
            }
        }
        Command::Check { path, set, edges } => check::command(&path, &set, edges),
        Command::Config { command: ConfigCommand::Show { file, set } } => {
            terminal::out(&config::show::text(&file, &set)?);
            Ok(ExitCode::SUCCESS)
        }
        Command::Model { command } => {
            match command {
                ModelCommand::Info { robot } => terminal::out(&model_info::text(&robot)?),
                ModelCommand::Eval { robot, world, poses, out } => {
                    let what =
                        model_eval::Evaluation { robot: &robot, world: world.as_deref(), poses: &poses, out: &out };
                    let done = model_eval::evaluate(what)?;
                    terminal::out(&format!(
                        "{} poses, {} colliding pairs of the robot with itself, {} with the world\n",
                        done.poses, done.self_pairs, done.world_pairs
                    ));
                    done.files.iter().for_each(|f| terminal::out(&format!("{}\n", f.display())));
                }
                ModelCommand::Convert(args) => terminal::out(&model_convert::command(&args)?),
                ModelCommand::View(args) => terminal::out(&model_view::command(&args)?),
                ModelCommand::Compare(args) => return model_compare::command(&args),
            }
            Ok(ExitCode::SUCCESS)
        }
        Command::Roadmap { command } => roadmap::command(&command),
        Command::Detector { command } => detector::command(&command).map(|()| ExitCode::SUCCESS),
        Command::Locator { command } => locator::command(&command).map(|()| ExitCode::SUCCESS),
        Command::Eyes { command } => eyes::command(&command).map(|()| ExitCode::SUCCESS),
        Command::Inspect { run, poses: Some(file), robot, .. } => {
            terminal::out(&(inspect::poses(&run, robot.as_deref(), &file)? + "\n"));
            Ok(ExitCode::SUCCESS)
        }
        Command::Inspect { run, json, .. } => {
            terminal::out(&inspect::text(&run, json)?);
            Ok(ExitCode::SUCCESS)
        }
        Command::View { run } => {
            terminal::out(&(view::open(&run).map_err(|e: ConfigError| Report::new(e))? + "\n"));
            Ok(ExitCode::SUCCESS)
        }
        Command::Replay(args) => replay::command(&args),
        Command::Sim(args) => {
            sim::command(&args)?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Torture(args) => torture::command(&args),
        Command::Plan(args) => plan::command(&args),
        Command::Bench { command } => bench::command(&command),
        Command::Kinds { name, all } => {
            terminal::out(&kinds::listing(name.as_deref(), all)?);
            Ok(ExitCode::SUCCESS)
        }
        Command::New(args) => write_new(args),
        Command::Schema => {
            terminal::out(&schema::text());
            Ok(ExitCode::SUCCESS)
        }
        Command::Agent(args) => agent::command(args),
        Command::Ctl(args) => ctl::command(args),
        Command::Doctor(args) => doctor::command(&args),
        Command::OnnxWorker => match onnx::serve() {
            Ok(()) => Ok(ExitCode::SUCCESS),
            Err(e) => {
                terminal::err(&format!("{e}\n"));
                Ok(ExitCode::FAILURE)
            }
        },
        Command::Calibrate(args) => calibrate::command(&args),
        Command::Yarp(args) => Ok(yarp::command(args)),
    }
}

/// `mobee new`: a behavior, a robot with a behavior, or a crate.
fn write_new(args: NewArgs) -> Result<ExitCode, Report> {
    let NewArgs { name, crate_name, mobee, from, robot, driver, arm, import } = args;
    if robot.is_none() && import.is_given() {
        let what = "options of the import are given, and no URDF to import";
        return Err(ConfigError::plain(what, "name it by --robot FILE, or leave the options out").into());
    }
    let name = name.unwrap_or_default();
    let text = match (crate_name, robot, arm.write(&name)) {
        (Some(name), ..) => new_crate::command(&name, mobee.as_deref())?,
        (None, Some(urdf), _) => new_robot::command(&name, &from, &urdf, driver, &import)?,
        (None, None, Some(written)) => written?,
        (None, None, None) => new_robot::files_text(&new::write(&name, &from)?),
    };
    terminal::out(&text);
    Ok(ExitCode::SUCCESS)
}
