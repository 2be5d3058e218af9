//! Pictures of a red square and a tag, the masks of the square, and what finds them: for detectors of every kind.

#[path = "../../../behaviors/sensing/tests/it/onnx/written.rs"]
mod written;

use image::{GrayImage, Luma, Rgb, RgbImage};
use mobee_sensing::detectors::tag::TagFamilyName;
use std::ops::Range;
use std::path::Path;
use written::{Graph, constant, input, node, node_with_body, whole};

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

/// What is wrong with a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Harm {
    /// So many operations in a row: the runtime nests as deeply.
    Deep(usize),
    /// It asks for a million times a million pictures.
    Wide,
    /// It turns in a loop for ever.
    Endless,
    /// It asks for terabytes where a picture is white, and finds nothing elsewhere.
    WideOnWhite,
}

/// A network that no process survives, in ONNX format.
pub fn harmful(path: &Path, harm: Harm) {
    let shape = [Some(1), Some(3), Some(24), Some(32)];
    let mut graph = Graph {
        nodes: Vec::new(),
        constants: Vec::new(),
        inputs: vec![input("picture", &shape)],
        outputs: vec!["logits".into()],
    };
    match harm {
        Harm::Deep(count) => {
            let name = |k: usize| if k == 0 { "picture".to_owned() } else { format!("n{k}") };
            graph.nodes.extend((0..count).map(|k| node("Relu", &[&name(k)], &[&name(k + 1)], &[])));
            graph.nodes.push(node("Identity", &[&name(count)], &["logits"], &[]));
        }
        Harm::Wide => {
            graph.constants.push(whole("times", &[4], &[1, 1, 1_000_000, 1_000_000]));
            graph.nodes.push(node("Tile", &["picture", "times"], &["logits"], &[]));
        }
        Harm::Endless => {
            let body = Graph {
                nodes: vec![node("Identity", &["goes"], &["goes_on"], &[]), node("Relu", &["v"], &["w"], &[])],
                constants: Vec::new(),
                inputs: vec![input("i", &[]), input("goes", &[]), input("v", &shape)],
                outputs: vec!["goes_on".into(), "w".into()],
            };
            graph.constants.push(whole("turns", &[], &[1 << 62]));
            graph.nodes.push(node_with_body("Loop", &["turns", "", "picture"], &["logits"], &body));
        }
        Harm::WideOnWhite => {
            graph.constants.extend([
                constant("bright", &[1], &[0.9]),
                constant("many", &[1], &[1e13]),
                constant("zero", &[1], &[0.0]),
                constant("one", &[1], &[1.0]),
            ]);
            graph.constants.push(whole("shape", &[1], &[1]));
            graph.nodes.extend([
                node("ReduceMean", &["picture"], &["mean"], &[("keepdims", &[0])]),
                node("Sub", &["mean", "bright"], &["over"], &[]),
                node("Relu", &["over"], &["above"], &[]),
                node("Mul", &["above", "many"], &["much"], &[]),
                node("Add", &["much", "one"], &["size"], &[]),
                node("Cast", &["size"], &["whole"], &[("to", &[7])]),
                node("Reshape", &["whole", "shape"], &["length"], &[]),
                node("ConstantOfShape", &["length"], &["zeros"], &[]),
                node("ReduceMax", &["zeros"], &["nothing"], &[("keepdims", &[0])]),
                node("Sub", &["nothing", "one"], &["less"], &[]),
                node("Mul", &["picture", "zero"], &["dark"], &[]),
                node("Add", &["dark", "less"], &["logits"], &[]),
            ]);
        }
    }
    std::fs::write(path, graph.bytes()).expect("written");
}
