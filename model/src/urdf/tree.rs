//! The tree of links, and what drives each joint.
//!
//! A URDF lists links and joints in any order and names them by strings. Here the names are resolved once, with a complaint at the
//! joint that is wrong, so that building the robot deals with numbers that are right.

use super::UrdfOptions;
use super::document::{Document, Joint, JointType};
use crate::JointMotion;
use crate::error::{FileError, Source};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// Longer chains are refused.
const MAX_DEPTH: usize = 200;

/// How far a joint without an end is let go either way, rad: as far as an encoder may count.
const MANY_TURNS: f64 = 100.0 * TAU;
/// A slide that goes farther is taken to have no end, and ends here, meters.
const FARTHEST: f64 = 100.0;

/// What a joint does.
#[derive(Clone, Copy, Debug)]
pub(super) enum Drive {
    /// Stands at a position for ever, rad or meters.
    Fixed(f64),
    /// Moves by `factor * q + offset` with the position q of the joint `source`, which has a motor and may be itself.
    Moves { source: usize, factor: f64, offset: f64 },
}

/// How a joint moves and how far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Whether it turns or slides.
    pub motion: JointMotion,
    /// Lower end, rad or meters.
    pub min: f64,
    /// Upper end, rad or meters.
    pub max: f64,
    /// Whether it turns without end, and its limits only bound its encoder.
    pub continuous: bool,
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
    pub limits: Vec<Option<Limits>>,
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
            *limit = limit.filter(|l| joint.mimic.is_none() && l.min < l.max);
        }
        end_where_followers_do_not_return(&drives, &mut limits);
        Ok(Self { root, leaving, child, drives, limits })
    }
}

/// A joint without an end, of which another follows by a fraction, is let go one turn only: after a full turn of it the
/// other is not where it was, so that its positions a turn apart are not one.
fn end_where_followers_do_not_return(drives: &[Drive], limits: &mut [Option<Limits>]) {
    for drive in drives {
        let Drive::Moves { source, factor, .. } = *drive else { continue };
        if let Some(limit) = limits.get_mut(source).and_then(Option::as_mut).filter(|l| l.continuous)
            && factor.fract() != 0.0
        {
            *limit = Limits { min: -PI, max: PI, continuous: false, ..*limit };
        }
    }
}

/// How a joint moves, `None` for one that does not.
fn limits_of(
    joint: &Joint,
    options: &UrdfOptions,
    blame: &impl Fn(&Joint, String, &str) -> FileError,
    warn: &mut dyn FnMut(String, &str),
) -> Result<Option<Limits>, FileError> {
    let name = &joint.name;
    let motion = match joint.joint_type {
        JointType::Fixed => return Ok(None),
        JointType::Continuous => return Ok(Some(turning(f64::NEG_INFINITY, f64::INFINITY))),
        JointType::Revolute => JointMotion::Turn,
        JointType::Prismatic => JointMotion::Slide,
        JointType::Floating => {
            // A base that drives or flies is not a robot's own motion: it stands where the scene puts it.
            warn(format!("the floating joint `{name}` stands still"), "MoBeE moves revolute and prismatic joints only");
            return Ok(None);
        }
        kind => {
            let kind = format!("{kind:?}").to_lowercase();
            if !options.fix_unsupported {
                let message = format!("joint `{name}` is {kind}; ZRP has revolute and prismatic joints only");
                let help = "make it fixed, or hold all such joints at zero with --fix-unsupported";
                return Err(blame(joint, message, help));
            }
            warn(format!("the {kind} joint `{name}` is held at zero"), "ZRP has revolute and prismatic joints only");
            return Ok(None);
        }
    };
    let unit = if motion == JointMotion::Turn { "radians" } else { "meters" };
    let Some(limit) = joint.limit else {
        let help = format!(
            "add <limit lower=\"...\" upper=\"...\"/> in {unit}, or make it continuous if it turns without end"
        );
        return Err(blame(joint, format!("joint `{name}` moves, and has no limits"), &help));
    };
    let (lo, hi) = (limit.lower, limit.upper);
    if lo.is_nan() || hi.is_nan() || lo > hi {
        let message = format!("joint `{name}` has the limits {lo} to {hi}");
        return Err(blame(joint, message, &format!("write numbers in {unit}, the lower one first")));
    }
    if lo == hi {
        let help = "give it a lower limit below the upper one if it moves";
        warn(format!("joint `{name}` has no range and is taken as fixed"), help);
    }
    Ok(Some(match motion {
        JointMotion::Turn => turning(lo, hi),
        JointMotion::Slide => {
            if lo < -FARTHEST || hi > FARTHEST {
                let message = format!("joint `{name}` slides from {lo} to {hi} m; it ends at {FARTHEST} m");
                warn(message, "write its limits in meters");
            }
            let (min, max) = (lo.clamp(-FARTHEST, FARTHEST), hi.clamp(-FARTHEST, FARTHEST));
            Limits { motion, min, max, continuous: false }
        }
    }))
}

/// A joint that turns. A limit beyond a hundred turns is none (URDF 1.2 writes it as infinite, and other files as 1e16).
fn turning(lo: f64, hi: f64) -> Limits {
    let (low, high) = (lo >= -MANY_TURNS, hi <= MANY_TURNS);
    let (min, max) = match (low, high) {
        (true, true) => (lo, hi),
        (true, false) => (lo, lo + TAU),
        (false, true) => (hi - TAU, hi),
        (false, false) => (-MANY_TURNS, MANY_TURNS),
    };
    Limits { motion: JointMotion::Turn, min, max, continuous: !low && !high }
}

/// Follows `mimic` to the joint with the motor.
fn drive(
    start: usize,
    urdf: &Document,
    joints: &BTreeMap<&str, usize>,
    limits: &[Option<Limits>],
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
                Some(l) if l.min < l.max && factor != 0.0 => Drive::Moves { source: at, factor, offset },
                Some(l) if l.min == l.max => Drive::Fixed(factor * l.min + offset),
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
