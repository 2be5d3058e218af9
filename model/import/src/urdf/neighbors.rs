//! Neighbors: links connected by a joint touch there by construction, so their pair is disabled.
//!
//! Links without shapes are skipped: many robots have several joints in one place with no shapes between them, or have
//! their shapes on a link that is fixed to the moving one.
//!
//! ```text
//! torso ══ fixed ══ (no shapes) ── joint ── (no shapes) ── joint ── arm         torso and arm are neighbors
//! ```

use super::document::Document;
use super::tree::{JointDrive, Tree};
use mobee_model::LeftOut;
use std::collections::BTreeSet;

/// The pairs of neighbors to disable, each with its reason.
///
/// # Arguments
/// * `shapes_of`: the node with the shapes of each link, if it has any.
pub(super) fn neighbors(urdf: &Document, tree: &Tree, shapes_of: &[Option<usize>]) -> Vec<LeftOut> {
    let graph = Graph::new(urdf.links.len(), tree, shapes_of);
    let mut out = Vec::new();
    for (parent, joints) in tree.leaving.iter().enumerate() {
        for &joint in joints.iter().filter(|j| matches!(tree.drives[**j], JointDrive::Moves { .. })) {
            let below = graph.nearest(tree.child[joint]).0;
            let above = graph.nearest_above(parent);
            let reason = format!("neighbors, joined by {}", urdf.joints[joint].name);
            for (a, b) in above.iter().flat_map(|a| below.iter().map(move |b| (*a, *b))) {
                out.push(LeftOut { nodes: (a.min(b), a.max(b)), reason: reason.clone() });
            }
        }
    }
    out
}

/// Connectivity of the links, for skipping those without shapes.
struct Graph<'a> {
    /// Per link: the links fixed to it.
    fixed: Vec<Vec<usize>>,
    /// Per link: its parent, if the joint between them moves.
    above: Vec<Option<usize>>,
    /// Per link: the node of its shapes.
    shapes_of: &'a [Option<usize>],
}

impl<'a> Graph<'a> {
    fn new(links: usize, tree: &Tree, shapes_of: &'a [Option<usize>]) -> Self {
        let mut graph = Graph { fixed: vec![Vec::new(); links], above: vec![None; links], shapes_of };
        for (parent, joints) in tree.leaving.iter().enumerate() {
            for &joint in joints {
                let child = tree.child[joint];
                match tree.drives[joint] {
                    JointDrive::Fixed(_) => {
                        graph.fixed[parent].push(child);
                        graph.fixed[child].push(parent);
                    }
                    JointDrive::Moves { .. } => graph.above[child] = Some(parent),
                }
            }
        }
        graph
    }

    /// The nodes of the nearest links with shapes that are fixed to a link, or of the link itself; and the parent above
    /// the links that were visited.
    fn nearest(&self, link: usize) -> (Vec<usize>, Option<usize>) {
        let mut found = Vec::new();
        let mut above = None;
        let mut todo = vec![link];
        let mut seen = BTreeSet::from([link]);
        while let Some(at) = todo.pop() {
            above = above.or(self.above[at]);
            match self.shapes_of[at] {
                Some(node) => found.push(node),
                None => todo.extend(self.fixed[at].iter().filter(|l| seen.insert(**l))),
            }
        }
        (found, above)
    }

    /// As [`Graph::nearest`]; if no link fixed to this one has shapes, continues above the joint that moves all of
    /// them.
    fn nearest_above(&self, link: usize) -> Vec<usize> {
        let mut at = link;
        // Terminates, since it moves upward in a tree.
        loop {
            match self.nearest(at) {
                (found, Some(next)) if found.is_empty() => at = next,
                (found, _) => return found,
            }
        }
    }
}
