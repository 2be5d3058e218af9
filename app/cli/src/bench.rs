//! `mobee bench`: the success of behaviors over many seeded scenes in virtual time, and the speed of planners.

mod plan;
mod reach;
mod scene;

use miette::Report;
use std::process::ExitCode;

/// The benchmarks.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum BenchCommand {
    /// Reach for an object in random scenes: how often it is reached, how fast, how exactly, and why not.
    Reach(reach::ReachBenchArgs),
    /// Plan the problems of files, such as MotionBenchMaker's: how many are solved, how fast, and how long the paths are.
    Plan(plan::PlanBenchArgs),
}

/// Runs a benchmark and prints its results.
///
/// # Errors
/// Complaints about the arguments or the configuration.
pub fn command(command: &BenchCommand) -> Result<ExitCode, Report> {
    match command {
        BenchCommand::Reach(args) => reach::command(args),
        BenchCommand::Plan(args) => plan::command(args),
    }
}
