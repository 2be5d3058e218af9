//! `mobee roadmap validate`: every edge certified, with what blocks it.

use super::certified::CertifiedArgs;
use crate::robot_import::Steps;
use miette::Report;

/// What to validate, and in which world.
#[derive(clap::Args, Clone, Debug)]
pub struct ValidateArgs {
    #[command(flatten)]
    of: CertifiedArgs,
}

/// Certifies all edges and stores what was found.
///
/// # Errors
/// If a file can't be read or written, or the map is of another robot.
pub fn command(args: &ValidateArgs) -> Result<String, Report> {
    let (scene, mut map) = args.of.load()?;
    let bar = Steps::new();
    args.of.certify(&mut map, &scene, &bar)?;
    drop(bar);
    args.of.save(&map, &scene)
}
