//! Which of two shapes that touch falsely should leave which places.

use super::closer::{Touch, Work};
use crate::engine::distances_from_hull;
use crate::fit::shared;
use crate::{Fit, Primitive};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// No more places than this are claimed of a shape: so many of each contact, so many of all.
const PLACES: (usize, usize) = (16, 200);
/// Where it is nearer to its mesh than this, a shape has nothing to give, meters.
const CLOSE: f64 = 2.5e-4;
/// A shape also gives what the other could give rather, if its distance from its mesh is not less than this share of the other's.
const SHARED_FAULT: f64 = 0.5;
impl Work<'_> {
    /// The places that each of these shapes should leave, in its link's frame.
    pub(super) fn claims(
        &self,
        touches: &[Touch],
        of: &BTreeSet<(usize, usize)>,
    ) -> BTreeMap<(usize, usize), Vec<Vector3<f64>>> {
        let mut claims: BTreeMap<_, Vec<_>> = of.iter().map(|shape| (*shape, Vec::new())).collect();
        let (mut frames, mut placed) = (Vec::new(), usize::MAX);
        for touch in touches.iter().filter(|t| t.shapes.iter().any(|s| of.contains(s))) {
            if placed != touch.pose {
                self.robot.forward(&self.falsely[touch.pose].q, &mut frames);
                placed = touch.pose;
            }
            let [a, b] = touch.shapes;
            let a_from_b = frames[a.0].inv_mul(&frames[b.0]);
            let shape = |(node, shape): (usize, usize)| &self.robot.nodes[node].solids[shape];
            let other = Primitive { pose: a_from_b * shape(b).pose, ..shape(b).clone() };
            let places = match touch.place {
                Some(place) => self.held(touch.shapes, &a_from_b, &frames[a.0].inverse_transform_point(&place)),
                None => shared(shape(a), &other),
            };
            for place in places.iter().step_by(places.len().div_ceil(PLACES.0).max(1)) {
                let at = [*place, a_from_b.inverse_transform_point(&Point3::from(*place)).coords];
                for (shape, place) in self.at_fault(touch.shapes, at) {
                    if let Some(all) = claims.get_mut(&shape) {
                        all.push(place);
                    }
                }
            }
        }
        for places in claims.values_mut() {
            let step = places.len().div_ceil(PLACES.1).max(1);
            *places = places.iter().step_by(step).copied().collect();
        }
        claims
    }

    /// Places that both of two shapes hold, of which one at least has a hull, in the frame of the first one's node: what of the mesh of
    /// either the other holds; if that is nothing, the middle of what they have in common.
    fn held(&self, [a, b]: [(usize, usize); 2], a_from_b: &Isometry3<f64>, middle: &Point3<f64>) -> Vec<Vector3<f64>> {
        let of = |one: (usize, usize), other: (usize, usize), other_from_one: &Isometry3<f64>| {
            let Some((link, number)) = self.fitted(one) else { return Vec::new() };
            let node = &self.robot.nodes[other.0];
            let within = |p: &Vector3<f64>| {
                let place = node.solids[other.1].pose.inverse_transform_point(&Point3::from(*p));
                node.solids[other.1].shape.depth(&place.coords) >= 0.0
            };
            let points = self.fits[&link.link].points(number);
            let places = points.map(|p| other_from_one.transform_point(&Point3::from(link.turn * p)).coords);
            let places: Vec<_> = places.filter(within).collect();
            match node.hulls.get(&other.1) {
                None => places,
                Some(hull) => {
                    let points: Vec<_> = hull.points().iter().map(|p| p.coords).collect();
                    let far = distances_from_hull(&points, &places);
                    places.iter().zip(far).filter(|(_, far)| *far <= hull.radius()).map(|(p, _)| *p).collect()
                }
            }
        };
        let of_a = of(a, b, &a_from_b.inverse());
        let of_a = of_a.into_iter().map(|p| a_from_b.transform_point(&Point3::from(p)).coords);
        let mut all: Vec<Vector3<f64>> = of_a.chain(of(b, a, a_from_b)).collect();
        if all.is_empty() {
            all.push(middle.coords);
        }
        all
    }

    /// Which of two shapes should leave a place that both hold, given in the frame of either's node; answered in its link's.
    fn at_fault(
        &self,
        shapes: [(usize, usize); 2],
        at: [Vector3<f64>; 2],
    ) -> impl Iterator<Item = ((usize, usize), Vector3<f64>)> {
        let place = |k: usize| self.links.get(&shapes[k].0).map(|l| l.turn.inverse_transform_vector(&at[k]));
        let measured = |k: usize, far: fn(&Fit, &Vector3<f64>) -> f64| {
            let fit = self.fitted(shapes[k]).map(|(link, _)| &self.fits[&link.link]);
            fit.zip(place(k)).map_or(0.0, |(fit, place)| far(fit, &place))
        };
        let mut gaps = [0, 1].map(|k| measured(k, Fit::gap));
        if gaps.iter().all(|gap| *gap < CLOSE) {
            // deep in a hollow, or in the other: no matter what counts as filled
            gaps = [0, 1].map(|k| measured(k, Fit::distance));
        }
        let gives = [0, 1].map(|k| {
            let (own, other) = (gaps[k], gaps[1 - k]);
            own >= CLOSE && (own >= SHARED_FAULT * other || !self.can_give(shapes[1 - k]))
        });
        let found = [0, 1].map(|k| place(k).filter(|_| gives[k]).map(|place| (shapes[k], place)));
        found.into_iter().flatten()
    }
}
