//! The result of a torture battery.

use super::plan::Planned;
use super::trial::{END, ESCAPE, TrialResult};
use super::witness::Joint;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

/// Minimum number of seeds for which shares are meaningful.
const MIN_SEEDS: u64 = 50;

/// Share in percent.
fn share(part: u64, of: u64) -> f64 {
    100.0 * part as f64 / of.max(1) as f64
}

/// Sums over all seeds.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Seeds that ran.
    pub seeds: u64,
    /// Time by the runs' clocks.
    pub simulated: Duration,
    /// Time by the wall clock.
    pub wall: Duration,
    /// Faults by kind.
    pub faults: BTreeMap<&'static str, u64>,
    /// Accepted commits.
    pub commits: u64,
    /// Outcomes of commits: reached, rolled back, neither.
    pub outcomes: [u64; 3],
    /// Causes of faulted commits, with their numbers.
    pub faulted: BTreeMap<&'static str, u64>,
    /// Causes of closed filters, with their numbers.
    pub closed: BTreeMap<&'static str, u64>,
    /// Restarts of actors.
    pub restarts: u64,
    /// Retreats that were stopped.
    pub retreats_stopped: u64,
    /// Escapes.
    pub escapes: u64,
    /// Hard contacts.
    pub hard_contacts: u64,
    /// Greatest depth of a hard contact, millimeters.
    pub hard_contact_depth_mm: f64,
    /// Greatest force with which a simulated robot pushed anything, N.
    pub push_n: f64,
    /// Longest time for which a simulated robot pushed anything, s.
    pub push_s: f64,
    /// Swaps: settled, reverted, refused.
    pub swaps: [u64; 3],
    /// Retreats of several robots at once.
    pub joint: Joint,
    /// Groups that used up their restarts.
    pub gave_up: u64,
    /// Greatest growth of memory in a run, megabytes per hour; `None` if all runs were too short.
    pub growth: Option<f64>,
    /// Seeds that failed.
    pub failed: Vec<u64>,
    /// Maximum share of commits that may end as faulted, percent, if it is bounded.
    pub most_faulted: Option<f64>,
    /// The robots whose own driver was replaced by the simulated one, each with that driver's kind.
    pub replaced: Vec<(String, String)>,
    /// Differences when the first seed ran a second time (I13).
    pub twice: Vec<String>,
}

impl Tally {
    /// Adds a run.
    pub fn add(&mut self, planned: &[Planned], ran: &TrialResult, wall: Duration) {
        self.seeds += 1;
        self.simulated += ran.simulated;
        self.wall = wall;
        for p in planned {
            *self.faults.entry(p.what.kind()).or_default() += 1;
        }
        let c = &ran.counts;
        self.commits += c.commits;
        for (sum, n) in self.outcomes.iter_mut().zip([c.committed, c.rolled_back, c.faulted + c.stopped]) {
            *sum += n;
        }
        for (cause, n) in &ran.faulted {
            *self.faulted.entry(cause).or_default() += n;
        }
        for (cause, n) in &ran.closed {
            *self.closed.entry(cause).or_default() += n;
        }
        for (sum, n) in self.swaps.iter_mut().zip(ran.swaps) {
            *sum += n;
        }
        self.joint.add(&ran.joint);
        self.restarts += c.restarts;
        self.retreats_stopped += c.retreats_stopped;
        self.escapes += c.escapes;
        self.hard_contacts += c.hard_contacts;
        self.hard_contact_depth_mm = self.hard_contact_depth_mm.max(c.hard_contact_depth_mm);
        self.push_n = self.push_n.max(c.push_n);
        self.push_s = self.push_s.max(c.push_s);
        self.gave_up += u64::from(c.is_given_up);
        self.growth = self.growth.into_iter().chain(ran.growth).reduce(f64::max);
    }

    /// The share of commits that ended as faulted, percent, without escapes and commits cut off by the end of a run:
    /// motions that had a retreat, and were not rolled back.
    pub fn faulted_share(&self) -> f64 {
        let faulted = self.faulted.iter().filter(|(why, _)| ![ESCAPE, END].contains(why)).map(|(_, n)| n).sum();
        let ends = self.faulted.get(END).copied().unwrap_or_default();
        share(faulted, self.commits.saturating_sub(self.escapes + ends))
    }

    /// True if more commits ended as faulted than the behavior allows. Always false for a few seeds.
    pub fn is_over(&self) -> bool {
        self.seeds >= MIN_SEEDS && self.most_faulted.is_some_and(|most| self.faulted_share() > most)
    }

    /// Ratio of simulated to wall-clock time.
    pub fn factor(&self) -> f64 {
        self.simulated.as_secs_f64() / self.wall.as_secs_f64().max(1e-9)
    }

    /// True if all seeds passed.
    pub fn is_good(&self) -> bool {
        self.failed.is_empty() && self.twice.is_empty() && !self.is_over()
    }

    /// The progress as a line.
    pub fn line(&self) -> String {
        let hours = self.simulated.as_secs_f64() / 3600.0;
        let factor = self.factor();
        format!(
            "{} seeds, {hours:.2} simulated hours, {factor:.0} times real time, {} failed",
            self.seeds,
            self.failed.len()
        )
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.line())?;
        let faults: Vec<String> = self.faults.iter().map(|(kind, n)| format!("{kind} {n}")).collect();
        writeln!(f, "faults     {}", faults.join(", "))?;
        let [reached, back, faulted] = self.outcomes;
        writeln!(f, "commits    {}: {reached} reached, {back} rolled back, {faulted} faulted", self.commits)?;
        if faulted > 0 {
            let causes: Vec<String> = self.faulted.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
            writeln!(f, "faulted    {}", causes.join(", "))?;
            let bound = self.most_faulted.map_or(String::new(), |most| format!("; at most {most} % may"));
            let all = share(faulted, self.commits);
            writeln!(
                f,
                "           {all:.1} % of all, {:.1} % without escapes and ends of runs{bound}",
                self.faulted_share()
            )?;
        }
        if !self.closed.is_empty() {
            let closed: Vec<String> = self.closed.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
            writeln!(f, "closed     {}", closed.join(", "))?;
        }
        let escapes = self.escapes;
        let stopped = self.retreats_stopped;
        writeln!(f, "and        {escapes} escapes, {stopped} retreats stopped, {} restarts", self.restarts)?;
        let hard = self.hard_contacts;
        let deep = self.hard_contact_depth_mm;
        writeln!(f, "touched    {hard} hard contacts, at most {deep:.1} mm deep")?;
        if self.push_n > 0.0 {
            writeln!(f, "pushed     at most {:.1} N, for at most {:.2} s", self.push_n, self.push_s)?;
        }
        let Joint { times, retreats, waited, stopped, nearer } = &self.joint;
        if *times > 0 {
            let mm = nearer * 1e3;
            writeln!(
                f,
                "joint      {times} times several robots retreated at once, and came {mm:.2} mm nearer at most"
            )?;
            let all: u64 = stopped.values().sum();
            let causes: Vec<String> = stopped.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
            let by = if causes.is_empty() { String::new() } else { format!(": {}", causes.join(", ")) };
            writeln!(f, "           {all} of their {retreats} retreats stopped ({:.2} %){by}", share(all, *retreats))?;
            if *waited > 0 {
                writeln!(f, "           {waited} times one waited for a robot that had come into its way")?;
            }
        }
        if self.swaps != [0; 3] {
            let [settled, reverted, refused] = self.swaps;
            writeln!(f, "swaps      {settled} settled, {reverted} reverted, {refused} refused")?;
        }
        if self.gave_up > 0 {
            writeln!(f, "storms     {} groups used up their restarts", self.gave_up)?;
        }
        if let Some(growth) = self.growth {
            writeln!(f, "memory     {growth:+.2} MB per hour after warming up")?;
        }
        for (robot, kind) in &self.replaced {
            writeln!(
                f,
                "driver     {robot} was simulated: its driver `{kind}` was not tested (the conformance suite does that)"
            )?;
        }
        for what in &self.twice {
            writeln!(f, "{what}")?;
        }
        if self.is_over() {
            writeln!(
                f,
                "more commits ended as faulted than `torture.faulted_percent` allows: motions that should have been rolled back were not"
            )?;
        }
        match (self.is_good(), self.failed.is_empty()) {
            (true, _) => write!(f, "no invariant was broken"),
            (false, true) => write!(f, "failed"),
            (false, false) => write!(f, "failed: {:?}", self.failed),
        }
    }
}
