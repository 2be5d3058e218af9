//! A random scene for a reach: the cup, the posts around it, and the errors of the cameras' poses.

use miette::{Report, miette};
use mobee_contract::suggestion;
use mobee_model::{Edit, Object, ObjectClass, Primitive, Scene, Shape};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::FRAC_PI_2;

/// Maximum number of obstacles.
const MAX_OBSTACLES: usize = 5;
/// Radius of obstacles, meters.
const RADIUS_M: [f64; 2] = [0.012, 0.035];
/// Height of obstacles, meters.
const HEIGHT_M: [f64; 2] = [0.08, 0.34];
/// Minimum distance of obstacles from the cup's middle, meters.
const MIN_CUP_DISTANCE_M: f64 = 0.09;
/// Clearance of a robot at home from all of them, meters.
const CLEARANCE_M: f64 = 0.02;
/// Maximum number of draws of obstacles.
const MAX_DRAWS: usize = 200;
/// Minimum distance by which the cup moves, meters.
const MIN_MOVE_M: f64 = 0.06;
/// Distance of the moved post from the cup's new position, meters.
const BESIDE_M: [f64; 2] = [0.10, 0.16];
/// The object's name in the world.
pub(super) const CUP_NAME: &str = "cup";

/// Minimum and maximum x, minimum and maximum y, meters.
pub(super) type Area = [[f64; 2]; 2];

/// Areas on the table.
#[derive(Clone, Copy, Debug)]
pub(super) struct Areas {
    /// The cup's middle.
    pub cup: Area,
    /// The posts.
    pub posts: Area,
}

/// A drawn scene.
#[derive(Clone, Debug)]
pub(super) struct ReachScene {
    /// The cup's true middle, meters.
    pub cup: [f64; 3],
    /// The posts.
    pub posts: Vec<Object>,
    /// Rotation errors of the cameras, deg about their axes.
    pub turned: Vec<[f64; 3]>,
    /// The moves during the reach, if any.
    pub moved: Option<Moved>,
    /// The final true world.
    pub truth: Scene,
}

/// The moves during a reach.
#[derive(Clone, Debug)]
pub(super) struct Moved {
    /// The cup's new middle, meters.
    pub cup: [f64; 3],
    /// The cup's orientation, which is unchanged.
    pub upright: UnitQuaternion<f64>,
    /// A post's name and new pose.
    pub post: Option<(String, Isometry3<f64>)>,
}

impl ReachScene {
    /// Draws the scene of a seed, in a world whose robots are at home and touch nothing. The cup stands as high as in
    /// the file, and the posts on the same surface. `cameras` cameras have errors of up to `offset_deg`.
    ///
    /// # Errors
    /// If the world has no cup.
    pub fn new(
        seed: u64,
        (cameras, offset_deg): (usize, f64),
        moving: bool,
        areas: &Areas,
        world: &Scene,
    ) -> Result<ReachScene, Report> {
        let (_, stands) = world.object(CUP_NAME).ok_or_else(|| no_cup(world))?;
        let middle = stands.pose.translation.z;
        let top = middle - stands.extent(&(stands.pose.rotation.inverse() * -Vector3::z()));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut within = |[from, to]: [f64; 2]| rng.random_range(from..=to);
        let cup = [within(areas.cup[0]), within(areas.cup[1]), middle];
        let o = offset_deg;
        let mut turned = |_| [0, 1, 2].map(|_| if o > 0.0 { within([-o, o]) } else { 0.0 });
        let turned = (0..cameras).map(&mut turned).collect();
        let count = (within([0.0, MAX_OBSTACLES as f64 + 1.0]) as usize).min(MAX_OBSTACLES);
        let pose = Isometry3::translation(cup[0], cup[1], cup[2]);
        let mut truth = edited(world, &Edit::Move { name: CUP_NAME.to_owned(), pose })?;
        let mut posts = Vec::new();
        for _ in 0..MAX_DRAWS {
            if posts.len() == count {
                break;
            }
            let [x, y] = areas.posts.map(&mut within);
            let post = post(posts.len(), [x, y, top], within(RADIUS_M), within(HEIGHT_M));
            let with = edited(&truth, &Edit::Add(post.clone()))?;
            let is_clear = (x - cup[0]).hypot(y - cup[1]) >= MIN_CUP_DISTANCE_M;
            if is_clear && (0..with.robots().len()).all(|r| with.robot_free(r, &with.home(), CLEARANCE_M)) {
                truth = with;
                posts.push(post);
            }
        }
        let mut drawn = ReachScene { cup, posts, turned, moved: None, truth };
        if moving {
            drawn.moved = drawn.moved(&mut rng, &areas.cup);
            drawn.truth = drawn.moved.iter().try_fold(drawn.truth, |truth, moved| moved.apply(&truth))?;
        }
        Ok(drawn)
    }

    /// The cup's final middle, meters.
    pub fn cup_at_last(&self) -> [f64; 3] {
        self.moved.as_ref().map_or(self.cup, |moved| moved.cup)
    }

    /// Moves the cup, and the first post beside it; `None` if there is no room.
    fn moved(&self, rng: &mut ChaCha8Rng, area: &Area) -> Option<Moved> {
        let far = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let stands = |post: &Object| [post.pose.translation.x, post.pose.translation.y];
        let upright = self.truth.object(CUP_NAME)?.1.pose.rotation;
        for _ in 0..MAX_DRAWS {
            let to = area.map(|[from, to]| rng.random_range(from..=to));
            let turn = rng.random_range(0.0..=std::f64::consts::TAU);
            let off = rng.random_range(BESIDE_M[0]..=BESIDE_M[1]);
            let beside = [to[0] + off * turn.cos(), to[1] + off * turn.sin()];
            let is_elsewhere = far(to, [self.cup[0], self.cup[1]]) >= MIN_MOVE_M;
            let is_clear = self.posts.iter().skip(1).all(|post| far(to, stands(post)) >= MIN_CUP_DISTANCE_M);
            if !is_elsewhere || !is_clear {
                continue;
            }
            let post = self.posts.first().map(|post| {
                let mut pose = post.pose;
                (pose.translation.x, pose.translation.y) = (beside[0], beside[1]);
                (post.name.clone(), pose)
            });
            let moved = Moved { cup: [to[0], to[1], self.cup[2]], upright, post };
            let with = moved.apply(&self.truth).ok()?;
            if (0..with.robots().len()).all(|r| with.robot_free(r, &with.home(), CLEARANCE_M)) {
                return Some(moved);
            }
        }
        None
    }
}

impl Moved {
    /// The world after the moves.
    fn apply(&self, scene: &Scene) -> Result<Scene, Report> {
        let [x, y, z] = self.cup;
        let pose = Isometry3::from_parts(nalgebra::Translation3::new(x, y, z), self.upright);
        let scene = edited(scene, &Edit::Move { name: CUP_NAME.to_owned(), pose })?;
        match &self.post {
            Some((name, pose)) => edited(&scene, &Edit::Move { name: name.clone(), pose: *pose }),
            None => Ok(scene),
        }
    }
}

fn no_cup(world: &Scene) -> Report {
    let known: Vec<&str> = world.objects().map(|(_, o)| o.name.as_str()).collect();
    let help = suggestion(CUP_NAME, "object", &known);
    miette!(help = help, "the world of the behavior has no `{CUP_NAME}`, which is what is reached for here")
}

fn edited(scene: &Scene, edit: &Edit) -> Result<Scene, Report> {
    scene.edit(edit).map_err(|e| miette!("{e}"))
}

/// An upright capsule on the table.
fn post(number: usize, [x, y, top]: [f64; 3], radius: f64, height: f64) -> Object {
    let shape = Shape::Capsule { radius, height: height - 2.0 * radius };
    let upright = Isometry3::rotation(Vector3::x() * FRAC_PI_2);
    Object {
        name: format!("post{number}"),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: Isometry3::translation(x, y, top + height / 2.0),
        shapes: vec![Primitive { shape, pose: upright }],
        color: Some([90, 120, 160]),
    }
}
