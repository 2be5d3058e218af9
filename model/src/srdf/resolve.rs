//! From the names in an SRDF to motors and poses of a robot. Motors are named like their joints.

use super::Srdf;
use crate::Robot;
use crate::error::{FileError, Source};
use crate::urdf::{JointUse, Named, read_names};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names that stand for a pose to begin with, most telling first.
const HOME: &[&str] = &["home", "default", "ready", "reference", "standing", "half_sitting"];

/// By how much a pose may exceed a limit, rad of encoder, rad or meters: the rounding of files.
pub(super) const ROUNDING: f64 = 1e-4;

/// Which joint leads to which link, by the names of the URDF.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkTree {
    /// Per link: the joint that leads to it and the link that the joint leaves; none for the root.
    parents: BTreeMap<String, Option<(String, String)>>,
    /// The joints.
    joints: BTreeMap<String, JointUse>,
}

/// Reads which joint of a URDF file leads to which link.
///
/// # Errors
/// As [`load_urdf`](crate::load_urdf), as far as links and joints are concerned.
pub fn load_link_tree(path: impl AsRef<Path>) -> Result<LinkTree, FileError> {
    Source::read(path.as_ref(), crate::urdf::MAX_BYTES).and_then(|source| LinkTree::new(&source))
}

/// As [`load_link_tree`], from text; `name` stands for the file in messages.
///
/// # Errors
/// As [`load_link_tree`].
pub fn parse_link_tree(name: &str, text: &str) -> Result<LinkTree, FileError> {
    LinkTree::new(&Source::new(name, text))
}

impl LinkTree {
    fn new(source: &Source) -> Result<Self, FileError> {
        let Named { parents, joints } = read_names(source)?;
        Ok(Self { parents, joints })
    }

    /// Whether there is a link of this name.
    pub fn has_link(&self, name: &str) -> bool {
        self.parents.contains_key(name)
    }

    /// Whether there is a joint of this name.
    pub fn has_joint(&self, name: &str) -> bool {
        self.joints.contains_key(name)
    }

    /// The joint that leads to a link.
    fn joint_to(&self, link: &str) -> Option<&(String, String)> {
        self.parents.get(link)?.as_ref()
    }

    /// What a joint does, if there is one of this name.
    pub(super) fn joint(&self, name: &str) -> Option<JointUse> {
        self.joints.get(name).copied()
    }

    /// The joints between a link and one above it; none if the other is not above it.
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
    /// All joints of a group, those of its subgroups included; none if there is no such group.
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

    /// The motors of a group, as indices into [`Robot::motors`] in their order. Joints without a motor (fixed, mimicking) have none.
    pub fn motors_of(&self, group: &str, tree: &LinkTree, robot: &Robot) -> Vec<usize> {
        let joints = self.joints_of(group, tree);
        (0..robot.motors.len()).filter(|m| joints.contains(robot.motors[*m].name.as_str())).collect()
    }

    /// The robot's home with a named pose put into it, within the motors' limits, in the order of [`Robot::motors`]. A name may
    /// stand for poses of several groups: all are put into it. None if no pose has this name.
    pub fn pose(&self, name: &str, robot: &Robot) -> Option<Vec<f64>> {
        let of = |m: &crate::Motor| match self.position(name, &m.name) {
            Some(p) => m.motion.encoder(p).max(m.min).min(m.max),
            None => m.home,
        };
        self.states.iter().any(|s| s.name == name).then(|| robot.motors.iter().map(of).collect())
    }

    /// The motors that a named pose is about, each with its position within its limits, rad of encoder. Empty if no pose has this name.
    pub fn stated(&self, name: &str, robot: &Robot) -> Vec<(usize, f64)> {
        let states = self.states.iter().filter(|s| s.name == name);
        let joints: BTreeSet<&str> = states
            .flat_map(|s| s.positions.iter().filter(|(_, q)| q.len() == 1).map(|(joint, _)| joint.as_str()))
            .collect();
        let Some(pose) = self.pose(name, robot) else { return Vec::new() };
        let motors = robot.motors.iter().zip(pose).enumerate();
        motors.filter(|(_, (motor, _))| joints.contains(motor.name.as_str())).map(|(m, (_, q))| (m, q)).collect()
    }

    /// The motors of a named pose that is beyond their limits, where [`Srdf::pose`] takes the limit: each with the position that the file
    /// gives, rad of encoder.
    pub fn beyond(&self, name: &str, robot: &Robot) -> Vec<(usize, f64)> {
        let of = |(i, m): (usize, &crate::Motor)| {
            let wanted = m.motion.encoder(self.position(name, &m.name)?);
            (wanted < m.min - ROUNDING || wanted > m.max + ROUNDING).then_some((i, wanted))
        };
        robot.motors.iter().enumerate().filter_map(of).collect()
    }

    /// The passive joints that would have a motor, and where they stand still: in the pose to begin with, or at zero; rad or meters,
    /// within their limits.
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

    /// The position of a joint in a named pose, rad or meters. A name may stand for poses of several groups: the first counts.
    fn position(&self, name: &str, joint: &str) -> Option<f64> {
        let states = self.states.iter().filter(|s| s.name == name);
        match states.filter_map(|s| s.positions.get(joint)).next().map(Vec::as_slice) {
            Some(&[position]) => Some(position),
            _ => None,
        }
    }

    /// The name of the pose to begin with: `home`, or one of the names that such a pose has elsewhere.
    pub fn home(&self) -> Option<&str> {
        let named = |name: &&str| self.states.iter().find(|s| s.name.eq_ignore_ascii_case(name));
        HOME.iter().find_map(named).map(|s| s.name.as_str())
    }

    /// Why a pair of links needs no test, if the file says so; in either order.
    pub fn disabled_reason(&self, a: &str, b: &str) -> Option<&str> {
        let pair = if a <= b { (a, b) } else { (b, a) };
        self.disabled.get(&(pair.0.to_owned(), pair.1.to_owned())).map(String::as_str)
    }
}
