//! A random scene to reach in: where the cup is, what stands about it, and how far the cameras are from where they are thought to be.

use miette::{Report, miette};
use mobee_model::{Edit, Object, ObjectClass, Primitive, Scene, Shape};
use nalgebra::{Isometry3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::FRAC_PI_2;

/// Where the cup's middle may be on the table of `configs/worlds/reach.xml`, meters.
const CUP: [[f64; 2]; 2] = [[-0.48, -0.26], [-0.10, 0.26]];
/// Where obstacles may stand, meters.
const AREA: [[f64; 2]; 2] = [[-0.60, -0.20], [-0.25, 0.45]];
/// The table's top and the cup's middle over it, meters.
const TOP: f64 = -0.15;
const MIDDLE: f64 = -0.10;
/// Obstacles at most; their radius and height, meters; how near to the cup's middle none stands.
const OBSTACLES: usize = 5;
const RADIUS: [f64; 2] = [0.012, 0.035];
const HEIGHT: [f64; 2] = [0.08, 0.34];
const APART: f64 = 0.09;
/// What a robot at home keeps from all of them, meters.
const CLEARANCE: f64 = 0.02;
/// Draws of an obstacle before there are fewer.
const TRIES: usize = 200;
/// The object's name in the world.
pub(super) const CUP_NAME: &str = "cup";

/// What is drawn of a seed.
#[derive(Clone, Debug)]
pub(super) struct ReachScene {
    /// The cup's middle in truth, meters.
    pub cup: [f64; 3],
    /// What stands about it.
    pub posts: Vec<Object>,
    /// How the two cameras are turned in truth, deg about their axes.
    pub turned: [[f64; 3]; 2],
    /// The world with all of it.
    pub truth: Scene,
}

impl ReachScene {
    /// The scene of a seed, in a world whose robots are at home, free of everything.
    ///
    /// # Errors
    /// If the world has no cup.
    pub fn new(seed: u64, offset_deg: f64, world: &Scene) -> Result<ReachScene, Report> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut within = |[from, to]: [f64; 2]| rng.random_range(from..=to);
        let cup = [within(CUP[0]), within(CUP[1]), MIDDLE];
        let o = offset_deg;
        let turned = [0, 1].map(|_| [0, 1, 2].map(|_| if o > 0.0 { within([-o, o]) } else { 0.0 }));
        let count = (within([0.0, OBSTACLES as f64 + 1.0]) as usize).min(OBSTACLES);
        let pose = Isometry3::translation(cup[0], cup[1], cup[2]);
        let mut truth = edited(world, &Edit::Move { name: CUP_NAME.to_owned(), pose })?;
        let mut posts = Vec::new();
        for _ in 0..TRIES {
            if posts.len() == count {
                break;
            }
            let [x, y] = AREA.map(&mut within);
            let post = post(posts.len(), [x, y], within(RADIUS), within(HEIGHT));
            let with = edited(&truth, &Edit::Add(post.clone()))?;
            let is_clear = (x - cup[0]).hypot(y - cup[1]) >= APART;
            if is_clear && (0..with.robots().len()).all(|r| with.robot_free(r, &with.home(), CLEARANCE)) {
                truth = with;
                posts.push(post);
            }
        }
        Ok(ReachScene { cup, posts, turned, truth })
    }
}

fn edited(scene: &Scene, edit: &Edit) -> Result<Scene, Report> {
    scene.edit(edit).map_err(|e| miette!("{e}"))
}

/// An upright capsule on the table.
fn post(number: usize, [x, y]: [f64; 2], radius: f64, height: f64) -> Object {
    let shape = Shape::Capsule { radius, height: height - 2.0 * radius };
    let upright = Isometry3::rotation(Vector3::x() * FRAC_PI_2);
    Object {
        name: format!("post{number}"),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: Isometry3::translation(x, y, TOP + height / 2.0),
        shapes: vec![Primitive { shape, pose: upright }],
        color: Some([90, 120, 160]),
    }
}
