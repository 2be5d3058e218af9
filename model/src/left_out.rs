//! Pairs of links that are not tested against each other, where a robot's file lists them.
//!
//! The adjacency filter of the format (`zrp/pairs.rs`) guesses from the tree which shapes overlap by construction. A robot that was
//! converted is not built the way it expects, so its file says it: everything is tested that can move against each other, but what
//! is left out by name, each with its reason, so that a person can overrule it.

use crate::zrp::left_out_tag;
use crate::zrp::pairs::quiet_subtrees;
use crate::{LeftOut, Node, NodePairs, Robot};
use std::collections::BTreeSet;

impl Robot {
    /// The node of that name.
    pub fn node_named(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|n| n.name.as_deref() == Some(name))
    }

    /// Leaves out more pairs; from then on the list decides, and not the adjacency filter of the format. The first reason for
    /// a pair stays. A node without a name can't be left out, as the file could not say so: its pairs are ignored.
    pub fn leave_out(&mut self, more: impl IntoIterator<Item = LeftOut>) {
        let mut all = self.left_out.take().unwrap_or_default();
        let mut known: BTreeSet<(usize, usize)> = all.iter().map(|l| l.nodes).collect();
        let named = |node: usize| self.nodes.get(node).is_some_and(|n: &Node| n.name.is_some());
        for LeftOut { nodes: (a, b), reason } in more {
            let nodes = (a.min(b), a.max(b));
            if named(a) && named(b) && a != b && known.insert(nodes) {
                all.push(LeftOut { nodes, reason });
            }
        }
        self.left_out = Some(all);
        self.pair_up(&known);
    }

    /// The line for the `pairs` of the robot's file that leaves this pair out. None if one of the two has no name, or if the file has
    /// no such list: a first line would put all other pairs to the test, which the filter of the format now leaves out.
    pub fn leave_out_line(&self, (a, b): (usize, usize), reason: &str) -> Option<String> {
        self.left_out.as_ref()?;
        let name = |node: usize| self.nodes.get(node)?.name.as_deref();
        Some(format!("<{}/>", left_out_tag((name(a)?, name(b)?), reason)))
    }

    /// Makes the pairs of all bodies but those left out, and says which nodes are the base.
    fn pair_up(&mut self, left_out: &BTreeSet<(usize, usize)>) {
        let bodies: Vec<Option<usize>> = (0..self.nodes.len()).map(|n| self.body(n)).collect();
        let quiet = quiet_subtrees(&self.nodes);
        let mut pairs = NodePairs::default();
        for (a, x) in self.nodes.iter().enumerate() {
            for (b, y) in self.nodes.iter().enumerate().skip(a + 1) {
                // Within one rigid body nothing can move, whatever touches.
                if bodies[a] == bodies[b] || left_out.contains(&(a, b)) {
                    continue;
                }
                let both_quiet = quiet[a].is_some() && quiet[a] == quiet[b];
                if !x.solids.is_empty() && !y.solids.is_empty() {
                    let list = if both_quiet { &mut pairs.visual_only } else { &mut pairs.reflex };
                    list.push((a, b));
                }
                if !x.fields.is_empty() && !y.fields.is_empty() && !both_quiet {
                    pairs.field.push((a, b));
                }
            }
        }
        self.pairs = pairs;
        for (node, body) in self.nodes.iter_mut().zip(&bodies) {
            node.near_root = body.is_none();
        }
    }
}
