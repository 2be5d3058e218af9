//! Simulation ahead: whether a robot may go straight to a configuration. No Python here.

use mobee_contract::Pose;
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Contact, Scene};
use std::sync::Arc;

/// Configurations at which a motion out of an obstacle's clearance is tested.
const SAMPLES: u32 = 4;
/// Rounding of a distance, m: a pair that gets nearer by less does not get nearer.
const EPSILON_M: f64 = 1e-4;

/// Proves straight motions of one robot free.
pub(super) struct FollowGuard {
    robot: usize,
    /// Distance that must remain, m.
    clearance: f64,
    compiled: Option<(Arc<Scene>, FastScene)>,
    edge: Vec<f64>,
    verdicts: Vec<EdgeVerdict>,
}

impl FollowGuard {
    pub fn new(robot: usize, clearance: f64) -> Self {
        Self { robot, clearance, compiled: None, edge: Vec::new(), verdicts: Vec::new() }
    }

    /// Takes over a scene and the distance that must remain: some milliseconds if either has changed.
    ///
    /// # Errors
    /// If the scene can't be compiled.
    pub fn set(&mut self, scene: &Arc<Scene>, clearance: f64) -> Result<(), String> {
        let same = |(of, _): &(Arc<Scene>, FastScene)| Arc::ptr_eq(of, scene);
        if clearance == self.clearance && self.compiled.as_ref().is_some_and(same) {
            return Ok(());
        }
        self.clearance = clearance;
        let fast = FastScene::new(scene, clearance).map_err(|e| e.to_string())?;
        self.compiled = Some((scene.clone(), fast));
        Ok(())
    }

    /// Tests the straight line from `from` to `to`, rad of encoder, with all other robots where they are.
    ///
    /// A robot that is nearer to something than the clearance may only go away from it.
    ///
    /// # Errors
    /// Description of the obstacle.
    pub fn test(&mut self, poses: &[Pose], from: &[f64], to: &[f64]) -> Result<(), String> {
        let Some((scene, fast)) = &mut self.compiled else { return Err("the scene is not compiled yet".into()) };
        self.edge.clear();
        for end in [from, to] {
            for (robot, pose) in poses.iter().enumerate() {
                self.edge.extend_from_slice(if robot == self.robot { end } else { pose });
            }
        }
        fast.certify(&self.edge, &mut self.verdicts).map_err(|e| e.to_string())?;
        let obstruction = match self.verdicts.first() {
            Some(EdgeVerdict::Free) => return Ok(()),
            Some(EdgeVerdict::Blocked(obstruction)) => Some(obstruction.pair),
            Some(EdgeVerdict::Uncertified { .. }) | None => None,
        };
        if obstruction != Some(None) && leaves(scene, self.robot, self.clearance, poses, (from, to)) {
            return Ok(());
        }
        let Some((a, b)) = obstruction.flatten() else {
            return Err(match obstruction {
                Some(_) => "a constraint of the robot would be violated".into(),
                None => "two shapes are too near for a proof that the motion is free".into(),
            });
        };
        let (a, b) = (scene.shape_name(a), scene.shape_name(b));
        Err(format!("{a} would come nearer than {:.0} mm to {b}", 1e3 * self.clearance))
    }
}

/// Tests that a robot that starts within the clearance of something gets no nearer to it, or to anything else.
fn leaves(scene: &Scene, robot: usize, clearance: f64, poses: &[Pose], (from, to): (&[f64], &[f64])) -> bool {
    let near = |share: f64| -> Vec<Contact> {
        let q: Pose = from.iter().zip(to).map(|(a, b)| a + (b - a) * share).collect();
        let all: Vec<Pose> =
            poses.iter().enumerate().map(|(r, pose)| if r == robot { q.clone() } else { pose.clone() }).collect();
        scene.contacts(&all, clearance)
    };
    let mut before = near(0.0);
    if before.is_empty() {
        return false;
    }
    for k in 1..=SAMPLES {
        let now = near(f64::from(k) / f64::from(SAMPLES));
        let nearer = |c: &Contact| {
            let was = before.iter().find(|b| b.pair == c.pair).map_or(f64::INFINITY, |b| b.distance);
            c.distance < was - EPSILON_M
        };
        if now.iter().any(nearer) {
            return false;
        }
        before = now;
    }
    true
}
