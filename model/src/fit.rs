//! Simple shapes around the meshes of a link: together around every triangle, and nowhere far from the mesh.
//!
//! Always around and never within: a shape that is too large costs free space, one that is too small costs a robot.
//!
//! ```text
//! meshes ──soup──> triangles ──filled──> how far is a place outside the mesh
//!                      │                        │
//!                      └────────search: split the worst piece, enclose both sides, merge what fits────> primitives
//! ```
//!
//! * **Around**: triangles are clipped at the planes that part the pieces, and each piece is enclosed by a convex primitive. So
//!   the primitives contain all of the surface, and not only its vertices.
//! * **Near**: what counts is how far the surface of a primitive is from the mesh itself, its hollows filled ([`Fitted::overshoot`]).
//!   A piece that is too far out is split by the best of many planes, until the bound or the number of primitives is reached.
//!
//! parry's convex decomposition (VHACD) is not used: its parts approximate the mesh within voxels, so that holding every triangle
//! needs the clipped triangles all the same.

mod enclose;
mod filled;
mod piece;
mod probe;
mod search;
mod soup;

use crate::{Mesh, Primitive};
use enclose::Cover;

/// How near and how many.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// How far outside the mesh the primitives may be, meters.
    pub overshoot: f64,
    /// How many primitives a link may have.
    pub primitives: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { overshoot: 0.010, primitives: 12 }
    }
}

/// Primitives around the meshes of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// They contain every triangle, in the frame of the meshes.
    pub primitives: Vec<Primitive>,
    /// The largest distance of a point on their surfaces from the mesh, meters, measured at samples. Open rims count as closed,
    /// and places from which the mesh is seen in nearly all directions belong to it.
    pub overshoot: f64,
}

/// Boxes, capsules, spheres and cylinders that together contain every point of every triangle.
///
/// With as few of them as the bound needs. Where [`FitOptions::primitives`] do not suffice for it, the best that was found is
/// returned, and [`Fitted::overshoot`] exceeds the bound. Equal meshes give equal primitives.
///
/// # Arguments
/// * `meshes`: of one link, in its frame, meters. Flat ones get a thickness of a millimeter. Of very fine ones the details are
///   rounded to a grid, and the primitives are larger by what that can cost.
///
/// # Errors
/// The end of a sentence that begins with the link or mesh: no triangles, or coordinates that are no places.
///
/// # Example
/// ```
/// use mobee_model::{FitOptions, Mesh, fit_link};
/// use nalgebra::Vector3;
///
/// // A triangle is flat, so one thin box does.
/// let vertices = vec![Vector3::zeros(), Vector3::x(), Vector3::y()];
/// let mesh = Mesh { vertices, triangles: vec![[0, 1, 2]] };
/// let fitted = fit_link(&[mesh], &FitOptions { overshoot: 1.0, primitives: 12 })?;
/// assert_eq!(fitted.primitives.len(), 1);
/// # Ok::<(), String>(())
/// ```
pub fn fit_link(meshes: &[Mesh], options: &FitOptions) -> Result<Fitted, String> {
    let soup = soup::Soup::new(meshes)?;
    let filled = filled::Filled::new(&soup);
    let covers = search::cover(&soup, &filled, options);
    let covers: Vec<Cover> = covers.iter().map(|c| c.grown(soup.slack + ROUNDING)).collect();
    let mesh = filled.exact(&soup);
    let overshoot = covers.iter().map(|c| mesh.overshoot(c)).fold(0.0, f64::max);
    let primitives = covers.iter().map(|c| Primitive { shape: c.shape, pose: c.pose }).collect();
    Ok(Fitted { primitives, overshoot })
}

/// Covers what clipping and turning round off, meters: coordinates end at 10 km.
const ROUNDING: f64 = 1e-9;
