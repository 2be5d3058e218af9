//! Pictures of a red square and a tag, the masks of the square, and what finds them: for detectors of every kind.

#[path = "../../../behaviors/tests/it/onnx/written.rs"]
mod written;

use image::{GrayImage, Luma, Rgb, RgbImage};
use mobee_behaviors::detectors::tag::TagFamilyName;
use std::ops::Range;
use std::path::Path;
use written::{Graph, constant, input, node};

/// Width and height, pixels.
pub const SIZE: [u32; 2] = [320, 240];
/// The square's edge, pixels.
pub const SQUARE: u32 = 50;
/// The tag's number.
pub const TAG: u16 = 7;
/// The edge of one of its bits, pixels.
const BIT: usize = 5;

/// The upper left corners of square and tag in picture `n`, for an eye that sees all of them moved to the right by so many pixels.
fn corners(n: u32, right: i32) -> [[u32; 2]; 2] {
    let across = |u: u32| u.saturating_add_signed(right) + 3 * n;
    [[across(130), 120], [across(135), 30]]
}

/// What masks show: the square, or the tag's black border and what is in it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    Square,
    Tag,
}

/// Writes a picture for each number, `NAME.png`, and where the square or the tag is, `NAME_mask.png`.
pub fn draw(folder: &Path, numbers: Range<u32>, right: i32, shown: Shown) {
    std::fs::create_dir_all(folder).expect("a folder");
    let [width, height] = SIZE;
    let tag = TagFamilyName::default().picture(TAG, BIT).expect("a tag");
    for n in numbers {
        let [[u, v], [left, top]] = corners(n, right);
        let inside = |x: u32, y: u32| (u..u + SQUARE).contains(&x) && (v..v + SQUARE).contains(&y);
        // what looks like noise, the same for every run
        let noise = |x: u32, y: u32| ((x * 31 + y * 17 + n * 7) % 23) as u8;
        let picture = RgbImage::from_fn(width, height, |x, y| {
            let (a, b) = (x.wrapping_sub(left) as usize, y.wrapping_sub(top) as usize);
            if a < tag.width && b < tag.height {
                let at = (b * tag.width + a) * 3;
                return Rgb([tag.rgb[at], tag.rgb[at + 1], tag.rgb[at + 2]]);
            }
            let [r, g, b] = if inside(x, y) { [170, 50, 60] } else { [100, 130, 110] };
            Rgb([r, g, b].map(|c| c + noise(x, y)))
        });
        // around the border is white paper, one bit wide
        let bits = BIT as u32..(tag.width - BIT) as u32;
        let on_tag = |x: u32, y: u32| bits.contains(&x.wrapping_sub(left)) && bits.contains(&y.wrapping_sub(top));
        let is_shown = |x, y| if shown == Shown::Tag { on_tag(x, y) } else { inside(x, y) };
        let mask = GrayImage::from_fn(width, height, |x, y| Luma([255 * u8::from(is_shown(x, y))]));
        picture.save(folder.join(format!("{n:03}.png"))).expect("saved");
        mask.save(folder.join(format!("{n:03}_mask.png"))).expect("saved");
    }
}

/// A network for pictures of this size, in ONNX format: class 1 is whatever is much more red than green.
pub fn network(path: &Path) {
    let [width, height] = SIZE.map(u64::from);
    // written out as exporters do: the runtime knows no defaults of these
    let steps: &[(&str, &[u64])] = &[("strides", &[1, 1]), ("dilations", &[1, 1]), ("pads", &[0, 0, 0, 0])];
    let graph = Graph {
        nodes: vec![node("Conv", &["picture", "weights", "bias"], &["logits"], steps)],
        constants: vec![
            constant("weights", &[2, 3, 1, 1], &[0.0, 0.0, 0.0, 20.0, -20.0, 0.0]),
            constant("bias", &[2], &[0.0, -6.0]),
        ],
        inputs: vec![input("picture", &[Some(1), Some(3), Some(height), Some(width)])],
        outputs: vec!["logits".into()],
    };
    std::fs::write(path, graph.bytes()).expect("written");
}
