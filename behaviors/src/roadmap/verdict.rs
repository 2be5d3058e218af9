//! What the robot learned of its edges, beside what an offline check of the same straight lines says.
//!
//! The reflex acts at its margin, and the offline check asks for the margin and 2 mm more, so an edge whose clearance lies
//! within 2 mm of that may rightly be judged either way: it is counted apart.

use crate::roadmap::Roadmap;
use mobee_contract::{EdgeState, Pose};
use mobee_model::Scene;
use serde::Serialize;

/// How near to the clearance asked for an edge counts as borderline, meters.
pub const BORDERLINE: f64 = 0.002;
/// Longest way of any point of the robot between two samples of a line, meters.
pub const STEP: f64 = 0.001;

/// An edge that was driven, judged offline.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// Whether it was driven to its end.
    pub reached: bool,
    /// Whether the offline check finds it free and within all constraints.
    pub free: bool,
    /// The smallest distance on the line, meters, as far as it was measured (5 mm beyond the clearance).
    pub distance: f64,
    /// The nearest pair, or the violated constraint, in words.
    pub pair: Option<String>,
    /// What the robot was told stood in its way.
    pub cause: Option<String>,
}

/// The verdicts of all driven edges.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerdictReport {
    /// How many verdicts are equal and not borderline.
    pub agree: usize,
    /// Edges whose clearance is within [`BORDERLINE`] of what was asked for.
    pub borderline: Vec<Judged>,
    /// Edges on which robot and offline check differ.
    pub disagree: Vec<Judged>,
}

/// Judges every edge that was itself driven, in the scene it was driven in.
///
/// `poses`: where all robots stand (the agent's own pose does not matter). `clearance`: the reflex's margin and 2 mm.
/// Two directions of one pair count as two edges, if both were driven.
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
