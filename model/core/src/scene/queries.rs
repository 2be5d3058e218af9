//! Queries of a scene at one configuration: contacts, clearance, intersection tests.
//!
//! The scene places the robots and selects the pairs; the engine computes their distances.

use super::{Contact, Scene, ShapeId};
use crate::engine::{Engine, IndexPair};

impl<E: Engine> Scene<E> {
    /// Contact query: the reflex pairs that touch or are closer than a margin.
    ///
    /// # Arguments
    /// * `poses`: motor positions per robot, rad of encoder; a robot or motor without an entry is at home.
    /// * `within`: the margin, meters; zero for touching pairs only.
    ///
    /// # Returns
    /// The pairs closer than the margin and all touching pairs, sorted by pair; signed distances in meters, points in
    /// the world frame. Pairs that can't move relative to each other are excluded (see [`Scene::static_contacts`]).
    ///
    /// # Performance
    /// Tests every pair at each call. For a stream of configurations use a [`crate::Watch`], for a yes-or-no query
    /// [`Scene::free`].
    pub fn contacts<P: AsRef<[f64]>>(&self, poses: &[P], within: f64) -> Vec<Contact> {
        let world = self.world();
        let found = world.engine.contacts(&self.placement(poses), &world.lists.pairs, within);
        let near = found.into_iter().filter(|n| world.is_near(n.pair, n.proximity.distance, within));
        near.map(|near| world.contact(near)).collect()
    }

    /// Distance query: the nearest reflex pair.
    ///
    /// # Arguments
    /// * `poses`: as for [`Scene::contacts`].
    /// * `cap`: maximum distance of interest, meters; the smaller, the faster.
    ///
    /// # Returns
    /// The pair of smallest signed distance, or `None` if all are farther apart than the cap. Of overlapping pairs it
    /// is the deepest.
    pub fn clearance<P: AsRef<[f64]>>(&self, poses: &[P], cap: f64) -> Option<Contact> {
        let world = self.world();
        world.nearest(&self.placement(poses), cap).map(|near| world.contact(near))
    }

    /// Intersection test of all robots: true if every reflex pair is farther apart than `clearance` meters and every
    /// robot's configuration satisfies its constraints.
    ///
    /// # Performance
    /// Stops at the first pair that is not, and measures no depth: the fastest query.
    pub fn free<P: AsRef<[f64]>>(&self, poses: &[P], clearance: f64) -> bool {
        // Constraints cost a few products, shapes a forward-kinematics pass.
        if poses.iter().enumerate().any(|(r, q)| !self.satisfies_constraints(r, q.as_ref())) {
            return false;
        }
        let world = self.world();
        world.free(&self.placement(poses), world.lists.pairs.iter().copied(), clearance)
    }

    /// Intersection test of one robot, with itself, the others and objects: true if each of its reflex pairs is farther
    /// apart than `clearance` meters and its configuration satisfies its constraints. Contacts among the other robots
    /// are ignored.
    ///
    /// # Arguments
    /// * `robot`: its index in [`Scene::robots`].
    /// * `poses`: configurations of all robots, as for [`Scene::contacts`].
    pub fn robot_free<P: AsRef<[f64]>>(&self, robot: usize, poses: &[P], clearance: f64) -> bool {
        if poses.get(robot).is_some_and(|q| !self.satisfies_constraints(robot, q.as_ref())) {
            return false;
        }
        let world = self.world();
        let own = world.lists.pairs.iter().copied().filter(|pair| self.is_of(robot, *pair));
        world.free(&self.placement(poses), own, clearance)
    }

    /// True if one of two solids belongs to the robot.
    pub(super) fn is_of(&self, robot: usize, (i, j): IndexPair) -> bool {
        let solids = &self.world().solids;
        let own = |k: u32| matches!(solids[k as usize].id, ShapeId::Robot { robot: r, .. } if usize::from(r) == robot);
        own(i) || own(j)
    }

    /// True if a robot's configuration (rad of encoder) satisfies all of its constraints, or if the scene has no such
    /// robot.
    pub fn satisfies_constraints(&self, robot: usize, q: &[f64]) -> bool {
        self.robots().get(robot).is_none_or(|r| r.violated(q).next().is_none())
    }

    /// The poses of all shapes at these configurations.
    fn placement<P: AsRef<[f64]>>(&self, poses: &[P]) -> E::Placement {
        let mut frames = Vec::new();
        let mut placement = E::Placement::default();
        self.bodies().place(poses, &mut frames);
        self.world().engine.place(&frames, &mut placement);
        placement
    }
}
