//! Robots as chains that the lanes can compute cheaply: choice of the computed frame of each moving body.
//!
//! A body's own frame F is given by its file. The lanes compute L = F·K instead, with a constant K chosen by the
//! compiler: z along the hinge that carries the body, and x so that the first hinge on the body is reached by one
//! rotation about x. This is Denavit and Hartenberg's convention; it saves most products of rotations.

use crate::bound::Bound;
use crate::program::{Bend, Joint, Motion};
use mobee_model::{Hinge, JointMotion, Skeleton};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// A frame in the lanes.
#[derive(Clone, Debug)]
pub(crate) struct LaneFrame {
    /// K, a rotation: the body's frame from this one.
    pub choice: UnitQuaternion<f64>,
    /// Its parent and joint, unless it is fixed.
    pub carried: Option<Carried>,
    /// Pose of a fixed frame: `world_from_lane`.
    pub fixed: Isometry3<f64>,
    /// Rounding error bounds.
    pub bound: Bound,
}

impl LaneFrame {
    /// The frame of the objects.
    pub fn world() -> Self {
        let choice = UnitQuaternion::identity();
        let fixed = Isometry3::identity();
        LaneFrame { choice, carried: None, fixed, bound: Bound::fixed(&Vector3::zeros()) }
    }
}

/// A frame that a joint carries.
#[derive(Clone, Debug)]
pub(crate) struct Carried {
    pub parent: usize,
    /// Constant transform between the parent and the joint.
    pub before: Isometry3<f64>,
    /// The motion's range, rad or meters.
    pub range: (f64, f64),
    /// Direction of a prismatic joint, in the parent's frame.
    pub slide: Option<Vector3<f64>>,
    pub joint: Joint,
}

/// The Euler angles of a rotation: `Rz(about_z) · Rx(about_x) · Rz(rest)`.
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
        // Parallel axes: a single rotation.
        let about_z = if sine < 1e-12 { 0.0 } else { z.x.atan2(-z.y) };
        // Computed from the remainder, so that it compensates where `about_z` is ill-conditioned.
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

/// A rotation that maps z to the axis.
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

/// Appends the frames of one robot; indices continue after the existing ones. Motors are numbered over the scene,
/// starting at `first_motor`.
pub(crate) fn follow(skeleton: &Skeleton, first_motor: usize, frames: &mut Vec<LaneFrame>) {
    let first = frames.len();
    // Rotation of each frame about its z with which its first hinge is reached without a rotation about z.
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

/// The frame of a hinge, rotated by `extra` about its own axis.
fn turning(parent: &LaneFrame, hinge: &Hinge, extra: f64) -> LaneFrame {
    let euler = Euler::of(&(parent.choice.inverse() * hinge.at.rotation * z_to(hinge)));
    let shift = parent.choice.inverse() * hinge.at.translation.vector;
    let about_z = Bend::by(euler.about_z);
    let about_x = Bend::by(euler.about_x);
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

/// The frame of a prismatic joint, which has its parent's axes.
fn sliding(parent: &LaneFrame, hinge: &Hinge) -> LaneFrame {
    let turned = parent.choice.inverse() * hinge.at.rotation;
    let shift = parent.choice.inverse() * hinge.at.translation.vector;
    let along = turned * *hinge.axis;
    let travel = hinge.min.abs().max(hinge.max.abs());
    LaneFrame {
        choice: turned.inverse(),
        bound: parent.bound.shifted(shift.norm()).shifted(travel).shifted(0.0),
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

/// The joint without the indices of frames, which are set later.
fn joint(hinge: &Hinge, start: f64, shift: Vector3<f64>, motion: Motion) -> Joint {
    // Components that are only rounding errors are set to zero, so that they cost nothing.
    let shift = shift.map(|x| if x.abs() < 1e-12 { 0.0 } else { x as f32 }).into();
    let motor = hinge.motor;
    let low = hinge.limits.0;
    let gain = hinge.gain;
    Joint { frame: 0, parent: 0, motor, low, start, gain, shift, motion }
}
