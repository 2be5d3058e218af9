//! A map like the paper's: poses of torso and right arm of the iCub with the hand over a table, covering every square
//! centimeter, each connected with its nearest neighbors.

use mobee_fast::FastScene;
use mobee_model::{Object, ObjectClass, Primitive, Robot, Scene, Shape, ShapeId};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, UnitQuaternion, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Random numbers from 0 to 1; equal seeds give equal sequences.
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.roll()
    }
}

pub struct Map {
    pub robot: Arc<Robot>,
    /// Indices of the motors of torso and right arm.
    pub motors: Vec<usize>,
    pub poses: Vec<Vec<f64>>,
    /// Position of the hand at each pose.
    pub hands: Vec<Point3<f64>>,
    /// Undirected edges, each once.
    pub edges: Vec<(usize, usize)>,
}

/// Region of the hand, frame of the robot (x backward, y to its right, z up), meters.
const OVER_THE_TABLE: [(f64, f64); 2] = [(-0.5, -0.1), (-0.35, 0.65)];
const HEIGHT: f64 = 0.08;
/// Random displacement of motors before each reach, rad.
const SPREAD: f64 = 0.08;
/// Number of neighbors of each pose.
const NEIGHBORS: usize = 8;

impl Map {
    /// Creates `count` poses, grown from one another so that neighbors are similar, as in the paper's search.
    pub fn new(robot: Arc<Robot>, count: usize) -> Self {
        let parts = ["torso", "right_arm"];
        let of_part = |name: &&str| robot.part(name).map(|p| p.motors.clone()).unwrap_or_default();
        let motors: Vec<usize> = parts.iter().flat_map(of_part).take(10).collect();
        let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], Vec::new()).expect("a scene");
        let mut map = Map { robot, motors, poses: Vec::new(), hands: Vec::new(), edges: Vec::new() };
        let mut dice = Dice(2012);
        while map.poses.len() < count {
            let target = OVER_THE_TABLE.map(|(low, high)| dice.between(low, high));
            let target = Point3::new(target[0], target[1], HEIGHT);
            let near = (0..map.poses.len()).min_by(|a, b| {
                let distance = |i: &usize| (map.hands[*i] - target).norm();
                distance(a).total_cmp(&distance(b))
            });
            // Evenly distributed, so not too close to another one.
            if near.is_some_and(|i| (map.hands[i] - target).norm() < 0.0055) {
                continue;
            }
            // Slightly different: the paper's search lets the arm reach a point in many configurations.
            let mut start = near.map_or_else(|| map.robot.home(), |i| map.poses[i].clone());
            for m in &map.motors {
                let motor = &map.robot.motors[*m];
                start[*m] = (start[*m] + dice.between(-SPREAD, SPREAD)).clamp(motor.min, motor.max);
            }
            if let Some(pose) = map.reach(start, target)
                && scene.free(&[&pose], 0.002)
            {
                map.hands.push(map.hand(&pose));
                map.poses.push(pose);
            }
        }
        map.join();
        map
    }

    fn hand(&self, pose: &[f64]) -> Point3<f64> {
        let index = self.robot.markers.iter().position(|m| m.name == "r_hand").expect("a right hand");
        self.robot.markers_at(pose)[index].position()
    }

    /// Inverse kinematics by damped least squares.
    fn reach(&self, mut pose: Vec<f64>, target: Point3<f64>) -> Option<Vec<f64>> {
        for _ in 0..30 {
            let hand = self.hand(&pose);
            let error = target - hand;
            if error.norm() < 0.002 {
                return Some(pose);
            }
            let column = |m: &usize| {
                let mut moved = pose.clone();
                moved[*m] += 1e-5;
                (self.hand(&moved) - hand) / 1e-5
            };
            let columns: Vec<Vector3<f64>> = self.motors.iter().map(column).collect();
            let jacobian = DMatrix::from_fn(3, columns.len(), |r, c| columns[c][r]);
            let damped = &jacobian * jacobian.transpose() + DMatrix::identity(3, 3) * 1e-3;
            let step = jacobian.transpose() * damped.try_inverse()? * DVector::from_column_slice(error.as_slice());
            for (m, step) in self.motors.iter().zip(step.iter()) {
                let motor = &self.robot.motors[*m];
                pose[*m] = (pose[*m] + step.clamp(-0.2, 0.2)).clamp(motor.min, motor.max);
            }
        }
        None
    }

    fn join(&mut self) {
        let mut edges = BTreeSet::new();
        for (i, pose) in self.poses.iter().enumerate() {
            let distance = |j: usize| self.motors.iter().map(|m| (pose[*m] - self.poses[j][*m]).powi(2)).sum::<f64>();
            let mut others: Vec<(f64, usize)> = (0..self.poses.len()).map(|j| (distance(j), j)).collect();
            others.select_nth_unstable_by(NEIGHBORS, |a, b| a.0.total_cmp(&b.0));
            edges.extend(others[..=NEIGHBORS].iter().filter(|(_, j)| *j != i).map(|(_, j)| (i.min(*j), i.max(*j))));
        }
        self.edges = edges.into_iter().collect();
    }

    /// All edges, in the format of [`FastScene::certify`].
    pub fn lines(&self) -> Vec<f64> {
        self.edges.iter().flat_map(|(i, j)| [&self.poses[*i], &self.poses[*j]]).flatten().copied().collect()
    }

    /// Distance of the hand between the ends of an edge, meters.
    pub fn hand_path(&self, edge: usize) -> f64 {
        let (i, j) = self.edges[edge];
        (self.hands[i] - self.hands[j]).norm()
    }

    /// Ten balls and ten rods over the table, each of which blocks some poses, but at most 1 in 25.
    pub fn obstacles(&self) -> Vec<Object> {
        let mut dice = Dice(20);
        let mut objects = Vec::new();
        let poses: Vec<f64> = self.poses.iter().flatten().copied().collect();
        while objects.len() < 20 {
            let shape = match objects.len() % 2 {
                0 => Shape::Sphere { radius: 0.02 },
                _ => Shape::Capsule { radius: 0.015, height: 0.12 },
            };
            let [x, y] = OVER_THE_TABLE.map(|(low, high)| dice.between(low - 0.1, high + 0.1));
            let turn = UnitQuaternion::from_euler_angles(dice.between(-3.0, 3.0), dice.between(-3.0, 3.0), 0.0);
            let pose = Isometry3::from_parts(Vector3::new(x, y, dice.between(0.0, 0.4)).into(), turn);
            let object = object(format!("o{}", objects.len()), pose, shape);
            let scene = self.scene(vec![object.clone()]);
            let mut fast = FastScene::of_pairs(&scene, 0.0, |_, b| is_object(&scene, b, 0)).expect("it compiles");
            let mut free = Vec::new();
            fast.free(&poses, &mut free).expect("whole poses");
            let blocked = free.iter().filter(|free| !**free).count();
            if (1..=free.len() / 25).contains(&blocked) {
                objects.push(object);
            }
        }
        objects
    }

    pub fn scene(&self, objects: Vec<Object>) -> Scene {
        Scene::new(vec![(self.robot.clone(), Isometry3::identity())], objects).expect("a scene")
    }
}

/// True if a collider is a shape of the object with this number.
pub fn is_object(scene: &Scene, collider: u32, number: u32) -> bool {
    matches!(scene.shape_id(collider), Some(ShapeId::Object { object, .. }) if object == number)
}

pub fn object(name: String, pose: Isometry3<f64>, shape: Shape) -> Object {
    let shapes = vec![Primitive { shape, pose: Isometry3::identity() }];
    Object { name, class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}
