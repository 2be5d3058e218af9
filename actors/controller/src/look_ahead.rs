//! Look-ahead: prediction of the configuration in which a robot would stop, and of the contacts on the way there.
//!
//! Algorithm 6 acts on present distances. At full speed that is too late: a stop takes effect after a delay, and
//! braking takes a distance. Therefore a *ghost* of the robot runs ahead of it by its stopping distance. Where the
//! ghost gets closer to anything than the braking clearance, the reflex closes the filter, and the robot stops with
//! about that clearance left.
//!
//! ```text
//! robot ●━━━━━━━━━━━━━━▶ ghost ○                     ┃ obstacle
//!        until it takes     brakes   clearance ├────┤
//!        effect
//! ```
//! Slow robots have short stopping distances: their ghost is hardly ahead, and the margin stops them, as in the
//! paper. A pair that does not get closer is never a reason to stop: a robot within the clearance may always move
//! out.
//!
//! The ghost advances with each reading, and its path since the last one is checked in steps, so that no contact is
//! missed between two readings at any speed. The motors brake independently, so a braking robot leaves the path that
//! it was on: a fast robot has further ghosts along its braking path. After an edit of the world, the path from the
//! robot to its ghosts is checked as well.

mod brakes;
mod clearance;
mod course;

pub use clearance::{FastClearance, braking_clearance, stop_error};

use crate::simultaneous::note;
use crate::{DEEPER, Rules};
use brakes::Brakes;
use course::Course;
use mobee_contract::{Pose, Sample};
use mobee_model::{Contact, Scene, ShapeId, Sweep, Watch};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Shares of the time to rest at which the ghosts are; the last is the robot at rest.
const GHOSTS: [f64; 8] = [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0];

/// Pair that would get closer than the braking clearance if the robot were stopped now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foreseen {
    /// Its predicted nearest contact.
    pub contact: Contact,
    /// Edit count of the scene when the object was placed; zero for robots, and for objects that never changed.
    pub edited: u64,
}

/// Look-ahead for the robots of a scene.
#[derive(Clone, Debug)]
pub struct LookAhead {
    /// Robots, by their index in the scene.
    robots: Vec<LookAheadRobot>,
    scene: Arc<Scene>,
    /// Edit count of the scene when each object was placed.
    edited: BTreeMap<u32, u64>,
    /// Sweeps along the paths of the ghosts, one per ghost.
    sweeps: [Sweep; GHOSTS.len()],
    /// Finds the pairs that may get close on any of these paths: most cannot, and are excluded from all sweeps.
    vicinity: Watch,
    /// Configurations of the robots at rest, as of the last check: there is nothing ahead of them.
    resting: Option<Vec<Pose>>,
}

/// A robot and its ghosts.
#[derive(Clone, Debug)]
struct LookAheadRobot {
    /// Controller parameters; `None`: the robot does not look ahead, and its ghost is at its own configuration.
    rules: Option<Arc<Rules>>,
    course: Course,
    brakes: Brakes,
    /// Predicted configurations, the last at rest; empty before the first reading.
    ghosts: Vec<Pose>,
    /// True if the world was edited since the last reading.
    edited: bool,
}

impl LookAheadRobot {
    fn reserve(&self) -> f64 {
        self.rules.as_ref().and_then(|rules| rules.reserve).unwrap_or(0.0)
    }

    /// Clearance for a stopping path of this length, meters: the prediction of a long path is less exact.
    fn reserve_after(&self, way: f64) -> f64 {
        let fast = self.rules.as_ref().map_or(FastClearance::default(), |rules| rules.fast_clearance);
        self.reserve().max(fast.after(way))
    }

    /// Processes a reading and advances the ghosts. `open`: whether agents' commands reach the robot.
    fn follow(&mut self, sample: &Sample, open: bool) {
        let Some(rules) = &self.rules else { return };
        self.course.push(sample, rules.fresh);
        let moving = self.course.now();
        self.brakes.learn(&sample.q, &moving, open, rules);
        self.ghosts = self.brakes.ahead(&sample.q, &moving, open, rules, &GHOSTS);
    }

    /// Returns false if the robot rests at `q`, its position.
    fn moves(&self, q: &Pose) -> bool {
        self.ghosts.last().is_some_and(|rest| rest != q)
    }

    /// Ghost of this index, or the robot's own configuration.
    fn ghost(&self, k: usize, q: &Pose) -> Pose {
        self.ghosts.get(k).filter(|ghost| ghost.len() == q.len()).unwrap_or(q).clone()
    }
}

impl LookAhead {
    /// Creates the look-ahead for robots with these rules, in the scene's order. Returns `None` if none of them looks
    /// ahead.
    pub fn new(scene: &Arc<Scene>, rules: impl IntoIterator<Item = Arc<Rules>>) -> Option<LookAhead> {
        let runner = |rules: Arc<Rules>| LookAheadRobot {
            rules: rules.reserve.is_some().then_some(rules),
            course: Course::default(),
            brakes: Brakes::default(),
            ghosts: Vec::new(),
            edited: true,
        };
        let robots: Vec<LookAheadRobot> = rules.into_iter().map(runner).collect();
        let most = farthest(robots.iter().filter_map(|runner| runner.rules.as_deref()));
        let least =
            robots.iter().filter(|r| r.rules.is_some()).map(LookAheadRobot::reserve).fold(f64::INFINITY, f64::min);
        // With these steps, no distance below half of the clearance is missed.
        let sweep = || Sweep::of_all(scene.clone(), most, least / 2.0);
        let sweeps = || GHOSTS.map(|_| sweep());
        least.is_finite().then(|| LookAhead {
            sweeps: sweeps(),
            vicinity: Watch::new(scene.clone(), most),
            scene: scene.clone(),
            edited: BTreeMap::new(),
            robots,
            resting: None,
        })
    }

    /// Replaces the scene, as after an edit.
    pub fn set_scene(&mut self, scene: &Arc<Scene>) {
        let before = std::mem::replace(&mut self.scene, scene.clone());
        for (id, object) in scene.objects() {
            let as_before = before.objects().any(|(i, o)| i == id && o.pose == object.pose && o.class == object.class);
            if !as_before {
                self.edited.insert(id, scene.epoch());
            }
        }
        self.sweeps.iter_mut().for_each(|sweep| sweep.set_scene(scene.clone()));
        self.vicinity.set_scene(scene.clone());
        self.robots.iter_mut().for_each(|runner| runner.edited = true);
    }

    /// Processes a reading of a robot. Returns its pairs that would get closer than its braking clearance if it were
    /// stopped now, except those that are that close already.
    ///
    /// # Arguments
    /// * `poses`: newest configurations of all robots, rad, in the scene's order.
    /// * `near`: present pairs, at least those within [`farthest`].
    /// * `open`: whether agents' commands reach the robot; while they don't, its braking is measured.
    pub fn read(
        &mut self,
        robot: usize,
        sample: &Sample,
        poses: &[Pose],
        near: &[Contact],
        open: bool,
    ) -> Vec<Foreseen> {
        let Some(runner) = self.robots.get_mut(robot) else { return Vec::new() };
        runner.follow(sample, open);
        let looks = runner.rules.is_some();
        let edited = std::mem::take(&mut runner.edited);
        let last = self.sweeps.len() - 1;
        let stopping = self.scene.travel(robot, &sample.q, &runner.ghost(last, &sample.q));
        let reserve = runner.reserve_after(stopping);
        if self.all_still_rest(poses) {
            return Vec::new();
        }
        let is_far = stopping > 2.0 * reserve;
        let mut ways: Vec<Option<Vec<Pose>>> = Vec::with_capacity(GHOSTS.len());
        for (k, sweep) in self.sweeps.iter_mut().enumerate() {
            if k < last && !is_far {
                // The whole path is near the configuration at rest.
                sweep.jump();
                ways.push(None);
                continue;
            }
            if edited {
                sweep.begin(poses);
            }
            ways.push(Some(self.robots.iter().zip(poses).map(|(runner, q)| runner.ghost(k, q)).collect()));
        }
        // Two moving robots both use up their clearance in the worst case.
        let clearance = |(r, (runner, q)): (usize, (&LookAheadRobot, &Pose))| match runner.moves(q) {
            true => runner.reserve_after(self.scene.travel(r, q, &runner.ghost(last, q))),
            false => 0.0,
        };
        let moving: Vec<f64> = self.robots.iter().zip(poses).enumerate().map(clearance).collect();
        let comes = |c: &&Contact| {
            let pair = [c.pair.0.robot(), c.pair.1.robot()];
            let own = pair.contains(&Some(robot));
            let other = pair.into_iter().flatten().find(|of| *of != robot);
            let others = other.and_then(|of| moving.get(of)).copied().unwrap_or(0.0);
            let present = || near.iter().find(|n| n.pair == c.pair).map_or(f64::INFINITY, |n| n.distance);
            looks && own && c.distance < reserve + others && c.distance < present() - DEEPER
        };
        // A slow robot needs little clearance: pairs farther off are not measured.
        let others = moving.iter().enumerate().filter(|(of, _)| *of != robot).map(|(_, clearance)| *clearance);
        let within = reserve + others.fold(0.0, f64::max);
        let ranges = ranges(&self.scene, poses, &self.sweeps, &ways);
        let groups = self.vicinity.near_groups(robot, poses, &ranges, within);
        let mut met: Vec<Contact> = Vec::new();
        for (sweep, way) in self.sweeps.iter_mut().zip(&ways) {
            let Some(ghosts) = way else { continue };
            sweep.to_of(ghosts, &groups).iter().filter(comes).for_each(|c| note(&mut met, c));
        }
        let edits = |s: ShapeId| match s {
            ShapeId::Object { object, .. } => self.edited.get(&object).copied().unwrap_or(0),
            ShapeId::Robot { .. } => 0,
        };
        let foreseen = |c: Contact| Foreseen { contact: c, edited: edits(c.pair.0).max(edits(c.pair.1)) };
        met.into_iter().map(foreseen).collect()
    }

    /// Returns true from the second reading on with all robots at rest: no pair gets closer. The first one ends the
    /// paths that led there, and the first motion begins new ones at the configurations at rest.
    fn all_still_rest(&mut self, poses: &[Pose]) -> bool {
        let last = self.sweeps.len() - 1;
        if self.robots.iter().zip(poses).all(|(runner, q)| runner.rules.is_some() && runner.ghost(last, q) == *q) {
            return self.resting.replace(poses.to_vec()).is_some();
        }
        if let Some(rested) = self.resting.take() {
            self.sweeps.iter_mut().for_each(|sweep| sweep.jump());
            if let Some(sweep) = self.sweeps.last_mut() {
                sweep.begin(&rested);
            }
        }
        false
    }
}

/// Greatest distance at which a pair may matter to robots with these rules, meters: the sum of the two greatest
/// clearances.
pub fn farthest<'a>(rules: impl IntoIterator<Item = &'a Rules>) -> f64 {
    let mut reserves: Vec<f64> =
        rules.into_iter().filter_map(|rules| Some(rules.reserve?.max(rules.fast_clearance.most))).collect();
    reserves.sort_by(|a, b| b.total_cmp(a));
    reserves.iter().take(2).sum()
}

/// Greatest distance of each motor of the scene from its position on the paths of the sweeps, rad of encoder.
fn ranges(scene: &Scene, poses: &[Pose], sweeps: &[Sweep], ways: &[Option<Vec<Pose>>]) -> Vec<f64> {
    let mut ranges = Vec::new();
    for (robot, (model, q)) in scene.robots().iter().zip(poses).enumerate() {
        for (motor, q) in (0..model.motors.len()).map(|motor| (motor, q.get(motor))) {
            let away = |of: Option<&f64>| Some((of? - q?).abs());
            let ahead = |(sweep, way): (&Sweep, &Option<Vec<Pose>>)| {
                let to = away(way.as_ref()?.get(robot)?.get(motor));
                let from = away(sweep.last().and_then(|last| last.get(robot)?.get(motor)));
                Some(to.unwrap_or_default().max(from.unwrap_or_default()))
            };
            ranges.push(sweeps.iter().zip(ways).filter_map(ahead).fold(0.0, f64::max));
        }
    }
    ranges
}

#[cfg(test)]
pub(crate) mod tests;
