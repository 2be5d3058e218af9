//! What is counted of retreats of several robots at once.

use mobee_contract::Hold;
use std::collections::BTreeMap;

/// Retreats of several robots at once.
#[derive(Clone, Debug, Default)]
pub struct Joint {
    /// How often that began.
    pub times: u64,
    /// How many robots took part.
    pub retreats: u64,
    /// How often one waited for a robot that had come into its way.
    pub waited: u64,
    /// Why some of these retreats were stopped, and how often.
    pub stopped: BTreeMap<&'static str, u64>,
    /// By how much two of them came nearer to each other than they were since they set out on what is taken back, or than the
    /// margin, at most, meters: where they really were, between the readings as well.
    pub nearer: f64,
}

impl Joint {
    /// With what was seen in another run.
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

/// Why a retreat was stopped, in a word, by its reason and by what the journal says of it.
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
