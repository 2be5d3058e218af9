//! Check of joint speeds against the commanded ones. A board that received other references from another
//! program does not follow ours.

use super::layout::Layout;

/// Greatest speed by commanded speed of a board that accelerates and brakes smoothly; 1.875 for a
/// minimum-jerk trajectory.
const EASED: f64 = 2.0;
/// Apparent speed of a slow joint by encoder noise and the board's own control, deg/s.
const NOISE: f64 = 5.0;
/// Time that a joint may take to reach a lower commanded speed, s.
const SLOWING: f64 = 1.0;

/// Speed limits of one board's joints, deg/s.
#[derive(Clone, Debug)]
pub struct Pace(Vec<SpeedLimit>);

#[derive(Clone, Copy, Debug)]
struct SpeedLimit {
    most: f64,
    before: f64,
    at: f64,
}

/// A joint that is too fast, deg/s.
#[derive(Clone, Debug, PartialEq)]
pub struct TooFast {
    pub joint: usize,
    pub speed: f64,
    pub most: f64,
}

impl Pace {
    /// Creates the check without any limit.
    pub fn new(axes: usize) -> Pace {
        Pace(vec![SpeedLimit { most: f64::INFINITY, before: f64::INFINITY, at: f64::NEG_INFINITY }; axes])
    }

    /// Sets the speed limits of these joints.
    pub fn set_limit(&mut self, joints: &[usize], most: &[f64], now: f64) {
        for (j, most) in joints.iter().zip(most) {
            if let Some(limit) = self.0.get_mut(*j) {
                *limit = SpeedLimit { most: *most, before: limit.most, at: now };
            }
        }
    }

    /// First joint that is faster than commanded by more than a board's own profile explains.
    pub fn exceeded(&self, speeds: &[f64], now: f64) -> Option<TooFast> {
        let too_fast = |(joint, (limit, speed)): (usize, (&SpeedLimit, &f64))| {
            let slowing = now < limit.at + SLOWING && limit.before.is_finite();
            let most = if slowing { limit.most.max(limit.before) } else { limit.most };
            (*speed > EASED * most + NOISE).then_some(TooFast { joint, speed: *speed, most })
        };
        self.0.iter().zip(speeds).enumerate().find_map(too_fast)
    }
}

impl TooFast {
    /// Message for the operator: the motor, its speed, and the remedy.
    pub fn in_words(&self, layout: &Layout, board: usize) -> String {
        let TooFast { joint, speed, most } = self;
        let patch = layout.patches.get(board);
        let motor = patch.map_or(usize::MAX, |p| p.motors.start + joint);
        let name = layout.names.get(motor).map_or("?", String::as_str);
        let unit = layout.motions.get(motor).copied().unwrap_or_default().unit();
        let port = patch.map_or("", |p| p.port.as_str());
        format!(
            "motor {name} (joint {joint} of {port}) moves at {speed:.0} {unit}/s and was told {most:.0}: end the program that writes to {port} beside MoBeE; if there is none, this board's reference speeds mean no speeds: set moves = \"set-points\""
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_may_ease_and_slow_down_but_not_exceed_its_limit() {
        let mut pace = Pace::new(2);
        assert_eq!(pace.exceeded(&[500.0, 500.0], 0.0), None, "nothing was told");
        pace.set_limit(&[0, 1], &[20.0, 50.0], 1.0);
        assert_eq!(pace.exceeded(&[1.9 * 20.0, 90.0], 1.1), None);
        let fast = pace.exceeded(&[10.0, 150.0], 1.1).unwrap();
        assert_eq!((fast.joint, fast.most), (1, 50.0));
        assert_eq!(pace.exceeded(&[45.0, 105.0], 1.1), None, "twice what it was told, and noise");
        pace.set_limit(&[1], &[5.0], 3.0);
        assert_eq!(pace.exceeded(&[0.0, 90.0], 3.5), None, "it is still slowing down");
        assert_eq!(pace.exceeded(&[0.0, 90.0], 4.0).map(|fast| fast.joint), Some(1), "a second is enough");
        let fast = pace.exceeded(&[0.0, 90.0], 4.5).unwrap();
        let patch = super::super::layout::Patch {
            part: "arm".into(),
            port: "/arm".into(),
            motors: 2..4,
            units: Default::default(),
        };
        let names = ["a", "b", "shoulder", "elbow"].map(String::from).into();
        let layout = Layout {
            patches: vec![patch],
            home: vec![0.0; 4],
            names,
            limits: vec![(0.0, 1.0); 4],
            speeds: Vec::new(),
            motions: Vec::new(),
        };
        let words = fast.in_words(&layout, 0);
        let start =
            "motor elbow (joint 1 of /arm) moves at 90 deg/s and was told 5: end the program that writes to /arm";
        assert!(words.starts_with(start), "{words}");
    }
}
