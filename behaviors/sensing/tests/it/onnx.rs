//! The kind `onnx`: networks written byte by byte by this test detect what they are made to detect,
//! and files that are not such networks are rejected with place and remedy.

mod written;

use mobee_contract::{Context, Detector, Frame, Intrinsics, Kind, KindError, Region, Time, kinds};
use mobee_model::{Robot, load_robot};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::{Arc, LazyLock};
use written::{Graph, constant, input, node};

static ROBOT: LazyLock<Arc<Robot>> = LazyLock::new(|| {
    Arc::new(load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml")).expect("a robot").value)
});

fn build(settings: &Value) -> Result<Box<dyn Detector>, KindError> {
    let kind: &Kind<dyn Detector> =
        kinds().into_iter().find(|k: &&Kind<dyn Detector>| k.name == "onnx").expect("the kind");
    (kind.build)(settings, &Context { robot: Arc::clone(&ROBOT), seed: 0 })
}

/// Required by the runtime, and written by all exporters.
const STEPS: &[(&str, &[u64])] = &[("strides", &[1, 1]), ("dilations", &[1, 1]), ("pads", &[0, 0, 0, 0])];

/// Detects reddish pixels: a convolution of one pixel with a positive output if red is well above
/// green and blue, inputs 0 to 1.
fn reddish(size: [Option<u64>; 2]) -> Graph {
    Graph {
        nodes: vec![node("Conv", &["picture", "weights", "bias"], &["logits"], STEPS)],
        constants: vec![constant("weights", &[1, 3, 1, 1], &[20.0, -10.0, -10.0]), constant("bias", &[1], &[-4.0])],
        inputs: vec![input("picture", &[Some(1), Some(3), size[1], size[0]])],
        outputs: vec!["logits".into()],
    }
}

/// The same with the channel last, with a second class for blue, and one for the rest.
fn two_classes() -> Graph {
    let weights = [0.0, 0.0, 0.0, 20.0, -10.0, -10.0, -10.0, -10.0, 20.0];
    Graph {
        nodes: vec![
            node("Transpose", &["picture"], &["turned"], &[("perm", &[0, 3, 1, 2])]),
            node("Conv", &["turned", "weights", "bias"], &["logits"], STEPS),
        ],
        constants: vec![constant("weights", &[3, 3, 1, 1], &weights), constant("bias", &[3], &[0.0, -4.0, -4.0])],
        inputs: vec![input("picture", &[Some(1), Some(60), Some(80), Some(3)])],
        outputs: vec!["logits".into()],
    }
}

/// Returns the same boxes for every image.
fn boxes(rows: &[&[f32]]) -> Graph {
    let shape = [1, rows.len() as u64, rows[0].len() as u64];
    Graph {
        nodes: vec![
            node("ReduceMean", &["picture"], &["level"], &[("keepdims", &[0])]),
            node("Mul", &["level", "nothing"], &["zero"], &[]),
            node("Add", &["zero", "table"], &["boxes"], &[]),
        ],
        constants: vec![constant("nothing", &[1], &[0.0]), constant("table", &shape, &rows.concat())],
        inputs: vec![input("picture", &[Some(1), Some(3), Some(32), Some(64)])],
        outputs: vec!["boxes".into()],
    }
}

/// Creates an image of a red disk, and a blue one at the left border, on gray.
fn frame() -> Frame {
    let (width, height) = (160u32, 120u32);
    let near = |k: u32, x: f64, y: f64| (f64::from(k % width) + 0.5 - x).hypot(f64::from(k / width) + 0.5 - y) < 20.0;
    let color = |k: u32| match k {
        k if near(k, 90.0, 60.0) => [200, 50, 40],
        k if near(k, 5.0, 80.0) => [40, 60, 210],
        k => [100 + (k % 7) as u8; 3],
    };
    let intrinsics =
        Intrinsics { size: [width, height], focal: [130.0; 2], center: [80.0, 60.0], distortion: [0.0; 4] };
    let pixels: Vec<u8> = (0..width * height).flat_map(color).collect();
    Frame { exposed: Time::ZERO, intrinsics, pixels: pixels.into() }
}

fn save(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("written");
    path.to_string_lossy().into_owned()
}

fn near(region: &Region, center: [f64; 2], pixels: f64) -> bool {
    region.center.iter().zip(center).all(|(a, b)| (a - b).abs() < pixels)
}

#[test]
fn a_mask_tells_each_class_and_what_the_border_cuts() {
    let dir = tempfile::tempdir().expect("a folder");
    let one = save(dir.path(), "one.onnx", &reddish([None, None]).bytes());
    let cup = json!([{ "object": "cup" }]);
    for size in [[160, 120], [80, 60], [200, 100]] {
        let settings = json!({ "file": one, "input": { "size": size }, "output": { "means": "mask" }, "objects": cup });
        let found = build(&settings).expect("a detector").detect(&frame());
        let [region] = &found[..] else { panic!("{found:?}") };
        assert!(region.object == "cup" && near(region, [90.0, 60.0], 0.3), "{size:?}: {region:?}");
        assert!((region.area - 1256.0).abs() < 70.0 && !region.is_clipped && region.confidence > 0.1, "{region:?}");
        assert!(region.pose.is_none());
    }
    // The other order of colors: red is blue to it.
    let settings = json!({
        "file": one, "input": { "size": [160, 120], "colors": "bgr" }, "output": { "means": "mask" }, "objects": cup,
    });
    let found = build(&settings).expect("a detector").detect(&frame());
    assert!(found.len() == 1 && found[0].is_clipped && found[0].center[0] < 15.0, "{found:?}");

    let two = save(dir.path(), "two.onnx", &two_classes().bytes());
    let settings = json!({
        "file": two, "input": { "layout": "nhwc", "std": [255, 255, 255] }, "output": { "means": "mask", "name": "logits" },
        "objects": [{ "class": 1, "object": "cup" }, { "class": 2, "object": "ball" }],
    });
    let found = build(&settings).expect("a detector").detect(&frame());
    let names: Vec<&str> = found.iter().map(|r| r.object.as_str()).collect();
    assert_eq!(names, ["cup", "ball"]);
    assert!(near(&found[0], [90.0, 60.0], 0.3) && !found[0].is_clipped && found[1].is_clipped, "{found:?}");
    let again = build(&settings).expect("a detector").detect(&frame());
    assert_eq!(found, again);
}

#[test]
fn boxes_are_told_once_each_in_pixels_of_the_picture() {
    let dir = tempfile::tempdir().expect("a folder");
    // Two almost equal ones, one of another class at the same place, one below the threshold, one
    // of no size, one at the border.
    let rows: [&[f32]; 6] = [
        &[8.0, 4.0, 24.0, 20.0, 0.8, 0.0],
        &[9.0, 4.0, 25.0, 20.0, 0.9, 0.0],
        &[9.0, 4.0, 25.0, 20.0, 0.7, 1.0],
        &[40.0, 4.0, 60.0, 20.0, 0.3, 0.0],
        &[40.0, 4.0, 40.0, 20.0, 0.9, 0.0],
        &[50.0, 10.0, 70.0, 30.0, 0.6, 1.0],
    ];
    let file = save(dir.path(), "boxes.onnx", &boxes(&rows).bytes());
    let objects = json!([{ "class": 0, "object": "cup" }, { "class": 1, "object": "ball" }]);
    let settings = json!({ "file": file, "output": { "means": "boxes" }, "objects": objects });
    let found = build(&settings).expect("a detector").detect(&frame());
    let told: Vec<(&str, [f64; 4])> = found.iter().map(|r| (r.object.as_str(), r.bounds)).collect();
    // 64x32 pixels of the network are 160x120 of the image.
    let wide = [22.5, 15.0, 62.5, 75.0];
    assert_eq!(told, [("cup", wide), ("ball", wide), ("ball", [125.0, 37.5, 160.0, 112.5])]);
    assert!((found[0].confidence - 0.9).abs() < 1e-6 && found[2].is_clipped && !found[0].is_clipped);
    assert_eq!(found[0].center, [42.5, 45.0]);

    // Columns, centers, a score for each class, shares of the image.
    let columns: [&[f32]; 6] = [&[0.5], &[0.5], &[0.2], &[0.4], &[0.1], &[0.95]];
    let file = save(dir.path(), "columns.onnx", &boxes(&columns).bytes());
    let output =
        json!({ "means": "boxes", "along": "columns", "place": "middle", "unit": "shares", "scores": "classes" });
    let settings = json!({ "file": file, "output": output, "objects": objects });
    let found = build(&settings).expect("a detector").detect(&frame());
    let [ball] = &found[..] else { panic!("{found:?}") };
    let right = [64.0, 36.0, 96.0, 84.0];
    assert!(ball.object == "ball" && ball.bounds.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-3), "{ball:?}");
}

/// Errors for invalid settings and files.
fn refused(settings: &Value, path: &str, said: &str) {
    let error = build(settings).err().unwrap_or_else(|| panic!("{settings} is taken"));
    let all: Vec<String> = error.clone().all().iter().map(|e| format!("{}: {}", e.path, e.what)).collect();
    let is_said = all.iter().any(|e| e.starts_with(path) && e.contains(said));
    assert!(is_said && !error.help.is_empty(), "{path}, {said}: {error:?}");
}

#[test]
fn files_that_are_no_such_network_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let whole = reddish([Some(160), Some(120)]).bytes();
    let mask = json!({ "means": "mask" });
    let settings = |file: &str| json!({ "file": file, "output": mask, "objects": [{ "object": "cup" }] });
    let wrong = |name: &str, graph: Graph| settings(&save(dir.path(), name, &graph.bytes()));
    let mut said = Vec::new();
    for (name, bytes) in [
        ("empty", &b""[..]),
        ("text", b"a network, honestly"),
        ("half", &whole[..whole.len() / 2]),
        ("cut", &whole[..whole.len() - 5]),
    ] {
        said.push((settings(&save(dir.path(), name, bytes)), "file", "no network"));
    }
    said.push((settings(&dir.path().join("nowhere").to_string_lossy()), "file", "can't read"));
    said.push((settings(&dir.path().to_string_lossy()), "file", "can't read"));
    let flat = Graph { inputs: vec![input("picture", &[Some(1), Some(3), Some(9)])], ..reddish([None, None]) };
    said.push((wrong("flat", flat), "input.layout", "[1, 3, 9]"));
    let gray = Graph { inputs: vec![input("picture", &[Some(1), Some(1), Some(9), Some(9)])], ..reddish([None, None]) };
    said.push((wrong("gray", gray), "input.layout", "[1, 1, 9, 9]"));
    said.push((wrong("open", reddish([None, None])), "input.size", "leaves"));
    let mut nan = reddish([Some(16), Some(12)]);
    nan.constants[1] = constant("bias", &[1], &[f32::NAN]);
    said.push((wrong("nan", nan), "file", "NaN"));
    let two = Graph {
        inputs: vec![input("picture", &[Some(1), Some(3), Some(9), Some(9)]), input("more", &[Some(1)])],
        ..reddish([None, None])
    };
    said.push((wrong("two", two), "file", "2 inputs"));
    said.push((wrong("table", boxes(&[&[0.0; 6], &[0.0; 6]])), "objects[0].class", "no class 3"));
    for (settings, ..) in said.iter_mut().filter(|s| s.1 == "objects[0].class") {
        settings["objects"] = json!([{ "class": 3, "object": "cup" }]);
    }
    let good = save(dir.path(), "good.onnx", &whole);
    let with = |change: Value| {
        let mut all = settings(&good);
        all.as_object_mut().expect("a table").extend(change.as_object().expect("a table").clone());
        all
    };
    said.push((with(json!({ "input": { "name": "image" } })), "input.name", "image"));
    said.push((with(json!({ "output": { "means": "mask", "name": "logit" } })), "output.name", "logit"));
    said.push((with(json!({ "output": { "means": "boxes" } })), "output", "dimensions"));
    said.push((with(json!({ "input": { "size": [80, 60] } })), "input.size", "160 pixels wide"));
    said.push((with(json!({ "input": { "std": [0, 1, 1] } })), "input.std", "divided"));
    said.push((with(json!({ "objects": [] })), "objects", "nothing to find"));
    said.push((with(json!({ "threshold": 0 })), "threshold", "threshold"));
    said.push((with(json!({ "output": { "means": "mask", "keep": 2 } })), "output.keep", "share"));
    for (settings, path, what) in &said {
        refused(settings, path, what);
    }
    assert!(build(&with(json!({}))).is_ok(), "and this one is good");
}

#[test]
fn bytes_that_are_changed_make_another_network_or_none_and_stop_nothing() {
    let dir = tempfile::tempdir().expect("a folder");
    let whole = two_classes().bytes();
    let (mut taken, mut refused) = (0, 0);
    for at in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= [0x01, 0x80, 0x3f][at % 3];
        let file = save(dir.path(), "changed.onnx", &bytes);
        let settings = json!({
            "file": file, "input": { "layout": "nhwc" }, "output": { "means": "mask" }, "objects": [{ "class": 1, "object": "cup" }],
        });
        match build(&settings) {
            Ok(mut detector) => {
                detector.detect(&frame());
                taken += 1;
            }
            Err(error) => {
                assert!(!error.help.is_empty(), "{error:?}");
                refused += 1;
            }
        }
    }
    assert!(taken > 20 && refused > 20, "{taken} taken, {refused} refused");
}
