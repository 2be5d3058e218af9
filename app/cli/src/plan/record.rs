//! A recording of a planned path: the robot along it, with the path of its hand.

use super::PlanArgs;
use crate::view::recording_settings;
use miette::{Report, miette};
use mobee_compose::maps::robot;
use mobee_model::Scene;
use mobee_planning::planners::JointPath;
use mobee_recorder::{MapLines, MapView, view_map};
use std::path::Path;

/// Number of configurations of a recorded path, roughly.
const RECORDED_POSES: f64 = 120.0;

/// Configurations of the whole robot along a path, rad of encoder, and the indices of the waypoints among them.
pub(super) struct RecordedPath {
    poses: Vec<Vec<f64>>,
    waypoints: Vec<usize>,
}

impl RecordedPath {
    /// Samples a path of these motors; the others are where they are in `from`.
    pub fn along(from: &[f64], motors: &[usize], path: &JointPath) -> RecordedPath {
        let whole = |group: Vec<f64>| -> Vec<f64> {
            let mut pose = from.to_vec();
            for (m, q) in motors.iter().zip(group) {
                if let Some(slot) = pose.get_mut(*m) {
                    *slot = q;
                }
            }
            pose
        };
        let mut poses: Vec<Vec<f64>> = path.poses.first().cloned().map(whole).into_iter().collect();
        let mut waypoints = vec![0];
        let length = path.length().max(1e-9);
        for (from, to) in path.edges() {
            let edge = from.iter().zip(to).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt();
            let steps = (RECORDED_POSES * edge / length).ceil().max(1.0) as usize;
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                poses.push(whole(from.iter().zip(to).map(|(a, b)| a + (b - a) * share).collect()));
            }
            waypoints.push(poses.len() - 1);
        }
        RecordedPath { poses, waypoints }
    }
}

/// Writes the recording. The hand is the marker of `--hand`, or the marker that moves farthest.
///
/// # Errors
/// If the file can't be written.
pub(super) fn write(args: &PlanArgs, scene: &Scene, path: &RecordedPath, file: &Path) -> Result<(), Report> {
    let robot = robot(scene)?;
    let at = |q: &[f64], marker: usize| {
        robot.markers_at(q).get(marker).map_or([0.0; 3], |pose| pose.position().coords.into())
    };
    let length = |marker: usize| {
        let places: Vec<[f64; 3]> = path.poses.iter().map(|q| at(q, marker)).collect();
        let steps = places.windows(2).map(|w| (0..3).map(|k| (w[1][k] - w[0][k]).powi(2)).sum::<f64>().sqrt());
        steps.sum::<f64>()
    };
    let named = args.hand.as_ref().and_then(|hand| robot.markers.iter().position(|m| m.name == *hand));
    let farthest = || (0..robot.markers.len()).max_by(|a, b| length(*a).total_cmp(&length(*b)));
    let hand = named.or_else(farthest).unwrap_or_default();
    let vertices: Vec<[f64; 3]> = path.poses.iter().map(|q| at(q, hand)).collect();
    let poses: Vec<&[f64]> = path.poses.iter().map(Vec::as_slice).collect();
    let label = |i: usize| {
        let waypoint = path.waypoints.iter().position(|w| *w == i)?;
        Some(if waypoint == 0 { "start".to_owned() } else { waypoint.to_string() })
    };
    let labels: Vec<Option<String>> = (0..poses.len()).map(label).collect();
    let names: Vec<Option<&str>> = labels.iter().map(Option::as_deref).collect();
    let edges = (1..poses.len() as u32).map(|i| (i - 1, i)).collect();
    let lines = [MapLines { name: "path".to_owned(), blocked: false, edges }];
    let view = MapView { scene, vertices: &vertices, poses: &poses, names: &names, lines: &lines };
    let settings = recording_settings(file, &robot.name, &args.robot);
    view_map(&settings, &view).map_err(|why| miette!("{}: {why}", file.display()))
}
