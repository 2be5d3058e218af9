//! Surroundings of robots and objects: a room, its lamp, textures, and distractors. All of it is drawn from
//! one seed, so that several cameras see the same.

use super::distractors::DistractorSettings;
use super::picture;
use super::solid::V3;
use super::sticker::{Sticker, StickerSettings};
use super::texture::{Texture, any_color, from_hsv};
use mobee_contract::KindError;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Surroundings of robots and objects. Cameras in one world have the same scenery.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScenerySettings {
    /// Seed of colors, textures, lamp and distractors.
    pub seed: u64,
    /// An image (JPEG or PNG), or a folder of them, for the walls; default: generated ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("format" = "path"))]
    pub pictures: Option<PathBuf>,
    /// Contrast of textures, 0 (plain colors) to 1.
    pub texture: f64,
    /// Height of the floor in the world, m.
    pub floor_m: f64,
    /// Width, depth and height of the room around the robot, m.
    pub room_m: [f64; 3],
    /// Position of the lamp relative to the robot's base, m; default: random, 1.1 to 1.7 m above it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamp_m: Option<[f64; 3]>,
    /// Brightness of the light; default: random, 0.8 to 1.15.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brightness: Option<f64>,
    /// True if objects cast shadows.
    pub shadows: bool,
    /// Distractors, which resemble an object; default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distractors: Option<DistractorSettings>,
    /// Images on boxes of the world, such as tags.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stickers: Vec<StickerSettings>,
}

impl Default for ScenerySettings {
    fn default() -> ScenerySettings {
        ScenerySettings {
            seed: 0,
            pictures: None,
            texture: 0.5,
            floor_m: -0.8,
            room_m: [4.0, 4.0, 2.8],
            lamp_m: None,
            brightness: None,
            shadows: true,
            distractors: None,
            stickers: Vec::new(),
        }
    }
}

impl ScenerySettings {
    /// Checks every setting.
    ///
    /// # Errors
    /// Invalid settings, with the valid ranges.
    pub fn validate(&self) -> Result<(), KindError> {
        let lamp = self.lamp_m.unwrap_or_default();
        let [width, depth, height] = self.room_m;
        let ranges = [
            ("texture", self.texture, 0.0, 1.0),
            ("floor_m", self.floor_m, -10.0, 10.0),
            ("room_m[0]", width, 1.0, 100.0),
            ("room_m[1]", depth, 1.0, 100.0),
            ("room_m[2]", height, 1.0, 100.0),
            ("lamp_m[0]", lamp[0], -50.0, 50.0),
            ("lamp_m[1]", lamp[1], -50.0, 50.0),
            ("lamp_m[2]", lamp[2], -50.0, 50.0),
            ("brightness", self.brightness.unwrap_or(1.0), 0.0, 4.0),
        ];
        let mut checks: Vec<Result<(), KindError>> = ranges.into_iter().map(in_range).collect();
        let stickers = self.stickers.iter().enumerate();
        checks.extend(stickers.map(|(k, s)| s.validate().map_err(|e| e.under(&format!("stickers[{k}]")))));
        checks.extend(self.distractors.as_ref().map(|d| d.validate().map_err(|e| e.under("distractors"))));
        KindError::gather(checks)?;
        Ok(())
    }
}

/// Checks that a setting is within its range.
pub fn in_range((name, value, least, most): (&str, f64, f64, f64)) -> Result<(), KindError> {
    // written so that NaN fails
    if value >= least && value <= most {
        return Ok(());
    }
    let help = format!("give a number from {least} to {most}");
    Err(KindError::new(name, format!("{value} is not a usable value here"), help))
}

/// A room, its light and its textures.
pub struct Scenery {
    /// The settings.
    pub settings: ScenerySettings,
    /// Textures of the six inner faces of the room: least and greatest x, y and z.
    pub walls: [Texture; 6],
    /// Texture of large boxes such as tables, which multiplies their colors.
    pub wood: Texture,
    /// Pixels of the wood's texture per meter.
    pub wood_scale: f32,
    /// Position of the lamp relative to the robot's base, meters.
    pub lamp: [f64; 3],
    /// Color and strength of the lamp, and of the ambient light.
    pub light: [V3; 2],
    /// Images on boxes.
    pub stickers: Vec<Sticker>,
}

impl Scenery {
    /// Draws the scenery from the settings and their seed.
    ///
    /// # Errors
    /// An invalid setting, or an image that can't be read.
    pub fn new(settings: &ScenerySettings) -> Result<Scenery, KindError> {
        settings.validate()?;
        let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
        let contrast = settings.texture as f32;
        let stickers = settings.stickers.iter().enumerate();
        let stickers = stickers.map(|(k, s)| s.read().map_err(|e| e.under(&format!("stickers[{k}]"))));
        let stickers = KindError::gather(stickers)?;
        let hung = match &settings.pictures {
            Some(path) => picture::textures(path, 6, &mut rng)?,
            None => Vec::new(),
        };
        let mut hung = hung.into_iter();
        let walls = std::array::from_fn(|k| {
            let paint =
                from_hsv(rng.random_range(0.0..360.0), rng.random_range(0.0..0.3), rng.random_range(110.0..230.0));
            let drawn = match k {
                4 if rng.random_bool(0.5) => Texture::tiles(any_color(&mut rng) * 0.6, contrast, &mut rng),
                4 | 5 => Texture::rough(paint * 0.8, contrast, &mut rng),
                _ => Texture::clutter(paint, contrast, &mut rng),
            };
            hung.next().unwrap_or(drawn)
        });
        let [x, y] = [0; 2].map(|_: u32| rng.random_range(-0.9..0.9));
        let drawn = [x, y, rng.random_range(1.1..1.7)];
        let bright = rng.random_range(0.8..1.15f32);
        let ambient = rng.random_range(0.4..0.65f32);
        let bright = settings.brightness.map_or(bright, |b| b as f32);
        let warm = rng.random_range(-0.08..0.08f32);
        let lamp_color = V3::new(1.0 + warm, 1.0, 1.0 - warm) * (bright * (1.1 - ambient));
        Ok(Scenery {
            settings: settings.clone(),
            walls,
            wood: Texture::wood(contrast * 0.5, &mut rng),
            wood_scale: rng.random_range(250.0..700.0),
            lamp: settings.lamp_m.unwrap_or(drawn),
            light: [lamp_color, V3::new(bright * ambient, bright * ambient, bright * ambient)],
            stickers,
        })
    }
}
