//! I32: a blocked motor is not pushed.

use super::{DISTURBANCE_TIME, Witness};
use mobee_contract::{Status, Time};
use std::time::Duration;

/// Time for which a motor may be commanded beyond its obstacle by more than its controller can miss.
const MAX_PUSH_TIME: Duration = Duration::from_secs(1);
/// That distance, as a multiple of the least lag that counts: the threshold may have grown to half of it.
const MISSED_LAG_RATIO: f64 = 20.0;

impl Witness {
    /// Processes the blocked motors of a robot: time since which each is blocked, and distance of its command beyond
    /// the obstacle, rad. Its controller counts lags from `bound` on, rad.
    pub fn held(&mut self, robot: usize, at: Time, held: &[Option<(Time, f64)>], bound: f64) {
        let disturbed = at.since(self.disturbed) < DISTURBANCE_TIME && self.disturbed > Time::ZERO;
        let Some(seen) = self.robots.get_mut(robot) else { return };
        let moves = seen.open && matches!(seen.status, Status::Moving | Status::Escaping);
        let farthest = held.iter().flatten().map(|(_, ahead)| *ahead).fold(0.0, f64::max);
        // a robot with wrong or missing readings can't detect it
        let reads = seen.honest && at.since(seen.last) <= seen.period;
        if !(moves && reads && farthest > MISSED_LAG_RATIO * bound) || disturbed {
            seen.pushed = None;
            return;
        }
        let since = *seen.pushed.get_or_insert(at);
        if at.since(since) > MAX_PUSH_TIME {
            let name = &seen.name;
            let by = seen.units.told(farthest, 1);
            let what = format!("{name}: a motor that is held since before {since} is wanted {by} beyond at {at}");
            self.found.push(("I32", what));
            seen.pushed = None;
        }
    }
}
