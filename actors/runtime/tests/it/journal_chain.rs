//! The journal: every change shows, every crash leaves a readable file (I12), equal runs have equal hashes (I13).

use mobee_contract::{CommitId, Entry, Event, Outcome, Time};
use mobee_journal::journal::{FILE, Journal, JournalError, JournalLine, NOT_FINITE, VERSION, read};
use mobee_runtime::clock::ClockKind;
use mobee_runtime::tap::{OpenSink, Pictures, SinkSpec, Taps};
use proptest::prelude::*;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

fn outcome(id: u64, q: Vec<f64>) -> Event {
    let (robot, outcome) = ("edge".to_string(), Outcome::Committed);
    Event::Outcome { robot, id: CommitId(id), outcome, q: q.into(), safe: None, cause: None }
}

fn events() -> Vec<Event> {
    let mut events = vec![Event::Started { seed: 7, clock: "virtual".into(), config: json!({"hash": "x", "a": null}) }];
    events.extend((1..30).map(|id| outcome(id, vec![0.125 * id as f64, -1e-17, 1.0 / 3.0])));
    events.push(Event::Ended { reason: "done".into() });
    events
}

fn write(dir: &Path, aside: &str) -> Journal {
    let journal = Journal::create(dir, &json!({ "build": aside })).unwrap();
    let mut sink = journal.sink();
    for (k, event) in events().into_iter().enumerate() {
        sink.write(Time(k as u64 * 1_234_567_891), &Entry::Event(Arc::new(event))).unwrap();
    }
    sink.flush().unwrap();
    journal
}

fn lines(path: &Path) -> Result<Vec<JournalLine>, JournalError> {
    read(path)?.collect()
}

#[test]
fn what_was_written_is_read_back_with_the_final_hash() {
    let dir = tempfile::tempdir().unwrap();
    let journal = write(dir.path(), "a");
    let lines = lines(dir.path()).unwrap();
    assert_eq!(lines.iter().map(|l| l.event.clone()).collect::<Vec<_>>(), events());
    assert_eq!(lines[3].at, Time(3 * 1_234_567_891));
    assert_eq!(lines.last().unwrap().hash, journal.hash());
    assert_eq!(journal.events(), lines.len() as u64);
}

#[test]
fn the_aside_is_not_hashed_and_everything_else_is() {
    let (a, b, c) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let hash = write(a.path(), "a").hash();
    assert_eq!(hash, write(b.path(), "another build").hash());
    let journal = Journal::create(c.path(), &json!({})).unwrap();
    for (k, event) in events().into_iter().enumerate() {
        journal.sink().write(Time(k as u64 * 1_234_567_891 + 1), &Entry::Event(Arc::new(event))).unwrap();
    }
    assert_ne!(hash, journal.hash(), "one nanosecond later is another run");
}

#[test]
fn the_first_line_tells_the_version_and_a_later_one_is_not_read() {
    let dir = tempfile::tempdir().unwrap();
    let journal = write(dir.path(), "a");
    let mut lines = read(dir.path()).unwrap();
    assert!(lines.next().unwrap().is_ok());
    assert_eq!(lines.version(), VERSION);
    let text = std::fs::read_to_string(journal.path()).unwrap();
    let (head, rest) = text.split_once('\n').unwrap();
    let first = |head: &str| {
        std::fs::write(journal.path(), format!("{head}\n{rest}")).unwrap();
        let mut lines = read(dir.path()).unwrap();
        (lines.next().unwrap().map_err(|e| e.to_string()), lines.version())
    };
    let old = first("{\"aside\":{}}");
    assert!(old.0.is_ok() && old.1 == 1, "{old:?}");
    let later = head.replace(&format!("\"version\":{VERSION}"), "\"version\":99");
    assert!(first(&later).0.unwrap_err().contains("of version 99"));
}

#[test]
fn an_existing_journal_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), "a");
    assert!(Journal::create(dir.path(), &json!({})).unwrap_err().contains("never overwritten"));
    assert_eq!(lines(dir.path()).unwrap().len(), events().len());
}

#[test]
fn a_number_that_is_not_finite_does_not_break_the_journal() {
    let dir = tempfile::tempdir().unwrap();
    let journal = Journal::create(dir.path(), &json!({})).unwrap();
    let mut sink = journal.sink();
    for bad in [f64::NAN, f64::INFINITY] {
        sink.write(Time(1), &Entry::Event(Arc::new(outcome(1, vec![bad])))).unwrap();
    }
    sink.flush().unwrap();
    let lines = lines(dir.path()).unwrap();
    assert_eq!(lines.len(), 2);
    assert!(lines.iter().all(|l| matches!(&l.event, Event::Warning { text } if text.starts_with(NOT_FINITE))));
}

#[test]
fn a_second_sink_continues_the_chain() {
    let dir = tempfile::tempdir().unwrap();
    let journal = Journal::create(dir.path(), &json!({})).unwrap();
    for (k, event) in events().into_iter().enumerate() {
        journal.sink().write(Time(k as u64), &Entry::Event(Arc::new(event))).unwrap();
    }
    assert_eq!(lines(dir.path()).unwrap().len(), events().len());
}

#[test]
fn missing_doubled_and_swapped_lines_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "a").path().to_path_buf();
    let text = std::fs::read_to_string(&path).unwrap();
    let all: Vec<&str> = text.lines().collect();
    let mut missing = all.clone();
    missing.remove(5);
    let mut doubled = all.clone();
    doubled.insert(6, all[5]);
    let mut swapped = all.clone();
    swapped.swap(5, 6);
    for (changed, line) in [(missing, 6), (doubled, 7), (swapped, 6)] {
        std::fs::write(&path, changed.join("\n") + "\n").unwrap();
        let error = lines(&path).unwrap_err();
        assert_eq!((error.line, error.truncated), (line, false), "{error}");
    }
}

/// A line beyond the bound of the reader is damage: a resumed run would otherwise cut off the events behind it.
#[test]
fn a_line_that_is_too_long_is_named_and_nothing_is_cut_off() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "a").path().to_path_buf();
    let text = std::fs::read_to_string(&path).unwrap();
    let all: Vec<&str> = text.lines().collect();
    // As a crash leaves it: a seal would count the events.
    std::fs::remove_file(path.with_extension("seal")).unwrap();
    for bytes in [1 << 25, 40 << 20] {
        let long = "x".repeat(bytes);
        let lines_before_and_after = [&all[..6], &[long.as_str()], &all[6..]].concat();
        std::fs::write(&path, lines_before_and_after.join("\n") + "\n").unwrap();
        let size = std::fs::metadata(&path).unwrap().len();
        let error = Journal::resume(dir.path(), |_| {}).unwrap_err();
        assert_eq!((error.line, error.truncated), (7, false), "{error}");
        assert!(error.what.contains("longer than 32 MiB"), "{error}");
        assert_eq!(std::fs::metadata(&path).unwrap().len(), size);
    }
}

#[test]
fn missing_and_empty_files_are_errors_with_a_remedy() {
    let dir = tempfile::tempdir().unwrap();
    let error = read(dir.path()).unwrap_err();
    assert!(error.to_string().contains("journal.jsonl") && !error.help.is_empty());
    std::fs::write(dir.path().join("journal.jsonl"), "").unwrap();
    assert!(lines(dir.path()).unwrap_err().truncated);
}

#[test]
fn the_journal_works_behind_the_taps() {
    let dir = tempfile::tempdir().unwrap();
    let journal = Journal::create(dir.path(), &json!({})).unwrap();
    let keep = journal.clone();
    let open: OpenSink = Arc::new(move || Ok(journal.sink()));
    let patience = std::time::Duration::from_secs(30);
    let spec = SinkSpec {
        pictures: Pictures::None,
        name: "journal".into(),
        essential: true,
        poses: None,
        capacity: 16,
        patience,
        open: Some(open),
    };
    let taps = Taps::spawn(ClockKind::Virtual, vec![spec]).unwrap();
    (0..500).for_each(|i| taps.event(Time(i), outcome(i, vec![])));
    let report = taps.finish(Time(500), Event::Ended { reason: "done".into() });
    assert_eq!(report[0].error, None);
    let lines = lines(dir.path()).unwrap();
    assert_eq!((lines.len(), &lines[500].hash), (501, &keep.hash()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Cut anywhere: the good lines are given, then an error that says how many they are.
    #[test]
    fn a_journal_cut_at_any_byte_is_readable(share in 0.0..1.0_f64) {
        let dir = tempfile::tempdir().unwrap();
        let path = write(dir.path(), "a").path().to_path_buf();
        let bytes = std::fs::read(&path).unwrap();
        let cut = (share * bytes.len() as f64) as usize;
        std::fs::write(&path, &bytes[..cut]).unwrap();
        // its seal knows how much there was
        let sealed: Vec<_> = read(&path).unwrap().collect();
        let noticed = matches!(sealed.last(), Some(Err(e)) if !e.truncated && e.what.contains("cut off"));
        prop_assert!(noticed || cut == bytes.len());
        // by itself, as a crash leaves what was never sealed
        std::fs::remove_file(path.with_extension("seal")).unwrap();
        let whole = bytes[..cut].iter().filter(|b| **b == b'\n').count().saturating_sub(1);
        let read: Vec<_> = read(&path).unwrap().collect();
        prop_assert_eq!(read.iter().filter(|l| l.is_ok()).count(), whole);
        match read.last() {
            Some(Err(e)) => {
                let says = e.what.contains(&format!("{whole} events are good"));
                prop_assert!(e.truncated && says);
            }
            _ => prop_assert_eq!(bytes[cut - 1], b'\n'),
        }
    }

    /// One flipped bit anywhere after the aside: the line is named (a flipped line end: it or the next).
    #[test]
    fn a_flipped_bit_is_found(share in 0.0..1.0_f64, bit in 0_u8..8) {
        let dir = tempfile::tempdir().unwrap();
        let path = write(dir.path(), "a").path().to_path_buf();
        let mut bytes = std::fs::read(&path).unwrap();
        let first = bytes.iter().position(|b| *b == b'\n').unwrap() + 1;
        let at = first + (share * (bytes.len() - first) as f64) as usize;
        let line = bytes[..at].iter().filter(|b| **b == b'\n').count() as u64 + 1;
        bytes[at] ^= 1 << bit;
        std::fs::write(&path, &bytes).unwrap();
        let error = lines(&path).unwrap_err();
        prop_assert_eq!(error.line, line, "{}", error);
    }

    /// Anything at all: an error, not a panic.
    #[test]
    fn garbage_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..300), head in any::<bool>()) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let mut text = if head { b"{\"aside\":{}}\n".to_vec() } else { Vec::new() };
        text.extend(&bytes);
        std::fs::write(&path, &text).unwrap();
        let clean = head && bytes.is_empty();
        prop_assert_eq!(lines(&path).is_ok(), clean);
    }
}

/// What is written into a file that nobody can open any more is lost; a folder of another name holds it as well.
#[test]
fn a_journal_that_is_taken_away_is_noticed_at_an_outcome_and_when_nothing_happens() {
    type Harm = fn(&std::path::Path);
    let harms: [(&str, Harm); 4] = [
        ("was removed", |dir| std::fs::remove_file(dir.join(FILE)).unwrap()),
        ("was removed", |dir| std::fs::remove_dir_all(dir).unwrap()),
        ("was truncated", |dir| drop(std::fs::File::create(dir.join(FILE)).unwrap())),
        ("was replaced", |dir| {
            std::fs::copy(dir.join(FILE), dir.join("copy")).unwrap();
            std::fs::rename(dir.join("copy"), dir.join(FILE)).unwrap();
        }),
    ];
    for (expected, harm) in harms {
        let parent = tempfile::tempdir().unwrap();
        let (first, dir) = (parent.path().join("first"), parent.path().join("renamed"));
        std::fs::create_dir(&first).unwrap();
        let journal = write(&first, "a");
        let mut sink = journal.sink();
        std::fs::rename(&first, &dir).unwrap();
        let event = || Entry::Event(Arc::new(outcome(7, vec![0.0])));
        sink.write(Time(9), &event()).unwrap();
        sink.flush().unwrap();
        assert!(journal.is_whole());
        let before = journal.hash();
        harm(&dir);
        assert!(sink.write(Time(10), &event()).is_err_and(|e| e.contains(expected)), "{expected}");
        assert!(sink.flush().is_err_and(|e| e.contains(expected)), "{expected}");
        assert_eq!((journal.hash(), journal.is_whole()), (before, false), "what is not written does not count");
    }
}
