//! `mobee detector`: detectors in files, trained on images with masks and evaluated on others.

mod eval;
mod part;
mod tag;
mod train;

use crate::remote_sensor::{RemoteSensorArgs, detector_process};
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_model::file::{MIB, read_text};
use mobee_sensing::detectors::file::DetectorFile;
use mobee_sensing::detectors::picture::PictureFault;
use std::path::{Path, PathBuf};

/// Maximum size of a detector file, bytes.
const MAX_DETECTOR_BYTES: u64 = 64 * MIB;

/// The commands on detectors.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum DetectorCommand {
    /// Train a detector of an object on a folder of images NAME.jpg with masks NAME_mask.png, in the order of their
    /// names. An interrupted training is continued.
    Train(train::TrainArgs),
    /// Evaluate a detector of any kind on images, with masks where there are any: Matthews' correlation, pooled over
    /// all pixels of all images, the errors of center and box, missed objects and false alarms.
    Eval(eval::EvalArgs),
    /// Show a trained detector: its cut, and its program as expressions.
    Show {
        /// The detector.
        file: PathBuf,
    },
    /// Run a sensor's detectors in a process of its own over YARP, until Ctrl-C: images come from image ports, regions
    /// and masks go to PREFIX/SENSOR/EYE/regions:o and mask:o.
    Run(RemoteSensorArgs),
    /// Make the image of a tag, for a printer or for the scenery of simulated cameras.
    Tag(tag::TagArgs),
}

/// Runs the command.
///
/// # Errors
/// If a file can't be read or written, or is invalid, with its place and the remedy.
pub fn command(command: &DetectorCommand) -> Result<(), Report> {
    let text = match command {
        DetectorCommand::Train(args) => train::command(args)?,
        DetectorCommand::Eval(args) => eval::command(args)?,
        DetectorCommand::Show { file } => show(&load(file)?),
        DetectorCommand::Tag(args) => tag::command(args)?,
        DetectorCommand::Run(args) => return detector_process::command(args),
    };
    crate::terminal::out(&text);
    Ok(())
}

fn load(path: &Path) -> Result<DetectorFile, ConfigError> {
    let text = read_text(path, MAX_DETECTOR_BYTES).map_err(|e| {
        let help = "give a detector as `mobee detector train` wrote it";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    DetectorFile::parse(&text).map_err(|e| ConfigError::plain(format!("{}: {}", path.display(), e.what), e.help))
}

/// A complaint about an image.
fn image_complaint(fault: PictureFault) -> ConfigError {
    ConfigError::plain(fault.to_string(), fault.help)
}

fn show(file: &DetectorFile) -> String {
    let edges = if file.smoothing.at_edges { ", not across edges" } else { "" };
    let open = if file.cut.open { ", opened by 3x3 pixels" } else { "" };
    let program = file.program.as_ref().map(ToString::to_string);
    format!(
        "{}, kind {}\n{}pictures made smaller by {}, output smoothed over {} pixels{edges}\nmask: at least {}{open}; regions of at least {} of the weightiest one\n",
        file.object,
        file.kind.name(),
        program.unwrap_or_else(|| "output = how likely each color is the object's\n".into()),
        file.shrink,
        2 * file.smoothing.radius + 1,
        file.cut.threshold,
        file.cut.keep
    )
}
