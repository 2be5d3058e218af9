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

//!
//! A fit can be brought nearer where it is known to be in the way ([`Fit::yield_to`]): the shape that is gives way to places that
//! should be free, if need be by two in its stead, and all others stay.

mod enclose;
mod filled;
mod hulling;
mod piece;
mod probe;
mod search;
mod soup;
mod yielding;

use crate::{Mesh, Primitive};
use enclose::Cover;
pub(crate) use hulling::rounded;
pub(crate) use yielding::shared;

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
    let fit = Fit::new(meshes, options)?;
    Ok(Fitted { primitives: fit.primitives(), overshoot: fit.overshoot() })
}

/// Primitives around the meshes of a link, with all that it takes to bring them nearer.
#[derive(Clone, Debug)]
pub struct Fit {
    /// How far a place is outside the mesh, about.
    filled: filled::Filled,
    /// The same exactly.
    exact: filled::Exact,
    /// What each primitive encloses.
    pieces: Vec<piece::Piece>,
    /// By how much the primitives are larger than what encloses the pieces, meters.
    slack: f64,
}

impl Fit {
    /// Fits primitives to meshes as [`fit_link`] does.
    ///
    /// # Errors
    /// As [`fit_link`].
    pub fn new(meshes: &[Mesh], options: &FitOptions) -> Result<Self, String> {
        let soup = soup::Soup::new(meshes)?;
        let filled = filled::Filled::new(&soup);
        let pieces = search::cover(&soup, &filled, options);
        Ok(Self { exact: filled::Exact::new(&soup), filled, pieces, slack: soup.slack + ROUNDING })
    }

    /// They contain every triangle, in the frame of the meshes.
    pub fn primitives(&self) -> Vec<Primitive> {
        self.covers().map(|c| Primitive { shape: c.shape, pose: c.pose }).collect()
    }

    /// See [`Fitted::overshoot`].
    pub fn overshoot(&self) -> f64 {
        self.covers().map(|c| self.exact.overshoot(&c, &self.filled)).fold(0.0, f64::max)
    }

    /// The shapes as they are given away.
    fn covers(&self) -> impl Iterator<Item = Cover> + '_ {
        // a hull is larger by its radius than what it is around, and is rounded
        let beyond = |p: &piece::Piece| p.hull.as_ref().map_or(self.slack, |hull| hull.radius() + hulling::ROUNDED);
        self.pieces.iter().map(move |p| p.tried.cover.grown(beyond(p)))
    }
}

/// Covers what clipping and turning round off, meters: coordinates end at 10 km.
const ROUNDING: f64 = 1e-9;
