//! Worst-case bounds of rounding errors in the lanes, propagated along the chain during compilation.
//!
//! With `u = 2^-24`, half a unit of `f32`, and every operation exact to a relative `u`:
//!
//! * A rotation multiplies two columns by `[c -s; s c]`. The error of sine and cosine together is at most `1.65 u` (of
//!   constants less), which is added to the rotation's error (spectral norm). The columns are sums of two products,
//!   which adds `(1 + sqrt(2)) sqrt(2) u = 3.4 u` without fused multiply-add. Together 5.1 u; `TURN` = 6 u leaves a
//!   reserve for products of errors. Right angles add nothing.
//! * A shift by `t` adds the rotation's error times `|t|`, and the rounding of three sums no longer than `reach + |t|`
//!   and of three products: below `6 u (reach + |t|)`, where `reach` bounds the distance of the frame from the world's
//!   origin.
//! * The displacement of a solid is its center's error plus, at its far end, its axes' error times its size.
//! * The tests of `distance.rs` add less than `16 u` times the sizes of the summands; `TESTS` is twice that.
//!
//! All terms are linear, so the rotation error of a chain of n hinges is about `n · 6 u`: 1e-5 m at the fingers of the
//! iCub. The measured error is a seventh of that (`tests.rs` compares each frame with its bound).

use nalgebra::Vector3;

/// Half a unit in the last place.
pub(crate) const U: f64 = 1.0 / 16_777_216.0;
/// Contribution of a rotation to the rotation's error.
const TURN: f64 = 6.0 * U;
/// Rounding of a shifted point, relative to the sum of the lengths.
const SHIFT: f64 = 6.0 * U;
/// Rounding of a test of two solids, relative to their sizes and the clearance.
pub(crate) const TESTS: f64 = 32.0 * U;
/// Accuracy of the reference for pairs that it measures by iteration (with a cylinder or box), meters: twice the stated
/// 1e-6 m.
pub(crate) const REFERENCE: f64 = 2e-6;

/// Error bounds of a frame (or a point on it) in the lanes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bound {
    /// Error of the rotation, spectral norm.
    pub turn: f64,
    /// Error of the origin, meters.
    pub place: f64,
    /// Maximum distance of the origin from the world's, meters.
    pub reach: f64,
}

impl Bound {
    /// Bound of a fixed frame, of which the numbers are only rounded.
    pub fn fixed(origin: &Vector3<f64>) -> Self {
        Bound { turn: 3.0 * U, place: 2.0 * U * origin.norm(), reach: origin.norm() }
    }

    pub fn turned(self) -> Self {
        Bound { turn: self.turn + TURN, ..self }
    }

    pub fn shifted(self, by: f64) -> Self {
        let reach = self.reach + by;
        Bound { place: self.place + self.turn * by + SHIFT * reach, reach, ..self }
    }

    /// Bound of the displacement of any point of a solid, meters: its center is at distance `center` from the frame's
    /// origin, and no point is farther than `size` from the center.
    pub fn solid(self, center: f64, size: f64) -> f64 {
        self.shifted(center).place + self.axes() * size
    }

    /// Error of a solid's axes, spectral norm.
    pub fn axes(self) -> f64 {
        2.0 * (self.turn + 2.0 * SHIFT)
    }
}
