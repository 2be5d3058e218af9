//! `mobee roadmap validate`: certifies every edge, and stores its obstacle.

use super::certified::CertifiedArgs;
use crate::robot_import::Steps;
use miette::Report;

/// Arguments of `mobee roadmap validate`.
#[derive(clap::Args, Clone, Debug)]
pub struct ValidateArgs {
    #[command(flatten)]
    of: CertifiedArgs,
}

/// Certifies all edges and stores the verdicts.
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
