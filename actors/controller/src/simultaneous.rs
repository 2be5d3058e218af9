//! Where several robots are at one instant, though each board reads its encoders in its own time.
//!
//! The newest readings of two robots are up to a period apart. Arms that pass each other at half of their speed go several
//! millimeters meanwhile: by such readings they are nearer than they ever were, or farther. On the way there and on the way
//! back the readings fall differently, so that a retreat along what was free would look as if it were not.
//!
//! ```text
//! arm     ──●─────────●─────────●            readings
//! other   ───────●─────────●────
//! common         ├─────────┤                 looked at: up to the older of the two newest, in steps of a millimeter
//! ```
//! What is nearest on the way between two such instants counts, too ([`Sweep`]): what touches between two readings is seen.

use crate::{RELEASE, Rules};
use mobee_contract::{Pose, Time};
use mobee_model::{Contact, Scene, Sweep};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// How near pairs of robots come to each other at common instants.
#[derive(Clone, Debug)]
pub struct Simultaneous {
    /// By their index in the scene.
    robots: Vec<Track>,
    /// Up to when all has been looked at.
    until: Time,
    /// Looks at the ways between instants.
    sweep: Sweep,
}

/// A robot's readings.
#[derive(Clone, Debug)]
struct Track {
    /// Below this distance its pairs are told, meters.
    within: f64,
    /// After so long without a reading it is taken to rest where it was: nobody waits for it.
    fresh: Duration,
    /// The readings since the last instant that was looked at, and the one before that; oldest first.
    readings: VecDeque<(Time, Pose)>,
    /// What was found since its last reading.
    found: Vec<Contact>,
}

impl Track {
    /// When it was read last.
    fn newest(&self) -> Option<Time> {
        self.readings.back().map(|(at, _)| *at)
    }

    /// Where it was then, on the line between two readings; after the newest it is taken to rest.
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
    /// Of robots that are controlled by these rules, in the scene's order.
    pub fn new<'a>(scene: &Arc<Scene>, rules: impl IntoIterator<Item = &'a Rules>) -> Simultaneous {
        let track = |rules: &Rules| Track {
            within: rules.margin + RELEASE,
            fresh: rules.fresh,
            readings: VecDeque::new(),
            found: Vec::new(),
        };
        let robots: Vec<Track> = rules.into_iter().map(track).collect();
        let within = robots.iter().map(|r| r.within).fold(0.0, f64::max);
        Simultaneous { robots, until: Time::ZERO, sweep: Sweep::new(scene.clone(), within) }
    }

    /// Goes on with another scene, such as one after an edit.
    pub fn set_scene(&mut self, scene: &Arc<Scene>) {
        self.sweep.set_scene(scene.clone());
    }

    /// A robot was read: the pairs of it and other robots that were nearer than its margin + 2 mm since it was read last, each
    /// where it was nearest.
    pub fn read(&mut self, robot: usize, at: Time, q: &Pose) -> Vec<Contact> {
        let Some(track) = self.robots.get_mut(robot) else { return Vec::new() };
        let last = track.newest();
        if last.is_none_or(|last| at > last) {
            if last.is_some_and(|last| at > last + track.fresh) {
                // nobody knows how it came here
                track.readings.clear();
                self.sweep.jump();
            }
            track.readings.push_back((at, q.clone()));
        }
        self.look(at);
        self.robots.get_mut(robot).map(|track| std::mem::take(&mut track.found)).unwrap_or_default()
    }

    /// Looks at all instants up to the last one at which all robots are known that are read at all.
    fn look(&mut self, now: Time) {
        let known = |track: &Track| track.newest().filter(|at| now <= *at + track.fresh);
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
            // of those that were passed the last one is where the next way begins
            while track.readings.get(1).is_some_and(|(at, _)| *at <= self.until) {
                track.readings.pop_front();
            }
        }
    }
}

/// The nearest of each pair counts.
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

    /// What is told of two arms whose readings are taken at these times (ms) and angles (rad), in the order in which they come.
    fn told(readings: &[(usize, u64, f64)]) -> Vec<usize> {
        let (scene, rules) = (scene(), rules(true));
        let mut simultaneous = Simultaneous::new(&scene, [&*rules, &*rules]);
        let read = |(robot, ms, q): &(usize, u64, f64)| {
            simultaneous.read(*robot, Time(ms * 1_000_000), &vec![*q].into()).len()
        };
        readings.iter().map(read).collect()
    }

    #[test]
    fn what_touches_between_two_readings_is_told_to_both() {
        let passes = [(0, 0, -0.25), (1, 1, 0.0), (0, 10, 0.25), (1, 11, 0.0), (0, 20, 0.7), (1, 21, 0.0)];
        assert!(
            passes
                .iter()
                .all(|(robot, _, q)| *robot == 1 || scene().contacts(&[vec![*q], vec![0.0]], 0.012).is_empty())
        );
        assert_eq!(told(&passes), [0, 0, 1, 1, 1, 0], "it begins before the second reading of the other");
    }

    /// The one leaves as the other comes: its last reading is from before.
    #[test]
    fn what_was_not_so_at_any_instant_is_not_told() {
        let follows = [(0, 0, -0.4), (1, 0, 0.0), (0, 10, 0.0), (1, 10, -0.4), (0, 20, 0.0), (1, 20, -0.4)];
        assert!(!scene().contacts(&[vec![0.0], vec![0.0]], 0.012).is_empty(), "as the readings come");
        assert_eq!(told(&follows), [0; 6]);
    }

    #[test]
    fn who_is_silent_is_taken_to_rest_and_comes_from_nowhere() {
        let fresh = rules(true).fresh.as_millis() as u64;
        assert_eq!(fresh, 5 * PERIOD.as_millis() as u64);
        let mut readings = vec![(1, 0, 0.0), (0, 0, -0.25)];
        readings.extend((1..=fresh / 10).map(|k| (0, 10 * k, -0.25)));
        // one is waited for while it is fresh: what happened meanwhile is told late, but told
        readings.extend([(0, fresh + 10, 0.0)]);
        let found = told(&readings);
        assert_eq!((found.last(), found.iter().sum::<usize>()), (Some(&1), 1));
        // from where it was silent to where it is nobody knows its way
        let returns =
            [(0, 0, -0.25), (1, 0, 0.0), (0, 10, -0.25), (1, 10, 0.0), (1, 200, 0.0), (0, 201, 0.25), (1, 202, 0.0)];
        assert_eq!(told(&returns), [0; 7]);
    }
}
