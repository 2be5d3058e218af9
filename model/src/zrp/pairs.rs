//! Which pairs of nodes may touch: the filters of the original format.
//!
//! Shapes of neighbors overlap by construction: a link's cylinder begins within that of the link before it. So a pair is tested only
//! if enough lies between the two in the tree, and *enough* is, in the original: a link below a joint and a joint below a link, both
//! solid.
//!
//! ```text
//! link ── joint ── link ── joint ── link
//!   a       .        b       .        c       a-b and b-c are left out; a-c is tested if b and the joint before it have shapes
//! ```
//! Within one part that is all; nodes of different parts count as neighbors only if one carries the other or both hang on the same
//! node. A `noSelfCollision` subtree (a hand, whose fingers touch each other all day) is tested against everything but itself.

use crate::{Node, NodeKind, NodePairs};

/// Whether each node belongs to the base: walking up from it reaches a root before a link below a joint and a joint
/// below a link have both been passed, to stand at a node of the other type.
pub(crate) fn near_root(nodes: &[Node]) -> Vec<bool> {
    // Literally the walk of the original, whose rule is not what one would guess: pairs must come out as there.
    let is_link = |n: usize| matches!(nodes[n].kind, NodeKind::Link { .. });
    let near = |start: usize| {
        let (mut link, mut joint) = (false, false);
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

/// The pairs that remain: shapes of one node, neighbors in the tree and near relatives of one part are left out;
/// pairs within a `noSelfCollision` subtree are shown only, and their fields do not act.
pub(crate) fn node_pairs(nodes: &[Node]) -> NodePairs {
    let filtered = Filtered::new(nodes);
    let quiet = quiet_subtrees(nodes);
    let mut pairs = NodePairs::default();
    for (a, x) in nodes.iter().enumerate() {
        for (b, y) in nodes.iter().enumerate().skip(a + 1) {
            // Quiet only against each other: a finger of a `noSelfCollision` hand still must not touch the trunk.
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

/// Square tables over nodes (both triangles filled) of the pairs that the adjacency filter takes out.
struct Filtered {
    /// For shapes that collide.
    solid: Vec<bool>,
    /// For shapes of the force field: the filter spares more of them, whatever their part.
    field: Vec<bool>,
}

impl Filtered {
    /// Walks from every node through the subtrees of its siblings, itself among them, as the original does.
    fn new(nodes: &[Node]) -> Self {
        // Dense tables: at 2048 nodes four million flags each, looked up for every pair, built once per robot.
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
            // A subtree is walked by a stack: files nest a thousand deep, and recursion would end the program there.
            stack.extend(siblings.iter().map(|s| (*s, false, false)));
            // Walk down every sibling's subtree. The flags tell that a link below a joint and a joint below a link,
            // both solid, have been passed: from there on the two are no longer neighbors.
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
