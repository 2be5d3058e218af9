//! Forward kinematics from motor positions, and properties of the kinematic tree.
//!
//! Configurations are slices of motor positions in the order of [`Robot::motors`], rad of encoder (see [`Motor`]; also
//! for prismatic motors). Positions outside a motor's limits count as the limit, as in the original; a motor without an
//! entry is at home.
//!
//! There are two implementations. The functions here visit every node and are the reference: they serve markers, the
//! transforms for the comparison of files, and tools. A [`crate::Scene`] reduces its robots to moving frames
//! (`scene/skeleton.rs`), with one motion per moving joint; a test compares the two.

use crate::{Clause, JointMotion, Marker, Motor, NodeKind, Part, Robot};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use std::collections::BTreeSet;

/// Pose of a marker in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerPose {
    /// `world_from_node` of the marker's node; its translation is the marker's position.
    pub frame: Isometry3<f64>,
    /// The marker's unit normal in the world.
    pub normal: Vector3<f64>,
}

impl MarkerPose {
    /// The marker's position in the world.
    pub fn position(&self) -> Point3<f64> {
        Point3::from(self.frame.translation.vector)
    }
}

impl Motor {
    /// The speed, or the motor's maximum if that is lower; rad/s of encoder.
    pub fn limit_speed(&self, speed: f64) -> f64 {
        self.max_speed.map_or(speed, |max| speed.min(max))
    }

    /// The position `q` (rad of encoder) as a fraction of the motor's range, clamped to 0..=1; 0 for a motor without range.
    pub fn fraction(&self, q: f64) -> f64 {
        let range = self.max - self.min;
        if range > 0.0 { (q.clamp(self.min, self.max) - self.min) / range } else { 0.0 }
    }
}

impl JointMotion {
    /// The motion of a joint of this kind at `position`, rad or meters: its child frame relative to its own.
    pub fn by(self, axis: &Unit<Vector3<f64>>, position: f64) -> Isometry3<f64> {
        match self {
            Self::Turn => {
                Isometry3::from_parts(Vector3::zeros().into(), UnitQuaternion::from_axis_angle(axis, position))
            }
            Self::Slide => Isometry3::from_parts((axis.into_inner() * position).into(), UnitQuaternion::identity()),
        }
    }

    /// The unit of its torque or force.
    pub fn effort_unit(self) -> &'static str {
        match self {
            JointMotion::Turn => "N m",
            JointMotion::Slide => "N",
        }
    }

    /// Unit of encoder positions for display: `deg` or `mm`.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Turn => "deg",
            Self::Slide => "mm",
        }
    }

    /// Unit of encoder positions in words: `degrees` or `millimeters`.
    pub fn unit_in_words(self) -> &'static str {
        match self {
            Self::Turn => "degrees",
            Self::Slide => "millimeters",
        }
    }

    /// True for revolute motion, the default that files omit.
    pub fn is_turn(&self) -> bool {
        *self == Self::Turn
    }

    /// Formats a position or a displacement, rad of encoder: `12.35 deg`, `40.00 mm`.
    pub fn told(self, q: f64, digits: usize) -> String {
        format!("{:.digits$} {}", q.to_degrees(), self.unit())
    }

    /// Formats a speed, rad/s of encoder: `12.35 deg/s`.
    pub fn told_speed(self, speed: f64, digits: usize) -> String {
        self.told(speed, digits) + "/s"
    }

    /// Formats limits, rad of encoder: `-20.0 to 70.0 deg`.
    pub fn told_range(self, [min, max]: [f64; 2], digits: usize) -> String {
        format!("{:.digits$} to {}", min.to_degrees(), self.told(max, digits))
    }
}

impl Robot {
    /// The home position of every motor, rad of encoder, in the order of [`Robot::motors`].
    pub fn home(&self) -> Vec<f64> {
        self.motors.iter().map(|m| m.home).collect()
    }

    /// The index of the motor of that name in every configuration.
    pub fn motor_index(&self, name: &str) -> Option<usize> {
        self.motors.iter().position(|m| m.name == name)
    }

    /// The body part of that name.
    pub fn part(&self, name: &str) -> Option<&Part> {
        self.parts.iter().find(|p| p.name == name)
    }

    /// The marker of that name.
    pub fn marker(&self, name: &str) -> Option<&Marker> {
        self.markers.iter().find(|m| m.name == name)
    }

    /// A motor's position within its limits, rad of encoder; home if `q` has no entry for it.
    fn position(&self, motor: usize, q: &[f64]) -> f64 {
        let m = &self.motors[motor];
        q.get(motor).copied().unwrap_or(m.home).clamp(m.min, m.max)
    }

    /// Position of a joint at the configuration `q`, rad or meters; 0 for a link.
    ///
    /// # Panics
    /// If the robot has no such node, here and in all functions that take a node's index.
    pub fn joint_position(&self, node: usize, q: &[f64]) -> f64 {
        match self.nodes[node].kind {
            NodeKind::Link { .. } => 0.0,
            // Linear from limit to limit: the range of a joint may differ from that of its motor, and several joints
            // may share a motor.
            NodeKind::Joint { motor, min, max, .. } => {
                min + self.motors[motor].fraction(self.position(motor, q)) * (max - min)
            }
        }
    }

    /// `node_from_child`: the transform from the children's frame to a node's. A link translates it; a joint rotates or
    /// translates it.
    fn motion(&self, node: usize, q: &[f64]) -> Isometry3<f64> {
        match &self.nodes[node].kind {
            NodeKind::Link { offset } => Isometry3::from_parts((*offset).into(), UnitQuaternion::identity()),
            NodeKind::Joint { axis, motion, .. } => motion.by(axis, self.joint_position(node, q)),
        }
    }

    /// Forward kinematics: writes `world_from_node` of every node to `out`, with the roots at the world's origin.
    ///
    /// A node's frame is the one before its own motion: a joint's own shapes do not move with it.
    ///
    /// # Arguments
    /// * `q`: motor positions, rad of encoder.
    /// * `out`: cleared first; does not allocate when reused.
    pub fn forward(&self, q: &[f64], out: &mut Vec<Isometry3<f64>>) {
        self.forward_from(&Isometry3::identity(), q, out);
    }

    /// As [`Robot::forward`], with the roots at `world_from_base` instead of the world's origin.
    pub fn forward_from(&self, base: &Isometry3<f64>, q: &[f64], out: &mut Vec<Isometry3<f64>>) {
        out.clear();
        for node in &self.nodes {
            let frame = match node.parent {
                None => *base,
                Some(parent) => {
                    // Parents precede their children, so one pass suffices and no search is needed.
                    let above = out[parent];
                    match &self.nodes[parent].kind {
                        NodeKind::Link { offset } => {
                            let moved = above.translation.vector + above.rotation * offset;
                            Isometry3::from_parts(moved.into(), above.rotation)
                        }
                        NodeKind::Joint { axis, motion: JointMotion::Turn, .. } => {
                            let turn = UnitQuaternion::from_axis_angle(axis, self.joint_position(parent, q));
                            Isometry3::from_parts(above.translation, above.rotation * turn)
                        }
                        NodeKind::Joint { axis, motion: JointMotion::Slide, .. } => {
                            let shift = axis.into_inner() * self.joint_position(parent, q);
                            let moved = above.translation.vector + above.rotation * shift;
                            Isometry3::from_parts(moved.into(), above.rotation)
                        }
                    }
                }
            };
            out.push(frame);
        }
    }

    /// The pose of every marker at the configuration `q`, in the order of [`Robot::markers`]; the robot's base is at
    /// the world's origin.
    pub fn markers_at(&self, q: &[f64]) -> Vec<MarkerPose> {
        let mut frames = Vec::with_capacity(self.nodes.len());
        self.forward(q, &mut frames);
        let pose = |m: &Marker| MarkerPose { frame: frames[m.node], normal: frames[m.node].rotation * *m.normal };
        self.markers.iter().map(pose).collect()
    }

    /// The value of a clause at the configuration `q`: the largest `a.q + b` of its members, in encoder units. The
    /// clause holds if that is above zero, since one satisfied member suffices.
    ///
    /// Positions are clamped to the limits, as for kinematics: a constraint is about the actual robot, which is never
    /// beyond its limits.
    pub fn clause_value(&self, clause: &Clause, q: &[f64]) -> f64 {
        let value = |member: &crate::HalfSpace| {
            let sum: f64 = member.terms.iter().map(|(m, a)| a * self.position(*m, q).to_degrees()).sum();
            sum + member.b
        };
        clause.0.iter().map(value).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The clauses that are violated at the configuration `q`, as (index into [`Robot::parts`], index into its
    /// clauses), in that order.
    pub fn violated<'a>(&'a self, q: &'a [f64]) -> impl Iterator<Item = (usize, usize)> + 'a {
        self.parts.iter().enumerate().flat_map(move |(p, part)| {
            let broken = move |(_, clause): &(usize, &Clause)| {
                let value = self.clause_value(clause, q);
                // A configuration that is not a number satisfies no clause, so that no motion to it is permitted.
                value.is_nan() || value <= 0.0
            };
            part.clauses.iter().enumerate().filter(broken).map(move |(c, _)| (p, c))
        })
    }

    /// Violation of the most violated clause, in the units of [`Robot::clause_value`]; zero if all hold, infinite for
    /// NaN.
    pub fn violated_by(&self, q: &[f64]) -> f64 {
        let depth = |clause: &Clause| match -self.clause_value(clause, q) {
            depth if depth.is_nan() => f64::INFINITY,
            depth => depth,
        };
        self.parts.iter().flat_map(|part| &part.clauses).map(depth).fold(0.0, f64::max)
    }

    /// True if the node is a joint with a range, driven by a motor with a range.
    pub fn can_move(&self, node: usize) -> bool {
        match self.nodes[node].kind {
            NodeKind::Link { .. } => false,
            NodeKind::Joint { motor, min, max, .. } => max > min && self.motors[motor].max > self.motors[motor].min,
        }
    }

    /// The rigid body of a node, identified by the nearest joint above it that can move; `None` is the base.
    ///
    /// A joint belongs to the body before it: its own frame does not move with it.
    pub fn body(&self, node: usize) -> Option<usize> {
        let mut at = self.nodes[node].parent;
        while let Some(n) = at {
            if self.can_move(n) {
                return Some(n);
            }
            at = self.nodes[n].parent;
        }
        None
    }

    /// True if a moving joint lies between two nodes, so that their distance can change.
    pub fn moves(&self, a: usize, b: usize) -> bool {
        self.body(a) != self.body(b)
    }

    /// The motors above the node that is moved by the most motors, from the root outward: those of the longest arm or
    /// leg.
    pub fn longest_chain(&self) -> Vec<usize> {
        let mut chains: Vec<Vec<usize>> = Vec::with_capacity(self.nodes.len());
        let mut longest: Vec<usize> = Vec::new();
        for node in &self.nodes {
            let mut chain = node.parent.and_then(|p| chains.get(p)).cloned().unwrap_or_default();
            if let NodeKind::Joint { motor, .. } = node.kind
                && !chain.contains(&motor)
            {
                chain.push(motor);
            }
            if chain.len() > longest.len() {
                longest.clone_from(&chain);
            }
            chains.push(chain);
        }
        longest
    }

    /// The motors that can change the distance between the shapes of two nodes; `None` is the world.
    pub fn movers(&self, a: Option<usize>, b: Option<usize>) -> BTreeSet<usize> {
        let joints = |node: Option<usize>| {
            let above = |n: &usize| self.nodes.get(*n)?.parent;
            let all = std::iter::successors(node.as_ref().and_then(above), above);
            all.collect::<BTreeSet<usize>>()
        };
        let motor = |n: &usize| match self.nodes.get(*n)?.kind {
            NodeKind::Joint { motor, .. } => Some(motor),
            NodeKind::Link { .. } => None,
        };
        // Joints above both nodes move both alike; one motor may have a joint above each.
        (&joints(a) ^ &joints(b)).iter().filter_map(motor).collect()
    }

    /// Upper bound, for each motor, of the displacement of any point of any solid shape relative to any other solid
    /// shape or the world, at any configuration; meters per rad of encoder.
    ///
    /// # Method
    /// Sum over the motor's joints of (joint range / motor range) times the largest possible distance from the joint's
    /// axis of a point that it moves; a prismatic joint moves every point by its own travel. For a straight path in
    /// joint space, the sum over the motors of bound times |change| bounds the decrease of any distance.
    pub fn reach(&self) -> Vec<f64> {
        let extent = self.extents();
        let mut bound = vec![0.0; self.motors.len()];
        for (j, node) in self.nodes.iter().enumerate() {
            let NodeKind::Joint { motion, motor, min, max, axis, .. } = &node.kind else { continue };
            if self.can_move(j) {
                // A motor that drives several joints moves a point by all of them at once: the bounds add up.
                let range = self.motors[*motor].max - self.motors[*motor].min;
                // Only points off the axis move: `|p x axis|` is the distance from the line through the joint's origin.
                let arm = match motion {
                    JointMotion::Turn => self.rigid_reach(j, &extent, |p| p.cross(axis).norm()),
                    JointMotion::Slide => 1.0,
                };
                bound[*motor] += (max - min) / range * arm;
            }
        }
        bound
    }

    /// Upper bound, for each joint that can move, of the distance from the joint's origin to any solid point that it
    /// moves, the joint's own travel included; meters.
    fn extents(&self) -> Vec<f64> {
        let mut extent = vec![0.0; self.nodes.len()];
        // Backward, so that the extents of the joints behind each joint are available.
        for n in (0..self.nodes.len()).rev() {
            if self.can_move(n) {
                extent[n] = self.rigid_reach(n, &extent, |p| p.norm()) + self.travel(n);
            }
        }
        extent
    }

    /// Maximum distance between a joint's origin and its children's, meters; zero unless the joint is prismatic.
    fn travel(&self, node: usize) -> f64 {
        match self.nodes[node].kind {
            NodeKind::Joint { motion: JointMotion::Slide, min, max, .. } => min.abs().max(max.abs()),
            _ => 0.0,
        }
    }

    /// The largest `measure` (of positions in the frame of joint `joint`, a norm of a linear map of norm <= 1) over all
    /// that the joint moves: shapes of its own rigid body placed exactly, later joints with their complete extent.
    fn rigid_reach(&self, joint: usize, extent: &[f64], measure: impl Fn(&Vector3<f64>) -> f64) -> f64 {
        // Only nodes behind `joint` can be its descendants: a parent always precedes its children.
        let mut at: Vec<Option<Isometry3<f64>>> = vec![None; self.nodes.len()];
        let mut reach: f64 = 0.0;
        for n in joint + 1..self.nodes.len() {
            let Some(parent) = self.nodes[n].parent else { continue };
            let frame = if parent == joint {
                Some(Isometry3::identity())
            } else {
                // Stops at a moving joint: its extent covers all that follows.
                at[parent].filter(|_| !self.can_move(parent)).map(|f| f * self.motion(parent, &[]))
            };
            let Some(frame) = frame else { continue };
            for solid in &self.nodes[n].solids {
                let center = frame * Point3::from(solid.pose.translation.vector);
                reach = reach.max(measure(&center.coords) + solid.shape.bounding_radius());
            }
            if self.can_move(n) {
                reach = reach.max(measure(&frame.translation.vector) + extent[n]);
            }
            at[n] = Some(frame);
        }
        reach
    }
}
