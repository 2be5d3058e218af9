//! `mobee detector` as a user meets it: an object learned from pictures, interrupted or not; judged by others; and what teaches
//! nothing, refused with place and remedy.

use super::common::pictures::{self, Shown};
use super::common::{answer, complaint, text};
use serde_json::Value;
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

/// What `mobee detector eval` tells.
fn judged(detector: &Path, images: &Path, more: &[&str]) -> Value {
    let eval = ["detector", "eval", "--detector", text(detector), "--images", text(images), "--json"];
    serde_json::from_str(&answer(&[&eval[..], more].concat())).expect("JSON")
}

/// The correlation that it tells.
fn mcc(detector: &Path, images: &Path) -> f64 {
    judged(detector, images, &[])["mcc"].as_f64().expect("a correlation")
}

/// A behavior with a sensor whose eyes have these detectors, beside the files that they name.
fn behavior(file: &Path, detectors: &[&str]) {
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/katana.xml");
    let arm = format!(
        "name = \"arm\"\nmodel = {robot:?}\ncontroller = {{ period_ms = 20, history = 6000 }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n"
    );
    let head = format!("[[robot]]\n{arm}[[sensor]]\nname = \"eyes\"\n");
    let eye = |(k, detector): (usize, &&str)| {
        format!(
            "[[sensor.eye]]\nname = \"e{k}\"\ncamera = {{ kind = \"simulated\", marker = \"tool\" }}\ndetector = {detector}\n"
        )
    };
    let eyes: String = detectors.iter().enumerate().map(eye).collect();
    std::fs::write(file, head + &eyes).expect("written");
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

#[test]
fn detectors_of_every_kind_are_judged_by_the_same_pictures() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (square, tag, bare) = (at("square"), at("tag"), at("bare"));
    pictures::draw(&square, 0..6, 0, Shown::Square);
    pictures::draw(&tag, 0..6, 0, Shown::Tag);
    pictures::draw(&bare, 0..6, 0, Shown::Tag);
    for n in 0..6 {
        std::fs::remove_file(bare.join(format!("{n:03}_mask.png"))).expect("a mask");
    }
    pictures::network(&at("red.onnx"));
    let off = |told: &Value, of: &str| told[of]["share_95"].as_f64().expect("pixels");

    let onnx = at("onnx.toml");
    let network = r#"{ kind = "onnx", file = "red.onnx", output = { means = "mask" }, objects = [{ class = 1, object = "cup" }] }"#;
    behavior(&onnx, &[network; 2]);
    let told = judged(&onnx, &square, &[]);
    assert!(told["kind"] == "onnx" && told["object"] == "cup" && told["told"] == 6, "{told}");
    assert!(told["mcc"].as_f64().is_some_and(|mcc| mcc > 0.99) && off(&told, "center_off_pixels") < 0.1, "{told}");
    // where a picture has no mask there is nothing to compare with
    std::fs::copy(bare.join("000.png"), square.join("006.png")).expect("copied");
    let told = judged(&onnx, &square, &[]);
    assert!(told["images"] == 7 && told["masks"] == 6 && told["told"] == 7, "{told}");
    let eval = |detector: &Path, images: &Path, more: &[&str]| {
        complaint(&[&["detector", "eval", "--detector", text(detector), "--images", text(images)], more].concat())
    };
    assert!(eval(&onnx, &bare, &[]).contains("no picture has a mask"));

    let tags = at("tags.toml");
    let both = r#"{ kind = "tag", size_m = 0.06, tags = [{ id = 7, object = "cup" }, { id = 8, object = "jar" }] }"#;
    behavior(&tags, &[network, both]);
    let told = judged(&tags, &tag, &["--sensor", "eyes/e1", "--object", "cup"]);
    assert!(told["mcc"].is_null() && told["pixels"].is_null() && told["told"] == 6 && told["unseen"] == 0, "{told}");
    assert!(off(&told, "center_off_pixels") < 0.3 && off(&told, "box_off_pixels") < 0.6, "{told}");
    let told = judged(&tags, &tag, &["--sensor", "eyes/e1", "--object", "jar"]);
    assert!(told["told"] == 0 && told["unseen"] == 6 && told["center_off_pixels"]["median"].is_null(), "{told}");
    // its number is all that there is to judge, and enough
    assert_eq!(judged(&tags, &bare, &["--sensor", "eyes/e1", "--object", "cup"])["told"], 6);

    // what was learned is the same by itself and in a behavior
    let (color, of_color) = (at("color.json"), at("color.toml"));
    std::fs::remove_file(square.join("006.png")).expect("removed");
    answer(&["detector", "train", "--images", text(&square), "--out", text(&color), "--kind", "color"]);
    behavior(&of_color, &[r#"{ kind = "color", file = "color.json" }"#]);
    assert_eq!(judged(&color, &square, &[]), judged(&of_color, &square, &[]));

    for (detector, more, expected) in [
        (&tags, &[][..], "which detector of"),
        (&tags, &["--sensor", "ears"][..], "there is no sensor or camera `ears`"),
        (&tags, &["--sensor", "eyes/e1"][..], "give --object; there are: cup, jar"),
        (&tags, &["--sensor", "eyes/e1", "--object", "cap"][..], "did you mean `cup`"),
        (&color, &["--sensor", "eyes"][..], "leave out --sensor"),
    ] {
        let told = eval(detector, &square, more);
        assert!(told.contains(expected), "{expected}: {told}");
    }
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
