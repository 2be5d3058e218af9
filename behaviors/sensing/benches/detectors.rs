//! Cost of detectors, in processor time of one core: a frame of 320x240 pixels with each kind, and
//! programs of 20 active nodes on images of 160x120, as drawn by evolution.
//!
//! ```text
//! cargo bench -p mobee-sensing --bench detectors
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[path = "../../../model/fast/benches/measure/mod.rs"]
mod measure;
#[path = "../tests/it/onnx/written.rs"]
mod written;

use measure::{processor_time, sorted};
use mobee_contract::{Detector, Frame, Intrinsics, Time};
use mobee_sensing::detectors::cgp::{ALL_OPS, Evolution, EvolutionState, ImageNode, ImageProgram, Op, channels};
use mobee_sensing::detectors::file::DetectorFile;
use mobee_sensing::detectors::onnx::{OnnxDetector, serve, use_process};
use mobee_sensing::detectors::picture::{LabeledPicture, Mask, Picture};
use mobee_sensing::detectors::plane::Plane;
use mobee_sensing::detectors::tag::{TagFamilyName, TagSeeker};
use mobee_sensing::detectors::train::Lessons;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use std::cell::RefCell;
use std::time::Instant;
use written::{Graph, constant, input, node};

/// Numbers of frames, and of programs.
const ROUNDS: usize = 41;
/// Number of repetitions of each: processor time is counted in milliseconds.
const AT_ONCE: u32 = 25;
/// Number of generations of each evolution.
const GENERATIONS: u32 = 20;

/// Creates images of an orange disk that moves over noise.
fn picture(i: usize, rng: &mut ChaCha8Rng) -> LabeledPicture {
    let (width, height) = (320usize, 240usize);
    let near = |x: usize, y: usize| (x as f64 - 60.0 - 20.0 * i as f64).hypot(y as f64 - 120.0) < 40.0;
    let data: Vec<bool> = (0..width * height).map(|p| near(p % width, p / width)).collect();
    let color = |is_object: &bool| if *is_object { [190, 110, 60] } else { [110, 120, 100] };
    let rgb = data.iter().flat_map(color).map(|c: i32| (c + rng.random_range(-40..40)) as u8).collect();
    let mask = Mask { width, height, data };
    LabeledPicture { name: i.to_string(), picture: Picture { width, height, rgb }, mask }
}

fn main() {
    if std::env::args().nth(1).as_deref() == Some("onnx-worker") {
        return serve().expect("a network runs");
    }
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let clock = Instant::now();
    let pictures: Vec<_> = (0..8).map(|i| picture(i, &mut rng)).collect();
    let lessons = Lessons::new(&pictures, "disk", 1).expect("they teach");
    let color = lessons.color().0;
    let (pixels, inputs) = lessons.network(&pictures, &mut |_| ()).expect("they teach");
    let cgp = lessons.finish_cgp(&pixels, &Evolution::new(inputs, lessons.masks(), 1)).0;
    for (name, file) in [("color", &color), ("cgp", &cgp)] {
        report(&format!("{name}, 320x240"), &look_times(file, &pictures[3].picture, clock));
    }

    let (seeker, tags) = (RefCell::new(TagSeeker::new(TagFamilyName::default())), tags(&pictures[3].picture));
    let seen = seeker.borrow_mut().seek(&tags).len();
    let times: Vec<f64> = (0..ROUNDS).map(|_| time_of(clock, || seeker.borrow_mut().seek(&tags))).collect();
    report(&format!("tag, 320x240, {seen} tags"), &times);
    networks("here", &pictures[3].picture, clock);
    use_process(std::env::current_exe().expect("this program"), &["onnx-worker"]);
    networks("in a process", &pictures[3].picture, clock);

    let small: [Plane; 3] = [0; 3].map(|_| {
        let data = (0..160 * 120).map(|_| rng.random_range(0.0..255.0)).collect();
        Plane { width: 160, height: 120, data }
    });
    let inputs = channels(&small, &small[0], &small[1]);
    let mut times = Vec::new();
    for _ in 0..ROUNDS {
        let program = chain(&mut rng);
        times.push(time_of(clock, || program.run(&inputs)));
    }
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    report("20-node programs, 160x120", &times);
    println!("programs times frames per second, mean over programs: {:.0}", 1.0 / mean);

    // Nodes that a child shares with its parent are not run again.
    let mask = Mask::at_least(&inputs[0], 140.0);
    let mut children = Vec::new();
    for seed in 0..5 {
        let parents: Vec<ImageProgram> = (0..4).map(|_| chain(&mut rng)).collect();
        let state = EvolutionState { seed, generation: 0, best: parents[0].clone(), parents };
        let mut evolution = Evolution::resume(vec![inputs.clone(); 8], vec![mask.clone(); 8], state);
        let begin = processor_time(clock);
        (0..GENERATIONS).for_each(|_| evolution.advance());
        // Four islands of four children each, bred on six of the eight images.
        children.push(f64::from(GENERATIONS * 4 * 4 * 6) / (processor_time(clock) - begin));
    }
    let mean = children.iter().sum::<f64>() / children.len() as f64;
    println!("children of such programs times frames per second, mean over evolutions: {mean:.0}");
}

/// Measures the cost of a frame by wall clock: the network's process has its own processor time.
fn networks(place: &str, picture: &Picture, clock: Instant) {
    for size in [[160, 120], [320, 240]] {
        let (mut detector, frame) = (network(size), frame(picture));
        assert!(!detector.detect(&frame).is_empty());
        let look = |_| {
            let begun = clock.elapsed();
            (0..AT_ONCE).for_each(|_| drop(std::hint::black_box(detector.detect(&frame))));
            (clock.elapsed() - begun).as_secs_f64() / f64::from(AT_ONCE)
        };
        let times: Vec<f64> = (0..ROUNDS).map(look).collect();
        report(&format!("onnx {place}, {}x{}", size[0], size[1]), &times);
    }
}

/// The same with four tags in the image.
fn tags(background: &Picture) -> Picture {
    let mut picture = background.clone();
    for (id, [left, top]) in [(1, [10, 10]), (2, [200, 20]), (3, [40, 150]), (4, [220, 150])] {
        let tag = TagFamilyName::default().picture(id, 7).expect("a tag");
        for y in 0..tag.height {
            let (to, from) = (((top + y) * picture.width + left) * 3, y * tag.width * 3);
            picture.rgb[to..to + tag.width * 3].copy_from_slice(&tag.rgb[from..from + tag.width * 3]);
        }
    }
    picture
}

fn frame(picture: &Picture) -> Frame {
    let size = [picture.width as u32, picture.height as u32];
    let intrinsics = Intrinsics { size, focal: [257.3; 2], center: [160.0, 120.0], distortion: [0.0; 4] };
    Frame { exposed: Time::ZERO, intrinsics, pixels: picture.rgb.clone().into() }
}

/// Creates three convolutions of 3x3 pixels with 16 channels in between, which sum to the redness
/// of a pixel.
fn network(size: [u64; 2]) -> OnnxDetector {
    let pads: &[(&str, &[u64])] = &[("pads", &[1, 1, 1, 1]), ("strides", &[1, 1]), ("dilations", &[1, 1])];
    let layer = |name: &str, to: usize, from: usize, weight: &dyn Fn(usize) -> f32| {
        let values: Vec<f32> = (0..to * from).flat_map(|k| [weight(k % from) / 9.0; 9]).collect();
        constant(name, &[to as u64, from as u64, 3, 3], &values)
    };
    let graph = Graph {
        nodes: vec![
            node("Conv", &["picture", "first"], &["a"], pads),
            node("Relu", &["a"], &["b"], &[]),
            node("Conv", &["b", "second"], &["c"], pads),
            node("Relu", &["c"], &["d"], &[]),
            node("Conv", &["d", "third", "bias"], &["logits"], pads),
        ],
        constants: vec![
            layer("first", 16, 3, &|k| [20.0, -10.0, -10.0][k]),
            layer("second", 16, 16, &|_| 1.0 / 16.0),
            layer("third", 1, 16, &|_| 1.0 / 16.0),
            constant("bias", &[1], &[-2.0]),
        ],
        inputs: vec![input("picture", &[Some(1), Some(3), Some(size[1]), Some(size[0])])],
        outputs: vec!["logits".into()],
    };
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), graph.bytes()).expect("written");
    let settings = json!({ "file": file.path(), "output": { "means": "mask" }, "objects": [{ "object": "disk" }] });
    OnnxDetector::new(serde_json::from_value(settings).expect("settings")).expect("a detector")
}

fn look_times(file: &DetectorFile, picture: &Picture, clock: Instant) -> Vec<f64> {
    (0..ROUNDS).map(|_| time_of(clock, || file.look(picture))).collect()
}

/// Returns the processor time of a task, seconds, averaged over a few runs.
fn time_of<T>(clock: Instant, task: impl Fn() -> T) -> f64 {
    let begin = processor_time(clock);
    (0..AT_ONCE).for_each(|_| drop(std::hint::black_box(task())));
    (processor_time(clock) - begin) / f64::from(AT_ONCE)
}

/// Creates a program of random functions, each of which depends on the previous one.
fn chain(rng: &mut ChaCha8Rng) -> ImageProgram {
    let node = |i: usize| {
        let op = if i == 0 { Op::Input } else { ALL_OPS[rng.random_range(3..ALL_OPS.len())] };
        let mut node =
            ImageNode::new(op, [1, (i as u16).clamp(1, 2)], rng.random_range(0.0..255.0), rng.random_range(-16..=16));
        node.p2 = rng.random_range(-16..=16);
        node
    };
    ImageProgram { nodes: (0..20).map(node).collect(), inverted: false }
}

fn report(what: &str, times: &[f64]) {
    let times = sorted(times.to_vec());
    let at = |share: f64| 1e3 * times[((times.len() - 1) as f64 * share) as usize];
    println!("{what:28} least {:7.2} ms, median {:7.2}, 95 % {:7.2}", at(0.0), at(0.5), at(0.95));
}
