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
//! readings at any speed. After an edit of the world, the way from the robot to its ghost is looked at as well.

mod brakes;
mod course;

use crate::{DEEPER, Rules};
use brakes::Brakes;
use course::Course;
use mobee_contract::{Pose, Sample};
use mobee_model::{Contact, Scene, Sweep};
use std::sync::Arc;

/// Looks ahead for the robots of a scene.
#[derive(Clone, Debug)]
pub struct LookAhead {
    /// By their index in the scene.
    robots: Vec<Runner>,
    /// Looks at the ways of the ghosts.
    sweep: Sweep,
}

/// A robot and its ghost.
#[derive(Clone, Debug)]
struct Runner {
    /// What it goes by; `None`: it does not look ahead, and its ghost is where it is.
    rules: Option<Arc<Rules>>,
    course: Course,
    brakes: Brakes,
    /// Where it would come to rest; empty before the first reading.
    ghost: Pose,
    /// Whether the world was edited since its last reading.
    edited: bool,
}

impl Runner {
    fn reserve(&self) -> f64 {
        self.rules.as_ref().and_then(|rules| rules.reserve).unwrap_or(0.0)
    }

    /// Takes in a reading; its ghost moves on. `open`: whether agents' commands reach the robot.
    fn follow(&mut self, sample: &Sample, open: bool) {
        let Some(rules) = &self.rules else {
            self.ghost = sample.q.clone();
            return;
        };
        self.course.push(sample, rules.fresh);
        let moving = self.course.now();
        self.brakes.learn(&sample.q, &moving, open, rules);
        self.ghost = self.brakes.rest(&sample.q, &moving, rules);
    }
}

impl LookAhead {
    /// For robots that are controlled by these rules, in the scene's order; `None` if none of them looks ahead.
    pub fn new(scene: &Arc<Scene>, rules: impl IntoIterator<Item = Arc<Rules>>) -> Option<LookAhead> {
        let runner = |rules: Arc<Rules>| Runner {
            rules: rules.reserve.is_some().then_some(rules),
            course: Course::default(),
            brakes: Brakes::default(),
            ghost: Vec::new().into(),
            edited: true,
        };
        let robots: Vec<Runner> = rules.into_iter().map(runner).collect();
        let reserves = || robots.iter().filter(|r| r.rules.is_some()).map(Runner::reserve);
        let (most, least) = (reserves().fold(0.0, f64::max), reserves().fold(f64::INFINITY, f64::min));
        // of a way in such steps nothing nearer than half of the reserve is overlooked
        least.is_finite().then(|| LookAhead { sweep: Sweep::of_all(scene.clone(), most, least / 2.0), robots })
    }

    /// Goes on with another scene, such as one after an edit.
    pub fn set_scene(&mut self, scene: &Arc<Scene>) {
        self.sweep.set_scene(scene.clone());
        self.robots.iter_mut().for_each(|runner| runner.edited = true);
    }

    /// A robot was read: the pairs of it that would come nearer than its reserve if it were stopped now, each where it would be
    /// nearest. None of those that are as near already.
    ///
    /// # Arguments
    /// * `poses`: the newest of all robots, rad, in the scene's order.
    /// * `near`: the pairs that are near it now, at least those within its reserve.
    /// * `open`: whether agents' commands reach the robot: while they don't, how it brakes is measured.
    pub fn read(
        &mut self,
        robot: usize,
        sample: &Sample,
        poses: &[Pose],
        near: &[Contact],
        open: bool,
    ) -> Vec<Contact> {
        let Some(runner) = self.robots.get_mut(robot) else { return Vec::new() };
        runner.follow(sample, open);
        let (reserve, looks, edited) = (runner.reserve(), runner.rules.is_some(), std::mem::take(&mut runner.edited));
        let ghost = |(runner, q): (&Runner, &Pose)| match runner.ghost.len() == q.len() {
            true => runner.ghost.clone(),
            false => q.clone(),
        };
        let ghosts: Vec<Pose> = self.robots.iter().zip(poses).map(ghost).collect();
        if edited {
            self.sweep.jump();
            self.sweep.to(poses);
        }
        let comes = |c: &&Contact| {
            let own = [c.pair.0.robot(), c.pair.1.robot()].contains(&Some(robot));
            let present = || near.iter().find(|n| n.pair == c.pair).map_or(f64::INFINITY, |n| n.distance);
            own && c.distance < reserve && c.distance < present() - DEEPER
        };
        let met = self.sweep.to(&ghosts);
        if looks { met.iter().filter(comes).copied().collect() } else { Vec::new() }
    }
}

#[cfg(test)]
mod tests;
