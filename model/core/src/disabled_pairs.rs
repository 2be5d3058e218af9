//! Disabled pairs of links, listed by a robot's file.
//!
//! The adjacency filter of the format (`zrp/pairs.rs`) guesses from the tree which shapes overlap by construction. This
//! guess does not suit converted robots, so their files list the disabled pairs instead: all pairs that can move
//! relative to each other are tested, except those listed by name. Each has a reason, so that a user can judge and
//! override it.

use crate::zrp::left_out_tag;
use crate::zrp::pairs::quiet_subtrees;
use crate::{LeftOut, NearPair, Node, NodePairs, Robot};
use std::collections::BTreeSet;

impl Robot {
    /// The index of the node with that name.
    pub fn node_named(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|n| n.name.as_deref() == Some(name))
    }

    /// Disables more pairs. From then on the list decides instead of the adjacency filter of the format. If a pair is
    /// listed twice, its first reason is used. Pairs with an unnamed node are ignored, since the file could not list
    /// them.
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

    /// Gives tested pairs a clearance of their own. If a pair is given twice, its lower clearance is used. Pairs with an
    /// unnamed node are ignored, since the file could not list them. A robot without a list of disabled pairs gets an
    /// empty one, since its file needs the element.
    pub fn bring_near(&mut self, more: impl IntoIterator<Item = NearPair>) {
        for NearPair { nodes: (a, b), clearance, reason } in more {
            let named = |node: usize| self.nodes.get(node).is_some_and(|n: &Node| n.name.is_some());
            if a == b || !named(a) || !named(b) {
                continue;
            }
            if self.left_out.is_none() {
                self.leave_out([]);
            }
            let nodes = (a.min(b), a.max(b));
            match self.near.iter_mut().find(|known| known.nodes == nodes) {
                Some(known) if known.clearance <= clearance => {}
                Some(known) => *known = NearPair { nodes, clearance, reason },
                None => self.near.push(NearPair { nodes, clearance, reason }),
            }
        }
    }

    /// The line for `pairs` in the robot's file that disables this pair. `None` if one of the two nodes has no name, or
    /// if the file has no such list: a first line would enable all other pairs that the format's filter disables now.
    pub fn leave_out_line(&self, (a, b): (usize, usize), reason: &str) -> Option<String> {
        self.left_out.as_ref()?;
        let name = |node: usize| self.nodes.get(node)?.name.as_deref();
        Some(format!("<{}/>", left_out_tag((name(a)?, name(b)?), reason)))
    }

    /// Builds the pairs of all bodies except the disabled ones, and marks the nodes of the base.
    fn pair_up(&mut self, left_out: &BTreeSet<(usize, usize)>) {
        let bodies: Vec<Option<usize>> = (0..self.nodes.len()).map(|n| self.body(n)).collect();
        let quiet = quiet_subtrees(&self.nodes);
        let mut pairs = NodePairs::default();
        for (a, x) in self.nodes.iter().enumerate() {
            for (b, y) in self.nodes.iter().enumerate().skip(a + 1) {
                // Nodes of one rigid body do not move relative to each other.
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
