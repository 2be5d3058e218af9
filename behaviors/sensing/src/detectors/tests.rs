mod evolved;

use super::cgp::{ALL_OPS, Evolution, ImageNode, ImageProgram, Op};
use super::file::{DetectorFile, DetectorKind};
use super::picture::{LabeledPicture, Mask, Picture, read_folder};
use super::plane::Plane;
use super::regions::Cut;
use super::score::{Confusion, Levels};
use super::train::{Lessons, TrainFault};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::sync::Arc;

fn noise(width: usize, height: usize, seed: u64) -> Plane {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    Plane { width, height, data: (0..width * height).map(|_| rng.random_range(0.0..255.0)).collect() }
}

/// Creates images of a red square that moves over green and gray noise.
fn wandering(n: usize) -> Vec<LabeledPicture> {
    let (width, height) = (64, 48);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let picture = |i: usize| {
        let mut mask = Mask { width, height, data: vec![false; width * height] };
        let mut rgb = Vec::new();
        for p in 0..width * height {
            let (x, y) = (p % width, p / width);
            mask.data[p] = (10 + i..24 + i).contains(&x) && (12..26).contains(&y);
            let color = if mask.data[p] { [180, 50, 60] } else { [90, 120, 80] };
            rgb.extend(color.map(|c| (c + rng.random_range(-25..25)) as u8));
        }
        LabeledPicture { name: format!("{i:03}"), picture: Picture { width, height, rgb }, mask }
    };
    (0..n).map(picture).collect()
}

#[test]
fn every_function_answers_finite_images_of_the_same_size_for_any_parameters_and_any_size() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for (width, height) in [(1, 1), (1, 7), (2, 3), (19, 11)] {
        let mut a = noise(width, height, 2);
        let b = noise(width, height, 3).map(|v| (v - 128.0) * 1e4);
        a.data[0] = -1e6;
        for op in ALL_OPS {
            for _ in 0..20 {
                let mut node =
                    ImageNode::new(op, [1, 2], rng.random_range(-300.0..300.0), rng.random_range(-128..=127));
                (node.p2, node.frequency, node.angle) =
                    (rng.random_range(-128..=127), rng.random_range(0..=16), rng.random_range(-128..=127));
                for (a, b) in [(&a, &b), (&b, &a)] {
                    let out = op.apply(&node, a, b);
                    assert_eq!((out.width, out.height, out.data.len()), (width, height, width * height), "{op:?}");
                    assert!(out.data.iter().all(|v| v.is_finite()), "{node:?}");
                }
            }
        }
    }
}

#[test]
fn windows_are_what_a_plain_loop_over_them_says() {
    let a = noise(13, 9, 5);
    for (rx, ry) in [(1, 1), (2, 4), (6, 1), (16, 16)] {
        let window = |x: usize, y: usize| {
            let rows = y.saturating_sub(ry)..(y + ry + 1).min(9);
            rows.flat_map(move |y| (x.saturating_sub(rx)..(x + rx + 1).min(13)).map(move |x| (x, y)))
        };
        let mut least = ImageNode::new(Op::LocalMin, [1, 1], 0.0, rx as i8);
        least.p2 = ry as i8;
        let mut mean = least.clone();
        mean.op = Op::LocalMean;
        let mut most = least.clone();
        most.op = Op::LocalMax;
        let [least, mean, most] = [least, mean, most].map(|n| n.op.apply(&n, &a, &a));
        for (x, y) in (0..9).flat_map(|y| (0..13).map(move |x| (x, y))) {
            let all: Vec<f32> = window(x, y).map(|(x, y)| a.data[y * 13 + x]).collect();
            let at = y * 13 + x;
            assert_eq!(least.data[at], all.iter().copied().fold(f32::MAX, f32::min));
            assert_eq!(most.data[at], all.iter().copied().fold(f32::MIN, f32::max));
            assert!((mean.data[at] - all.iter().sum::<f32>() / all.len() as f32).abs() < 1e-2);
        }
    }
}

/// Compares medians, bilateral and Gabor filters with their definitions, pixel by pixel.
#[test]
fn filters_are_what_their_definitions_say_of_each_pixel() {
    for (w, h) in [(1, 1), (4, 9), (5, 5), (13, 9), (23, 7)] {
        let a = noise(w, h, 6);
        let (columns, rows) = (w as isize, h as isize);
        let at = |x: isize, y: isize| a.data[(y.clamp(0, rows - 1) * columns + x.clamp(0, columns - 1)) as usize];
        let compare = |node: &ImageNode, least: f32, of: &dyn Fn(isize, isize) -> f32| {
            let out = node.op.apply(node, &a, &a);
            for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
                let (own, defined) = (out.data[(y * columns + x) as usize], of(x, y));
                assert!((own - defined).abs() <= least, "{node:?} of {w}x{h} at {x}, {y}: {own}, not {defined}");
            }
        };
        for (p1, r) in [(3, 1), (9, 2)] {
            compare(&ImageNode::new(Op::Median, [1, 1], 0.0, p1), 0.0, &|x, y| {
                let inside = |x: isize, y: isize| (0..columns).contains(&x) && (0..rows).contains(&y);
                let window = (y - r..=y + r).flat_map(|y| (x - r..=x + r).map(move |x| (x, y)));
                let mut all: Vec<f32> = window.filter(|(x, y)| inside(*x, *y)).map(|(x, y)| at(x, y)).collect();
                all.sort_by(f32::total_cmp);
                all[all.len() / 2]
            });
        }
        for (p1, r) in [(3, 1), (5, 2), (7, 3)] {
            compare(&ImageNode::new(Op::Bilateral, [1, 1], 0.0, p1), 1e-3, &|x, y| {
                let (mut sum, mut all) = (0.0, 0.0);
                for (dy, dx) in (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dy, dx))) {
                    let (v, o) = (at(x, y), at(x + dx, y + dy));
                    let steps = (v - o).abs().floor().min(64.0);
                    let weight = (-(steps * steps + (dx * dx + dy * dy) as f32) / 200.0).exp();
                    (sum, all) = (sum + weight * o, all + weight);
                }
                sum / all
            });
        }
        let mut wave = ImageNode::new(Op::Gabor, [1, 1], 0.0, 0);
        for (frequency, angle) in [(0, 0), (1, 3), (2, -5), (7, 8)] {
            (wave.frequency, wave.angle) = (frequency, angle);
            compare(&wave, 2e-3, &|x, y| {
                let pi = std::f32::consts::PI;
                let (k, variance) = (pi * 2f32.powf(-(f32::from(frequency) + 2.0) / 2.0), 2.0 * pi * pi);
                let (sin, cos) = (f32::from(angle) * pi / 8.0).sin_cos();
                let (mut real, mut imaginary) = (0.0, 0.0);
                for (dy, dx) in (-4..=4).flat_map(|dy| (-4..=4).map(move |dx| (dy, dx))) {
                    let bell = k * k / variance * (-k * k * (dx * dx + dy * dy) as f32 / (2.0 * variance)).exp();
                    let phase = k * (cos * dx as f32 + sin * dy as f32);
                    real += bell * (phase.cos() - (-variance / 2.0).exp()) * at(x + dx, y + dy);
                    imaginary += bell * phase.sin() * at(x + dx, y + dy);
                }
                real.hypot(imaginary)
            });
        }
    }
}

#[test]
fn an_inactive_node_changes_nothing() {
    let inputs = vec![Arc::new(noise(9, 9, 1)), Arc::new(noise(9, 9, 2))];
    let mut nodes = vec![ImageNode::new(Op::Input, [1, 1], 0.0, 0), ImageNode::new(Op::Canny, [1, 1], 3.0, 0)];
    nodes.push(ImageNode::new(Op::Sqrt, [2, 1], 0.0, 0));
    let mut program = ImageProgram { nodes, inverted: false };
    let before = program.run(&inputs);
    assert_eq!(program.active(), [true, false, true]);
    program.nodes[1] = ImageNode::new(Op::Const, [1, 1], 77.0, 0);
    assert_eq!(program.run(&inputs), before);
}

#[test]
fn the_best_threshold_is_that_of_counting_masks() {
    let plane = noise(20, 20, 4);
    let mut truth = Mask::at_least(&plane, 200.0);
    truth.data[..40].iter_mut().for_each(|m| *m = !*m);
    let mut levels = Levels::default();
    levels.add(&plane, &truth);
    let (threshold, mcc) = levels.best(false);
    let by_hand = |t: u8| {
        let mut sum = Confusion::default();
        sum.add(&Mask::at_least(&plane, f32::from(t)), &truth);
        sum.mcc()
    };
    assert!((by_hand(threshold) - mcc).abs() < 1e-12);
    assert!((1..=255).all(|t| by_hand(t) <= mcc));
    assert!((levels.mcc(threshold.into()) - mcc).abs() < 1e-12);
}

#[test]
fn regions_have_their_centroid_box_and_whether_the_border_cuts_them() {
    let mut plane = Plane::filled(20, 12, 0.0);
    let mut paint = |xs: std::ops::Range<usize>, ys: std::ops::Range<usize>| {
        ys.for_each(|y| xs.clone().for_each(|x| plane.data[y * 20 + x] = 255.0));
    };
    paint(3..9, 2..6);
    paint(16..20, 7..10);
    paint(12..13, 1..2); // a speck
    let (mask, blobs) = Cut { threshold: 128.0, open: true, keep: 0.0 }.apply(&plane);
    let blobs = blobs.kept;
    assert_eq!(blobs.len(), 2, "the speck is opened away");
    assert_eq!((blobs[0].centroid, blobs[0].bounds, blobs[0].area), ([6.0, 4.0], [3, 2, 9, 6], 24));
    assert!(!blobs[0].is_clipped && blobs[1].is_clipped);
    assert_eq!(mask.data.iter().filter(|m| **m).count(), 36);
    let (mask, blobs) = Cut { threshold: 128.0, open: true, keep: 1.0 }.apply(&plane);
    assert_eq!((blobs.kept.len(), mask.data.iter().filter(|m| **m).count()), (1, 24));
}

#[test]
fn both_kinds_learn_and_go_through_their_file_and_evolution_is_resumed_exactly() {
    let all = wandering(14);
    let (lessons, seen) = (&all[..10], &all[10..]);
    let score = |file: &DetectorFile| {
        let file = DetectorFile::parse(&file.text()).expect("its own text");
        let mut sum = Confusion::default();
        seen.iter().for_each(|p| sum.add(&file.look(&p.picture).0, &p.mask));
        sum.mcc()
    };
    let learned = Lessons::new(lessons, "square", 1).expect("they teach");
    let color = learned.color().0;
    assert!(score(&color) > 0.95, "{}", score(&color));
    let (network, inputs) = learned.network(lessons, &mut |_| ()).expect("they teach");
    let mut whole = Evolution::new(inputs.clone(), learned.masks(), 1);
    (0..3).for_each(|_| whole.advance());
    let mut resumed = Evolution::resume(inputs, learned.masks(), whole.state().clone());
    let first = whole.best_worth();
    (0..3).for_each(|_| (whole.advance(), resumed.advance()).0);
    assert_eq!(whole.state(), resumed.state());
    assert!(whole.best_worth() >= first);
    let cgp = learned.finish_cgp(&network, &whole).0;
    assert_eq!(cgp.kind, DetectorKind::Cgp);
    assert!(score(&cgp) > 0.95, "{}", score(&cgp));
    damaged_files_are_refused(&cgp);
}

fn damaged_files_are_refused(file: &DetectorFile) {
    let text = file.text();
    let mut short = file.clone();
    if let Some(p) = &mut short.program {
        p.nodes.clear();
    }
    let mut blind = file.clone();
    blind.network = None;
    let mut never = file.clone();
    never.cut.threshold = 0.0;
    let cases = [
        (text[..text.len() / 2].to_owned(), "no detector file"),
        (text.replacen("\"version\":1", "\"version\":2", 1), "version 2"),
        (text.replacen("mobee-detector", "mobee-map", 1), "mobee-map"),
        (text.replacen("\"shrink\":1", "\"shrink\":0", 1), "shrink"),
        (short.text(), "0 nodes"),
        (blind.text(), "network"),
        (never.text(), "cut.threshold"),
    ];
    for (text, said) in cases {
        let fault = DetectorFile::parse(&text).expect_err(said);
        assert!(fault.what.contains(said) && !fault.help.is_empty(), "{fault:?}");
    }
}

#[test]
fn pictures_that_teach_nothing_are_told() {
    let mut all = wandering(8);
    assert_eq!(Lessons::new(&all[..3], "x", 0).err(), Some(TrainFault::Few(3)));
    all.iter_mut().for_each(|p| p.mask.data.fill(false));
    assert_eq!(Lessons::new(&all, "x", 0).err(), Some(TrainFault::Blank));
}

#[test]
fn a_folder_is_read_whole_or_refused_with_the_file() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let save = |name: &str, w: u32, h: u32| image::GrayImage::new(w, h).save(at(name)).expect("saved");
    let refused = |said: &str, file: &str| {
        let fault = read_folder(dir.path()).expect_err(said);
        assert!(fault.what.contains(said) && fault.path.ends_with(file) && !fault.help.is_empty(), "{fault:?}");
    };
    refused("no pictures", "");
    save("a.png", 8, 6);
    refused("no mask", "a.png");
    save("a_mask.png", 6, 8);
    refused("6x8", "a_mask.png");
    save("a_mask.png", 8, 6);
    assert_eq!(read_folder(dir.path()).expect("it is whole").len(), 1);
    std::fs::write(at("b.jpg"), b"").expect("written");
    save("b_mask.png", 8, 6);
    refused("no whole picture", "b.jpg");
    std::fs::copy(at("a.png"), at("b.jpg")).expect("copied");
    std::fs::remove_file(at("b.jpg")).expect("removed");
    refused("no picture", "b_mask.png");
    assert!(read_folder(Path::new("/nowhere/at/all")).is_err());
}
