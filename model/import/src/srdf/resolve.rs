//! Resolves the names in an SRDF to motors and poses of a robot. Motors have the names of their joints.

use super::Srdf;
use crate::urdf::{JointUse, Named, read_names};
use mobee_model::Robot;
use mobee_text::{FileError, SourceText};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names of a home pose, in order of preference.
const HOME: &[&str] = &["home", "default", "ready", "reference", "standing", "half_sitting"];

/// Tolerance for a pose at a limit, rad of encoder, rad or meters: rounding in files.
pub(super) const LIMIT_TOLERANCE: f64 = 1e-4;

/// The tree of links and joints, by the names of the URDF.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkTree {
    /// Per link: its parent joint and its parent link; `None` for the root.
    parents: BTreeMap<String, Option<(String, String)>>,
    /// The joints.
    joints: BTreeMap<String, JointUse>,
}

/// Reads the tree of links and joints of a URDF file.
///
/// # Errors
/// As [`load_urdf`](crate::load_urdf), with respect to links and joints.
pub fn load_link_tree(path: impl AsRef<Path>) -> Result<LinkTree, FileError> {
    SourceText::read(path.as_ref(), crate::urdf::MAX_BYTES).and_then(|source| LinkTree::new(&source))
}

/// As [`load_link_tree`], from text; `name` is the file name for messages.
///
/// # Errors
/// As [`load_link_tree`].
pub fn parse_link_tree(name: &str, text: &str) -> Result<LinkTree, FileError> {
    LinkTree::new(&SourceText::new(name, text))
}

impl LinkTree {
    fn new(source: &SourceText) -> Result<Self, FileError> {
        let Named { parents, joints } = read_names(source)?;
        Ok(Self { parents, joints })
    }

    /// True if there is a link of this name.
    pub fn has_link(&self, name: &str) -> bool {
        self.parents.contains_key(name)
    }

    /// True if there is a joint of this name.
    pub fn has_joint(&self, name: &str) -> bool {
        self.joints.contains_key(name)
    }

    /// The parent joint and parent link of a link.
    fn joint_to(&self, link: &str) -> Option<&(String, String)> {
        self.parents.get(link)?.as_ref()
    }

    /// The use of a joint, if there is one of this name.
    pub(super) fn joint(&self, name: &str) -> Option<JointUse> {
        self.joints.get(name).copied()
    }

    /// The joints between a link and one above it, from the tip; `None` if `base` is not above `tip`.
    pub(super) fn chain(&self, base: &str, tip: &str) -> Option<Vec<&str>> {
        let mut joints = Vec::new();
        let mut link = tip;
        while link != base {
            let (joint, parent) = self.joint_to(link)?;
            joints.push(joint.as_str());
            link = parent;
        }
        Some(joints)
    }
}

impl Srdf {
    /// All joints of a group, including those of its subgroups; empty if there is no such group.
    pub fn joints_of<'a>(&'a self, group: &str, tree: &'a LinkTree) -> BTreeSet<&'a str> {
        let mut joints = BTreeSet::new();
        let mut seen = BTreeSet::new();
        let mut todo = vec![group];
        while let Some(name) = todo.pop() {
            let Some(group) = self.groups.iter().find(|g| g.name == name) else { continue };
            if !seen.insert(group.name.as_str()) {
                continue;
            }
            joints.extend(group.joints.iter().map(String::as_str));
            joints.extend(group.links.iter().filter_map(|l| tree.joint_to(l)).map(|(joint, _)| joint.as_str()));
            joints.extend(group.chains.iter().filter_map(|(base, tip)| tree.chain(base, tip)).flatten());
            todo.extend(group.groups.iter().map(String::as_str));
        }
        joints
    }

    /// The motors of a group, as indices into [`Robot::motors`], in that order. Joints without a motor (fixed,
    /// mimicking) are skipped.
    pub fn motors_of(&self, group: &str, tree: &LinkTree, robot: &Robot) -> Vec<usize> {
        let joints = self.joints_of(group, tree);
        (0..robot.motors.len()).filter(|m| joints.contains(robot.motors[*m].name.as_str())).collect()
    }

    /// The robot's home configuration overwritten by a named pose, within the motors' limits, in the order of
    /// [`Robot::motors`]. If several groups have poses of this name, all are applied. `None` if no pose has this name.
    pub fn pose(&self, name: &str, robot: &Robot) -> Option<Vec<f64>> {
        let position = |m: &mobee_model::Motor| match self.position(name, &m.name) {
            Some(p) => m.motion.encoder(p).max(m.min).min(m.max),
            None => m.home,
        };
        self.states.iter().any(|s| s.name == name).then(|| robot.motors.iter().map(position).collect())
    }

    /// The motors that a named pose defines, each with its position within its limits, rad of encoder. Empty if no pose
    /// has this name.
    pub fn stated(&self, name: &str, robot: &Robot) -> Vec<(usize, f64)> {
        let states = self.states.iter().filter(|s| s.name == name);
        let joints: BTreeSet<&str> = states
            .flat_map(|s| s.positions.iter().filter(|(_, q)| q.len() == 1).map(|(joint, _)| joint.as_str()))
            .collect();
        let Some(pose) = self.pose(name, robot) else { return Vec::new() };
        let motors = robot.motors.iter().zip(pose).enumerate();
        motors.filter(|(_, (motor, _))| joints.contains(motor.name.as_str())).map(|(m, (_, q))| (m, q)).collect()
    }

    /// The motors for which a named pose is beyond the limits, so that [`Srdf::pose`] uses the limit: each with the
    /// position in the file, rad of encoder.
    pub fn beyond(&self, name: &str, robot: &Robot) -> Vec<(usize, f64)> {
        let exceeding = |(i, m): (usize, &mobee_model::Motor)| {
            let wanted = m.motion.encoder(self.position(name, &m.name)?);
            (wanted < m.min - LIMIT_TOLERANCE || wanted > m.max + LIMIT_TOLERANCE).then_some((i, wanted))
        };
        robot.motors.iter().enumerate().filter_map(exceeding).collect()
    }

    /// The passive joints that would have a motor, with their fixed positions: those of the home pose, or zero; rad or
    /// meters, within their limits.
    pub fn held(&self, tree: &LinkTree) -> BTreeMap<String, f64> {
        let at = |joint: &String| match tree.joint(joint)? {
            JointUse::Moves { min, max, .. } => {
                let stated = self.home().and_then(|home| self.position(home, joint));
                Some((joint.clone(), stated.unwrap_or(0.0).clamp(min, max)))
            }
            _ => None,
        };
        self.passive_joints.iter().filter_map(at).collect()
    }

    /// The position of a joint in a named pose, rad or meters. If several groups have poses of this name, the first
    /// that defines the joint counts.
    fn position(&self, name: &str, joint: &str) -> Option<f64> {
        let states = self.states.iter().filter(|s| s.name == name);
        match states.filter_map(|s| s.positions.get(joint)).next().map(Vec::as_slice) {
            Some(&[position]) => Some(position),
            _ => None,
        }
    }

    /// The name of the home pose: `home`, or another usual name of such a pose.
    pub fn home(&self) -> Option<&str> {
        let named = |name: &&str| self.states.iter().find(|s| s.name.eq_ignore_ascii_case(name));
        HOME.iter().find_map(named).map(|s| s.name.as_str())
    }

    /// The reason why a pair of links is disabled, if it is, in either order.
    pub fn disabled_reason(&self, a: &str, b: &str) -> Option<&str> {
        let pair = if a <= b { (a, b) } else { (b, a) };
        self.disabled.get(&(pair.0.to_owned(), pair.1.to_owned())).map(String::as_str)
    }
}
