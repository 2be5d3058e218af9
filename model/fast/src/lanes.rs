//! Sixteen numbers at a time, one pose per lane: the few operations that the kernel uses.
//!
//! The kernel is one generic source. A [`Lanes`] is one register with [`Avx512`], two with [`Avx2`], and with
//! [`Portable`] an array that the compiler may vectorize. All perform the same operations in the same order; the
//! portable one rounds twice where the others use a fused multiply-add.

use std::ops::{Add, Mul, Sub};

/// Number of poses tested at once, on every machine.
pub(crate) const WIDTH: usize = 16;

/// One bit per lane.
pub(crate) type LaneMask = u16;

/// A number per lane, in memory.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct Row(pub [f32; WIDTH]);

/// As [`Row`], in double precision: joint positions, up to sine and cosine.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct WideRow(pub [f64; WIDTH]);

/// A number per lane, in registers.
///
/// Everything is inlined into a function that has the instructions enabled (`isa.rs`). Only there, behind the check of
/// the processor, are the kinds of lanes named; this makes the `unsafe` blocks below sound.
pub(crate) trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// True if fused multiply-add is an instruction; otherwise it would be a call.
    const FUSED: bool;
    /// The same number in all lanes.
    fn splat(x: f32) -> Self;
    /// Loads from memory.
    fn load(row: &Row) -> Self;
    /// Stores to memory.
    fn store(self, row: &mut Row);
    /// `self * a + b`.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// `b - self * a`.
    fn neg_mul_add(self, a: Self, b: Self) -> Self;
    /// Quotient.
    fn div(self, other: Self) -> Self;
    /// The smaller value.
    fn min(self, other: Self) -> Self;
    /// The greater value.
    fn max(self, other: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// The lanes in which it is less than the other; false for NaN.
    fn below(self, other: Self) -> LaneMask;
    /// Clamps to `-half ..= half`.
    #[inline(always)]
    fn clamp(self, half: Self) -> Self {
        self.min(half).max(Self::splat(0.0) - half)
    }
}

/// Lanes for any processor.
#[derive(Clone, Copy)]
pub(crate) struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn each(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut all = self.0;
        for i in 0..WIDTH {
            all[i] = f(all[i], other.0[i]);
        }
        Portable(all)
    }
}

impl Lanes for Portable {
    const FUSED: bool = false;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Portable([x; WIDTH])
    }
    #[inline(always)]
    fn load(row: &Row) -> Self {
        Portable(row.0)
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        row.0 = self.0;
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        b - self * a
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.each(other, |a, b| a / b)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.each(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.each(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.each(self, |x, _| x.abs())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.each(self, |x, _| x.sqrt())
    }
    #[inline(always)]
    fn below(self, other: Self) -> LaneMask {
        let mut bits = 0;
        for i in 0..WIDTH {
            bits |= LaneMask::from(self.0[i] < other.0[i]) << i;
        }
        bits
    }
}

/// Implements the operators, given their results.
macro_rules! operators {
    ($lanes:ty: |$a:ident, $b:ident| $add:expr, |$c:ident, $d:ident| $sub:expr, |$e:ident, $f:ident| $mul:expr) => {
        operators!($lanes, Add, add, $a, $b, $add);
        operators!($lanes, Sub, sub, $c, $d, $sub);
        operators!($lanes, Mul, mul, $e, $f, $mul);
    };
    ($lanes:ty, $operator:ident, $name:ident, $a:ident, $b:ident, $result:expr) => {
        impl $operator for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, $b: Self) -> Self {
                let $a = self;
                $result
            }
        }
    };
}

operators!(Portable: |a, b| a.each(b, |x, y| x + y), |a, b| a.each(b, |x, y| x - y), |a, b| a.each(b, |x, y| x * y));

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{LaneMask, Lanes, Row};
    use std::arch::x86_64::*;
    use std::ops::{Add, Mul, Sub};

    /// AVX2 with FMA: two registers.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2(__m256, __m256);

    /// AVX-512: one register.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512);

    /// Applies the instruction to both halves of its operands.
    macro_rules! halves {
        ($op:ident($($x:expr),+)) => {
            // SAFETY: only code behind the check for AVX2 and FMA has a value of this type (see `Lanes`).
            unsafe { Avx2($op($($x.0),+), $op($($x.1),+)) }
        };
    }

    impl Lanes for Avx2 {
        const FUSED: bool = true;
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see `Lanes`.
            let all = unsafe { _mm256_set1_ps(x) };
            Avx2(all, all)
        }
        #[inline(always)]
        fn load(row: &Row) -> Self {
            let from = row.0.as_ptr();
            // SAFETY: a row is sixteen floats, aligned to 64 bytes.
            unsafe { Avx2(_mm256_load_ps(from), _mm256_load_ps(from.add(8))) }
        }
        #[inline(always)]
        fn store(self, row: &mut Row) {
            let to = row.0.as_mut_ptr();
            // SAFETY: as for `load`.
            unsafe {
                _mm256_store_ps(to, self.0);
                _mm256_store_ps(to.add(8), self.1);
            }
        }
        #[inline(always)]
        fn mul_add(self, a: Self, b: Self) -> Self {
            halves!(_mm256_fmadd_ps(self, a, b))
        }
        #[inline(always)]
        fn neg_mul_add(self, a: Self, b: Self) -> Self {
            halves!(_mm256_fnmadd_ps(self, a, b))
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            halves!(_mm256_div_ps(self, other))
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            halves!(_mm256_min_ps(self, other))
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            halves!(_mm256_max_ps(self, other))
        }
        #[inline(always)]
        fn abs(self) -> Self {
            halves!(_mm256_andnot_ps(Self::splat(-0.0), self))
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            halves!(_mm256_sqrt_ps(self))
        }
        #[inline(always)]
        fn below(self, other: Self) -> LaneMask {
            // SAFETY: see `Lanes`.
            let (low, high) = unsafe {
                let (low, high) =
                    (_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0), _mm256_cmp_ps::<_CMP_LT_OQ>(self.1, other.1));
                (_mm256_movemask_ps(low), _mm256_movemask_ps(high))
            };
            low as LaneMask | ((high as LaneMask) << 8)
        }
    }

    operators!(Avx2: |a, b| halves!(_mm256_add_ps(a, b)), |a, b| halves!(_mm256_sub_ps(a, b)),
        |a, b| halves!(_mm256_mul_ps(a, b)));

    /// Applies the instruction to its operands.
    macro_rules! whole {
        ($op:ident($($x:expr),+)) => {
            // SAFETY: only code behind the check for AVX-512 has a value of this type (see `Lanes`).
            unsafe { Avx512($op($($x.0),+)) }
        };
    }

    impl Lanes for Avx512 {
        const FUSED: bool = true;
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see `Lanes`.
            Avx512(unsafe { _mm512_set1_ps(x) })
        }
        #[inline(always)]
        fn load(row: &Row) -> Self {
            // SAFETY: a row is sixteen floats, aligned to 64 bytes.
            Avx512(unsafe { _mm512_load_ps(row.0.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, row: &mut Row) {
            // SAFETY: as for `load`.
            unsafe { _mm512_store_ps(row.0.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn mul_add(self, a: Self, b: Self) -> Self {
            whole!(_mm512_fmadd_ps(self, a, b))
        }
        #[inline(always)]
        fn neg_mul_add(self, a: Self, b: Self) -> Self {
            whole!(_mm512_fnmadd_ps(self, a, b))
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            whole!(_mm512_div_ps(self, other))
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            whole!(_mm512_min_ps(self, other))
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            whole!(_mm512_max_ps(self, other))
        }
        #[inline(always)]
        fn abs(self) -> Self {
            whole!(_mm512_abs_ps(self))
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            whole!(_mm512_sqrt_ps(self))
        }
        #[inline(always)]
        fn below(self, other: Self) -> LaneMask {
            // SAFETY: see `Lanes`.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
        }
    }

    operators!(Avx512: |a, b| whole!(_mm512_add_ps(a, b)), |a, b| whole!(_mm512_sub_ps(a, b)),
        |a, b| whole!(_mm512_mul_ps(a, b)));
}
