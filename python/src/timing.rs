//! Trajectories along paths of straight lines: each line from rest to rest, as fast as limits of velocity, acceleration and jerk permit.
//! No Python here.
//!
//! A trajectory that stays on the lines must stop at each corner. In return it never leaves what was proved free: blending corners would.

use crate::failure::Failure;
use rsruckig::prelude::{InputParameter, Ruckig, ThrowErrorHandler, Trajectory};

/// Samples of a trajectory at most.
const MAX_SAMPLES: f64 = 1e7;
/// Corners with a smaller change of direction are none.
const STRAIGHT: f64 = 1e-9;

/// Limits of each joint, rad or m, per s, s^2 and s^3.
pub(crate) struct TimingLimits {
    pub velocity: Vec<f64>,
    pub acceleration: Vec<f64>,
    pub jerk: Vec<f64>,
}

/// A trajectory: numbers of all joints for each time, row by row.
#[derive(Default)]
pub(crate) struct TimedPath {
    pub times: Vec<f64>,
    pub q: Vec<f64>,
    pub velocity: Vec<f64>,
    pub acceleration: Vec<f64>,
}

/// Times a path of `width` joints.
///
/// # Arguments
/// * `every`: period of the samples, s. Corners are samples, too.
///
/// # Errors
/// Limits or a path for which there is no trajectory; too many samples.
pub(crate) fn timed(path: &[f64], width: usize, limits: &TimingLimits, every: f64) -> Result<TimedPath, Failure> {
    let corners = corners(path, width);
    let Some(first) = corners.first() else {
        return Err(Failure::new("shape", "the path has no configuration", "give one at least"));
    };
    let mut out = TimedPath::default();
    out.push(0.0, first, &vec![0.0; width], (0.0, 0.0));
    let mut begun = 0.0;
    for leg in corners.windows(2) {
        let [from, to] = leg else { continue };
        let way: Vec<f64> = from.iter().zip(to.iter()).map(|(a, b)| b - a).collect();
        let length = way.iter().fold(0.0_f64, |most, d| most.max(d.abs()));
        let profile = profile(&way, length, limits)?;
        let duration = profile.get_duration();
        if (begun + duration) / every > MAX_SAMPLES {
            let message = format!("a sample every {every} s are too many for {:.1} s", begun + duration);
            return Err(Failure::new("too_many", message, "give a longer period").at("every"));
        }
        // samples of the whole trajectory are at multiples of the period
        let mut tick = (begun / every).floor() + 1.0;
        while tick * every < begun + duration - every * 1e-6 {
            let (s, v, a) = at(&profile, tick * every - begun);
            let unit: Vec<f64> = way.iter().map(|d| d / length).collect();
            let q: Vec<f64> = from.iter().zip(&unit).map(|(q, u)| q + u * s).collect();
            out.push(tick * every, &q, &unit, (v, a));
            tick += 1.0;
        }
        begun += duration;
        out.push(begun, to, &vec![0.0; width], (0.0, 0.0));
    }
    Ok(out)
}

impl TimedPath {
    fn push(&mut self, time: f64, q: &[f64], unit: &[f64], (speed, acceleration): (f64, f64)) {
        self.times.push(time);
        self.q.extend_from_slice(q);
        self.velocity.extend(unit.iter().map(|u| u * speed));
        self.acceleration.extend(unit.iter().map(|u| u * acceleration));
    }
}

/// The ends of straight lines: without repeated configurations, and without those between two ends of a line.
fn corners(path: &[f64], width: usize) -> Vec<&[f64]> {
    let mut all: Vec<&[f64]> = Vec::new();
    let way = |a: &[f64], b: &[f64]| -> Vec<f64> {
        let way: Vec<f64> = a.iter().zip(b).map(|(a, b)| b - a).collect();
        let length = way.iter().map(|d| d * d).sum::<f64>().sqrt();
        way.iter().map(|d| d / length).collect()
    };
    for q in path.chunks_exact(width.max(1)) {
        if all.last() == Some(&q) {
            continue;
        }
        if let [.., a, b] = all.as_slice()
            && way(a, b).iter().zip(way(b, q)).all(|(x, y)| (x - y).abs() < STRAIGHT)
        {
            all.pop();
        }
        all.push(q);
    }
    all
}

/// The time-optimal way from rest at 0 to rest at `length`, where all joints move in proportion.
fn profile(way: &[f64], length: f64, limits: &TimingLimits) -> Result<Trajectory<1>, Failure> {
    let least = |limits: &[f64]| {
        let share = |(limit, d): (&f64, &f64)| if *d == 0.0 { f64::INFINITY } else { limit * length / d.abs() };
        limits.iter().zip(way).map(share).fold(f64::INFINITY, f64::min)
    };
    let mut input = InputParameter::<1>::new(None);
    input.target_position[0] = length;
    input.max_velocity[0] = least(&limits.velocity);
    input.max_acceleration[0] = least(&limits.acceleration);
    input.max_jerk[0] = least(&limits.jerk);
    let mut profile = Trajectory::<1>::new(None);
    let done = Ruckig::<1, ThrowErrorHandler>::new(None, 0.001).calculate(&input, &mut profile);
    let wrong = |why: String| {
        let message = format!("no trajectory was found along an edge of {length:.3e}: {why}");
        Failure::new("limits", message, "give limits of similar magnitude")
    };
    done.map_err(|e| wrong(e.to_string()))?;
    let (end, ..) = at(&profile, profile.get_duration());
    if !profile.get_duration().is_finite() || (end - length).abs() > 1e-6 * length {
        return Err(wrong(format!("it ends at {end}")));
    }
    Ok(profile)
}

/// Position, velocity and acceleration at a time.
fn at(profile: &Trajectory<1>, time: f64) -> (f64, f64, f64) {
    let mut section = None;
    let [mut q, mut v, mut a] = [const { [0.0] }; 3].map(rsruckig::util::DataArrayOrVec::Stack);
    profile.at_time(time, &mut Some(&mut q), &mut Some(&mut v), &mut Some(&mut a), &mut None, &mut section);
    (q[0], v[0], a[0])
}
