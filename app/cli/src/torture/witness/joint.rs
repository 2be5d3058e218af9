//! Counters for retreats of several robots at once.

use mobee_contract::Hold;
use std::collections::BTreeMap;

/// Retreats of several robots at once.
#[derive(Clone, Debug, Default)]
pub struct Joint {
    /// Number of joint retreats.
    pub times: u64,
    /// Number of robots that took part.
    pub retreats: u64,
    /// Number of times that one waited for a robot that blocked its path.
    pub waited: u64,
    /// Causes of stopped retreats, with their numbers.
    pub stopped: BTreeMap<&'static str, u64>,
    /// Maximum distance by which two of them got closer than their minimum since the motions began, or than the margin,
    /// meters: by true positions, also between the readings.
    pub nearer: f64,
}

impl Joint {
    /// Adds the counters of another run.
    pub fn add(&mut self, other: &Joint) {
        self.times += other.times;
        self.retreats += other.retreats;
        self.waited += other.waited;
        for (why, n) in &other.stopped {
            *self.stopped.entry(why).or_default() += n;
        }
        self.nearer = self.nearer.max(other.nearer);
    }
}

/// The cause of a stopped retreat as a phrase, from its reason and the journal's text.
pub(super) fn stopped_by(reason: Hold, what: &str) -> &'static str {
    let robot = |shape: Option<&str>| shape.and_then(|s| s.split(':').next()).map(str::to_owned);
    match reason {
        Hold::RetreatBlocked if what.ends_with(" mm") => {
            let mut pair = what.split(" and ");
            if robot(pair.next()) == robot(pair.next()) { "its own shapes" } else { "another robot or object" }
        }
        Hold::RetreatBlocked if what.contains("constraint") => "a constraint",
        Hold::RetreatBlocked => "no way past",
        Hold::RetreatMissed => "not followed",
        Hold::HistoryTooShort => "history too short",
        _ => "stale",
    }
}
