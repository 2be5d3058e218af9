//! Overload: evidence that the machine was too slow for a run, as one line with a remedy.

use crate::wiring::{Late, RunCounts};

/// Number of late seconds from which an overload counts as lasting, not as one pause of the machine.
const LASTING_SECONDS: u64 = 10;
/// Remedy for an overload.
const REMEDY: &str =
    "reduce the load on the machine (`mobee doctor` checks it), or give the controller a longer period_ms or stale_ms";

/// Describes the overload of a machine, if there was one; `dropped` lists the sinks that could not keep up with
/// their losses.
///
/// The second value is true if the overload lasted or data was lost: the run is then not representative.
pub fn overload(counts: &RunCounts, dropped: &[(String, u64)]) -> Option<(String, bool)> {
    let mut seen = Vec::new();
    let Late { periods, seconds, .. } = counts.late;
    if periods > 0 && counts.stale > 0 {
        let stale = counts.stale;
        seen.push(format!(
            "{periods} control periods missed in {seconds} s of the run, filters closed {stale} times for old readings"
        ));
    }
    let lasts = !seen.is_empty() && seconds >= LASTING_SECONDS;
    if counts.readings_dropped > 0 {
        seen.push(format!("{} readings dropped in transit", counts.readings_dropped));
    }
    seen.extend(dropped.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{n} entries dropped by the {name}")));
    let lost = counts.readings_dropped > 0 || dropped.iter().any(|(_, n)| *n > 0);
    (!seen.is_empty()).then(|| (format!("overload: {}; {REMEDY}", seen.join(", ")), lasts || lost))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const PERIOD: Duration = Duration::from_millis(20);

    fn late(times: &[(u64, u64)]) -> RunCounts {
        let mut counts = RunCounts { stale: 1, ..RunCounts::default() };
        for (at, by) in times {
            counts.late.note(Duration::from_millis(*at), Duration::from_millis(*by), PERIOD);
        }
        counts
    }

    #[test]
    fn a_turn_within_its_period_is_in_time() {
        assert_eq!(late(&[(1000, 0), (2000, 19)]).late, Late::default());
        assert_eq!(overload(&late(&[(1000, 19)]), &[]), None);
    }

    #[test]
    fn one_pause_is_reported_and_lasting_overload_counts() {
        let nap = late(&[(1000, 550), (1500, 60)]);
        assert_eq!((nap.late.periods, nap.late.seconds), (30, 1));
        let (line, grave) = overload(&nap, &[]).unwrap();
        assert!(line.contains("30 control periods missed") && line.contains("mobee doctor") && !grave, "{line}");
        let lasting: Vec<_> = (1..=LASTING_SECONDS).map(|s| (1000 * s, 40)).collect();
        assert!(overload(&late(&lasting), &[]).unwrap().1);
        let harmless = RunCounts { stale: 0, ..late(&lasting) };
        assert_eq!(overload(&harmless, &[]), None, "no filter closed for it");
    }

    #[test]
    fn what_is_lost_counts_at_once() {
        let lost = RunCounts { readings_dropped: 3, ..RunCounts::default() };
        assert!(overload(&lost, &[]).unwrap().1);
        let (line, grave) = overload(&RunCounts::default(), &[("recorder".into(), 7), ("journal".into(), 0)]).unwrap();
        assert!(line.contains("7 entries dropped by the recorder") && !line.contains("journal") && grave, "{line}");
    }
}
