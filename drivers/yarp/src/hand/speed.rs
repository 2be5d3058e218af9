//! Velocities that are sent repeatedly while they are wanted, lowered near position limits.

use std::collections::BTreeMap;

/// Deceleration assumed for the distance to limits, deg/s^2.
const BRAKING: f64 = 100.0;
/// Time after which a velocity that has not been renewed expires, s. Boards do the same, but their watchdog
/// is defeated by our repetition.
const WATCHDOG: f64 = 0.1;

/// Velocities of one board, deg/s by joint, with the time until which each is valid.
#[derive(Clone, Debug, Default)]
pub struct JointVelocities(BTreeMap<usize, (f64, f64)>);

impl JointVelocities {
    pub fn clear(&mut self) {
        self.0.clear();
    }

    pub fn forget(&mut self, joints: &[usize]) {
        for j in joints {
            self.0.remove(j);
        }
    }

    pub fn set(&mut self, joints: &[usize], speeds: &[f64], now: f64) {
        self.0.extend(joints.iter().copied().zip(speeds.iter().map(|v| (*v, now + WATCHDOG))));
    }

    /// Velocities to send now to a board at `q` that acts within `latency` seconds; `None` if there are none.
    /// An expired velocity is sent as zero, once.
    pub fn due(&mut self, q: &[f64], limits: &[(f64, f64)], latency: f64, now: f64) -> Option<(Vec<usize>, Vec<f64>)> {
        if self.0.is_empty() {
            return None;
        }
        let one = |(j, (v, until)): (&usize, &(f64, f64))| match (q.get(*j), limits.get(*j)) {
            (Some(q), Some((min, max))) if now <= *until => (*j, lowered(*v, *q, *min, *max, latency)),
            _ => (*j, 0.0),
        };
        let due = self.0.iter().map(one).unzip();
        self.0.retain(|_, (_, until)| now <= *until);
        Some(due)
    }
}

/// Greatest speed from which the joint still stops before its limit, if each command takes effect a latency
/// late.
fn lowered(v: f64, q: f64, min: f64, max: f64, latency: f64) -> f64 {
    let room = if v > 0.0 { max - q } else { q - min };
    // v * e * latency + v^2 / (2 a) <= room: a loop with a delay does not overshoot while its gain is below 1 / (e * delay)
    let late = BRAKING * std::f64::consts::E * latency;
    let most = (late * late + 2.0 * BRAKING * room.max(0.0)).sqrt() - late;
    v.clamp(-most, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_comes_to_rest_before_its_limit() {
        for sign in [1.0, -1.0] {
            let mut speeds = JointVelocities::default();
            speeds.set(&[0], &[sign * 60.0], 0.0);
            let mut q = 0.0;
            let mut v = 0.0f64;
            let dt = 0.001;
            let mut sent_before = std::collections::VecDeque::from(vec![0.0; 60]);
            for _ in 0..3_000 {
                let (_, sent) = speeds.due(&[sign * q], &[(-10.0, 10.0)], 0.06, 0.0).unwrap();
                sent_before.push_back(sign * sent[0]);
                let want = sent_before.pop_front().unwrap();
                v += (want - v).clamp(-200.0 * dt, 200.0 * dt);
                q += v * dt;
                assert!(q <= 10.01, "{q}");
            }
            assert!(q > 9.9 && v.abs() < 0.1, "it gets there within three seconds: {q} {v}");
        }
        let mut speeds = JointVelocities::default();
        speeds.set(&[0], &[60.0], 0.0);
        speeds.set(&[1], &[-5.0], 0.0);
        let (joints, sent) = speeds.due(&[10.0, -20.0], &[(-10.0, 10.0), (-10.0, 10.0)], 0.06, 0.0).unwrap();
        assert_eq!((joints, sent), (vec![0, 1], vec![0.0, 0.0]), "beyond its limit it does not go farther");
        speeds.forget(&[0, 1]);
        assert!(speeds.due(&[], &[], 0.0, 0.0).is_none());
    }

    #[test]
    fn an_expired_velocity_is_sent_as_zero_once() {
        let mut speeds = JointVelocities::default();
        speeds.set(&[0], &[5.0], 1.0);
        let mut at = |now: f64| speeds.due(&[0.0], &[(-10.0, 10.0)], 0.0, now);
        assert_eq!(at(1.09), Some((vec![0], vec![5.0])));
        assert_eq!(at(1.2), Some((vec![0], vec![0.0])));
        assert_eq!(at(1.3), None);
    }
}
