//! Episodes in which a simulated robot pushes an obstacle ([`Sample::contact_n`]). They are only reported, and
//! nothing depends on them: no real board provides this value.

use mobee_contract::{Event, Sample, Time};
use std::time::Duration;

/// Longest interruption within one contact: stiff links bounce.
const BOUNCE_TIME: Duration = Duration::from_millis(100);
/// Duration from which a contact is reported before it ends.
const LASTING_TIME: Duration = Duration::from_secs(1);

/// Force up to which a touch is light, N: the torque of a motor hardly shows it, so no controller can end it.
const LIGHT_N: f64 = 5.0;

/// Detects pushing episodes in a robot's readings.
#[derive(Clone, Debug, Default)]
pub struct PushWatch {
    open: Option<Push>,
}

#[derive(Clone, Copy, Debug)]
struct Push {
    /// Time of the last reading with a force.
    last: Time,
    newtons: f64,
    /// First and last reading of the present part with more than [`LIGHT_N`].
    firm: Option<(Time, Time)>,
    /// Duration of the longest such part.
    longest: Duration,
    reported: bool,
}

impl Push {
    fn adds(&mut self, at: Time, newtons: f64) {
        self.last = at;
        self.newtons = self.newtons.max(newtons);
        if newtons > LIGHT_N {
            let goes_on = self.firm.filter(|(_, last)| at.since(*last) <= BOUNCE_TIME);
            let since = goes_on.map_or(at, |(since, _)| since);
            self.firm = Some((since, at));
            self.longest = self.longest.max(at.since(since));
        }
    }
}

impl PushWatch {
    /// Processes a reading. Returns the event of an episode that ended, or that lasts. Its duration is that of a force
    /// of more than [`LIGHT_N`]; an episode of light touches has none.
    pub fn read(&mut self, sample: &Sample, robot: &str) -> Option<Event> {
        let event = |push: &Push, lasting| Event::Pushed {
            robot: robot.to_owned(),
            newtons: push.newtons,
            secs: push.longest.as_secs_f64(),
            lasting,
        };
        if sample.contact_n > 0.0 {
            let (last, newtons, firm, longest) = (sample.at, 0.0, None, Duration::ZERO);
            let push = self.open.get_or_insert(Push { last, newtons, firm, longest, reported: false });
            push.adds(sample.at, sample.contact_n);
            if !push.reported && push.longest >= LASTING_TIME {
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
        let light =
            |ms: u64| if (100..2000).contains(&ms) { if (400..=600).contains(&ms) { 9.0 } else { 2.0 } } else { 0.0 };
        assert_eq!(episodes(light), [(9.0, 0.2, false)], "light touches have no duration");
        let twice = |ms: u64| if [100, 300].contains(&ms) { 6.0 } else { 0.0 };
        assert_eq!(episodes(twice), [(6.0, 0.0, false), (6.0, 0.0, false)]);
    }

    #[test]
    fn a_contact_that_lasts_is_reported_before_it_ends() {
        let long = |ms: u64| if (500..2500).contains(&ms) { 7.0 } else { 0.0 };
        assert_eq!(episodes(long), [(7.0, 1.0, true), (7.0, 1.99, false)]);
    }
}
