//! Pairs that a scene tests: those of its robots, derived once, and those with its objects.

use super::bodies::{Bodies, Solid};
use super::pair_rules::{PairPolicy, ResolvedRule, rule_of};
use super::travel::Terms;
use crate::engine::IndexPair;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Reflex pairs that can move relative to each other.
#[derive(Debug, Default)]
pub(crate) struct PairLists {
    /// Indices, smaller first, sorted.
    pub pairs: Vec<IndexPair>,
    /// The same pairs, grouped by their two frames.
    pub groups: Vec<Arc<PairGroup>>,
    /// Pairs with a clearance of their own, meters; sorted.
    pub near: Vec<(IndexPair, f64)>,
    /// True if a rule omits a pair with an object.
    pub omits_objects: bool,
}

/// Pairs of solids with the same relative motion: those of the same two frames.
#[derive(Clone, Debug)]
pub(crate) struct PairGroup {
    /// The two frames, smaller first.
    pub frames: (usize, usize),
    /// Bound of their relative motion.
    pub travel: Terms,
    /// The pairs.
    pub pairs: Vec<IndexPair>,
}

impl PairLists {
    /// The pairs within and between the robots.
    pub fn of_robots(bodies: &Bodies, rules: &[ResolvedRule]) -> Self {
        let mut pairs = bodies.moving.clone();
        let mut near = Vec::new();
        if !rules.is_empty() || bodies.robots.iter().any(|robot| !robot.near.is_empty()) {
            pairs.retain(|&(i, j)| {
                let ids = (bodies.solids[i as usize].id, bodies.solids[j as usize].id);
                add_near(&mut near, (i, j), rule_of(&bodies.robots, rules, ids))
            });
        }
        // One motion bound serves all pairs of two frames, and a group that is not due is skipped as a whole.
        let mut by_frames = BTreeMap::<(usize, usize), Vec<IndexPair>>::new();
        for &(i, j) in &pairs {
            let f = bodies.solids[i as usize].collider.frame;
            let g = bodies.solids[j as usize].collider.frame;
            by_frames.entry((f.min(g), f.max(g))).or_default().push((i, j));
        }
        let group = |(frames, pairs): ((usize, usize), _)| {
            Arc::new(PairGroup { frames, travel: bodies.travel(frames.0, frames.1), pairs })
        };
        PairLists { pairs, groups: by_frames.into_iter().map(group).collect(), near, omits_objects: false }
    }

    /// These pairs of the robots, and those with objects.
    pub fn among(&self, bodies: &Bodies, objects: &[Solid], rules: &[ResolvedRule]) -> Self {
        let first = bodies.solids.len() as u32;
        let is_ruled: Vec<bool> = objects.iter().map(|o| rules.iter().any(|rule| rule.names(o.id))).collect();
        let mut all = PairLists {
            pairs: Vec::with_capacity(self.pairs.len() + bodies.tested.len() * objects.len()),
            near: self.near.clone(),
            ..PairLists::default()
        };
        let mut of_frame = vec![Vec::new(); bodies.frames];
        let mut own = self.pairs.as_slice();
        for &i in &bodies.tested {
            let before = own.partition_point(|pair| pair.0 <= i);
            all.pairs.extend_from_slice(&own[..before]);
            own = &own[before..];
            let solid = &bodies.solids[i as usize];
            let from = all.pairs.len();
            for ((object, is_ruled), j) in objects.iter().zip(&is_ruled).zip(first..) {
                let is_tested = !is_ruled || {
                    let policy = rule_of(&bodies.robots, rules, (solid.id, object.id));
                    add_near(&mut all.near, (i, j), policy)
                };
                all.omits_objects |= !is_tested;
                all.pairs.extend(is_tested.then_some((i, j)));
            }
            of_frame[solid.collider.frame].extend_from_slice(&all.pairs[from..]);
        }
        all.pairs.extend_from_slice(own);
        all.near.sort_unstable_by_key(|(pair, _)| *pair);
        // The world's frame is the last, so a frame's pairs with objects come after its others.
        let mut groups = self.groups.as_slice();
        for (frame, pairs) in of_frame.into_iter().enumerate().filter(|(_, pairs)| !pairs.is_empty()) {
            let before = groups.partition_point(|group| group.frames.0 <= frame);
            all.groups.extend_from_slice(&groups[..before]);
            groups = &groups[before..];
            let frames = (frame, bodies.frames);
            let travel = bodies.world_travel.get(frame).cloned().unwrap_or_default();
            all.groups.push(Arc::new(PairGroup { frames, travel, pairs }));
        }
        all.groups.extend_from_slice(groups);
        all
    }
}

/// Adds a pair with a clearance of its own to the list; returns whether the pair is tested.
fn add_near(near: &mut Vec<(IndexPair, f64)>, pair: IndexPair, policy: PairPolicy) -> bool {
    if let PairPolicy::Near(clearance) = policy {
        near.push((pair, clearance));
    }
    policy != PairPolicy::MayTouch
}
