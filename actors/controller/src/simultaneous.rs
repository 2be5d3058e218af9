//! Distances between robots at common instants, although each board reads its encoders in its own time.
//!
//! The newest readings of two robots are up to a period apart. Arms that pass each other at half of their speed move
//! several millimeters in that time: by these readings they seem closer than they ever were, or farther. On the way
//! there and on the retreat the readings fall at different instants, so that a retreat along a free path would not
//! look free.
//!
//! ```text
//! arm     ──●─────────●─────────●            readings
//! other   ───────●─────────●────
//! common         ├─────────┤                 checked: up to the older of the two newest, in steps of a millimeter
//! ```
//! The least distance between two such instants counts as well ([`Sweep`]), so that no contact between readings is
//! missed.

use crate::{RELEASE, Rules};
use mobee_contract::{Pose, Time};
use mobee_model::{Contact, Scene, Sweep};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Distances between pairs of robots at common instants.
#[derive(Clone, Debug)]
pub struct Simultaneous {
    /// Tracks of the robots, by their index in the scene.
    robots: Vec<RobotReadings>,
    /// Instant up to which everything has been checked.
    until: Time,
    /// Sweep between instants.
    sweep: Sweep,
}

/// Readings of a robot.
#[derive(Clone, Debug)]
struct RobotReadings {
    /// Distance below which its pairs are reported, meters.
    within: f64,
    /// Time without a reading after which the robot counts as resting: the others do not wait for it.
    fresh: Duration,
    /// Readings since the last checked instant, and the one before it; oldest first.
    readings: VecDeque<(Time, Pose)>,
    /// Contacts found since its last reading.
    found: Vec<Contact>,
}

impl RobotReadings {
    /// Time of the newest reading.
    fn newest(&self) -> Option<Time> {
        self.readings.back().map(|(at, _)| *at)
    }

    /// Configuration at this instant, interpolated linearly between two readings; constant after the newest.
    fn at(&self, time: Time) -> Option<Pose> {
        let after = self.readings.partition_point(|(at, _)| *at <= time);
        match (after.checked_sub(1).and_then(|i| self.readings.get(i)), self.readings.get(after)) {
            (Some((t0, a)), Some((t1, b))) if a.len() == b.len() => {
                let part = time.since(*t0).as_secs_f64() / t1.since(*t0).as_secs_f64().max(1e-9);
                Some(a.iter().zip(b.iter()).map(|(a, b)| a + (b - a) * part).collect())
            }
            (a, b) => a.or(b).map(|(_, q)| q.clone()),
        }
    }
}

impl Simultaneous {
    /// Creates the check for robots with these rules, in the scene's order.
    pub fn new<'a>(scene: &Arc<Scene>, rules: impl IntoIterator<Item = &'a Rules>) -> Simultaneous {
        let track = |rules: &Rules| RobotReadings {
            within: rules.margin + RELEASE,
            fresh: rules.fresh,
            readings: VecDeque::new(),
            found: Vec::new(),
        };
        let robots: Vec<RobotReadings> = rules.into_iter().map(track).collect();
        let within = robots.iter().map(|r| r.within).fold(0.0, f64::max);
        Simultaneous { robots, until: Time::ZERO, sweep: Sweep::new(scene.clone(), within) }
    }

    /// Replaces the scene, as after an edit.
    pub fn set_scene(&mut self, scene: &Arc<Scene>) {
        self.sweep.set_scene(scene.clone());
    }

    /// Processes a reading of a robot. Returns its pairs with other robots that were closer than its margin + 2 mm
    /// since its last reading, each at its least distance.
    pub fn read(&mut self, robot: usize, at: Time, q: &Pose) -> Vec<Contact> {
        let Some(track) = self.robots.get_mut(robot) else { return Vec::new() };
        let last = track.newest();
        if last.is_none_or(|last| at > last) {
            if last.is_some_and(|last| at > last + track.fresh) {
                // The path to this configuration is unknown.
                track.readings.clear();
                self.sweep.jump();
            }
            track.readings.push_back((at, q.clone()));
        }
        self.look(at);
        self.robots.get_mut(robot).map(|track| std::mem::take(&mut track.found)).unwrap_or_default()
    }

    /// Checks all instants up to the last one with readings of all robots that are being read.
    fn look(&mut self, now: Time) {
        let known = |track: &RobotReadings| track.newest().filter(|at| now <= *at + track.fresh);
        let Some(common) = self.robots.iter().filter_map(known).min() else { return };
        let mut times: Vec<Time> = self.robots.iter().flat_map(|r| r.readings.iter().map(|(at, _)| *at)).collect();
        times.retain(|at| *at > self.until && *at <= common);
        times.sort_unstable();
        times.dedup();
        for time in times {
            let Some(poses) = self.robots.iter().map(|track| track.at(time)).collect::<Option<Vec<Pose>>>() else {
                continue;
            };
            for contact in self.sweep.to(&poses) {
                for robot in [contact.pair.0.robot(), contact.pair.1.robot()].into_iter().flatten() {
                    if let Some(track) = self.robots.get_mut(robot).filter(|track| contact.distance <= track.within) {
                        note(&mut track.found, contact);
                    }
                }
            }
            self.until = time;
        }
        for track in &mut self.robots {
            // The last reading before the checked instant is the beginning of the next interval.
            while track.readings.get(1).is_some_and(|(at, _)| *at <= self.until) {
                track.readings.pop_front();
            }
        }
    }
}

/// Adds a contact; the least distance of each pair counts.
pub fn note(least: &mut Vec<Contact>, contact: &Contact) {
    match least.iter_mut().find(|c| c.pair == contact.pair) {
        Some(least) if least.distance <= contact.distance => {}
        Some(least) => *least = *contact,
        None => least.push(*contact),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint_retreat::tests::{PERIOD, rules, scene};

    /// Numbers of contacts returned for two arms with readings at these times (ms) and angles (rad), in the order of
    /// arrival.
    fn contacts(readings: &[(usize, u64, f64)]) -> Vec<usize> {
        let scene = scene();
        let rules = rules(true);
        let mut simultaneous = Simultaneous::new(&scene, [&*rules, &*rules]);
        let read = |(robot, ms, q): &(usize, u64, f64)| {
            simultaneous.read(*robot, Time(ms * 1_000_000), &vec![*q].into()).len()
        };
        readings.iter().map(read).collect()
    }

    #[test]
    fn a_contact_between_two_readings_is_reported_to_both() {
        let passes = [(0, 0, -0.25), (1, 1, 0.0), (0, 10, 0.25), (1, 11, 0.0), (0, 20, 0.7), (1, 21, 0.0)];
        assert!(
            passes
                .iter()
                .all(|(robot, _, q)| *robot == 1 || scene().contacts(&[vec![*q], vec![0.0]], 0.012).is_empty())
        );
        assert_eq!(contacts(&passes), [0, 0, 1, 1, 1, 0], "it begins before the second reading of the other");
    }

    /// One arm leaves as the other one comes: its last reading is from before.
    #[test]
    fn a_contact_at_no_common_instant_is_not_reported() {
        let follows = [(0, 0, -0.4), (1, 0, 0.0), (0, 10, 0.0), (1, 10, -0.4), (0, 20, 0.0), (1, 20, -0.4)];
        assert!(!scene().contacts(&[vec![0.0], vec![0.0]], 0.012).is_empty(), "as the readings come");
        assert_eq!(contacts(&follows), [0; 6]);
    }

    #[test]
    fn a_silent_robot_counts_as_resting_and_has_no_path_when_it_returns() {
        let fresh = rules(true).fresh.as_millis() as u64;
        assert_eq!(fresh, 5 * PERIOD.as_millis() as u64);
        let mut readings = vec![(1, 0, 0.0), (0, 0, -0.25)];
        readings.extend((1..=fresh / 10).map(|k| (0, 10 * k, -0.25)));
        // the other robot waits for it while it is fresh: what happened in that time is reported late, but reported
        readings.extend([(0, fresh + 10, 0.0)]);
        let found = contacts(&readings);
        assert_eq!((found.last(), found.iter().sum::<usize>()), (Some(&1), 1));
        // its path during the silence is unknown
        let returns =
            [(0, 0, -0.25), (1, 0, 0.0), (0, 10, -0.25), (1, 10, 0.0), (1, 200, 0.0), (0, 201, 0.25), (1, 202, 0.0)];
        assert_eq!(contacts(&returns), [0; 7]);
    }
}
