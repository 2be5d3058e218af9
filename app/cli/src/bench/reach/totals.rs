//! Statistics over all scenes.

use super::trial::Outcome;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Share of solvable scenes that were reached, causes of the others, and quantiles of the other figures.
pub(super) fn totals(all: &[&Outcome]) -> Value {
    let mut ends: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
    for o in all {
        let [solvable, others] = ends.entry(&o.end).or_default();
        *if o.solvable { solvable } else { others } += 1;
    }
    let solvable = all.iter().filter(|o| o.solvable);
    let count = solvable.clone().count();
    let reached = solvable.filter(|o| o.end == "reached").count();
    let row = |(end, [a, b]): (&&str, &[u64; 2])| ((*end).to_owned(), json!({ "solvable": a, "others": b }));
    json!({
        "scenes": all.len(),
        "solvable": count,
        "reached_of_solvable": if count > 0 { reached as f64 / count as f64 } else { 0.0 },
        "ends": ends.iter().map(row).collect::<BTreeMap<_, _>>(),
        "set_out_s": quantiles(all, |o| o.set_out_s),
        "pre_grasp_s": quantiles(all, |o| o.pre_grasp_s),
        "off_mm": quantiles(all, |o| o.off_mm),
        "believed_off_mm": quantiles(all, |o| o.believed_off_mm),
        "rolled_back": all.iter().map(|o| o.rolled_back).sum::<u64>(),
        "hard_contacts": all.iter().map(|o| o.hard_contacts).sum::<u64>(),
    })
}

/// Median, 95 % quantile and maximum, over the scenes in which the hand came to the cup's estimated position.
fn quantiles(all: &[&Outcome], of: fn(&Outcome) -> f64) -> Value {
    let mut values: Vec<f64> = all.iter().filter(|o| o.pre_grasp_s > 0.0).map(|o| of(o)).collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((values.len().saturating_sub(1) as f64 * share).round() as usize).copied();
    json!({ "median": at(0.5), "p95": at(0.95), "most": at(1.0) })
}
