//! Neighbors: links that a joint joins touch there by construction, and are left out of the tests.
//!
//! A link without shapes is looked through: many a robot has several joints in one place with nothing between them, or its shapes on a
//! link that is fixed to the one that moves.
//!
//! ```text
//! torso ══ fixed ══ (no shapes) ── joint ── (no shapes) ── joint ── arm         torso and arm are neighbors
//! ```

use super::document::Document;
use super::tree::{Drive, Tree};
use crate::LeftOut;
use std::collections::BTreeSet;

/// The pairs of neighbors, each with its reason.
///
/// # Arguments
/// * `shapes_of`: per link the node that carries its shapes, if it has any.
pub(super) fn neighbors(urdf: &Document, tree: &Tree, shapes_of: &[Option<usize>]) -> Vec<LeftOut> {
    let graph = Graph::new(urdf.links.len(), tree, shapes_of);
    let mut out = Vec::new();
    for (parent, joints) in tree.leaving.iter().enumerate() {
        for &joint in joints.iter().filter(|j| matches!(tree.drives[**j], Drive::Moves { .. })) {
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

/// How links hang on each other, for looking through those without shapes.
struct Graph<'a> {
    /// Per link: the links that are fixed to it.
    fixed: Vec<Vec<usize>>,
    /// Per link: the link above it, if the joint between moves.
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
                    Drive::Fixed(_) => {
                        graph.fixed[parent].push(child);
                        graph.fixed[child].push(parent);
                    }
                    Drive::Moves { .. } => graph.above[child] = Some(parent),
                }
            }
        }
        graph
    }

    /// The nodes of the nearest links with shapes that are fixed to a link, itself first, and the link above all that was passed.
    fn nearest(&self, link: usize) -> (Vec<usize>, Option<usize>) {
        let (mut found, mut above) = (Vec::new(), None);
        let (mut todo, mut seen) = (vec![link], BTreeSet::from([link]));
        while let Some(at) = todo.pop() {
            above = above.or(self.above[at]);
            match self.shapes_of[at] {
                Some(node) => found.push(node),
                None => todo.extend(self.fixed[at].iter().filter(|l| seen.insert(**l))),
            }
        }
        (found, above)
    }

    /// As [`Graph::nearest`]; where nothing that is fixed to the link has shapes, it goes on above the joint that moves all of it.
    fn nearest_above(&self, link: usize) -> Vec<usize> {
        let mut at = link;
        // Upward along a tree: it ends.
        loop {
            match self.nearest(at) {
                (found, Some(next)) if found.is_empty() => at = next,
                (found, _) => return found,
            }
        }
    }
}
