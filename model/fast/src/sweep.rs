//! Balls that contain a shape at every pose: they prove that a pair can never meet, and determine if a hand can be
//! skipped.

use crate::chain::{Carried, LaneFrame};
use nalgebra::{Isometry3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// A ball in some frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sphere {
    pub center: Vector3<f64>,
    pub radius: f64,
}

impl Sphere {
    /// A small ball around balls: the center moves toward the farthest one in decreasing steps (Bădoiu and Clarkson).
    pub fn around(balls: &[Sphere]) -> Sphere {
        let Some(first) = balls.first() else { return Sphere { center: Vector3::zeros(), radius: 0.0 } };
        if balls.len() == 1 {
            return *first;
        }
        let mut center = first.center;
        let reach = |center: &Vector3<f64>, ball: &Sphere| (ball.center - center).norm() + ball.radius;
        for step in 1..=200 {
            let mut far = first;
            let mut most = f64::NEG_INFINITY;
            for ball in balls {
                let reach = reach(&center, ball);
                if reach > most {
                    far = ball;
                    most = reach;
                }
            }
            let offset = far.center - center;
            let toward = offset + offset.try_normalize(1e-12).unwrap_or_default() * far.radius;
            center += toward / (f64::from(step) + 1.0);
        }
        let radius = |center: &Vector3<f64>| balls.iter().map(|b| reach(center, b)).fold(0.0, f64::max);
        // For one dominant ball the exact result is that ball, which the steps only approach.
        if radius(&first.center) <= radius(&center) {
            center = first.center
        };
        Sphere { center, radius: radius(&center) }
    }

    pub fn moved(self, by: &Isometry3<f64>) -> Sphere {
        Sphere { center: by.transform_point(&self.center.into()).coords, ..self }
    }

    /// The positions it can have in the frame that carries its own, an arc or a segment, enclosed by a ball.
    pub fn carried(self, by: &Carried) -> Sphere {
        let (low, high) = by.range;
        let middle = (low + high) / 2.0;
        let half = (high - low) / 2.0;
        match by.slide {
            Some(along) => Sphere { center: self.center + along * middle, radius: self.radius + half },
            None => {
                let c = self.center;
                let off_axis = self.center.xy().norm();
                let toward = c.y.atan2(c.x) + middle;
                // The ball around an arc of less than half a circle is centered on its chord.
                let (out, more) = if half < FRAC_PI_2 { (half.cos(), half.sin()) } else { (0.0, 1.0) };
                let center = Vector3::new(toward.cos() * off_axis * out, toward.sin() * off_axis * out, c.z);
                Sphere { center, radius: self.radius + off_axis * more }
            }
        }
        .moved(&by.before)
    }

    /// Ball around its possible positions in frame `to`, which carries its own frame `from`, or is equal to it.
    pub fn swept(self, frames: &[LaneFrame], from: usize, to: usize) -> Sphere {
        let mut ball = self;
        let mut at = from;
        while at != to {
            let Some(carried) = frames[at].carried.as_ref() else { break };
            ball = ball.carried(carried);
            at = carried.parent;
        }
        ball
    }
}

/// The frames from `frame` to the base that carries it, both included.
pub(crate) fn above(frames: &[LaneFrame], frame: usize) -> impl Iterator<Item = usize> + '_ {
    std::iter::successors(Some(frame), |f| frames[*f].carried.as_ref().map(|c| c.parent))
}

/// The nearest frame that carries both, if any does.
pub(crate) fn common(frames: &[LaneFrame], a: usize, b: usize) -> Option<usize> {
    above(frames, a).find(|f| above(frames, b).any(|g| g == *f))
}

/// Ball around the possible positions of a frame's ball in the world.
pub(crate) fn in_world(frames: &[LaneFrame], frame: usize, ball: Sphere) -> Sphere {
    let base = above(frames, frame).last().unwrap_or(frame);
    ball.swept(frames, frame, base).moved(&frames[base].fixed)
}

/// Lower bound of the distance of two balls at every pose, meters.
pub(crate) fn least_distance(frames: &[LaneFrame], a: (usize, Sphere), b: (usize, Sphere)) -> f64 {
    let world = |(frame, ball): (usize, Sphere)| in_world(frames, frame, ball);
    let (p, q) = match common(frames, a.0, b.0) {
        Some(common) => (a.1.swept(frames, a.0, common), b.1.swept(frames, b.0, common)),
        None => (world(a), world(b)),
    };
    (p.center - q.center).norm() - p.radius - q.radius
}
