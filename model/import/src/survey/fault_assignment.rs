//! Assignment of fault in false contacts: which of the two shapes should leave which points.

use super::refit::{FalseContact, RefitState};
use crate::Fit;
use crate::fit::shared;
use mobee_model::Primitive;
use mobee_model::distances_from_hull;
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of claimed points of a shape: per contact, and in total.
const MAX_POINTS: (usize, usize) = (16, 200);
/// Distance from its mesh, meters, below which a shape can't be tightened.
const MIN_GAP_M: f64 = 2.5e-4;
/// A shape yields in addition to the other one if its distance from its mesh is at least this share of the other's.
const SHARED_FAULT: f64 = 0.5;
impl RefitState<'_> {
    /// The points that each of these shapes should leave, in its link's frame.
    pub(super) fn claims(
        &self,
        touches: &[FalseContact],
        of: &BTreeSet<(usize, usize)>,
    ) -> BTreeMap<(usize, usize), Vec<Vector3<f64>>> {
        let mut claims: BTreeMap<_, Vec<_>> = of.iter().map(|shape| (*shape, Vec::new())).collect();
        let mut frames = Vec::new();
        let mut placed = usize::MAX;
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
                Some(place) => {
                    self.common_points(touch.shapes, &a_from_b, &frames[a.0].inverse_transform_point(&place))
                }
                None => shared(shape(a), &other),
            };
            for place in places.iter().step_by(places.len().div_ceil(MAX_POINTS.0).max(1)) {
                let at = [*place, a_from_b.inverse_transform_point(&Point3::from(*place)).coords];
                for (shape, place) in self.at_fault(touch.shapes, at) {
                    if let Some(all) = claims.get_mut(&shape) {
                        all.push(place);
                    }
                }
            }
        }
        for places in claims.values_mut() {
            let step = places.len().div_ceil(MAX_POINTS.1).max(1);
            *places = places.iter().step_by(step).copied().collect();
        }
        claims
    }

    /// Points inside both of two shapes, of which at least one has a hull, in the frame of the first one's node: the
    /// points of either mesh that are inside the other shape; if there are none, the center of their intersection.
    fn common_points(
        &self,
        [a, b]: [(usize, usize); 2],
        a_from_b: &Isometry3<f64>,
        middle: &Point3<f64>,
    ) -> Vec<Vector3<f64>> {
        let points_inside = |one: (usize, usize), other: (usize, usize), other_from_one: &Isometry3<f64>| {
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
        let of_a = points_inside(a, b, &a_from_b.inverse());
        let of_a = of_a.into_iter().map(|p| a_from_b.transform_point(&Point3::from(p)).coords);
        let mut all: Vec<Vector3<f64>> = of_a.chain(points_inside(b, a, a_from_b)).collect();
        if all.is_empty() {
            all.push(middle.coords);
        }
        all
    }

    /// Assigns a point inside both shapes, given in the frames of both nodes, to the shapes that should leave it;
    /// returns it in the frame of each such shape's link.
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
        if gaps.iter().all(|gap| *gap < MIN_GAP_M) {
            // Deep in a hollow, or in the other shape: use the distance regardless of filled hollows.
            gaps = [0, 1].map(|k| measured(k, Fit::distance));
        }
        let gives = [0, 1].map(|k| {
            let own = gaps[k];
            let other = gaps[1 - k];
            own >= MIN_GAP_M && (own >= SHARED_FAULT * other || !self.can_refit(shapes[1 - k]))
        });
        let found = [0, 1].map(|k| place(k).filter(|_| gives[k]).map(|place| (shapes[k], place)));
        found.into_iter().flatten()
    }
}
