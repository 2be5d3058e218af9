//! Notes about the decisions of an import: one line each, for robot files and users.

use crate::{Comparison, Fit, Refitted};

use mobee_model::{NearPair, Robot};
use std::collections::BTreeMap;

/// Maximum number of moved motors that are named.
const MAX_NAMED_MOTORS: usize = 8;
/// Maximum number of pairs of links that are named.
const MAX_NAMED_PAIRS: usize = 8;

/// The joints that are fixed because the SRDF marks them as passive, if there are any.
pub(super) fn passive(held: &BTreeMap<String, f64>) -> Option<String> {
    let names: Vec<String> = held.iter().map(|(name, q)| format!("{name} (at {q} rad or m)")).collect();
    (!names.is_empty())
        .then(|| format!("without a motor and still, as the SRDF calls them passive: {}", names.join(", ")))
}

/// The motors of a pose that are clamped to their limits, with the position that the pose requests.
pub(super) fn at_limits(robot: &Robot, beyond: &[(usize, f64)]) -> String {
    let one = |(m, wanted): &(usize, f64)| {
        let motor = robot.motors.get(*m)?;
        let limit = if *wanted < motor.min { motor.min } else { motor.max };
        let [limit, wanted] = [limit, *wanted].map(f64::to_degrees);
        Some(format!("{} at its limit of {limit:.1} {}, not at {wanted:.1}", motor.name, motor.motion.unit()))
    };
    let all: Vec<String> = beyond.iter().filter_map(one).collect();
    if all.is_empty() { String::new() } else { format!(", but {}", all.join(", ")) }
}

/// The motors that are displaced, and by how much, degrees or millimeters.
pub(super) fn motor_offsets(robot: &Robot, moved: &[(usize, f64)]) -> String {
    let one = |(m, by): &(usize, f64)| {
        let motor = robot.motors.get(*m)?;
        let by = by.to_degrees();
        let digits = if by.abs() < 9.5 { 1 } else { 0 };
        Some(format!("{} by {by:.digits$} {}", motor.name, motor.motion.unit()))
    };
    let mut all: Vec<String> = moved.iter().take(MAX_NAMED_MOTORS).filter_map(one).collect();
    if moved.len() > all.len() {
        all.push(format!("and {} more", moved.len() - all.len()));
    }
    all.join(", ")
}

/// The links whose shapes exceed the requested overshoot, if there are any.
pub(super) fn coarse(fits: &BTreeMap<String, Fit>, most: f64) -> Option<String> {
    let over = fits.iter().map(|(link, fit)| (fit.overshoot(), link)).filter(|(by, _)| by * 1e3 >= most * 1e3 + 0.5);
    let mut over: Vec<(f64, &String)> = over.collect();
    over.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (by, link) = over.first()?;
    let links = over.len();
    let by = by * 1e3;
    let most = most * 1e3;
    Some(format!(
        "shapes stick out by more than {most:.0} mm at {links} link(s), by {by:.0} mm at most ({link}); more shapes stick out \
         less: --shapes N"
    ))
}

/// The pairs of links with a clearance of their own, if there are any.
pub(super) fn near_note(robot: &Robot) -> Option<String> {
    let name = |node: usize| robot.nodes.get(node).and_then(|n| n.name.as_deref()).unwrap_or("?");
    let one = |near: &NearPair| {
        let mm = near.clearance * 1e3;
        format!("{} and {} ({mm:.0} mm: {})", name(near.nodes.0), name(near.nodes.1), near.reason)
    };
    let mut all: Vec<String> = robot.near.iter().take(MAX_NAMED_PAIRS).map(one).collect();
    if robot.near.len() > all.len() {
        all.push(format!("{} more", robot.near.len() - all.len()));
    }
    (!all.is_empty()).then(|| format!("pairs with a clearance of their own: {}", all.join(", ")))
}

/// Accuracy of the finished shapes compared with the meshes.
pub(super) fn verdict(seen: &Comparison) -> String {
    let missed = if seen.missed == 0 { "none".to_owned() } else { format!("{} contacts", seen.missed) };
    format!(
        "shapes against meshes at {} random configurations: of the free ones {:.1} % are blocked, {missed} missed",
        seen.poses,
        100.0 * seen.blocked_share()
    )
}

/// Result of fitting a link closer.
pub(super) fn refit_note(Refitted { link, shapes: (before, after), hulls, overshoot }: &Refitted) -> String {
    let why = "as its shapes touched falsely";
    let shapes = if after == before { format!("{after} shapes") } else { format!("{after} shapes, not {before}") };
    let now = match hulls {
        0 => format!("within {:.0} mm", overshoot * 1e3),
        some if some == after => "all with hulls".to_owned(),
        some => format!("{some} of them with hulls"),
    };
    format!("link {link}: fitted closer, {why}: {shapes}, {now}")
}
