//! Configuration of the robot at the instant of an observation.

use super::HistoryCore;
use mobee_contract::{Pose, Time};

/// Error: the configuration at an instant is not available.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unrecorded {
    /// The instant is newer than the newest reading.
    #[error("there is no reading of that instant yet")]
    NotYet,
    /// The instant is older than the ring, or lies in a gap.
    #[error("there is no reading of that instant any more")]
    NoMore,
}

impl HistoryCore {
    /// Returns the configuration at this instant, interpolated linearly between the readings before and after.
    ///
    /// # Errors
    /// If there are no two such readings, or a gap is between them.
    pub fn at(&self, at: Time) -> Result<Pose, Unrecorded> {
        let next = self.ring.partition_point(|r| r.at < at);
        let after = self.ring.get(next).ok_or(Unrecorded::NotYet)?;
        // The reading after a bridge was measured, the configurations on it were not.
        let measured = |r: &&super::Recorded| !r.bridged || self.ring.get(next + 1).is_none_or(|next| !next.bridged);
        if after.at == at {
            return Some(after).filter(measured).map(|r| r.q.clone()).ok_or(Unrecorded::NoMore);
        }
        let before = next.checked_sub(1).and_then(|i| self.ring.get(i));
        let before = before.filter(|_| !after.after_gap && !after.after_pause).ok_or(Unrecorded::NoMore)?;
        let share = at.since(before.at).as_secs_f64() / after.at.since(before.at).as_secs_f64();
        Ok(before.q.iter().zip(after.q.iter()).map(|(a, b)| a + share * (b - a)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::Pulse;
    use mobee_contract::Sample;
    use std::time::Duration;

    fn ms(ms: u64) -> Time {
        Time(ms * 1_000_000)
    }

    /// A ring of 16 after readings every 10 ms; the motor moves one degree per reading.
    fn recorded(readings: u64) -> HistoryCore {
        let mut history = HistoryCore::new(16);
        for k in 1..=readings {
            let sample = Sample {
                seq: k,
                at: ms(10 * k),
                q: vec![(k as f64).to_radians()].into(),
                done: vec![true],
                ..Sample::default()
            };
            history.push(&mut Pulse::new(sample, &Vec::new().into()), Duration::from_millis(100));
        }
        history
    }

    fn deg(history: &HistoryCore, at: Time) -> Result<f64, Unrecorded> {
        history.at(at).map(|q| (q[0].to_degrees() * 1e6).round() / 1e6)
    }

    #[test]
    fn a_configuration_is_available_at_and_between_readings_within_the_ring() {
        let history = recorded(20);
        assert_eq!(deg(&history, ms(200)), Ok(20.0));
        assert_eq!(deg(&history, ms(50)), Ok(5.0), "the oldest of sixteen");
        assert_eq!(deg(&history, ms(123)), Ok(12.3));
        assert_eq!(deg(&history, ms(49)), Err(Unrecorded::NoMore));
        assert_eq!(deg(&history, ms(201)), Err(Unrecorded::NotYet));
        assert_eq!(deg(&HistoryCore::new(16), ms(1)), Err(Unrecorded::NotYet));
    }

    #[test]
    fn the_configuration_within_a_gap_is_an_error() {
        let mut history = recorded(20);
        history.mark_gap();
        let sample = Sample { seq: 21, at: ms(210), q: vec![0.0].into(), done: vec![true], ..Sample::default() };
        history.push(&mut Pulse::new(sample, &Vec::new().into()), Duration::from_millis(100));
        assert_eq!(deg(&history, ms(205)), Err(Unrecorded::NoMore));
        assert_eq!(deg(&history, ms(195)), Ok(19.5));
    }
}
