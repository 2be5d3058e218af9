//! How far rounding can have moved what the lanes compute: worst cases, carried along the chain while it is compiled.
//!
//! With `u = 2^-24`, half a unit of `f32`, and every operation right to a relative `u`:
//!
//! * A turn multiplies two columns by `[c -s; s c]`. Sine and cosine together are wrong by `1.65 u` at most (constants by
//!   less), which is added to the rotation's error (spectral norm); the columns are sums of two products, which adds `(1 +
//!   sqrt(2)) sqrt(2) u = 3.4 u` where multiplying and adding rounds twice. Together 5.1 u; `TURN` = 6 u leaves room
//!   for products of errors. Right angles add nothing.
//! * A shift by `t` adds the rotation's error times `|t|`, and rounding of three sums no longer than `reach + |t|` and
//!   of three products: below `6 u (reach + |t|)`, where `reach` bounds how far the frame is from the world's origin.
//! * A solid is displaced by its center's error and, at its far end, by its axes' error times its size.
//! * The tests of `distance.rs` add less than `16 u` times the sizes of what they add up; `TESTS` is twice that.
//!
//! All of it is linear, so a chain of n hinges is wrong by about `n · 6 u` in rotation: 1e-5 m at the fingers of the
//! iCub. What was measured is a seventh of that (`tests.rs` holds each frame to its bound).

use nalgebra::Vector3;

/// Half a unit in the last place.
pub(crate) const U: f64 = 1.0 / 16_777_216.0;
/// A turn's share in the rotation's error.
const TURN: f64 = 6.0 * U;
/// Rounding of a shifted point, relative to the lengths that are added.
const SHIFT: f64 = 6.0 * U;
/// Rounding of a test of two solids, relative to their sizes and the clearance.
pub(crate) const TESTS: f64 = 32.0 * U;
/// How exact the reference is itself where it measures by iteration (pairs with a cylinder or box): twice its stated
/// 1e-6 m.
pub(crate) const REFERENCE: f64 = 2e-6;

/// What is known of a frame (or a point on it) in the lanes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bound {
    /// Error of the rotation, spectral norm.
    pub turn: f64,
    /// Error of the origin, meters.
    pub place: f64,
    /// How far the origin is from the world's at most, meters.
    pub reach: f64,
}

impl Bound {
    /// Of a frame whose numbers are only rounded.
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

    /// How far any point of a solid is displaced, meters: its center at `center` in the frame, and no point farther
    /// than `size` from that.
    pub fn solid(self, center: f64, size: f64) -> f64 {
        self.shifted(center).place + self.axes() * size
    }

    /// Error of a solid's axes, spectral norm.
    pub fn axes(self) -> f64 {
        2.0 * (self.turn + 2.0 * SHIFT)
    }
}
