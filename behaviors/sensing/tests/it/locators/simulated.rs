//! Simulated heads with a known true model.

use super::simulated_head::{SimulatedHead, learn, mean_square};
use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::calibrated::Calibrated;
use mobee_sensing::locators::network::PublishedNetwork;
use mobee_sensing::locators::online::OnlineCalibration;
use mobee_sensing::locators::triangulated::Triangulated;
use mobee_sensing::locators::view::{INSIDE_95, KnownView};

#[test]
fn a_head_learns_nearly_all_that_a_hundred_views_can_tell() {
    let ratios: Vec<f64> = (1000..1008).map(|seed| learn(seed, 100)).map(|l| l.error / l.bound).collect();
    let pooled = (ratios.iter().sum::<f64>() / ratios.len() as f64).sqrt();
    assert!(pooled < 1.15 && ratios.iter().all(|r| *r < 4.0), "{pooled} {ratios:?}");
}

#[test]
fn stated_regions_hold_what_they_promise() {
    let inside = |seed: u64| {
        let mut head = SimulatedHead::new(seed);
        let seen: Vec<KnownView> = (0..300).map(|_| head.view(true)).collect();
        let ready = Calibrated::train(&seen, &Beginning::recorded(0), &mut |_| ()).expect("learned").ready();
        let is_inside = |k: &KnownView| ready.locate(&k.view).is_some_and(|e| e.distance(&k.place) <= INSIDE_95);
        (0..300).map(|_| head.view(true)).filter(is_inside).count()
    };
    let inside: Vec<usize> = (77..83).map(inside).collect();
    let sum: usize = inside.iter().sum();
    assert!((93 * 18..=97 * 18).contains(&sum), "of 300 each: {inside:?}");
}

#[test]
fn a_jump_of_an_encoder_is_named_and_followed() {
    for joint in [0, 3, 6, 8] {
        let mut of = learn(2000 + joint as u64, 150);
        of.head.model.theta[joint] += 2.0_f64.to_radians();
        let mut online = OnlineCalibration::new(of.calibrated);
        let told: Vec<_> = (0..50).filter_map(|_| online.see(of.head.view(true))).collect();
        let first = told.first().expect("it is noticed");
        assert_eq!(first.joint, joint, "{told:?}");
        let test: Vec<KnownView> = (0..100).map(|_| of.head.view(false)).collect();
        let after = mean_square(online.learned(), &test);
        assert!(after < 1.7 * of.error, "{joint}: {after} after {}", of.error);
    }
}

#[test]
fn nothing_is_named_while_nothing_jumps() {
    let mut of = learn(3000, 150);
    let mut online = OnlineCalibration::new(of.calibrated);
    let told: Vec<_> = (0..300).filter_map(|_| online.see(of.head.view(true))).collect();
    assert!(told.is_empty(), "{told:?}");
}

#[test]
fn the_same_views_and_seed_teach_the_same() {
    let mut head = SimulatedHead::new(5);
    let seen: Vec<KnownView> = (0..60).map(|_| head.view(true)).collect();
    let learned = || Calibrated::train(&seen, &Beginning::recorded(3), &mut |_| ()).expect("learned");
    assert_eq!(learned(), learned());
    let few = Calibrated::train(&seen[..10], &Beginning::recorded(3), &mut |_| ()).expect_err("too few");
    assert!(few.to_string().contains("10 views of 10 places are too few"), "{few}");
}

#[test]
fn a_model_that_was_fitted_beats_the_drawings() {
    let mut head = SimulatedHead::new(9);
    let seen: Vec<KnownView> = (0..100).map(|_| head.view(true)).collect();
    let test: Vec<KnownView> = (0..100).map(|_| head.view(false)).collect();
    let fitted = mean_square(&Calibrated::train(&seen, &Beginning::recorded(0), &mut |_| ()).expect("learned"), &test);
    let drawn = Triangulated::train(&seen, &Beginning::recorded(0)).expect("learned");
    let off = |k: &KnownView| drawn.locate(&k.view).map(|e| (e.place - k.place).norm_squared());
    let drawn = test.iter().filter_map(off).sum::<f64>() / test.len() as f64;
    assert!(fitted < 0.25 * drawn, "{fitted} {drawn}");
    // The published network has fixed input limits: positions far outside of them can't train it.
    assert!(PublishedNetwork::train(&seen[..10], 0, &mut |_| ()).is_err());
}
