//! `mobee roadmap info`: the contents of a map, in a few lines.

use mobee_contract::EdgeState;
use mobee_model::Labels;
use mobee_planning::map_file::{MapFile, StoredVerdict};
use mobee_planning::table_map::figures;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Maximum number of groups that are listed.
const MAX_GROUPS: usize = 12;

/// Maximum number of listed pairs of shapes that block edges.
const MAX_PAIRS: usize = 5;

/// The lines, with labels of the robot's shapes if its file is given.
pub fn text(map: &MapFile, labels: Option<&Labels>) -> String {
    let mut out = format!(
        "version {}, robot {}{}, {} vertices, {} directed edges\n",
        map.version,
        map.robot,
        short(map.robot_sha256.as_deref()),
        map.vertices.len(),
        map.edges.len()
    );
    let _ = writeln!(out, "world: {}", map.world_sha256.as_deref().map_or("none recorded".into(), twelve));
    let _ = writeln!(out, "motors: {}; hand: {}", map.motors.join(" "), map.hand.as_deref().unwrap_or("none recorded"));
    let states = [
        (EdgeState::Optimistic, "untried"),
        (EdgeState::Feasible, "feasible"),
        (EdgeState::Doubtful, "doubtful"),
        (EdgeState::Removed, "removed"),
    ];
    let count = |state| map.edges.iter().filter(|e| e.state == state).count();
    let states: Vec<String> = states.iter().map(|(state, word)| format!("{} {word}", count(*state))).collect();
    let _ = writeln!(out, "edges: {}", states.join(", "));
    match &map.certified {
        None => out += "certified: no; `mobee roadmap validate` does it\n",
        Some(c) => {
            let _ = write!(out, "certified in world {} at {:.1} mm: ", twelve(&c.world_sha256), c.clearance_m * 1e3);
            out += &(verdicts(map) + "\n" + &pairs(map, labels));
        }
    }
    let reached = map.tried.iter().filter(|t| t.reached).count();
    let _ = writeln!(out, "tried: {} motions, {reached} of them driven to their end", map.tried.len());
    out + &spacing(map)
}

/// The number of free edges, and of blocked ones by obstacle.
pub fn verdicts(map: &MapFile) -> String {
    let mut by: BTreeMap<&str, usize> = BTreeMap::new();
    let mut free = 0;
    for verdict in map.edges.iter().filter_map(|e| e.verdict.as_ref()) {
        match verdict.blocked_by() {
            Some(what) => *by.entry(what).or_default() += 1,
            None => free += 1,
        }
    }
    let mut by: Vec<(&str, usize)> = by.into_iter().collect();
    by.sort_by_key(|(what, n)| (std::cmp::Reverse(*n), *what));
    let more = by.len().saturating_sub(MAX_GROUPS);
    let mut words: Vec<String> = by.iter().take(MAX_GROUPS).map(|(what, n)| format!("{what} {n}")).collect();
    if more > 0 {
        words.push(format!("{more} more"));
    }
    if words.is_empty() {
        format!("{free} free, none blocked")
    } else {
        format!("{free} free; blocked: {}", words.join(", "))
    }
}

/// The pairs of shapes that block most edges, as a line; empty if there are none.
pub fn pairs(map: &MapFile, labels: Option<&Labels>) -> String {
    let mut by: BTreeMap<[String; 2], usize> = BTreeMap::new();
    for verdict in map.edges.iter().filter_map(|e| e.verdict.as_ref()) {
        if let StoredVerdict::Blocked { between: Some(pair), .. } = verdict {
            let mut pair = pair.each_ref().map(|shape| readable(shape, labels));
            pair.sort();
            *by.entry(pair).or_default() += 1;
        }
    }
    if by.is_empty() {
        return String::new();
    }
    let mut by: Vec<([String; 2], usize)> = by.into_iter().collect();
    by.sort_by(|(a, n), (b, m)| m.cmp(n).then(a.cmp(b)));
    let mut words: Vec<String> = by.iter().take(MAX_PAIRS).map(|([a, b], n)| format!("{a} and {b} {n}")).collect();
    if by.len() > MAX_PAIRS {
        words.push(format!("{} more pairs", by.len() - MAX_PAIRS));
    }
    format!("pairs that block most edges: {}\n", words.join(", "))
}

/// A shape's stable name as readable text: its label, or without the robot's file the robot and its part or link, or
/// the object.
fn readable(shape: &str, labels: Option<&Labels>) -> String {
    let body = shape.rsplit_once('#').map_or(shape, |(body, _)| body);
    if let Some(label) = labels.map(|labels| labels.read(shape)).filter(|label| label != body) {
        return label.into_owned();
    }
    let Some((robot, place)) = body.split_once(':') else { return body.to_owned() };
    // `part/7` is a node's number in a part; a link has its own name
    let is_number = |n: &str| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit());
    let place = place.rsplit_once('/').filter(|(_, n)| is_number(n)).map_or(place, |(part, _)| part);
    format!("{robot} {place}")
}

/// Statistics of the distance of each hand position to the nearest other.
fn spacing(map: &MapFile) -> String {
    let at: Vec<[f64; 3]> = map.vertices.iter().map(|v| v.at_m).collect();
    let found = figures(&at);
    if found.nearest_mm.is_empty() {
        return String::new();
    }
    let bars: Vec<String> = found.nearest_mm.iter().take(MAX_GROUPS).map(|(mm, n)| format!("{mm} mm {n}")).collect();
    let dots = if found.nearest_mm.len() > MAX_GROUPS { ", ..." } else { "" };
    format!(
        "spacing: median {:.1} mm; poses by the distance of their nearest: {}{dots}\n",
        found.median * 1e3,
        bars.join(", ")
    )
}

fn twelve(digest: &str) -> String {
    digest.chars().take(12).collect()
}

fn short(digest: Option<&str>) -> String {
    digest.map_or(String::new(), |d| format!(" ({})", twelve(d)))
}
