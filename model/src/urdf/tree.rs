//! The tree of links, and what drives each joint.
//!
//! A URDF lists links and joints in any order and names them by strings. Here the names are resolved once, with a complaint at the
//! joint that is wrong, so that building the robot deals with numbers that are right.

use super::UrdfOptions;
use super::document::{Document, Joint, JointType};
use crate::error::{FileError, Source};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Longer chains are refused.
const MAX_DEPTH: usize = 200;

/// What a joint does.
#[derive(Clone, Copy, Debug)]
pub(super) enum Drive {
    /// Stands at an angle for ever.
    Fixed(f64),
    /// Turns by `factor * q + offset` with the angle q of the joint `source`, which has a motor and may be itself.
    Turns { source: usize, factor: f64, offset: f64 },
}

/// How links hang on each other, and what moves each joint. Links and joints are indices into the URDF's lists.
pub(super) struct Tree {
    /// The link that no joint leads to.
    pub root: usize,
    /// Per link: the joints that leave it, in file order.
    pub leaving: Vec<Vec<usize>>,
    /// Per joint: the link it leads to.
    pub child: Vec<usize>,
    /// Per joint: what it does.
    pub drives: Vec<Drive>,
    /// Per joint: its limits, if it is a motor.
    pub limits: Vec<Option<(f64, f64)>>,
}

impl Tree {
    /// Checks that links and joints are one tree of moderate depth, and resolves limits and mimics.
    ///
    /// # Errors
    /// At the first joint or link that is not part of one tree, or can't be converted.
    pub fn new(
        source: &Source,
        urdf: &Document,
        options: &UrdfOptions,
        warnings: &mut Vec<FileError>,
    ) -> Result<Self, FileError> {
        let blame = |joint: &Joint, message: String, help: &str| source.error(joint.at.clone(), message, help);
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
            let (from, to) = (find(&joint.parent)?, find(&joint.child)?);
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
        // Every link but the root has one parent, so what the root does not reach must hang on a circle.
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
        let mut limits = Vec::new();
        for joint in &urdf.joints {
            limits.push(limits_of(joint, options, &blame, &mut |m, help: &str| {
                warnings.push(source.warning(joint.at.clone(), m, help));
            })?);
        }
        let mut drives = Vec::new();
        for i in 0..urdf.joints.len() {
            drives.push(drive(i, urdf, &joints, &limits, &blame)?);
        }
        // A mimic joint has no motor of its own.
        for (limit, joint) in limits.iter_mut().zip(&urdf.joints) {
            *limit = limit.filter(|(lo, hi)| joint.mimic.is_none() && lo < hi);
        }
        Ok(Self { root, leaving, child, drives, limits })
    }
}

/// The range of a joint that turns, `None` for one that does not.
fn limits_of(
    joint: &Joint,
    options: &UrdfOptions,
    blame: &impl Fn(&Joint, String, &str) -> FileError,
    warn: &mut dyn FnMut(String, &str),
) -> Result<Option<(f64, f64)>, FileError> {
    let name = &joint.name;
    match joint.joint_type {
        JointType::Fixed => Ok(None),
        JointType::Continuous => Ok(Some((-PI, PI))),
        JointType::Revolute => {
            let Some(limit) = joint.limit else {
                let message = format!("joint `{name}` turns, and has no limits");
                let help = "add <limit lower=\"...\" upper=\"...\"/> in radians, or make it continuous";
                return Err(blame(joint, message, help));
            };
            let (lo, hi) = (limit.lower, limit.upper);
            if lo.is_nan() || hi.is_nan() || lo > hi {
                let message = format!("joint `{name}` has the limits {lo} to {hi}");
                return Err(blame(joint, message, "write numbers in radians, the lower one first"));
            }
            if lo == hi {
                let help = "give it a lower limit below the upper one if it moves";
                warn(format!("joint `{name}` has no range and is taken as fixed"), help);
            }
            // An infinite limit means none (URDF 1.2).
            Ok(Some((if lo.is_finite() { lo } else { -PI }, if hi.is_finite() { hi } else { PI })))
        }
        kind => {
            let kind = format!("{kind:?}").to_lowercase();
            if !options.fix_unsupported {
                let message = format!("joint `{name}` is {kind}; ZRP has revolute joints only");
                let help = "make it fixed, or hold all such joints at zero with --fix-unsupported";
                return Err(blame(joint, message, help));
            }
            warn(format!("the {kind} joint `{name}` is held at zero"), "ZRP has revolute joints only");
            Ok(None)
        }
    }
}

/// Follows `mimic` to the joint with the motor.
fn drive(
    start: usize,
    urdf: &Document,
    joints: &BTreeMap<&str, usize>,
    limits: &[Option<(f64, f64)>],
    blame: &impl Fn(&Joint, String, &str) -> FileError,
) -> Result<Drive, FileError> {
    if limits[start].is_none() {
        return Ok(Drive::Fixed(0.0));
    }
    // Along the chain `q_i = m * q_next + o` is put in again and again: the whole chain is one line, `factor * q + offset`.
    let (mut at, mut factor, mut offset) = (start, 1.0, 0.0);
    // A chain without a circle is no longer than there are joints.
    for _ in 0..=urdf.joints.len() {
        let joint = &urdf.joints[at];
        let Some(mimic) = &joint.mimic else {
            return Ok(match limits[at] {
                Some((lo, hi)) if lo < hi && factor != 0.0 => Drive::Turns { source: at, factor, offset },
                Some((lo, hi)) if lo == hi => Drive::Fixed(factor * lo + offset),
                _ => Drive::Fixed(offset),
            });
        };
        let (m, o) = (mimic.multiplier, mimic.offset);
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
