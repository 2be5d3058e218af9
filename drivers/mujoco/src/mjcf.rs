//! Conversion of a robot model to MJCF, MuJoCo's XML format.
//!
//! Bodies are the moving frames of the robot's skeleton, geoms its collision shapes and the obstacles of the scene. Only the pairs that the
//! scene tests may touch. The mass is spread over the moving shapes by volume.

use mobee_model::{Collider, Hinge, JointMotion, Robot, Scene, Shape};
use mobee_sim::{ArmPhysics, Servo};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

/// Time between two steps, s.
pub const STEP_S: f64 = 0.002;

/// Name of the joint that carries frame `i + 1`.
pub fn joint_name(i: usize) -> String {
    format!("joint{i}")
}

/// Name of a collider's geom.
pub fn geom_name(i: usize) -> String {
    format!("shape{i}")
}

/// Name of a motor's actuator.
pub fn actuator_name(motor: usize) -> String {
    format!("motor{motor}")
}

/// Leading joint of each motor, as an index into the skeleton's joints; the motor's other joints are coupled
/// to it. `None` for a motor that moves nothing.
pub fn leaders(robot: &Robot, joints: &[Hinge]) -> Vec<Option<usize>> {
    (0..robot.motors.len()).map(|m| joints.iter().position(|joint| joint.motor == m)).collect()
}

/// Writes the first robot of a scene, and the scene's objects, as MJCF.
///
/// # Returns
/// `None` if the scene has no robot.
pub fn write(physics: &ArmPhysics, servos: &[Servo]) -> Option<String> {
    let robot = physics.scene.robots().first()?;
    let skeleton = physics.scene.skeletons().first()?;
    let shapes: Vec<&Collider> = physics.scene.colliders().collect();
    let moving = |shape: &&&Collider| (1..skeleton.frames()).contains(&shape.frame);
    let all: f64 = shapes.iter().filter(moving).map(|shape| shape.shape.volume()).sum();
    let writer = MjcfWriter {
        joints: &skeleton.joints,
        base: skeleton.base,
        servos,
        gravcomp: 1.0 - physics.felt,
        density: if all > 0.0 { physics.mass / all } else { 0.0 },
        shapes,
    };
    let mut xml = String::from("<mujoco>\n");
    xml.push_str("<compiler angle=\"radian\" boundmass=\"0.001\" boundinertia=\"0.000001\"/>\n");
    let _ = writeln!(
        xml,
        "<option timestep=\"{STEP_S}\" integrator=\"implicitfast\"><flag autoreset=\"disable\"/></option>"
    );
    xml.push_str("<default><geom contype=\"0\" conaffinity=\"0\"/></default>\n");
    writer.assets(&mut xml);
    xml.push_str("<worldbody>\n");
    writer.body(&mut xml, 0);
    writer.geoms(&mut xml, skeleton.frames());
    xml.push_str("</worldbody>\n");
    contacts(&mut xml, &physics.scene);
    let leaders = leaders(robot, writer.joints);
    writer.couplings(&mut xml, &leaders);
    writer.actuators(&mut xml, &leaders);
    xml.push_str("</mujoco>\n");
    Some(xml)
}

/// Source data of the elements.
struct MjcfWriter<'a> {
    joints: &'a [Hinge],
    base: Isometry3<f64>,
    servos: &'a [Servo],
    shapes: Vec<&'a Collider>,
    /// Share of the weight that is compensated.
    gravcomp: f64,
    /// Density, kg/m^3.
    density: f64,
}

impl MjcfWriter<'_> {
    /// Writes hulls as meshes, in their frame.
    fn assets(&self, xml: &mut String) {
        xml.push_str("<asset>\n");
        for (i, hull) in self.shapes.iter().enumerate().filter_map(|(i, shape)| Some((i, shape.hull()?))) {
            let _ = write!(xml, "<mesh name=\"hull{i}\" inertia=\"convex\" vertex=\"");
            for vertex in hull.mesh().vertices {
                let _ = write!(xml, "{} {} {} ", vertex.x, vertex.y, vertex.z);
            }
            xml.push_str("\"/>\n");
        }
        xml.push_str("</asset>\n");
    }

    /// Writes a frame with its shapes and its children.
    fn body(&self, xml: &mut String, frame: usize) {
        let joint = frame.checked_sub(1).and_then(|j| Some((j, self.joints.get(j)?)));
        let at = joint.map_or(self.base, |(_, joint)| joint.at);
        let _ = writeln!(xml, "<body name=\"frame{frame}\" gravcomp=\"{}\" {}>", self.gravcomp, pose(&at));
        if let Some((j, joint)) = joint {
            self.joint(xml, j, joint);
        }
        self.geoms(xml, frame);
        for child in self.joints.iter().enumerate().filter_map(|(j, joint)| (joint.parent == frame).then_some(j + 1)) {
            self.body(xml, child);
        }
        xml.push_str("</body>\n");
    }

    fn joint(&self, xml: &mut String, j: usize, joint: &Hinge) {
        let Some(servo) = self.servos.get(joint.motor) else { return };
        let kind = match joint.motion {
            JointMotion::Turn => "hinge",
            JointMotion::Slide => "slide",
        };
        let axis = joint.axis.into_inner();
        let gain = joint.gain.abs();
        let (min, max) = (joint.min.min(joint.max), joint.min.max(joint.max));
        let _ = writeln!(
            xml,
            "<joint name=\"{}\" type=\"{kind}\" axis=\"{}\" limited=\"true\" range=\"{min} {max}\" armature=\"{}\" frictionloss=\"{}\"/>",
            joint_name(j),
            three(&axis),
            servo.rotor / (gain * gain),
            servo.friction / gain,
        );
    }

    /// Writes the shapes on a frame.
    fn geoms(&self, xml: &mut String, frame: usize) {
        for (i, shape) in self.shapes.iter().enumerate().filter(|(_, shape)| shape.frame == frame) {
            let mass = self.density * shape.shape.volume();
            let _ = write!(xml, "<geom name=\"{}\" mass=\"{mass}\" ", geom_name(i));
            match (shape.hull(), shape.shape) {
                (Some(_), _) => {
                    let _ = write!(xml, "type=\"mesh\" mesh=\"hull{i}\"");
                }
                (None, Shape::Sphere { radius }) => {
                    let _ = write!(xml, "type=\"sphere\" size=\"{radius}\" {}", pose(&shape.pose));
                }
                (None, Shape::Box { size }) => {
                    let _ = write!(xml, "type=\"box\" size=\"{}\" {}", three(&(size / 2.0)), pose(&shape.pose));
                }
                (None, Shape::Cylinder { radius, height }) => {
                    let upright = pose(&upright(&shape.pose));
                    let _ = write!(xml, "type=\"cylinder\" size=\"{radius} {}\" {upright}", height / 2.0);
                }
                (None, Shape::Capsule { radius, height }) => {
                    let upright = pose(&upright(&shape.pose));
                    let _ = write!(xml, "type=\"capsule\" size=\"{radius} {}\" {upright}", height / 2.0);
                }
            }
            xml.push_str("/>\n");
        }
    }

    /// Couples the joints of one motor linearly to the first of them.
    fn couplings(&self, xml: &mut String, leaders: &[Option<usize>]) {
        xml.push_str("<equality>\n");
        for (j, joint) in self.joints.iter().enumerate() {
            let leader = leaders.get(joint.motor).copied().flatten();
            let Some((l, first)) = leader.and_then(|l| Some((l, self.joints.get(l)?))).filter(|(l, _)| *l != j) else {
                continue;
            };
            let ratio = joint.gain / first.gain;
            let follower = joint_name(j);
            let leader = joint_name(l);
            let offset = joint.min - first.min * ratio;
            let _ =
                writeln!(xml, "<joint joint1=\"{follower}\" joint2=\"{leader}\" polycoef=\"{offset} {ratio} 0 0 0\"/>");
        }
        xml.push_str("</equality>\n");
    }

    /// Writes the position servos.
    fn actuators(&self, xml: &mut String, leaders: &[Option<usize>]) {
        xml.push_str("<actuator>\n");
        for (m, (servo, leader)) in self.servos.iter().zip(leaders).enumerate() {
            let Some((l, joint)) = leader.and_then(|l| Some((l, self.joints.get(l)?))) else { continue };
            let per_joint = joint.gain * joint.gain;
            let force = servo.torque / joint.gain.abs();
            let _ = writeln!(
                xml,
                "<position name=\"{}\" joint=\"{}\" kp=\"{}\" kv=\"{}\" forcelimited=\"true\" forcerange=\"{} {force}\"/>",
                actuator_name(m),
                joint_name(l),
                servo.stiffness / per_joint,
                servo.damping / per_joint,
                -force,
            );
        }
        xml.push_str("</actuator>\n");
    }
}

/// Writes the pairs that may touch: those that the scene tests.
fn contacts(xml: &mut String, scene: &Scene) {
    xml.push_str("<contact>\n");
    for (a, b) in scene.pairs() {
        let _ = writeln!(xml, "<pair geom1=\"{}\" geom2=\"{}\"/>", geom_name(*a as usize), geom_name(*b as usize));
    }
    xml.push_str("</contact>\n");
}

/// Rotates the pose of a cylinder or capsule, which lies along y here and along z in MuJoCo.
fn upright(pose: &Isometry3<f64>) -> Isometry3<f64> {
    pose * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -FRAC_PI_2)
}

fn pose(pose: &Isometry3<f64>) -> String {
    let q = pose.rotation.quaternion();
    format!("pos=\"{}\" quat=\"{} {} {} {}\"", three(&pose.translation.vector), q.w, q.i, q.j, q.k)
}

fn three(v: &Vector3<f64>) -> String {
    format!("{} {} {}", v.x, v.y, v.z)
}
