//! Disks that are full, limited or not to be written (F15).

use super::{Run, count, events, holds, mobee, said, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program under a limit of the size of its files, in blocks of 512 bytes.
fn limited(blocks: u32, args: &[&str]) -> Output {
    let mut shell = Command::new("sh");
    let line = format!("ulimit -f {blocks}; exec \"$0\" \"$@\"");
    shell.args(["-c", &line, env!("CARGO_BIN_EXE_mobee")]).args(args);
    shell.current_dir(env!("CARGO_MANIFEST_DIR")).env("NO_COLOR", "1").output().expect("sh starts")
}

/// Runs a script of the shell with a small disk of its own at `$D`; `None`, said plainly, where there is no right to mount.
fn on_a_small_disk(script: &str) -> Option<Output> {
    let dir = tempfile::tempdir().expect("a folder");
    let script = format!("D={0}; mount -t tmpfs -o size=2m none $D || exit 77\n{script}", text(dir.path()));
    let mut shell = Command::new("unshare");
    shell.args(["-rm", "sh", "-c", &script]).env("M", env!("CARGO_BIN_EXE_mobee")).env("NO_COLOR", "1");
    let out = shell.current_dir(env!("CARGO_MANIFEST_DIR")).output().ok()?;
    if matches!(out.status.code(), Some(77)) || said(&out).contains("unshare:") {
        eprintln!("SKIPPED: no small disk can be mounted here: {}", said(&out));
        return None;
    }
    Some(out)
}

#[test]
fn a_journal_that_can_not_grow_ends_the_run_and_is_gone_on_with() {
    let scratch = tempfile::tempdir().expect("a folder");
    let run = scratch.path().join("run");
    let args = ["run", "configs/behaviors/explore.toml", "--no-record", "--for", "2000", "--out", text(&run)];
    let out = limited(800, &args);
    assert_eq!(out.status.code(), Some(1), "{}", said(&out));
    let words = said(&out);
    assert!(words.contains("no journal") && words.contains("make room on the disk"), "{words}");
    assert!(words.contains("--resume"), "it says how to go on: {words}");
    let before = events(&run);
    assert!(count(&before, "outcome") > 10, "outcomes as far as the journal reaches");
    let until = ["run", "--resume", text(&run), "--no-record", "--json", "--for", "2000"];
    let out = mobee().args(until).output().expect("mobee starts");
    assert!(out.status.success(), "{}", said(&out));
    assert_eq!(holds(&run)[..before.len()], before, "what was told stays told");
}

#[test]
fn a_recording_that_can_not_grow_is_lost_alone() {
    let scratch = tempfile::tempdir().expect("a folder");
    let run = scratch.path().join("run");
    // the journal of five minutes needs less, its recording more; the recording is written every 2048 frames
    let args = ["run", "configs/behaviors/explore.toml", "--for", "300", "--out", text(&run)];
    let out = limited(900, &args);
    assert!(out.status.success(), "{}", said(&out));
    assert!(said(&out).contains("recorder: the recording can't be written"), "{}", said(&out));
    let all = events(&run);
    assert_eq!(count(&all, "commit"), count(&all, "outcome"), "every commit has one outcome");
    // the measured poses end at the limit as well: what they can't show is named, and nothing is broken
    let checked = mobee().args(["check", text(&run)]).output().expect("mobee starts");
    let judged = said(&checked);
    assert_eq!(checked.status.code(), Some(1), "{judged}");
    assert!(
        judged.contains("poses-icub.track: nothing can be read from byte ") && !judged.contains(" broken at "),
        "{judged}"
    );
}

#[test]
fn a_folder_that_can_not_be_made_or_written_is_said_at_once() {
    let below = Path::new("/dev/null/run");
    let run = |args: &[&str]| mobee().args(["run", "configs/behaviors/ball.toml", "--out"]).args(args).output();
    let out = run(&[text(below)]).expect("mobee starts");
    assert_eq!(out.status.code(), Some(2));
    assert!(said(&out).contains("give an --out that can be written"), "{}", said(&out));
    let scratch = tempfile::tempdir().expect("a folder");
    let path = scratch.path().join("run");
    let out = limited(0, &["run", "configs/behaviors/ball.toml", "--out", text(&path)]);
    assert_eq!(out.status.code(), Some(2), "{}", said(&out));
    assert!(said(&out).contains("disk's space and permissions"), "{}", said(&out));
    assert_eq!(path.read_dir().expect("a folder").count(), 0, "nothing half-made stays");
}

#[test]
fn a_disk_that_fills_up_gives_up_first_the_recording_then_the_run() {
    let begin = "$M run configs/behaviors/ball.toml --out $D/run; echo \"exit $?\"; ls $D/run";
    let Some(out) = on_a_small_disk(&format!("head -c 2085000 /dev/zero >$D/fill\n{begin}")) else { return };
    let words = said(&out);
    assert!(words.contains("exit 2") && words.contains("give an --out on another disk"), "{words}");

    let some = format!("head -c 2010000 /dev/zero >$D/fill\n{begin}; $M check $D/run");
    let words = said(&on_a_small_disk(&some).expect("a disk, as before"));
    assert!(words.contains("there is no recording of this run"), "{words}");
    assert!(words.contains("exit 0") && words.contains("chain intact") && !words.contains(".rrd"), "{words}");

    let all = "$M run configs/behaviors/explore.toml --out $D/run; echo \"exit $?\"; rm $D/run/*.rrd\n\
               $M run --resume $D/run --no-record --for 1; echo \"exit $?\"; $M check $D/run";
    let words = said(&on_a_small_disk(all).expect("a disk, as before"));
    assert!(words.contains("is left to the journal"), "{words}");
    assert!(words.contains("exit 1") && words.contains("no journal"), "{words}");
    assert!(words.contains("exit 0") && words.contains("hold"), "{words}");
}

/// A run of a robot that moves all the time, and has had an outcome.
fn moving(out: &Path) -> Run {
    let mut run = Run::start(out.to_owned(), &["configs/behaviors/explore.toml", "--no-record", "--for", "120"]);
    run.wait(|all| count(all, "outcome") > 0);
    run
}

#[test]
fn a_run_whose_journal_is_taken_away_comes_to_rest_and_names_it() {
    type Harm = fn(&Path);
    let harms: [(&str, Harm, &str); 4] = [
        ("removed", |run| fs::remove_file(run.join("journal.jsonl")).expect("there"), "was removed"),
        ("folder", |run| fs::remove_dir_all(run).expect("there"), "was removed"),
        ("truncated", |run| fs::write(run.join("journal.jsonl"), "").expect("written"), "was truncated"),
        (
            "replaced",
            |run| {
                fs::copy(run.join("journal.jsonl"), run.join("copy")).expect("a copy");
                fs::rename(run.join("copy"), run.join("journal.jsonl")).expect("renamed");
            },
            "was replaced",
        ),
    ];
    let scratch = tempfile::tempdir().expect("a folder");
    let runs: Vec<_> = harms.iter().map(|(name, ..)| moving(&scratch.path().join(name))).collect();
    for (run, (name, harm, expected)) in runs.into_iter().zip(harms) {
        let at = scratch.path().join(name);
        harm(&at);
        let out = run.end();
        let words = said(&out);
        assert_eq!(out.status.code(), Some(1), "{name}: {words}");
        assert!(words.contains("no journal") && words.contains(expected) && words.contains("journal.jsonl"), "{words}");
        assert!(words.contains("\"faulted\": 0"), "{name}: it comes to rest in order: {words}");
        let simulated = words.split("\"simulated_s\": ").nth(1).and_then(|w| w.split(',').next());
        let simulated: f64 = simulated.and_then(|s| s.trim().parse().ok()).expect("a number");
        assert!(simulated < 100.0, "{name}: at once, not at its end: {simulated} s");
    }
}

#[test]
fn a_run_whose_folder_is_renamed_goes_on_there() {
    let scratch = tempfile::tempdir().expect("a folder");
    let (at, moved) = (scratch.path().join("run"), scratch.path().join("moved"));
    let run = moving(&at);
    fs::rename(&at, &moved).expect("renamed");
    let before = count(&events(&moved), "outcome");
    while count(&events(&moved), "outcome") <= before {
        std::thread::park_timeout(std::time::Duration::from_millis(20));
    }
    run.signal("TERM");
    let out = run.end();
    assert!(out.status.success(), "{}", said(&out));
    assert!(said(&out).contains("was renamed") && said(&out).contains(text(&moved)), "{}", said(&out));
    assert!(moved.join("summary.json").is_file() && !at.exists());
    holds(&moved);
}
