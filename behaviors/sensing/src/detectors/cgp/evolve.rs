//! Evolution: islands of one parent and four children each; at intervals the best parent migrates
//! to another island.
//!
//! In a child, single genes are mutated until one of an active node has changed (Goldman and Punch
//! 2013), so that no evaluation is spent on an equivalent program. A child that is as good as its
//! parent replaces it, so that inactive genes drift. Programs are bred on the first three quarters
//! of the images. The best program is selected by these and by the last quarter, which breeding
//! never uses.

use super::super::picture::Mask;
use super::super::plane::Plane;
use super::super::score::Levels;
use super::op::{ALL_OPS, Op};
use super::program::{Channels, ImageNode, ImageProgram, Images};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

const ISLANDS: usize = 4;
const CHILDREN: usize = 4;
const NODES: usize = 30;
/// Number of generations between two migrations.
const MIGRATION_INTERVAL: u64 = 50;
/// Maximum number of images that programs are bred on.
const MAX_BREEDING_IMAGES: usize = 10;
/// Maximum number of images, of the last quarter, that select the best program.
const MAX_SELECTION_IMAGES: usize = 5;
/// Input channel of the color likelihood.
const COLOR_CHANNEL: i8 = 7;
/// Input channel of the network's output.
const NETWORK_CHANNEL: i8 = 8;

/// State of an evolution: resumed from it, an evolution continues as if it had not stopped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvolutionState {
    /// Seed of all randomness.
    pub seed: u64,
    /// Number of generations so far.
    pub generation: u64,
    /// Parent of each island.
    pub parents: Vec<ImageProgram>,
    /// The best program so far.
    pub best: ImageProgram,
}

/// An evolution of programs for a set of images.
pub struct Evolution {
    inputs: Vec<Channels>,
    masks: Vec<Mask>,
    state: EvolutionState,
    /// Breeding score of each parent.
    worth: Vec<f64>,
    /// Images of each parent's nodes for each breeding image: a child changes few of them.
    images: Vec<Vec<Images>>,
    best_worth: f64,
}

impl Evolution {
    /// Starts an evolution from programs that pass on the network's output and the color
    /// likelihood.
    pub fn new(inputs: Vec<Channels>, masks: Vec<Mask>, seed: u64) -> Evolution {
        let begin = |island: usize| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (island as u64 + 1));
            let mut nodes: Vec<ImageNode> = (0..NODES).map(|i| random_node(i, &mut rng)).collect();
            nodes[0] = ImageNode::new(Op::Input, [1, 1], 0.0, NETWORK_CHANNEL);
            nodes[1] = ImageNode::new(Op::Input, [1, 1], 0.0, COLOR_CHANNEL);
            let back = |to: usize| (NODES - 1 - to) as u16;
            let op = [Op::Nop, Op::BoxBlur, Op::Avg, Op::Gauss][island % 4];
            nodes[NODES - 1] = ImageNode::new(op, [back(0), back(1)], 0.0, 5);
            ImageProgram { nodes, inverted: false }
        };
        let parents: Vec<ImageProgram> = (0..ISLANDS).map(begin).collect();
        let best = parents[0].clone();
        Evolution::resume(inputs, masks, EvolutionState { seed, generation: 0, parents, best })
    }

    /// Resumes an evolution.
    pub fn resume(inputs: Vec<Channels>, masks: Vec<Mask>, state: EvolutionState) -> Evolution {
        let mut all =
            Evolution { inputs, masks, worth: vec![], images: vec![], best_worth: f64::MIN, state: state.clone() };
        all.judge(&state.best);
        for parent in &state.parents {
            let images = all.bred(parent, None);
            all.worth.push(all.breed_worth(parent, &images).0);
            all.images.push(images);
            all.judge(parent);
        }
        all
    }

    /// Advances every island by one generation.
    pub fn advance(&mut self) {
        let generation = self.state.generation;
        for island in 0..self.state.parents.len() {
            let chance =
                self.state.seed ^ (generation * ISLANDS as u64 + island as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let mut rng = ChaCha8Rng::seed_from_u64(chance);
            let mut next = None;
            let before = self.worth[island];
            for _ in 0..CHILDREN {
                let parent = &self.state.parents[island];
                let mut child = mutant(parent, &mut rng);
                let images = self.bred(&child, Some((parent, &self.images[island])));
                let (worth, inverted) = self.breed_worth(&child, &images);
                if worth >= self.worth[island] {
                    child.inverted ^= inverted;
                    (next, self.worth[island]) = (Some((child, images)), worth);
                }
            }
            if let Some((child, images)) = next {
                if self.worth[island] > before {
                    self.judge(&child);
                }
                (self.state.parents[island], self.images[island]) = (child, images);
            }
        }
        self.state.generation += 1;
        if self.state.generation.is_multiple_of(MIGRATION_INTERVAL) {
            let best = (0..self.worth.len()).max_by(|a, b| self.worth[*a].total_cmp(&self.worth[*b])).unwrap_or(0);
            let to = (best + 1 + (self.state.generation / MIGRATION_INTERVAL) as usize % (ISLANDS - 1)) % ISLANDS;
            self.state.parents[to] = self.state.parents[best].clone();
            self.worth[to] = self.worth[best];
            self.images[to] = self.images[best].clone();
        }
    }

    /// Returns the indices of the selected images: of the first three quarters, or of the last
    /// quarter.
    fn chosen(&self, last: bool) -> Vec<usize> {
        let cut = self.inputs.len() * 3 / 4;
        let (from, to, most) =
            if last { (cut, self.inputs.len(), MAX_SELECTION_IMAGES) } else { (0, cut, MAX_BREEDING_IMAGES) };
        let n = (to - from).min(most);
        (0..n).map(|i| from + (2 * i + 1) * (to - from) / (2 * n)).collect()
    }

    fn levels(&self, program: &ImageProgram, last: bool) -> Levels {
        let mut levels = Levels::default();
        for i in self.chosen(last) {
            levels.add(&program.run(&self.inputs[i]), &self.masks[i]);
        }
        levels
    }

    /// Computes the images of a program's nodes for the breeding images. `like`: a parent and the
    /// images of its nodes.
    fn bred(&self, program: &ImageProgram, like: Option<(&ImageProgram, &Vec<Images>)>) -> Vec<Images> {
        let chosen = self.chosen(false).into_iter().enumerate();
        let known = |k: usize| like.and_then(|(parent, images)| Some((parent, images.get(k)?)));
        chosen.map(|(k, i)| program.images(&self.inputs[i], known(k))).collect()
    }

    fn breed_worth(&self, program: &ImageProgram, images: &[Images]) -> (f64, bool) {
        let mut levels = Levels::default();
        for (i, images) in self.chosen(false).into_iter().zip(images) {
            let out = images.output();
            match program.inverted {
                true => levels.add(&out.map(|v| 255.0 - v), &self.masks[i]),
                false => levels.add(&out, &self.masks[i]),
            }
        }
        let mcc = levels.best(true).1;
        (mcc.abs(), mcc < 0.0)
    }

    /// Stores a program if it is the best by all selected images.
    fn judge(&mut self, program: &ImageProgram) {
        let (threshold, bred) = self.levels(program, false).best(false);
        let judged = self.levels(program, true).mcc(threshold.into());
        let worth = 0.5 * (bred + judged);
        if worth > self.best_worth {
            (self.best_worth, self.state.best) = (worth, program.clone());
        }
    }

    /// The best program so far.
    pub fn best(&self) -> &ImageProgram {
        &self.state.best
    }

    /// Returns the mean of the best program's correlations on the breeding images and on the
    /// selection images.
    pub fn best_worth(&self) -> f64 {
        self.best_worth
    }

    /// Returns the best program's output for every image.
    pub fn outputs(&self) -> Vec<Plane> {
        self.inputs.iter().map(|i| self.state.best.run(i)).collect()
    }

    /// Current state.
    pub fn state(&self) -> &EvolutionState {
        &self.state
    }
}

impl EvolutionState {
    /// Returns whether an evolution can be resumed from it.
    pub fn is_sound(&self) -> bool {
        let programs = self.parents.iter().chain([&self.best]);
        self.parents.len() == ISLANDS && programs.into_iter().all(|p| p.wrong().is_none() && p.nodes.len() == NODES)
    }
}

fn random_node(i: usize, rng: &mut ChaCha8Rng) -> ImageNode {
    let mut node = ImageNode::new(Op::Input, [1, 1], 0.0, 0);
    (0..8).for_each(|gene| mutate(&mut node, gene, i, rng));
    node
}

/// Replaces a gene by another value.
fn mutate(node: &mut ImageNode, gene: usize, i: usize, rng: &mut ChaCha8Rng) {
    match gene {
        0 => node.op = ALL_OPS[rng.random_range(0..ALL_OPS.len())],
        1 | 2 => node.from[gene - 1] = rng.random_range(1..=(i as u16 + 1).min(12)),
        // Change it slightly, or draw a new value.
        3 if rng.random_bool(0.5) => {
            node.p0 = (node.p0 * rng.random_range(0.7..1.4) + rng.random_range(-5.0..5.0)).clamp(-1e4, 1e4)
        }
        3 if rng.random_bool(0.5) => node.p0 = rng.random_range(-2.0..2.0),
        3 => node.p0 = rng.random_range(0.0..255.0),
        4 => node.p1 = rng.random_range(-16..=16),
        5 => node.p2 = rng.random_range(-16..=16),
        6 => node.frequency = rng.random_range(0..=16),
        _ => node.angle = rng.random_range(-8..=8),
    }
}

/// Returns a copy with one active gene changed, and some inactive ones.
fn mutant(of: &ImageProgram, rng: &mut ChaCha8Rng) -> ImageProgram {
    let mut child = of.clone();
    let active = of.active();
    loop {
        let i = rng.random_range(0..child.nodes.len());
        let gene = rng.random_range(0..8);
        let before = child.nodes[i].clone();
        mutate(&mut child.nodes[i], gene, i, rng);
        let counts = match gene {
            0 => true,
            1 | 2 => before.op.arity() >= gene,
            _ => before.op != Op::Nop && before.op != Op::Blank,
        };
        if active[i] && counts && child.nodes[i] != before {
            return child;
        }
    }
}
