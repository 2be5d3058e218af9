//! A tree of poses that can be reached from its root by certified straight lines.

use super::JointSpace;
use crate::roadmap::neighbors::{Flat, Neighbors};

/// Grows from one end of a problem.
pub(super) struct Tree {
    /// Each in the turn that it was reached in.
    poses: Vec<Vec<f64>>,
    parents: Vec<u32>,
    near: Flat,
}

impl Tree {
    pub fn new(space: &JointSpace, root: Vec<f64>) -> Tree {
        let mut near = Flat::new(root.len(), space.metric());
        near.add(0, &root);
        Tree { poses: vec![root], parents: vec![0], near }
    }

    pub fn len(&self) -> usize {
        self.poses.len()
    }

    pub fn pose(&self, node: u32) -> &[f64] {
        self.poses.get(node as usize).map_or(&[], |q| q)
    }

    /// The node nearest to a pose.
    pub fn nearest(&self, q: &[f64]) -> u32 {
        self.near.knn(q, 1).first().map_or(0, |(_, node)| *node)
    }

    pub fn add(&mut self, parent: u32, pose: Vec<f64>) -> u32 {
        let node = self.poses.len() as u32;
        self.near.add(node, &pose);
        self.poses.push(pose);
        self.parents.push(parent);
        node
    }

    /// The poses from a node to the root.
    pub fn to_root(&self, node: u32) -> Vec<Vec<f64>> {
        let (mut path, mut at) = (Vec::new(), node);
        loop {
            path.push(self.pose(at).to_vec());
            match self.parents.get(at as usize) {
                Some(parent) if *parent < at => at = *parent,
                _ => return path,
            }
        }
    }
}
