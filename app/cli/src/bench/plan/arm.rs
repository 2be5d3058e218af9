//! The robot of a problem file: `robots/NAME_spherized.urdf` (or `NAME.urdf`) and `robots/NAME.srdf` beside it, or
//! `robots/NAME.xml`.
//!
//! The pairs that the SRDF disables are not tested, nor those that touch at every sampled configuration, which would leave nothing
//! free. No other pair is left out, so that the questions are those that published figures answer.

use super::problems::{InputFault, ProblemFile};
use mobee_import::{UrdfOptions, load_link_tree, load_srdf, load_urdf};
use mobee_model::{JointMotion, LeftOut, Loaded, Robot, Scene, ShapeId, load_robot, random_poses, suggestion};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// Configurations at which a pair must touch, all of them, to be left out.
const SAMPLES: usize = 128;
const SEED: u64 = 46;

/// A robot, and the motors that are planned for.
pub(crate) struct Arm {
    pub robot: Arc<Robot>,
    /// Where its motors are that do not move, and home elsewhere, rad of encoder.
    pub pose: Vec<f64>,
    /// Indices into `Robot::motors`.
    pub motors: Vec<usize>,
    /// Rules for pairs of all problems.
    pub may_touch: Vec<String>,
    pub pair_clearance_mm: BTreeMap<String, f64>,
    /// What is not used of the files, and which pairs always touch.
    pub notes: Vec<String>,
}

/// Reads a robot from its URDF and SRDF, or from its XML, and notes about these files.
fn read_arm(folder: &Path, name: &str) -> Result<(Robot, Vec<String>), InputFault> {
    let fault = |e: &dyn std::error::Error| InputFault::new(e, "mend the file, or get it anew");
    let files = [format!("{name}_spherized.urdf"), format!("{name}.urdf"), format!("{name}.xml")];
    let Some(file) = files.iter().map(|n| folder.join(n)).find(|path| path.is_file()) else {
        let text = format!("{}: none of {} is there", folder.display(), files.join(", "));
        let help = "put the robot's URDF and SRDF, or its XML, in robots/ beside the problem file";
        return Err(InputFault::new(text, help));
    };
    if file.extension().is_some_and(|extension| extension == "xml") {
        let Loaded { value, warnings } = load_robot(&file).map_err(|e| fault(&e))?;
        return Ok((value, warnings.iter().map(ToString::to_string).collect()));
    }
    let Loaded { value: mut robot, warnings } = load_urdf(&file, &UrdfOptions::default()).map_err(|e| fault(&e))?;
    let tree = load_link_tree(&file).map_err(|e| fault(&e))?;
    let srdf = load_srdf(folder.join(format!("{name}.srdf")), &tree).map_err(|e| fault(&e))?;
    let notes = warnings.iter().chain(&srdf.warnings).map(ToString::to_string).collect();
    let node = |link: &str| robot.node_named(link);
    // a link without a node has no shapes either
    let disabled = srdf.value.disabled.iter().filter_map(|((a, b), reason)| {
        Some(LeftOut { nodes: (node(a)?, node(b)?), reason: format!("SRDF: {reason}") })
    });
    let disabled: Vec<LeftOut> = disabled.collect();
    robot.leave_out(disabled);
    Ok((robot, notes))
}

/// Reads the robot of a problem file.
///
/// # Errors
/// If its files are missing or faulty, or lack a joint, with place and remedy.
pub(crate) fn load_arm(path: &Path, file: &ProblemFile) -> Result<Arm, InputFault> {
    let name = &file.robot;
    let (mut robot, mut notes) = read_arm(&path.parent().unwrap_or(Path::new(".")).join("robots"), name)?;
    let motor = |joint: &String| {
        let names: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
        robot.motors.iter().position(|m| m.name == *joint).ok_or_else(|| {
            let text = format!("{}: {name} has no joint `{joint}` that moves", path.display());
            InputFault::new(text, suggestion(joint, "joint", &names))
        })
    };
    let motors = file.joints.iter().map(motor).collect::<Result<Vec<usize>, InputFault>>()?;
    if motors.iter().collect::<BTreeSet<_>>().len() != motors.len() {
        let text = format!("{}: `joints` names a joint twice", path.display());
        return Err(InputFault::new(text, "name each joint once"));
    }
    let mut pose = robot.home();
    for (joint, q) in &file.others {
        let Some((m, motor)) = robot.motors.iter().enumerate().find(|(_, m)| m.name == *joint) else {
            // such as one that follows another
            notes.push(format!("others.{joint} is not used: no motor of the robot has this name"));
            continue;
        };
        let wanted = motor.motion.encoder(*q);
        let within = wanted.max(motor.min).min(motor.max);
        if (within - wanted).abs() > 1e-9 {
            notes.push(format!("others.{joint} is beyond the joint's limits: it stands at the limit"));
        }
        pose.get_mut(m).into_iter().for_each(|slot| *slot = within);
    }
    notes.extend(leave_out_what_always_touches(&mut robot, &pose, &motors)?);
    let (may_touch, pair_clearance_mm) = (file.may_touch.clone(), file.pair_clearance_mm.clone());
    Ok(Arm { robot: Arc::new(robot), pose, motors, may_touch, pair_clearance_mm, notes })
}

impl Arm {
    /// Positions of the joints as rad of encoder.
    pub fn encoder(&self, q: &[f64]) -> Vec<f64> {
        self.motors.iter().zip(q).map(|(m, q)| self.motion(*m).encoder(*q)).collect()
    }

    /// Length of a path in rad and meters (Euclidean): what published figures call its cost.
    pub fn cost(&self, poses: &[Vec<f64>]) -> f64 {
        let scale: Vec<f64> = self.motors.iter().map(|m| 1.0 / self.motion(*m).encoder(1.0)).collect();
        let line = |a: &[f64], b: &[f64]| {
            let squares = a.iter().zip(b).zip(&scale).map(|((a, b), s)| ((b - a) * s).powi(2));
            squares.sum::<f64>().sqrt()
        };
        poses.windows(2).map(|w| line(&w[0], &w[1])).sum()
    }

    fn motion(&self, motor: usize) -> JointMotion {
        self.robot.motors.get(motor).map(|m| m.motion).unwrap_or_default()
    }
}

/// Leaves out pairs that touch wherever the robot is; returns a note for each.
fn leave_out_what_always_touches(robot: &mut Robot, rest: &[f64], motors: &[usize]) -> Result<Vec<String>, InputFault> {
    let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())
        .map_err(|e| InputFault::new(e, "mend the robot's URDF"))?;
    let mut always: Option<BTreeSet<(usize, usize)>> = None;
    for sample in random_poses(robot, SEED).take(SAMPLES) {
        let mut pose = rest.to_vec();
        for m in motors {
            pose[*m] = sample[*m];
        }
        let node = |id: ShapeId| match id {
            ShapeId::Robot { node, .. } => Some(usize::from(node)),
            ShapeId::Object { .. } => None,
        };
        let touching = scene.contacts(&[pose], 0.0).into_iter();
        let touching = touching.filter_map(|c| Some((node(c.pair.0)?, node(c.pair.1)?))).collect();
        always = Some(match always {
            None => touching,
            Some(before) => before.intersection(&touching).copied().collect(),
        });
    }
    let all: Vec<LeftOut> = always
        .into_iter()
        .flatten()
        .map(|nodes| LeftOut { nodes, reason: format!("in contact at each of {SAMPLES} sampled configurations") })
        .collect();
    let named = |n: usize| robot.nodes.get(n).and_then(|n| n.name.clone()).unwrap_or_else(|| "?".into());
    let notes =
        all.iter().map(|l| format!("{} and {} are not tested: {}", named(l.nodes.0), named(l.nodes.1), l.reason));
    let notes = notes.collect();
    robot.leave_out(all);
    Ok(notes)
}
