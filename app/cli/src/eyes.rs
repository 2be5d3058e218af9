//! `mobee eyes`: images of simulated cameras, as training data for detectors and locators.

mod draw;
mod settings;
mod views;

use miette::Report;

/// The commands on eyes.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum EyesCommand {
    /// Render images of an object from random poses, in random light and scenery: NAME.png with NAME_mask.png for each
    /// eye, and index.csv with motors, pixels and the true position; for an iCub, views.csv for `mobee locator train`.
    Draw(draw::DrawArgs),
}

/// Runs the command.
///
/// # Errors
/// If a file can't be read or written, or is invalid, with its place and the remedy.
pub fn command(command: &EyesCommand) -> Result<(), Report> {
    let EyesCommand::Draw(args) = command;
    crate::terminal::out(&draw::command(args)?);
    Ok(())
}
