//! Robots as chains that the lanes can follow cheaply: which frame of a moving body is the one to compute.
//!
//! A body's own frame F is as its file has it. The lanes compute L = F·K instead, with a constant K of the compiler's
//! choice: z along the hinge that carries the body, and x so that the first hinge on the body is reached by one turn
//! about x. This is Denavit and Hartenberg's choice; it spares most products of rotations.

use crate::bound::Bound;
use crate::program::{Bend, Joint, Motion};
use mobee_model::{Hinge, JointMotion, Skeleton};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// A frame as the lanes have it.
#[derive(Clone, Debug)]
pub(crate) struct LaneFrame {
    /// K, a rotation: the body's frame from this one.
    pub choice: UnitQuaternion<f64>,
    /// How it hangs on another, unless it is fixed.
    pub carried: Option<Carried>,
    /// Where it is if it is fixed: `world_from_lane`.
    pub fixed: Isometry3<f64>,
    /// What rounding can do to it.
    pub bound: Bound,
}

impl LaneFrame {
    /// Where objects are.
    pub fn world() -> Self {
        let (choice, fixed) = (UnitQuaternion::identity(), Isometry3::identity());
        LaneFrame { choice, carried: None, fixed, bound: Bound::fixed(&Vector3::zeros()) }
    }
}

/// A frame that a joint carries.
#[derive(Clone, Debug)]
pub(crate) struct Carried {
    pub parent: usize,
    /// What stands between, constant.
    pub before: Isometry3<f64>,
    /// The motion's range, rad or meters.
    pub range: (f64, f64),
    /// The direction of a slide, in the parent's frame.
    pub slide: Option<Vector3<f64>>,
    pub joint: Joint,
}

/// `Rz(about_z) · Rx(about_x) · Rz(rest)`: any rotation.
struct Euler {
    about_z: f64,
    about_x: f64,
    rest: f64,
}

impl Euler {
    fn of(rotation: &UnitQuaternion<f64>) -> Self {
        let z = rotation * Vector3::z();
        let sine = z.xy().norm();
        let about_x = sine.atan2(z.z);
        // Parallel axes: all is one turn.
        let about_z = if sine < 1e-12 { 0.0 } else { z.x.atan2(-z.y) };
        // From what is left, so that where `about_z` is ill determined this one makes up for it.
        let left = (turn_z(about_z) * turn_x(about_x)).inverse() * rotation * Vector3::x();
        Euler { about_z, about_x, rest: left.y.atan2(left.x) }
    }
}

fn turn_z(angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
}

fn turn_x(angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle)
}

/// A rotation that takes z to the axis.
fn z_to(hinge: &Hinge) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::z(), &hinge.axis).unwrap_or_else(|| turn_x(PI))
}

impl Bend {
    fn by(angle: f64) -> Self {
        let is = |other: f64| (angle - other).abs() < 1e-12;
        if is(0.0) {
            Bend::None
        } else if is(FRAC_PI_2) {
            Bend::Quarter
        } else {
            Bend::By { cosine: angle.cos() as f32, sine: angle.sin() as f32 }
        }
    }

    fn bound(self, bound: Bound) -> Bound {
        if matches!(self, Bend::By { .. }) { bound.turned() } else { bound }
    }
}

/// The frames of one robot, numbered on from those that are there. Motors are numbered over the scene, from
/// `first_motor`.
pub(crate) fn follow(skeleton: &Skeleton, first_motor: usize, frames: &mut Vec<LaneFrame>) {
    let first = frames.len();
    // By how much each frame is turned about its z so that its first hinge is reached without a turn about z.
    let convenient = |frame: usize, choice: &UnitQuaternion<f64>| {
        let next = skeleton.joints.iter().find(|j| j.parent == frame && j.motion == JointMotion::Turn);
        next.map_or(0.0, |next| Euler::of(&(choice.inverse() * next.at.rotation * z_to(next))).about_z)
    };
    let choice = turn_z(convenient(0, &UnitQuaternion::identity()));
    let bound = Bound::fixed(&skeleton.base.translation.vector);
    frames.push(LaneFrame { choice, carried: None, fixed: skeleton.base * choice, bound });
    for (j, hinge) in skeleton.joints.iter().enumerate() {
        let parent = &frames[first + hinge.parent];
        let frame = match hinge.motion {
            JointMotion::Turn => {
                let extra = convenient(j + 1, &z_to(hinge));
                turning(parent, hinge, extra)
            }
            JointMotion::Slide => sliding(parent, hinge),
        };
        let LaneFrame { carried: Some(mut carried), choice, fixed, bound } = frame else { continue };
        carried.parent = first + hinge.parent;
        carried.joint.parent = carried.parent;
        carried.joint.frame = first + j + 1;
        carried.joint.motor += first_motor;
        frames.push(LaneFrame { carried: Some(carried), choice, fixed, bound });
    }
}

/// The frame of a hinge, turned by `extra` about its own axis.
fn turning(parent: &LaneFrame, hinge: &Hinge, extra: f64) -> LaneFrame {
    let euler = Euler::of(&(parent.choice.inverse() * hinge.at.rotation * z_to(hinge)));
    let shift = parent.choice.inverse() * hinge.at.translation.vector;
    let (about_z, about_x) = (Bend::by(euler.about_z), Bend::by(euler.about_x));
    let start = hinge.min + euler.rest + extra;
    let bound = about_x.bound(about_z.bound(parent.bound.shifted(shift.norm()))).turned();
    LaneFrame {
        choice: z_to(hinge) * turn_z(extra),
        bound,
        fixed: Isometry3::identity(),
        carried: Some(Carried {
            parent: 0,
            before: Isometry3::from_parts(Translation3::from(shift), turn_z(euler.about_z) * turn_x(euler.about_x)),
            range: (start, start + hinge.max - hinge.min),
            slide: None,
            joint: joint(hinge, start, shift, Motion::Turn { about_z, about_x }),
        }),
    }
}

/// The frame of a slide keeps its parent's axes.
fn sliding(parent: &LaneFrame, hinge: &Hinge) -> LaneFrame {
    let turned = parent.choice.inverse() * hinge.at.rotation;
    let (shift, along) = (parent.choice.inverse() * hinge.at.translation.vector, turned * *hinge.axis);
    let way = hinge.min.abs().max(hinge.max.abs());
    LaneFrame {
        choice: turned.inverse(),
        bound: parent.bound.shifted(shift.norm()).shifted(way).shifted(0.0),
        fixed: Isometry3::identity(),
        carried: Some(Carried {
            parent: 0,
            before: Translation3::from(shift).into(),
            range: (hinge.min, hinge.max),
            slide: Some(along),
            joint: joint(hinge, hinge.min, shift, Motion::Slide { along: along.map(|x| x as f32).into() }),
        }),
    }
}

/// Without the numbers of frames, which follow.
fn joint(hinge: &Hinge, start: f64, shift: Vector3<f64>, motion: Motion) -> Joint {
    // What is not there but for rounding costs nothing.
    let shift = shift.map(|x| if x.abs() < 1e-12 { 0.0 } else { x as f32 }).into();
    let (motor, low, gain) = (hinge.motor, hinge.limits.0, hinge.gain);
    Joint { frame: 0, parent: 0, motor, low, start, gain, shift, motion }
}
