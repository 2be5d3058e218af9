//! Three-dimensional vectors, sixteen at a time.

use crate::lanes::{Lanes, Row};

/// Three rows: a vector per lane, in memory.
pub(crate) type Rows3 = [Row; 3];

/// A vector per lane.
#[derive(Clone, Copy)]
pub(crate) struct LaneVector<L> {
    pub x: L,
    pub y: L,
    pub z: L,
}

impl<L: Lanes> LaneVector<L> {
    #[inline(always)]
    pub fn load(rows: &Rows3) -> Self {
        LaneVector { x: L::load(&rows[0]), y: L::load(&rows[1]), z: L::load(&rows[2]) }
    }

    #[inline(always)]
    pub fn store(self, rows: &mut Rows3) {
        self.x.store(&mut rows[0]);
        self.y.store(&mut rows[1]);
        self.z.store(&mut rows[2]);
    }

    #[inline(always)]
    pub fn minus(self, o: Self) -> Self {
        LaneVector { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }

    #[inline(always)]
    pub fn plus(self, o: Self) -> Self {
        LaneVector { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }

    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        LaneVector {
            x: self.z.neg_mul_add(o.y, self.y * o.z),
            y: self.x.neg_mul_add(o.z, self.z * o.x),
            z: self.y.neg_mul_add(o.x, self.x * o.y),
        }
    }

    #[inline(always)]
    pub fn negated(self) -> Self {
        let zero = L::splat(0.0);
        LaneVector { x: zero - self.x, y: zero - self.y, z: zero - self.z }
    }

    #[inline(always)]
    pub fn times(self, t: L) -> Self {
        LaneVector { x: self.x * t, y: self.y * t, z: self.z * t }
    }

    /// `self + direction * t`.
    #[inline(always)]
    pub fn along(self, direction: Self, t: L) -> Self {
        LaneVector {
            x: direction.x.mul_add(t, self.x),
            y: direction.y.mul_add(t, self.y),
            z: direction.z.mul_add(t, self.z),
        }
    }

    /// `self - direction * t`.
    #[inline(always)]
    pub fn against(self, direction: Self, t: L) -> Self {
        LaneVector {
            x: direction.x.neg_mul_add(t, self.x),
            y: direction.y.neg_mul_add(t, self.y),
            z: direction.z.neg_mul_add(t, self.z),
        }
    }

    #[inline(always)]
    pub fn dot(self, o: Self) -> L {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }

    #[inline(always)]
    pub fn squared(self) -> L {
        self.dot(self)
    }
}
