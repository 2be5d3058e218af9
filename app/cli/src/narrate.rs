//! Events as sentences for operators: the terminal of a run, `mobee ctl log`, and the last lines of a summary.
//!
//! Journals contain stable names of shapes; the sentences contain their labels ([`Labels`]).

use mobee_compose::compose;
use mobee_compose::config::Config;
use mobee_contract::{
    Cause, EdgeState, Event, Hold, MotorUnits, Note, Outcome, Pose, RestStep, Status, SwapPart, SwapStep, Time,
    distance,
};
use mobee_model::{Contact, Labels, Robot, Scene, ShapeId};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Maximum number of motors that a line names; further ones are counted.
const MAX_NAMED: usize = 3;

/// Importance of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Weight {
    /// For `mobee ctl log` only.
    Detail,
    /// An operator should see it as it happens.
    News,
    /// Needs attention, also in an unattended run.
    Warning,
}

/// An event as a sentence.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Line {
    /// Its importance.
    pub(crate) weight: Weight,
    /// The plural by which a sum counts such lines.
    pub(crate) kind: &'static str,
    /// The sentence, without its time.
    pub(crate) text: String,
}

/// The end of a motion.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MotionLine {
    /// The robot.
    pub(crate) robot: String,
    /// The commit's number.
    pub(crate) id: u64,
    /// Its outcome.
    pub(crate) outcome: Outcome,
}

/// The state of one robot, derived from its events.
#[derive(Default)]
struct RobotState {
    motors: Vec<String>,
    units: MotorUnits,
    tolerance: f64,
    /// The motors that the open commit names.
    named: Vec<usize>,
    /// True if the safe pose of the open commit has moved.
    moved: bool,
    /// The pairs in contact by their names in the journal, with their distances, meters.
    touches: BTreeMap<(String, String), f64>,
    status: Option<Status>,
    halted: bool,
}

/// The labels of the robots of a run, by its folder or journal; empty if its configuration can't be read any more.
pub(crate) fn labels_of(run: &Path) -> Labels {
    let dir = if run.is_dir() { run } else { run.parent().unwrap_or(Path::new(".")) };
    let loaded = Config::load_resolved(&dir.join("config.json")).ok();
    let composition = loaded.and_then(|(config, source)| compose(config, &source).ok());
    composition.map(|c| Labels::new(c.scene.robots())).unwrap_or_default()
}

/// Converts events into sentences, in their order.
pub(crate) struct Narrator {
    robots: Vec<Arc<Robot>>,
    labels: Labels,
    /// The names of all objects of the run, also of removed ones.
    objects: BTreeMap<u32, String>,
    states: BTreeMap<String, RobotState>,
}

impl Narrator {
    /// A narrator for a run that begins in this scene.
    pub(crate) fn new(scene: &Scene) -> Narrator {
        let robots = scene.robots().to_vec();
        let labels = Labels::new(scene.robots());
        let mut narrator = Narrator { robots, labels, objects: BTreeMap::new(), states: BTreeMap::new() };
        narrator.edited(scene);
        narrator
    }

    /// Updates the names of objects after an edit of the world.
    pub(crate) fn edited(&mut self, scene: &Scene) {
        self.objects.extend(scene.objects().map(|(id, object)| (id, object.name.clone())));
    }

    /// The motion that an event ends.
    pub(crate) fn ended(event: &Event) -> Option<MotionLine> {
        let Event::Outcome { robot, id, outcome, .. } = event else { return None };
        Some(MotionLine { robot: robot.clone(), id: id.0, outcome: *outcome })
    }

    /// The event as a line. `None` if it does not concern an operator.
    pub(crate) fn line(&mut self, event: &Event) -> Option<Line> {
        let (weight, kind, text) = self.robot_line(event).or_else(|| system_line(event))?;
        Some(Line { weight, kind, text: self.labels.read(&text).into_owned() })
    }

    fn state_of(&mut self, robot: &str) -> &mut RobotState {
        self.states.entry(robot.to_owned()).or_default()
    }

    fn robot_line(&mut self, event: &Event) -> Option<(Weight, &'static str, String)> {
        use Weight::{Detail, News};
        Some(match event {
            Event::Robot { robot, motors, sliding, tolerance, .. } => {
                let state = self.state_of(robot);
                state.units = MotorUnits::new(motors.len(), sliding);
                (state.motors, state.tolerance) = (motors.clone(), *tolerance);
                return None;
            }
            Event::Commit { robot, id, agent, escape, motors, .. } => {
                let state = self.state_of(robot);
                (state.named, state.moved) = (motors.iter().map(|(m, _)| *m).collect(), false);
                let which = named(&state.motors, &state.named);
                let what = if *escape { "escape" } else { "motion" };
                let weight = if *escape { News } else { Detail };
                (weight, "escapes", format!("{robot}: {what} {} of {agent} begins: {which}", id.0))
            }
            Event::Amended { robot, motors, .. } => {
                self.state_of(robot).named.extend(motors.iter().map(|(m, _)| *m));
                return None;
            }
            Event::SafePoseMoved { robot, .. } => {
                self.state_of(robot).moved = true;
                return None;
            }
            Event::Outcome { robot, id, outcome, q, safe, cause } => {
                let why = cause.as_ref().map(|cause| self.why(robot, cause));
                let state = self.state_of(robot);
                let what = state.ended(*outcome, cause.as_ref(), why.as_deref(), (q, safe.as_ref()));
                let (weight, kind) = match outcome {
                    Outcome::Committed => (Detail, "motions"),
                    Outcome::RolledBack => (News, "rolled back"),
                    Outcome::Faulted if *cause == Some(Cause::Asked) => (Detail, "stopped"),
                    Outcome::Faulted => (News, "faulted"),
                };
                (weight, kind, format!("{robot}: motion {} {what}", id.0))
            }
            Event::ContactBegan { robot, contact, names, .. } => {
                self.state_of(robot).touches.insert(names.clone(), contact.distance);
                (Detail, "contacts", format!("{robot}: {}", near(names, contact.distance)))
            }
            Event::ContactEnded { robot, names, .. } => {
                self.state_of(robot).touches.remove(names);
                (Detail, "contacts", format!("{robot}: {} is clear of {}", names.0, names.1))
            }
            Event::HardContact { robot, names: (a, b), .. } => {
                (News, "hard contacts", format!("{robot}: {a} touches {b}"))
            }
            Event::Pushed { robot, newtons, secs, lasting } => {
                let (weight, begun) = if *lasting { (News, "has been pushing") } else { (Detail, "pushed") };
                (weight, "pushes", format!("{robot} {begun} something for {secs:.2} s, at most with {newtons:.1} N"))
            }
            Event::State { robot, status } => return self.state_of(robot).status_line(robot, *status),
            Event::Halted { robot } => {
                let state = self.state_of(robot);
                if std::mem::replace(&mut state.halted, true) {
                    return None;
                }
                (News, "halts", format!("{robot}: halted; it will not move before `mobee ctl release`"))
            }
            Event::Released { robot } => {
                self.state_of(robot).halted = false;
                (News, "releases", format!("{robot}: released"))
            }
            Event::Displaced { robot, motor, by, motion } => {
                let text = format!(
                    "{robot}: {motor} was moved by {} at rest: by another program, by hand or by its weight",
                    motion.told(*by, 1)
                );
                (News, "motors moved", text)
            }
            Event::Disabled { robot, cause: cause @ Cause::Displaced { .. }, .. } => {
                (News, "motors moved", format!("{robot}: {}", self.why(robot, cause)))
            }
            _ => return None,
        })
    }

    /// The cause of a failed motion, as a clause.
    fn why(&self, robot: &str, cause: &Cause) -> String {
        match cause {
            Cause::Contact(contacts) => self.contact_cause(robot, contacts, ""),
            Cause::Foreseen(contacts) => self.contact_cause(robot, contacts, "would have "),
            Cause::Stall { motor, by, motion } => {
                let by = motion.told(*by, 1);
                format!("{motor} does not follow, by {by}: something holds it that the model does not have")
            }
            Cause::ExternalTorque { motor, torque, motion } => {
                let unit = motion.effort_unit();
                format!("{motor} is pushed with {torque:.1} {unit}, by something that the model does not have")
            }
            Cause::Constraint { part, clause } => format!("constraint {clause} of {part} would not hold"),
            Cause::TargetMissed => "its target was not reached in time".into(),
            Cause::AgentDied => "its agent died or was stopped".into(),
            Cause::Stale => "the encoders gave no fresh readings".into(),
            Cause::ActorDied(actor) => format!("{actor} died"),
            Cause::Crashed => "the process had ended".into(),
            Cause::BoardFault(what) => format!("the board reports {what}"),
            Cause::Displaced { motor, by, motion } => {
                let by = motion.told(*by, 1);
                format!("{motor} was moved by {by} at rest: by another program, by hand or by its weight")
            }
            Cause::Asked => "requested by a person or a program".into(),
        }
    }

    /// The closest pair in contact, and the motors that moved it.
    fn contact_cause(&self, robot: &str, contacts: &[Contact], would: &str) -> String {
        let nearest = contacts.iter().min_by(|a, b| a.distance.total_cmp(&b.distance));
        let Some(contact) = nearest else { return "something was met".into() };
        let index = self.robots.iter().position(|r| r.name == robot);
        let own = |id: ShapeId| id.robot().is_some() && id.robot() == index;
        let (a, b) = if own(contact.pair.0) { contact.pair } else { (contact.pair.1, contact.pair.0) };
        let mm = contact.distance * 1e3;
        let how = match (would, contact.distance < 0.0) {
            ("", true) => format!("came {:.1} mm deep into", -mm),
            ("", false) => format!("came within {mm:.1} mm of"),
            (_, true) => format!("would have come {:.1} mm deep into", -mm),
            (_, false) => format!("would have come within {mm:.1} mm of"),
        };
        let state = self.states.get(robot);
        let mut movers = index.map(|i| contact.movers(&self.robots, i)).unwrap_or_default();
        movers.retain(|m| state.is_none_or(|state| state.named.contains(m)));
        let movers: Vec<usize> = movers.into_iter().collect();
        let by = match state.map(|state| named(&state.motors, &movers)) {
            Some(motors) if !movers.is_empty() => format!(" (moved by {motors})"),
            _ => String::new(),
        };
        let more = if contacts.len() > 1 { format!(", and {} more pairs", contacts.len() - 1) } else { String::new() };
        format!("{} {how} {}{by}{more}", self.shape(a), self.shape(b))
    }

    /// A shape of a robot by its label, or an object by its name.
    fn shape(&self, id: ShapeId) -> String {
        match id {
            ShapeId::Robot { robot, node, .. } => {
                let owner = self.robots.get(usize::from(robot));
                owner.map_or_else(|| format!("robot {robot}"), |owner| owner.label(usize::from(node)))
            }
            ShapeId::Object { object, .. } => {
                self.objects.get(&object).cloned().unwrap_or_else(|| format!("object {object}"))
            }
        }
    }
}

impl RobotState {
    /// The end of a motion, and the place where the robot rests.
    fn ended(&self, outcome: Outcome, cause: Option<&Cause>, why: Option<&str>, at: (&Pose, Option<&Pose>)) -> String {
        let why = why.map(|why| format!(": {why}")).unwrap_or_default();
        match outcome {
            Outcome::Committed => "reached its target".into(),
            Outcome::RolledBack if self.moved => format!("was rolled back{why}; rests at an earlier configuration"),
            Outcome::RolledBack => {
                let (q, safe) = at;
                let away = safe.map(|safe| distance(q, safe)).filter(|away| away.is_finite());
                let away = away.map(|away| format!(" ({} from there)", self.units.told(away, 1))).unwrap_or_default();
                format!("was rolled back{why}; rests where it began{away}")
            }
            Outcome::Faulted if cause == Some(&Cause::Asked) => match self.status {
                Some(Status::Holding(Hold::ShuttingDown)) => "aborted: run ended".into(),
                _ if self.halted => "stopped: halted".into(),
                _ => "stopped on request".into(),
            },
            Outcome::Faulted => format!("failed{why}; rests on the way, neither at its target nor where it began"),
        }
    }

    fn status_line(&mut self, robot: &str, status: Status) -> Option<(Weight, &'static str, String)> {
        let before = self.status.replace(status);
        let news = |text: String| Some((Weight::News, "holds", format!("{robot}: {text}")));
        let detail = |text: &str| Some((Weight::Detail, "states", format!("{robot}: {text}")));
        match status {
            Status::Holding(Hold::ShuttingDown) => detail("stops: the run is ending"),
            Status::Holding(Hold::Halted) => detail("holds: halted"),
            // an earlier line names the motor
            Status::Holding(Hold::Displaced) => detail("holds: it was moved at rest"),
            Status::Holding(Hold::InContact) => match self.touches.iter().next() {
                Some((pair, distance)) => {
                    news(format!("holds: {}; clear it away, or an escape leads out", near(pair, *distance)))
                }
                None => news(format!("holds: {}", Hold::InContact)),
            },
            Status::Holding(hold) => news(format!("holds: {hold}")),
            Status::Rest => match before {
                Some(Status::Holding(_)) => news("accepts motions again".into()),
                Some(Status::Starting) => Some((Weight::Detail, "states", format!("{robot}: ready for motions"))),
                _ => None,
            },
            Status::Retreating => detail("retreats along its path"),
            _ => None,
        }
    }
}

/// Lines for events that do not belong to one robot's motions.
fn system_line(event: &Event) -> Option<(Weight, &'static str, String)> {
    use Weight::{Detail, News, Warning};
    Some(match event {
        Event::RetreatWaits { robot, what, .. } => (Detail, "waits", format!("{robot}: its retreat waits: {what}")),
        Event::RetreatStopped { robot, what, .. } => {
            (News, "retreats aborted", format!("{robot}: its retreat was aborted: {what}"))
        }
        Event::Refused { robot, agent, refusal } => {
            (Detail, "refusals", format!("{robot}: refused {agent}: {refusal}; {}", refusal.remedy()))
        }
        Event::World { object, what, at, .. } => {
            let at = at.map(|[x, y, z]| format!(" at {x:.3} {y:.3} {z:.3} m")).unwrap_or_default();
            (Detail, "edits", format!("{object} was {}{at}", what.word()))
        }
        Event::Note { robot, note: Note::Log { text } } => (Detail, "notes", format!("{robot}: {text}")),
        Event::Note { robot, note: Note::Edge { from, to, state: EdgeState::Removed, cause } } => {
            let why = cause.as_ref().map(|cause| format!(": {cause}")).unwrap_or_default();
            (Detail, "edges removed", format!("{robot}: the edge {from} -> {to} is removed{why}"))
        }
        Event::Done { robot, summary } => {
            (News, "agents done", format!("{robot}: its agent is done: {}", summary.text))
        }
        Event::Rest { robot, step } => {
            let weight = if matches!(step, RestStep::Missed { .. }) { Warning } else { News };
            (weight, "rest poses", format!("{robot}: {step}"))
        }
        Event::AgentActs { robot, acts } => {
            let what = if *acts { "acts again" } else { "pauses" };
            (News, "pauses", format!("{robot}: its agent {what}"))
        }
        Event::Swap { robot: name, part, step } | Event::SwapBeside { name, part, step } => {
            let trouble = matches!(step, SwapStep::Refused { .. } | SwapStep::Reverted { .. });
            let weight = if trouble { Warning } else { News };
            (weight, "swaps", format!("{name}: swap of the {part}: {}", swap_step_text(*part, step)))
        }
        Event::Stale { sensor, object } => (News, "objects lost", format!("{sensor} does not see {object} any more")),
        Event::Died { actor, reason } => (News, "deaths", format!("{actor} died: {reason}")),
        Event::Restarted { actor, restarts } => {
            (News, "restarts", format!("{actor} was restarted ({restarts} within its period)"))
        }
        Event::GaveUp { group } => (Warning, "groups given up", format!("{group} used up its restarts")),
        Event::Warning { text } => (Warning, "warnings", text.clone()),
        Event::Injected { fault } => (Detail, "faults", format!("injected: {fault}")),
        Event::CommandDropped { robot, reason, .. } => {
            (Detail, "commands dropped", format!("{robot}: a command was discarded: {reason}"))
        }
        Event::Ended { reason } => (Detail, "ends", format!("the run has ended: {reason}")),
        _ => return None,
    })
}

/// A step of a swap as a phrase, with a remedy if there is one.
pub(crate) fn swap_step_text(part: SwapPart, step: &SwapStep) -> String {
    let why = match step {
        SwapStep::Refused { why } | SwapStep::Reverted { why } => why.as_str(),
        _ => return step.to_string(),
    };
    format!("{step}{}", fresh_remedy(part, why))
}

/// The remedy for a new part that can't take over the old one's state.
pub(crate) fn fresh_remedy(part: SwapPart, why: &str) -> String {
    if !why.contains("the state can't be taken over") {
        return String::new();
    }
    format!("; `mobee ctl swap {part} FILE --fresh` starts it without the old one's state")
}

fn near((a, b): &(String, String), distance: f64) -> String {
    let mm = distance * 1e3;
    if distance < 0.0 { format!("{a} is {:.1} mm deep in {b}", -mm) } else { format!("{a} is {mm:.1} mm from {b}") }
}

/// Some motors by name.
fn named(names: &[String], motors: &[usize]) -> String {
    let known: Vec<&str> = motors.iter().filter_map(|m| Some(names.get(*m)?.as_str())).collect();
    match known.split_at_checked(MAX_NAMED) {
        Some((first, rest)) if !rest.is_empty() => format!("{} and {} more motors", first.join(", "), rest.len()),
        _ => known.join(", "),
    }
}

/// The time of an event in front of its line.
pub(crate) fn timed(at: Time, text: &str) -> String {
    format!("{:.1} s: {text}", at.secs())
}

#[cfg(test)]
mod tests;
