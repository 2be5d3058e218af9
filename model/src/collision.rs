//! Who touches whom at a pose.
//!
//! Pair by pair with rejection first: bounding balls, then a point against a box, then the capsules that hold the
//! shapes; what remains is measured exactly (see [`crate::distance()`]).

mod placement;
mod report;

pub(crate) use placement::{Placement, bound, exact, measure};
pub use report::{Kind, Reported};

use crate::scene::{Contact, Scene, ShapeId};

impl Scene {
    /// Reflex pairs nearer than `within` metres (and all that touch), sorted by pair. Pairs that can't move against each other
    /// are left out.
    pub fn contacts<P: AsRef<[f64]>>(&self, poses: &[P], within: f64) -> Vec<Contact> {
        let placement = self.placement(poses);
        let mut found = Vec::new();
        for &(i, j) in &self.world().pairs {
            if let Some(c) = exact(&self.world().solids, &placement, i, j, within)
                && (c.distance < within || c.distance <= 0.0)
            {
                found.push(c);
            }
        }
        found
    }

    /// The nearest reflex pair, if any is within `cap` metres.
    pub fn clearance<P: AsRef<[f64]>>(&self, poses: &[P], cap: f64) -> Option<Contact> {
        let placement = self.placement(poses);
        let mut nearest: Option<Contact> = None;
        for &(i, j) in &self.world().pairs {
            let cap = nearest.map_or(cap, |c| c.distance);
            if let Some(c) = exact(&self.world().solids, &placement, i, j, cap)
                && nearest.is_none_or(|n| c.distance < n.distance)
            {
                nearest = Some(c);
            }
        }
        nearest
    }

    /// Whether every reflex pair is farther apart than `clearance` metres and every robot's pose is satisfies_constraints.
    pub fn free<P: AsRef<[f64]>>(&self, poses: &[P], clearance: f64) -> bool {
        if poses.iter().enumerate().any(|(r, q)| !self.satisfies_constraints(r, q.as_ref())) {
            return false;
        }
        let placement = self.placement(poses);
        let solids = &self.world().solids;
        !self.world().pairs.iter().any(|&(i, j)| placement::touches(solids, &placement, i, j, clearance))
    }

    /// Whether every reflex pair of one robot (with itself, the others and objects) is farther apart than `clearance` metres and
    /// its pose is satisfies_constraints. What the others touch meanwhile is their matter.
    pub fn robot_free<P: AsRef<[f64]>>(&self, robot: usize, poses: &[P], clearance: f64) -> bool {
        if poses.get(robot).is_some_and(|q| !self.satisfies_constraints(robot, q.as_ref())) {
            return false;
        }
        let placement = self.placement(poses);
        let solids = &self.world().solids;
        let mut own = self.world().pairs.iter().filter(|&&(i, j)| self.is_of(robot, i, j));
        !own.any(|&(i, j)| placement::touches(solids, &placement, i, j, clearance))
    }

    /// Whether one of two solids is a robot's.
    pub(crate) fn is_of(&self, robot: usize, i: u32, j: u32) -> bool {
        let solids = &self.world().solids;
        let own = |k: u32| matches!(solids[k as usize].id, ShapeId::Robot { robot: r, .. } if usize::from(r) == robot);
        own(i) || own(j)
    }

    /// Whether a robot's pose satisfies all of its constraints.
    pub fn satisfies_constraints(&self, robot: usize, q: &[f64]) -> bool {
        self.robots().get(robot).is_none_or(|r| r.violated(q).next().is_none())
    }

    fn placement<P: AsRef<[f64]>>(&self, poses: &[P]) -> Placement {
        let mut placement = Placement::default();
        self.bodies().place(poses, &mut placement.frames);
        placement.solids(&self.world().solids);
        placement
    }
}
