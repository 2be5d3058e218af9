//! A random scene to reach in: where the cup is, what stands about it, and how far the cameras are from where they are thought to be.

use miette::{Report, miette};
use mobee_contract::suggestion;
use mobee_model::{Edit, Object, ObjectClass, Primitive, Scene, Shape};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::FRAC_PI_2;

/// Obstacles at most; their radius and height, meters; how near to the cup's middle none stands.
const OBSTACLES: usize = 5;
const RADIUS: [f64; 2] = [0.012, 0.035];
const HEIGHT: [f64; 2] = [0.08, 0.34];
const APART: f64 = 0.09;
/// What a robot at home keeps from all of them, meters.
const CLEARANCE: f64 = 0.02;
/// Draws of an obstacle before there are fewer.
const TRIES: usize = 200;
/// How far the cup is put elsewhere at least, and how far beside its new place a post is put then, meters.
const ELSEWHERE: f64 = 0.06;
const BESIDE: [f64; 2] = [0.10, 0.16];
/// The object's name in the world.
pub(super) const CUP_NAME: &str = "cup";

/// Least and greatest x, least and greatest y, meters.
pub(super) type Area = [[f64; 2]; 2];

/// Where on the table things may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Areas {
    /// The cup's middle.
    pub cup: Area,
    /// What stands about it.
    pub posts: Area,
}

/// What is drawn of a seed.
#[derive(Clone, Debug)]
pub(super) struct ReachScene {
    /// The cup's middle in truth, meters.
    pub cup: [f64; 3],
    /// What stands about it.
    pub posts: Vec<Object>,
    /// How the cameras are turned in truth, deg about their axes.
    pub turned: Vec<[f64; 3]>,
    /// What moves in mid-reach, if anything does.
    pub moved: Option<Moved>,
    /// The world with all of it, as it is at last.
    pub truth: Scene,
}

/// What moves in mid-reach.
#[derive(Clone, Debug)]
pub(super) struct Moved {
    /// Where the cup's middle is from then on, meters, and how it stands.
    pub cup: [f64; 3],
    pub upright: UnitQuaternion<f64>,
    /// A post's name, and where that is from then on.
    pub post: Option<(String, Isometry3<f64>)>,
}

impl ReachScene {
    /// The scene of a seed, in a world whose robots are at home, free of everything: the cup and the posts stand as high as the cup does
    /// in the file. So many cameras are off by up to `offset_deg`.
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
        let count = (within([0.0, OBSTACLES as f64 + 1.0]) as usize).min(OBSTACLES);
        let pose = Isometry3::translation(cup[0], cup[1], cup[2]);
        let mut truth = edited(world, &Edit::Move { name: CUP_NAME.to_owned(), pose })?;
        let mut posts = Vec::new();
        for _ in 0..TRIES {
            if posts.len() == count {
                break;
            }
            let [x, y] = areas.posts.map(&mut within);
            let post = post(posts.len(), [x, y, top], within(RADIUS), within(HEIGHT));
            let with = edited(&truth, &Edit::Add(post.clone()))?;
            let is_clear = (x - cup[0]).hypot(y - cup[1]) >= APART;
            if is_clear && (0..with.robots().len()).all(|r| with.robot_free(r, &with.home(), CLEARANCE)) {
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

    /// Where the cup's middle is at last, meters.
    pub fn cup_at_last(&self) -> [f64; 3] {
        self.moved.as_ref().map_or(self.cup, |moved| moved.cup)
    }

    /// The cup put elsewhere, and the first post beside it; `None` if there is no room.
    fn moved(&self, rng: &mut ChaCha8Rng, area: &Area) -> Option<Moved> {
        let far = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let stands = |post: &Object| [post.pose.translation.x, post.pose.translation.y];
        let upright = self.truth.object(CUP_NAME)?.1.pose.rotation;
        for _ in 0..TRIES {
            let to = area.map(|[from, to]| rng.random_range(from..=to));
            let turn = rng.random_range(0.0..=std::f64::consts::TAU);
            let off = rng.random_range(BESIDE[0]..=BESIDE[1]);
            let beside = [to[0] + off * turn.cos(), to[1] + off * turn.sin()];
            let is_elsewhere = far(to, [self.cup[0], self.cup[1]]) >= ELSEWHERE;
            let is_clear = self.posts.iter().skip(1).all(|post| far(to, stands(post)) >= APART);
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
            if (0..with.robots().len()).all(|r| with.robot_free(r, &with.home(), CLEARANCE)) {
                return Some(moved);
            }
        }
        None
    }
}

impl Moved {
    /// The world after that.
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
