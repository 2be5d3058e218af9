//! `mobee agent`: runs only the agent of a behavior's robot in a process of its own, against the filtered control
//! boards of a running system, as in the paper. It uses YARP only.
//!
//! ```text
//! FILE: robot, world, agent ──> Agent::next ──MoveTo──> /MoBeE/icub/<part>/rpc:i   [velg] [posg], then [dons]
//!                                    ^                        │ [fail]: the reflex rolled the motion back, or refused
//!                                    └── poses, objects <─────┴ [encs];  /MoBeE/world: ls, get
//! ```
//!
//! Not available over YARP: contacts of the robot (they are computed at the pose that is read), the configurations of
//! other robots (they are assumed to be at home), and objects that are not in FILE's world.

mod body;
mod surroundings;

use crate::signals::Interrupt;
use body::Body;
use miette::{IntoDiagnostic, Report};
use mobee_compose::compose;
use mobee_compose::config::{Config, ConfigError, nearest};
use mobee_contract::{Agent, Intent, MotionEnd, Note, Pose, Summary, Target, View};
use mobee_controller::RELEASE;
use mobee_model::Scene;
use mobee_runtime::clock::{Clock, ClockKind};
use mobee_yarp::Network;
use mobee_yarp::config::{self, Env};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;
use surroundings::Surroundings;

/// Pause before a commit is retried that the filter was not ready for.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// The arguments of `mobee agent`.
#[derive(clap::Args)]
pub struct AgentArgs {
    /// The behavior whose agent to run; its robot model and world must be those of the running system.
    file: PathBuf,
    /// Prefix of the names of the robot's boards.
    #[arg(long, value_name = "PREFIX", default_value = "/MoBeE/icub")]
    robot: String,
    /// The port of the running system's world. Without it, objects are assumed to be where FILE puts them.
    #[arg(long, value_name = "PORT")]
    world: Option<String>,
    /// The robot in FILE whose agent to run; default: the robot that PREFIX ends with, or the only one.
    #[arg(long, value_name = "ROBOT")]
    name: Option<String>,
    /// End after this many seconds.
    #[arg(long = "for", value_name = "SECONDS")]
    secs: Option<f64>,
    /// Override a setting: --set robot.icub.agent.vertices=30
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print only the summary, as JSON, on standard output.
    #[arg(long)]
    json: bool,
}

/// Counts of a session.
#[derive(Default, serde::Serialize)]
struct Counts {
    motions: u64,
    reached: u64,
    failed: u64,
    waited: u64,
}

/// A running agent.
struct Session {
    agent: Box<dyn Agent>,
    body: Body,
    world: Option<Surroundings>,
    scene: Arc<Scene>,
    robot: usize,
    poses: Vec<Pose>,
    clearance: f64,
    margin: f64,
    clock: Clock,
    counts: Counts,
    quiet: bool,
}

/// Runs the agent to its end and prints its summary.
///
/// # Errors
/// Complaints about the configuration and the ports, before anything moves, and boards with malformed answers.
pub fn command(args: AgentArgs) -> Result<ExitCode, Report> {
    let (mut config, source) = Config::load(&args.file, &args.set)?;
    let robot = chosen(&config, &args)?;
    // the boards are accessed through the filter: no driver of this file may touch them
    for r in &mut config.robot {
        r.simulate();
    }
    let network = match config.yarp_ports().find_map(|(_, ports)| ports.name_server) {
        Some(server) => Network::at(server),
        None => config::network_or_default(&Env::real()).map_err(|e| {
            ConfigError::plain(e.to_string(), "give the address as name_server in the table [yarp] of the file")
        })?,
    };
    let tolerance = 2.0 * config.robot[robot].controller.tolerance_deg.to_radians();
    let margin = config.robot[robot].controller.margin_mm * 1e-3;
    let composition = compose(config, &source)?;
    let setup = &composition.robots[robot];
    let maker = setup.agent.clone().ok_or_else(|| {
        let what = format!("the robot {} of this file has no agent", setup.name);
        ConfigError::plain(what, "give it a table [robot.agent]; `mobee kinds` lists the kinds")
    })?;
    let agent = maker().map_err(Report::msg)?;
    let axes = setup.hardware.connect().into_diagnostic()?.board().axes.clone();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().into_diagnostic()?;
    runtime.block_on(async {
        let model = composition.scene.robots()[robot].clone();
        let no_port = |e: &dyn std::fmt::Display| {
            ConfigError::plain(
                e.to_string(),
                "start the system first (`mobee run` with a table [yarp]), and see `mobee yarp list` for its ports",
            )
        };
        let body = Body::connect(&network, &args.robot, &model, &axes, tolerance).await.map_err(|e| no_port(&e))?;
        let world = match &args.world {
            Some(port) => Some(Surroundings::connect(&network, port).await.map_err(|e| no_port(&e))?),
            None => None,
        };
        let session = Session {
            agent,
            body,
            world,
            robot,
            poses: composition.scene.home(),
            scene: Arc::new(composition.scene),
            clearance: margin + RELEASE,
            margin,
            clock: Clock::new(ClockKind::Real),
            counts: Counts::default(),
            quiet: args.json,
        };
        session.run(args.secs).await
    })
}

/// The index of the robot whose agent is to run.
fn chosen(config: &Config, args: &AgentArgs) -> Result<usize, ConfigError> {
    let names: Vec<&str> = config.robot.iter().map(|r| r.name.as_str()).collect();
    let wanted = args.name.as_deref().or_else(|| args.robot.rsplit('/').next()).unwrap_or_default();
    match names.iter().position(|n| *n == wanted) {
        Some(found) => Ok(found),
        None if names.len() == 1 && args.name.is_none() => Ok(0),
        None => {
            let near = nearest(wanted, &names).map_or(String::new(), |n| format!("did you mean `{n}`? "));
            let help = format!("{near}choose with --name; the robots are: {}", names.join(", "));
            Err(ConfigError::plain(format!("there is no robot `{wanted}` in this file"), help))
        }
    }
}

impl Session {
    async fn run(mut self, secs: Option<f64>) -> Result<ExitCode, Report> {
        let limit = Duration::from_secs_f64(secs.unwrap_or(1e9).clamp(0.0, 1e9));
        let mut interrupt = Interrupt::new();
        let ended = tokio::select! {
            done = self.work() => Some(done?),
            () = interrupt.wait() => None,
            () = tokio::time::sleep(limit) => None,
        };
        if ended.is_none() {
            // stop the motion under way; a closed filter has stopped it already
            let _ = tokio::time::timeout(Duration::from_secs(2), self.body.stop()).await;
        }
        let text = ended.as_ref().map_or("stopped before it was done", |s| s.text.as_str());
        if self.quiet {
            let done = json!({ "done": ended.is_some(), "summary": ended, "counters": self.counts });
            println!("{}", serde_json::to_string_pretty(&done).into_diagnostic()?);
        } else {
            println!("{text}");
            for (name, value) in ended.iter().flat_map(|s| &s.figures) {
                println!("  {name:22} {value}");
            }
            let Counts { motions, reached, failed, .. } = self.counts;
            println!("  {motions} motions: {reached} reached, {failed} failed");
        }
        Ok(ExitCode::SUCCESS)
    }

    /// Runs the agent: carries out its intents until it is done.
    async fn work(&mut self) -> Result<Summary, Report> {
        let mut last = None;
        loop {
            let view = self.view().await?;
            let intent = self.agent.next(last.take(), &view);
            self.print_notes();
            match intent {
                Intent::MoveTo(target) => last = self.drive(&target, None, &view).await?,
                Intent::MoveEach(target, speeds) => last = self.drive(&target, Some(&speeds), &view).await?,
                Intent::Stream(_) => {
                    return Err(ConfigError::plain(
                        "this agent streams set-points, which `mobee agent` does not send",
                        "run it within `mobee run`",
                    )
                    .into());
                }
                Intent::Stop => tokio::time::sleep(RETRY_DELAY).await,
                Intent::Wait(time) => tokio::time::sleep(time.max(Duration::from_millis(1))).await,
                Intent::Done(summary) => return Ok(summary),
            }
        }
    }

    /// Drives a motion, and returns its end; `None` if the filter is closed, and it did not begin.
    async fn drive(
        &mut self,
        target: &Target,
        speeds: Option<&[f64]>,
        view: &View,
    ) -> Result<Option<MotionEnd>, Report> {
        let end = self.body.drive(target, speeds, view.pose()).await.into_diagnostic()?;
        match end {
            Some(MotionEnd::Reached) => self.counts.reached += 1,
            Some(MotionEnd::Failed) => self.counts.failed += 1,
            None => {
                self.counts.waited += 1;
                tokio::time::sleep(RETRY_DELAY).await;
            }
        }
        self.counts.motions += u64::from(end.is_some());
        Ok(end)
    }

    /// The agent's view, as soon as the filter is open.
    async fn view(&mut self) -> Result<View, Report> {
        let q: Pose = self.body.pose().await.into_diagnostic()?.into();
        if let Some(slot) = self.poses.get_mut(self.robot) {
            *slot = q;
        }
        if let Some(world) = &mut self.world {
            match world.refresh(&self.scene).await {
                Ok(Some(scene)) => self.scene = Arc::new(scene),
                Ok(None) => {}
                Err(e) => eprintln!("the world is assumed to be unchanged: {e}"),
            }
        }
        Ok(View {
            at: self.clock.now(),
            robot: self.robot,
            axes: self.body.axes().into(),
            poses: self.poses.clone(),
            contacts: self.scene.contacts(&self.poses, self.margin).into(),
            scene: self.scene.clone(),
            clearance: self.clearance,
            seen: Arc::new([]),
        })
    }

    fn print_notes(&mut self) {
        for note in self.agent.notes() {
            if let Note::Log { text } = note
                && !self.quiet
            {
                eprintln!("{text}");
            }
        }
    }
}
