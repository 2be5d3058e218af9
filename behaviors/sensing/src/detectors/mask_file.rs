//! Interpretation of mask files: white on black, one color or label on a background, or opaque on
//! transparent.
//!
//! ```text
//! transparent pixels ──> the opaque ones are the object
//! up to 16 colors    ──> exact: black is the background; the other color that covers an area is the object (two: error)
//! more               ──> soft edges: pixels at least half as bright as the brightest are the object
//! ```

use image::DynamicImage;
use std::collections::BTreeSet;

/// Maximum number of colors of a drawn mask with exact colors; one with more has soft edges or
/// noise.
const MAX_EXACT_COLORS: usize = 16;
/// Maximum value of a channel.
const FULL: u16 = u16::MAX;
const HALF: u16 = FULL / 2 + 1;
const BLACK: [u16; 3] = [0; 3];

/// Problem and remedy.
type MaskProblem = (String, &'static str);

/// Returns, for each pixel, row by row, whether it belongs to the object.
///
/// # Errors
/// A mask in which the object's color is ambiguous.
pub(super) fn object_pixels(mask: &DynamicImage) -> Result<Vec<bool>, MaskProblem> {
    let width = mask.width() as usize;
    // Labels of 16 bits may be as small as 1.
    let pixels: Vec<[u16; 4]> = mask.to_rgba16().pixels().map(|p| p.0).collect();
    let is_opaque = |p: &[u16; 4]| p[3] >= HALF;
    if !pixels.iter().any(is_opaque) && !pixels.is_empty() {
        let help = "save it without transparency, white where the object is";
        return Err(("all of this mask is transparent".into(), help));
    }
    if !pixels.iter().all(is_opaque) {
        let opaque: BTreeSet<[u16; 3]> = pixels.iter().filter(|p| is_opaque(p)).map(color).collect();
        let is_gray = |[r, g, b]: &[u16; 3]| r == g && g == b;
        let spans = |levels: &BTreeSet<[u16; 3]>| {
            levels.iter().any(|c| c[0] < FULL / 4) && levels.iter().any(|c| c[0] > FULL / 4 * 3)
        };
        if opaque.iter().all(is_gray) && spans(&opaque) {
            let help = "save it without transparency, white where the object is";
            return Err((
                "this mask has transparent, black and white pixels: two of them are not the object".into(),
                help,
            ));
        }
        return Ok(pixels.iter().map(is_opaque).collect());
    }
    let colors: Vec<[u16; 3]> = pixels.iter().map(color).collect();
    let mut different = BTreeSet::new();
    for color in &colors {
        different.insert(*color);
        if different.len() > MAX_EXACT_COLORS {
            break;
        }
    }
    let brightest = colors.iter().map(brightness).max().unwrap_or(0);
    let brighter_than = |least: u32| colors.iter().map(|c| u32::from(brightness(c)) >= least.max(1)).collect();
    if different.len() > MAX_EXACT_COLORS {
        return Ok(brighter_than(u32::from(brightest).div_ceil(2)));
    }
    let mut areas = areas(&colors, width);
    areas.remove(&BLACK);
    let areas: Vec<[u16; 3]> = areas.into_iter().collect();
    match areas.as_slice() {
        // No area is as large as 3x3 pixels: the object is that small.
        [] => Ok(brighter_than(u32::from(brightest).div_ceil(2))),
        // A background that is not black, and an object that small.
        [ground] if !different.contains(&BLACK) && 2 * u32::from(brightness(ground)) < u32::from(brightest) => {
            Ok(brighter_than((u32::from(brightness(ground)) + u32::from(brightest)).div_ceil(2)))
        }
        [object] => Ok(brighter_than(u32::from(brightness(object)).div_ceil(2))),
        // A background that is not black.
        [a, b] if !different.contains(&BLACK) && is_much_brighter(a, b) => {
            Ok(brighter_than((u32::from(brightness(a)) + u32::from(brightness(b))).div_ceil(2)))
        }
        several => {
            let shown: Vec<String> = several.iter().take(4).map(shown).collect();
            let what = format!("this mask has {} colors that could be the object: {}", several.len(), shown.join(", "));
            Err((what, "give a mask of one object: white where it is, black elsewhere"))
        }
    }
}

fn color(pixel: &[u16; 4]) -> [u16; 3] {
    [pixel[0], pixel[1], pixel[2]]
}

fn brightness([red, green, blue]: &[u16; 3]) -> u16 {
    *red.max(green).max(blue)
}

/// Returns whether one of two colors is more than twice as bright as the other.
fn is_much_brighter(a: &[u16; 3], b: &[u16; 3]) -> bool {
    let [a, b] = [a, b].map(|c| u32::from(brightness(c)));
    2 * a.min(b) < a.max(b)
}

/// Formats a color with 8 bits for each channel; values that are not multiples of 257 as in files
/// of 16 bits.
fn shown([red, green, blue]: &[u16; 3]) -> String {
    let channel = |c: u16| if c.is_multiple_of(257) { (c / 257).to_string() } else { format!("{c}/65535") };
    if red == green && green == blue {
        return format!("gray {}", channel(*red));
    }
    format!("({}, {}, {})", channel(*red), channel(*green), channel(*blue))
}

/// Returns the colors that cover 3x3 pixels somewhere; all others are edges.
fn areas(colors: &[[u16; 3]], width: usize) -> BTreeSet<[u16; 3]> {
    let mut found = BTreeSet::new();
    let rows: Vec<&[[u16; 3]]> = colors.chunks_exact(width.max(1)).collect();
    for three in rows.windows(3) {
        let [above, middle, below] = [three[0], three[1], three[2]];
        let across = above.windows(3).zip(middle.windows(3)).zip(below.windows(3));
        for ((a, m), b) in across {
            let one = m[1];
            if [a, m, b].iter().all(|row| row.iter().all(|c| *c == one)) {
                found.insert(one);
            }
        }
    }
    found
}
