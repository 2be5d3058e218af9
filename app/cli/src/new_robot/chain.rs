//! Selects the motors of the exploration of a new robot: its arm, without the fingers.

use super::MIN_ARM_MOTORS;
use mobee_import::Imported;
use mobee_model::{NodeKind, Robot};
use std::collections::BTreeSet;

/// Maximum number of motors: with more, an exploration by trial covers little.
const MAX_MOTORS: usize = 12;
/// Parts of the names of motors that open and close a hand.
const FINGER_WORDS: [&str; 6] = ["finger", "gripper", "thumb", "pinky", "jaw", "knuckle"];
/// Share of the chain's length: motors that branch off within it are the fingers of a hand, not limbs.
const HAND_SHARE: f64 = 0.3;

/// The motors of the exploration.
pub(super) struct Chain {
    /// Their origin, as text.
    pub(super) named: String,
    /// Their indices, from the base outward.
    pub(super) motors: Vec<usize>,
    /// Excluded motors of a hand.
    pub(super) fingers: Vec<usize>,
}

/// The SRDF's arm, or the longest chain, without the motors of a hand; `None` if there is no motor.
pub(super) fn choose(imported: &Imported) -> Option<Chain> {
    let robot = &imported.robot;
    let arms = imported.groups.iter().filter(|(name, _)| {
        let name = name.to_lowercase();
        name.contains("arm") || name.contains("manipulator")
    });
    let arms = arms.map(|(name, motors)| (name, without_fingers(robot, motors)));
    let arms = arms.filter(|(_, (motors, _))| (MIN_ARM_MOTORS..=MAX_MOTORS).contains(&motors.len()));
    if let Some((name, (motors, fingers))) = arms.max_by_key(|(_, (motors, _))| motors.len()) {
        return Some(Chain { named: format!("the SRDF's group `{name}`"), motors, fingers });
    }
    let (mut motors, fingers) = without_fingers(robot, &robot.longest_chain());
    let length = motors.len();
    motors.truncate(MAX_MOTORS);
    let cut = if length > MAX_MOTORS { format!(", the first {MAX_MOTORS} of {length}") } else { String::new() };
    (!motors.is_empty()).then(|| Chain { named: format!("the longest chain{cut}"), motors, fingers })
}

/// Splits a chain into the motors of an arm and those of the hand at its end. A chain that is only a hand stays whole.
fn without_fingers(robot: &Robot, chain: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let branched = beyond_branch(robot, chain);
    let is_finger = |m: &usize| {
        let Some(motor) = robot.motors.get(*m) else { return false };
        let name = motor.name.to_lowercase();
        branched.contains(m) || motor.joints.len() > 1 || FINGER_WORDS.iter().any(|word| name.contains(word))
    };
    // only the end of the chain: a motor with several joints may be at its base
    let arm = chain.iter().rposition(|m| !is_finger(m)).map_or(0, |last| last + 1);
    if arm == 0 { (chain.to_vec(), Vec::new()) } else { (chain[..arm].to_vec(), chain[arm..].to_vec()) }
}

/// Motors of the chain beyond a node near its tip from which other motors branch off as well.
fn beyond_branch(robot: &Robot, chain: &[usize]) -> BTreeSet<usize> {
    let mut frames = Vec::new();
    robot.forward(&robot.home(), &mut frames);
    let at = |node: usize| frames.get(node).map(|f| f.translation.vector).unwrap_or_default();
    let joint_of = |m: &usize| robot.motors.get(*m).and_then(|motor| motor.joints.first().copied());
    let joints: Vec<usize> = chain.iter().filter_map(joint_of).collect();
    let (Some(first), Some(last)) = (joints.first(), joints.last()) else { return BTreeSet::new() };
    let length = (at(*last) - at(*first)).norm();
    let is_above = |above: usize, node: usize| {
        std::iter::successors(Some(node), |n| robot.nodes.get(*n)?.parent).any(|n| n == above)
    };
    let own: BTreeSet<usize> = chain.iter().copied().collect();
    let mut beyond = BTreeSet::new();
    for (i, joint) in joints.iter().enumerate().skip(1) {
        let Some(parent) = robot.nodes.get(*joint).and_then(|n| n.parent) else { continue };
        // other motors below the node from which this joint starts, and not only below an earlier joint's own link
        let others: Vec<usize> = (0..robot.nodes.len())
            .filter(|n| match robot.nodes[*n].kind {
                NodeKind::Joint { motor, .. } => !own.contains(&motor) && is_above(parent, *n),
                NodeKind::Link { .. } => false,
            })
            .collect();
        let small = |n: &usize| (at(*n) - at(*joint)).norm() < HAND_SHARE * length;
        if !others.is_empty() && others.iter().all(small) {
            beyond.extend(chain[i..].iter().copied());
            break;
        }
    }
    beyond
}
