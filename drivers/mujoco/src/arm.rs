//! An arm simulated by MuJoCo.

use crate::mjcf::{STEP_S, actuator_name, geom_name, joint_name, leaders, write};
use mobee_contract::KindError;
use mobee_model::{Hinge, Scene};
use mobee_sim::path::State;
use mobee_sim::{ArmBody, ArmParts, ArmPhysics, Physics, PhysicsEngine, Pushes, Servo, StepClock};
use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_model::MjtObjBase;
use nalgebra::{Isometry3, Matrix3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Time between two steps.
const STEP: Duration = Duration::from_millis((STEP_S * 1e3) as u64);
/// Speed below which a joint rests, rad/s.
const STILL: f64 = 1e-6;
/// MuJoCo's warnings that invalidate its state: positions, speeds or accelerations that are NaN or huge.
const BAD_STATE: std::ops::RangeInclusive<usize> = 3..=5;

inventory::submit! {
    PhysicsEngine {
        physics: Physics::Mujoco,
        make: |parts| Ok(Box::new(MujocoArm::new(parts)?)),
        unused: &[
            ("inertia_kgm2", "MuJoCo computes it from the shapes and `mass_kg`"),
            ("contact_n_per_m", "MuJoCo's contacts have a stiffness of their own"),
        ],
    }
}

/// One joint of the skeleton in MuJoCo's state.
#[derive(Clone, Debug)]
struct ArmJoint {
    hinge: Hinge,
    /// Index into positions and speeds: every joint has one degree of freedom.
    dof: usize,
}

/// One motor.
#[derive(Clone, Copy, Debug)]
struct MotorJoint {
    servo: Servo,
    /// Leading joint of the motor, as an index into the joints, and its actuator. `None` if the motor moves
    /// nothing.
    leader: Option<(usize, usize)>,
    /// Position, rad, if it moves nothing.
    q: f64,
}

/// Owner of a geom: forces on all geoms of one owner are summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct GeomOwner {
    /// MuJoCo's body.
    body: usize,
    /// Distinguishes the world's shapes, which count individually; the shapes of a robot's link count
    /// together.
    thing: usize,
}

/// An arm as a MuJoCo model and its state.
#[derive(Debug)]
pub struct MujocoArm {
    data: MjData<Box<MjModel>>,
    joints: Vec<ArmJoint>,
    motors: Vec<MotorJoint>,
    /// Owners, by MuJoCo's index of the geom.
    owners: Vec<GeomOwner>,
    /// Share of the weight that is not compensated.
    felt: f64,
    clock: StepClock,
    external: Vec<f64>,
    pushes: Pushes,
}

impl MujocoArm {
    /// Creates an arm at rest, alone, and without weight.
    ///
    /// # Errors
    /// A robot that MuJoCo does not accept.
    pub fn new(parts: ArmParts) -> Result<MujocoArm, KindError> {
        let scene = Scene::new(vec![(parts.robot, Isometry3::identity())], Vec::new());
        let scene = Arc::new(scene.map_err(|e| refused(&e))?);
        let physics = ArmPhysics { scene, mass: parts.mass, felt: 0.0, stiffness: 0.0, damping: 0.0 };
        let clock = StepClock::new(STEP, &parts.start);
        MujocoArm::load(&physics, parts.servos, &parts.start, clock)
    }

    /// Creates an arm at rest at these positions, rad, which continues the clock's steps.
    fn load(physics: &ArmPhysics, servos: Vec<Servo>, q: &[f64], mut clock: StepClock) -> Result<MujocoArm, KindError> {
        let xml = write(physics, &servos).ok_or_else(|| refused(&"there is no robot"))?;
        let model = MjModel::from_xml_string(&xml).map_err(|e| refused(&e))?;
        let id = |kind: MjtObjBase, name: &str| {
            model.name_to_id(kind, name).ok_or_else(|| refused(&format!("MuJoCo's model has no {name}")))
        };
        let scene = &physics.scene;
        let robot = scene.robots().first().ok_or_else(|| refused(&"there is no robot"))?;
        let hinges: &[Hinge] = scene.skeletons().first().map_or(&[], |skeleton| &skeleton.joints);
        let joints = hinges
            .iter()
            .enumerate()
            .map(|(i, hinge)| Ok(ArmJoint { hinge: hinge.clone(), dof: id(MjtObjBase::mjOBJ_JOINT, &joint_name(i))? }));
        let joints = joints.collect::<Result<Vec<ArmJoint>, KindError>>()?;
        let leaders = leaders(robot, hinges);
        let motors = servos.into_iter().zip(leaders).zip(q).enumerate().map(|(m, ((servo, leader), q))| {
            let actuator = leader.map(|_| id(MjtObjBase::mjOBJ_ACTUATOR, &actuator_name(m))).transpose()?;
            Ok(MotorJoint { servo, leader: leader.zip(actuator), q: *q })
        });
        let motors = motors.collect::<Result<Vec<MotorJoint>, KindError>>()?;
        let mut owners = vec![GeomOwner { body: 0, thing: 0 }; model.ngeom() as usize];
        for i in 0..scene.colliders().count() {
            let geom = id(MjtObjBase::mjOBJ_GEOM, &geom_name(i))?;
            let body = model.geom_bodyid().get(geom).and_then(|body| usize::try_from(*body).ok()).unwrap_or(0);
            if let Some(owner) = owners.get_mut(geom) {
                *owner = GeomOwner { body, thing: if body == 0 { geom } else { 0 } };
            }
        }
        let mut data = MjData::try_new(Box::new(model)).map_err(|e| refused(&e))?;
        for joint in &joints {
            if let Some(slot) = data.qpos_mut().get_mut(joint.dof) {
                *slot = joint.hinge.position(q);
            }
        }
        clock.wake();
        let mut arm = MujocoArm {
            data,
            joints,
            external: vec![0.0; motors.len()],
            motors,
            owners,
            felt: physics.felt,
            clock,
            pushes: Pushes::default(),
        };
        arm.control(&q.iter().map(|q| State::rest(*q)).collect::<Vec<_>>());
        arm.data.forward();
        Ok(arm)
    }

    /// Leading joint and actuator of a motor.
    fn leader(&self, motor: &MotorJoint) -> Option<(&ArmJoint, usize)> {
        let (joint, actuator) = motor.leader?;
        Some((self.joints.get(joint)?, actuator))
    }

    /// Passes commanded states to the position servos. For speed feed-forward, the command leads by the lag
    /// that damping causes.
    fn control(&mut self, commanded: &[State]) {
        let targets: Vec<(usize, f64)> = self
            .motors
            .iter()
            .zip(commanded)
            .filter_map(|(motor, state)| {
                let (joint, actuator) = self.leader(motor)?;
                let Servo { lead, damping, stiffness, .. } = motor.servo;
                let q = state.q + lead * damping / stiffness.max(1e-9) * state.v;
                Some((actuator, joint.hinge.min + (q - joint.hinge.limits.0) * joint.hinge.gain))
            })
            .collect();
        for (actuator, target) in targets {
            if let Some(slot) = self.data.ctrl_mut().get_mut(actuator) {
                *slot = target;
            }
        }
        for (motor, state) in self.motors.iter_mut().zip(commanded) {
            motor.q = state.q;
        }
    }

    /// Contact forces of the last step: the greatest between two owners, N, and their torques for each degree
    /// of freedom.
    fn contacts(&self) -> (f64, Vec<f64>) {
        let mut torques = vec![0.0; self.joints.len()];
        let mut forces: BTreeMap<(GeomOwner, GeomOwner), f64> = BTreeMap::new();
        for (i, contact) in self.data.contact().iter().enumerate() {
            let Ok([normal, along, across, ..]) = self.data.try_contact_force(i) else { continue };
            if normal <= 0.0 {
                continue;
            }
            let force = Matrix3::from_column_slice(&contact.frame) * Vector3::new(normal, along, across);
            let owner = |geom: i32| usize::try_from(geom).ok().and_then(|geom| self.owners.get(geom)).copied();
            let (Some(a), Some(b)) = (owner(contact.geom1), owner(contact.geom2)) else { continue };
            *forces.entry((a, b)).or_default() += normal;
            for (owner, sign) in [(a, -1.0), (b, 1.0)] {
                let Ok((jacobian, _)) = self.data.try_jac(true, false, &contact.pos, owner.body) else { continue };
                for (row, component) in jacobian.chunks(self.joints.len().max(1)).zip(force.iter()) {
                    torques.iter_mut().zip(row).for_each(|(torque, j)| *torque += sign * j * component);
                }
            }
        }
        (forces.into_values().fold(0.0, f64::max), torques)
    }

    /// Total torque of a motor's joints, converted to the motor.
    fn of_motor(&self, m: usize, of: impl Fn(&ArmJoint) -> f64) -> f64 {
        let unit = self.motors.get(m).map_or(1.0, |motor| motor.servo.unit);
        self.joints.iter().filter(|joint| joint.hinge.motor == m).map(|joint| joint.hinge.gain * of(joint)).sum::<f64>()
            / unit
    }
}

impl ArmBody for MujocoArm {
    fn set_physics(&mut self, physics: ArmPhysics) -> Result<(), KindError> {
        let servos = self.motors.iter().map(|motor| motor.servo).collect();
        *self = MujocoArm::load(&physics, servos, &self.positions(), self.clock.clone())?;
        Ok(())
    }

    fn clock(&mut self) -> &mut StepClock {
        &mut self.clock
    }

    fn step(&mut self, commanded: &[State]) {
        let is_still = |data: &MjData<Box<MjModel>>| data.qvel().iter().all(|v| v.abs() < STILL);
        let before = is_still(&self.data);
        self.control(commanded);
        self.data.step();
        self.clock.step(commanded, before && is_still(&self.data));
        let (greatest, torques) = self.contacts();
        self.pushes.note(greatest, STEP);
        let at = |list: &[f64], joint: &ArmJoint| list.get(joint.dof).copied().unwrap_or_default();
        let external = |m| {
            // the bias is the torque that holds the arm against gravity and its own motion
            self.of_motor(m, |joint| at(&torques, joint) - self.felt * at(self.data.qfrc_bias(), joint))
        };
        self.external = (0..self.motors.len()).map(external).collect();
    }

    fn positions(&self) -> Vec<f64> {
        let position = |motor: &MotorJoint| {
            let Some((ArmJoint { hinge, dof }, _)) = self.leader(motor) else { return motor.q };
            let joint = self.data.qpos().get(*dof).copied().unwrap_or_default();
            hinge.limits.0 + (joint - hinge.min) / hinge.gain
        };
        self.motors.iter().map(position).collect()
    }

    fn speeds(&self) -> Vec<f64> {
        let speed = |motor: &MotorJoint| {
            let (joint, _) = self.leader(motor)?;
            Some(self.data.qvel().get(joint.dof)? / joint.hinge.gain)
        };
        self.motors.iter().map(|motor| speed(motor).unwrap_or_default()).collect()
    }

    fn efforts(&self) -> Vec<f64> {
        let effort = |motor: &MotorJoint| {
            let (joint, actuator) = self.leader(motor)?;
            Some(self.data.actuator_force().get(actuator)? * joint.hinge.gain / motor.servo.unit)
        };
        self.motors.iter().map(|motor| effort(motor).unwrap_or_default()).collect()
    }

    fn external(&self) -> Vec<f64> {
        self.external.clone()
    }

    fn pushes(&mut self) -> &mut Pushes {
        &mut self.pushes
    }

    fn trouble(&self) -> Option<String> {
        let bad =
            |(i, warning): (usize, &mujoco_rs::mujoco_c::mjWarningStat)| BAD_STATE.contains(&i) && warning.number > 0;
        let unstable = self.data.warning().iter().enumerate().any(bad);
        unstable.then(|| "MuJoCo's simulation became unstable: give softer servos or a greater mass".into())
    }
}

/// Error for a robot that MuJoCo does not accept.
fn refused(why: &dyn std::fmt::Display) -> KindError {
    KindError::new(
        "physics",
        format!("MuJoCo can't simulate this robot: {why}"),
        "leave `physics` out, or report the robot",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::load_robot;
    use mobee_sim::SimSettings;
    use nalgebra::Point3;
    use std::path::Path;

    /// In MuJoCo, every shape is where the robot model has it, at any configuration, including robots with
    /// prismatic joints, motors with several joints, and tilted bases.
    #[test]
    fn every_shape_is_where_the_robot_model_has_it() {
        for name in ["icub", "katana", "panda", "so101", "ur5"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
            let robot = Arc::new(load_robot(path).unwrap().value);
            let base = Isometry3::new(Vector3::new(0.1, -0.4, 0.7), Vector3::new(0.0, 0.3, 1.0));
            let scene: Arc<Scene> = Arc::new(Scene::new(vec![(robot.clone(), base)], Vec::new()).unwrap());
            let settings: SimSettings = serde_json::from_str(r#"{ "profile": "panda" }"#).unwrap();
            let servos = settings.servos(&robot).unwrap();
            let physics = ArmPhysics { scene: scene.clone(), mass: 5.0, felt: 1.0, stiffness: 0.0, damping: 0.0 };
            for share in [0.0, 0.31, 0.77, 1.0] {
                let q: Vec<f64> = robot.motors.iter().map(|m| m.min + share * (m.max - m.min)).collect();
                let arm = MujocoArm::load(&physics, servos.clone(), &q, StepClock::new(STEP, &q)).unwrap();
                let mut frames = Vec::new();
                scene.skeletons()[0].place(&q, &mut frames);
                for (i, shape) in scene.colliders().enumerate() {
                    let geom = arm.data.model().name_to_id(MjtObjBase::mjOBJ_GEOM, &geom_name(i)).unwrap();
                    let there = Point3::from(arm.data.geom_xpos()[geom]);
                    // MuJoCo moves a hull's frame to its center of mass
                    let here = match shape.hull() {
                        Some(_) => continue,
                        None => frames[shape.frame] * shape.pose * Point3::origin(),
                    };
                    assert!((here - there).norm() < 1e-9, "{name}, shape {i}: {here} and {there}");
                }
                let back = arm.positions();
                assert!(q.iter().zip(&back).all(|(a, b)| (a - b).abs() < 1e-9), "{name}: {q:?} and {back:?}");
            }
        }
    }
}
