//! Retiming of a recorded path, driven backwards, so that a lagging robot can follow its set-points.
//!
//! The reversed path begins with a recorded stop and ends with a recorded start, both at the motors' greatest
//! acceleration. At the recorded rate, a slightly late motor catches up faster than it came. Where the set-points
//! brake as hard as the motor can, it cannot lose that speed before their end: it overshoots.
//!
//! At the rate `r`, a share of the recorded one, a motor on the path `q(s)` accelerates by `q'' r^2 + q' r r'`. The
//! first term bounds `r^2`, the second its slope: time-optimal path parametrization (Bobrow, Dubowsky and Gibson,
//! 1985), with each term bounded separately.

use mobee_contract::Pose;

/// Greatest acceleration by the path's own bends, as a share of the motor's.
const BEND_SHARE: f64 = 0.7;
/// Greatest acceleration by changes of the rate, as a share of the motor's, in addition: the rest is for catching up.
const RATE_CHANGE_SHARE: f64 = 0.1;
/// Time span before and after an instant for finite differences, s. Encoders are noisy: a second difference over 10
/// ms would be pure noise. Where a motor has just accelerated and begins to brake, the second difference sees
/// neither.
const DIFFERENCE_SPAN: f64 = 0.05;
/// Square of the least rate, which is 0.63: a jump of an encoder causes no pause, and no path takes more than 1.6
/// times as long.
const MIN_RATE_SQUARED: f64 = 0.4;
/// Bend share and square of the least rate of a path on which motors may reverse in mid-motion: there robots are
/// deepest in each other, and each lags differently.
const REVERSING: (f64, f64) = (0.35, 0.2);

/// Returns the points of a path, seconds and radians, at new times that its motors can follow with these greatest
/// accelerations, rad/s^2. `reverses`: whether motors may reverse in mid-motion, and not only set out and stop.
pub fn eased(points: &[(f64, Pose)], accelerations: &[f64], reverses: bool) -> Vec<(f64, Pose)> {
    let least = if reverses { REVERSING } else { (BEND_SHARE, MIN_RATE_SQUARED) };
    let bounds = |(t, _): &(f64, Pose)| bounds(points, *t, accelerations, least);
    let (squares, slopes): (Vec<f64>, Vec<f64>) = points.iter().map(bounds).unzip();
    let mut squares = if reverses { least_about(points, &squares) } else { squares };
    let secs: Vec<f64> = points.iter().zip(points.iter().skip(1)).map(|(a, b)| b.0 - a.0).collect();
    let steps: Vec<f64> = secs.iter().zip(&slopes).map(|(secs, slope)| secs * slope).collect();
    // A forward and a backward pass, as in every time-optimal parametrization: the rates that can be reached, and
    // those that can be braked from.
    for (i, step) in steps.iter().enumerate() {
        reach(&mut squares, i, i + 1, *step);
    }
    for (i, step) in steps.iter().enumerate().rev() {
        reach(&mut squares, i + 1, i, *step);
    }
    let mut then = 0.0;
    let rest = secs.iter().zip(squares.windows(2)).zip(points.iter().skip(1)).map(|((secs, squares), (_, q))| {
        then += secs / (squares.iter().sum::<f64>() / 2.0).sqrt();
        (then, q.clone())
    });
    points.first().map(|(_, q)| (0.0, q.clone())).into_iter().chain(rest).collect()
}

/// Least of these values within [`DIFFERENCE_SPAN`] of each point: it includes requirements just before and after the
/// instant.
fn least_about(points: &[(f64, Pose)], values: &[f64]) -> Vec<f64> {
    let mut from = 0;
    let least = |(here, _): &(f64, Pose)| {
        from += points.iter().skip(from).take_while(|(t, _)| *t < here - DIFFERENCE_SPAN).count();
        let about = points.iter().zip(values).skip(from).take_while(|((t, _), _)| *t <= here + DIFFERENCE_SPAN);
        about.map(|(_, value)| *value).fold(f64::INFINITY, f64::min)
    };
    points.iter().map(least).collect()
}

/// Limits the square of the rate at point `to` to that at point `from` plus `step`.
fn reach(squares: &mut [f64], from: usize, to: usize, step: f64) {
    let most = squares.get(from).map_or(f64::INFINITY, |square| square + step);
    if let Some(square) = squares.get_mut(to) {
        *square = square.min(most);
    }
}

/// Bounds of the rate at that time of the path: greatest square, and greatest change of the square per second.
/// `bend`: share of the accelerations for the path's own bends; `slowest`: square of the least rate.
fn bounds(points: &[(f64, Pose)], secs: f64, accelerations: &[f64], (bend, slowest): (f64, f64)) -> (f64, f64) {
    let [before, here, after] = [secs - DIFFERENCE_SPAN, secs, secs + DIFFERENCE_SPAN].map(|t| passed(points, t));
    let mut square = 1.0_f64;
    let mut slope = f64::INFINITY;
    for (((a, b), c), most) in before.iter().zip(&here).zip(&after).zip(accelerations) {
        let speed = (c - a) / (2.0 * DIFFERENCE_SPAN);
        let gained = (a - b - b + c) / (DIFFERENCE_SPAN * DIFFERENCE_SPAN);
        square = square.min(bend * most / gained.abs());
        slope = slope.min(2.0 * RATE_CHANGE_SHARE * most / speed.abs());
    }
    (square.max(slowest), slope)
}

/// Configuration at that time of the path; before its beginning and after its end it rests.
fn passed(points: &[(f64, Pose)], secs: f64) -> Vec<f64> {
    let after = points.partition_point(|(t, _)| *t <= secs);
    match (after.checked_sub(1).and_then(|i| points.get(i)), points.get(after)) {
        (Some((t0, a)), Some((t1, b))) => {
            let part = (secs - t0) / (t1 - t0).max(1e-9);
            a.iter().zip(b.iter()).map(|(a, b)| a + (b - a) * part).collect()
        }
        (a, b) => a.or(b).map(|(_, q)| q.to_vec()).unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Motion of a motor that accelerates with `acceleration` up to `speed`, cruises for `cruise` seconds, and
    /// brakes: readings every 10 ms.
    fn motion(acceleration: f64, speed: f64, cruise: f64) -> Vec<(f64, Pose)> {
        let ramp = speed / acceleration;
        let at = |t: f64| {
            let (up, down) = (t.min(ramp), (t - ramp - cruise).clamp(0.0, ramp));
            0.5 * acceleration * (up * up - down * down) + speed * (t - ramp).clamp(0.0, cruise + ramp)
        };
        let secs = 2.0 * ramp + cruise;
        (0..=(secs * 100.0).ceil() as usize).map(|k| k as f64 * 0.01).map(|t| (t, vec![at(t)].into())).collect()
    }

    /// Greatest acceleration of a path, by differences over this span of time.
    fn greatest(points: &[(f64, Pose)], span: f64) -> f64 {
        let end = points.last().unwrap().0;
        let gained = |t: f64| {
            let [a, b, c] = [t - span, t, t + span].map(|t| passed(points, t)[0]);
            ((a - b - b + c) / (span * span)).abs()
        };
        (0..=(end * 1000.0) as usize).map(|ms| gained(ms as f64 * 1e-3)).fold(0.0, f64::max)
    }

    proptest! {
        /// A follower has a tenth of its acceleration left, wherever a path that uses all of it accelerates or
        /// brakes. The path takes up to a fifth longer; a path that uses a third is not changed.
        #[test]
        fn an_eased_path_leaves_room_to_brake(acceleration in 0.5..10.0_f64, ramp in 0.15..1.0_f64, cruise in 0.0..2.0_f64) {
            let path = motion(acceleration, ramp * acceleration, cruise);
            let eased = eased(&path, &[acceleration], false);
            let before = greatest(&path, DIFFERENCE_SPAN);
            let after = greatest(&eased, DIFFERENCE_SPAN);
            prop_assert!(before > 0.99 * acceleration && after < 0.9 * acceleration, "{before} {after} of {acceleration}");
            let took = path.last().unwrap().0;
            let takes = eased.last().unwrap().0;
            prop_assert!(takes <= 1.2 * took, "{takes} s for {took} s");
            prop_assert!(path.iter().zip(&eased).all(|(a, b)| a.1 == b.1));
            let calm = super::eased(&path, &[3.0 * acceleration], true);
            prop_assert!(path.iter().zip(&calm).all(|(a, b)| a.1 == b.1 && (a.0 - b.0).abs() < 1e-9));
        }
    }

    /// Path of a robot that brakes beyond the set-point at which it was to stay, and returns to it: a retreat along
    /// it would overshoot where its set-points brake as hard as the robot can, though it has accelerated just before.
    #[test]
    fn where_a_motor_that_gains_speed_begins_to_lose_it_it_has_room_to_brake() {
        let acceleration = 3.5;
        let ramp = 0.12;
        // two ramps there, reversing between them, and a third to rest
        let at = |t: f64| {
            let [one, two, three] = [0.0, ramp, 3.0 * ramp].map(|from| (t - from).max(0.0).powi(2));
            0.5 * acceleration * (one - 2.0 * two + 2.0 * three)
        };
        let path: Vec<(f64, Pose)> =
            (0..=(4000.0 * ramp) as usize).map(|ms| ms as f64 * 1e-3).map(|t| (t, vec![at(t)].into())).collect();
        let required = greatest(&eased(&path, &[acceleration], true), 0.02);
        assert!(
            greatest(&path, 0.02) > 0.99 * acceleration && required < 0.5 * acceleration,
            "{required} of {acceleration}"
        );
    }

    #[test]
    fn a_jump_of_an_encoder_causes_no_pause() {
        let jump: Vec<(f64, Pose)> =
            (0..100).map(|k| (0.01 * k as f64, vec![f64::from(u8::from(k > 50))].into())).collect();
        for (reverses, slowest) in [(false, MIN_RATE_SQUARED), (true, REVERSING.1)] {
            let takes = eased(&jump, &[1.0], reverses).last().unwrap().0;
            assert!(takes < 0.99 / slowest.sqrt() + 1e-9, "{takes} s");
        }
        assert!(eased(&[], &[1.0], true).is_empty());
        assert_eq!(eased(&jump[..1], &[1.0], true), jump[..1]);
    }
}
