//! What a run recorded is what it was, or it is said what of it is not: damage to any file of a run that ended in order is noticed, and a
//! resumed run loses no more than what is damaged.

use super::common::{EDGE, HOLD, mobee_in, said, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

const BEHAVIOR: &str = r#"[[robot]]
name = "edge"
model = "robot.xml"
controller = { period_ms = 20, history = 500 }
driver = { kind = "sim", profile = "ideal" }
agent = { kind = "random", motors = ["base"], count = 1000, speed = 0.5 }
"#;

/// What only measured poses show.
const BY_POSES: &str = "I8, I17, I20, I21, I25, I26 and I31";

fn mobee(dir: &Path, args: &[&str]) -> Output {
    mobee_in(dir).args(args).output().expect("mobee starts")
}

/// A folder with a recorded run of some seconds by this clock, which ended in order.
fn ended(clock: &str, secs: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("a folder");
    for (name, text) in [("behavior.toml", BEHAVIOR), ("robot.xml", EDGE)] {
        fs::write(dir.path().join(name), text).expect("a file");
    }
    let run = dir.path().join("run");
    let out = mobee(dir.path(), &["run", "behavior.toml", "--clock", clock, "--for", secs, "--out", text(&run)]);
    assert!(out.status.success(), "{}", said(&out));
    (dir, run)
}

/// What is done to a file.
type Damage = (&'static str, fn(&Path));

const DAMAGE: [Damage; 5] = [
    ("a flipped bit in the middle", |file| flip(file, |len| len / 2)),
    ("a flipped bit at the end", |file| flip(file, |len| len - 1)),
    ("cut in half", |file| {
        let bytes = fs::read(file).expect("a file");
        fs::write(file, &bytes[..bytes.len() / 2]).expect("written");
    }),
    ("emptied", |file| fs::write(file, "").expect("written")),
    ("removed", |file| fs::remove_file(file).expect("there")),
];

fn flip(file: &Path, place: impl Fn(usize) -> usize) {
    let mut bytes = fs::read(file).expect("a file");
    let at = place(bytes.len());
    bytes[at] ^= 0x10;
    fs::write(file, bytes).expect("written");
}

/// Damages each file of a run, and returns what was not noticed.
fn unnoticed(run: &Path) -> Vec<String> {
    let mut names: Vec<String> = run
        .read_dir()
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().into_string().expect("a name"))
        .collect();
    names.retain(|name| !name.starts_with("ctl"));
    let mut missed = Vec::new();
    for name in &names {
        let file = run.join(name);
        let whole = fs::read(&file).expect("a file");
        for (what, damage) in DAMAGE {
            damage(&file);
            let out = mobee(run, &["check", "."]);
            if out.status.success() || !said(&out).contains(name.as_str()) {
                missed.push(format!("{name}, {what}: {:?}", out.status.code()));
            }
            fs::write(&file, &whole).expect("written");
        }
    }
    let out = mobee(run, &["check", "."]);
    assert!(out.status.success() && said(&out).contains(HOLD), "{}", said(&out));
    missed
}

#[test]
fn damage_to_any_file_of_a_run_that_ended_in_order_is_noticed() {
    let (_dir, run) = ended("virtual", "20");
    assert!(run.join("recording.rrd").exists() && run.join("poses-edge.track").exists());
    assert_eq!(unnoticed(&run), Vec::<String>::new());
    // a folder that has files of its user's, and another name, is none the worse
    fs::write(run.join("notes.txt"), "mine").expect("written");
    let moved = run.with_file_name("moved");
    fs::rename(&run, &moved).expect("renamed");
    assert!(mobee(&moved, &["check", "."]).status.success());
}

#[test]
fn a_flipped_bit_of_the_measured_poses_costs_one_frame_and_what_it_hides_is_named() {
    let (_dir, run) = ended("virtual", "60");
    let track = run.join("poses-edge.track");
    let readings = |out: &Output| -> usize {
        let words = said(out);
        let line = words.lines().find_map(|l| l.strip_suffix(" measured poses")).expect("a line");
        line.parse().expect("a number")
    };
    let whole = readings(&mobee(&run, &["check", "."]));
    flip(&track, |len| len / 3);
    let length = fs::metadata(&track).expect("there").len();
    let out = mobee(&run, &["check", "."]);
    let words = said(&out);
    assert_eq!(out.status.code(), Some(1), "{words}");
    let rest = readings(&out);
    assert!(rest < whole && rest + 300 > whole, "{rest} of {whole}: {words}");
    let named = format!("{BY_POSES} of edge are not judged from ");
    assert!(words.contains("poses-edge.track") && words.contains(&named) && !words.contains(HOLD), "{words}");

    let out = mobee(&run, &["run", "--resume", ".", "--no-record", "--for", "80"]);
    assert!(out.status.success(), "{}", said(&out));
    assert!(said(&out).contains("poses-edge.track is damaged from byte "), "{}", said(&out));
    assert!(fs::metadata(&track).expect("there").len() > length, "nothing is cut off");
    let out = mobee(&run, &["check", "."]);
    assert!(readings(&out) > rest && said(&out).contains(&named), "{}", said(&out));
    assert_eq!(out.status.code(), Some(1), "it stays damaged");
}

#[test]
fn a_run_that_died_is_judged_up_to_where_its_poses_end() {
    let (_dir, run) = ended("virtual", "60");
    for name in ["journal.seal", "files.sha256", "summary.json"] {
        fs::remove_file(run.join(name)).expect("there");
    }
    let journal = run.join("journal.jsonl");
    let lines = fs::read_to_string(&journal).expect("a journal");
    let until = lines.lines().position(|l| l.contains("\"ended\"")).expect("an end");
    fs::write(&journal, lines.lines().take(until).collect::<Vec<_>>().join("\n") + "\n").expect("written");
    let track = run.join("poses-edge.track");
    let bytes = fs::read(&track).expect("a track");
    fs::write(&track, &bytes[..bytes.len() - 3]).expect("written");
    let out = mobee(&run, &["check", "."]);
    assert!(out.status.success(), "a crash is no damage: {}", said(&out));
    let named = format!("{BY_POSES} of edge are not judged after ");
    assert!(said(&out).contains(&named) && !said(&out).contains(HOLD), "{}", said(&out));
}

#[test]
fn a_resumed_run_keeps_the_frames_behind_a_damaged_one() {
    let dir = tempfile::tempdir().expect("a folder");
    let run = dir.path().join("run");
    let look = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/look.toml");
    let keep = ["--set", "sensor.eyes.keep_frames=true", "--no-record", "--for", "3", "--out", "run"];
    let out = mobee(dir.path(), &[&["run", text(&look)], &keep[..]].concat());
    assert!(out.status.success(), "{}", said(&out));
    let file = run.join("eyes.left.frames");
    let whole = fs::read(&file).expect("frames");
    let mut places = vec![15];
    while let Some(length) = whole.get(places[places.len() - 1]..).and_then(|rest| rest.first_chunk::<4>()) {
        places.push(places[places.len() - 1] + 8 + u32::from_le_bytes(*length) as usize);
    }
    // the length, the time and a number of the lens of the third record
    for (at, bit) in [(3, 0x80), (0, 0x01), (11, 0x40), (27, 0x40)] {
        let mut bytes = whole.clone();
        bytes[places[2] + at] ^= bit;
        fs::write(&file, &bytes).expect("written");
        let copy = tempfile::tempdir_in(dir.path()).expect("a folder");
        for entry in run.read_dir().expect("a folder").flatten() {
            fs::copy(entry.path(), copy.path().join(entry.file_name())).expect("a copy");
        }
        let out = mobee(copy.path(), &["run", "--resume", ".", "--no-record", "--for", "4"]);
        assert!(out.status.success(), "{}", said(&out));
        let after = fs::read(copy.path().join("eyes.left.frames")).expect("frames");
        assert!(
            after.len() > bytes.len() && after[..bytes.len()] == bytes,
            "byte {at}: {} of {}",
            after.len(),
            bytes.len()
        );
        assert!(said(&out).contains("eyes.left.frames"), "{}", said(&out));
    }
}
