//! `mobee roadmap info`: what a map holds, in a few lines.

use mobee_behaviors::map_file::MapFile;
use mobee_behaviors::table_map::figures;
use mobee_contract::EdgeState;
use std::collections::BTreeMap;
use std::fmt::Write;

/// More groups than this are not told apart.
const MOST: usize = 12;

/// The lines.
pub fn text(map: &MapFile) -> String {
    let mut out = format!(
        "version {}, robot {}{}, {} vertices, {} directed edges\n",
        map.version,
        map.robot,
        short(map.robot_sha256.as_deref()),
        map.vertices.len(),
        map.edges.len()
    );
    let _ = writeln!(out, "world: {}", map.world_sha256.as_deref().map_or("not said".into(), twelve));
    let _ = writeln!(out, "motors: {}; hand: {}", map.motors.join(" "), map.hand.as_deref().unwrap_or("not said"));
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
            out += &(verdicts(map) + "\n");
        }
    }
    let reached = map.tried.iter().filter(|t| t.reached).count();
    let _ = writeln!(out, "tried: {} motions, {reached} of them driven to their end", map.tried.len());
    out + &spacing(map)
}

/// How many edges are free, and how many are blocked by what.
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
    let more = by.len().saturating_sub(MOST);
    let mut words: Vec<String> = by.iter().take(MOST).map(|(what, n)| format!("{what} {n}")).collect();
    if more > 0 {
        words.push(format!("{more} more"));
    }
    if words.is_empty() {
        format!("{free} free, none blocked")
    } else {
        format!("{free} free; blocked: {}", words.join(", "))
    }
}

/// How far each hand position is from the next.
fn spacing(map: &MapFile) -> String {
    let at: Vec<[f64; 3]> = map.vertices.iter().map(|v| v.at_m).collect();
    let found = figures(&at);
    if found.nearest_mm.is_empty() {
        return String::new();
    }
    let bars: Vec<String> = found.nearest_mm.iter().take(MOST).map(|(mm, n)| format!("{mm} mm {n}")).collect();
    let dots = if found.nearest_mm.len() > MOST { ", ..." } else { "" };
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
