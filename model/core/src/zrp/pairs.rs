//! Pairs of nodes to test: the adjacency filters of the original format.
//!
//! Shapes of neighbors overlap by construction: a link's cylinder starts inside that of the link before it. So a pair
//! is tested only if enough lies between the two in the tree. *Enough* is, in the original: a link below a joint and a
//! joint below a link, both solid.
//!
//! ```text
//! link ── joint ── link ── joint ── link
//!   a       .        b       .        c       a-b and b-c are disabled; a-c is tested if b and the joint before it have shapes
//! ```
//! This holds within one part. Nodes of different parts count as neighbors only if one is the parent of the other or
//! both have the same parent. A `noSelfCollision` subtree (such as a hand, whose fingers often touch each other) is
//! tested against everything except itself.

use crate::{Node, NodeKind, NodePairs};

/// True for each node that belongs to the base: walking up from it reaches a root before both a link below a joint and
/// a joint below a link have been passed, followed by a node of the other type.
pub(crate) fn near_root(nodes: &[Node]) -> Vec<bool> {
    // The literal walk of the original, whose rule is unexpected: the pairs must be the same.
    let is_link = |n: usize| matches!(nodes[n].kind, NodeKind::Link { .. });
    let near = |start: usize| {
        let mut link = false;
        let mut joint = false;
        let mut at = start;
        while let Some(parent) = nodes[at].parent {
            if link && joint && is_link(at) != is_link(start) {
                return false;
            }
            match (is_link(at), is_link(parent)) {
                (true, false) => link = true,
                (false, true) => joint = true,
                _ => {}
            }
            at = parent;
        }
        true
    };
    (0..nodes.len()).map(near).collect()
}

/// The pairs to test. Pairs within one node, of neighbors in the tree and of near relatives of one part are excluded.
/// Pairs within a `noSelfCollision` subtree are only displayed, and their fields do not act.
pub(crate) fn node_pairs(nodes: &[Node]) -> NodePairs {
    let filtered = FilteredPairs::new(nodes);
    let quiet = quiet_subtrees(nodes);
    let mut pairs = NodePairs::default();
    for (a, x) in nodes.iter().enumerate() {
        for (b, y) in nodes.iter().enumerate().skip(a + 1) {
            // Excluded only against each other: a finger of a `noSelfCollision` hand must still not touch the trunk.
            let both_quiet = quiet[a].is_some() && quiet[a] == quiet[b];
            if !x.solids.is_empty() && !y.solids.is_empty() && !filtered.solid[a * nodes.len() + b] {
                let list = if both_quiet { &mut pairs.visual_only } else { &mut pairs.reflex };
                list.push((a, b));
            }
            if !x.fields.is_empty() && !y.fields.is_empty() && !both_quiet && !filtered.field[a * nodes.len() + b] {
                pairs.field.push((a, b));
            }
        }
    }
    pairs
}

/// The outermost `noSelfCollision` node above or at each node.
pub(crate) fn quiet_subtrees(nodes: &[Node]) -> Vec<Option<usize>> {
    let mut quiet: Vec<Option<usize>> = Vec::with_capacity(nodes.len());
    for (i, node) in nodes.iter().enumerate() {
        let above = node.parent.and_then(|p| quiet[p]);
        quiet.push(above.or(node.no_self_collision.then_some(i)));
    }
    quiet
}

/// Square tables over nodes (both triangles filled) of the pairs that the adjacency filter excludes.
struct FilteredPairs {
    /// For collision shapes.
    solid: Vec<bool>,
    /// For force-field shapes: the filter excludes more of them, regardless of their part.
    field: Vec<bool>,
}

impl FilteredPairs {
    /// Walks from every node through the subtrees of its siblings and its own, as the original does.
    fn new(nodes: &[Node]) -> Self {
        // Dense tables: at 2048 nodes four million flags each, read for every pair, built once per robot.
        let n = nodes.len();
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); n];
        let mut roots = Vec::new();
        for (i, node) in nodes.iter().enumerate() {
            node.parent.map_or(&mut roots, |p| &mut children[p]).push(i);
        }
        let is_link = |i: usize| matches!(nodes[i].kind, NodeKind::Link { .. });
        let mut out = Self { solid: vec![false; n * n], field: vec![false; n * n] };
        let mut stack = Vec::new();
        for (base, base_node) in nodes.iter().enumerate() {
            let siblings = base_node.parent.map_or(&roots, |p| &children[p]);
            // An explicit stack: files may nest a thousand levels, and recursion would overflow there.
            stack.extend(siblings.iter().map(|s| (*s, false, false)));
            // Walk down every sibling's subtree. The flags are set when a link below a joint and a joint below a link,
            // both solid, have been passed: from there on the two nodes are no longer neighbors.
            while let Some((v, mut link, mut joint)) = stack.pop() {
                let node = &nodes[v];
                if let Some(parent) = node.parent.filter(|p| Some(*p) != base_node.parent) {
                    if link && joint && is_link(v) != is_link(base) {
                        continue;
                    }
                    match (is_link(v), is_link(parent)) {
                        _ if node.solids.is_empty() => {}
                        (true, false) => link = true,
                        (false, true) => joint = true,
                        _ => {}
                    }
                }
                let related =
                    node.part == base_node.part || node.parent == Some(base) || node.parent == base_node.parent;
                for at in [v * n + base, base * n + v] {
                    out.field[at] = true;
                    out.solid[at] |= related;
                }
                stack.extend(children[v].iter().map(|c| (*c, link, joint)));
            }
        }
        out
    }
}
