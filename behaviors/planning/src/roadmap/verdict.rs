//! Comparison of the outcomes of driven edges with an offline check of the same straight lines.
//!
//! The reflex acts at its margin, and the offline check requires the margin plus 2 mm, so for an
//! edge with a clearance within 2 mm of that either outcome is correct: such edges are counted
//! separately.

use crate::roadmap::Roadmap;
use mobee_contract::{EdgeState, Pose};
use mobee_model::Scene;
use serde::Serialize;

/// Maximum difference from the required clearance of a borderline edge, meters.
pub const BORDERLINE: f64 = 0.002;
/// Maximum displacement of any point of the robot between two samples of a line, meters.
pub const STEP: f64 = 0.001;

/// A driven edge with its offline check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// The edge was driven to its end.
    pub reached: bool,
    /// The offline check found it free and within all constraints.
    pub free: bool,
    /// Smallest distance on the line, meters, as far as it was computed (5 mm beyond the
    /// clearance).
    pub distance: f64,
    /// Nearest pair, or the violated constraint, in words.
    pub pair: Option<String>,
    /// Obstacle that was reported to the robot.
    pub cause: Option<String>,
}

/// Comparison of all driven edges.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerdictReport {
    /// Number of edges with equal outcomes that are not borderline.
    pub agree: usize,
    /// Edges with a clearance within [`BORDERLINE`] of the required one.
    pub borderline: Vec<Judged>,
    /// Edges for which outcome and offline check differ.
    pub disagree: Vec<Judged>,
}

/// Checks every edge that was driven, in the scene in which it was driven.
///
/// `poses`: configurations of all robots (the agent's own is not used). `clearance`: the reflex's
/// margin plus 2 mm. The two directions of a pair are two edges, if both were driven.
pub fn judge(map: &Roadmap, scene: &Scene, robot: usize, poses: &[Pose], clearance: f64) -> VerdictReport {
    let mut report = VerdictReport::default();
    for (from, to, edge) in map.edges().into_iter().filter(|(.., e)| e.driven) {
        let (Some(a), Some(b)) = (map.vertex(from), map.vertex(to)) else { continue };
        let end = scene.robots().get(robot).map_or(b.q.clone(), |r| r.nearest_equivalent(&a.q, &b.q));
        let line = scene.line(robot, poses, &a.q, &end, STEP, clearance);
        let reached = edge.state == EdgeState::Feasible;
        let law = line.constraint.map(|(part, clause)| {
            let part = scene.robots().get(robot).and_then(|r| r.parts.get(part)).map_or("?", |p| p.name.as_str());
            format!("constraint {clause} of {part}")
        });
        let pair = line.pair.map(|(a, b)| format!("{} and {}", scene.shape_name(a), scene.shape_name(b)));
        let judged = Judged {
            from,
            to,
            reached,
            free: line.free,
            distance: line.min_distance,
            pair: law.or(pair),
            cause: edge.cause.clone(),
        };
        let borderline = line.constraint.is_none() && (line.min_distance - clearance).abs() <= BORDERLINE;
        match (borderline, line.free == reached) {
            (true, _) => report.borderline.push(judged),
            (false, true) => report.agree += 1,
            (false, false) => report.disagree.push(judged),
        }
    }
    report
}
