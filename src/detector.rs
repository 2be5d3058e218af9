//! `mobee detector`: detectors in files, learned from pictures with masks and judged by others.

mod part;
mod tag;
mod train;

use crate::config::ConfigError;
use crate::outside::{OutsideArgs, looking};
use miette::{IntoDiagnostic, Report};
use mobee_behaviors::detectors::file::DetectorFile;
use mobee_behaviors::detectors::picture::{LabeledPicture, Mask, PictureFault, read_folder};
use mobee_behaviors::detectors::score::Confusion;
use mobee_model::file::{MIB, read_text};
use serde_json::json;
use std::path::{Path, PathBuf};

/// How long a detector file may be, bytes.
const LONGEST: u64 = 64 * MIB;

/// What to do with detectors.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum DetectorCommand {
    /// Learn an object from a folder of pictures NAME.jpg with masks NAME_mask.png, in the order of their names. An interrupted
    /// training goes on where it was.
    Train(train::TrainArgs),
    /// Judge a detector by pictures with masks: Matthews' correlation, pooled over all pixels of all pictures, and how far the
    /// weightiest region's center is from the mask's.
    Eval {
        /// The detector.
        #[arg(long, value_name = "FILE")]
        detector: PathBuf,
        /// The folder of pictures NAME.jpg with masks NAME_mask.png.
        #[arg(long, value_name = "DIR")]
        images: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show what a detector has learned: how it cuts, and its program as expressions.
    Show {
        /// The detector.
        file: PathBuf,
    },
    /// Look at what the cameras of a sensor see, in a process of its own over YARP, until Ctrl-C: pictures come from image ports, regions and
    /// masks go to PREFIX/SENSOR/EYE/regions:o and mask:o.
    Run(OutsideArgs),
    /// Make the picture of a tag, for a printer or for the scenery of simulated cameras.
    Tag(tag::TagArgs),
}

/// Does it.
///
/// # Errors
/// If a file can't be read or written, or is not what it should be, with place and remedy.
pub fn command(command: &DetectorCommand) -> Result<(), Report> {
    let said = match command {
        DetectorCommand::Train(args) => train::command(args)?,
        DetectorCommand::Eval { detector, images, json } => eval(detector, images, *json)?,
        DetectorCommand::Show { file } => show(&load(file)?),
        DetectorCommand::Tag(args) => tag::command(args)?,
        DetectorCommand::Run(args) => return looking::command(args),
    };
    crate::terminal::out(&said);
    Ok(())
}

fn load(path: &Path) -> Result<DetectorFile, ConfigError> {
    let text = read_text(path, LONGEST).map_err(|e| {
        let help = "give a detector as `mobee detector train` wrote it";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    DetectorFile::parse(&text).map_err(|e| ConfigError::plain(format!("{}: {}", path.display(), e.what), e.help))
}

fn pictures(folder: &Path) -> Result<Vec<LabeledPicture>, ConfigError> {
    read_folder(folder).map_err(|e: PictureFault| ConfigError::plain(e.to_string(), e.help))
}

fn eval(detector: &Path, images: &Path, json: bool) -> Result<String, Report> {
    let file = load(detector)?;
    let pictures = pictures(images)?;
    let mut sum = Confusion::default();
    let (mut off, mut unseen) = (Vec::new(), 0usize);
    for p in &pictures {
        let (mask, blobs) = file.look(&p.picture);
        sum.add(&mask, &p.mask);
        match (middle(&p.mask), blobs.first()) {
            (Some([u, v]), Some(blob)) => off.push((blob.centroid[0] - u).hypot(blob.centroid[1] - v)),
            (Some(_), None) => unseen += 1,
            (None, _) => {}
        }
    }
    off.sort_by(f64::total_cmp);
    let [median, most] = [0.5, 0.95].map(|share| off.get((off.len() as f64 * share) as usize).copied());
    if json {
        let said = json!({
            "object": file.object, "kind": file.kind, "images": pictures.len(), "mcc": sum.mcc(),
            "center_off_pixels": { "median": median, "share_95": most }, "unseen": unseen,
            "pixels": { "hit": sum.hit, "false_alarm": sum.false_alarm, "miss": sum.miss, "rest": sum.rest },
        });
        return Ok(serde_json::to_string(&said).into_diagnostic()? + "\n");
    }
    Ok(format!(
        "{}: correlation {:.3} on {} pictures; pixels: {} hit, {} false alarms, {} missed\n{}",
        file.object,
        sum.mcc(),
        pictures.len(),
        sum.hit,
        sum.false_alarm,
        sum.miss,
        match median.zip(most) {
            Some((median, most)) => format!(
                "center of the weightiest region: off by {median:.2} pixels in the median, {most:.2} at 95 %; none in {unseen} pictures\n"
            ),
            None => "no region in any picture that shows the object\n".into(),
        }
    ))
}

/// The mean place of a mask's pixels, as regions tell it; `None` if it has none.
fn middle(mask: &Mask) -> Option<[f64; 2]> {
    let (mut u, mut v, mut count) = (0.0, 0.0, 0.0);
    for (k, _) in mask.data.iter().enumerate().filter(|(_, inside)| **inside) {
        u += (k % mask.width) as f64 + 0.5;
        v += (k / mask.width) as f64 + 0.5;
        count += 1.0;
    }
    (count > 0.0).then(|| [u / count, v / count])
}

fn show(file: &DetectorFile) -> String {
    let edges = if file.smoothing.at_edges { ", not across edges" } else { "" };
    let open = if file.cut.open { ", opened by 3x3 pixels" } else { "" };
    let kind = serde_json::to_value(file.kind).unwrap_or_default();
    let program = file.program.as_ref().map(ToString::to_string);
    format!(
        "{}, kind {}\n{}pictures made smaller by {}, output smoothed over {} pixels{edges}\nmask: at least {}{open}; regions of at least {} of the weightiest one\n",
        file.object,
        kind.as_str().unwrap_or_default(),
        program.unwrap_or_else(|| "output = how likely each color is the object's\n".into()),
        file.shrink,
        2 * file.smoothing.radius + 1,
        file.cut.threshold,
        file.cut.keep
    )
}
