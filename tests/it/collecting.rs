//! Two robots that teach each other, as a user meets it: a run in which one looks at what the other holds, a table of that, and the best
//! kind of locator; and runs that teach nothing, refused with place and remedy.

use super::common::{answer, complaint, text};
use mobee::run::example_in;
use std::path::Path;

fn run(folder: &Path, behavior: &str, secs: u32) {
    let length = format!("for_s={secs}");
    example_in(folder, &format!("configs/behaviors/{behavior}.toml"), &["record.enabled=false", &length])
        .expect("a run");
}

#[test]
fn what_one_robot_holds_teaches_the_other_ones_eyes() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (folder, table, best) = (at("run"), at("block.csv"), at("best.json"));
    run(&folder, "collect", 300);
    let collect = ["locator", "collect", text(&folder), "--out", text(&table)];
    let told = answer(&collect);
    for part in ["1200 pictures", " 0 gross errors", "balance ", "coverage ", "place 5 "] {
        assert!(told.contains(part), "{part}: {told}");
    }
    let rows = std::fs::read_to_string(&table).expect("a table").lines().count() - 1;
    assert!(rows > 40 && told.contains(&format!("{rows} rows")), "{told}");
    assert!(complaint(&collect).contains("--force"));
    let told = answer(&["locator", "best", "--data", text(&table), "--out", text(&best)]);
    assert!(told.contains("network") && told.contains("ensemble"), "{told}");
    assert!(told.contains("best.json: calibrated") || told.contains("best.json: triangulate"), "{told}");
    let told = answer(&["locator", "eval", "--locator", text(&best), "--data", text(&table), "--json"]);
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    assert!(told["all"]["single"]["mean_mm"].as_f64().is_some_and(|mm| mm < 10.0), "{told}");

    // a run that goes on has a journal and tracks that stop anywhere
    let journal = folder.join("journal.jsonl");
    let whole = std::fs::read(&journal).expect("a journal");
    std::fs::remove_file(folder.join("journal.seal")).expect("a seal");
    std::fs::write(&journal, &whole[..whole.len() / 2]).expect("written");
    let track = folder.join("poses-katana.track");
    let poses = std::fs::read(&track).expect("poses");
    std::fs::write(&track, &poses[..poses.len() * 2 / 3]).expect("written");
    let again = [&collect[..], &["--force"]].concat();
    let told = answer(&again);
    assert!(!told.contains("1200 pictures") && told.contains("place 2 "), "{told}");
    // one that was changed is no journal
    let changed = String::from_utf8(whole).expect("text").replacen("\"seed\":1", "\"seed\":2", 1);
    std::fs::write(&journal, changed).expect("written");
    assert!(complaint(&again).contains("journal.jsonl:2:"));
    std::fs::remove_file(&track).expect("poses");
    assert!(complaint(&again).contains("no measured poses of katana"));
}

#[test]
fn runs_without_eyes_or_without_a_robot_that_holds_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (blind, alone, table) = (at("blind"), at("alone"), at("block.csv"));
    run(&blind, "conflict", 1);
    run(&alone, "look", 1);
    let refused = |folder: &Path, more: &[&str], expected: &str| {
        let told = complaint(&[&["locator", "collect", text(folder), "--out", text(&table)], more].concat());
        assert!(told.contains(expected) && !table.exists(), "{expected}: {told}");
    };
    refused(&at("nowhere"), &[], "is no run: it has no journal.jsonl");
    refused(&blind, &[], "no sensor looked there");
    refused(&alone, &[], "no other robot of");
    refused(&alone, &["--sensor", "ears"], "did you mean `eyes`");
}
