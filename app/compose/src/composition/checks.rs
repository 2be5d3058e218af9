//! Checks that valid parts fit together: robots and world, poses and obstacles, agents and boards, ports and names.

use super::{Begin, BuiltRobot};
use crate::config::{Complaints, Config, Source};
use mobee_contract::SetPose;
use mobee_model::{Contact, Scene, ShapeId};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Maximum number of link pairs that a complaint lists with a line that disables them; more of them indicate another
/// error.
const MAX_DISABLE_LINES: usize = 5;

/// Runs all checks.
pub(super) fn all(
    config: &Config,
    source: &Source,
    scene: &Scene,
    built: &[BuiltRobot],
    begin: Begin,
    wrong: &mut Complaints,
    warnings: &mut Vec<String>,
) {
    let poses =
        PoseChecks { config, source, scene, moved: config.script.iter().map(|s| s.edit.object.as_str()).collect() };
    if begin == Begin::New {
        poses.starts(built, wrong);
    }
    // the poses of a robot that can't start are not checked
    if wrong.is_empty() {
        poses.named(built, wrong, warnings);
    }
    readings(config, source, built, wrong);
    boards(config, source, built, wrong);
}

struct PoseChecks<'a> {
    config: &'a Config,
    source: &'a Source,
    scene: &'a Scene,
    /// The objects that the script moves or changes.
    moved: BTreeSet<&'a str>,
}

impl PoseChecks<'_> {
    /// Checks the start configurations: a motion that starts in contact could never be committed.
    fn starts(&self, built: &[BuiltRobot], wrong: &mut Complaints) {
        let mut poses = self.scene.home();
        let known = |b: &BuiltRobot| b.hardware.as_ref().and_then(|h| h.known().start);
        let starts: Vec<Option<SetPose>> = built.iter().map(known).collect();
        for (pose, start) in poses.iter_mut().zip(&starts) {
            if let Some(start) = start {
                *pose = Arc::from(start.q.clone());
            }
        }
        let mut reported: Vec<(ShapeId, ShapeId)> = Vec::new();
        for (i, r) in self.config.robot.iter().enumerate() {
            // an invalid margin is reported elsewhere
            let judged = (0.0..=500.0).contains(&r.controller.margin_mm);
            let near =
                self.nearest(i, &poses, r.controller.margin_mm).filter(|c| judged && !reported.contains(&c.pair));
            let Some(c) = near else { continue };
            reported.push(c.pair);
            // a recorded robot repeats its recording
            if matches!(starts.get(i), Some(Some(start)) if start.optional) {
                continue;
            }
            let (path, when) = match starts.get(i) {
                Some(Some(start)) => (format!("robot[{i}].driver.{}", start.path), "at the start"),
                _ => (format!("robot[{i}].model"), "at home"),
            };
            let others = self.close_own_pairs(i, &poses, r.controller.margin_mm);
            let itself = matches!(c.pair, (ShapeId::Robot { robot: a, .. }, ShapeId::Robot { robot: b, .. }) if a == b);
            let mut what = format!("{when}, {}", self.describe(&c, r.controller.margin_mm));
            if itself && others.len() > 1 {
                what += &format!("; {} pairs of its links are as near", others.len());
            }
            let help = match itself {
                true => self.self_collision_remedy(i, &others),
                false => "move the object or the robot's base, let the robot start elsewhere (`start_deg` of the driver `sim`, `home` in \
                          the robot's file), or choose a smaller margin"
                    .to_owned(),
            };
            wrong.push(self.source.error(&path, what, help));
        }
    }

    /// Pairs of a robot's own nodes that are closer than the margin, the closest first.
    fn close_own_pairs(&self, robot: usize, poses: &[mobee_contract::Pose], margin_mm: f64) -> Vec<(usize, usize)> {
        let own = |id: ShapeId| match id {
            ShapeId::Robot { robot: r, node, .. } if usize::from(r) == robot => Some(usize::from(node)),
            _ => None,
        };
        let mut all = self.scene.contacts(poses, margin_mm * 1e-3);
        all.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let mut pairs = Vec::new();
        for pair in all.iter().filter_map(|c| Some((own(c.pair.0)?, own(c.pair.1)?))) {
            if !pairs.contains(&pair) {
                pairs.push(pair);
            }
        }
        pairs
    }

    /// Remedies for a robot in self-collision, among them the lines that disable the pairs in its file.
    fn self_collision_remedy(&self, robot: usize, pairs: &[(usize, usize)]) -> String {
        let mut help =
            "let it start elsewhere (`start_deg` of the driver `sim`, `home` in the robot's file), or choose a \
                        smaller margin"
                .to_owned();
        let of = self.scene.robots().get(robot).zip(self.config.robot.get(robot));
        let Some((model, r)) = of else { return help };
        let line = |pair: &(usize, usize)| model.leave_out_line(*pair, "can't hurt each other");
        let lines: Vec<String> = pairs.iter().take(MAX_DISABLE_LINES).filter_map(line).collect();
        if !lines.is_empty() {
            let file = r.model.display();
            help += &format!(
                ". Only where two links can't hurt each other, however they meet: write into <pairs> of {file}, so that they are \
                 never tested, {}",
                lines.join(" ")
            );
        }
        help
    }

    /// Checks the poses that an agent's settings name, with the other robots at home.
    fn named(&self, built: &[BuiltRobot], wrong: &mut Complaints, warnings: &mut Vec<String>) {
        for (i, (r, b)) in self.config.robot.iter().zip(built).enumerate() {
            let of_agent = b.agent.iter().flat_map(|(_, means)| &means.poses).map(|pose| ("agent.", pose));
            let of_rest = b.rest.iter().map(|(_, pose)| ("", pose));
            for (table, SetPose { path, q, optional }) in of_agent.chain(of_rest) {
                let mut poses = self.scene.home();
                if let Some(own) = poses.get_mut(i) {
                    *own = Arc::from(q.clone());
                }
                let near = self.nearest(i, &poses, r.controller.margin_mm);
                let what = match &near {
                    Some(c) => format!("in this pose {}", self.describe(c, r.controller.margin_mm)),
                    None if !self.scene.satisfies_constraints(i, q) => {
                        "this pose breaks a constraint of the robot's file".to_owned()
                    }
                    None => continue,
                };
                let may_change = *optional || near.as_ref().is_some_and(|c| self.may_move(c));
                if may_change {
                    warnings.push(format!("{}: {path}: {what}; the reflex will undo the way there", r.name));
                } else {
                    let help = "change the pose, or move the object; no motion could end here";
                    wrong.push(self.source.error(&format!("robot[{i}].{table}{path}"), what, help));
                }
            }
        }
    }

    fn nearest(&self, robot: usize, poses: &[mobee_contract::Pose], margin_mm: f64) -> Option<Contact> {
        let own = |id: ShapeId| matches!(id, ShapeId::Robot { robot: r, .. } if usize::from(r) == robot);
        let mut all = self.scene.contacts(poses, margin_mm * 1e-3);
        all.retain(|c| own(c.pair.0) || own(c.pair.1));
        all.into_iter().min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    fn may_move(&self, c: &Contact) -> bool {
        let moved = |id: ShapeId| match id {
            ShapeId::Object { object, .. } => {
                self.scene.objects().any(|(id, o)| id == object && self.moved.contains(o.name.as_str()))
            }
            ShapeId::Robot { .. } => false,
        };
        moved(c.pair.0) || moved(c.pair.1)
    }

    fn describe(&self, c: &Contact, margin_mm: f64) -> String {
        let a = self.scene.label(c.pair.0);
        let b = self.scene.label(c.pair.1);
        let mm = c.distance * 1e3;
        if mm < 0.0 {
            return format!("{a} is {:.1} mm deep in {b}", -mm);
        }
        format!("{a} is {mm:.1} mm from {b}, nearer than the margin of {margin_mm} mm")
    }
}

/// Checks the age of samples: a controller whose samples are always stale would never open its filter.
fn readings(config: &Config, source: &Source, built: &[BuiltRobot], wrong: &mut Complaints) {
    for (i, (r, b)) in config.robot.iter().zip(built).enumerate() {
        let Some(period) = b.hardware.as_ref().and_then(|h| h.known().period) else { continue };
        let board_ms = period.as_secs_f64() * 1e3;
        let fresh_ms = r.controller.stale_after_ms();
        if board_ms > fresh_ms && r.controller.period_ms >= 1.0 {
            let what = format!(
                "a reading counts for {fresh_ms} ms (`stale_ms`, or five control periods), and the board gives one every \
                 {board_ms:.0} ms"
            );
            let help = format!("give {:.0} ms or more, or let the driver read more often", (board_ms / 2.0).ceil());
            wrong.push(source.error(&format!("robot[{i}].controller.period_ms"), what, help));
        }
    }
}

/// Checks the boards: an agent whose motors have no board would move nothing, and two drivers of one board would
/// conflict.
fn boards(config: &Config, source: &Source, built: &[BuiltRobot], wrong: &mut Complaints) {
    for (i, b) in built.iter().enumerate() {
        let (Some(hardware), Some((_, means))) = (&b.hardware, &b.agent) else { continue };
        let Some(driven) = hardware.known().motors else { continue };
        let idle: BTreeSet<&str> = means
            .motors
            .iter()
            .filter(|m| !driven.contains(m))
            .filter_map(|m| Some(b.model.motors.get(*m)?.name.as_str()))
            .collect();
        if !idle.is_empty() {
            let names: Vec<&str> = idle.into_iter().take(5).collect();
            let what = format!("the agent moves motors that have no board: {}", names.join(", "));
            let help = "name the boards of their parts in the driver's `parts`, or remove the motors";
            wrong.push(source.error(&format!("robot[{i}].agent.motors"), what, help));
        }
    }
    let port = |i: usize, k: usize| config.robot.get(i)?.driver.get("parts")?.get(k)?.get("port")?.as_str();
    let mut taken: Vec<(&str, &str)> = Vec::new();
    for (i, r) in config.robot.iter().enumerate() {
        for k in 0..r.driver["parts"].as_array().map_or(0, Vec::len) {
            let Some(name) = port(i, k) else { continue };
            let at = format!("robot[{i}].driver.parts[{k}].port");
            if let Some((_, other)) = taken.iter().find(|(port, other)| *port == name && *other != r.name) {
                let what = format!("robot {other} is driven by the board {name} already");
                wrong.push(source.error(&at, what, "give every robot boards of its own"));
            }
            for (table, ports) in config.yarp_ports().filter(|(_, ports)| ports.filter) {
                let prefix = ports.robot_prefix(&r.name);
                if name.strip_prefix(&prefix).is_some_and(|rest| rest.starts_with('/')) {
                    let what = format!("{name} would be the robot's own board and MoBeE's filtered one");
                    let help = format!("give the filter another prefix: {table}.robots.{}.prefix", r.name);
                    wrong.push(source.error(&at, what, help));
                }
            }
            taken.push((name, &r.name));
        }
    }
}
