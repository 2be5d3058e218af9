//! Evolved filters that ran on the robot (icVision): each detects, in the interpreter, the object
//! that it was evolved for.

use crate::detectors::cgp::{Channels, ImageNode, ImageProgram, Op, channels};
use crate::detectors::picture::Mask;
use crate::detectors::plane::Plane;

/// An object of one color on a background, in an image of 96x72 pixels.
struct Thing {
    columns: (usize, usize),
    rows: (usize, usize),
    color: [f32; 3],
    before: [f32; 3],
}

impl Thing {
    /// Returns whether pixel `i` is inside the object, enlarged by `more` pixels on each side and
    /// moved down by `down`.
    fn is_at(&self, i: usize, more: isize, down: isize) -> bool {
        let within = |(from, to): (usize, usize), k: usize, by: isize| {
            (from as isize - more + by..to as isize + more + by).contains(&(k as isize))
        };
        within(self.columns, i % 96, 0) && within(self.rows, i / 96, down)
    }

    fn channels(&self) -> Channels {
        let plane = |k: usize| {
            let value = |i: usize| if self.is_at(i, 0, 0) { self.color[k] } else { self.before[k] };
            Plane { width: 96, height: 72, data: (0..96 * 72).map(value).collect() }
        };
        let says_nothing = Plane::filled(96, 72, 128.0);
        channels(&[plane(0), plane(1), plane(2)], &says_nothing, &says_nothing)
    }

    /// Returns whether these nodes detect the object except for at most `all_but` pixels at its
    /// edge, and nothing more than `none_beside` pixels outside.
    fn is_found(
        &self,
        nodes: &[ImageNode],
        threshold: f32,
        (all_but, none_beside): (isize, isize),
        down: isize,
    ) -> bool {
        let program = ImageProgram { nodes: nodes.to_vec(), inverted: false };
        let found = Mask::at_least(&program.run(&self.channels()), threshold);
        let is_right = |(i, is): (usize, &bool)| {
            if *is { self.is_at(i, none_beside, down) } else { !self.is_at(i, -all_but, down) }
        };
        found.data.iter().enumerate().all(is_right)
    }
}

/// Creates a node of a filter; the sources of its images are counted back.
fn node(op: Op, from: [u16; 2], p0: f32, p1: i8) -> ImageNode {
    ImageNode::new(op, from, p0, p1)
}

#[test]
fn the_filter_that_saw_a_blue_cup_on_the_robot_finds_a_blue_thing() {
    let thing = Thing { columns: (30, 70), rows: (20, 52), color: [40.0, 60.0, 200.0], before: [180.0, 150.0, 90.0] };
    let nodes = vec![
        node(Op::Input, [1, 1], 0.0, 4),
        node(Op::Const, [1, 1], -8.23, 0),
        node(Op::Avg, [1, 2], 0.0, 0),
        node(Op::Threshold, [1, 1], 64.0, 0),
        node(Op::Erode, [1, 1], 0.0, 5),
        node(Op::Median, [1, 1], 0.0, 5),
        node(Op::Gauss, [1, 1], 0.0, 9),
        node(Op::Dilate, [1, 1], 0.0, 5),
    ];
    assert!(thing.is_found(&nodes, 111.8, (2, 1), 0));
    let program = ImageProgram { nodes, inverted: false };
    assert!(program.to_string().ends_with("n7 = dilate(n6, 5)\noutput = n7\n"), "{program}");
}

#[test]
fn the_filter_that_saw_a_red_block_finds_a_dark_red_thing_before_a_bright_wall() {
    let thing = Thing { columns: (30, 70), rows: (20, 52), color: [200.0, 40.0, 40.0], before: [220.0, 220.0, 220.0] };
    let nodes = [
        node(Op::Input, [1, 1], 0.0, 1),
        node(Op::Threshold, [1, 1], 64.0, 0),
        node(Op::Pow, [1, 1], 0.5, 0),
        node(Op::Input, [1, 1], 0.0, 0),
        node(Op::Normalize, [1, 1], 0.0, 0),
        node(Op::Gauss, [1, 1], 0.0, 3),
        node(Op::AbsDiff, [1, 4], 0.0, 0),
        node(Op::Normalize, [1, 1], 0.0, 0),
        node(Op::AbsDiff, [8, 1], 0.0, 0),
        node(Op::Threshold, [1, 1], 64.0, 0),
        node(Op::Erode, [1, 1], 0.0, 2),
    ];
    assert!(thing.is_found(&nodes, 128.0, (4, 0), 0));
}

#[test]
fn the_filter_that_saw_a_tea_box_finds_what_is_redder_than_it_is_bright() {
    let thing = Thing { columns: (30, 70), rows: (20, 52), color: [200.0, 40.0, 40.0], before: [90.0, 90.0, 90.0] };
    let nodes = [
        node(Op::Input, [1, 1], 0.0, 0),
        node(Op::Erode, [1, 1], 0.0, 1),
        node(Op::AbsDiff, [2, 1], 0.0, 0),
        node(Op::Add, [1, 1], 0.0, 0),
        node(Op::Avg, [4, 3], 0.0, 0),
        node(Op::Min, [1, 2], 0.0, 0),
        node(Op::ShiftDown, [5, 5], 0.0, 0),
        node(Op::Input, [1, 1], 0.0, 1),
        node(Op::Erode, [1, 1], 0.0, 3),
        node(Op::Sub, [3, 1], 0.0, 0),
        node(Op::AbsDiff, [5, 1], 0.0, 0),
        node(Op::Sub, [1, 2], 0.0, 0),
        node(Op::Gauss, [1, 1], 0.0, 15),
        node(Op::Gauss, [1, 1], 0.0, 15),
        node(Op::Threshold, [1, 1], 64.0, 0),
        node(Op::Gauss, [1, 1], 0.0, 13),
    ];
    assert!(thing.is_found(&nodes, 128.0, (7, 7), 0));
}

#[test]
fn the_filter_that_saw_a_hand_finds_what_has_color_six_pixels_higher() {
    let thing = Thing { columns: (30, 70), rows: (20, 52), color: [200.0, 130.0, 100.0], before: [120.0; 3] };
    let nodes = [
        node(Op::Input, [1, 1], 0.0, 0),
        node(Op::MeanValue, [1, 1], 0.0, 0),
        node(Op::Input, [1, 1], 0.0, 5),
        node(Op::Add, [1, 2], 0.0, 0),
        node(Op::Normalize, [1, 1], 0.0, 0),
        ImageNode { p2: 3, ..node(Op::LocalMin, [1, 1], 0.0, 3) },
        ImageNode { p2: -6, ..node(Op::Shift, [1, 1], 0.0, 0) },
        node(Op::Dilate, [1, 1], 0.0, 7),
        node(Op::Threshold, [1, 1], 145.4, 0),
    ];
    // Smaller by three, larger by seven.
    assert!(thing.is_found(&nodes, 128.0, (-4, 4), -6));
    assert!(!thing.is_found(&nodes, 128.0, (-4, 4), 0));
}

#[test]
fn the_filter_that_saw_a_finger_finds_what_is_bright_and_narrow() {
    let finger = Thing { columns: (45, 51), rows: (10, 60), color: [230.0, 180.0, 160.0], before: [20.0; 3] };
    let nodes = [
        node(Op::Input, [1, 1], 0.0, 6),
        node(Op::ShiftLeft, [1, 1], 0.0, 0),
        node(Op::SobelX, [1, 1], 0.0, 0),
        node(Op::Laplace, [3, 3], 0.0, 3),
        node(Op::AbsDiff, [2, 1], 0.0, 0),
        node(Op::Gauss, [1, 1], 0.0, 15),
    ];
    assert!(finger.is_found(&nodes, 170.3, (2, 9), 0));
    let wall = Thing { columns: (20, 80), ..finger };
    assert!(!wall.is_found(&nodes, 170.3, (2, 9), 0), "of what is broad it tells the edges");
}
