//! Episodes in which a simulated robot pushes an obstacle ([`Sample::contact_n`]). They are only reported, and
//! nothing depends on them: no real board provides this value.

use mobee_contract::{Event, Sample, Time};
use std::time::Duration;

/// Longest interruption within one contact: stiff links bounce.
const BOUNCE_TIME: Duration = Duration::from_millis(100);
/// Duration from which a contact is reported before it ends.
const LASTING_TIME: Duration = Duration::from_secs(1);

/// Detects pushing episodes in a robot's readings.
#[derive(Clone, Debug, Default)]
pub struct PushWatch {
    open: Option<Push>,
}

#[derive(Clone, Copy, Debug)]
struct Push {
    since: Time,
    /// Time of the last reading with a force.
    last: Time,
    newtons: f64,
    reported: bool,
}

impl PushWatch {
    /// Processes a reading. Returns the event of an episode that ended, or that lasts.
    pub fn read(&mut self, sample: &Sample, robot: &str) -> Option<Event> {
        let event = |push: &Push, lasting| Event::Pushed {
            robot: robot.to_owned(),
            newtons: push.newtons,
            secs: push.last.since(push.since).as_secs_f64(),
            lasting,
        };
        if sample.contact_n > 0.0 {
            let new = Push { since: sample.at, last: sample.at, newtons: 0.0, reported: false };
            let push = self.open.get_or_insert(new);
            push.last = sample.at;
            push.newtons = push.newtons.max(sample.contact_n);
            if !push.reported && push.last.since(push.since) >= LASTING_TIME {
                push.reported = true;
                return Some(event(push, true));
            }
            return None;
        }
        let push = self.open.take_if(|push| sample.at.since(push.last) > BOUNCE_TIME)?;
        Some(event(&push, false))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episodes(forces: impl Fn(u64) -> f64) -> Vec<(f64, f64, bool)> {
        let mut watch = PushWatch::default();
        let read = |ms: u64| {
            let sample = Sample { at: Time(ms * 1_000_000), contact_n: forces(ms), ..Sample::default() };
            match watch.read(&sample, "arm")? {
                Event::Pushed { newtons, secs, lasting, .. } => Some((newtons, secs, lasting)),
                other => panic!("{other:?}"),
            }
        };
        (0..3000).step_by(10).filter_map(read).collect()
    }

    #[test]
    fn a_contact_that_bounces_is_one_episode() {
        let bouncing = |ms: u64| if (100..400).contains(&ms) && ms.is_multiple_of(50) { ms as f64 } else { 0.0 };
        assert_eq!(episodes(bouncing), [(350.0, 0.25, false)]);
        let twice = |ms: u64| if [100, 300].contains(&ms) { 5.0 } else { 0.0 };
        assert_eq!(episodes(twice), [(5.0, 0.0, false), (5.0, 0.0, false)]);
    }

    #[test]
    fn a_contact_that_lasts_is_reported_before_it_ends() {
        let long = |ms: u64| if (500..2500).contains(&ms) { 7.0 } else { 0.0 };
        assert_eq!(episodes(long), [(7.0, 1.0, true), (7.0, 1.99, false)]);
    }
}
