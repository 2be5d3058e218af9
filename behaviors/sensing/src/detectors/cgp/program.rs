//! Image programs and their execution.

use super::super::plane::Plane;
use super::op::Op;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Maximum number of nodes of a program.
const MAX_NODES: usize = 1000;

/// Inputs of a program: gray, red, green, blue, hue, saturation, value, color likelihood and
/// network output, all 0 to 255.
pub type Channels = Vec<Arc<Plane>>;

/// A node: a function, the sources of its images, and its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageNode {
    /// The function.
    pub op: Op,
    /// Offsets, in nodes back, of the two images; before the first node there is a blank one.
    pub from: [u16; 2],
    /// Constant, threshold, exponent or scale.
    pub p0: f32,
    /// Aperture, iterations, shift to the right, or an input's channel.
    pub p1: i8,
    /// The second aperture, or shift down.
    pub p2: i8,
    /// Frequency of a Gabor filter, 0 to 16.
    pub frequency: u8,
    /// Orientation of a Gabor filter, multiples of 22.5 degrees.
    pub angle: i8,
}

/// An image program. Its output is the image of the last node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageProgram {
    /// The nodes.
    pub nodes: Vec<ImageNode>,
    /// The output is low for the object and is therefore subtracted from 255.
    pub inverted: bool,
}

/// Computes the seven channels of an image, and appends color likelihood and network output.
pub fn channels(rgb: &[Plane; 3], colors: &Plane, learned: &Plane) -> Channels {
    let [r, g, b] = rgb;
    let pixels = r.data.iter().zip(&g.data).zip(&b.data).map(|((r, g), b)| (*r, *g, *b));
    let mut of: [Vec<f32>; 4] = Default::default();
    for (r, g, b) in pixels {
        let most = r.max(g).max(b);
        let least = r.min(g).min(b);
        let span = most - least;
        let sixth = match () {
            () if span <= 0.0 => 0.0,
            () if most == r => ((g - b) / span).rem_euclid(6.0),
            () if most == g => (b - r) / span + 2.0,
            () => (r - g) / span + 4.0,
        };
        let saturation = if most > 0.0 { 255.0 * span / most } else { 0.0 };
        let values = [0.299 * r + 0.587 * g + 0.114 * b, sixth * 42.5, saturation, most];
        of.iter_mut().zip(values).for_each(|(to, v)| to.push(v));
    }
    let [grey, hue, saturation, value] = of.map(|data| r.like(data));
    let all = [grey, r.clone(), g.clone(), b.clone(), hue, saturation, value, colors.clone(), learned.clone()];
    all.into_iter().map(Arc::new).collect()
}

impl ImageProgram {
    /// Returns, for each node, whether the output depends on it.
    pub fn active(&self) -> Vec<bool> {
        let mut active = vec![false; self.nodes.len()];
        if let Some(last) = active.last_mut() {
            *last = true;
        }
        for (i, node) in self.nodes.iter().enumerate().rev().filter(|(_, n)| n.op.arity() > 0) {
            if active[i] {
                for from in &node.from[..node.op.arity()] {
                    if let Some(j) = i.checked_sub(usize::from(*from)) {
                        active[j] = true;
                    }
                }
            }
        }
        active
    }

    /// Computes the output, subtracted from 255 if inverted. `inputs`: at least one plane, all of
    /// one size.
    pub fn run(&self, inputs: &[Arc<Plane>]) -> Plane {
        let out = self.images(inputs, None).output();
        if self.inverted { out.map(|v| 255.0 - v) } else { Arc::unwrap_or_clone(out) }
    }

    /// Computes the images of all nodes that the output depends on. `like`: another program and its
    /// images for the same inputs; the image of an equal node with equal inputs is reused.
    pub(super) fn images(&self, inputs: &[Arc<Plane>], like: Option<(&ImageProgram, &Images)>) -> Images {
        let first = &inputs[0];
        let fresh = || Arc::new(Plane::filled(first.width, first.height, 0.0));
        let blank = like.map_or_else(fresh, |(_, images)| Arc::clone(&images.blank));
        let mut of: Vec<Option<Arc<Plane>>> = Vec::with_capacity(self.nodes.len());
        for (i, (node, active)) in self.nodes.iter().zip(self.active()).enumerate() {
            let image = active.then(|| {
                let from = |of: &[Option<Arc<Plane>>], k: usize| {
                    let made = i.checked_sub(usize::from(node.from[k])).and_then(|j| of.get(j)?.clone());
                    made.unwrap_or_else(|| Arc::clone(&blank))
                };
                let [a, b] = [from(&of, 0), from(&of, 1)];
                let known = like.and_then(|(other, images)| {
                    let theirs = other.nodes.get(i).filter(|theirs| theirs.does_as(node))?;
                    let same = |own: &Arc<Plane>, k: usize| {
                        let made = i.checked_sub(usize::from(theirs.from[k])).and_then(|j| images.of.get(j)?.as_ref());
                        Arc::ptr_eq(own, made.unwrap_or(&blank))
                    };
                    let needs = node.op.arity();
                    let is_same = (needs < 1 || same(&a, 0)) && (needs < 2 || same(&b, 1));
                    images.of.get(i)?.clone().filter(|_| is_same)
                });
                known.unwrap_or_else(|| match node.op {
                    Op::Input => Arc::clone(&inputs[node.channel(inputs.len())]),
                    Op::Nop => a,
                    op => Arc::new(op.apply(node, &a, &b)),
                })
            });
            of.push(image);
        }
        Images { of, blank }
    }

    /// Returns the first error of the program; `None`: it is valid.
    pub fn wrong(&self) -> Option<String> {
        if self.nodes.is_empty() || self.nodes.len() > MAX_NODES {
            return Some(format!("it has {} nodes, and 1 to {MAX_NODES} are possible", self.nodes.len()));
        }
        let bad = |n: &ImageNode| !n.p0.is_finite() || n.from.contains(&0) || n.frequency > 16;
        let i = self.nodes.iter().position(bad)?;
        Some(format!("node {i} has a non-finite number, takes its own image, or a frequency above 16"))
    }
}

/// Images of a program's nodes, as far as the output depends on them.
#[derive(Clone, Debug)]
pub(super) struct Images {
    of: Vec<Option<Arc<Plane>>>,
    blank: Arc<Plane>,
}

impl Images {
    /// Image of the last node.
    pub fn output(&self) -> Arc<Plane> {
        Arc::clone(self.of.last().and_then(Option::as_ref).unwrap_or(&self.blank))
    }
}

impl ImageNode {
    /// Creates a node from a function, its image offsets, a constant, and an integer parameter
    /// (aperture, iterations or channel).
    pub fn new(op: Op, from: [u16; 2], p0: f32, p1: i8) -> ImageNode {
        ImageNode { op, from, p0, p1, p2: 0, frequency: 0, angle: 0 }
    }

    /// Returns those parameters that its function uses.
    pub(super) fn parameters(&self) -> [Option<f32>; 2] {
        use Op::*;
        let [p0, p1, p2] = [self.p0, self.p1.into(), self.p2.into()];
        match self.op {
            Const | AddC | SubC | MulC | MinC | MaxC | Pow | Threshold | ThresholdInv | Canny => [Some(p0), None],
            Input | Dilate | Erode | Gauss | Median | Bilateral | BoxBlur | Laplace | Unsharpen | Rescale => {
                [Some(p1), None]
            }
            GaussXy | LocalMin | LocalMax | LocalMean | LocalNormalize | Shift => [Some(p1), Some(p2)],
            Gabor | ResizeGabor => [Some(self.frequency.into()), Some(self.angle.into())],
            _ => [None, None],
        }
    }

    /// Returns whether it computes the same as another node on the same images: parameters that its
    /// function does not use are ignored.
    fn does_as(&self, other: &ImageNode) -> bool {
        self.op == other.op && self.parameters() == other.parameters()
    }

    /// Returns the index of its input channel, of `of` channels.
    pub(super) fn channel(&self, of: usize) -> usize {
        i32::from(self.p1).rem_euclid(of as i32) as usize
    }
}
