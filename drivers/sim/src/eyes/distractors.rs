//! Objects that stand on a table and resemble a target. They are rendered only: nothing touches them, and no
//! world contains them.

use super::scenery::in_range;
use super::solid::V3;
use super::texture::{any_color, from_hsv, to_hsv};
use mobee_contract::KindError;
use mobee_model::{Object, Primitive, Scene, Shape, distance};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Distractors: objects that resemble a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DistractorSettings {
    /// Number of distractors.
    pub count: u32,
    /// Object on whose first shape they stand, such as a table.
    pub on: String,
    /// Object whose color they resemble; default: none, they have random colors.
    #[serde(default)]
    pub like: Option<String>,
    /// Least and greatest difference of their hue from that object's, to either side, deg.
    #[serde(default = "hue_deg")]
    pub hue_deg: [f64; 2],
    /// Area on which they stand: least and greatest x, least and greatest y in the world, m; default: the
    /// whole object.
    #[serde(default)]
    pub area_m: Option<[f64; 4]>,
}

fn hue_deg() -> [f64; 2] {
    [15.0, 40.0]
}

/// Least distance between objects, m.
const MIN_GAP_M: f64 = 0.005;

/// An object that is only rendered.
#[derive(Clone, Debug)]
pub struct Distractor {
    /// Shape with its pose in the world.
    pub shape: Primitive,
    /// Its color, 0 to 255.
    pub color: V3,
}

impl DistractorSettings {
    /// Checks every setting.
    ///
    /// # Errors
    /// Invalid settings, with the valid ranges.
    pub fn validate(&self) -> Result<(), KindError> {
        let [least, most] = self.hue_deg;
        let [x0, x1, y0, y1] = self.area_m.unwrap_or_default();
        let ranges = [
            ("count", f64::from(self.count), 0.0, 100.0),
            ("hue_deg[0]", least, 0.0, 180.0),
            ("hue_deg[1]", most, least, 180.0),
            ("area_m[1]", x1, x0, 1e3),
            ("area_m[3]", y1, y0, 1e3),
        ];
        KindError::gather(ranges.map(in_range))?;
        Ok(())
    }

    /// Places the distractors that a scene has room for. Positions are drawn from the seed, and those that
    /// would touch an object are omitted. Deterministic for a scene and a seed.
    ///
    /// # Errors
    /// The name of an object that the scene does not have.
    pub fn stand(&self, scene: &Scene, seed: u64) -> Result<Vec<Distractor>, String> {
        let find = |name: &str| scene.object(name).map(|(_, o)| o).ok_or_else(|| name.to_owned());
        let floor = find(&self.on)?;
        let like = self.like.as_deref().map(find).transpose()?.and_then(|o| o.color);
        let others: Vec<Primitive> = scene
            .objects()
            .filter(|(_, o)| o.name != self.on)
            .flat_map(|(_, o)| o.shapes.iter().map(|s| Primitive { shape: s.shape, pose: o.pose * s.pose }))
            .collect();
        let [x0, x1, y0, y1, top] = self.area(floor);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0d15_7ac7);
        let mut standing: Vec<Distractor> = Vec::new();
        for _ in 0..self.count {
            let at = [rng.random_range(x0..=x1), rng.random_range(y0..=y1), top];
            let shape = standing_at(at, &mut rng);
            let color = self.color(like, &mut rng);
            let taken = |p: &Primitive| touches(p, &shape);
            if !others.iter().any(taken) && !standing.iter().any(|d| taken(&d.shape)) {
                standing.push(Distractor { shape, color });
            }
        }
        Ok(standing)
    }

    /// Area on which they may stand, with its height.
    fn area(&self, on: &Object) -> [f64; 5] {
        let Some(first) = on.shapes.first() else { return [0.0; 5] };
        let pose = on.pose * first.pose;
        let half = match first.shape {
            Shape::Box { size } => pose.rotation.to_rotation_matrix().matrix().abs() * (size / 2.0),
            other => Vector3::repeat(other.bounding_radius()),
        };
        let (low, high) = (pose.translation.vector - half, pose.translation.vector + half);
        let inset = 0.06;
        let [x0, x1, y0, y1] = self.area_m.unwrap_or([f64::MIN, f64::MAX, f64::MIN, f64::MAX]);
        let within = |least: f64, most: f64, low: f64, high: f64| {
            let (a, b) = (least.max(low + inset), most.min(high - inset));
            if a <= b { [a, b] } else { [(low + high) / 2.0; 2] }
        };
        let ([x0, x1], [y0, y1]) = (within(x0, x1, low.x, high.x), within(y0, y1, low.y, high.y));
        [x0, x1, y0, y1, high.z]
    }

    fn color(&self, like: Option<[u8; 3]>, rng: &mut ChaCha8Rng) -> V3 {
        let any = any_color(rng);
        let [least, most] = self.hue_deg.map(|d| d as f32);
        let away = rng.random_range(least..=most);
        let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let dull = rng.random_range(0.7..1.1f32);
        let bright = rng.random_range(0.6..1.2f32);
        let Some(color) = like else { return any };
        let [hue, saturation, value] = to_hsv(V3::from(color.map(f32::from)));
        from_hsv(hue + side * away, (saturation * dull).min(1.0), (value * bright).min(255.0))
    }
}

/// A ball, a can or a box of common size, on its lower side.
fn standing_at(at: [f64; 3], rng: &mut ChaCha8Rng) -> Primitive {
    let mut size = |least: f64, most: f64| rng.random_range(least..most);
    let a = size(0.02, 0.06);
    let b = size(0.05, 0.14);
    let c = size(0.02, 0.06);
    let turn = size(0.0, 3.0);
    let (shape, height) = match rng.random_range(0..3u32) {
        0 => (Shape::Sphere { radius: a }, a),
        1 => (Shape::Cylinder { radius: a, height: b }, b / 2.0),
        _ => (Shape::Box { size: Vector3::new(2.0 * a, b, 2.0 * c) }, b / 2.0),
    };
    // shapes stand along y, the world along z
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn) * upright;
    let [x, y, z] = at;
    Primitive { shape, pose: Isometry3::from_parts(Translation3::new(x, y, z + height), turned) }
}

fn touches(a: &Primitive, b: &Primitive) -> bool {
    let between = (a.pose.translation.vector - b.pose.translation.vector).norm();
    between < a.shape.bounding_radius() + b.shape.bounding_radius() + MIN_GAP_M
        && distance(&a.shape, &a.pose, &b.shape, &b.pose).distance < MIN_GAP_M
}
