//! Division of a robot's motors among body parts.

use crate::{NodeKind, Part, Robot};

/// A division of a robot's motors among parts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotParts {
    /// Name and motors of each part, as indices into [`Robot::motors`]; each motor is in one of them.
    pub parts: Vec<(String, Vec<usize>)>,
    /// Groups that did not become parts because they overlap with others.
    pub passed_over: Vec<String>,
}

impl Robot {
    /// Divides the motors among these parts, in this order, which changes the order of configurations. A node and its
    /// markers belong to the part of the nearest joint above it, or else to the first part. Does nothing if a motor is
    /// in no part or in several, or if a part has constraints, since these refer to motors by index.
    pub fn divide(&mut self, parts: &[(String, Vec<usize>)]) {
        let order: Vec<usize> = parts.iter().flat_map(|(_, motors)| motors).copied().collect();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        if !sorted.iter().copied().eq(0..self.motors.len()) || self.parts.iter().any(|p| !p.clauses.is_empty()) {
            return;
        }
        let mut new_index = vec![0; order.len()];
        order.iter().enumerate().for_each(|(new, old)| new_index[*old] = new);
        self.motors = order.iter().map(|old| self.motors[*old].clone()).collect();
        self.parts.clear();
        let mut first = 0;
        for (p, (name, motors)) in parts.iter().enumerate() {
            let range = first..first + motors.len();
            for (i, motor) in self.motors[range.clone()].iter_mut().enumerate() {
                motor.part = p;
                motor.is_part_root = i == 0;
            }
            first = range.end;
            self.parts.push(Part { name: name.clone(), motors: range, root_node: None, clauses: Vec::new() });
        }
        for n in 0..self.nodes.len() {
            let above = self.nodes[n].parent.map_or(0, |p| self.nodes[p].part);
            let node = &mut self.nodes[n];
            node.part = above;
            if let NodeKind::Joint { motor, .. } = &mut node.kind {
                *motor = new_index[*motor];
                node.part = self.motors[*motor].part;
            }
            self.parts[node.part].root_node.get_or_insert(n);
        }
        self.markers.iter_mut().for_each(|m| m.part = self.nodes[m.node].part);
    }
}
