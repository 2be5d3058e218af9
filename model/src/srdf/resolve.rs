//! From the names in an SRDF to motors and poses of a robot. Motors are named like their joints.

use super::{Srdf, SrdfState};
use crate::Robot;
use crate::error::{FileError, Source};
use crate::urdf::read_parents;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names that stand for a pose to begin with, most telling first.
const HOME: &[&str] = &["home", "default", "ready", "reference", "standing", "half_sitting"];

/// Which joint leads to which link, by the names of the URDF.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkTree {
    /// Per link: the joint that leads to it and the link that the joint leaves; none for the root.
    parents: BTreeMap<String, Option<(String, String)>>,
    /// The joints.
    joints: BTreeSet<String>,
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
        let parents = read_parents(source)?;
        let joints = parents.values().flatten().map(|(joint, _)| joint.clone()).collect();
        Ok(Self { parents, joints })
    }

    /// Whether there is a link of this name.
    pub fn has_link(&self, name: &str) -> bool {
        self.parents.contains_key(name)
    }

    /// Whether there is a joint of this name.
    pub fn has_joint(&self, name: &str) -> bool {
        self.joints.contains(name)
    }

    /// The joint that leads to a link.
    fn joint_to(&self, link: &str) -> Option<&(String, String)> {
        self.parents.get(link)?.as_ref()
    }

    /// The joints between a link and one above it; those up to the root if the other is not above it.
    fn chain(&self, base: &str, tip: &str) -> Vec<&str> {
        let mut joints = Vec::new();
        let mut link = tip;
        // a file with a circle of joints is told elsewhere
        while let Some((joint, parent)) =
            self.joint_to(link).filter(|_| link != base && joints.len() < self.joints.len())
        {
            joints.push(joint.as_str());
            link = parent;
        }
        joints
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
            joints.extend(group.chains.iter().flat_map(|(base, tip)| tree.chain(base, tip)));
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
        let states: Vec<&SrdfState> = self.states.iter().filter(|s| s.name == name).collect();
        let position = |motor: &str| match states.iter().find_map(|s| s.positions.get(motor)).map(Vec::as_slice) {
            Some(&[position]) => Some(position),
            _ => None,
        };
        let of = |m: &crate::Motor| position(&m.name).map_or(m.home, |p| m.motion.encoder(p).max(m.min).min(m.max));
        (!states.is_empty()).then(|| robot.motors.iter().map(of).collect())
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
