//! Decision of doubtful cases: the scalar engine, for the pairs that the lanes could not decide.

use mobee_model::{Engine, IndexPair, ScalarEngine, Scene, ShapeId};
use nalgebra::Isometry3;

/// A scene prepared for the scalar engine, and the pose at which it was placed last.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    scene: Scene,
    placement: <ScalarEngine as Engine>::Placement,
    frames: Vec<Isometry3<f64>>,
}

impl Reference {
    pub fn new(scene: &Scene) -> Self {
        Reference { scene: scene.clone(), placement: Default::default(), frames: Vec::new() }
    }

    /// Replaces the scene by one of the same robots.
    pub fn set_scene(&mut self, scene: &Scene) {
        self.scene = scene.clone();
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The identity of a collider's shape.
    pub fn shape_id(&self, collider: u32) -> Option<ShapeId> {
        self.scene.shape_id(collider)
    }

    /// The motors of each robot, from a pose of all robots.
    fn robots<'a>(&'a self, pose: &'a [f64]) -> impl Iterator<Item = &'a [f64]> {
        let mut rest = pose;
        self.scene.robots().iter().map(move |robot| {
            let (own, others) = rest.split_at_checked(robot.motors.len()).unwrap_or((rest, &[]));
            rest = others;
            own
        })
    }

    /// True if the pose satisfies all constraints and these pairs are free, checked by the scalar engine.
    pub fn free(&mut self, pose: &[f64], pairs: impl Iterator<Item = IndexPair>, clearance: f64) -> bool {
        self.satisfies_constraints(pose) && !self.any_touches(pose, pairs, clearance)
    }

    /// True if the pose satisfies all constraints.
    pub fn satisfies_constraints(&self, pose: &[f64]) -> bool {
        self.robots(pose).enumerate().all(|(r, own)| self.scene.satisfies_constraints(r, own))
    }

    /// The clearance that applies to a pair.
    pub fn clearance(&self, pair: IndexPair, clearance: f64) -> f64 {
        self.scene.pair_clearance(pair, clearance)
    }

    /// True if any of these pairs is not farther apart than the clearance that applies to it.
    pub fn any_touches(&mut self, pose: &[f64], mut pairs: impl Iterator<Item = IndexPair>, clearance: f64) -> bool {
        self.place(pose);
        pairs.any(|pair| self.touches(pair, self.clearance(pair, clearance)))
    }

    /// Places everything at a pose.
    pub fn place(&mut self, pose: &[f64]) {
        let mut frames = std::mem::take(&mut self.frames);
        frames.clear();
        for (skeleton, own) in self.scene.skeletons().iter().zip(self.robots(pose)) {
            skeleton.place(own, &mut frames);
        }
        frames.push(Isometry3::identity());
        self.frames = frames;
        self.scene.engine().place_frames(&self.frames, &mut self.placement);
    }

    /// True if a pair is within exactly this distance, meters, at the pose of [`Reference::place`].
    pub fn touches(&mut self, pair: IndexPair, clearance: f64) -> bool {
        self.scene.engine().place_pair(&mut self.placement, pair);
        self.scene.engine().touches(&self.placement, pair, clearance)
    }
}
