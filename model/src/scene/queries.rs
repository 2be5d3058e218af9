//! Queries of a scene at one pose: contacts, clearance, intersection tests.
//!
//! The scene places the robots and knows which pairs count; the engine answers how near they are.

use super::{Contact, Scene, ShapeId};
use crate::engine::{Engine, IndexPair};

impl<E: Engine> Scene<E> {
    /// Contact query: the reflex pairs that touch or are nearer than a margin.
    ///
    /// # Arguments
    /// * `poses`: per robot its motors' positions, rad of encoder; a robot or motor without an entry is at home.
    /// * `within`: the margin, meters; zero for what touches.
    ///
    /// # Returns
    /// The pairs nearer than the margin and all that touch, sorted by pair; signed distances in meters, points in the world
    /// frame. Pairs that can't move against each other are left out (see [`Scene::static_contacts`]).
    ///
    /// # Performance
    /// Every pair is looked at anew. For a stream of poses ask a [`crate::Watch`], for a yes or no [`Scene::free`].
    pub fn contacts<P: AsRef<[f64]>>(&self, poses: &[P], within: f64) -> Vec<Contact> {
        let world = self.world();
        let found = world.engine.contacts(&self.placement(poses), &world.pairs, within);
        found.into_iter().map(|near| world.contact(near)).collect()
    }

    /// Distance query: the nearest reflex pair.
    ///
    /// # Arguments
    /// * `poses`: as for [`Scene::contacts`].
    /// * `cap`: how far it is worth looking, meters; the smaller, the faster.
    ///
    /// # Returns
    /// The pair of smallest signed distance, or `None` if all are farther apart than the cap. Of pairs that overlap it is the
    /// deepest.
    pub fn clearance<P: AsRef<[f64]>>(&self, poses: &[P], cap: f64) -> Option<Contact> {
        let world = self.world();
        let nearest = world.engine.clearance(&self.placement(poses), &world.pairs, cap);
        nearest.map(|near| world.contact(near))
    }

    /// Intersection test of all robots: whether every reflex pair is farther apart than `clearance` meters and every robot's
    /// pose satisfies its constraints.
    ///
    /// # Performance
    /// Stops at the first pair that is not, and measures no depth: the quickest query there is.
    pub fn free<P: AsRef<[f64]>>(&self, poses: &[P], clearance: f64) -> bool {
        // Constraints are a few products; shapes cost a pass of kinematics.
        if poses.iter().enumerate().any(|(r, q)| !self.satisfies_constraints(r, q.as_ref())) {
            return false;
        }
        let world = self.world();
        world.engine.free(&self.placement(poses), world.pairs.iter().copied(), clearance)
    }

    /// Intersection test of one robot, with itself, the others and objects: whether every reflex pair that it has part in is
    /// farther apart than `clearance` meters and its pose satisfies its constraints. What the others touch meanwhile is
    /// their matter.
    ///
    /// # Arguments
    /// * `robot`: its index in [`Scene::robots`].
    /// * `poses`: of all robots, as for [`Scene::contacts`].
    pub fn robot_free<P: AsRef<[f64]>>(&self, robot: usize, poses: &[P], clearance: f64) -> bool {
        if poses.get(robot).is_some_and(|q| !self.satisfies_constraints(robot, q.as_ref())) {
            return false;
        }
        let world = self.world();
        let own = world.pairs.iter().copied().filter(|pair| self.is_of(robot, *pair));
        world.engine.free(&self.placement(poses), own, clearance)
    }

    /// Whether one of two solids is a robot's.
    pub(super) fn is_of(&self, robot: usize, (i, j): IndexPair) -> bool {
        let solids = &self.world().solids;
        let own = |k: u32| matches!(solids[k as usize].id, ShapeId::Robot { robot: r, .. } if usize::from(r) == robot);
        own(i) || own(j)
    }

    /// Whether a robot's pose (rad of encoder) satisfies all of its constraints. One that the scene does not have does.
    pub fn satisfies_constraints(&self, robot: usize, q: &[f64]) -> bool {
        self.robots().get(robot).is_none_or(|r| r.violated(q).next().is_none())
    }

    /// Where every shape is at these poses.
    fn placement<P: AsRef<[f64]>>(&self, poses: &[P]) -> E::Placement {
        let (mut frames, mut placement) = (Vec::new(), E::Placement::default());
        self.bodies().place(poses, &mut frames);
        self.world().engine.place(&frames, &mut placement);
        placement
    }
}
