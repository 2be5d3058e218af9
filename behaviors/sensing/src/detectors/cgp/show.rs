//! Text form of image programs.

use super::op::Op;
use super::program::{ImageNode, ImageProgram};
use std::fmt;

const CHANNELS: [&str; 9] = ["grey", "red", "green", "blue", "hue", "saturation", "value", "colors", "network"];

/// Writes one line for each image that is used, from the inputs to the output.
impl fmt::Display for ImageProgram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let active = self.active();
        for (i, node) in self.nodes.iter().enumerate().filter(|(i, _)| active[*i]) {
            let name = |back: u16| i.checked_sub(usize::from(back)).map_or("blank".into(), |j| format!("n{j}"));
            let images = node.from[..node.op.arity()].iter().map(|b| name(*b));
            let all: Vec<String> = images.chain(words(node)).collect();
            let op = serde_json::to_value(node.op).unwrap_or_default();
            writeln!(f, "n{i} = {}({})", op.as_str().unwrap_or_default(), all.join(", "))?;
        }
        let last = self.nodes.len().saturating_sub(1);
        if self.inverted { writeln!(f, "output = 255 - n{last}") } else { writeln!(f, "output = n{last}") }
    }
}

/// Formats the parameters of a node.
fn words(node: &ImageNode) -> Vec<String> {
    match node.op {
        Op::Input => vec![CHANNELS[node.channel(CHANNELS.len())].into()],
        _ => node.parameters().into_iter().flatten().map(|p| p.to_string()).collect(),
    }
}
