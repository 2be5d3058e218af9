//! `mobee locator train`.

use crate::roadmap::may_write;
use crate::robot_import::Steps;
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_compose::maps::save_text;
use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::file::{LocatorFile, LocatorKind};
use mobee_sensing::locators::head::HeadKind;
use std::path::PathBuf;

/// Arguments of `mobee locator train`.
#[derive(clap::Args, Clone, Debug)]
pub struct LocatorTrainArgs {
    /// The table of recorded views of known positions.
    #[arg(long, value_name = "FILE.csv")]
    data: PathBuf,
    /// The locator to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The kind to train: `triangulate` (fits the frame of the positions), `network` (as published), `ensemble`
    /// (networks with more inputs) or `calibrated` (fits the deviations of the head from its nominal kinematics).
    #[arg(long, value_parser = kind, default_value = "calibrated")]
    kind: LocatorKind,
    /// The nominal head kinematics that training starts from: `v1` (iCubs of 2012) or `v2` (later ones, and the shipped
    /// model).
    #[arg(long, value_parser = head, default_value = "v1")]
    head: HeadKind,
    /// The seed of all randomness.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Replace the locator if it exists.
    #[arg(long)]
    force: bool,
}

fn kind(text: &str) -> Result<LocatorKind, String> {
    let names: Vec<_> = LocatorKind::ALL.iter().map(|k| format!("`{}`", k.name())).collect();
    let found = LocatorKind::ALL.into_iter().find(|k| k.name() == text);
    found.ok_or_else(|| format!("give one of {}", names.join(", ")))
}

pub(super) fn head(text: &str) -> Result<HeadKind, String> {
    match text {
        "v1" => Ok(HeadKind::V1),
        "v2" => Ok(HeadKind::V2),
        _ => Err("give `v1` or `v2`".into()),
    }
}

/// Trains the locator, and reports the number of views.
///
/// # Errors
/// If the table can't be read or is insufficient, or the locator can't be written.
pub fn command(args: &LocatorTrainArgs) -> Result<String, Report> {
    may_write(&args.out, args.force)?;
    let bar = Steps::new();
    bar.step("reads views");
    let (table, digest) = super::table(&args.data)?;
    bar.step("learns, also without each fifth of the places");
    let from = Beginning { head: args.head, ..Beginning::recorded(args.seed) };
    let file =
        LocatorFile::train(args.kind, &table.known, digest, &from, &mut |share| bar.show(share)).map_err(|e| {
            let help = "give more views of more places, spread over the workspace";
            ConfigError::plain(format!("{}: {e}", args.data.display()), help)
        })?;
    save_text(&args.out, &file.text())?;
    let boxes = if table.has_boxes { "with boxes" } else { "without boxes" };
    Ok(format!("{}: {}, from {} views {boxes}\n", args.out.display(), args.kind.name(), table.known.len()))
}
