//! `mobee detector train`.

use super::part::{TrainingPart, digest};
use crate::roadmap::may_write;
use crate::robot_import::Steps;
use miette::{Report, miette};
use mobee_compose::config::ConfigError;
use mobee_compose::maps::save_text;
use mobee_contract::check_object_name;
use mobee_sensing::detectors::cgp::Evolution;
use mobee_sensing::detectors::file::DetectorKind;
use mobee_sensing::detectors::picture::read_folder;
use mobee_sensing::detectors::train::{Lessons, TrainFault};
use std::path::PathBuf;
use std::time::Instant;

/// Generations if no time is given: the same seed then gives the same detector.
const GENERATIONS: u64 = 40;
/// Interval at which the state of the evolution is stored, seconds.
const NOTED_S: f64 = 10.0;

/// Arguments of `mobee detector train`.
#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// The folder of images NAME.jpg with masks NAME_mask.png.
    #[arg(long, value_name = "DIR")]
    images: PathBuf,
    /// The detector to write. An unfinished training is in FILE.part.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The kind of detector: `color` (seconds) or `cgp` (as long as you let it).
    #[arg(long, value_parser = kind, default_value = "cgp")]
    kind: DetectorKind,
    /// The object's name; default: the folder's.
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
    /// Duration of the evolution, minutes; default: forty generations.
    #[arg(long, value_name = "M", value_parser = minutes)]
    minutes: Option<f64>,
    /// The seed of all randomness.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Replace the detector if it exists.
    #[arg(long)]
    force: bool,
    /// Stop after this many generations, as an interrupt would.
    #[arg(long, value_name = "N", hide = true)]
    stop_after: Option<u64>,
}

fn kind(text: &str) -> Result<DetectorKind, String> {
    match text {
        "color" => Ok(DetectorKind::Color),
        "cgp" => Ok(DetectorKind::Cgp),
        _ => Err("give `color` or `cgp`".into()),
    }
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse().ok().filter(|m| (0.0..=100_000.0).contains(m));
    minutes.ok_or_else(|| "give a number of minutes from 0 to 100000".into())
}

/// Trains the detector and reports its correlation on images that were held out.
///
/// # Errors
/// If images can't be read or are insufficient, the unfinished training is of others, or a file can't be written.
#[expect(clippy::disallowed_methods, reason = "how long a training takes is asked for in real time")]
pub fn command(args: &TrainArgs) -> Result<String, Report> {
    may_write(&args.out, args.force)?;
    if args.kind == DetectorKind::Color && args.minutes.is_some() {
        return Err(miette!(help = "leave out --minutes, or give --kind cgp", "the kind `color` does not evolve"));
    }
    let bar = Steps::new();
    bar.step("reads pictures");
    let pictures = read_folder(&args.images).map_err(super::image_complaint)?;
    let folder = args.images.canonicalize().ok().and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned()));
    let object = args.object.clone().or(folder).unwrap_or_else(|| "object".into());
    if let Err(why) = check_object_name(&object) {
        return Err(
            ConfigError::plain(format!("the object's name {why}"), "give its name in the world by --object").into()
        );
    }
    bar.step("learns colors");
    let fault = |e: TrainFault| {
        let help = "give at least 4 pictures of a sequence, better 20, with the object in every stretch of it";
        ConfigError::plain(format!("{}: {e}", args.images.display()), help)
    };
    let lessons = Lessons::new(&pictures, &object, args.seed).map_err(fault)?;
    let (file, mcc, evolved) = match args.kind {
        DetectorKind::Color => {
            let (file, mcc) = lessons.color();
            (file, mcc, String::new())
        }
        DetectorKind::Cgp => {
            let mut part = TrainingPart::open(&args.out, digest(&pictures, args.seed))?;
            bar.step("learns surroundings");
            let mut progress = |share| bar.show(share);
            let (network, inputs) = lessons.network(&pictures, &mut progress).map_err(fault)?;
            let mut evolution = match part.state.take() {
                Some(state) => Evolution::resume(inputs, lessons.masks(), state),
                None => Evolution::new(inputs, lessons.masks(), args.seed),
            };
            bar.step("evolves programs");
            let began = Instant::now();
            let before = part.seconds;
            let mut noted = 0.0;
            loop {
                let now = began.elapsed().as_secs_f64();
                let generation = evolution.state().generation;
                let share = match args.minutes {
                    Some(m) => (before + now) / (60.0 * m).max(1e-9),
                    None => generation as f64 / GENERATIONS as f64,
                };
                if share >= 1.0 {
                    break;
                }
                bar.show(share);
                if args.stop_after.is_some_and(|most| generation >= most) {
                    part.note(evolution.state(), before + now)?;
                    return Ok(format!("stopped after {generation} generations; the same command goes on\n"));
                }
                evolution.advance();
                if now - noted > NOTED_S {
                    noted = now;
                    part.note(evolution.state(), before + now)?;
                }
            }
            let (file, mcc) = lessons.finish_cgp(&network, &evolution);
            let nodes = evolution.best().active().iter().filter(|a| **a).count();
            let generations = evolution.state().generation;
            part.remove()?;
            (file, mcc, format!("; {generations} generations, the best program has {nodes} active nodes"))
        }
    };
    if mcc <= 0.0 {
        return Err(miette!(
            help = "check that the masks are of these pictures, white where the object is",
            "nothing was learned: on pictures left out, masks agree with the truth no better than by chance"
        ));
    }
    save_text(&args.out, &file.text())?;
    Ok(format!(
        "{}: {object}, from {} pictures; correlation on stretches of them that were left out: {mcc:.3}{evolved}\n",
        args.out.display(),
        pictures.len()
    ))
}
