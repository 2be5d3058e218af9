//! The invariants of a run as predicates over its journal, so that one checker serves tests, simulations and real robots.
//!
//! | | promise | |
//! |---|---|---|
//! | I1 | closed means closed | no agent's command reaches the driver while the filter is closed; commands with old tokens are not written |
//! | I2 | one outcome | every accepted commit ends exactly once |
//! | I3 | home is a vertex | after a rollback the robot rests at the safe pose, which is a vertex for an agent with a map |
//! | I4 | safe pose is honest | taken at rest, fresh, free, with no transaction open |
//! | I5 | limits | what leaves the filter is finite, within limits, and not too fast |
//! | I6 | nothing vanishes | sent = handled + queued + dropped on every link |
//! | I7 | bounded | the queue of a link never exceeds its credit |
//! | I8 | stale is not fresh | commits are accepted and outcomes given only while the newest reading is fresh |
//! | I9 | the retreat is watched | a contact during the retreat stops it within one period |
//! | I10 | a restart does not move | no motion from a start or restart until the next commit, except a retreat |
//! | I11 | removed stays removed | no plan leads over a removed or blocked edge |
//! | I14 | several robots | while several are retreating, no contact between two of them begins |
//! | I15 | liveness | once all faults have healed, motions end, filters open, and agents go on |
//! | I17 | ended means at rest | an outcome is given only while the robot is measured to be at rest |
//! | I18 | orphans are cancelled | a motion does not continue after its agent has died |
//! | I19 | a contact closes the filter | a contact that begins in mid-motion closes the filter within one control period |
//! | I20 | no motor too fast | no motor is measured to be faster than its commit allows |
//! | I21 | idle motors stay put | a motor that no open commit names does not move, nor drift in the long run, and no command except a stop names it |
//! | I22 | failed motions are rolled back | after a contact, a constraint violation, a stall, a missed target or the agent's death, the motion is rolled back along its path, unless the journal gives the reason why not |
//! | I23 | a failed edge is removed | before the agent commits again, and no other edge is |
//! | I25 | a violated constraint closes the filter | a constraint that is violated, at rest or in motion, closes the filter; during the retreat, or if an escape makes it worse, it stops the robot |
//! | I26 | frozen encoders are noticed | readings that stay bit-identical while the motors should move end the motion within a stated time |
//! | I27 | contacts have hysteresis | a contact begins below the margin, and again only after it has ended |
//! | I28 | a death closes the filter | the death of the model or of a controller's actor closes the filter within two leases; an exchange closes it before the new part is inspected; a new driver first stops its board, and a stop discards queued set-points |
//! | I29 | reports to agents are true | `committed` is reported only within the tolerance of the target; the built-in agent is notified of the end of its motion once, after the outcome and before its next commit, and the notification matches the outcome |
//! | I31 | displacement at rest closes the filter | the filter closes if a robot at rest is moved by something other than its commands; a displacement beyond the tolerance is reported, and the filter does not stay open |
//! | I34 | no avoidable hard contact | a robot that looks ahead touches nothing that it could have stopped short of |
//! | I35 | nothing is pushed for long | a simulated robot pushes a thing for a second at most, in addition to the time in which it brakes and returns |
//!
//! Each is a small state machine in its own file. It receives one journal line after another and, where they
//! were recorded, the measured configurations beside the journal ([`crate::track`]). I4 and I22 also
//! use those; I8, I17, I20, I21, I25, I26 and I31 need them. I15 is judged only after a simulation reports that
//! its faults have healed. [`ALL`] lists the invariants.

mod all;
mod as_fast_as_allowed;
mod bounded;
mod closed_means_closed;
mod closes_at_once;
mod constraints_close;
mod contact_closes;
mod contacts_hold;
mod disturbances;
mod failed_edges;
mod fresh_readings;
mod frozen_is_noticed;
mod hard_contacts;
mod home_is_a_vertex;
mod honest_safe_pose;
mod idle_motors_stay;
mod limits;
mod liveness;
mod measured;
mod moved_at_rest;
mod nothing_vanishes;
mod one_outcome;
mod orphans;
mod poses;
mod released;
mod removed_stays_removed;
mod rest_at_the_end;
mod restart_does_not_move;
mod retreat_pace;
mod summary;
mod taken_back;
mod together;
mod told_the_truth;
pub mod touches;
mod watched_retreat;
mod window;
pub use all::{ALL, InvariantEntry, Wants, judged, wants_poses};
pub use hard_contacts::HardContactTally;
pub use poses::JudgedPoses;
pub use retreat_pace::SLOW_RETREAT;
pub use summary::{RunSummary, summary};

use crate::files;
use crate::journal::{JournalError, JournalLine, JournalLines, read};
use hard_contacts::HardContacts;
use mobee_contract::{Event, Pose, Time};
use poses::Merge;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// A broken invariant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// Name of the invariant in [`ALL`].
    pub invariant: &'static str,
    /// The line of the journal, counted from 1.
    pub line: u64,
    /// Time of the violation on the run's clock.
    pub at: Time,
    /// Description of the event, in a sentence.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} broken at {} (line {}): {}", self.invariant, self.at, self.line, self.what)
    }
}

/// Result of a check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckReport {
    /// Number of events read; the hash chain is valid up to the last of them.
    pub events: u64,
    /// Hash of the last event, in hexadecimal.
    pub hash: String,
    /// Reason for which the run ended, if it ended in order. If it did not, I6 and open commits are not judged.
    pub ended: Option<String>,
    /// Set if the journal stops in mid-line, as after a crash.
    pub truncated: Option<JournalError>,
    /// Result for the measured configurations beside the journal.
    pub poses: JudgedPoses,
    /// Result for the run's files.
    pub files: JudgedFiles,
    /// Hard contacts, by the rule that applies to each.
    pub hard: HardContactTally,
    /// Broken invariants, by line.
    pub violations: Vec<Violation>,
}

/// State of a run's files compared with their digests from the end of the run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JudgedFiles {
    /// Number of files that are unchanged since the run ended.
    pub whole: usize,
    /// Description of each damaged file.
    pub damage: Vec<String>,
    /// Reason for which the files are not judged, if they are not.
    pub unjudged: Option<String>,
}

impl CheckReport {
    /// True if part of the record is damaged; an unfinished end after a crash is not damage.
    pub fn is_damaged(&self) -> bool {
        let torn = !self.poses.wrong.is_empty();
        !self.files.damage.is_empty() || self.poses.is_damaged || torn && self.ended.is_some()
    }
}

/// Compares the files of a run with the digests that it stored when it ended.
fn judge_files(path: &Path, dir: &Path, lines: &JournalLines, report: &CheckReport) -> JudgedFiles {
    let unjudged = |why: &str| JudgedFiles { unjudged: Some(why.into()), ..JudgedFiles::default() };
    if report.ended.is_none() {
        return unjudged("the run did not end in order");
    }
    let (seal, must) = lines.seal();
    let Some(seal) = seal else {
        let damage = if must && path.is_dir() { vec!["journal.seal is missing".to_owned()] } else { Vec::new() };
        return JudgedFiles { damage, ..unjudged("no seal is beside the journal") };
    };
    let Some(digest) = &seal.files else {
        let mut files =
            unjudged("the run left no digests (an older version, a full disk, or its process was ended last of all)");
        files.damage.extend((!seal.is_whole).then(|| "journal.seal is not as it was written".into()));
        return files;
    };
    let (whole, mut damage) = files::judge(dir, digest);
    if !seal.is_whole || seal.events != report.events {
        damage.push("journal.seal is not as it was when the run ended".into());
    }
    JudgedFiles { whole, damage, unjudged: None }
}

/// Verifies the chain of a journal (its file or its run's folder), the invariants, and the run's files if it
/// ended in order.
///
/// # Errors
/// If it can't be opened, or its hash chain is broken. A journal that merely stops in mid-line is reported in
/// the result.
pub fn check(path: &Path) -> Result<CheckReport, JournalError> {
    let mut checker = Checker::default();
    let mut merge = Merge::default();
    let mut report = CheckReport::default();
    let dir = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    let mut lines = read(path)?;
    for line in lines.by_ref() {
        match line {
            Ok(line) => {
                merge.until(line.at, &mut checker);
                checker.on(&line);
                if let Event::Robot { robot, .. } = &line.event {
                    merge.robot(dir, robot);
                }
                report.events += 1;
                report.hash = line.hash;
            }
            Err(e) if e.truncated => report.truncated = Some(e),
            Err(e) => return Err(e),
        }
    }
    merge.until(Time(u64::MAX), &mut checker);
    report.poses = merge.end();
    report.hard = checker.hard_contacts();
    (report.ended, report.violations) = checker.end();
    report.files = judge_files(path, dir, &lines, &report);
    Ok(report)
}

/// Checks events from memory; line numbers then count events from 1.
pub fn check_events(events: impl IntoIterator<Item = (Time, Arc<Event>)>) -> Vec<Violation> {
    let mut checker = Checker::default();
    for (n, (at, event)) in (0..).zip(events) {
        checker.on(&JournalLine { line: n + 1, n, at, event: (*event).clone(), hash: String::new() });
    }
    checker.end().1
}

/// One invariant as a state machine.
trait Invariant: Send {
    /// Takes the next line.
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>);
    /// Takes a configuration reading of this robot, if there are any. A violation is attributed to the line
    /// before it.
    fn pose(&mut self, _robot: &str, _at: Time, _q: &Pose, _found: &mut FoundViolations<'_>) {}
    /// Readings of this robot were lost from here on: the previous ones don't connect to the next.
    fn blind(&mut self, _robot: &str) {}
    /// True while the invariant waits for an event that is still to come.
    fn waits(&self) -> bool {
        false
    }
    /// The journal is complete, and the run ended in order.
    fn end(&mut self, _found: &mut FoundViolations<'_>) {}
}

/// Collects the violations that an invariant finds.
struct FoundViolations<'a> {
    invariant: &'static str,
    line: u64,
    at: Time,
    violations: &'a mut Vec<Violation>,
}

impl FoundViolations<'_> {
    fn report(&mut self, what: impl Into<String>) {
        let violation = Violation { invariant: self.invariant, line: self.line, at: self.at, what: what.into() };
        self.violations.push(violation);
    }

    fn report_all<W: Into<String>>(&mut self, what: impl IntoIterator<Item = W>) {
        what.into_iter().for_each(|what| self.report(what));
    }
}

/// State of an invariant per robot, by the robot's name.
trait PerRobot<R> {
    /// Changes the state of a robot; no-op if the journal has not introduced it.
    fn of(&mut self, robot: &str, change: impl FnOnce(&mut R));
}

impl<R> PerRobot<R> for BTreeMap<String, R> {
    fn of(&mut self, robot: &str, change: impl FnOnce(&mut R)) {
        if let Some(known) = self.get_mut(robot) {
            change(known);
        }
    }
}

/// All invariants at once.
pub struct Checker {
    invariants: Vec<(&'static str, Box<dyn Invariant>)>,
    violations: Vec<Violation>,
    robots: Vec<String>,
    last: (u64, Time),
    ended: Option<String>,
    hard: HardContacts,
}

impl Default for Checker {
    fn default() -> Checker {
        let invariants = ALL.iter().map(|promise| (promise.name, promise.make())).collect();
        let hard = HardContacts::default();
        Checker { invariants, violations: Vec::new(), robots: Vec::new(), last: (0, Time::ZERO), ended: None, hard }
    }
}

impl Checker {
    /// Takes the next line.
    pub fn on(&mut self, line: &JournalLine) {
        self.last = (line.line, line.at);
        if crate::names::is_beside(&line.event) {
            return;
        }
        let _ = self.hard.note(line.at, &line.event);
        for (name, invariant) in &mut self.invariants {
            let violations = &mut self.violations;
            invariant.on(line, &mut FoundViolations { invariant: name, line: line.line, at: line.at, violations });
        }
        match &line.event {
            Event::Robot { robot, .. } => self.robots.push(robot.clone()),
            Event::Ended { reason } => self.ended = Some(reason.clone()),
            Event::Resumed { .. } => self.ended = None,
            _ => {}
        }
    }

    /// Takes a reading of the pose of the robot of this index, in the order of the journal.
    pub fn pose(&mut self, robot: usize, at: Time, q: &Pose) {
        let Some(robot) = self.robots.get(robot) else { return };
        let line = self.last.0;
        for (name, invariant) in &mut self.invariants {
            let violations = &mut self.violations;
            invariant.pose(robot, at, q, &mut FoundViolations { invariant: name, line, at, violations });
        }
    }

    /// Readings of the robot with this index were lost: the earlier ones are no evidence for the next.
    pub fn blind(&mut self, robot: usize) {
        let Some(robot) = self.robots.get(robot) else { return };
        self.invariants.iter_mut().for_each(|(_, invariant)| invariant.blind(robot));
    }

    /// True while progress after a simulation's faults have healed is still to be shown (I15).
    pub fn waits(&self) -> bool {
        self.invariants.iter().any(|(_, invariant)| invariant.waits())
    }

    /// Tally of the hard contacts so far.
    pub fn hard_contacts(&self) -> HardContactTally {
        self.hard.tally()
    }

    /// Violations found so far.
    pub fn violations(&self) -> &[Violation] {
        &self.violations
    }

    /// Ends the check. Returns the reason for the run's end, if it ended in order, and all violations, by line.
    pub fn end(mut self) -> (Option<String>, Vec<Violation>) {
        let (line, at) = self.last;
        if self.ended.is_some() {
            for (name, invariant) in &mut self.invariants {
                invariant.end(&mut FoundViolations { invariant: name, line, at, violations: &mut self.violations });
            }
        }
        self.violations.sort_by_key(|v| v.line);
        (self.ended, self.violations)
    }
}

/// True if two configurations agree to within `tolerance` per motor, rad.
fn near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * (1.0 + 1e-9))
}
