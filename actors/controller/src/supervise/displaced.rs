//! Displacement of motors that are not commanded (I21, I31). A motor that sags, or is moved by something else, is
//! reported. Beyond the tolerance the filter closes until the robot rests again, and a motion in progress is rolled
//! back: agents plan from the assumed configuration of the robot.

use super::{Closing, SuperviseCore, SuperviseStep};
use crate::Rules;
use crate::gate::Gate;
use crate::pulse::Pulse;
use mobee_contract::{Cause, Event, Hold, Status, play};

/// Number of consecutive readings that must show a displacement: noise shows it in one. Three take 30 ms at the usual
/// rate, in which a motor that was released has not moved far.
const READINGS: u32 = 3;

/// Resting positions of the motors: each from its first reading at rest after the last motion that named it, so that
/// no motor drifts from rest to rest.
#[derive(Clone, Debug, Default)]
pub(super) struct Resting {
    /// Position of each motor; `None` for a motor that is commanded, or has not rested since.
    places: Vec<Option<RestPosition>>,
    /// Numbers of consecutive readings that showed a motor beyond half of the tolerance, which is reported, and
    /// beyond the whole tolerance, which closes the filter.
    beyond: [u32; 2],
}

#[derive(Clone, Copy, Debug)]
struct RestPosition {
    /// Position, rad.
    q: f64,
    /// True if the displacement has been reported.
    reported: bool,
}

impl Resting {
    /// Clears the positions of commanded motors: the next position at rest is the new one.
    pub(super) fn commanded(&mut self, motors: &[usize]) {
        for m in motors {
            if let Some(place) = self.places.get_mut(*m) {
                *place = None;
            }
        }
    }

    /// Returns the motor with the greatest displacement among those that are not commanded, and that displacement,
    /// rad, beyond what the load of the others' motion may cause.
    fn farthest(&mut self, q: &[f64], commanded: &[usize], rules: &Rules) -> Option<(usize, f64)> {
        self.places.resize(q.len(), None);
        let idle = self.places.iter_mut().zip(q).enumerate().filter(|(m, _)| !commanded.contains(m));
        let way = |place: &mut Option<RestPosition>, q: f64| {
            (q - place.get_or_insert(RestPosition { q, reported: false }).q).abs()
        };
        let gives = |m: usize| rules.hold_error(m).max(rules.axes.get(m).map_or(0.0, |axis| play(axis.motion)));
        let ways = idle.map(|(m, (place, q))| (m, (way(place, *q) - gives(m)).max(0.0)));
        ways.max_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

impl SuperviseCore {
    /// Processes a fresh reading. Returns whether it closes the filter. With a closed filter a displacement is only
    /// reported.
    pub(super) fn watch_idle(&mut self, pulse: &Pulse, step: &mut SuperviseStep) -> bool {
        if self.status == Status::Starting {
            return false;
        }
        // The motors of a failed retreat move during its retry, and while a halt brakes it, though their motion is no
        // longer open.
        let retried = self.closing == Closing::Reflex || step.book.halted && matches!(self.closing, Closing::Settle(_));
        let motion = step.book.motion().or_else(|| self.retry.clone().filter(|_| retried));
        let commanded = motion.as_ref().map_or(&[][..], |motion| &motion.named);
        let Some((motor, by)) = self.resting.farthest(&pulse.sample.q, commanded, step.rules) else { return false };
        for (count, share) in self.resting.beyond.iter_mut().zip([0.5, 1.0]) {
            *count = if by > share * step.rules.tolerance { *count + 1 } else { 0 };
        }
        let [reports, is_far] = self.resting.beyond.map(|count| count >= READINGS);
        // Beyond the tolerance, the filter closes two readings later, or it was noise.
        let reports = reports && by <= step.rules.tolerance;
        let closes = is_far && Gate::opens(self.token) && step.gate.token() == self.token;
        let place = self.resting.places.get_mut(motor).and_then(Option::as_mut);
        let is_news = reports && place.is_some_and(|place| !std::mem::replace(&mut place.reported, true));
        let axis = step.rules.axes.get(motor);
        let (motor, motion) = axis.map(|axis| (axis.name.clone(), axis.motion)).unwrap_or_default();
        // The present position becomes the resting position: it is reported once, and the filter can open again.
        if is_far {
            self.resting = Resting::default();
        }
        if closes {
            let cause = Cause::Displaced { motor, by, motion };
            match self.is_moving() {
                true => self.roll_back(cause, step),
                false => self.interrupt(cause, Status::Holding(Hold::Displaced), step),
            }
        } else if is_news || is_far {
            step.emit(Event::Displaced { robot: step.robot(), motor, by, motion });
        }
        closes
    }
}
