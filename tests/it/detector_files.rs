//! `mobee detector` as a user meets it: an object learned from pictures, interrupted or not; judged by others; and what teaches
//! nothing, refused with place and remedy.

use super::common::{answer, complaint, text};
use std::path::{Path, PathBuf};

/// Pictures of a red square that wanders over green, with masks.
fn pictures(folder: &Path, numbers: std::ops::Range<u32>) {
    std::fs::create_dir_all(folder).expect("a folder");
    let (width, height) = (64, 48);
    for n in numbers {
        let inside = |x: u32, y: u32| (8 + n..24 + n).contains(&x) && (12..28).contains(&y);
        // what looks like noise, the same for every run
        let noise = |x: u32, y: u32| (x * 31 + y * 17 + n * 7) % 23;
        let picture = image::RgbImage::from_fn(width, height, |x, y| {
            let [r, g, b] = if inside(x, y) { [170, 50, 60] } else { [80, 130, 70] };
            let by = noise(x, y) as u8;
            image::Rgb([r + by, g + by, b + by])
        });
        let mask = image::GrayImage::from_fn(width, height, |x, y| image::Luma([255 * u8::from(inside(x, y))]));
        picture.save(folder.join(format!("{n:03}.png"))).expect("saved");
        mask.save(folder.join(format!("{n:03}_mask.png"))).expect("saved");
    }
}

/// The correlation that `mobee detector eval` tells.
fn mcc(detector: &Path, images: &Path) -> f64 {
    let told = answer(&["detector", "eval", "--detector", text(detector), "--images", text(images), "--json"]);
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    told["mcc"].as_f64().expect("a correlation")
}

#[test]
fn an_object_is_learned_interrupted_resumed_judged_and_shown() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (square, later) = (at("square"), at("later"));
    pictures(&square, 0..10);
    pictures(&later, 12..16);
    let train = ["detector", "train", "--images", text(&square), "--out"];
    let color = at("color.json");
    let told = answer(&[&train[..], &[text(&color), "--kind", "color"]].concat());
    assert!(told.contains("square, from 10 pictures"), "{told}");
    assert!(mcc(&color, &later) > 0.95);

    let (whole, cut) = (at("whole.json"), at("cut.json"));
    answer(&[&train[..], &[text(&whole)]].concat());
    let told = answer(&[&train[..], &[text(&cut), "--stop-after", "20"]].concat());
    assert!(told.contains("the same command goes on") && !cut.exists(), "{told}");
    let other = complaint(&[&train[..], &[text(&cut), "--seed", "1"]].concat());
    assert!(other.contains("cut.json.part is of a training with other pictures or another seed"), "{other}");
    answer(&[&train[..], &[text(&cut)]].concat());
    assert!(!at("cut.json.part").exists());
    assert_eq!(std::fs::read(&cut).expect("a detector"), std::fs::read(&whole).expect("a detector"));
    assert!(mcc(&whole, &later) > 0.95);
    let told = answer(&["detector", "show", text(&whole)]);
    assert!(told.starts_with("square, kind cgp\n") && told.contains("\noutput = "), "{told}");
}

#[test]
fn what_teaches_nothing_or_is_no_detector_is_refused_with_its_place() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (images, out) = (at("images"), at("out.json"));
    pictures(&images, 0..4);
    let train = ["detector", "train", "--images", text(&images), "--out", text(&out), "--kind", "color"];
    let refused = |words: &str| {
        let told = complaint(&train);
        assert!(told.contains(words) && !out.exists(), "{words}: {told}");
    };
    let told = complaint(&[&train[..], &["--minutes", "3"]].concat());
    assert!(told.contains("does not evolve"), "{told}");
    std::fs::copy(images.join("000.png"), images.join("003_mask.jpg")).expect("copied");
    refused("003_mask.jpg: this picture has no mask");
    std::fs::remove_file(images.join("003_mask.jpg")).expect("removed");
    std::fs::write(images.join("002.png"), b"\x89PNG and no more").expect("written");
    refused("002.png: this is no whole picture");
    std::fs::remove_dir_all(&images).expect("removed");
    pictures(&images, 0..3);
    refused("only 3 pictures");
    pictures(&images, 0..4);
    answer(&train);
    assert!(complaint(&train).contains("exists already"));
    std::fs::write(at("torn.json"), &std::fs::read(&out).expect("a detector")[..3000]).expect("written");
    let told = complaint(&["detector", "show", text(&at("torn.json"))]);
    assert!(told.contains("torn.json: this is no detector file") && told.contains("column"), "{told}");
}

/// Real sequences: learned from the first 60 % of the frames, judged by the last 25 %.
#[test]
fn real_objects_are_found_in_later_frames() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shared = std::env::var_os("MOBEE_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    let sequences = shared.join("data/vision/detector");
    if !sequences.is_dir() {
        eprintln!(
            "SKIPPED: there are no recorded sequences at {}; MOBEE_SHARED names another place",
            sequences.display()
        );
        return;
    }
    let dir = tempfile::tempdir().expect("a folder");
    for (object, kind, least) in [("blackswan", "color", 0.8), ("camel", "cgp", 0.85)] {
        let (early, late) = (dir.path().join(format!("{object}-early")), dir.path().join(format!("{object}-late")));
        for folder in [&early, &late] {
            std::fs::create_dir(folder).expect("a folder");
        }
        let files = std::fs::read_dir(sequences.join(object)).expect("the sequence");
        let mut frames: Vec<PathBuf> = files.map(|f| f.expect("a file").path()).collect();
        frames.retain(|f| f.extension().is_some_and(|e| e == "jpg"));
        frames.sort();
        for (i, frame) in frames.iter().enumerate() {
            let to = match 100 * i / frames.len() {
                0..60 => &early,
                75.. => &late,
                _ => continue,
            };
            let stem = frame.file_stem().expect("a name").to_string_lossy().into_owned();
            for name in [format!("{stem}.jpg"), format!("{stem}_mask.png")] {
                std::fs::copy(frame.with_file_name(&name), to.join(&name)).expect("copied");
            }
        }
        let detector = dir.path().join(format!("{object}.json"));
        let minutes: &[&str] = if kind == "cgp" { &["--minutes", "0"] } else { &[] };
        let train = ["detector", "train", "--images", text(&early), "--out", text(&detector), "--kind", kind];
        answer(&[&train[..], minutes].concat());
        let mcc = mcc(&detector, &late);
        assert!(mcc > least, "{object}, {kind}: {mcc}");
    }
}
