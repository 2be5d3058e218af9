//! Simple shapes around the meshes of a link: together they contain every triangle, and none extends far from the mesh.
//!
//! Always an outer approximation: a shape that is too large costs free space, one that is too small costs a robot.
//!
//! ```text
//! meshes ──soup──> triangles ──filled──> distance of a point outside the mesh
//!                      │                        │
//!                      └────────search: split the worst piece, enclose both sides, merge what fits────> primitives
//! ```
//!
//! * **Containment**: triangles are clipped at the planes that separate the pieces, and each piece is enclosed by a
//!   convex primitive. So the primitives contain the complete surface, not only its vertices.
//! * **Tightness**: the measure is the distance between the surface of a primitive and the mesh with its hollows filled
//!   ([`Fitted::overshoot`]). A piece above the bound is split by the best of many planes, until the bound or the
//!   number of primitives is reached.
//!
//! parry's convex decomposition (VHACD) is not used: its parts approximate the mesh to within voxels, so that
//! containing every triangle requires the clipped triangles anyway.
//!
//! A fit can be tightened where it is known to block free space ([`Fit::yield_to`]): the blocking shape is refitted
//! around points that should be free, if necessary as two shapes; all other shapes are unchanged.

mod enclose;
mod filled;
mod piece;
mod piece_hulls;
mod probe;
mod search;
mod soup;
mod tightening;

use enclose::Cover;
use mobee_model::{Mesh, Primitive};
pub(crate) use piece_hulls::rounded;
pub(crate) use tightening::shared;

/// Limits of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Maximum distance of the primitives' surfaces outside the mesh, meters. Default: 0.010.
    pub overshoot: f64,
    /// Maximum number of primitives per link. Default: 12.
    pub primitives: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { overshoot: 0.010, primitives: 12 }
    }
}

/// Primitives around the meshes of a link, and their accuracy.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The primitives, in the frame of the meshes. Together they contain every triangle.
    pub primitives: Vec<Primitive>,
    /// The largest distance of a point on their surfaces from the mesh, meters, measured at samples. Open rims count as
    /// closed, and points from which the mesh is visible in nearly all directions belong to the mesh.
    pub overshoot: f64,
}

/// Fits boxes, capsules, spheres and cylinders that together contain every point of every triangle.
///
/// Uses as few as the bound needs. If [`FitOptions::primitives`] are not enough for the bound, the best fit found is
/// returned, and [`Fitted::overshoot`] exceeds the bound. Equal meshes give equal primitives.
/// # Arguments
/// * `meshes`: of one link, in its frame, meters. Flat ones get a thickness of a millimeter. Details of very fine ones
///   are rounded to a grid, and the primitives are enlarged by the maximum rounding error.
///
/// # Errors
/// The end of a sentence that begins with the link or mesh: no triangles, or coordinates that are not finite or out of
/// range.
///
/// # Example
/// ```
/// use mobee_import::{FitOptions, fit_link};
/// use mobee_model::Mesh;
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

/// A fit of primitives to the meshes of a link, with the data needed to tighten it later.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Approximate distance of a point outside the mesh.
    filled: filled::Filled,
    /// Exact distance of a point outside the mesh.
    exact: filled::Exact,
    /// The enclosed piece of each primitive.
    pieces: Vec<piece::Piece>,
    /// Margin by which the primitives are larger than the covers of the pieces, meters.
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
        Ok(Self { exact: filled::Exact::new(&soup), filled, pieces, slack: soup.slack + ROUNDING_M })
    }

    /// The primitives, in the frame of the meshes. Together they contain every triangle.
    pub fn primitives(&self) -> Vec<Primitive> {
        self.covers().map(|c| Primitive { shape: c.shape, pose: c.pose }).collect()
    }

    /// The largest distance of the primitives' surfaces from the mesh, meters; see [`Fitted::overshoot`].
    pub fn overshoot(&self) -> f64 {
        self.covers().map(|c| self.exact.overshoot(&c, &self.filled)).fold(0.0, f64::max)
    }

    /// The covers of all pieces, enlarged by their margins.
    fn covers(&self) -> impl Iterator<Item = Cover> + '_ {
        // A hull is larger by its radius than the points it encloses, and is rounded.
        let beyond =
            |p: &piece::Piece| p.hull.as_ref().map_or(self.slack, |hull| hull.radius() + piece_hulls::ROUNDING_M);
        self.pieces.iter().map(move |p| p.fit.cover.grown(beyond(p)))
    }
}

/// Margin for rounding in clipping and rotation, meters: coordinates are limited to 10 km.
const ROUNDING_M: f64 = 1e-9;
