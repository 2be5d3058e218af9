//! The single list of invariants, used by the checker and by `mobee check`; a test compares the documents with
//! it.

use super::Invariant;
use super::as_fast_as_allowed::AsFastAsAllowed;
use super::bounded::Bounded;
use super::closed_means_closed::ClosedMeansClosed;
use super::closes_at_once::ClosesAtOnce;
use super::constraints_close::ConstraintsClose;
use super::contact_closes::ContactCloses;
use super::contacts_hold::ContactsHold;
use super::failed_edges::FailedEdges;
use super::fresh_readings::FreshReadings;
use super::frozen_is_noticed::FrozenIsNoticed;
use super::hard_contacts::HardContacts;
use super::home_is_a_vertex::HomeIsAVertex;
use super::honest_safe_pose::HonestSafePose;
use super::idle_motors_stay::IdleMotorsStay;
use super::limits::LimitsWatch;
use super::liveness::Liveness;
use super::moved_at_rest::MovedAtRest;
use super::nothing_vanishes::NothingVanishes;
use super::one_outcome::OneOutcome;
use super::orphans::Orphans;
use super::released::Released;
use super::removed_stays_removed::RemovedStaysRemoved;
use super::rest_at_the_end::RestAtTheEnd;
use super::restart_does_not_move::RestartDoesNotMove;
use super::taken_back::TakenBack;
use super::together::Together;
use super::told_the_truth::ToldTheTruth;
use super::watched_retreat::WatchedRetreat;

/// An invariant that a journal is checked for.
#[derive(Clone, Copy)]
pub struct InvariantEntry {
    /// Its number, such as `I4`.
    pub name: &'static str,
    /// Promise in a few words, as in the documents' tables.
    pub what: &'static str,
    /// Source of data that the invariant needs.
    pub wants: Wants,
    make: fn() -> Box<dyn Invariant>,
}

/// Source of data that an invariant is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wants {
    /// The journal's events; some invariants also use the measured configurations if they were recorded.
    Events,
    /// The measured configurations beside the journal.
    Poses,
    /// A simulation, which reports the time at which its faults have healed.
    Healing,
}

impl InvariantEntry {
    pub(super) fn make(&self) -> Box<dyn Invariant> {
        (self.make)()
    }
}

fn boxed<I: Invariant + Default + 'static>() -> Box<dyn Invariant> {
    Box::new(I::default())
}

const fn of<I: Invariant + Default + 'static>(name: &'static str, what: &'static str, wants: Wants) -> InvariantEntry {
    InvariantEntry { name, what, wants, make: boxed::<I> }
}

/// All invariants, by number.
pub const ALL: &[InvariantEntry] = &[
    of::<ClosedMeansClosed>("I1", "closed means closed", Wants::Events),
    of::<OneOutcome>("I2", "one outcome", Wants::Events),
    of::<HomeIsAVertex>("I3", "home is a vertex", Wants::Events),
    of::<HonestSafePose>("I4", "safe pose is honest", Wants::Events),
    of::<LimitsWatch>("I5", "limits", Wants::Events),
    of::<NothingVanishes>("I6", "nothing vanishes", Wants::Events),
    of::<Bounded>("I7", "bounded", Wants::Events),
    of::<FreshReadings>("I8", "stale is not fresh", Wants::Poses),
    of::<WatchedRetreat>("I9", "the retreat is watched", Wants::Events),
    of::<RestartDoesNotMove>("I10", "a restart does not move", Wants::Events),
    of::<RemovedStaysRemoved>("I11", "removed stays removed", Wants::Events),
    of::<Together>("I14", "several robots", Wants::Events),
    of::<Liveness>("I15", "liveness", Wants::Healing),
    of::<RestAtTheEnd>("I17", "ended means at rest", Wants::Poses),
    of::<Orphans>("I18", "orphans are cancelled", Wants::Events),
    of::<ContactCloses>("I19", "a contact closes the filter", Wants::Events),
    of::<AsFastAsAllowed>("I20", "no motor too fast", Wants::Poses),
    of::<IdleMotorsStay>("I21", "idle motors stay put", Wants::Poses),
    of::<TakenBack>("I22", "failed motions are rolled back", Wants::Events),
    of::<FailedEdges>("I23", "a failed edge is removed", Wants::Events),
    of::<ConstraintsClose>("I25", "a violated constraint closes the filter", Wants::Poses),
    of::<FrozenIsNoticed>("I26", "frozen encoders are noticed", Wants::Poses),
    of::<ContactsHold>("I27", "contacts have hysteresis", Wants::Events),
    of::<ClosesAtOnce>("I28", "a death closes the filter", Wants::Events),
    of::<ToldTheTruth>("I29", "reports to agents are true", Wants::Events),
    of::<MovedAtRest>("I31", "displacement at rest closes the filter", Wants::Poses),
    of::<HardContacts>("I34", "no avoidable hard contact", Wants::Events),
    of::<Released>("I35", "nothing is pushed for long", Wants::Events),
];

/// Names of the invariants that a journal is judged by, with or without measured configurations, as a phrase:
/// `I1-I7, I9 and I10`.
pub fn judged(poses: bool) -> String {
    let is_judged = |p: &&InvariantEntry| p.wants == Wants::Events || poses && p.wants == Wants::Poses;
    spans(ALL.iter().filter(is_judged).filter_map(|p| p.name.strip_prefix('I')?.parse().ok()))
}

/// Names of the invariants that need measured configurations.
pub fn wants_poses() -> String {
    spans(ALL.iter().filter(|p| p.wants == Wants::Poses).filter_map(|p| p.name.strip_prefix('I')?.parse().ok()))
}

/// Formats ascending numbers as ranges.
fn spans(numbers: impl Iterator<Item = u32>) -> String {
    let mut spans: Vec<(u32, u32)> = Vec::new();
    for n in numbers {
        match spans.last_mut() {
            Some((_, last)) if *last + 1 == n => *last = n,
            _ => spans.push((n, n)),
        }
    }
    let text = |(a, b): &(u32, u32)| match b - a {
        0 => vec![format!("I{a}")],
        1 => vec![format!("I{a}"), format!("I{b}")],
        _ => vec![format!("I{a}-I{b}")],
    };
    let mut words: Vec<String> = spans.iter().flat_map(text).collect();
    match words.pop() {
        Some(last) if !words.is_empty() => format!("{} and {last}", words.join(", ")),
        last => last.unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_formatted_as_ranges() {
        assert_eq!(spans([1, 2, 3, 5, 8, 9].into_iter()), "I1-I3, I5, I8 and I9");
        assert_eq!(spans([4].into_iter()), "I4");
    }

    /// The documents list every invariant with the promise from [`ALL`].
    #[test]
    fn the_documents_have_every_invariant() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for page in ["docs/journal.md", "docs/torture.md", "actors/journal/src/check.rs"] {
            let text = std::fs::read_to_string(root.join(page)).unwrap();
            for InvariantEntry { name, what, .. } in ALL {
                let row = format!("| {name} | {what} |");
                assert!(text.contains(&row), "{page} has no row `{row} ...`");
            }
        }
    }
}
