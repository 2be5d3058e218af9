//! I32: a motor that something holds is not pushed on.

use super::{DISTURBED, Witness};
use mobee_contract::{Status, Time};
use std::time::Duration;

/// For how long a motor may be wanted farther beyond what holds it than its controller can overlook.
const PUSHES: Duration = Duration::from_secs(1);
/// How far that is, in the least lags that count: its threshold may have grown to half of this.
const OVERLOOKS: f64 = 20.0;

impl Witness {
    /// What holds the motors of a robot (since when, and how far its board wants them beyond, rad), whose controller counts lags from
    /// `bound` on, rad.
    pub fn held(&mut self, robot: usize, at: Time, held: &[Option<(Time, f64)>], bound: f64) {
        let disturbed = at.since(self.disturbed) < DISTURBED && self.disturbed > Time::ZERO;
        let Some(seen) = self.robots.get_mut(robot) else { return };
        let moves = seen.open && matches!(seen.status, Status::Moving | Status::Escaping);
        let farthest = held.iter().flatten().map(|(_, ahead)| *ahead).fold(0.0, f64::max);
        // who is led astray by its encoders, or reads nothing, knows nothing of it
        let reads = seen.honest && at.since(seen.last) <= seen.period;
        if !(moves && reads && farthest > OVERLOOKS * bound) || disturbed {
            seen.pushed = None;
            return;
        }
        let since = *seen.pushed.get_or_insert(at);
        if at.since(since) > PUSHES {
            let name = &seen.name;
            let by = seen.units.told(farthest, 1);
            let what = format!("{name}: a motor that is held since before {since} is wanted {by} beyond at {at}");
            self.found.push(("I32", what));
            seen.pushed = None;
        }
    }
}
