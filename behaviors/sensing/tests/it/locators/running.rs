//! A locator in a run, and the tracker.

use super::simulated_head::SimulatedHead;
use mobee_contract::{BodyState, Intrinsics, Located, Locator, Region, Sighting, Time};
use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::file::{LocatorFile, LocatorKind};
use mobee_sensing::locators::learned::{EyeNames, LearnedLocator};
use mobee_sensing::locators::lens::Lens;
use mobee_sensing::locators::standing::Standing;
use mobee_sensing::locators::tracker::{Sight, Tracker};
use mobee_sensing::locators::view::{Estimate, KnownView};
use nalgebra::{Matrix3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The same, seen by a camera with images half as large.
fn sighting(camera: &str, center: [f64; 2], at_s: f64, eye: usize) -> Sighting {
    let lens = Lens::icub()[eye];
    let half = |v: [f64; 2]| v.map(|n| n / 2.0);
    let intrinsics = Intrinsics {
        size: [320, 240],
        focal: half(lens.focal),
        center: half(lens.center),
        distortion: lens.distortion,
    };
    let [x, y] = half(center);
    let region = Region {
        object: "cup".into(),
        center: [x, y],
        bounds: [x - 5.0, y - 5.0, x + 5.0, y + 5.0],
        area: 100.0,
        is_clipped: false,
        confidence: 1.0,
        pose: None,
    };
    Sighting { camera: camera.into(), intrinsics, region, at: Time::from_secs(at_s) }
}

fn ask(locator: &mut LearnedLocator, known: &KnownView, times_s: [f64; 2]) -> Vec<Vec<Located>> {
    let mut q = vec![0.0; 12];
    q[3..].copy_from_slice(&known.view.encoders);
    let eyes = [("eye_left", 0), ("eye_right", 1), ("hand", 0)];
    let ask = |(camera, eye): (&str, usize)| {
        let seen = sighting(camera, known.view.eyes[eye].center, times_s[eye], eye);
        let body = BodyState { at: seen.at, q: q.clone().into() };
        locator.locate(&[seen], &body)
    };
    eyes.into_iter().map(ask).collect()
}

/// Creates a head, and a locator trained on 150 views of it.
fn trained(kind: LocatorKind) -> (SimulatedHead, LocatorFile) {
    let mut head = SimulatedHead::new(21);
    let seen: Vec<KnownView> = (0..150).map(|_| head.view(true)).collect();
    let file = LocatorFile::train(kind, &seen, String::new(), &Beginning::recorded(0), &mut |_| ()).expect("learned");
    (head, file)
}

#[test]
fn eyes_are_paired_if_they_saw_it_at_about_the_same_time_whatever_the_size_of_their_pictures() {
    let (mut head, file) = trained(LocatorKind::Calibrated);
    let joints = std::array::from_fn(|i| i + 3);
    let mut locator = LearnedLocator::new(&file, joints, EyeNames { left: None, right: None }, false);
    let known = head.view(false);
    let told = ask(&mut locator, &known, [1.0, 1.02]);
    assert!(told[0].is_empty() && told[2].is_empty());
    let direct = file.ready().locate(&known.view).expect("located");
    let off = Vector3::from(told[1][0].position) - direct.place;
    assert!(off.norm() < 1e-3 && (direct.place - known.place).norm() < 0.05, "{off}");
    assert!(ask(&mut locator, &known, [2.0, 2.2]).concat().is_empty(), "too far apart in time");
    let body = BodyState { at: Time::ZERO, q: vec![0.0; 3].into() };
    assert!(locator.locate(&[sighting("eye_left", [320.0, 240.0], 3.0, 0)], &body).is_empty(), "a pose too short");
    let names = EyeNames { left: Some("hand".into()), right: Some("eye_right".into()) };
    let mut other = LearnedLocator::new(&file, joints, names, true);
    let told = ask(&mut other, &known, [1.0, 1.0]);
    assert!(told[1].is_empty() && told[2].len() == 1, "settings name the eyes: {told:?}");
}

/// The same with both images clipped by the border.
fn clipped(locator: &mut LearnedLocator, known: &KnownView, at_s: f64) -> Vec<Located> {
    let mut q = vec![0.0; 12];
    q[3..].copy_from_slice(&known.view.encoders);
    let look = |(camera, eye): (&str, usize)| {
        let mut seen = sighting(camera, known.view.eyes[eye].center, at_s, eye);
        seen.region.is_clipped = true;
        locator.locate(&[seen], &BodyState { at: Time::from_secs(at_s), q: q.clone().into() })
    };
    [("eye_left", 0), ("eye_right", 1)].into_iter().flat_map(look).collect()
}

#[test]
fn what_stands_on_a_table_is_at_its_height_and_what_the_border_cuts_off_is_hardly_anywhere() {
    let (mut head, file) = trained(LocatorKind::Triangulate);
    let joints = std::array::from_fn(|i| i + 3);
    let known = head.view(false);
    let at = |z_m: f64, behind_mm: f64| {
        let stands = Some(Standing { z_m, sd_mm: 1.0, behind_mm });
        LearnedLocator::new(&file, joints, EyeNames { left: None, right: None }, true).standing(stands)
    };
    let place = |locator: &mut LearnedLocator| {
        let told = ask(locator, &known, [1.0, 1.0]).concat();
        told.first().map(|l| Vector3::from(l.position))
    };
    let free = file.ready().locate(&known.view).expect("located").place;
    let found = place(&mut at(free.z + 0.03, 0.0)).expect("located");
    assert!((found.z - free.z - 0.03).abs() < 0.005, "the height is believed: {found} {free}");
    assert!((found - free).norm() > 0.03, "and tells how far away it is");
    let behind = place(&mut at(free.z, 20.0)).expect("located");
    assert!((behind - free).norm() > 0.005, "what is seen is the near side");
    assert_eq!(place(&mut at(free.z + 2.0, 0.0)), None, "nothing stands there");
    // The border: the position is reported, but the view does not count.
    let mut locator = at(free.z, 0.0);
    let widest = |l: &Located| (0..3).map(|i| l.covariance[i][i]).fold(0.0, f64::max).sqrt();
    for i in 0..50 {
        let told = clipped(&mut locator, &known, 2.0 + 0.1 * f64::from(i));
        assert!(told.iter().all(|l| widest(l) > 0.09), "however often it is seen: {told:?}");
    }
}

/// The same with a box of this size in each eye, pixels; `None`: no detection.
fn looks(locator: &mut LearnedLocator, known: &KnownView, at_s: f64, boxes: [Option<f64>; 2]) -> Vec<Located> {
    let mut q = vec![0.0; 12];
    q[3..].copy_from_slice(&known.view.encoders);
    let mut look = |(camera, eye): (&str, usize)| {
        let Some(wide) = boxes[eye] else { return Vec::new() };
        let mut seen = sighting(camera, known.view.eyes[eye].center, at_s, eye);
        let [x, y] = seen.region.center;
        seen.region.bounds = [x - wide / 2.0, y - wide / 2.0, x + wide / 2.0, y + wide / 2.0];
        locator.locate(&[seen], &BodyState { at: Time::from_secs(at_s), q: q.clone().into() })
    };
    [look(("eye_left", 0)), look(("eye_right", 1))].concat()
}

#[test]
fn one_eye_is_enough_for_what_stands_if_something_hides_it_from_the_other() {
    let (mut head, file) = trained(LocatorKind::Triangulate);
    let joints = std::array::from_fn(|i| i + 3);
    let locator = || LearnedLocator::new(&file, joints, EyeNames { left: None, right: None }, true);
    let (mut by_one, mut by_both) = (Vec::new(), Vec::new());
    for eye in (0..600).map(|i| i % 2) {
        let known = head.view(false);
        let stands = Some(Standing { z_m: known.place.z, sd_mm: 5.0, behind_mm: 0.0 });
        let off = |told: &[Located]| told.iter().map(|l| (Vector3::from(l.position) - known.place).norm()).next_back();
        // Both eyes have seen the object's size for a while.
        let seen = |mut locator: LearnedLocator| {
            let told = (0..10).map(|i| looks(&mut locator, &known, 0.1 * f64::from(i), [Some(20.0); 2]));
            let last = told.last();
            (locator, off(&last.unwrap_or_default()))
        };
        // The other eye does not detect it: the next image of this one shows that.
        let mut hidden = [Some(20.0); 2];
        hidden[1 - eye] = None;
        let (mut alone, with_both) = seen(locator().standing(stands));
        assert!(looks(&mut alone, &known, 1.0, hidden).is_empty());
        let told = looks(&mut alone, &known, 1.1, hidden);
        // A ray parallel to the table does not determine the position.
        let Some(found) = off(&told) else { continue };
        by_one.push(found);
        by_both.extend(with_both);
        hidden[eye] = Some(30.0);
        assert!(looks(&mut alone, &known, 1.2, hidden).is_empty(), "it has another size");
        hidden[eye] = Some(20.0);
        let (mut plain, _) = seen(locator());
        assert!((0..5).all(|i| looks(&mut plain, &known, 2.0 + 0.1 * f64::from(i), hidden).is_empty()));
        // A small part of it in the other eye, with its center elsewhere.
        let mut sliver = known;
        sliver.view.eyes[1 - eye].center[0] += 20.0;
        hidden[1 - eye] = Some(6.0);
        let told = looks(&mut seen(locator().standing(stands)).0, &sliver, 1.0, hidden);
        by_one.extend(off(&told));
    }
    let median = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    assert!(by_one.len() > 20, "{}", by_one.len());
    let [one, both] = [median(by_one), median(by_both)];
    assert!(one < 1.5 * both + 0.005, "{one} {both}");
}

#[test]
fn a_tracker_gets_surer_ignores_what_is_far_off_and_notices_a_move() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let covariance: Matrix3<f64> = Matrix3::from_diagonal(&Vector3::new(1e-4, 1e-4, 9e-4));
    let mut view = |truth: Vector3<f64>| {
        let noise = Vector3::from_fn(|i, _| {
            let sum: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum();
            sum * covariance[(i, i)].sqrt()
        });
        Sight { estimate: Estimate { place: truth + noise, covariance }, size: None }
    };
    let (here, there) = (Vector3::new(0.3, 0.1, 0.0), Vector3::new(0.3, 0.3, 0.0));
    let mut tracker = Tracker::new(Matrix3::identity() * 1e-6);
    let (mut found, mut times) = (None, 0);
    for i in 0..30 {
        let is_off = i % 7 == 6;
        let told = tracker.see(&[view(if is_off { here + Vector3::new(0.5, 0.0, 0.1 * f64::from(i)) } else { here })]);
        assert!(told.is_empty() || !is_off, "what is far off tells nothing: {told:?}");
        times += told.len();
        found = told.last().copied().or(found);
    }
    // One view in twenty is outside its 95 % region.
    assert!(times >= 20, "{times} of 26");
    let found = found.expect("seen");
    assert!((found.place - here).norm() < 0.02 && found.covariance.trace() < 0.1 * covariance.trace());
    let told: Vec<Vec<Estimate>> = (0..12).map(|_| tracker.see(&[view(there)])).collect();
    assert!(told[..2].iter().all(Vec::is_empty), "seen there twice: {told:?}");
    let last = told.concat().pop().expect("it has moved");
    assert!((last.place - there).norm() < 0.05, "{last:?}");
}

#[test]
fn a_small_step_is_taken_as_soon_as_a_large_one() {
    // Regions that include the error shared by all views are much wider than the step.
    let covariance = Matrix3::identity() * 0.03f64.powi(2);
    let mut tracker = Tracker::new(Matrix3::identity() * 1e-4);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut see = |x: f64| {
        let place = Vector3::new(x, 0.0, 0.0) + Vector3::from_fn(|_, _| rng.random_range(-0.002..0.002));
        tracker.see(&[Sight { estimate: Estimate { place, covariance }, size: None }]).first().expect("told").place.x
    };
    let before: Vec<f64> = (0..60).map(|_| see(0.3)).collect();
    assert!(before.iter().all(|x| (x - 0.3).abs() < 0.003), "it rests: {before:?}");
    let after: Vec<f64> = (0..5).map(|_| see(0.34)).collect();
    assert!(after[2..].iter().all(|x| (x - 0.34).abs() < 0.003), "4 cm: {after:?}");
}

/// Tracks a thing that was seen at `(0.3, y, 0)`, with size `size`, in regions that include the
/// error shared by all views.
fn see(tracker: &mut Tracker, y: f64, size: f64) -> Option<f64> {
    let place = Vector3::new(0.3, y, 0.0);
    let estimate = Estimate { place, covariance: Matrix3::identity() * 0.03f64.powi(2) };
    tracker.see(&[Sight { estimate, size: Some(size) }]).first().map(|told| told.place.y)
}

#[test]
fn what_is_half_hidden_stays_where_it_was_until_it_is_so_for_long() {
    let mut tracker = Tracker::new(Matrix3::identity() * 1e-4);
    let mut see = |y: f64, size: f64| see(&mut tracker, y, size).expect("told");
    assert!((0..20).all(|_| see(0.0, 100.0).abs() < 1e-9));
    // A hand occludes it partly: the center of the visible part is beside its own.
    assert!((0..15).all(|_| see(0.02, 50.0).abs() < 1e-9), "it stays");
    assert!(see(0.0, 95.0).abs() < 1e-9, "and is there again");
    let last = (0..40).map(|_| see(0.04, 50.0)).last().expect("told");
    assert!((last - 0.04).abs() < 1e-9, "what is seen like that for long is so: {last}");
}

#[test]
fn specks_are_not_the_object_even_if_nothing_else_is_seen_for_a_while() {
    let mut tracker = Tracker::new(Matrix3::identity() * 1e-4);
    let mut see = |y: f64, size: f64| usize::from(see(&mut tracker, y, size).is_some());
    assert!((0..20).all(|_| see(0.0, 100.0) == 1));
    assert!((0..200).all(|_| see(0.4, 5.0) == 0), "specks elsewhere");
    assert!((0..5).map(|_| see(0.4, 60.0)).sum::<usize>() == 3, "half of it elsewhere");
    let told = (0..300).map(|i| {
        if i % 100 == 50 {
            // An image without a detection contradicts nothing.
            tracker.see(&[]);
        }
        usize::from(self::see(&mut tracker, 0.8, 5.0).is_some())
    });
    assert!(told.sum::<usize>() > 0, "in the end it was taken for something larger than it is");
}

/// A wall detected as the object in the first images, before the eyes turn to the table, must not
/// make a speck of the object.
#[test]
fn what_is_far_away_does_not_tell_how_large_the_object_is() {
    let mut tracker = Tracker::new(Matrix3::identity() * 1e-4);
    let mut see = |x: f64, sd: f64, size: f64| {
        let estimate = Estimate { place: Vector3::new(x, 0.1, 0.0), covariance: Matrix3::identity() * sd * sd };
        tracker.see(&[Sight { estimate, size: Some(size) }]).len()
    };
    assert!((0..20).all(|_| see(3.0, 0.25, 8000.0) == 1));
    assert_eq!((0..6).map(|_| see(0.3, 0.02, 500.0)).sum::<usize>(), 4, "told once it was seen three times");
}

#[test]
fn a_tracker_keeps_two_things_of_the_same_looks_apart() {
    let covariance = Matrix3::identity() * 1e-4;
    let at = |y: f64| Sight { estimate: Estimate { place: Vector3::new(0.3, y, 0.0), covariance }, size: None };
    let mut tracker = Tracker::new(Matrix3::identity() * 1e-6);
    for i in 0..20 {
        // Reported in any order.
        let views = if i % 2 == 0 { [at(0.1), at(0.3)] } else { [at(0.3), at(0.1)] };
        let told = tracker.see(&views);
        let expected = if i < 2 { 1 } else { 2 };
        assert_eq!(told.len(), expected, "the second is told once it was seen three times");
        let is_seen = |told: &Estimate| views.iter().any(|view| (view.estimate.place - told.place).norm() < 1e-9);
        assert!(told.iter().all(is_seen), "neither is drawn to the other: {told:?}");
    }
}
