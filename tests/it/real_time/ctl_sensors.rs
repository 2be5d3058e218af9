//! Sensors of a run in real time: detectors that kill their process are not taken or taken back, and one that gave up is started again.

use super::ctl::Run;
use crate::common::pictures::{Harm, harmful};
use image::{Rgb, RgbImage};
use std::path::Path;

const ONNX: &str = r#"{ kind = "onnx", file = "FILE", limits = { memory_mib = 1024, seconds = 1 }, output = { means = "mask" }, objects = [{ object = "cup" }] }"#;

fn behavior(dir: &Path, name: &str, detector: &str) -> std::path::PathBuf {
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/katana.xml");
    let text = format!(
        "[[robot]]\nname = \"arm\"\nmodel = {robot:?}\ncontroller = {{ period_ms = 20, history = 6000 }}\n\
         driver = {{ kind = \"sim\", profile = \"ideal\" }}\n[[sensor]]\nname = \"eyes\"\n[[sensor.eye]]\nname = \"left\"\n\
         camera = {{ kind = \"folder\", path = \"pics\", fps = 10, repeat = true }}\ndetector = {detector}\n"
    );
    let path = dir.join(name);
    std::fs::write(&path, text).expect("written");
    path
}

#[test]
fn detectors_that_kill_their_process_do_not_touch_the_run() {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(dir.path().join("pics")).expect("a folder");
    RgbImage::from_pixel(32, 24, Rgb([255; 3])).save(dir.path().join("pics/a.png")).expect("saved");
    let color = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/sensing/cup.detector.json");
    let file = behavior(dir.path(), "run.toml", &format!("{{ kind = \"color\", file = {color:?} }}"));
    let run = Run::start(dir.path(), &file, &[]);
    for (name, harm) in [("deep", Harm::Deep(40_000)), ("wide", Harm::Wide), ("endless", Harm::Endless)] {
        harmful(&dir.path().join(format!("{name}.onnx")), harm);
        let other = behavior(dir.path(), &format!("{name}.toml"), &ONNX.replace("FILE", &format!("{name}.onnx")));
        let out = run.ctl(&["swap", "detector", &other.display().to_string(), "--probation", "1"]);
        assert_eq!(out.status.code(), Some(2), "{name}: {}", crate::common::said(&out));
    }
    // loads and looks at two pictures, and dies on the first of the run
    harmful(&dir.path().join("white.onnx"), Harm::WideOnWhite);
    let other = behavior(dir.path(), "white.toml", &ONNX.replace("FILE", "white.onnx")).display().to_string();
    let out = run.ctl(&["swap", "detector", &other, "--probation", "3"]);
    let told = crate::common::said(&out);
    assert!(out.status.code() == Some(1) && told.contains("1024 MiB of memory"), "{:?}: {told}", out.status);
    let out = run.ctl(&["swap", "detector", &other, "--shadow", "1"]);
    let told = crate::common::said(&out);
    assert!(out.status.code() == Some(1) && told.contains("1024 MiB of memory"), "{:?}: {told}", out.status);
    let status = run.says(&["status"]);
    assert!(status.contains("arm  ARMED") && !status.contains("DOWN"), "{status}");
}

#[test]
fn a_sensor_that_gave_up_is_shown_and_started_again() {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(dir.path().join("pics")).expect("a folder");
    let picture = dir.path().join("pics/a.png");
    RgbImage::from_pixel(32, 24, Rgb([255; 3])).save(&picture).expect("saved");
    harmful(&dir.path().join("white.onnx"), Harm::WideOnWhite);
    let file = behavior(dir.path(), "run.toml", &ONNX.replace("FILE", "white.onnx"));
    let run = Run::start(dir.path(), &file, &[]);
    let shows = |what: &str, there: bool| {
        let is_so = (0..2_000).any(|_| run.says(&["status"]).contains(what) == there);
        assert!(is_so, "{what}: {}", run.says(&["status"]));
    };
    shows("eyes  DOWN: eyes/left/detector died", true);
    // the picture that kills it is replaced: the next life looks at another
    RgbImage::from_pixel(32, 24, Rgb([9; 3])).save(&picture).expect("saved");
    assert!(
        run.refuses(&["restart", "ears"]).contains("there is no sensor or bridge `ears` in this run; there are: eyes")
    );
    assert!(run.says(&["restart", "eyes"]).contains("eyes has been started again"));
    shows("DOWN", false);
    assert!(run.says(&["restart"]).contains("eyes has been started again"), "one that runs, too");
}
