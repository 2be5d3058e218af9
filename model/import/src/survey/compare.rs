//! Comparison of contacts between the fitted shapes with contacts between the meshes.

use super::Subject;
use crate::Surfaces;
use mobee_model::{Robot, SceneError, random_poses};
use std::collections::BTreeMap;

/// Mesh distance, meters, below which no plan passes: plans maintain 2 mm more than the margin of the reflex.
const APART_M: f64 = 0.002;

/// Counts for a pair of links.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactCounts {
    /// Poses that are free by the meshes, at which the shapes touched.
    pub falsely: usize,
    /// Poses at which the meshes met and the shapes did not; zero if the shapes contain the meshes.
    pub missed: usize,
    /// Poses at which the meshes met.
    pub met: usize,
}

/// Self-collision of a robot by shapes compared with that by meshes, at random poses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Number of poses.
    pub poses: usize,
    /// Poses in contact by the meshes, in tested pairs.
    pub by_meshes: usize,
    /// Poses in contact by the robot's shapes.
    pub by_shapes: usize,
    /// Poses in contact by the shapes and free by the meshes.
    pub falsely: usize,
    /// Of these, poses at which the meshes of a pair in false contact are at least 2 mm apart, so that a robot could
    /// reach them.
    pub falsely_apart: usize,
    /// Poses in contact by the meshes and free by the shapes.
    pub missed: usize,
    /// The counts for each tested pair of links with any count above zero, by link names.
    pub pairs: BTreeMap<(String, String), ContactCounts>,
    /// Disabled pairs whose meshes met, with the number of poses: harmless only for neighbors.
    pub left_out_met: BTreeMap<(String, String), usize>,
}

impl Comparison {
    /// Share of the mesh-free poses that the shapes block, 0 to 1.
    pub fn blocked_share(&self) -> f64 {
        self.falsely as f64 / (self.poses - self.by_meshes).max(1) as f64
    }

    /// As [`Comparison::blocked_share`], without the poses at which meshes are within 2 mm of each other.
    pub fn blocked_apart_share(&self) -> f64 {
        self.falsely_apart as f64 / (self.poses - self.by_meshes).max(1) as f64
    }
}

/// Compares a robot's shapes with the meshes of its links at random poses; equal seeds give equal results.
///
/// # Errors
/// If the robot can't be placed in a scene.
pub fn compare(
    robot: &Robot,
    surfaces: &Surfaces,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> Result<Comparison, SceneError> {
    let subject = Subject::new(robot, surfaces)?;
    let names: Vec<&str> = surfaces.links().collect();
    let named = |(a, b): (usize, usize)| {
        let name = |node: usize| subject.surface_of.get(&node).map_or("?", |s| names[*s]).to_owned();
        (name(a), name(b))
    };
    let tested: Vec<_> = subject.tested.iter().filter_map(|p| Some((*p, subject.surfaces(*p)?))).collect();
    let disabled = robot.left_out.iter().flatten().map(|l| l.nodes);
    let disabled: Vec<_> = disabled.filter_map(|p| Some((p, subject.surfaces(p)?))).collect();
    let mut out = Comparison { poses, ..Comparison::default() };
    for (done, q) in random_poses(robot, seed).take(poses).enumerate() {
        let near = subject.near(&q, 0.0);
        let frames = surfaces.frames(robot, &q);
        let mut meeting = Vec::new();
        for (pair, (a, b)) in &tested {
            if surfaces.meet(&frames, *a, *b) {
                meeting.push(*pair);
                let counts = out.pairs.entry(named(*pair)).or_default();
                counts.met += 1;
                counts.missed += usize::from(!near.contains_key(pair));
            }
        }
        for (pair, (a, b)) in &disabled {
            if surfaces.meet(&frames, *a, *b) {
                *out.left_out_met.entry(named(*pair)).or_default() += 1;
            }
        }
        out.by_meshes += usize::from(!meeting.is_empty());
        out.by_shapes += usize::from(!near.is_empty());
        out.missed += usize::from(meeting.iter().any(|p| !near.contains_key(p)) && near.is_empty());
        if meeting.is_empty() && !near.is_empty() {
            out.falsely += 1;
            let near_too =
                |pair: &(usize, usize)| subject.surfaces(*pair).is_some_and(|p| surfaces.near(&frames, p, APART_M));
            out.falsely_apart += usize::from(!near.keys().all(near_too));
            near.keys().for_each(|pair| out.pairs.entry(named(*pair)).or_default().falsely += 1);
        }
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    Ok(out)
}
