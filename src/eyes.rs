//! `mobee eyes`: pictures that simulated eyes take, to teach detectors and locators.

mod draw;
mod settings;
mod views;

use miette::Report;

/// What to do with eyes.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum EyesCommand {
    /// Take pictures of an object from random poses, in random light and scenery: NAME.png with NAME_mask.png for each eye, and
    /// index.csv with motors, pixels and the true position; for an iCub, views.csv for `mobee locator train`.
    Draw(draw::DrawArgs),
}

/// Does it.
///
/// # Errors
/// If a file can't be read or written, or is not what it should be, with place and remedy.
pub fn command(command: &EyesCommand) -> Result<(), Report> {
    let EyesCommand::Draw(args) = command;
    crate::terminal::out(&draw::command(args)?);
    Ok(())
}
