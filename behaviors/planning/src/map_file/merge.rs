//! Merge of maps of one robot in one world, independent of their order.
//!
//! Every part of the result is a maximum in some order, so that merging is commutative, associative
//! and idempotent. Vertices are identified by their poses and renumbered in the order of these. For
//! an edge, an observation takes precedence over an assumption, and failure over success. Of the
//! logs of one run, the longest is used: a log is append-only, so a shorter one is a prefix of it.

use super::{MapEdge, MapFile, MapVertex, StoredVerdict, TriedMotion, VERSION};
use mobee_contract::EdgeState;
use std::cmp::Ordering;
use std::collections::BTreeMap;

/// Reason why maps can't be merged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeRefusal {
    /// They differ in robot, world or motors.
    #[error("the maps have different {what}: {first} and {second}")]
    Different {
        /// Property in which they differ.
        what: &'static str,
        /// Value in the first map.
        first: String,
        /// Value in the second map.
        second: String,
    },
    /// Two different poses have the same name.
    #[error("two different poses are named {0:?}")]
    Named(String),
}

impl MergeRefusal {
    pub(super) fn none() -> MergeRefusal {
        let what = "numbers of maps";
        MergeRefusal::Different { what, first: "none".into(), second: "at least one".into() }
    }
}

/// Merges maps.
///
/// # Errors
/// Maps that differ in robot, world, hand or motors, and a name of two different poses.
pub fn merge(maps: &[MapFile]) -> Result<MapFile, MergeRefusal> {
    let mut maps: Vec<MapFile> = maps.to_vec();
    maps.iter_mut().for_each(MapFile::round);
    let Some(first) = maps.first() else { return Err(MergeRefusal::none()) };
    let mut merged = MapFile {
        version: VERSION,
        certified: maps.iter().filter_map(|m| m.certified.clone()).max_by(|a, b| json(a).cmp(&json(b))),
        vertices: Vec::new(),
        edges: Vec::new(),
        tried: Vec::new(),
        ..first.clone()
    };
    maps.iter().try_for_each(|map| differ(&merged, map, &ALL))?;
    let numbers = vertices(&mut merged, &maps)?;
    let mut edges: BTreeMap<(u32, u32), MapEdge> = BTreeMap::new();
    let mut logs: BTreeMap<Option<String>, Vec<TriedMotion>> = BTreeMap::new();
    for (map, number) in maps.iter().zip(&numbers) {
        let number = |id: u32| number.get(id as usize).copied().unwrap_or(0);
        for edge in &map.edges {
            let from = number(edge.from);
            let to = number(edge.to);
            let verdict = edge.verdict.clone().filter(|_| map.certified == merged.certified);
            join(&mut edges, MapEdge { from, to, verdict, ..edge.clone() });
        }
        let mut own: BTreeMap<Option<String>, Vec<TriedMotion>> = BTreeMap::new();
        for t in &map.tried {
            let t = TriedMotion { from: number(t.from), to: number(t.to), ..t.clone() };
            own.entry(t.run.clone()).or_default().push(t);
        }
        for (run, log) in own {
            let kept = logs.entry(run).or_default();
            if (log.len(), &log) > (kept.len(), kept) {
                *kept = log;
            }
        }
    }
    // A map may contain a pose twice, and an edge between the two.
    merged.edges = edges.into_values().filter(|e| e.from != e.to).collect();
    merged.tried = logs.into_values().flatten().collect();
    Ok(merged)
}

/// Properties in which two maps may differ.
const ALL: [&str; 6] = ["robots", "robot models", "worlds", "motors", "hands", "poses"];

/// Checks that two maps agree in these properties.
pub(super) fn differ(a: &MapFile, b: &MapFile, matters: &[&str]) -> Result<(), MergeRefusal> {
    let word = |x: &Option<String>| x.clone().unwrap_or_else(|| "not said".to_owned());
    let short = |x: &Option<String>| word(x).chars().take(12).collect::<String>();
    let length = |m: &MapFile| m.vertices.first().map(|v| v.q_rad.len());
    let poses = |m: &MapFile| length(m).map_or("none".to_owned(), |n| format!("{n} positions"));
    let checks = [
        ("robots", a.robot != b.robot, a.robot.clone(), b.robot.clone()),
        ("robot models", a.robot_sha256 != b.robot_sha256, short(&a.robot_sha256), short(&b.robot_sha256)),
        ("worlds", a.world_sha256 != b.world_sha256, short(&a.world_sha256), short(&b.world_sha256)),
        ("motors", a.motors != b.motors, a.motors.join(" "), b.motors.join(" ")),
        ("hands", a.hand != b.hand, word(&a.hand), word(&b.hand)),
        ("poses", length(a).zip(length(b)).is_some_and(|(a, b)| a != b), poses(a), poses(b)),
    ];
    let refuse = |(what, _, first, second)| MergeRefusal::Different { what, first, second };
    checks
        .into_iter()
        .find(|(what, differ, ..)| *differ && matters.contains(what))
        .map_or(Ok(()), |check| Err(refuse(check)))
}

/// A pose with a total order.
struct PoseKey<'a>(&'a [f64]);

impl Ord for PoseKey<'_> {
    fn cmp(&self, other: &Self) -> Ordering {
        let all = self.0.iter().zip(other.0).map(|(a, b)| a.total_cmp(b));
        all.fold(Ordering::Equal, Ordering::then).then(self.0.len().cmp(&other.0.len()))
    }
}
impl PartialOrd for PoseKey<'_> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl PartialEq for PoseKey<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for PoseKey<'_> {}

/// Adds the vertices of all maps; returns the new numbers of the vertices of each map.
fn vertices(merged: &mut MapFile, maps: &[MapFile]) -> Result<Vec<Vec<u32>>, MergeRefusal> {
    let mut all: BTreeMap<PoseKey<'_>, (Option<&String>, [f64; 3])> = BTreeMap::new();
    for v in maps.iter().flat_map(|m| &m.vertices) {
        let (name, at) = all.entry(PoseKey(&v.q_rad)).or_insert((None, v.at_m));
        match (*name, &v.name) {
            (Some(a), Some(b)) if a != b => {
                let first = a.min(b).clone();
                let second = a.max(b).clone();
                return Err(MergeRefusal::Different { what: "names for one pose", first, second });
            }
            (None, Some(b)) => *name = Some(b),
            _ => {}
        }
        if PoseKey(&v.at_m) > PoseKey(at) {
            *at = v.at_m;
        }
    }
    let mut numbers = BTreeMap::new();
    let mut names = BTreeMap::new();
    for (i, (key, (name, at))) in all.into_iter().enumerate() {
        if let Some(name) = name
            && names.insert(name, i).is_some()
        {
            return Err(MergeRefusal::Named(name.clone()));
        }
        merged.vertices.push(MapVertex { id: i as u32, name: name.cloned(), q_rad: key.0.to_vec(), at_m: at });
        numbers.insert(key, i as u32);
    }
    let number = |v: &MapVertex| numbers.get(&PoseKey(&v.q_rad)).copied().unwrap_or(0);
    Ok(maps.iter().map(|m| m.vertices.iter().map(number).collect()).collect())
}

/// Adds an edge, or merges it with the existing one.
fn join(edges: &mut BTreeMap<(u32, u32), MapEdge>, edge: MapEdge) {
    let known = edges.entry((edge.from, edge.to)).or_insert_with(|| edge.clone());
    let rank = |e: &MapEdge| {
        let state = match e.state {
            EdgeState::Doubtful => 1,
            EdgeState::Feasible => 2,
            EdgeState::Removed => 3,
            _ => 0,
        };
        (state, e.driven, e.cause.clone())
    };
    let verdict = |e: &MapEdge| e.verdict.as_ref().map(json::<StoredVerdict>);
    let certified = if verdict(known) < verdict(&edge) { edge.verdict.clone() } else { known.verdict.clone() };
    if rank(known) < rank(&edge) {
        *known = edge;
    }
    known.verdict = certified;
}

fn json<T: serde::Serialize>(value: &T) -> String {
    serde_json::to_string(value).unwrap_or_default()
}
