//! The world in which edges were certified: detection of changes, and a compiled checker for the
//! robot with each object.

use super::limbs::{Limbs, WorldBox, bounds};
use mobee_contract::View;
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Object, ObjectClass, Primitive, Scene, ShapeId};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Maximum displacement of a motor that the map does not move, beyond which everything is certified
/// again, rad. The displacement that it causes at the end of a stretched arm is less than the
/// difference between the plans' clearance and the reflex's margin, or a millimeter more.
const REST_TOLERANCE_RAD: f64 = 0.25 * std::f64::consts::PI / 180.0;
/// Enlargement of an object's region beyond the clearance, for rounding, meters.
const ROUNDING_M: f64 = 1e-5;
/// Number of edges certified in one call.
const BATCH: usize = 1024;

/// The world for which all verdicts hold.
pub(super) struct SeenWorld {
    pub scene: Arc<Scene>,
    pub robot: usize,
    clearance: f64,
    /// Rest configuration of the robot's other motors.
    rest: Vec<f64>,
    pub limbs: Limbs,
    poses: ScenePoses,
    /// Checker of the robot with itself.
    own: ObjectPairs,
    objects: BTreeMap<u32, CheckedObject>,
}

/// An object, and the checker of the robot with it alone, created when needed.
struct CheckedObject {
    object: Arc<Object>,
    checker: Option<ObjectPairs>,
}

impl SeenWorld {
    pub fn new(view: &View, motors: &[usize]) -> SeenWorld {
        let scene = view.scene.clone();
        let limbs = Limbs::new(&scene, view.robot, motors, view.pose());
        let carried = limbs.carried(&scene);
        let owner = |i: u32| scene.shape_id(i).and_then(ShapeId::robot);
        let own = ObjectPairs::new(&scene, view.clearance, |i, j| {
            let apart = carried.get(i as usize) != carried.get(j as usize);
            apart && owner(i) == Some(view.robot) && owner(j) == Some(view.robot)
        });
        let seen = |o: &Arc<Object>| CheckedObject { object: o.clone(), checker: None };
        let objects = scene.objects().map(|(id, o)| (id, seen(o))).collect();
        let poses = ScenePoses::new(&scene, view, motors);
        let robot = view.robot;
        let clearance = view.clearance;
        let rest = view.pose().to_vec();
        SeenWorld { scene, robot, clearance, rest, limbs, poses, own, objects }
    }

    /// Returns whether the view has the same robots with the same rest configuration and base, so
    /// that only objects can have changed.
    pub fn is_of(&self, view: &View, motors: &[usize]) -> bool {
        let same =
            |(r, (a, b)): (usize, (&Arc<_>, &Arc<_>))| Arc::ptr_eq(a, b) && self.scene.base(r) == view.scene.base(r);
        let rests = |(m, (a, b)): (usize, (&f64, &f64))| motors.contains(&m) || (a - b).abs() <= REST_TOLERANCE_RAD;
        self.robot == view.robot
            && self.clearance == view.clearance
            && self.scene.robots().len() == view.scene.robots().len()
            && self.scene.robots().iter().zip(view.scene.robots()).enumerate().all(same)
            && self.rest.len() == view.pose().len()
            && self.rest.iter().zip(view.pose()).enumerate().all(rests)
    }

    /// Takes over the objects of another scene; returns those that changed.
    pub fn update(&mut self, scene: &Arc<Scene>) -> BTreeSet<u32> {
        let mut changed = BTreeSet::new();
        let mut objects = BTreeMap::new();
        for (id, object) in scene.objects() {
            let known = self.objects.remove(&id).filter(|seen| is_same(&seen.object, object));
            if known.is_none() {
                changed.insert(id);
            }
            objects.insert(id, known.unwrap_or_else(|| CheckedObject { object: object.clone(), checker: None }));
        }
        changed.extend(self.objects.keys());
        self.objects = objects;
        self.scene = scene.clone();
        changed
    }

    /// Returns the objects of all classes.
    pub fn objects(&self) -> Vec<u32> {
        self.objects.keys().copied().collect()
    }

    /// Returns boxes around an object's shapes, enlarged by the clearance; empty if it is not an
    /// obstacle.
    pub fn region(&self, object: u32) -> Vec<WorldBox> {
        let Some(CheckedObject { object, .. }) = self.objects.get(&object) else { return Vec::new() };
        let around = self.clearance + ROUNDING_M;
        let shapes = object.shapes.iter().filter(|_| object.class == ObjectClass::Obstacle);
        let region = |shape: &Primitive| {
            let (low, high) = bounds(shape.shape, &(object.pose * shape.pose));
            let low = low.map(|x| ((x - around) as f32).next_down());
            let high = high.map(|x| ((x + around) as f32).next_up());
            [low.x, low.y, low.z, high.x, high.y, high.z]
        };
        shapes.map(region).collect()
    }

    /// Certifies edges of the robot with itself.
    pub fn certify_own<'a>(&mut self, ways: impl Iterator<Item = &'a [f64]>) -> Vec<EdgeVerdict> {
        self.own.certify(&mut self.poses, ways)
    }

    /// Certifies edges against one object.
    pub fn certify_object<'a>(&mut self, object: u32, ways: impl Iterator<Item = &'a [f64]>) -> Vec<EdgeVerdict> {
        let Some(seen) = self.objects.get_mut(&object) else { return Vec::new() };
        let checker = seen.checker.get_or_insert_with(|| {
            let carried = self.limbs.carried(&self.scene);
            let moves = |i: u32| carried.get(i as usize).is_some_and(|body| *body > 0);
            let is_it =
                |i: u32| matches!(self.scene.shape_id(i), Some(ShapeId::Object { object: o, .. }) if o == object);
            self.own.among(&self.scene, |i, j| (moves(i) && is_it(j)) || (moves(j) && is_it(i)))
        });
        checker.certify(&mut self.poses, ways)
    }
}

/// Returns whether an object is unchanged for the robots.
fn is_same(a: &Arc<Object>, b: &Arc<Object>) -> bool {
    Arc::ptr_eq(a, b) || (a.pose == b.pose && a.class == b.class && a.shapes == b.shapes)
}

/// Configurations of all robots of a scene, of which only the map's motors change. Other robots are
/// at home, because no pairs with them are checked.
struct ScenePoses {
    rest: Vec<f64>,
    /// Columns of the map's motors.
    motors: Vec<usize>,
    /// Starts and ends of edges, in the checker's format.
    edges: Vec<f64>,
}

impl ScenePoses {
    fn new(scene: &Scene, view: &View, motors: &[usize]) -> ScenePoses {
        let first: usize = scene.robots().iter().take(view.robot).map(|r| r.motors.len()).sum();
        let home = scene.home();
        let of = |(r, home): (usize, &Arc<[f64]>)| if r == view.robot { view.pose().to_vec() } else { home.to_vec() };
        let mut rest: Vec<f64> = home.iter().enumerate().flat_map(of).collect();
        // A motor at rest at its limit may read slightly more; no edge is to blame for that.
        let limits = scene.robots().iter().flat_map(|r| &r.motors);
        rest.iter_mut().zip(limits).for_each(|(q, m)| *q = q.max(m.min).min(m.max));
        ScenePoses { rest, motors: motors.iter().map(|m| first + m).collect(), edges: Vec::new() }
    }

    fn push(&mut self, group: &[f64]) {
        let start = self.edges.len();
        self.edges.extend(&self.rest);
        for (motor, q) in self.motors.iter().zip(group) {
            if let Some(slot) = self.edges.get_mut(start + motor) {
                *slot = *q;
            }
        }
    }
}

/// The pairs relevant to one object, compiled. `None` (an invalid clearance): nothing can be
/// certified.
struct ObjectPairs(Option<FastScene>);

impl ObjectPairs {
    fn new(scene: &Scene, clearance: f64, keep: impl Fn(u32, u32) -> bool) -> ObjectPairs {
        ObjectPairs(FastScene::of_pairs(scene, clearance, keep).ok())
    }

    /// Other pairs of the same robots.
    fn among(&self, scene: &Scene, keep: impl Fn(u32, u32) -> bool) -> ObjectPairs {
        ObjectPairs(self.0.as_ref().and_then(|fast| fast.among(scene, keep).ok()))
    }

    /// Certifies edges, each given by the positions of the map's motors at its start and then at
    /// its end.
    fn certify<'a>(&mut self, poses: &mut ScenePoses, ways: impl Iterator<Item = &'a [f64]>) -> Vec<EdgeVerdict> {
        let mut all = Vec::new();
        let mut verdicts = Vec::new();
        let mut ways = ways.peekable();
        while ways.peek().is_some() {
            poses.edges.clear();
            let mut count = 0;
            for way in ways.by_ref().take(BATCH) {
                let (from, to) = way.split_at(way.len() / 2);
                poses.push(from);
                poses.push(to);
                count += 1;
            }
            let judged = self.0.as_mut().is_some_and(|fast| fast.certify(&poses.edges, &mut verdicts).is_ok());
            if judged && verdicts.len() == count {
                all.append(&mut verdicts);
            } else {
                all.extend((0..count).map(|_| EdgeVerdict::Uncertified { at: 0.0 }));
            }
        }
        all
    }
}
