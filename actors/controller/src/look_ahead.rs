//! Where a robot would come to rest if it were told to stop now, and what is in the way there.
//!
//! Algorithm 6 acts on what is near. At full speed that is late: the stop takes effect a little after it is told, and braking
//! takes its way. So a *ghost* of the robot runs ahead of it, by as much as the robot would go on. Where the ghost comes nearer to
//! anything than a reserve, the reflex closes the filter, and the robot comes to rest with about that reserve left.
//!
//! ```text
//! robot ●━━━━━━━━━━━━━━▶ ghost ○                     ┃ obstacle
//!        until it takes     brakes     reserve ├────┤
//!        effect
//! ```
//! Slow robots have short ways: their ghost is hardly ahead, and it is the margin that stops them, as in the paper. A pair that is
//! not getting nearer is never a reason: what is inside of the reserve already may always move out.
//!
//! The ghost moves on with each reading, and its way since the last one is looked at in steps, so that nothing slips between two
//! readings at any speed. Motors brake each by itself, so that the way on which the robot brakes is not the one that it would have gone:
//! of a fast robot, more ghosts are where it would be on that way. After an edit of the world, the way from the robot to its ghosts is
//! looked at as well.

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

/// The parts of the time to rest after which a ghost is: the last is where the robot rests.
const GHOSTS: [f64; 8] = [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0];

/// A pair that would come nearer than the reserve if the robot were stopped now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foreseen {
    /// Where it would be nearest.
    pub contact: Contact,
    /// The scene's count of edits as its object was put there; zero for robots, and for what never changed.
    pub edited: u64,
}

/// Looks ahead for the robots of a scene.
#[derive(Clone, Debug)]
pub struct LookAhead {
    /// By their index in the scene.
    robots: Vec<Runner>,
    scene: Arc<Scene>,
    /// Per object the count of edits as it was put where it is.
    edited: BTreeMap<u32, u64>,
    /// Look at the ways of the ghosts, each at those of one part of the time.
    sweeps: [Sweep; GHOSTS.len()],
    /// Finds the pairs that may come near on any of those ways: most can't, and are left out of all sweeps.
    vicinity: Watch,
    /// Where the robots have rested since they were looked at last: nothing is ahead of any of them.
    resting: Option<Vec<Pose>>,
}

/// A robot and its ghost.
#[derive(Clone, Debug)]
struct Runner {
    /// What it goes by; `None`: it does not look ahead, and its ghost is where it is.
    rules: Option<Arc<Rules>>,
    course: Course,
    brakes: Brakes,
    /// Where it would be, the last at rest; none before the first reading.
    ghosts: Vec<Pose>,
    /// Whether the world was edited since its last reading.
    edited: bool,
}

impl Runner {
    fn reserve(&self) -> f64 {
        self.rules.as_ref().and_then(|rules| rules.reserve).unwrap_or(0.0)
    }

    /// The clearance while it goes on so far after a stop, meters: what is foreseen of a long way is less exact.
    fn reserve_after(&self, way: f64) -> f64 {
        let fast = self.rules.as_ref().map_or(FastClearance::default(), |rules| rules.fast_clearance);
        self.reserve().max(fast.after(way))
    }

    /// Takes in a reading; its ghost moves on. `open`: whether agents' commands reach the robot.
    fn follow(&mut self, sample: &Sample, open: bool) {
        let Some(rules) = &self.rules else { return };
        self.course.push(sample, rules.fresh);
        let moving = self.course.now();
        self.brakes.learn(&sample.q, &moving, open, rules);
        self.ghosts = self.brakes.ahead(&sample.q, &moving, open, rules, &GHOSTS);
    }

    /// True unless it rests at `q`, its position.
    fn moves(&self, q: &Pose) -> bool {
        self.ghosts.last().is_some_and(|rest| rest != q)
    }

    /// A ghost of it, or where it is.
    fn ghost(&self, k: usize, q: &Pose) -> Pose {
        self.ghosts.get(k).filter(|ghost| ghost.len() == q.len()).unwrap_or(q).clone()
    }
}

impl LookAhead {
    /// For robots that are controlled by these rules, in the scene's order; `None` if none of them looks ahead.
    pub fn new(scene: &Arc<Scene>, rules: impl IntoIterator<Item = Arc<Rules>>) -> Option<LookAhead> {
        let runner = |rules: Arc<Rules>| Runner {
            rules: rules.reserve.is_some().then_some(rules),
            course: Course::default(),
            brakes: Brakes::default(),
            ghosts: Vec::new(),
            edited: true,
        };
        let robots: Vec<Runner> = rules.into_iter().map(runner).collect();
        let most = farthest(robots.iter().filter_map(|runner| runner.rules.as_deref()));
        let least = robots.iter().filter(|r| r.rules.is_some()).map(Runner::reserve).fold(f64::INFINITY, f64::min);
        // of a way in such steps nothing nearer than half of the reserve is overlooked
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

    /// Goes on with another scene, such as one after an edit.
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

    /// A robot was read: the pairs of it that would come nearer than its reserve if it were stopped now. None of those that are as near
    /// already.
    ///
    /// # Arguments
    /// * `poses`: the newest of all robots, rad, in the scene's order.
    /// * `near`: the pairs that are near now, at least those within [`farthest`].
    /// * `open`: whether agents' commands reach the robot: while they don't, how it brakes is measured.
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
        let (looks, edited) = (runner.rules.is_some(), std::mem::take(&mut runner.edited));
        let last = self.sweeps.len() - 1;
        let stopping = self.scene.travel(robot, &sample.q, &runner.ghost(last, &sample.q));
        let reserve = runner.reserve_after(stopping);
        // nothing gets nearer while every robot is where it rests; the first reading of a rest ends the ways that led there
        if self.robots.iter().zip(poses).all(|(runner, q)| runner.rules.is_some() && runner.ghost(last, q) == *q) {
            if self.resting.replace(poses.to_vec()).is_some() {
                return Vec::new();
            }
        } else if let Some(rested) = self.resting.take() {
            // the ways begin there
            for sweep in &mut self.sweeps {
                sweep.jump();
            }
            if let Some(sweep) = self.sweeps.last_mut() {
                sweep.begin(&rested);
            }
        }
        let is_far = stopping > 2.0 * reserve;
        let mut ways: Vec<Option<Vec<Pose>>> = Vec::with_capacity(GHOSTS.len());
        for (k, sweep) in self.sweeps.iter_mut().enumerate() {
            if k < last && !is_far {
                // all of its way is near where it rests
                sweep.jump();
                ways.push(None);
                continue;
            }
            if edited {
                sweep.begin(poses);
            }
            ways.push(Some(self.robots.iter().zip(poses).map(|(runner, q)| runner.ghost(k, q)).collect()));
        }
        // two robots that move both use up their reserve in the worst case
        let clearance = |(r, (runner, q)): (usize, (&Runner, &Pose))| match runner.moves(q) {
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
        // a slow robot needs little clearance: what is farther off is not measured
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
}

/// The greatest distance at which a pair may matter to robots that go by these rules, meters: the sum of the two greatest reserves.
pub fn farthest<'a>(rules: impl IntoIterator<Item = &'a Rules>) -> f64 {
    let mut reserves: Vec<f64> =
        rules.into_iter().filter_map(|rules| Some(rules.reserve?.max(rules.fast_clearance.most))).collect();
    reserves.sort_by(|a, b| b.total_cmp(a));
    reserves.iter().take(2).sum()
}

/// How far each motor of the scene is from its pose at most on the ways of the sweeps, rad of encoder.
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
