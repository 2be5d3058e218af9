use super::*;
use proptest::prelude::*;

fn settings() -> WorldGateSettings {
    WorldGateSettings {
        objects: vec!["cup".into(), "box".into()],
        workspace: [[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]],
        jump: 0.1,
        confirmations: 3,
        uncertainty: 0.02,
        least_move: 0.005,
        stale: Duration::from_secs(2),
    }
}

fn at(object: &str, position: [f64; 3]) -> Located {
    let variance = 0.01_f64.powi(2);
    let covariance = [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]];
    Located { object: object.into(), position, covariance }
}

fn secs(s: f64) -> Time {
    Time::from_secs(s)
}

/// A gate that has the cup at (0.3, 0, 1).
fn with_cup() -> WorldGate {
    let mut gate = WorldGate::new(settings(), Time::ZERO);
    let all: Vec<_> =
        (1..=3).flat_map(|k| gate.admit(secs(0.1 * f64::from(k)), &[at("cup", [0.3, 0.0, 1.0])])).collect();
    assert_eq!(all, [Admission::Waits, Admission::Waits, Admission::Moved]);
    gate
}

fn place(gate: &WorldGate) -> Option<[f64; 3]> {
    gate.objects().iter().find(|k| k.object == "cup").and_then(|k| k.place)
}

#[test]
fn small_moves_are_followed_and_smaller_ones_left() {
    let mut gate = with_cup();
    assert_eq!(gate.admit(secs(1.0), &[at("cup", [0.304, 0.0, 1.0])]), [Admission::Agrees]);
    assert_eq!(gate.admit(secs(1.1), &[at("cup", [0.308, 0.0, 1.0])]), [Admission::Moved], "small moves add up");
    assert_eq!(gate.admit(secs(1.2), &[at("cup", [0.38, 0.0, 1.0])]), [Admission::Moved]);
}

#[test]
fn an_object_that_jumps_is_believed_when_it_stays_there() {
    let mut gate = with_cup();
    let far = [at("cup", [-0.4, 0.2, 1.0])];
    assert_eq!(gate.admit(secs(1.0), &far), [Admission::Waits]);
    assert_eq!(gate.admit(secs(1.1), &far), [Admission::Waits]);
    assert_eq!(gate.admit(secs(1.2), &far), [Admission::Moved]);
    assert_eq!(place(&gate), Some([-0.4, 0.2, 1.0]));
}

#[test]
fn outliers_that_are_each_near_the_one_before_do_not_lead_it_away() {
    let mut gate = with_cup();
    let steps =
        (1..=10).map(|k| gate.admit(secs(1.0 + 0.1 * f64::from(k)), &[at("cup", [0.3, 0.06 * f64::from(k), 1.0])]));
    let all: Vec<_> = steps.flatten().collect();
    assert_eq!(all[..2], [Admission::Moved, Admission::Waits], "6 cm, then 12 cm from where it was steady: {all:?}");
    assert!(all[2..].iter().all(|a| *a == Admission::Waits), "it is nowhere twice: {all:?}");
    // An object that moves on slowly is tracked.
    let mut gate = with_cup();
    let steps =
        (1..=30).map(|k| gate.admit(secs(1.0 + 0.1 * f64::from(k)), &[at("cup", [0.3, 0.02 * f64::from(k), 1.0])]));
    assert!(steps.flatten().all(|a| a == Admission::Moved));
}

#[test]
fn a_second_object_of_the_same_appearance_is_distinguished() {
    let mut gate = with_cup();
    for k in 0..20 {
        let both = [at("cup", [-0.4, 0.2, 1.0]), at("cup", [0.301, 0.0, 1.0])];
        assert_eq!(gate.admit(secs(1.0 + f64::from(k)), &both), [Admission::Other, Admission::Agrees]);
    }
    // They are seen alternately: the other one is not seen often enough in a row.
    for k in 0..20 {
        let one = if k % 3 == 0 { at("cup", [0.3, 0.0, 1.0]) } else { at("cup", [-0.4, 0.2, 1.0]) };
        gate.admit(secs(30.0 + f64::from(k)), &[one]);
        assert_eq!(place(&gate).unwrap()[1], 0.0);
    }
}

#[test]
fn what_is_not_known_not_sure_or_not_possible_moves_nothing() {
    let mut gate = with_cup();
    let vague = Located { covariance: [[1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 0.0, 1e-2]], ..at("cup", [0.3; 3]) };
    let broken =
        [at("cup", [f64::NAN, 0.0, 1.0]), Located { covariance: [[f64::INFINITY; 3]; 3], ..at("cup", [0.3; 3]) }];
    let all = [at("hat", [0.3, 0.0, 1.0]), vague, at("cup", [0.3, 0.0, -0.1]), broken[0].clone(), broken[1].clone()];
    use Admission::{Foreign, Outside, Unsure};
    for k in 0..5 {
        assert_eq!(gate.admit(secs(1.0 + f64::from(k)), &all), [Foreign, Unsure, Outside, Foreign, Foreign]);
    }
    assert_eq!(place(&gate), Some([0.3, 0.0, 1.0]));
}

#[test]
fn what_is_not_seen_is_stale_once_and_not_gone() {
    let mut gate = with_cup();
    assert_eq!(gate.stale(secs(2.0)), [""; 0], "the box was last seen never, and the gate is two seconds old");
    assert_eq!(gate.stale(secs(2.2)), ["box"]);
    assert_eq!(gate.stale(secs(3.0)), ["cup"]);
    assert_eq!(gate.stale(secs(4.0)), [""; 0]);
    assert_eq!(place(&gate), Some([0.3, 0.0, 1.0]));
    gate.admit(secs(5.0), &[at("cup", [0.3, 0.0, 1.0])]);
    assert!(gate.objects().iter().any(|k| k.object == "cup" && !k.is_stale && k.seen == secs(5.0)));
}

proptest! {
    /// Fewer consecutive outliers than confirmations move nothing, at any place and after any history.
    #[test]
    fn outliers_move_nothing(
        outliers in prop::collection::vec([-0.9..0.9, -0.9..0.9, 0.1..1.9f64], 1..60),
        in_a_row in 1usize..3,
    ) {
        let mut gate = with_cup();
        for (k, outlier) in outliers.into_iter().enumerate() {
            let t = secs(1.0 + k as f64);
            let far = (Vector3::from(outlier) - Vector3::new(0.3, 0.0, 1.0)).norm() > 0.1;
            if k % (in_a_row + 1) == in_a_row || !far {
                gate.admit(t, &[at("cup", [0.3, 0.0, 1.0])]);
            } else {
                prop_assert_eq!(gate.admit(t, &[at("cup", outlier)]), [Admission::Waits]);
            }
            prop_assert_eq!(place(&gate), Some([0.3, 0.0, 1.0]));
        }
    }
}
