//! Logarithm and exponential of every pixel, in arithmetic that compiles to vector instructions:
//! library functions are called for one pixel at a time. Relative error: a few millionths.

use std::f32::consts::LOG2_E;

/// Added and subtracted again, it rounds to an integer, which is then in the lowest bits.
const ROUNDING_OFFSET: f32 = 12_582_912.0;
/// Bits of the square root of 1/2: a mantissa is between that and twice that.
const SQRT_HALF_BITS: u32 = 0x3f35_04f3;

/// Returns an integer near `x` and 2 to the power of the remainder: a Taylor series, its
/// coefficients adjusted for the least error between -1/2 and 1/2 (Cephes).
#[inline(always)]
fn parted(x: f32) -> (i32, f32) {
    let shifted = x + ROUNDING_OFFSET;
    let part = x - (shifted - ROUNDING_OFFSET);
    let mut sum = 1.535_336_2e-4;
    for term in [1.339_887_4e-3, 9.618_437e-3, 5.550_332_5e-2, 2.402_264_8e-1, 6.931_472e-1, 1.0] {
        sum = sum * part + term;
    }
    (shifted.to_bits().wrapping_sub(ROUNDING_OFFSET.to_bits()) as i32, sum)
}

/// Returns 2 to the power of an integer from -126 to 127.
#[inline(always)]
fn two_to(n: i32) -> f32 {
    f32::from_bits((n.wrapping_add(127) as u32) << 23)
}

/// Returns 2 to the power of `x`: infinite from 128 on, and 0 if the result would underflow.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    let (whole, sum) = parted(x.clamp(-160.0, 128.0));
    // In two steps: 2 to the power of `whole` may underflow or overflow.
    let half = whole >> 1;
    sum * two_to(half) * two_to(whole.wrapping_sub(half))
}

/// Returns e to the power of `x`.
#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    exp2(x * LOG2_E)
}

/// Returns e to the power of `x`, for `x` from -87 to 88.
#[inline(always)]
pub(super) fn exp_near(x: f32) -> f32 {
    let (whole, sum) = parted(x * LOG2_E);
    sum * two_to(whole)
}

/// Rounds `x` down to an integer, for `x` from 0 to 1e6.
#[inline(always)]
pub(super) fn floor(x: f32) -> f32 {
    let near = (x + ROUNDING_OFFSET) - ROUNDING_OFFSET;
    if near > x { near - 1.0 } else { near }
}

/// Returns the natural logarithm: minus infinity for 0, NaN below.
#[inline(always)]
pub(super) fn ln(x: f32) -> f32 {
    // Normalize subnormal numbers.
    let is_subnormal = x < f32::MIN_POSITIVE;
    let whole = if is_subnormal { x * 8_388_608.0 } else { x };
    let shift = if is_subnormal { -23.0 } else { 0.0 };
    let bits = whole.to_bits().wrapping_sub(SQRT_HALF_BITS);
    let exponent = ((bits as i32) >> 23) as f32 + shift;
    let part = f32::from_bits((bits & 0x007f_ffff).wrapping_add(SQRT_HALF_BITS)) - 1.0;
    let square = part * part;
    let mut sum = 7.037_684e-2;
    for term in [
        -1.151_461e-1,
        1.167_699_9e-1,
        -1.242_014_1e-1,
        1.424_932_3e-1,
        -1.666_805_8e-1,
        2.000_071_5e-1,
        -2.5e-1,
        3.333_333e-1,
    ] {
        sum = sum * part + term;
    }
    // ln 2 in two parts; the product of the first with any exponent is exact.
    let low = part * square * sum + exponent * -2.121_944_4e-4 - 0.5 * square;
    let out = part + low + exponent * 0.693_359_4;
    if x > 0.0 {
        out
    } else if x == 0.0 {
        f32::NEG_INFINITY
    } else {
        f32::NAN
    }
}

/// Returns the sign of a negative number to the power of `p`; NaN if `p` is not an integer.
pub(super) fn sign_of_power(p: f32) -> f32 {
    if p.fract() != 0.0 {
        f32::NAN
    } else if p % 2.0 != 0.0 {
        -1.0
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_equal_the_functions_of_the_library() {
        let near = |own: f32, theirs: f32| {
            let is_same = own == theirs || own.is_nan() && theirs.is_nan() || own.is_infinite() && theirs > 1e38;
            is_same || (own - theirs).abs() <= 4e-6 * theirs.abs().max(1e-7)
        };
        let values = (-4000..4000).map(|k| k as f32 * 0.037).chain([1e-40, 1e-30, 255.0, 1e6, -1e6, 0.0, 1.0, 2.0]);
        for x in values {
            assert!(near(exp(x), x.exp()), "e^{x}: {} {}", exp(x), x.exp());
            assert!(!(-87.0..88.0).contains(&x) || exp_near(x) == exp(x), "{x}");
            assert!(!(0.0..1e6).contains(&x) || floor(x) == x.floor(), "{x}");
            assert!(near(ln(x), x.ln()), "ln {x}: {} {}", ln(x), x.ln());
        }
        assert_eq!([exp(0.0), ln(1.0)], [1.0, 0.0]);
        assert_eq!([2.0, -3.0].map(sign_of_power), [1.0, -1.0]);
        assert!(sign_of_power(0.5).is_nan());
    }
}
