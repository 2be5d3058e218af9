//! Hulls for shapes that can't be fitted close enough.
//!
//! Shapes have few kinds, and two parts that pass each other within millimeters need hundreds of them, each tested against all of the
//! other's. The hull of what a shape encloses is as near to the mesh as anything convex can be, and it is looked at only where
//! the shapes themselves are not apart.

use super::closer::{Touch, Work};
use crate::{SceneError, Surfaces};
use std::collections::BTreeSet;

impl Work<'_> {
    /// Gives hulls to the links whose shapes touch falsely, and lets hulls give way as long as that leads anywhere and more poses than
    /// this are left.
    ///
    /// # Returns
    /// How many are left.
    pub(super) fn with_hulls(&mut self, surfaces: &Surfaces, enough: usize) -> Result<usize, SceneError> {
        loop {
            let touches = self.look(surfaces)?;
            let left = self.falsely.len();
            if left <= enough || !(self.give_hulls(&touches) || self.give_way(&touches)) {
                return Ok(left);
            }
        }
    }

    /// Gives hulls to all shapes of every link of which any touches falsely; answers whether there was one without.
    fn give_hulls(&mut self, touches: &[Touch]) -> bool {
        let nodes: BTreeSet<usize> = touches.iter().flat_map(|t| t.shapes).map(|(node, _)| node).collect();
        let mut gave = false;
        for node in nodes {
            let Some(link) = self.links.get(&node) else { continue };
            let (Some(fit), of) = (self.fits.get_mut(&link.link), &mut self.robot.nodes[node]) else { continue };
            if of.hulls.is_empty() {
                fit.hull_all();
                of.solids = link.shapes(Some(fit));
                of.hulls = link.hulls(fit);
                gave = true;
            }
        }
        gave
    }
}
