//! How far shapes can move when motors do: Lipschitz bounds.
//!
//! A point at most `r` from a joint's axis moves at most `r` times the angle turned. `r` is bounded over all poses of the
//! joints between, so that between any two poses no point of a shape moves farther, relative to another shape, than the sum
//! over the motors between the two of `coefficient * |change of motor|`. The signed distance of the two changes no more than that.

use super::Skeleton;
use super::bodies::Solid;
use std::collections::BTreeMap;

/// Terms (motor index among all motors of the scene, metres per radian of encoder).
pub(crate) type Terms = Vec<(u32, f64)>;

/// Per frame of one robot: how far its shapes move in the robot's base, hinge by hinge from the frame up.
#[derive(Clone, Debug, Default)]
pub(crate) struct Reach {
    /// Per frame: (frame of the hinge, metres per radian of its motor).
    pub hinges: Vec<Vec<(usize, f64)>>,
}

impl Reach {
    /// `solids` are those of this robot, whose frames are numbered from `first_frame`.
    pub fn new(skeleton: &Skeleton, first_frame: usize, solids: &[Solid]) -> Self {
        let hinges = (0..skeleton.frames())
            .map(|f| {
                let Some(own) = f.checked_sub(1).and_then(|h| skeleton.joints.get(h)) else { return Vec::new() };
                // Greatest distance of the frame's points from its hinge's axis, and from its origin.
                let (mut off_axis, mut rho) = (0.0_f64, 0.0_f64);
                let off = |v: &nalgebra::Vector3<f64>, axis: &nalgebra::Vector3<f64>| (v - axis * v.dot(axis)).norm();
                for s in solids.iter().filter(|s| s.frame == first_frame + f) {
                    let c = s.pose.translation.vector;
                    let (ends, radius) = ([c + s.axis, c - s.axis], s.form.outer.1);
                    let far = |v: f64, w: f64, ball: f64| (v.max(w) + radius).min(ball + s.form.ball);
                    off_axis =
                        off_axis.max(far(off(&ends[0], &own.axis), off(&ends[1], &own.axis), off(&c, &own.axis)));
                    rho = rho.max(far(ends[0].norm(), ends[1].norm(), c.norm()));
                }
                for (_, at) in skeleton.frame.iter().zip(&skeleton.in_frame).filter(|(frame, _)| **frame == f) {
                    off_axis = off_axis.max(off(&at.translation.vector, &own.axis));
                    rho = rho.max(at.translation.vector.norm());
                }
                let mut list = vec![(f, off_axis * own.gain.abs())];
                let mut at = f;
                loop {
                    let below = &skeleton.joints[at - 1];
                    let parent = below.parent;
                    if parent == 0 {
                        break list;
                    }
                    let (hinge, offset) = (&skeleton.joints[parent - 1], below.at.translation.vector);
                    list.push((parent, (off(&offset, &hinge.axis) + rho) * hinge.gain.abs()));
                    rho += offset.norm();
                    at = parent;
                }
            })
            .collect();
        Reach { hinges }
    }

    /// How far the shapes of frame `a` move against those of frame `b` of the same robot; `b = 0` is the base.
    pub fn between(&self, skeleton: &Skeleton, first_motor: usize, a: usize, b: usize) -> Terms {
        let mut sums = BTreeMap::<u32, f64>::new();
        for (one, other) in [(a, b), (b, a)] {
            let shared: Vec<usize> = self.hinges[other].iter().map(|(f, _)| *f).collect();
            for (frame, metres) in self.hinges[one].iter().filter(|(f, _)| !shared.contains(f)) {
                let motor = first_motor + skeleton.joints[frame - 1].motor;
                *sums.entry(motor as u32).or_default() += metres;
            }
        }
        sums.into_iter().collect()
    }
}
