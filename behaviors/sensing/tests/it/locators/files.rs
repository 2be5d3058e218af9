//! Locator files: a written file can be read again; anything else is rejected.

use super::simulated_head::SimulatedHead;
use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::file::{LocatorFile, LocatorKind};
use mobee_sensing::locators::view::KnownView;

fn views(n: usize) -> Vec<KnownView> {
    let mut head = SimulatedHead::new(11);
    (0..n).map(|_| head.view(true)).collect()
}

#[test]
fn what_is_written_is_read_again() {
    for kind in [LocatorKind::Triangulate, LocatorKind::Ensemble, LocatorKind::Calibrated] {
        let file =
            LocatorFile::train(kind, &views(40), "abc".into(), &Beginning::recorded(7), &mut |_| ()).expect("learned");
        let again = LocatorFile::parse(&file.text()).expect("a locator");
        assert_eq!((again.kind(), again.seed, again.data.as_str()), (kind, 7, "abc"));
        let (a, b) = (file.ready(), again.ready());
        for known in views(40) {
            let [a, b] = [&a, &b].map(|l| l.locate(&known.view).map(|e| e.place));
            // The last bit of a number may be lost in a file.
            assert_eq!(a.is_some(), b.is_some());
            assert!(a.zip(b).is_none_or(|(a, b)| (a - b).norm() < 1e-6), "{a:?} {b:?}");
        }
    }
}

#[test]
fn what_is_torn_of_another_version_or_impossible_is_refused_with_a_remedy() {
    let file =
        LocatorFile::train(LocatorKind::Calibrated, &views(40), "abc".into(), &Beginning::recorded(7), &mut |_| ())
            .expect("learned");
    let text = file.text();
    let theta = text.find("\"theta\":[").expect("it has parameters") + 9;
    let comma = theta + text[theta..].find(',').expect("several");
    let wrong = [
        (text[..text.len() / 2].to_owned(), "no locator file"),
        ("\u{0}".into(), "no locator file"),
        (text.replacen("mobee-locator", "mobee-detector", 1), "of the format"),
        (text.replacen("\"version\":1", "\"version\":2", 1), "has version 2, and 1 is known"),
        (format!("{}null{}", &text[..theta], &text[comma..]), "invalid type: null"),
        (format!("{}1e999{}", &text[..theta], &text[comma..]), "out of range"),
        (format!("{}{}", &text[..theta], &text[comma + 1..]), "is damaged"),
        (text.replacen("\"calibrated\"", "\"guessed\"", 1), "unknown variant"),
        (text.replacen("\"seed\"", "\"sead\"", 1), "unknown field"),
    ];
    for (text, what) in wrong {
        let fault = LocatorFile::parse(&text).expect_err("it is wrong");
        assert!(fault.what.contains(what) && fault.help.contains("mobee locator train"), "{fault}, not {what}");
    }
}
