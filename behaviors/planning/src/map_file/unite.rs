//! Combination of maps of several limbs of one robot into one map of all their motors.
//!
//! ```text
//! torso, right arm ──┐
//!                    ├──> torso, right arm, left arm      vertices and edges of the one, then those of the other
//! torso, left arm  ──┘
//! ```
//! A vertex is a configuration of the whole robot and stays the same: motors that its own map does
//! not move are where that map was built, at home. No edge leads from one map to another; a planner
//! joins them, for example where all limbs rest.

use super::merge::{MergeRefusal, differ};
use super::{MapEdge, MapFile, MapVertex, TriedMotion, VERSION};
use std::collections::BTreeSet;

/// Combines maps into one of all motors that they move, in the order in which they are named.
/// Verdicts are dropped, because they apply to different parts of the robot. If two vertices have
/// the same name, only the first keeps it.
///
/// # Errors
/// An empty list, or maps of different robots or worlds.
pub fn unite(maps: &[MapFile]) -> Result<MapFile, MergeRefusal> {
    let Some(first) = maps.first() else { return Err(MergeRefusal::none()) };
    let hand = first.hand.clone().filter(|_| maps.iter().all(|map| map.hand == first.hand));
    let mut all = MapFile {
        version: VERSION,
        hand,
        certified: None,
        vertices: Vec::new(),
        edges: Vec::new(),
        tried: Vec::new(),
        ..first.clone()
    };
    for map in maps {
        differ(first, map, &["robots", "robot models", "worlds", "poses"])?;
        let before = all.vertices.len() as u32;
        let news = map.motors.iter().filter(|m| !first.motors.contains(m));
        let news: Vec<String> = news.filter(|m| !all.motors.contains(m)).cloned().collect();
        all.motors.extend(news);
        let names: BTreeSet<String> = all.vertices.iter().filter_map(|v| v.name.clone()).collect();
        let vertex = |v: &MapVertex| {
            let name = v.name.clone().filter(|name| !names.contains(name));
            MapVertex { id: before + v.id, name, ..v.clone() }
        };
        all.vertices.extend(map.vertices.iter().map(vertex));
        let edge = |e: &MapEdge| MapEdge { from: before + e.from, to: before + e.to, verdict: None, ..e.clone() };
        all.edges.extend(map.edges.iter().map(edge));
        let tried = |t: &TriedMotion| TriedMotion { from: before + t.from, to: before + t.to, ..t.clone() };
        all.tried.extend(map.tried.iter().map(tried));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::EdgeState;

    /// Creates a map of these motors of a robot of three, with two vertices and an edge.
    fn map(motors: &[&str], hand: &str, q: [[f64; 3]; 2]) -> MapFile {
        let vertex = |(id, q): (u32, [f64; 3])| MapVertex { id, name: None, q_rad: q.to_vec(), at_m: [0.0; 3] };
        MapFile {
            version: VERSION,
            robot: "any".to_owned(),
            robot_sha256: None,
            world_sha256: None,
            motors: motors.iter().map(|m| (*m).to_owned()).collect(),
            hand: Some(hand.to_owned()),
            certified: None,
            vertices: vec![vertex((0, q[0])), vertex((1, q[1]))],
            edges: vec![MapEdge {
                from: 0,
                to: 1,
                state: EdgeState::Feasible,
                driven: true,
                cause: None,
                verdict: None,
            }],
            tried: Vec::new(),
        }
    }

    /// Only the numbers of the vertices change, and a motor that both maps move counts once.
    #[test]
    fn the_maps_lie_side_by_side() {
        let right = map(&["torso", "right"], "r_hand", [[0.1, 0.2, 0.0], [0.3, 0.4, 0.0]]);
        let left = map(&["torso", "left"], "l_hand", [[0.5, 0.0, 0.6], [0.7, 0.0, 0.8]]);
        let both = unite(&[right.clone(), left.clone()]).expect("of one robot");
        assert_eq!((both.motors.join(" "), both.hand.as_deref()), ("torso right left".to_owned(), None));
        let poses = |map: &MapFile| map.vertices.iter().map(|v| v.q_rad.clone()).collect::<Vec<_>>();
        assert_eq!(poses(&both), [poses(&right), poses(&left)].concat());
        assert_eq!(both.vertices.iter().map(|v| v.id).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert_eq!(
            both.edges.iter().map(|e| (e.from, e.to, e.driven)).collect::<Vec<_>>(),
            [(0, 1, true), (2, 3, true)]
        );
        assert_eq!(unite(std::slice::from_ref(&right)), Ok(right.clone()), "of one it is that one");
        let other = MapFile { robot: "another".to_owned(), ..left };
        assert!(unite(&[right, other]).is_err_and(|e| e.to_string().contains("robots")));
        assert!(unite(&[]).is_err());
    }
}
