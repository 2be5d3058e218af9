//! Hulls for shapes that can't be fitted close enough.
//!
//! There are few kinds of shapes, and two parts that pass each other within millimeters would need hundreds of them,
//! each tested against all of the other's. The hull of the enclosed part of the mesh is the tightest convex shape, and
//! it is tested only if the shapes themselves are not apart.

use super::refit::{FalseContact, RefitState};
use crate::Surfaces;
use mobee_model::SceneError;
use std::collections::BTreeSet;

impl RefitState<'_> {
    /// Adds hulls to the links whose shapes have false contacts, and splits hulls while that helps and more than
    /// `enough` poses remain.
    ///
    /// # Returns
    /// Number of remaining poses.
    pub(super) fn with_hulls(&mut self, surfaces: &Surfaces, enough: usize) -> Result<usize, SceneError> {
        loop {
            let touches = self.find_touches(surfaces)?;
            let left = self.falsely.len();
            if left <= enough || !(self.add_hulls(&touches) || self.refit_worst(&touches)) {
                return Ok(left);
            }
        }
    }

    /// Adds hulls to all shapes of every link with a false contact; returns false if all had hulls already.
    fn add_hulls(&mut self, touches: &[FalseContact]) -> bool {
        let nodes: BTreeSet<usize> = touches.iter().flat_map(|t| t.shapes).map(|(node, _)| node).collect();
        let mut changed = false;
        for node in nodes {
            let Some(link) = self.links.get(&node) else { continue };
            let (Some(fit), target) = (self.fits.get_mut(&link.link), &mut self.robot.nodes[node]) else { continue };
            if target.hulls.is_empty() {
                fit.hull_all();
                target.solids = link.shapes(Some(fit));
                target.hulls = link.hulls(fit);
                changed = true;
            }
        }
        changed
    }
}
