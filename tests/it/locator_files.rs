//! `mobee locator` as a user meets it: learned from a table, judged by another, shown; and what teaches nothing, refused with place and
//! remedy.

use super::common::{answer, complaint, text};
use mobee_sensing::locators::head::HeadKind;
use mobee_sensing::locators::lens::Lens;
use mobee_sensing::locators::model::HeadModel;
use mobee_sensing::locators::parameters::PlaceFrame;
use nalgebra::{Matrix3, Vector3};
use std::fmt::Write;
use std::path::Path;

const HEADER: &str = "lcx,lcy,rcx,rcy,neck_pitch,neck_roll,neck_yaw,eyes_tilt,eyes_version,eyes_vergence,torso_yaw,torso_roll,torso_pitch,\
                      x_mm,y_mm,z_mm";

/// What a head whose neck is off by three degrees sees of a grid of places, in the frame of an arm 0.9 m before it.
pub(super) fn table(path: &Path, shift: f64) {
    let frame = PlaceFrame { rotation: Matrix3::identity(), origin: Vector3::new(-0.9, 0.0, 0.1) };
    let mut model = HeadModel::nominal(HeadKind::V1, Lens::icub(), frame);
    model.theta[3] = 3.0_f64.to_radians();
    let mut rows = format!("{HEADER}\n");
    for i in 0..90 {
        let wave = |k: f64| (k * f64::from(i) + 1.0).sin();
        let place = Vector3::new(0.45 + 0.1 * wave(0.7), 0.15 * wave(1.3), 0.05 + 0.1 * wave(2.1)).add_scalar(shift);
        let degrees = [
            10.0 + 8.0 * wave(0.9),
            5.0 * wave(1.1),
            8.0 * wave(1.7),
            -12.0 + 8.0 * wave(2.3),
            4.0 * wave(0.3),
            6.0 * wave(1.9),
            5.0 * wave(2.9),
            6.0 * wave(0.5),
            5.0 + 4.0 * wave(3.1),
        ];
        let Some(p) = model.pixels(&degrees.map(f64::to_radians), &place) else { continue };
        let [tp, tr, ty, np, nr, ny, et, ev, eg] = degrees;
        let [x, y, z] = [place.x, place.y, place.z].map(|m| 1e3 * m);
        let _ = writeln!(
            rows,
            "{},{},{},{},{np},{nr},{ny},{et},{ev},{eg},{ty},{tr},{tp},{x},{y},{z}",
            p[0], p[1], p[2], p[3]
        );
    }
    std::fs::write(path, rows).expect("written");
}

#[test]
fn a_locator_is_learned_judged_and_shown() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (data, later) = (at("data.csv"), at("later.csv"));
    table(&data, 0.0);
    table(&later, 0.02);
    let mean = |kind: &str| {
        let out = at(&format!("{kind}.json"));
        let told =
            answer(&["locator", "train", "--data", text(&data), "--kind", kind, "--out", text(&out), "--seed", "3"]);
        assert!(told.contains(kind) && told.contains("without boxes"), "{told}");
        let told = answer(&["locator", "eval", "--locator", text(&out), "--data", text(&later), "--json"]);
        let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
        assert_eq!(told["kind"], kind);
        assert_eq!(told["all"]["single"]["n"], told["unclipped"]["single"]["located"]);
        for of in ["single", "fused"] {
            assert!(told["all"][of]["inside_95"].as_f64().is_some_and(|share| share > 0.5), "{told}");
        }
        told["all"]["single"]["mean_mm"].as_f64().expect("a mean")
    };
    let (drawn, fitted) = (mean("triangulate"), mean("calibrated"));
    assert!(fitted < 2.0 && fitted < drawn, "{fitted} {drawn}");
    mean("network");
    let calibrated = at("calibrated.json");
    let shown = answer(&["locator", "show", text(&calibrated)]);
    assert!(
        shown.starts_with("calibrated, seed 3, learned from the table ") && shown.contains("neck_pitch"),
        "{shown}"
    );
    let plain = answer(&["locator", "eval", "--locator", text(&calibrated), "--data", text(&later)]);
    assert!(plain.contains("single views, unclipped"), "{plain}");
    let again = complaint(&["locator", "train", "--data", text(&data), "--out", text(&calibrated)]);
    assert!(again.contains("--force"), "{again}");
}

#[test]
fn what_teaches_nothing_or_is_no_locator_is_refused_with_its_place() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (data, out) = (at("data.csv"), at("out.json"));
    let train = ["locator", "train", "--data", text(&data), "--out", text(&out)];
    assert!(complaint(&train).contains("can't read"));
    table(&data, 0.0);
    let whole = std::fs::read_to_string(&data).expect("a table");
    let broken = |what: String, expected: &[&str]| {
        std::fs::write(&data, what).expect("written");
        let told = complaint(&train);
        assert!(expected.iter().all(|e| told.contains(e)) && told.contains("help:"), "{told}");
        assert!(!out.exists(), "nothing half-learned");
    };
    broken(whole.replacen("neck_yaw,", "", 1), &["data.csv", "line 1"]);
    broken(whole.lines().take(9).collect::<Vec<_>>().join("\n"), &["data.csv", "8 views of 8 places are too few"]);
    let mut torn: Vec<&str> = whole.lines().collect();
    torn[4] = &torn[4][..20];
    broken(torn.join("\n"), &["line 5", "16 columns"]);
    broken(whole.replacen("x_mm,y_mm,z_mm", "cell_x,cell_y,z_mm", 1), &["cells of a table"]);
    std::fs::write(&data, whole).expect("written");
    answer(&train);
    std::fs::write(at("torn.json"), &std::fs::read(&out).expect("a locator")[..3000]).expect("written");
    let told = complaint(&["locator", "show", text(&at("torn.json"))]);
    assert!(told.contains("torn.json: this is no locator file") && told.contains("column"), "{told}");
}
