//! A motor that nobody commands stays where it is (I21, I31). One that sags, or that somebody else moves, is told of.
//! Beyond the tolerance the filter closes until the robot rests again, and a motion that is under way is taken back:
//! agents plan from where they believe the robot to be.

use super::{Closing, Step, SuperviseCore};
use crate::gate::Gate;
use crate::pulse::Pulse;
use crate::{Rules, play};
use mobee_contract::{Cause, Event, Hold, Status};

/// So many readings in a row must show it: noise shows it in one. Three take 30 ms at the usual rate, in which a motor
/// that was let go of has not yet gone far.
const READINGS: u32 = 3;

/// Where the motors rest: each at its first reading at rest after the last motion that named it, so that none walks
/// from rest to rest.
#[derive(Clone, Debug, Default)]
pub(super) struct Resting {
    /// By motor; none for one that is commanded, or was and has not rested since.
    places: Vec<Option<Place>>,
    /// How many readings in a row have shown a motor beyond half of the tolerance, which is told of, and beyond all of
    /// it, which closes.
    beyond: [u32; 2],
}

#[derive(Clone, Copy, Debug)]
struct Place {
    /// Where, rad.
    q: f64,
    /// Whether it was told that the motor has left it.
    told: bool,
}

impl Resting {
    /// These motors were commanded: where they rest next is their place.
    pub(super) fn commanded(&mut self, motors: &[usize]) {
        for m in motors {
            if let Some(place) = self.places.get_mut(*m) {
                *place = None;
            }
        }
    }

    /// Of the motors that are not commanded, the one that is farthest from its place, and how far that is, rad, beyond what the load of the
    /// others' motion may move it by.
    fn farthest(&mut self, q: &[f64], commanded: &[usize], rules: &Rules) -> Option<(usize, f64)> {
        self.places.resize(q.len(), None);
        let idle = self.places.iter_mut().zip(q).enumerate().filter(|(m, _)| !commanded.contains(m));
        let way = |place: &mut Option<Place>, q: f64| (q - place.get_or_insert(Place { q, told: false }).q).abs();
        let gives = |m: usize| rules.hold_error(m).max(rules.axes.get(m).map_or(0.0, |axis| play(axis.motion)));
        let ways = idle.map(|(m, (place, q))| (m, (way(place, *q) - gives(m)).max(0.0)));
        ways.max_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

impl SuperviseCore {
    /// A fresh reading; whether it closes the filter. While that is closed it is only told.
    pub(super) fn watch_idle(&mut self, pulse: &Pulse, step: &mut Step) -> bool {
        if self.status == Status::Starting {
            return false;
        }
        // during another try of a failed retreat its motors move, though their motion is no longer open
        // and while a halt brakes it
        let retried = self.closing == Closing::Reflex || step.book.halted && matches!(self.closing, Closing::Settle(_));
        let motion = step.book.motion().or_else(|| self.retry.clone().filter(|_| retried));
        let commanded = motion.as_ref().map_or(&[][..], |motion| &motion.named);
        let Some((motor, by)) = self.resting.farthest(&pulse.sample.q, commanded, step.rules) else { return false };
        for (count, share) in self.resting.beyond.iter_mut().zip([0.5, 1.0]) {
            *count = if by > share * step.rules.tolerance { *count + 1 } else { 0 };
        }
        let [tells, is_far] = self.resting.beyond.map(|count| count >= READINGS);
        // what is beyond the tolerance closes the filter two readings later, or was noise
        let tells = tells && by <= step.rules.tolerance;
        let closes = is_far && Gate::opens(self.token) && step.gate.token() == self.token;
        let place = self.resting.places.get_mut(motor).and_then(Option::as_mut);
        let is_news = tells && place.is_some_and(|place| !std::mem::replace(&mut place.told, true));
        let axis = step.rules.axes.get(motor);
        let (motor, motion) = axis.map(|axis| (axis.name.clone(), axis.motion)).unwrap_or_default();
        // where it is from now on is its place: told once, and the filter can open again
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
