//! The tree of links, and the drive of each joint.
//!
//! A URDF lists links and joints in any order and refers to them by name. The names are resolved once, with errors at
//! the faulty joint, so that the conversion works on valid indices.

use super::UrdfOptions;
use super::document::{Document, UrdfJoint};
use super::limits::{LimitReader, Limits, limit_leaders_of_fractional_followers};
use mobee_text::{FileError, SourceText};
use std::collections::BTreeMap;

/// Maximum number of joints in a chain.
const MAX_DEPTH: usize = 200;

/// Drive of a joint.
#[derive(Clone, Copy, Debug)]
pub(super) enum JointDrive {
    /// Constant position, rad or meters.
    Fixed(f64),
    /// Moves by `factor * q + offset` with the position q of the joint `source`, which has a motor and may be itself.
    Moves { source: usize, factor: f64, offset: f64 },
}

/// Connectivity of links, and the drive of each joint. Links and joints are indices into the URDF's lists.
pub(super) struct Tree {
    /// The link without a parent joint.
    pub root: usize,
    /// Per link: its child joints, in file order.
    pub leaving: Vec<Vec<usize>>,
    /// Per joint: its child link.
    pub child: Vec<usize>,
    /// Per joint: its drive.
    pub drives: Vec<JointDrive>,
    /// Per joint: its limits, if it has a motor.
    pub limits: Vec<Option<Limits>>,
}

impl Tree {
    /// Checks that links and joints are one tree of moderate depth, and resolves limits and mimics.
    ///
    /// # Errors
    /// At the first joint or link that does not belong to one tree, or can't be converted.
    pub fn new(
        source: &SourceText,
        urdf: &Document,
        options: &UrdfOptions,
        warnings: &mut Vec<FileError>,
    ) -> Result<Self, FileError> {
        let blame = |joint: &UrdfJoint, message: String, help: &str| source.error(joint.at.clone(), message, help);
        let links: BTreeMap<&str, usize> = urdf.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
        let joints: BTreeMap<&str, usize> = urdf.joints.iter().enumerate().map(|(i, j)| (j.name.as_str(), i)).collect();
        let mut leaving = vec![Vec::new(); urdf.links.len()];
        let mut child = Vec::new();
        let mut has_parent = vec![false; urdf.links.len()];
        for (i, joint) in urdf.joints.iter().enumerate() {
            let find = |name: &str| {
                links.get(name).copied().ok_or_else(|| {
                    let message = format!("joint `{}` names the link `{name}`, which does not exist", joint.name);
                    blame(joint, message, "correct the name, or add that link")
                })
            };
            let from = find(&joint.parent)?;
            let to = find(&joint.child)?;
            if std::mem::replace(&mut has_parent[to], true) {
                let message = format!("link `{}` has more than one parent", urdf.links[to].name);
                return Err(blame(joint, message, "a URDF is a tree: let one joint only lead to each link"));
            }
            leaving[from].push(i);
            child.push(to);
        }
        let roots: Vec<usize> = (0..urdf.links.len()).filter(|l| !has_parent[*l]).collect();
        let [root] = roots[..] else {
            let names: Vec<_> = roots.iter().take(5).map(|r| format!("`{}`", urdf.links[*r].name)).collect();
            let message = match roots.len() {
                0 => "there is no link without a parent".to_owned(),
                n => format!("{n} links have no parent: {}", names.join(", ")),
            };
            return Err(source.error(urdf.at.clone(), message, "join them to one tree with one root, by joints"));
        };
        // Every link except the root has one parent, so links that the root does not reach are on a cycle.
        let mut reached = 0;
        let mut todo = vec![(root, 0)];
        while let Some((link, depth)) = todo.pop() {
            if depth > MAX_DEPTH {
                let message = format!("more than {MAX_DEPTH} joints follow each other");
                return Err(source.error(urdf.links[link].at.clone(), message, "shorten the chain"));
            }
            reached += 1;
            todo.extend(leaving[link].iter().map(|j| (child[*j], depth + 1)));
        }
        if reached < urdf.links.len() {
            let message = "some joints form a circle that the root does not lead to";
            return Err(source.error(urdf.at.clone(), message, "a URDF is a tree: correct the parents"));
        }
        let mut reader = LimitReader::new(source, options, warnings);
        let mut limits = urdf.joints.iter().map(|joint| reader.read(joint)).collect::<Result<Vec<_>, _>>()?;
        for (i, joint) in urdf.joints.iter().enumerate().filter(|(_, j)| j.mimic.is_some()) {
            let Some(own) = limits[i] else { continue };
            let drive = drive(i, urdf, &joints, &limits, &blame)?;
            let leader = if let JointDrive::Moves { source, .. } = drive { source } else { i };
            reader.follow((joint, own), drive, (&urdf.joints[leader], &mut limits[leader]))?;
        }
        reader.finish();
        let drives = (0..urdf.joints.len()).map(|i| drive(i, urdf, &joints, &limits, &blame));
        let drives = drives.collect::<Result<Vec<_>, _>>()?;
        // A mimic joint does not have its own motor.
        for (limit, joint) in limits.iter_mut().zip(&urdf.joints) {
            *limit = limit.filter(|l| joint.mimic.is_none() && l.min < l.max);
        }
        limit_leaders_of_fractional_followers(&drives, &mut limits);
        Ok(Self { root, leaving, child, drives, limits })
    }
}

/// Follows `mimic` to the joint with the motor, and returns the drive of joint `start`.
fn drive(
    start: usize,
    urdf: &Document,
    joints: &BTreeMap<&str, usize>,
    limits: &[Option<Limits>],
    blame: &impl Fn(&UrdfJoint, String, &str) -> FileError,
) -> Result<JointDrive, FileError> {
    if limits[start].is_none() {
        return Ok(JointDrive::Fixed(0.0));
    }
    // Substitutes `q_i = m * q_next + o` along the chain, which yields one linear function, `factor * q + offset`.
    let mut at = start;
    let mut factor = 1.0;
    let mut offset = 0.0;
    // A chain without a cycle is at most as long as the number of joints.
    for _ in 0..=urdf.joints.len() {
        let joint = &urdf.joints[at];
        let Some(mimic) = &joint.mimic else {
            return Ok(match limits[at] {
                Some(l) if l.min < l.max && factor != 0.0 => JointDrive::Moves { source: at, factor, offset },
                Some(l) if l.min == l.max => JointDrive::Fixed(factor * l.min + offset),
                _ => JointDrive::Fixed(offset),
            });
        };
        let m = mimic.multiplier;
        let o = mimic.offset;
        if !(m.is_finite() && o.is_finite()) {
            let message = format!("joint `{}` mimics with numbers that are not finite", joint.name);
            return Err(blame(joint, message, "write finite numbers as multiplier and offset"));
        }
        offset += factor * o;
        factor *= m;
        at = *joints.get(mimic.joint.as_str()).ok_or_else(|| {
            let message = format!("joint `{}` mimics `{}`, which does not exist", joint.name, mimic.joint);
            blame(joint, message, "correct the name of the joint it mimics")
        })?;
    }
    let message = format!("joint `{}` mimics itself by a detour", urdf.joints[start].name);
    Err(blame(&urdf.joints[start], message, "let the chain of mimics end at a joint without one"))
}
