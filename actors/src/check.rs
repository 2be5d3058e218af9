//! The invariants of a run as predicates over its journal, so that one checker serves tests, simulations and real robots.
//!
//! | | promise | |
//! |---|---|---|
//! | I1 | closed means closed | no agent's command reaches the driver while the filter is closed; old tokens write nothing |
//! | I2 | one outcome | every accepted commit ends exactly once |
//! | I3 | home is a vertex | after a rollback the robot rests at the safe pose, which is a vertex for an agent with a map |
//! | I4 | safe pose is honest | taken at rest, fresh, free, with no transaction open |
//! | I5 | limits | what leaves the filter is finite, within limits, and not too fast |
//! | I6 | nothing vanishes | sent = handled + queued + dropped on every link |
//! | I7 | bounded | no more wait on a link than its credit allows |
//! | I8 | stale is not fresh | commits are accepted, and outcomes given, by fresh readings |
//! | I9 | the retreat is watched | a contact during the retreat stops it within one period |
//! | I10 | a restart does not move | no motion from a start or restart until the next commit, but a retreat |
//! | I11 | removed stays removed | no plan leads over a removed or blocked edge |
//! | I14 | several robots | while several are retreating, no contact between two of them begins |
//! | I15 | liveness | once all faults have healed, motions end, filters open, and agents go on |
//! | I17 | ended means at rest | an outcome is given only while the robot is measured to rest |
//! | I18 | orphans are cancelled | a motion does not go on when its agent has died |
//! | I19 | a contact closes the filter | a contact that begins in mid-motion closes the filter within one control period |
//! | I20 | no motor too fast | no motor is measured to go faster than its commit allows it |
//! | I21 | idle motors stay put | a motor that no open commit names does not leave its place, not in the long run either, and no command but a stop names it |
//! | I22 | failed motions are rolled back | a contact, a constraint, a stall, a missed target, the agent's death: the motion ends rolled back, the way it came, unless the journal says why not |
//! | I23 | a failed edge is removed | before the agent commits again, and no other is |
//! | I25 | a violated constraint closes the filter | a constraint that is violated, at rest or in motion, closes the filter; during the retreat, or if it gets worse in an escape, it stops the robot |
//! | I26 | frozen encoders are noticed | readings that are equal bit for bit while the motors should go on end the motion in a stated time |
//! | I27 | contacts have hysteresis | a contact begins below the margin, and again only after it has ended |
//! | I28 | a death closes the filter | the death of the model or of a controller's actor closes the filter within two leases, an exchange before the new part is looked at; a new driver stops its board first, and a stop hushes what waits |
//! | I29 | agents are told the truth | `committed` is said only within the tolerance of the target; the built-in agent is told how its motion ended once, after its outcome and before it commits again, and it is what the outcome says |
//! | I31 | displacement at rest closes the filter | a robot that is moved at rest, by no command of its filter, closes it: beyond the tolerance it is told of and does not stay open |
//! | I34 | no avoidable hard contact | a robot that looks ahead touches nothing that it could have stopped before |
//! | I35 | nothing is pushed for long | what a simulated robot pushes, it pushes for a second at most, beside the time in which it brakes and comes back |
//!
//! Each is a small state machine in a file of its own, fed with one line after the other, and with the measured poses beside the
//! journal where there are any ([`crate::record::track`]): I4 and I22 look at those, too, I8, I17, I20, I21, I25, I26 and I31 want them. I15 is judged where a simulation
//! says that its faults have healed. [`ALL`] lists them.

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
pub(crate) mod touches;
mod watched_retreat;
mod window;
pub use all::{ALL, InvariantEntry, Wants, judged, wants_poses};
pub use hard_contacts::HardContactTally;
pub use poses::JudgedPoses;
pub use retreat_pace::SLOW_RETREAT;
pub use summary::{RunSummary, summary};

use crate::record::files;
use crate::record::journal::{JournalError, JournalLine, JournalLines, read};
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
    /// Which, by its name in [`ALL`].
    pub invariant: &'static str,
    /// The line of the journal, counted from 1.
    pub line: u64,
    /// When.
    pub at: Time,
    /// What happened, in a sentence.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} broken at {} (line {}): {}", self.invariant, self.at, self.line, self.what)
    }
}

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckReport {
    /// Events read; the chain is right up to the last of them.
    pub events: u64,
    /// The hash of the last, in hexadecimal.
    pub hash: String,
    /// Why the run ended, if it ended in order. If not, I6 and open commits are not judged.
    pub ended: Option<String>,
    /// Set if the journal stops in mid-line, as after a crash.
    pub truncated: Option<JournalError>,
    /// The measured poses beside it.
    pub poses: JudgedPoses,
    /// The files of the run.
    pub files: JudgedFiles,
    /// Hard contacts, by the rule that applies to each.
    pub hard: HardContactTally,
    /// Broken invariants, by line.
    pub violations: Vec<Violation>,
}

/// What became of a run's files since it ended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JudgedFiles {
    /// Files that are as they were when the run ended.
    pub whole: usize,
    /// What is wrong with others, in words.
    pub damage: Vec<String>,
    /// Why they are not judged, if they are not.
    pub unjudged: Option<String>,
}

impl CheckReport {
    /// Whether something of the record is damaged, which nothing but a crash's unfinished end excuses.
    pub fn is_damaged(&self) -> bool {
        let torn = !self.poses.wrong.is_empty();
        !self.files.damage.is_empty() || self.poses.is_damaged || torn && self.ended.is_some()
    }
}

/// Judges the files of a run by the digests that it left when it ended.
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

/// Verifies the chain of a journal (its file or its run's folder), the invariants, and the run's files if it ended in order.
///
/// # Errors
/// If it can't be opened, or is not as it was written. A journal that merely stops in mid-line is reported on.
pub fn check(path: &Path) -> Result<CheckReport, JournalError> {
    let (mut checker, mut merge) = (Checker::default(), Merge::default());
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

/// Checks events that were kept in memory; line numbers then count events from 1.
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
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>);
    /// Takes a reading of this robot's pose, where there are any: what it finds is put at the line before.
    fn pose(&mut self, _robot: &str, _at: Time, _q: &Pose, _found: &mut Found<'_>) {}
    /// The readings of this robot that come next are not known.
    fn blind(&mut self, _robot: &str) {}
    /// Whether it waits for something that is still to come.
    fn waits(&self) -> bool {
        false
    }
    /// The journal is over, and ended in order.
    fn end(&mut self, _found: &mut Found<'_>) {}
}

/// Where an invariant puts what it finds.
struct Found<'a> {
    invariant: &'static str,
    line: u64,
    at: Time,
    violations: &'a mut Vec<Violation>,
}

impl Found<'_> {
    fn say(&mut self, what: impl Into<String>) {
        let (invariant, line, at) = (self.invariant, self.line, self.at);
        self.violations.push(Violation { invariant, line, at, what: what.into() });
    }

    fn say_all<W: Into<String>>(&mut self, what: impl IntoIterator<Item = W>) {
        what.into_iter().for_each(|what| self.say(what));
    }
}

/// What an invariant knows of each robot, by its name.
trait PerRobot<R> {
    /// Changes what is known of a robot, if it is one of the journal's.
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
        if crate::record::names::is_beside(&line.event) {
            return;
        }
        let _ = self.hard.note(line.at, &line.event);
        for (name, invariant) in &mut self.invariants {
            let violations = &mut self.violations;
            invariant.on(line, &mut Found { invariant: name, line: line.line, at: line.at, violations });
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
            invariant.pose(robot, at, q, &mut Found { invariant: name, line, at, violations });
        }
    }

    /// Readings of the robot of this index were lost: those before say nothing of what comes.
    pub fn blind(&mut self, robot: usize) {
        let Some(robot) = self.robots.get(robot) else { return };
        self.invariants.iter_mut().for_each(|(_, invariant)| invariant.blind(robot));
    }

    /// Whether progress is still to be shown after a simulation's faults have healed (I15).
    pub fn waits(&self) -> bool {
        self.invariants.iter().any(|(_, invariant)| invariant.waits())
    }

    /// The hard contacts so far.
    pub fn hard_contacts(&self) -> HardContactTally {
        self.hard.tally()
    }

    /// What was found so far.
    pub fn violations(&self) -> &[Violation] {
        &self.violations
    }

    /// Why the run ended, if in order, and everything found, by line.
    pub fn end(mut self) -> (Option<String>, Vec<Violation>) {
        let (line, at) = self.last;
        if self.ended.is_some() {
            for (name, invariant) in &mut self.invariants {
                invariant.end(&mut Found { invariant: name, line, at, violations: &mut self.violations });
            }
        }
        self.violations.sort_by_key(|v| v.line);
        (self.ended, self.violations)
    }
}

/// Whether two poses agree to within `tolerance` per motor, rad.
fn near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * (1.0 + 1e-9))
}
