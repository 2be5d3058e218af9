//! A tiny world for agents: a planar arm of a few joints, and a loop that drives an agent and
//! reports the end of its motions.

use mobee_contract::*;
use mobee_model::*;
use nalgebra::{Isometry3, Unit, Vector3};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::sync::Arc;

/// Creates an arm in the x-y plane: joints about z, links of 0.3 m along x, a ball of 4 cm at the
/// end of each link.
pub fn arm(joints: usize) -> Arc<Robot> {
    let node = |parent, kind, solids| Node {
        name: None,
        parent,
        part: 0,
        kind,
        solids,
        hulls: Default::default(),
        fields: Vec::new(),
        color: None,
        no_self_collision: false,
        near_root: false,
    };
    let mut nodes = Vec::new();
    let mut motors = Vec::new();
    for i in 0..joints {
        let parent = nodes.len().checked_sub(1);
        let axis = Unit::new_normalize(Vector3::z());
        let kind = NodeKind::Joint { motion: JointMotion::Turn, axis, motor: i, min: -PI, max: PI, length: 0.05 };
        motors.push(Motor {
            name: format!("joint{i}"),
            part: 0,
            min: -PI,
            max: PI,
            home: 0.0,
            motion: JointMotion::Turn,
            max_speed: None,
            continuous: false,
            joints: vec![nodes.len()],
            is_part_root: i == 0,
        });
        nodes.push(node(parent, kind, Vec::new()));
        let ball = Primitive { shape: Shape::Sphere { radius: 0.04 }, pose: Isometry3::translation(0.3, 0.0, 0.0) };
        let link = NodeKind::Link { offset: Vector3::new(0.3, 0.0, 0.0) };
        nodes.push(node(Some(nodes.len() - 1), link, vec![ball]));
    }
    let last = nodes.len() - 1;
    nodes.push(node(Some(last), NodeKind::Link { offset: Vector3::new(0.01, 0.0, 0.0) }, Vec::new()));
    let marker =
        Marker { name: "tip".into(), node: last + 1, part: 0, normal: Unit::new_normalize(Vector3::x()), tracer: 0 };
    Arc::new(Robot {
        name: "arm".into(),
        parts: vec![Part { name: "arm".into(), motors: 0..joints, root_node: Some(0), clauses: Vec::new() }],
        motors,
        nodes,
        markers: vec![marker],
        pairs: NodePairs::default(),
        left_out: None,
        near: Vec::new(),
        bare: Vec::new(),
    })
}

/// Creates the same arm with continuous joints, and encoders that count a hundred turns either way.
pub fn endless_arm(joints: usize) -> Arc<Robot> {
    let mut robot = arm(joints);
    let of = Arc::make_mut(&mut robot);
    for motor in &mut of.motors {
        (motor.continuous, motor.min, motor.max) = (true, -200.0 * PI, 200.0 * PI);
    }
    for node in &mut of.nodes {
        if let NodeKind::Joint { min, max, .. } = &mut node.kind {
            (*min, *max) = (-200.0 * PI, 200.0 * PI);
        }
    }
    robot
}

/// Creates a ball in the world.
pub fn ball(name: &str, x: f64, y: f64, radius: f64, class: ObjectClass) -> Object {
    Object {
        name: name.into(),
        class,
        persistent: false,
        pose: Isometry3::translation(x, y, 0.0),
        shapes: vec![Primitive { shape: Shape::Sphere { radius }, pose: Isometry3::identity() }],
        color: None,
    }
}

pub fn scene(robot: &Arc<Robot>, objects: Vec<Object>) -> Arc<Scene> {
    Arc::new(Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).unwrap())
}

pub fn view(scene: &Arc<Scene>, q: &[f64]) -> View {
    let axes = scene.robots()[0].motors.iter().map(|m| Axis {
        name: m.name.clone(),
        min: m.min,
        max: m.max,
        max_speed: 1.7,
        max_acceleration: 3.5,
        motion: m.motion,
        ..Default::default()
    });
    View {
        at: Time::default(),
        robot: 0,
        axes: axes.collect(),
        poses: vec![q.into()],
        scene: scene.clone(),
        contacts: Arc::new([]),
        clearance: 0.012,
        seen: Arc::new([]),
    }
}

pub fn context(robot: &Arc<Robot>, seed: u64) -> Context {
    Context { robot: robot.clone(), seed }
}

pub fn kind(name: &str, robot: &Arc<Robot>, seed: u64, settings: serde_json::Value) -> Box<dyn Agent> {
    try_kind(name, robot, seed, settings).unwrap_or_else(|e| panic!("{}: {} ({})", e.path, e.what, e.help))
}

pub fn try_kind(
    name: &str,
    robot: &Arc<Robot>,
    seed: u64,
    settings: serde_json::Value,
) -> Result<Box<dyn Agent>, KindError> {
    let kind = kinds::<dyn Agent>().into_iter().find(|k| k.name == name).expect("a registered kind");
    (kind.build)(&settings, &context(robot, seed))
}

/// Result of driving an agent.
#[derive(Debug, Default)]
pub struct Run {
    /// Every motion: from, to, and its success.
    pub motions: Vec<(Vec<f64>, Vec<f64>, bool)>,
    pub notes: Vec<Note>,
    pub done: Option<Summary>,
    pub waits: u32,
    /// Final position of the robot.
    pub q: Vec<f64>,
}

/// Drives an agent until it is done, or until it has given `most` intents. A motion ends at its
/// target if the oracle allows it, otherwise at its start, as after a rollback.
pub fn drive(
    agent: &mut dyn Agent,
    view: &mut View,
    most: usize,
    mut reached: impl FnMut(&View, &[f64], &[f64]) -> bool,
) -> Run {
    let mut run = Run { q: view.pose().to_vec(), ..Run::default() };
    let mut last = None;
    for _ in 0..most {
        let intent = agent.next(last.take(), view);
        run.notes.extend(agent.notes());
        match intent {
            Intent::MoveTo(target) | Intent::MoveEach(target, _) => {
                let to = target.pose(&run.q).to_vec();
                let ok = reached(view, &run.q, &to);
                view.contacts = if ok { Arc::default() } else { met(view, &run.q, &to) };
                run.motions.push((run.q.clone(), to.clone(), ok));
                if ok {
                    run.q = to;
                }
                view.poses = vec![run.q.as_slice().into()];
                last = Some(if ok { MotionEnd::Reached } else { MotionEnd::Failed });
            }
            Intent::Wait(_) => run.waits += 1,
            Intent::Done(summary) => {
                run.done = Some(summary);
                break;
            }
            other => panic!("unexpected intent {other:?}"),
        }
    }
    run
}

/// Returns the first contacts of a motion, as a view reports them after its rollback.
fn met(view: &View, from: &[f64], to: &[f64]) -> Arc<[Contact]> {
    let at = |s: f64| from.iter().zip(to).map(|(a, b)| a + s * (b - a)).collect::<Vec<f64>>();
    let mut steps = (0..=100).map(|i| view.scene.contacts(&[at(f64::from(i) / 100.0)], view.clearance));
    steps.find(|found| !found.is_empty()).unwrap_or_default().into()
}

/// The realistic oracle: the line is free at the reflex's margin.
pub fn by_scene(view: &View, from: &[f64], to: &[f64]) -> bool {
    view.scene.line_free(0, &view.poses, from, to, 0.001, view.clearance - 0.002)
}

/// Settings of a tour between a and b with two paths: the short one straight through (0.6, 0), the
/// long one with the arm folded.
pub fn two_ways(extra: Value) -> Value {
    let mut all = json!({
        "poses": [
            { "name": "a", "q_deg": { "joint0": 60 } },
            { "name": "b", "q_deg": { "joint0": -60 } },
            { "name": "folded_a", "q_deg": { "joint0": 60, "joint1": 150 } },
            { "name": "folded_b", "q_deg": { "joint0": -60, "joint1": 150 } },
        ],
        "edges": [["a", "b"], ["a", "folded_a"], ["folded_a", "folded_b"], ["folded_b", "b"]],
        "goals": ["a", "b"],
    });
    all.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    all
}
