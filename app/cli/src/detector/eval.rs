//! `mobee detector eval`: evaluates a detector of any kind on images.

use super::{image_complaint, load};
use miette::{IntoDiagnostic, Report};
use mobee_compose::compose;
use mobee_compose::config::{Config, ConfigError, simulated, suggestion};
use mobee_contract::{Detector, Frame, Intrinsics, Region, Time};
use mobee_sensing::detectors::kinds::LearnedDetector;
use mobee_sensing::detectors::picture::{FolderPicture, Mask, Picture, read_pictures};
use mobee_sensing::detectors::score::Confusion;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Arguments of `mobee detector eval`.
#[derive(clap::Args, Clone, Debug)]
pub struct EvalArgs {
    /// The detector: a file of `mobee detector train`, or a behavior FILE.toml with a sensor, of any kind.
    #[arg(long, value_name = "FILE")]
    detector: PathBuf,
    /// The detector of a behavior, if its cameras have several: SENSOR or SENSOR/CAMERA.
    #[arg(long, value_name = "NAME")]
    sensor: Option<String>,
    /// The object that the masks show, if the detector has several.
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
    /// The folder of images NAME.jpg with masks NAME_mask.png; images without a mask only count detections.
    #[arg(long, value_name = "DIR")]
    images: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A detector and its kind's name.
struct EvaluatedDetector {
    detector: Box<dyn Detector>,
    kind: String,
}

/// Evaluates the detector on all images, and returns the result as text.
///
/// # Errors
/// If detector or images can't be read, or no mask can be compared with its output.
pub fn command(args: &EvalArgs) -> Result<String, Report> {
    let mut judged = EvaluatedDetector::read(args)?;
    let objects = judged.detector.objects();
    let object = object(&objects, args)?;
    let pictures = read_pictures(&args.images).map_err(image_complaint)?;
    let mut tally = Tally::default();
    for picture in &pictures {
        tally.look(judged.detector.as_mut(), &objects, &object, picture)?;
    }
    if tally.masks == 0 && tally.tells_pixels {
        let what = format!("{}: no picture has a mask, so there is nothing to judge pixels by", args.images.display());
        let help = "add NAME_mask.png beside NAME.jpg, white where the object is";
        return Err(ConfigError::plain(what, help).into());
    }
    if args.json {
        return Ok(serde_json::to_string(&tally.json(&object, &judged.kind)).into_diagnostic()? + "\n");
    }
    Ok(tally.text(&object, &judged.kind))
}

/// The object that the masks show.
fn object(objects: &[String], args: &EvalArgs) -> Result<String, ConfigError> {
    let mut names: Vec<&str> = objects.iter().map(String::as_str).collect();
    names.sort_unstable();
    names.dedup();
    match (&args.object, names.as_slice()) {
        (Some(name), known) if known.is_empty() || known.contains(&name.as_str()) => Ok(name.clone()),
        (Some(name), known) => {
            let what = format!("{} tells of no object `{name}`", args.detector.display());
            Err(ConfigError::plain(what, suggestion(name, "object", known)))
        }
        (None, [one]) => Ok((*one).to_owned()),
        (None, known) => {
            let what = format!("which object of {} do the masks show?", args.detector.display());
            Err(ConfigError::plain(what, format!("give --object; there are: {}", known.join(", "))))
        }
    }
}

impl EvaluatedDetector {
    fn read(args: &EvalArgs) -> Result<EvaluatedDetector, Report> {
        if args.detector.extension().is_some_and(|e| e == "toml") {
            return EvaluatedDetector::of_behavior(&args.detector, args.sensor.as_deref());
        }
        if args.sensor.is_some() {
            let what = format!("{} is one detector, and no behavior", args.detector.display());
            return Err(ConfigError::plain(what, "leave out --sensor, or give the behavior FILE.toml").into());
        }
        let file = load(&args.detector)?;
        let kind = file.kind.name().into();
        Ok(EvaluatedDetector { detector: Box::new(LearnedDetector::new(file)), kind })
    }

    fn of_behavior(path: &Path, wanted: Option<&str>) -> Result<EvaluatedDetector, Report> {
        let (mut config, source) = Config::load(path, &[])?;
        // no board may be touched
        config.robot.iter_mut().for_each(|robot| robot.driver = simulated());
        let all: Vec<(String, Value)> = config.detectors().map(|(name, table)| (name, table.clone())).collect();
        let is_meant =
            |name: &str| wanted.is_none_or(|w| w == name || name.split_once('/').is_some_and(|(s, _)| s == w));
        let mut meant = all.iter().enumerate().filter(|(_, (name, _))| is_meant(name));
        let names = || all.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>();
        let Some((at, (_, table))) = meant.next() else {
            let file = path.display();
            return Err(match wanted.filter(|_| !all.is_empty()) {
                Some(name) => {
                    let what = format!("there is no sensor or camera `{name}` in {file}");
                    ConfigError::plain(what, format!("there are: {}", names().join(", ")))
                }
                None => ConfigError::plain(format!("{file} has no sensor"), "give a behavior with a table [[sensor]]"),
            }
            .into());
        };
        if meant.any(|(_, (_, other))| other != table) {
            let help = format!("give --sensor; there are: {}", names().join(", "));
            return Err(ConfigError::plain(format!("which detector of {}?", path.display()), help).into());
        }
        let kind = table["kind"].as_str().unwrap_or_default().to_owned();
        let composition = compose(config, &source)?;
        let maker = composition.sensors.into_iter().flat_map(|s| s.cameras).nth(at).map(|camera| camera.detector);
        let maker = maker.ok_or_else(|| Report::msg("the sensor could not be built"))?;
        Ok(EvaluatedDetector { detector: maker().map_err(Report::msg)?, kind })
    }
}

/// Counts of detections and of the truth.
#[derive(Default)]
struct Tally {
    images: usize,
    /// Images with a mask.
    masks: usize,
    /// Images in which the object was detected.
    told: usize,
    /// Images that show the object, without a detection.
    image_complaint: usize,
    /// Images that don't show the object, with a detection.
    false_alarms: usize,
    /// Errors of the first region: of its center, and of the worst side of its box, pixels.
    off: [Vec<f64>; 2],
    tells_pixels: bool,
    pixels: Confusion,
}

impl Tally {
    fn look(
        &mut self,
        detector: &mut dyn Detector,
        objects: &[String],
        object: &str,
        (name, picture, truth): &FolderPicture,
    ) -> Result<(), ConfigError> {
        let regions = detector.detect(&frame(picture));
        if let Some(why) = detector.failure() {
            return Err(ConfigError::plain(format!("{name}: the detector fails: {why}"), "repair the detector"));
        }
        if let Some(what) = detector.complaint() {
            eprintln!("warning: {name}: {}", mobee_model::printable(&what));
        }
        let region = regions.iter().find(|r| r.object == object);
        let mask = detector.mask();
        self.images += 1;
        self.told += usize::from(region.is_some());
        self.tells_pixels |= mask.is_some();
        let Some(truth) = truth else { return Ok(()) };
        self.masks += 1;
        self.place(region, truth);
        if let Some(mask) = mask {
            // a detector that does not list its objects has one
            let is_object =
                |n: &u8| n.checked_sub(1).is_some_and(|k| objects.get(usize::from(k)).is_none_or(|o| o == object));
            let data = mask.objects.iter().map(is_object).collect();
            self.pixels.add(&Mask { width: picture.width, height: picture.height, data }, truth);
        }
        Ok(())
    }

    fn place(&mut self, region: Option<&Region>, truth: &Mask) {
        match (truth.middle_and_box(), region) {
            (Some(([u, v], bounds)), Some(region)) => {
                let side = |(a, b): (&f64, &f64)| (a - b).abs();
                self.off[0].push((region.center[0] - u).hypot(region.center[1] - v));
                self.off[1].push(region.bounds.iter().zip(&bounds).map(side).fold(0.0, f64::max));
            }
            (Some(_), None) => self.image_complaint += 1,
            (None, Some(_)) => self.false_alarms += 1,
            (None, None) => {}
        }
    }

    /// Median and 95 % quantile of the errors of centers and boxes.
    fn quantiles(&self) -> [[Option<f64>; 2]; 2] {
        self.off.each_ref().map(|off| {
            let mut sorted = off.clone();
            sorted.sort_by(f64::total_cmp);
            [0.5, 0.95].map(|share| sorted.get((sorted.len() as f64 * share) as usize).copied())
        })
    }

    /// Matthews' correlation, if the detector reports pixels and there are masks.
    fn mcc(&self) -> Option<f64> {
        (self.tells_pixels && self.masks > 0).then(|| self.pixels.mcc())
    }

    fn json(&self, object: &str, kind: &str) -> Value {
        let [center, corners] = self.quantiles().map(|[median, most]| json!({ "median": median, "share_95": most }));
        json!({
            "object": object, "kind": kind, "images": self.images, "masks": self.masks, "mcc": self.mcc(),
            "center_off_pixels": center, "box_off_pixels": corners,
            "told": self.told, "unseen": self.image_complaint, "false_alarms": self.false_alarms,
            "pixels": self.mcc().map(|_| self.pixels),
        })
    }

    fn text(&self, object: &str, kind: &str) -> String {
        let mut text = format!(
            "{object}, kind {kind}: told in {} of {} pictures, {} with masks\n",
            self.told, self.images, self.masks
        );
        if let Some(mcc) = self.mcc() {
            let Confusion { hit, false_alarm, miss, .. } = self.pixels;
            text += &format!("correlation {mcc:.3}; pixels: {hit} hit, {false_alarm} false alarms, {miss} missed\n");
        }
        if let [[Some(center), Some(center_most)], [Some(side), Some(side_most)]] = self.quantiles() {
            text += &format!(
                "of the first region, off in the median and at 95 %: center {center:.2} and {center_most:.2} pixels, box {side:.2} and \
                 {side_most:.2}\n"
            );
        }
        if self.masks > 0 {
            text += &format!(
                "not told in {} pictures that show it, told in {} that don't\n",
                self.image_complaint, self.false_alarms
            );
        }
        text
    }
}

/// An image as a camera's frame. The lens of a file is unknown, and pixels do not depend on it.
fn frame(picture: &Picture) -> Frame {
    let size = [picture.width, picture.height];
    let focal = [size[1] as f64; 2];
    let center = size.map(|n| n as f64 / 2.0);
    let intrinsics = Intrinsics { size: size.map(|n| n as u32), focal, center, distortion: [0.0; 4] };
    Frame { exposed: Time::ZERO, intrinsics, pixels: picture.rgb.clone().into() }
}
