//! `mobee eyes draw`.

use super::settings::DrawSettings;
use super::views::Views;
use crate::roadmap::may_write;
use crate::robot_import::Steps;
use image::{GrayImage, RgbImage};
use miette::{IntoDiagnostic, Report, miette};
use mobee_compose::config::{Complaints, ConfigError, Source};
use mobee_compose::maps::save_text;
use mobee_contract::{KindError, Time, Truth, suggestion};
use mobee_model::{Edit, Robot, Scene};
use mobee_sensing::locators::rows;
use mobee_sim::eyes::{Owner, Shot, SimulatedEye, project};
use nalgebra::Point3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum number of configurations that are tried for one image.
const MAX_DRAWS: u32 = 20_000;
/// Number of configurations after which the object is placed elsewhere.
const DRAWS_PER_PLACE: u32 = 1_000;
/// Minimum distance of the object's center from the border, as a share of the image's side.
const MIN_INSET_SHARE: f64 = 0.06;
/// Minimum number of pixels of an object in view.
const MIN_PIXELS: usize = 40;

/// Arguments of `mobee eyes draw`.
#[derive(clap::Args, Clone, Debug)]
pub struct DrawArgs {
    /// Robot XML.
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// World XML.
    #[arg(long, value_name = "FILE")]
    world: PathBuf,
    /// The object, by its name in the world.
    #[arg(long, value_name = "NAME")]
    object: String,
    /// Number of poses; each eye takes an image of each.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    count: u32,
    /// The folder to write.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Cameras, scenery, and moving motors: see docs/cameras.md.
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// The seed of all randomness.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Replace images in the folder.
    #[arg(long)]
    force: bool,
}

/// The setup that all images share.
struct RenderSetup {
    scene: Scene,
    robot: Arc<Robot>,
    settings: DrawSettings,
    /// The object's name and id.
    object: (String, u32),
    /// The motors with random positions.
    motors: Vec<usize>,
    eyes: Vec<SimulatedEye>,
}

/// Renders the images and returns their number as text.
///
/// # Errors
/// If a file can't be read or written, settings are wrong, or the object can't be seen.
pub fn command(args: &DrawArgs) -> Result<String, Report> {
    let index = args.out.join("index.csv");
    may_write(&index, args.force)?;
    let scene = mobee_compose::maps::scene(&args.robot, Some(&args.world))?;
    let robot = Arc::clone(mobee_compose::maps::robot(&scene)?);
    let (settings, source) = DrawSettings::load(args.settings.as_deref(), &robot)?;
    let complain = |e: KindError| complaints(source.as_ref(), e);
    let mut studio = RenderSetup::new(scene, robot, settings, &args.object, args.seed).map_err(complain)?;
    std::fs::create_dir_all(&args.out).map_err(|e| unwritable(&args.out, &e))?;
    let mut rng = ChaCha8Rng::seed_from_u64(args.seed);
    let mut table = studio.head();
    let mut views = Views::new(&studio.robot, studio.eyes.len());
    let bar = Steps::new();
    bar.step("takes pictures");
    for number in 0..args.count {
        bar.show(f64::from(number) / f64::from(args.count));
        let scenery = rng.random();
        studio.furnish(scenery).map_err(complain)?;
        let (truth, shots) = studio.shots(&mut rng)?;
        let name = format!("{number:04}");
        for (camera, shot) in studio.settings.camera.iter().zip(&shots) {
            save(&args.out.join(format!("{name}_{}", camera.marker)), shot, studio.object.1)?;
        }
        table += &studio.row(&name, &truth, &shots);
        if let (Some(views), Some(q)) = (&mut views, truth.poses.first()) {
            views.add(q, &shots, studio.object.1, &center(&truth.scene, &studio.object.0));
        }
    }
    save_text(&index, &table)?;
    if let Some(views) = views {
        save_text(&args.out.join("views.csv"), &rows::table(&views.known))?;
    }
    Ok(format!(
        "{}: {} pictures of {} from {} poses\n",
        args.out.display(),
        args.count as usize * studio.eyes.len(),
        args.object,
        args.count
    ))
}

/// Errors of the settings as complaints, with their places if they are from a file.
fn complaints(source: Option<&Source>, error: KindError) -> Report {
    let Some(source) = source else { return ConfigError::plain(error.what, error.help).into() };
    let mut wrong = Complaints::default();
    error.all().into_iter().for_each(|e| wrong.push(source.error(&e.path, e.what, e.help)));
    wrong.into()
}

fn unwritable(path: &Path, error: &dyn std::fmt::Display) -> Report {
    ConfigError::plain(format!("can't write {}: {error}", path.display()), "check the folder's space and permissions")
        .into()
}

impl RenderSetup {
    fn new(
        scene: Scene,
        robot: Arc<Robot>,
        settings: DrawSettings,
        name: &str,
        seed: u64,
    ) -> Result<RenderSetup, KindError> {
        let known: Vec<&str> = scene.objects().map(|(_, o)| o.name.as_str()).collect();
        let Some((id, _)) = scene.object(name) else {
            let what = format!("there is no object {name} in this world");
            return Err(KindError::new("", what, suggestion(name, "object", &known)));
        };
        if let Some([x0, x1, y0, y1]) = settings.area_m
            && !(x0 <= x1 && y0 <= y1)
        {
            let help = "give least and greatest x, then least and greatest y";
            return Err(KindError::new("area_m", "this is no area", help));
        }
        let mut eyes = Vec::new();
        for (k, camera) in settings.camera.iter().enumerate() {
            // each eye has its own noise
            let eye = SimulatedEye::new(camera, &robot, 0, seed.wrapping_add(1 + k as u64));
            eyes.push(eye.map_err(|e| e.under(&format!("camera[{k}]")))?);
        }
        let mut motors = Vec::new();
        for (k, name) in settings.motors.iter().enumerate() {
            match (robot.motor_index(name), robot.part(name)) {
                (Some(motor), _) => motors.push(motor),
                (None, Some(part)) => motors.extend(part.motors.clone()),
                (None, None) => {
                    let names: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
                    let what = format!("robot {} has no motor or part {name}", robot.name);
                    return Err(KindError::new(format!("motors[{k}]"), what, suggestion(name, "motor", &names)));
                }
            }
        }
        if settings.motors.is_empty() {
            let marker = settings.camera.first().and_then(|c| robot.marker(&c.marker));
            motors.extend(marker.map(|m| robot.movers(Some(m.node), None)).unwrap_or_default());
        }
        Ok(RenderSetup { scene, robot, settings, object: (name.into(), id), motors, eyes })
    }

    /// Changes room and light.
    fn furnish(&mut self, seed: u64) -> Result<(), KindError> {
        self.settings.scenery.seed = seed;
        let scenery = &self.settings.scenery;
        self.eyes.iter_mut().try_for_each(|eye| eye.furnish(scenery).map_err(|e| e.under("scenery")))
    }

    /// Images of all eyes at a random configuration in which they see the object.
    fn shots(&mut self, rng: &mut ChaCha8Rng) -> Result<(Truth, Vec<Shot>), Report> {
        let mut scene = Arc::new(self.scene.clone());
        for k in 0..MAX_DRAWS {
            if k % DRAWS_PER_PLACE == 0 {
                scene = Arc::new(self.placed(rng)?);
            }
            let truth = Truth { scene: Arc::clone(&scene), poses: vec![self.pose(rng).into()] };
            let center = center(&truth.scene, &self.object.0);
            let sees = |eye: &SimulatedEye| {
                let [x, y, z] = eye.at(&truth).map_or([0.0; 3], |at| at.inverse_transform_point(&center).coords.into());
                let lens = eye.intrinsics();
                let place = project(&lens, [x / z, y / z]);
                let inside =
                    |(p, n): (&f64, u32)| (MIN_INSET_SHARE..1.0 - MIN_INSET_SHARE).contains(&(p / f64::from(n)));
                // a lens model bends points far outside back into the image
                z > 0.05 && x.hypot(y) < 1.5 * z && place.iter().zip(lens.size).all(inside)
            };
            if !self.eyes.iter().all(sees) || !truth.scene.free(&truth.poses, 0.0) {
                continue;
            }
            let now = Time::from_secs(rng.random_range(0.0..1000.0));
            let shots: Result<Vec<Shot>, String> = self.eyes.iter_mut().map(|e| e.shoot(&truth, None, now)).collect();
            let shots =
                shots.map_err(|e| ConfigError::plain(e, "name objects of this world in `scenery.distractors`"))?;
            let is_mine = |o: &&Owner| **o == Owner::Object(self.object.1);
            if shots.iter().all(|s| s.owner.iter().filter(is_mine).count() >= MIN_PIXELS) {
                return Ok((truth, shots));
            }
        }
        Err(miette!(
            help = "put the object where the eyes can look, or name the motors that turn them (docs/cameras.md)",
            "of {MAX_DRAWS} random poses, none has {} in the view of all cameras",
            self.object.0
        ))
    }

    /// A random configuration of the moving motors; the others are at home.
    fn pose(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut q = self.robot.home();
        for motor in &self.motors {
            let m = &self.robot.motors[*motor];
            let q = &mut q[*motor];
            *q = rng.random_range(m.min..=m.max);
        }
        q
    }

    /// The world with the object at a random place in its area.
    fn placed(&self, rng: &mut ChaCha8Rng) -> Result<Scene, Report> {
        let scene = self.scene.clone();
        let Some(([x0, x1, y0, y1], (_, object))) = self.settings.area_m.zip(scene.object(&self.object.0)) else {
            return Ok(scene);
        };
        let mut pose = object.pose;
        (pose.translation.x, pose.translation.y) = (rng.random_range(x0..=x1), rng.random_range(y0..=y1));
        scene.edit(&Edit::Move { name: self.object.0.clone(), pose }).into_diagnostic()
    }

    /// The table's header.
    fn head(&self) -> String {
        let mut line = String::from("name");
        self.robot.motors.iter().for_each(|m| line += &format!(",{}_{}", m.name, m.motion.unit()));
        for camera in &self.settings.camera {
            let _ = write!(line, ",{0}_u,{0}_v,{0}_pixels", camera.marker);
        }
        line + ",x_m,y_m,z_m\n"
    }

    /// A row: motor positions, the pixel of the object's center and its number of pixels for each eye, and its
    /// position.
    fn row(&self, name: &str, truth: &Truth, shots: &[Shot]) -> String {
        let mut line = String::from(name);
        for q in truth.poses.iter().flat_map(|p| p.iter()) {
            let _ = write!(line, ",{:.4}", q.to_degrees());
        }
        let center = center(&truth.scene, &self.object.0);
        for shot in shots {
            let at = shot.eye.inverse_transform_point(&center);
            let [u, v] = project(&shot.frame.intrinsics, [at.x / at.z, at.y / at.z]);
            let pixels = shot.owner.iter().filter(|o| **o == Owner::Object(self.object.1)).count();
            let _ = write!(line, ",{u:.3},{v:.3},{pixels}");
        }
        line + &format!(",{:.5},{:.5},{:.5}\n", center.x, center.y, center.z)
    }
}

/// The middle of an object, in the world.
fn center(scene: &Scene, name: &str) -> Point3<f64> {
    scene.object(name).map_or_else(Point3::origin, |(_, object)| object.pose * Point3::from(object.middle()))
}

/// Writes an image and the mask of an object.
fn save(path: &Path, shot: &Shot, object: u32) -> Result<(), Report> {
    let [width, height] = shot.frame.intrinsics.size;
    let mask = shot.owner.iter().map(|o| 255 * u8::from(*o == Owner::Object(object))).collect();
    let at = |end: &str| PathBuf::from(format!("{}{end}", path.display()));
    let picture = RgbImage::from_raw(width, height, shot.frame.pixels.to_vec()).unwrap_or_default();
    picture.save(at(".png")).map_err(|e| unwritable(&at(".png"), &e))?;
    let mask = GrayImage::from_raw(width, height, mask).unwrap_or_default();
    mask.save(at("_mask.png")).map_err(|e| unwritable(&at("_mask.png"), &e))
}
