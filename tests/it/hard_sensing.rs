//! What cameras, detectors and their files can do to a run: nothing but to be refused, skipped, counted or to end by themselves.

use super::common::pictures::{Harm, harmful};
use super::common::{mobee_in, said};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Address space of the program, kB.
const MEMORY_KB: u64 = 1_500_000;
/// Longest wait for the program, s.
const PATIENCE_S: u32 = 120;

/// A behavior with a sensor, its pictures in `pics/`.
struct Eye {
    dir: tempfile::TempDir,
}

impl Eye {
    fn new(camera: &str, detector: &str) -> Eye {
        let dir = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(dir.path().join("pics")).expect("a folder");
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/katana.xml");
        let text = format!(
            "[[robot]]\nname = \"arm\"\nmodel = {robot:?}\ncontroller = {{ period_ms = 20, history = 6000 }}\n\
             driver = {{ kind = \"sim\", profile = \"ideal\" }}\n[[sensor]]\nname = \"eyes\"\n[[sensor.eye]]\nname = \"left\"\n\
             camera = {camera}\ndetector = {detector}\n"
        );
        std::fs::write(dir.path().join("eye.toml"), text).expect("written");
        Eye { dir }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn picture(&self, name: &str, size: [u32; 2], color: impl Fn(u32, u32) -> [u8; 3]) {
        RgbImage::from_fn(size[0], size[1], |x, y| Rgb(color(x, y)))
            .save(self.at(&format!("pics/{name}")))
            .expect("saved");
    }

    /// The program, within bounds of memory and time.
    fn mobee(&self, args: &[&str]) -> Output {
        let program = mobee_in(self.dir.path());
        let script = format!("ulimit -v {MEMORY_KB} && exec timeout {PATIENCE_S} \"$0\" \"$@\"");
        let mut shell = Command::new("sh");
        shell.args(["-c", &script]).arg(program.get_program()).args(args).current_dir(self.dir.path());
        shell.env("NO_COLOR", "1").stdin(std::process::Stdio::null()).output().expect("the shell starts")
    }

    /// Runs for so long, and returns the exit code, what it said, and the summary.
    fn run(&self, secs: &str) -> (Option<i32>, String, Value) {
        let out = self.mobee(&["run", "eye.toml", "--for", secs, "--no-record", "--out", "run"]);
        let summary = std::fs::read_to_string(self.at("run/summary.json")).unwrap_or_default();
        (out.status.code(), said(&out), serde_json::from_str(&summary).unwrap_or_default())
    }

    fn refused(&self, args: &[&str], words: &str) {
        let out = self.mobee(args);
        let told = said(&out);
        assert!(
            out.status.code() == Some(2) && told.contains(words) && told.contains("help"),
            "{args:?}: {:?} {told}",
            out.status
        );
    }

    fn events(&self, kind: &str) -> Vec<Value> {
        let journal = std::fs::read_to_string(self.at("run/journal.jsonl")).expect("a journal");
        let lines = journal.lines().skip(1).map(|l| serde_json::from_str::<Value>(l).expect("JSON"));
        lines.map(|l| l["event"].clone()).filter(|e| e["event"] == kind).collect()
    }
}

const FOLDER: &str = r#"{ kind = "folder", path = "pics", fps = 10, repeat = true }"#;
const ONNX: &str = r#"{ kind = "onnx", file = "net.onnx", limits = { memory_mib = 1024, seconds = 1 }, output = { means = "mask", values = "logits" }, objects = [{ class = 0, object = "cup" }] }"#;

fn shipped() -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/sensing/cup.detector.json");
    format!("{{ kind = \"color\", file = {file:?} }}")
}

#[test]
fn pipes_in_the_place_of_pictures_are_refused_at_once() {
    let pipe = |eye: &Eye, name: &str| {
        let made = Command::new("mkfifo").arg(eye.at(name)).status().expect("mkfifo starts");
        assert!(made.success());
    };
    let eye = Eye::new(FOLDER, &shipped());
    pipe(&eye, "pics/a.png");
    for args in [
        &["check", "eye.toml"][..],
        &["run", "eye.toml", "--out", "run"],
        &["detector", "train", "--images", "pics", "--out", "x.json"],
    ] {
        eye.refused(args, "a.png");
    }
    std::fs::remove_file(eye.at("pics/a.png")).expect("removed");
    eye.picture("a.png", [32, 24], |_, _| [9; 3]);
    pipe(&eye, "pics/a_mask.png");
    eye.refused(&["detector", "train", "--images", "pics", "--out", "x.json"], "a_mask.png");
    eye.refused(&["detector", "eval", "--detector", "eye.toml", "--object", "cup", "--images", "pics"], "a_mask.png");
    let sticker = r#"{ kind = "simulated", marker = "tool", scenery = { stickers = [{ on = "post", picture = "tag.png", width_m = 0.1 }] } }"#;
    let eye = Eye::new(sticker, &shipped());
    pipe(&eye, "tag.png");
    eye.refused(&["check", "eye.toml"], "tag.png");
    let walls = r#"{ kind = "simulated", marker = "tool", scenery = { pictures = "pics" } }"#;
    let eye = Eye::new(walls, &shipped());
    pipe(&eye, "pics/wall.jpg");
    eye.refused(&["check", "eye.toml"], "wall.jpg");
    std::fs::remove_file(eye.at("pics/wall.jpg")).expect("removed");
    std::fs::create_dir(eye.at("pics/wall.jpg")).expect("a folder");
    eye.refused(&["check", "eye.toml"], "wall.jpg");
}

#[test]
fn a_camera_goes_on_behind_a_torn_picture() {
    let eye = Eye::new(r#"{ kind = "folder", path = "pics", fps = 10 }"#, &shipped());
    (0..60).for_each(|n| eye.picture(&format!("{n:03}.png"), [32, 24], |x, y| [x as u8, y as u8, n as u8]));
    // in either format: a decoder of JPEG shows gray for what is missing
    let photo = eye.at("pics/006.jpg");
    let color = |x: u32, y: u32| Rgb([x as u8, y as u8, (x * y) as u8]);
    RgbImage::from_fn(32, 24, color).save(&photo).expect("saved");
    let bytes = std::fs::read(&photo).expect("a picture");
    std::fs::write(&photo, &bytes[..bytes.len() - 40]).expect("written");
    let torn = eye.at("pics/005.png");
    let whole = std::fs::read(&torn).expect("a picture");
    std::fs::write(&torn, &whole[..whole.len() / 2]).expect("written");
    let (code, told, summary) = eye.run("7");
    assert_eq!(code, Some(0), "{told}");
    assert!(eye.events("sighted").len() >= 57 && eye.events("restarted").is_empty(), "{told}");
    assert_eq!(summary["counters"]["pictures_skipped"], 2, "{summary}");
    assert_eq!(told.matches("005.png: this is no whole picture").count(), 1, "{told}");
}

#[test]
fn regions_beyond_what_is_useful_stay_out_of_the_journal() {
    let eye = Eye::new(FOLDER, r#"{ kind = "color", file = "all.json" }"#);
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/sensing/cup.detector.json");
    let mut file: Value = serde_json::from_str(&std::fs::read_to_string(shipped).expect("a detector")).expect("JSON");
    let bins = file["colors"].as_array().expect("colors").len();
    let mut colors = vec![0; bins];
    // white, in the last bin of brightness and the middle of both opponents
    colors[(15 * 32 + 16) * 32 + 16] = 255;
    (file["colors"], file["shrink"]) = (json!(colors), json!(1));
    file["smoothing"] = json!({ "radius": 0, "at_edges": false });
    file["cut"] = json!({ "threshold": 128.0, "open": false, "keep": 0.0 });
    std::fs::write(eye.at("all.json"), file.to_string()).expect("written");
    eye.picture("a.png", [1024, 1024], |x, y| [255 * ((x + y) % 2) as u8; 3]);
    let (code, told, summary) = eye.run("1");
    assert_eq!(code, Some(0), "{told}");
    let seen = eye.events("sighted");
    assert!(!seen.is_empty());
    for event in &seen {
        assert_eq!((event["regions"].as_array().map(Vec::len), &event["omitted"]), (Some(16), &json!(1024 * 512 - 16)));
    }
    assert!(summary["counters"]["regions_omitted"].as_u64() > Some(500_000), "{summary}");
    assert_eq!(told.matches("beyond the first 16 of each object").count(), 1, "{told}");
    let size = std::fs::metadata(eye.at("run/journal.jsonl")).expect("a journal").len();
    assert!(size < 400_000, "{size} bytes");
    // a setting says how many
    std::fs::remove_dir_all(eye.at("run")).expect("removed");
    let text = std::fs::read_to_string(eye.at("eye.toml")).expect("a text");
    std::fs::write(eye.at("eye.toml"), text.clone() + "max_regions = 2\n").expect("written");
    eye.run("0.5");
    assert_eq!(eye.events("sighted")[0]["regions"].as_array().map(Vec::len), Some(2));
    std::fs::write(eye.at("eye.toml"), text + "max_regions = 0\n").expect("written");
    eye.refused(&["check", "eye.toml"], "max_regions");
    // and the object's name is no book
    file["object"] = json!("x".repeat(1 << 20));
    std::fs::write(eye.at("all.json"), file.to_string()).expect("written");
    std::fs::write(
        eye.at("eye.toml"),
        std::fs::read_to_string(eye.at("eye.toml")).expect("a text").replace("max_regions = 0", ""),
    )
    .expect("written");
    eye.refused(&["check", "eye.toml"], "1048576");
}

#[test]
fn networks_that_no_process_survives_are_refused() {
    let eye = Eye::new(FOLDER, ONNX);
    eye.picture("a.png", [32, 24], |_, _| [9; 3]);
    for (harm, words) in [
        (Harm::Deep(80_000), "nested too deeply"),
        (Harm::Wide, "more than 1024 MiB of memory"),
        (Harm::Endless, "more than 1 s of processor time"),
    ] {
        harmful(&eye.at("net.onnx"), harm);
        let words = words.replace(' ', "\u{1}");
        let out = eye.mobee(&["check", "eye.toml"]);
        let told = said(&out).split_whitespace().filter(|w| *w != "│").collect::<Vec<_>>().join("\u{1}");
        assert!(out.status.code() == Some(2) && told.contains(&words), "{harm:?}: {:?}: {}", out.status, said(&out));
        let out = eye.mobee(&["detector", "eval", "--detector", "eye.toml", "--images", "pics"]);
        assert_eq!(out.status.code(), Some(2), "{harm:?}: {}", said(&out));
    }
}

#[test]
fn a_network_that_dies_in_a_run_ends_its_sensor_alone() {
    let eye = Eye::new(FOLDER, ONNX);
    eye.picture("a.png", [32, 24], |_, _| [255; 3]);
    harmful(&eye.at("net.onnx"), Harm::WideOnWhite);
    let checked = eye.mobee(&["check", "eye.toml"]);
    assert!(checked.status.success(), "{}", said(&checked));
    let (code, told, summary) = eye.run("5");
    assert_eq!(code, Some(4), "{told}");
    assert_eq!((&summary["reason"], &summary["counters"]["gave_up"]), (&json!("time"), &json!(1)), "{summary}");
    let why = summary["counters"]["down"]["eyes"].as_str().expect("it is named");
    assert!(why.contains("the network failed on a picture: it needs more than 1024 MiB"), "{why}");
    assert!(told.contains("gave up") && told.contains("eyes is down: eyes/left/detector died"), "{told}");
    let died = eye.events("died");
    assert!(
        died.len() == 10 && died.iter().all(|e| e["actor"].as_str().is_some_and(|a| a.starts_with("eyes/"))),
        "{died:?}"
    );
    // the same again, event by event
    let first = std::fs::read(eye.at("run/journal.jsonl")).expect("a journal");
    std::fs::remove_dir_all(eye.at("run")).expect("removed");
    eye.run("5");
    assert!(first == std::fs::read(eye.at("run/journal.jsonl")).expect("a journal"), "equal runs");
}
