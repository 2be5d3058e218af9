//! Every registered agent with every controller setting on every robot: starts, runs ten simulated seconds, holds the
//! invariants. A new kind is in the matrix by being registered, with an example of its settings. The same for sensors: `sensors.rs`.

mod sensors;

use mobee::run::{Folder, run};
use mobee_contract::{Agent, Hardware, kinds};
use mobee_controller::Drive;
use mobee_journal::check::check;
use mobee_model::load_robot;
use mobee_runtime::system::RunCounts;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use tokio::sync::mpsc;

const SECONDS: f64 = 10.0;

/// The files of all robots that ship. The robot of corner cases touches itself in every pose, so that there contacts with itself don't count.
fn robots(scratch: &Path) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (edge, outermost) = (scratch.join("edge.xml"), "<link z=\"0.2\" radius=\"0.03\">");
    let text = std::fs::read_to_string(root.join("tests/data/edge/edge_a.xml")).expect("a robot");
    assert!(text.contains(outermost));
    let text = text.replace(outermost, "<link z=\"0.2\" radius=\"0.03\" noSelfCollision=\"true\">");
    std::fs::write(&edge, text).expect("written");
    let shipped =
        std::fs::read_dir(root.join("configs/robots")).expect("a folder").map(|e| e.expect("an entry").path());
    let mut robots: Vec<PathBuf> = shipped.filter(|path| path.extension().is_some_and(|e| e == "xml")).collect();
    robots.sort();
    robots.push(edge);
    robots
}

/// What a controller can be told, each for another reason, and all of it for each kind of controller.
fn controllers() -> Vec<(String, Value)> {
    let settings = [
        ("as shipped", json!({ "period_ms": 20, "history": 6000 })),
        ("quick and close", json!({ "period_ms": 10, "history": 3000, "margin_mm": 4, "tolerance_deg": 0.05 })),
        ("slow and wide", json!({ "period_ms": 50, "history": 500, "margin_mm": 15, "tolerance_deg": 1.0 })),
        ("forgetful", json!({ "period_ms": 20, "history": 40 })),
    ];
    let of_kind = |kind: &'static str| {
        settings.clone().map(|(name, mut controller)| {
            controller["kind"] = kind.into();
            (format!("{kind}, {name}"), controller)
        })
    };
    kinds::<Drive>().into_iter().flat_map(|k| of_kind(k.name)).collect()
}

/// One cell of the matrix.
struct Cell {
    title: String,
    config: Value,
}

fn cells(robots: &[PathBuf]) -> Vec<Cell> {
    let mut cells = Vec::new();
    for path in robots {
        let robot = load_robot(path).expect("a robot").value;
        for driver in kinds::<dyn Hardware>() {
            let mut hardware = match (driver.example)(&robot) {
                Ok(settings) => settings,
                Err(why) => {
                    println!("left out: driver {} on {}: {why}", driver.name, robot.name);
                    continue;
                }
            };
            hardware["kind"] = driver.name.into();
            for agent in kinds::<dyn Agent>() {
                let mut planner = (agent.example)(&robot).expect("an agent's settings for any robot");
                planner["kind"] = agent.name.into();
                for (name, controller) in controllers() {
                    cells.push(Cell {
                        title: format!("{} on {} by {}, {name}", agent.name, robot.name, driver.name),
                        config: json!({
                            "for_s": SECONDS, "record": { "enabled": false },
                            "robot": [{
                                "name": "robot", "model": path, "driver": hardware, "controller": controller,
                                "agent": planner,
                            }],
                        }),
                    });
                }
            }
        }
    }
    cells
}

/// A cell that ran as it should, and its journal.
struct Ran {
    counts: RunCounts,
    dir: tempfile::TempDir,
}

impl Ran {
    fn folder(&self) -> PathBuf {
        self.dir.path().join("run")
    }
}

/// What is wrong with a cell, if anything.
fn judge(cell: &Cell) -> Result<Ran, String> {
    let dir = tempfile::tempdir().map_err(|e| e.to_string())?;
    let file = dir.path().join("cell.toml");
    std::fs::write(&file, toml::to_string(&cell.config).map_err(|e| e.to_string())?).map_err(|e| e.to_string())?;
    let composition = mobee::compose::read(&file, &[]).map_err(|e| format!("{:?}", miette::Report::new(e)))?;
    let seconds = cell.config["for_s"].as_f64().unwrap_or(f64::MAX);
    let folder = Folder::create("cell", Some(&dir.path().join("run"))).map_err(|e| e.to_string())?;
    let (_controls, receiver) = mpsc::channel(1);
    let done = run(composition, &folder, receiver, |_| ()).map_err(|e| format!("{e:?}"))?;
    if !mobee::run::in_order(&done.end) || done.end.ended_at.secs() < seconds {
        return Err(format!("ended at {}: {}", done.end.ended_at, done.end.reason));
    }
    let report = check(folder.path()).map_err(|e| e.to_string())?;
    match report.violations.first() {
        Some(v) => Err(v.to_string()),
        None if done.end.counts.commits == 0 => Err("nothing ever moved".into()),
        None => Ok(Ran { counts: done.end.counts, dir }),
    }
}

/// What becomes of each cell, on two threads: what was asked of it, or its title and what is wrong.
fn in_turn<T: Send>(cells: &[Cell], ask: impl Fn(&Cell) -> Result<T, String> + Sync) -> (Vec<T>, Vec<String>) {
    let next = AtomicUsize::new(0);
    let work = || {
        let (mut right, mut wrong) = (Vec::new(), Vec::new());
        while let Some(cell) = cells.get(next.fetch_add(1, Ordering::Relaxed)) {
            match ask(cell) {
                Ok(answer) => right.push(answer),
                Err(what) => wrong.push(format!("{}: {what}", cell.title)),
            }
        }
        (right, wrong)
    };
    let done: Vec<(Vec<T>, Vec<String>)> = std::thread::scope(|s| {
        let threads = [s.spawn(work), s.spawn(work)];
        threads.into_iter().map(|t| t.join().expect("a thread")).collect()
    });
    let (right, wrong): (Vec<_>, Vec<_>) = done.into_iter().unzip();
    (right.into_iter().flatten().collect(), wrong.into_iter().flatten().collect())
}

#[test]
fn every_composition_starts_runs_and_holds_the_invariants() {
    let scratch = tempfile::tempdir().expect("a folder");
    let robots = robots(scratch.path());
    let cells = cells(&robots);
    let (ran, wrong) = in_turn(&cells, |cell| judge(cell).map(|ran| ran.counts));
    let (commits, back) = ran.iter().fold((0, 0), |(c, b), counts| (c + counts.commits, b + counts.rolled_back));
    println!("{} compositions, {commits} motions, {back} rolled back", cells.len());
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cells.len(), wrong.join("\n"));
    let drivers = kinds::<dyn Hardware>()
        .iter()
        .filter(|k| (k.example)(&load_robot(&robots[0]).expect("a robot").value).is_ok())
        .count();
    assert_eq!(cells.len(), robots.len() * drivers * kinds::<dyn Agent>().len() * controllers().len());
}
