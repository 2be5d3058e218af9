//! A run that keeps its cameras' frames can be looked at again: by the same detector, which then sees the same, or by another; and the
//! pictures of what was collected can be had beside its table.

use super::common::{answer, complaint, text};
use mobee::run::{example_in, in_order};
use mobee_contract::{Event, Region, Time};
use mobee_journal::journal;
use std::collections::BTreeMap;
use std::path::Path;

/// A run of a shipped behavior in this folder, not recorded.
fn run(folder: &Path, behavior: &str, set: &[&str]) -> mobee::run::Done {
    let set = [&["record.enabled=false"], set].concat();
    let done = example_in(folder, behavior, &set).expect("a run");
    assert!(in_order(&done.end) && done.complaints.is_empty(), "{:?}", done.complaints);
    done
}

/// What each camera's detector saw, by the time of exposure.
fn seen(folder: &Path) -> BTreeMap<(String, Time), Vec<Region>> {
    let lines = journal::read(folder).expect("a journal").map(|line| line.expect("whole").event);
    let seen = lines.filter_map(|event| match event {
        Event::Sighted { camera, exposed, regions, is_shadow: false, .. } => Some(((camera, exposed), regions)),
        _ => None,
    });
    seen.collect()
}

#[test]
fn a_run_looked_at_again_shows_the_same_to_the_same_detector() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (kept, again, look) = (at("kept"), at("again"), "configs/behaviors/look.toml");
    let first = run(&kept, look, &["for_s=5", "sensor.eyes.keep_frames=true"]);
    let second = run(&at("equal"), look, &["for_s=5", "sensor.eyes.keep_frames=true"]);
    assert_eq!(first.hash, second.hash, "what is kept does not change a run");
    let bytes = |run: &str| std::fs::read(at(run).join("eyes.left.frames")).expect("frames");
    assert_eq!(bytes("kept"), bytes("equal"));

    let camera = |eye: &str| {
        format!("sensor.eyes.eye.{eye}.camera={{ kind = \"recorded\", run = {kept:?}, camera = \"eyes/{eye}\" }}")
    };
    let (left, right) = (camera("left"), camera("right"));
    let set = ["for_s=5", "script=[]", &left, &right];
    run(&again, look, &set);
    let (was, is) = (seen(&kept), seen(&again));
    assert!(was.len() > 80 && was.values().any(|regions| !regions.is_empty()), "{} pictures", was.len());
    assert_eq!(was, is);
    // what sees nothing of that kind sees nothing in it
    let blind =
        "sensor.eyes.eye.left.detector={ kind = \"tag\", size_m = 0.064, tags = [{ id = 7, object = \"cup\" }] }";
    run(&at("blind"), look, &[&set[..], &[blind]].concat());
    let left = |seen: &BTreeMap<(String, Time), Vec<Region>>| {
        seen.iter().filter(|((camera, _), regions)| camera == "eyes/left" && !regions.is_empty()).count()
    };
    assert_eq!((left(&seen(&at("blind"))), left(&was) > 0), (0, true));
}

#[test]
fn the_pictures_of_a_table_are_its_rows_and_a_run_that_kept_none_says_so() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (collected, table, images) = (at("collected"), at("block.csv"), at("pictures"));
    run(&collected, "configs/behaviors/collect.toml", &["for_s=60", "sensor.eyes.keep_frames=true"]);
    let collect = |images: &Path, more: &[&str]| -> Vec<String> {
        let args = ["locator", "collect", text(&collected), "--out", text(&table), "--images", text(images)];
        args.iter().chain(more).map(ToString::to_string).collect()
    };
    fn words(args: &[String]) -> Vec<&str> {
        args.iter().map(String::as_str).collect()
    }
    let told = answer(&words(&collect(&images, &[])));
    let rows = std::fs::read_to_string(&table).expect("a table").lines().count() - 1;
    assert!(rows > 3 && told.contains(&format!("pictures: {} pictures", 2 * rows)), "{rows}: {told}");
    let eval = ["detector", "eval", "--detector", "configs/sensing/cup.detector.json", "--images", text(&images)];
    assert!(complaint(&eval).contains("no picture has a mask"), "they can be read, and have no masks yet");
    for row in 1..=rows {
        for eye in ["left", "right"] {
            let picture = image::open(images.join(format!("{row:05}_{eye}.png"))).expect("a picture");
            assert_eq!((picture.width(), picture.height()), (320, 240));
        }
    }
    let told = complaint(&words(&collect(&images, &["--force"])));
    assert!(told.contains("is no empty folder"), "{told}");
    std::fs::remove_file(collected.join("eyes.right.frames")).expect("there");
    std::fs::remove_file(&table).expect("there");
    let told = complaint(&words(&collect(&at("other"), &[])));
    assert!(
        told.contains("kept no frames of a camera eyes/right") && !table.exists() && !at("other").exists(),
        "{told}"
    );
    std::fs::remove_file(collected.join("eyes.left.frames")).expect("there");
    let told = complaint(&words(&collect(&at("other"), &[])));
    assert!(told.contains("kept no frames") && told.contains("keep_frames = true"), "{told}");
}
