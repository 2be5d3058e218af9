//! I13: the same seed gives the same run, event by event; another seed does not.

use crate::common::{Trial, ball};
use mobee_model::ObjectClass;
use mobee_runtime::system::Control;
use std::time::Duration;

fn lines(seed: u64) -> String {
    let objects = vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
    let poses = vec![[30.0, 10.0, 0.0], [150.0, 0.0, 5.0], [0.0, 0.0, 0.0]];
    let controls = vec![
        (Duration::from_millis(1500), Control::Kill("arm/reflex".into())),
        (Duration::from_millis(9000), Control::Kill("model".into())),
        (Duration::from_millis(9500), Control::Kill("arm/driver".into())),
    ];
    Trial { objects, poses, seed, speed: 0.1, controls, ..Trial::default() }.run().lines()
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let first = lines(7);
    assert_eq!(first, lines(7));
    assert_ne!(first, lines(8), "a difference must be seen");
}
