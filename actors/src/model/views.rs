//! The latest of everything an agent may see: cells that never grow and that nobody waits for.

use mobee_contract::{Axis, Pose, Time, View};
use mobee_model::{Contact, Scene};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Latest scene, poses and contacts.
#[derive(Debug)]
pub struct Views(Mutex<Cells>);

#[derive(Debug)]
struct Cells {
    scene: Arc<Scene>,
    poses: Vec<Pose>,
    seen: Vec<Arc<[Contact]>>,
}

impl Views {
    /// All robots at home, nothing touched.
    pub fn new(scene: Arc<Scene>) -> Views {
        let poses = scene.home();
        let seen = poses.iter().map(|_| Vec::new().into()).collect();
        Views(Mutex::new(Cells { scene, poses, seen }))
    }

    fn cells(&self) -> MutexGuard<'_, Cells> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The scene.
    pub fn scene(&self) -> Arc<Scene> {
        self.cells().scene.clone()
    }

    /// The newest poses, in the scene's order.
    pub fn poses(&self) -> Vec<Pose> {
        self.cells().poses.clone()
    }

    /// A new scene.
    pub fn set_scene(&self, scene: Arc<Scene>) {
        self.cells().scene = scene;
    }

    /// A robot's newest pose.
    pub fn set_pose(&self, robot: usize, pose: &Pose) {
        if let Some(p) = self.cells().poses.get_mut(robot) {
            *p = pose.clone();
        }
    }

    /// A robot's present contacts, or those that began during its last motion.
    pub fn set_seen(&self, robot: usize, contacts: Arc<[Contact]>) {
        if let Some(c) = self.cells().seen.get_mut(robot) {
            *c = contacts;
        }
    }

    /// A snapshot for a robot's agent.
    pub fn view(&self, robot: usize, at: Time, axes: Arc<[Axis]>, clearance: f64) -> View {
        let cells = self.cells();
        let contacts = cells.seen.get(robot).cloned().unwrap_or_else(|| Vec::new().into());
        View { at, robot, axes, poses: cells.poses.clone(), scene: cells.scene.clone(), contacts, clearance }
    }
}
