//! `mobee eyes draw` as a user meets it: pictures and masks that agree with the table beside them, the same for the same seed; and
//! what can't be drawn, refused with place and remedy.

use super::common::{answer, complaint, text};
use std::path::Path;

const CUP: &[&str] = &[
    "eyes",
    "draw",
    "--robot",
    "configs/robots/icub.xml",
    "--world",
    "configs/worlds/cup.xml",
    "--settings",
    "configs/cameras/cup.toml",
];

fn rows(folder: &Path) -> Vec<Vec<String>> {
    let table = std::fs::read_to_string(folder.join("index.csv")).expect("a table");
    table.lines().map(|l| l.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn pictures_masks_and_table_agree_and_a_seed_gives_them_again() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let draw = |out: &str, seed: &str| {
        let told =
            answer(&[CUP, &["--object", "cup", "--count", "2", "--seed", seed, "--out", text(&at(out))]].concat());
        assert!(told.contains("4 pictures of cup from 2 poses"), "{told}");
    };
    draw("first", "5");
    draw("again", "5");
    draw("other", "6");
    let table = rows(&at("first"));
    let column = |name: &str| table[0].iter().position(|n| n == name).expect("a column");
    for row in &table[1..] {
        for eye in ["l_eye", "r_eye"] {
            let mask = at("first").join(format!("{}_{eye}_mask.png", row[0]));
            let mask = image::open(mask).expect("a mask").into_luma8();
            assert_eq!(mask.dimensions(), (320, 240));
            let pixels = mask.pixels().filter(|p| p.0[0] == 255).count();
            assert_eq!(row[column(&format!("{eye}_pixels"))], pixels.to_string());
            assert!(pixels >= 40, "{pixels}");
            let number = |name: &str| row[column(name)].parse::<f64>().expect("a number");
            let (u, v) = (number(&format!("{eye}_u")), number(&format!("{eye}_v")));
            assert!((0.0..320.0).contains(&u) && (0.0..240.0).contains(&v), "{u} {v}");
            assert!((-0.55..=-0.28).contains(&number("x_m")) && number("z_m") == -0.1);
        }
    }
    let same = |a: &str, b: &str, name: &str| {
        std::fs::read(at(a).join(name)).expect("a file") == std::fs::read(at(b).join(name)).expect("a file")
    };
    for name in ["index.csv", "0001_r_eye.png", "0000_l_eye_mask.png"] {
        assert!(same("first", "again", name) && !same("first", "other", name), "{name}");
    }
    // the views are those of the table's rows, in the columns that locators learn from
    let views = std::fs::read_to_string(at("first").join("views.csv")).expect("views");
    let views = mobee_sensing::locators::rows::parse(&views).expect("a table of views");
    assert!(views.has_boxes);
    for view in &views.known {
        let is_it = |row: &&Vec<String>| {
            let number = |name: &str| row[column(name)].parse::<f64>().expect("a number");
            let is_near = |a: f64, b: f64, by: f64| (a - b).abs() < by;
            is_near(number("x_m"), view.place.x, 1e-4)
                && is_near(number("neck_yaw_deg"), view.view.encoders[5].to_degrees(), 1e-2)
                && is_near(number("eyes_verg_deg"), view.view.encoders[8].to_degrees(), 1e-2)
        };
        assert_eq!(table[1..].iter().filter(is_it).count(), 1, "{view:?}");
    }
    // whatever is trained from a folder of these is trained from this one
    let color = at("color.json");
    let first = at("first");
    answer(&["detector", "train", "--kind", "color", "--images", text(&first), "--out", text(&color)]);
    let told = answer(&["detector", "eval", "--detector", text(&color), "--images", text(&first), "--json"]);
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    assert!(told["center_off_pixels"]["median"].as_f64().is_some(), "{told}");
    let told = complaint(&[CUP, &["--object", "cup", "--out", text(&first)]].concat());
    assert!(told.contains("index.csv exists already"), "{told}");
}

#[test]
fn what_can_not_be_drawn_is_refused_with_place_and_remedy() {
    let dir = tempfile::tempdir().expect("a folder");
    let (out, settings) = (dir.path().join("out"), dir.path().join("settings.toml"));
    let told = complaint(&[CUP, &["--object", "cap", "--out", text(&out)]].concat());
    assert!(told.contains("no object cap") && told.contains("cup"), "{told}");
    let draw = [&CUP[..6], &["--object", "cup", "--out", text(&out), "--settings", text(&settings)]].concat();
    for (table, what) in [
        ("motors = [\"neck\"]", "has no motor or part neck"),
        ("[scenery]\nlamp = 1", "there is no key `lamp` here"),
        ("[scenery]\ntexture = 3", "3 is not a usable value here"),
        ("[[camera]]\nmarker = \"l_eye\"\nfps = 0", "0 is not a usable value here"),
        ("[[camera]]\nmarker = \"l_eye\"\n[camera.scenery]\nseed = 3", "this camera has a scenery of its own"),
        ("[scenery.distractors]\ncount = 2\non = \"desk\"", "no object desk"),
        ("motors = [\"right_arm\"]\narea_m = [2.0, 3.0, 0.0, 1.0]", "none has cup in the view of all cameras"),
    ] {
        std::fs::write(&settings, table).expect("written");
        let told = complaint(&draw);
        assert!(told.contains(what), "{table}: {told}");
        assert!(!out.join("index.csv").exists());
    }
}
