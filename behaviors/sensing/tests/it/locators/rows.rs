//! Tables: accepted completely, or rejected with line, column and remedy.

use mobee_sensing::locators::rows::{parse, table as written};
use mobee_sensing::locators::view::{Glimpse, KnownView, StereoView};
use nalgebra::Vector3;
use proptest::prelude::*;

const HEADER: &str = "lcx,lcy,rcx,rcy,neck_pitch,neck_roll,neck_yaw,eyes_tilt,eyes_version,eyes_vergence,torso_yaw,torso_roll,torso_pitch,\
                      x_mm,y_mm,z_mm";
const ROW: &str = "320,240,300,241,-10,1,2,3,4,5,6,7,8,400,-50,100";

fn table(rows: &[&str]) -> String {
    format!("{HEADER}\n{}\n", rows.join("\n"))
}

#[test]
fn rows_are_taken_in_any_order_of_columns_with_units_made_ours() {
    let read = parse(&table(&[ROW, "", ROW])).expect("a table");
    assert_eq!((read.known.len(), read.has_boxes), (2, false));
    let known = read.known[0];
    assert_eq!(known.view.pixels().as_slice(), [320.0, 240.0, 300.0, 241.0]);
    let degrees = known.view.encoders.map(|q| q.to_degrees().round());
    assert_eq!(degrees, [8.0, 7.0, 6.0, -10.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(known.place.as_slice(), [0.4, -0.05, 0.1]);
    let turned = |line: &str| line.split(',').rev().collect::<Vec<_>>().join(",");
    let other = parse(&format!("\u{feff}{}\r\n{}\r\n", turned(HEADER), turned(ROW))).expect("a table");
    assert_eq!(other.known, [known]);
}

#[test]
fn boxes_at_the_border_are_clipped() {
    let header = format!("lx,ly,lw,lh,rx,ry,rw,rh,{HEADER}");
    let row = |left: &str, right: &str| format!("{header}\n{left},{right},{ROW}\n");
    let clipped = |text: String| parse(&text).expect("a table").known[0].view.is_clipped();
    assert!(!clipped(row("100,100,40,40", "90,100,40,40")));
    assert!(clipped(row("1,100,40,40", "90,100,40,40")));
    assert!(clipped(row("100,100,40,40", "90,440,40,40")));
    let fault = parse(&row("100,100,-4,40", "90,100,40,40")).expect_err("no such box");
    assert!(fault.line == 2 && fault.what.contains("left"), "{fault}");
}

#[test]
fn whatever_is_wrong_is_refused_with_its_place() {
    let wrong = [
        (table(&[ROW, &ROW.replace("300", "nan")]), 3, "column 3 (`rcx`) has \"nan\""),
        (table(&[&ROW.replace("300", "")]), 2, "column 3 (`rcx`) has nothing"),
        (table(&[&ROW.replace("300", "inf")]), 2, "has \"inf\""),
        (table(&[&ROW.replace("300", "1e300")]), 2, "has \"1e300\""),
        (table(&[&ROW.replace("300", "three")]), 2, "has \"three\""),
        (table(&[ROW, "1,2,3"]), 3, "3 fields"),
        (table(&[]), 1, "no rows"),
        (String::new(), 1, "not known"),
        (table(&[ROW]).replace("neck_yaw", "neck_jaw"), 1, "`neck_jaw` is not known"),
        (table(&[ROW]).replace("neck_yaw", "neck_roll"), 1, "`neck_roll`) is there twice"),
        (table(&[&format!("{ROW},1")]).replace("z_mm", "z_mm,lx"), 1, "some of the columns of the boxes"),
        (table(&[ROW]).replace("x_mm,y_mm,z_mm", "cell_x,cell_y,z_mm"), 1, "cells of a table"),
    ];
    for (text, line, what) in wrong {
        let fault = parse(&text).expect_err("it is wrong");
        assert!(fault.line == line && fault.what.contains(what) && !fault.help.is_empty(), "{fault}, not {what}");
    }
    let short = table(&[&ROW[..ROW.len() - 4]]).replace(",z_mm", "");
    assert!(parse(&short).expect_err("it is wrong").what.contains("columns are missing: z_mm"));
}

proptest! {
    /// A written table is read again, except for rounding.
    #[test]
    fn a_table_that_was_written_is_read(
        rows in prop::collection::vec((prop::array::uniform8(20.0..400.0f64), prop::array::uniform9(-1.5..1.5f64), prop::array::uniform3(-2.0..2.0f64)), 1..20),
    ) {
        let known = |(n, encoders, place): &([f64; 8], [f64; 9], [f64; 3])| {
            let eye = |k: usize| {
                let center = [n[k], n[k + 1]];
                Glimpse { center, bounds: Some([n[k], n[k + 1], n[k + 2] / 10.0, n[k + 3] / 10.0]), is_clipped: false }
            };
            let view = StereoView { eyes: [eye(0), eye(4)], encoders: *encoders, is_timed: false };
            KnownView { view, place: Vector3::from(*place) }
        };
        let all: Vec<KnownView> = rows.iter().map(known).collect();
        let read = parse(&written(&all)).expect("a table");
        prop_assert!(read.has_boxes && read.known.len() == all.len());
        for (a, b) in all.iter().zip(&read.known) {
            prop_assert!((a.place - b.place).norm() < 1e-6);
            prop_assert!((a.view.pixels() - b.view.pixels()).norm() < 1e-3);
            prop_assert!(a.view.encoders.iter().zip(&b.view.encoders).all(|(a, b)| (a - b).abs() < 1e-5));
            for (a, b) in a.view.eyes.iter().zip(&b.view.eyes) {
                let (a, b) = (a.bounds.expect("a box"), b.bounds.expect("a box"));
                prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3));
            }
        }
    }
}
