//! `mobee ctl`: look at a running `mobee run`, exchange its parts, pause it, stop it.
//!
//! ```text
//! mobee ctl ──RUN/ctl.sock (JSON lines)──> a service of the run ──Control──> the system
//! ```
//! Who may do what: the run's own user and root, anything; anybody else, nothing. `mobee ctl` reads the files, the run opens none
//! that it is told of.

mod client;
mod desk;
mod door;
mod find;
mod gather;
pub(crate) mod offer;
mod service;
mod show;
mod wire;

pub use service::CtlService;

use clap::{Args, Subcommand};
use miette::Report;
use std::path::PathBuf;
use std::process::ExitCode;

/// The arguments of `mobee ctl`.
#[derive(Args)]
pub struct CtlArgs {
    /// The folder of the run; default: the newest one in runs/ that can be controlled.
    #[arg(long, global = true, value_name = "DIR")]
    run: Option<PathBuf>,
    /// The address of a run on another computer that was started with --ctl ADDRESS:PORT, instead of the folder; needs --key.
    #[arg(long, global = true, value_name = "HOST:PORT", conflicts_with = "run", requires = "key")]
    at: Option<String>,
    /// A copy of the file ctl.tcp in the folder of that run.
    #[arg(long, global = true, value_name = "FILE", requires = "at")]
    key: Option<PathBuf>,
    #[command(subcommand)]
    command: CtlCommand,
}

#[derive(Subcommand)]
enum CtlCommand {
    /// How each robot is, in one line; then the tree of actors with restarts, queues, rates and drops.
    Status,
    /// The same, live, until Ctrl-C: once a second, in place if this is a terminal.
    Top {
        /// End after so many.
        #[arg(long, value_name = "N")]
        times: Option<u64>,
    },
    /// Exchange a part of a robot by the one of another configuration file, while it runs.
    Swap(SwapArgs),
    /// Let the robots' own agents make no motions for now (the present ones end first).
    Pause {
        /// Only this robot's.
        robot: Option<String>,
    },
    /// Let them make motions again.
    Resume {
        /// Only this robot's.
        robot: Option<String>,
    },
    /// Try a failed retreat again.
    Recover {
        /// Only this robot's.
        robot: Option<String>,
    },
    /// End the run in order: motions stop, every commit has its outcome.
    Stop {
        /// Without waiting for rest.
        #[arg(long)]
        now: bool,
    },
    /// Say something to the world, such as `mk ssph 0.05 0.3 0 0.5`, `ls`, `rm ssph 1`, `help`.
    World {
        /// The request.
        #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<String>,
    },
    /// Switch the recording `on` or `off` (the journal is always kept), or let a Rerun viewer follow: `connect`.
    Record {
        /// `on`, `off` or `connect`.
        what: String,
        /// Where the viewer listens, as the run sees it; default: 127.0.0.1:9876.
        #[arg(value_name = "ADDRESS:PORT")]
        address: Option<String>,
    },
}

#[derive(Args)]
struct SwapArgs {
    /// What to exchange: `agent`, `controller` or `driver`.
    part: String,
    /// The configuration file that has the new one. It may `include` the running one.
    file: PathBuf,
    /// Which robot; needed if there are several.
    #[arg(long)]
    robot: Option<String>,
    /// Seconds that a new agent only looks on; what it would have done is in the journal.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    shadow: f64,
    /// Seconds after it took over in which the old one returns if it breaks.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    probation: f64,
    /// The longest that it may take for an answer until its probation is over, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0)]
    budget: f64,
    /// Begin anew instead of taking over the old agent's state: for an agent of another kind.
    #[arg(long)]
    fresh: bool,
    /// Return when it is built and checked, instead of when its probation is over.
    #[arg(long)]
    no_wait: bool,
}

/// Carries out `mobee ctl ...`.
///
/// # Errors
/// A run that can't be found or reached, and whatever it did not accept, in its words.
pub fn command(args: CtlArgs) -> Result<ExitCode, Report> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|e| Report::msg(format!("no asynchronous runtime: {e}")))?;
    runtime.block_on(client::run(args))
}
