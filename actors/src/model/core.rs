//! The model's state: scene, newest poses, and the watch that finds what is near.

use crate::controller::{RELEASE, Rules};
use crate::pulse::Pulse;
use mobee_contract::{Event, Pose};
use mobee_model::{Contact, Counters, Edit, Scene, SceneError, ShapeId, Watch};
use std::sync::Arc;

/// The state machine.
pub struct ModelCore {
    watch: Watch,
    poses: Vec<Pose>,
    /// Margin of each robot, metres.
    margins: Vec<f64>,
    none: Arc<[Contact]>,
}

impl ModelCore {
    /// With these poses, one per robot.
    pub fn new(scene: Arc<Scene>, poses: Vec<Pose>, rules: &[Arc<Rules>]) -> ModelCore {
        let margins: Vec<f64> = rules.iter().map(|r| r.margin).collect();
        let widest = margins.iter().copied().fold(0.0, f64::max);
        ModelCore { watch: Watch::new(scene, widest + RELEASE), poses, margins, none: Vec::new().into() }
    }

    /// Completes a robot's pulse with the pairs nearer than its margin + 2 mm and the first violated constraint.
    /// Returns the pairs nearer than the margin, for display.
    pub fn pulse(&mut self, robot: usize, pulse: &mut Pulse) -> Arc<[Contact]> {
        let (Some(pose), Some(margin)) = (self.poses.get_mut(robot), self.margins.get(robot)) else {
            return self.none.clone();
        };
        *pose = pulse.sample.q.clone();
        let mine = |id: ShapeId| matches!(id, ShapeId::Robot { robot: r, .. } if usize::from(r) == robot);
        let near = self.watch.update(&self.poses);
        let within = |limit: f64| -> Arc<[Contact]> {
            let hit = |c: &&Contact| c.distance < limit && (mine(c.pair.0) || mine(c.pair.1));
            if near.iter().any(|c| hit(&c)) { near.iter().filter(hit).copied().collect() } else { self.none.clone() }
        };
        pulse.contacts = within(margin + RELEASE);
        let touching = if pulse.contacts.is_empty() { self.none.clone() } else { within(*margin) };
        let scene = self.watch.scene();
        pulse.epoch = scene.epoch();
        pulse.violated = scene.robots().get(robot).and_then(|r| r.violated(&pulse.sample.q).next());
        touching
    }

    /// Changes the world, or nothing.
    pub fn edit(&mut self, edit: &Edit) -> Result<Arc<Scene>, SceneError> {
        let scene = Arc::new(self.watch.scene().edit(edit)?);
        self.watch.set_scene(scene.clone());
        Ok(scene)
    }

    /// How much work the watch had.
    pub fn work(&self) -> Counters {
        self.watch.counters()
    }
}

/// An edit as events.
pub fn told(edit: &Edit, scene: &Scene) -> Vec<Event> {
    let (name, what) = match edit {
        Edit::Add(object) => (object.name.as_str(), "added"),
        Edit::Remove { name } => (name.as_str(), "removed"),
        Edit::Move { name, .. } => (name.as_str(), "moved"),
        Edit::Class { name, .. } => (name.as_str(), "changed"),
        Edit::Clear => ("", "cleared"),
    };
    let object = scene.object(name).map(|(_, o)| o);
    vec![Event::World {
        object: name.to_owned(),
        what: what.to_owned(),
        class: object.map(|o| o.class),
        at: object.map(|o| o.pose.translation.vector.into()),
    }]
}
