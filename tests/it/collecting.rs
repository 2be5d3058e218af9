//! Two robots that teach each other, as a user meets it: a run in which one looks at what the other holds, a table of that, the best
//! kind of locator, and a sensor that goes on by it; and runs that teach nothing, refused with place and remedy.

use super::common::pictures::network;
use super::common::{answer, complaint, text};
use super::real_time::ctl::Run;
use mobee::run::{Folder, example_in};
use mobee_contract::{Event, SwapStep};
use mobee_journal::journal;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{BesideOffer, Control, NewBeside};
use nalgebra::Vector3;
use std::path::Path;
use tokio::sync::{mpsc, oneshot};

fn run(folder: &Path, behavior: &str, secs: u32) {
    let length = format!("for_s={secs}");
    example_in(folder, &format!("configs/behaviors/{behavior}.toml"), &["record.enabled=false", &length])
        .expect("a run");
}

#[test]
fn what_one_robot_holds_teaches_the_other_ones_eyes() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (folder, table, best) = (at("collected"), at("block.csv"), at("best.json"));
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

    // the same in one command, from the run into a sensor that is running
    let (live, again) = (Run::start(dir.path(), Path::new("configs/behaviors/collect.toml"), &[]), at("again.json"));
    let one =
        ["locator", "best", text(&folder), "--out", text(&again), "--into", text(&live.out), "--probation", "0.5"];
    let said = answer(&one);
    assert!(said.contains(&format!("{rows} rows")) && said.contains("took over") && said.contains("settled"), "{said}");
    assert_eq!(std::fs::read(&again).expect("a locator"), std::fs::read(&best).expect("a locator"));
    // a detector of any kind goes the same way, a network too
    network(&at("red.onnx"));
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/collect.toml");
    let eye = |name: &str| {
        format!(
            "[[sensor.eye]]\nname = \"{name}\"\ndetector = {{ kind = \"onnx\", file = \"red.onnx\", output = {{ means = \"mask\" }}, \
             objects = [{{ class = 1, object = \"cup\" }}] }}\n"
        )
    };
    let other = format!("include = [{shipped:?}]\n[[sensor]]\nname = \"eyes\"\n{}{}", eye("left"), eye("right"));
    std::fs::write(at("network.toml"), other).expect("written");
    let said = live.says(&["swap", "detector", text(&at("network.toml")), "--probation", "0.5"]);
    assert!(said.contains("settled"), "{said}");
    let kept = at("other.json");
    let told = complaint(&[&one[..3], &["--out", text(&kept), "--into", text(&folder)]].concat());
    assert!(told.contains("can be controlled while it runs") && kept.exists(), "{told}");
    drop(live);

    a_sensor_is_taught_as_it_looks(dir.path(), &table, &best);

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

/// A sensor that places a cup by what networks learned of a block elsewhere, and from 20 s on by the best kind.
fn a_sensor_is_taught_as_it_looks(dir: &Path, table: &Path, best: &Path) {
    let networks = dir.join("networks.json");
    let train = ["locator", "train", "--data", text(table), "--kind", "network", "--head", "v2", "--out"];
    answer(&[&train[..], &[text(&networks)]].concat());
    let kind = answer(&["locator", "show", text(best)]).split(',').next().expect("a kind").to_owned();
    let look = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/look.toml");
    let composed = |kind: &str, file: &Path| {
        let locator = format!("sensor.eyes.locator={{ kind = {kind:?}, file = {file:?} }}");
        let set = ["record.enabled=false", "for_s=40", "script=[]", &locator].map(str::to_owned);
        mobee::compose::read(&look, &set).expect("a composition")
    };
    let taught = composed(&kind, best).sensors.remove(0).locator.expect("a locator").locator;
    let part = NewBeside::Locator { maker: taught, fresh: false };
    let mut offer = Some(BesideOffer { part, what: kind, terms: SwapPolicy::default() });
    let folder = Folder::create("taught", Some(&dir.join("taught"))).expect("a folder");
    let (controls, receiver) = mpsc::channel(1);
    let done = mobee::run::run(composed("network", &networks), &folder, receiver, |progress| {
        if progress.at.secs() >= 20.0
            && let Some(offer) = offer.take()
        {
            let (reply, _) = oneshot::channel();
            controls.try_send(Control::SwapBeside { name: "eyes".into(), offer, reply }).expect("the run hears");
        }
    });
    assert!(mobee::run::in_order(&done.expect("a run").end));
    let (mut off, mut steps): ([Vec<f64>; 2], Vec<SwapStep>) = Default::default();
    for line in journal::read(folder.path()).expect("a journal") {
        match line.expect("whole").event {
            Event::Located { objects, .. } => {
                let cup = Vector3::new(-0.36, 0.04, -0.10);
                let is_taught = steps.iter().any(|step| matches!(step, SwapStep::TookOver { .. }));
                off[usize::from(is_taught)].extend(objects.iter().map(|o| (Vector3::from(o.position) - cup).norm()));
            }
            Event::SwapBeside { step, .. } => steps.push(step),
            _ => {}
        }
    }
    assert!(steps.contains(&SwapStep::Settled), "{steps:?}");
    let [before, after] = off.map(|mut off| {
        off.sort_by(f64::total_cmp);
        off[off.len() / 2]
    });
    println!("the cup is {:.1} mm off in the median before, {:.1} after", 1e3 * before, 1e3 * after);
    assert!(after < 0.02 && after < 0.5 * before, "{before} m before, {after} after");
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
