//! `mobee roadmap merge`: merges several maps into one.

use super::{info, load, may_write, save};
use miette::{Report, miette};
use mobee_planning::map_file::merge;
use std::path::PathBuf;

/// Arguments of `mobee roadmap merge`.
#[derive(clap::Args, Clone, Debug)]
pub struct MergeArgs {
    /// The maps.
    #[arg(required = true)]
    maps: Vec<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace it if it exists.
    #[arg(long)]
    force: bool,
}

/// Merges the maps.
///
/// # Errors
/// If a file can't be read or written, or the maps don't belong together.
pub fn command(args: &MergeArgs) -> Result<String, Report> {
    may_write(&args.out, args.force)?;
    let maps = args.maps.iter().map(|path| Ok(load(path)?.0)).collect::<Result<Vec<_>, Report>>()?;
    let merged = merge(&maps).map_err(|e| {
        miette!(help = "merge maps of one robot, unchanged, in one world, with one group of motors and one hand", "{e}")
    })?;
    save(&args.out, &merged)?;
    Ok(format!("{}: ", args.out.display()) + &info::text(&merged, None))
}
