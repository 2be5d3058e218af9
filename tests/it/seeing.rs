//! The whole chain of seeing, as a configuration composes it: what is moved where only the eyes can tell is where the model has it soon
//! after, and equal seeds see the same.

use mobee::run::{Done, example, in_order};
use nalgebra::Vector3;

fn look(set: &[&str]) -> Done {
    let set = [&["record.enabled=false", "for_s=24"], set].concat();
    let done = example("configs/behaviors/look.toml", &set).expect("a run");
    assert!(in_order(&done.end) && done.complaints.is_empty(), "{:?}", done.complaints);
    done
}

/// How far the model's cup is from here, meters.
fn off(done: &Done, truth: [f64; 3]) -> f64 {
    let (_, cup) = done.end.scene.object("cup").expect("a cup");
    (cup.pose.translation.vector - Vector3::from(truth)).norm()
}

#[test]
fn the_model_follows_what_is_seen_and_equal_seeds_see_the_same() {
    let (done, again) = (look(&[]), look(&[]));
    assert_eq!(done.hash, again.hash);
    let mm = off(&done, [-0.42, -0.12, -0.10]) * 1e3;
    assert!(mm < 20.0, "{mm} mm off");
}

#[test]
fn what_no_sensor_keeps_is_where_the_script_puts_it() {
    let done = look(&["sensor.eyes.gate.objects=[\"table\"]"]);
    assert!(off(&done, [-0.42, -0.12, -0.10]) < 1e-9, "nothing keeps the cup but the script");
}
