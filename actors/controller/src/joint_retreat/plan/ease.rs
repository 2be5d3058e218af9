//! How a recorded path is gone backwards by set-points that a robot that lags can follow.
//!
//! The path begins with what was a stop, and ends with what was a start, both at the motors' greatest acceleration. At
//! the recorded rate a motor that is a little late catches up faster than it came, and where the set-points brake as
//! hard as it can, it can't lose that speed before their end: it overshoots.
//!
//! At the rate `r`, a share of the recorded one, a motor on the path `q(s)` accelerates by `q'' r^2 + q' r r'`. The
//! first term bounds `r^2`, the second its slope: time-optimal path parametrization (Bobrow, Dubowsky and Gibson,
//! 1985), with each term bounded by itself.

use mobee_contract::Pose;

/// Share of the greatest acceleration that the path may ask for by its own bends.
const BEND: f64 = 0.7;
/// And beside it, changes of the rate: what is left is for catching up.
const CHANGE: f64 = 0.1;
/// Over how long before and after an instant speeds are taken, s: encoders are noisy, and a difference of differences
/// over 10 ms would be nothing but that noise. Where a motor has gained speed and begins to lose it, that sees neither.
const SPAN: f64 = 0.05;
/// The square of the slowest rate, which is 0.63: an encoder that jumps asks for no pause, and no path takes 1.6 times
/// as long.
const SLOWEST: f64 = 0.4;
/// The two where motors may turn about in mid-motion: there robots are deepest in each other, and each lags in its own way.
const TURNING: (f64, f64) = (0.35, 0.2);

/// The points of a path, seconds and radians, at times at which its motors can gain and lose speed as it does, with
/// these greatest accelerations, rad/s^2. `turns`: whether it may turn about in mid-motion, and not only set out and stop.
pub fn eased(points: &[(f64, Pose)], accelerations: &[f64], turns: bool) -> Vec<(f64, Pose)> {
    let least = if turns { TURNING } else { (BEND, SLOWEST) };
    let bounds = |(t, _): &(f64, Pose)| bounds(points, *t, accelerations, least);
    let (squares, slopes): (Vec<f64>, Vec<f64>) = points.iter().map(bounds).unzip();
    let mut squares = if turns { least_about(points, &squares) } else { squares };
    let secs: Vec<f64> = points.iter().zip(points.iter().skip(1)).map(|(a, b)| b.0 - a.0).collect();
    let steps: Vec<f64> = secs.iter().zip(&slopes).map(|(secs, slope)| secs * slope).collect();
    // there and back again, as in every time-optimal parametrization: what can be reached from before, and braked to
    // from behind
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

/// The least of these values of points within [`SPAN`] of each: what is asked for just before and just after an instant is seen there.
fn least_about(points: &[(f64, Pose)], values: &[f64]) -> Vec<f64> {
    let mut from = 0;
    let least = |(here, _): &(f64, Pose)| {
        from += points.iter().skip(from).take_while(|(t, _)| *t < here - SPAN).count();
        let about = points.iter().zip(values).skip(from).take_while(|((t, _), _)| *t <= here + SPAN);
        about.map(|(_, value)| *value).fold(f64::INFINITY, f64::min)
    };
    points.iter().map(least).collect()
}

/// From one point to the next the square of the rate rises by so much at most.
fn reach(squares: &mut [f64], from: usize, to: usize, step: f64) {
    let most = squares.get(from).map_or(f64::INFINITY, |square| square + step);
    if let Some(square) = squares.get_mut(to) {
        *square = square.min(most);
    }
}

/// The greatest square of the rate at that time of the path, and by how much it may change per second; with a share of the
/// accelerations for the path's own bends, and the square of the slowest rate.
fn bounds(points: &[(f64, Pose)], secs: f64, accelerations: &[f64], (bend, slowest): (f64, f64)) -> (f64, f64) {
    let [before, here, after] = [secs - SPAN, secs, secs + SPAN].map(|t| passed(points, t));
    let (mut square, mut slope) = (1.0_f64, f64::INFINITY);
    for (((a, b), c), most) in before.iter().zip(&here).zip(&after).zip(accelerations) {
        let (speed, gained) = ((c - a) / (2.0 * SPAN), (a - b - b + c) / (SPAN * SPAN));
        square = square.min(bend * most / gained.abs());
        slope = slope.min(2.0 * CHANGE * most / speed.abs());
    }
    (square.max(slowest), slope)
}

/// Where the path is at that time; before its beginning and after its end it rests.
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

    /// What a motor goes that gains speed with `acceleration` up to `speed`, goes on for `cruise` seconds, and brakes:
    /// readings each 10 ms.
    fn motion(acceleration: f64, speed: f64, cruise: f64) -> Vec<(f64, Pose)> {
        let ramp = speed / acceleration;
        let at = |t: f64| {
            let (up, down) = (t.min(ramp), (t - ramp - cruise).clamp(0.0, ramp));
            0.5 * acceleration * (up * up - down * down) + speed * (t - ramp).clamp(0.0, cruise + ramp)
        };
        let secs = 2.0 * ramp + cruise;
        (0..=(secs * 100.0).ceil() as usize).map(|k| k as f64 * 0.01).map(|t| (t, vec![at(t)].into())).collect()
    }

    /// The greatest acceleration of a path between spans of time.
    fn greatest(points: &[(f64, Pose)], span: f64) -> f64 {
        let end = points.last().unwrap().0;
        let gained = |t: f64| {
            let [a, b, c] = [t - span, t, t + span].map(|t| passed(points, t)[0]);
            ((a - b - b + c) / (span * span)).abs()
        };
        (0..=(end * 1000.0) as usize).map(|ms| gained(ms as f64 * 1e-3)).fold(0.0, f64::max)
    }

    proptest! {
        /// Whoever follows has a tenth of its acceleration left, wherever a path that asks for all of it gains or loses
        /// speed. That takes a fifth of the time at most; and none for a path that asks for a third.
        #[test]
        fn an_eased_path_leaves_room_to_brake(acceleration in 0.5..10.0_f64, ramp in 0.15..1.0_f64, cruise in 0.0..2.0_f64) {
            let path = motion(acceleration, ramp * acceleration, cruise);
            let eased = eased(&path, &[acceleration], false);
            let (before, after) = (greatest(&path, SPAN), greatest(&eased, SPAN));
            prop_assert!(before > 0.99 * acceleration && after < 0.9 * acceleration, "{before} {after} of {acceleration}");
            let (took, takes) = (path.last().unwrap().0, eased.last().unwrap().0);
            prop_assert!(takes <= 1.2 * took, "{takes} s for {took} s");
            prop_assert!(path.iter().zip(&eased).all(|(a, b)| a.1 == b.1));
            let calm = super::eased(&path, &[3.0 * acceleration], true);
            prop_assert!(path.iter().zip(&calm).all(|(a, b)| a.1 == b.1 && (a.0 - b.0).abs() < 1e-9));
        }
    }

    /// What a robot goes that brakes beyond the set-point at which it was told to stay, and comes back to it: gone once more, it would go
    /// farther where its set-points brake as hard as it can, though it has gained speed just before.
    #[test]
    fn where_a_motor_that_gains_speed_begins_to_lose_it_it_has_room_to_brake() {
        let (acceleration, ramp) = (3.5, 0.12);
        // there for two ramps, turning between them, and a third to rest
        let at = |t: f64| {
            let [one, two, three] = [0.0, ramp, 3.0 * ramp].map(|from| (t - from).max(0.0).powi(2));
            0.5 * acceleration * (one - 2.0 * two + 2.0 * three)
        };
        let path: Vec<(f64, Pose)> =
            (0..=(4000.0 * ramp) as usize).map(|ms| ms as f64 * 1e-3).map(|t| (t, vec![at(t)].into())).collect();
        let asked = greatest(&eased(&path, &[acceleration], true), 0.02);
        assert!(greatest(&path, 0.02) > 0.99 * acceleration && asked < 0.5 * acceleration, "{asked} of {acceleration}");
    }

    #[test]
    fn an_encoder_that_jumps_asks_for_no_pause() {
        let jump: Vec<(f64, Pose)> =
            (0..100).map(|k| (0.01 * k as f64, vec![f64::from(u8::from(k > 50))].into())).collect();
        for (turns, slowest) in [(false, SLOWEST), (true, TURNING.1)] {
            let takes = eased(&jump, &[1.0], turns).last().unwrap().0;
            assert!(takes < 0.99 / slowest.sqrt() + 1e-9, "{takes} s");
        }
        assert!(eased(&[], &[1.0], true).is_empty());
        assert_eq!(eased(&jump[..1], &[1.0], true), jump[..1]);
    }
}
