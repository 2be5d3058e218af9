//! Log lines of events: source, severity, and one sentence.

use mobee_contract::{Cause, EdgeState, Event, Hold, Note, Outcome, RestStep, Status, SwapStep};
use mobee_model::Contact;

/// Severity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    Trace,
    Debug,
    Info,
    Warn,
    Error,
}

impl Level {
    /// Name of the level in Rerun.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Level::Trace => "TRACE",
            Level::Debug => "DEBUG",
            Level::Info => "INFO",
            Level::Warn => "WARN",
            Level::Error => "ERROR",
        }
    }
}

fn displaced(motor: &str, by: &str) -> String {
    format!("{motor} was moved by {by} at rest: by another program, by hand or by its weight")
}

/// Log line of an event: the source (`system`, `world` or a robot's name), level and text. `None` if it gets no
/// line. `vertex` returns the label of a robot's vertex.
pub(crate) fn line<'a>(event: &'a Event, vertex: &dyn Fn(&str, u32) -> String) -> Option<(&'a str, Level, String)> {
    use Level::{Debug, Error, Info, Trace, Warn};
    Some(match event {
        Event::Started { seed, clock, .. } => ("system", Info, format!("started: seed {seed}, {clock} clock")),
        Event::Resumed { events, .. } => {
            ("system", Warn, format!("resumed after {events} events of an earlier process"))
        }
        Event::Robot { robot, motors, period, margin, .. } => (
            robot,
            Info,
            format!("{} motors, period {:.0} ms, margin {:.0} mm", motors.len(), period * 1e3, margin * 1e3),
        ),
        Event::Displaced { robot, motor, by, motion } => (robot, Warn, displaced(motor, &motion.told(*by, 2))),
        Event::Found { robot, motors } => (robot, Debug, format!("{} motors as they were found", motors.len())),
        Event::Controller { robot, kind, reflex, .. } => {
            let reflex = if *reflex { "" } else { ", without a reflex" };
            (robot, Info, format!("controller: {kind}{reflex}"))
        }
        Event::Enabled { robot, .. } => (robot, Debug, "filter open".to_owned()),
        Event::Disabled { robot, cause: Cause::Asked, .. } => (robot, Info, "filter closed: asked for".to_owned()),
        Event::Disabled { robot, cause, .. } => (robot, Warn, format!("filter closed: {}", why(cause))),
        Event::State { robot, status: Status::Holding(Hold::ShuttingDown) } => {
            (robot, Info, format!("holds: {}", Hold::ShuttingDown))
        }
        Event::State { robot, status: Status::Holding(Hold::Halted) } => {
            (robot, Warn, format!("holds: {}", Hold::Halted))
        }
        Event::Halted { robot } => (robot, Warn, "halted".to_owned()),
        Event::Released { robot } => (robot, Info, "released".to_owned()),
        Event::State { robot, status: Status::Holding(reason) } => (robot, Error, format!("holds: {reason}")),
        Event::State { .. } | Event::SafePose { .. } | Event::Command { .. } | Event::Streamed { .. } => return None,
        Event::Told { .. } => return None,
        Event::SafePoseMoved { robot, id, recorded: Some(at), .. } => {
            (robot, Info, format!("#{}: the stream is taken back to where the robot was at {at}", id.0))
        }
        Event::SafePoseMoved { robot, id, .. } => {
            (robot, Warn, format!("#{}: its safe pose moved (a long motion, or another robot has to pass there)", id.0))
        }
        Event::Commit { robot, id, agent, escape, .. } => {
            let what = if *escape { "escape" } else { "commit" };
            (robot, Info, format!("#{} {what} of {agent}", id.0))
        }
        Event::Amended { robot, id, .. } => (robot, Info, format!("#{} amended", id.0)),
        Event::Refused { robot, agent, refusal } => (robot, Warn, format!("refused {agent}: {refusal}")),
        Event::Outcome { robot, id, outcome, cause, .. } => {
            let (level, text) = outcome_text(*outcome, cause.as_ref());
            (robot, level, format!("#{} {text}", id.0))
        }
        Event::CommandDropped { robot, writer, reason, .. } => {
            (robot, Warn, format!("command of {writer:?} discarded: {reason}"))
        }
        Event::ContactBegan { robot, contact, names: (a, b), .. } => {
            (robot, Warn, format!("{a} is {:.1} mm from {b}", contact.distance * 1e3))
        }
        Event::ContactEnded { robot, names: (a, b), .. } => (robot, Debug, format!("{a} is clear of {b}")),
        Event::HardContact { robot, names: (a, b), .. } => (robot, Error, format!("{a} touches {b}")),
        Event::Pushed { robot, newtons, secs, lasting } => {
            let (weight, begun) = if *lasting { (Error, "has been pushing") } else { (Warn, "pushed") };
            (robot, weight, format!("{begun} something for {secs:.2} s, at most with {newtons:.1} N"))
        }
        Event::RetreatBegan { robot, id, secs, .. } => {
            (robot, Warn, format!("#{} goes back along {secs:.1} s of its path", id.0))
        }
        Event::Bridged { robot, since, until, .. } => {
            let secs = until.since(*since).as_secs_f64();
            (robot, Warn, format!("no readings for {secs:.2} s: its path there is the commanded one"))
        }
        Event::RetreatJoined { robot, id, motors } => {
            (robot, Info, format!("#{}: a contact has bent {} more motors, which go back as well", id.0, motors.len()))
        }
        Event::RetreatWaits { robot, what, .. } => (robot, Warn, format!("waits on its way back: {what}")),
        Event::RetreatGoesOn { robot } => (robot, Info, "goes on on its way back".to_owned()),
        Event::RetreatStopped { robot, what, .. } => (robot, Error, format!("the retreat was given up: {what}")),
        Event::World { object, what, class, at } => {
            let class = class.map(|c| format!(" {}", format!("{c:?}").to_lowercase())).unwrap_or_default();
            let at = at.map(|[x, y, z]| format!(" at {x:.2} {y:.2} {z:.2} m")).unwrap_or_default();
            ("world", Info, format!("{object} {}:{class}{at}", what.word()))
        }
        Event::Note { robot, note } => return note_line(robot, note, &|id| vertex(robot, id)),
        Event::Done { robot, summary } => (robot, Info, format!("done: {}", summary.text)),
        Event::Rest { robot, step } => {
            (robot, if matches!(step, RestStep::Missed { .. }) { Warn } else { Info }, step.to_string())
        }
        Event::AgentActs { robot, acts } => {
            (robot, Info, if *acts { "its own agent acts again" } else { "its own agent yields" }.to_owned())
        }
        Event::Swap { robot: name, part, step } | Event::SwapBeside { name, part, step } => {
            (name, swap_level(step), format!("swap of the {part}: {step}"))
        }
        Event::Shadow { .. } | Event::Sighted { .. } | Event::Located { .. } => return None,
        Event::Stale { sensor, object } => ("system", Warn, format!("{sensor} does not see {object} any more")),
        Event::Died { actor, reason } => ("system", Error, format!("{actor} died: {reason}")),
        Event::Restarted { actor, restarts } => ("system", Warn, format!("{actor} restarted ({restarts})")),
        Event::GaveUp { group } => ("system", Error, format!("{group} stays down: restarted too often")),
        Event::Injected { fault } => ("system", Warn, format!("injected: {fault}")),
        Event::Warning { text } => ("system", Warn, text.clone()),
        Event::Link { link, sent, dropped, .. } => {
            ("system", Trace, format!("link {link}: {sent} sent, {dropped} dropped"))
        }
        Event::Ended { reason } => ("system", Info, format!("ended: {reason}")),
    })
}

/// Level and text of an outcome.
fn outcome_text(outcome: Outcome, cause: Option<&Cause>) -> (Level, String) {
    let because = cause.map(|c| format!(": {}", why(c))).unwrap_or_default();
    match outcome {
        Outcome::Committed => (Level::Info, "committed".to_owned()),
        // An orderly end is not an error.
        Outcome::Faulted if cause == Some(&Cause::Asked) => (Level::Info, format!("aborted{because}")),
        Outcome::RolledBack => (Level::Warn, format!("rolled back{because}")),
        Outcome::Faulted => (Level::Error, format!("faulted{because}")),
    }
}

/// Level of a step of a swap.
fn swap_level(step: &SwapStep) -> Level {
    match step {
        SwapStep::Reverted { .. } => Level::Error,
        SwapStep::Refused { .. } => Level::Warn,
        _ => Level::Info,
    }
}

fn note_line<'a>(robot: &'a str, note: &Note, vertex: &dyn Fn(u32) -> String) -> Option<(&'a str, Level, String)> {
    let way = |from: u32, to: u32| format!("{} -> {}", vertex(from), vertex(to));
    Some(match note {
        // The notes on the edge give the result.
        Note::Vertex { .. } | Note::Tried { .. } => return None,
        Note::Edge { from, to, state: EdgeState::Feasible, .. } => {
            (robot, Level::Info, format!("edge {} is feasible", way(*from, *to)))
        }
        Note::Edge { from, to, state: EdgeState::Removed, cause } => {
            let because = cause.as_ref().map(|c| format!(": {c}")).unwrap_or_default();
            (robot, Level::Warn, format!("edge {} removed{because}", way(*from, *to)))
        }
        Note::Edge { from, to, state: EdgeState::Blocked, cause } => {
            let because = cause.as_ref().map(|c| format!(": {c}")).unwrap_or_default();
            (robot, Level::Debug, format!("edge {} is blocked{because}", way(*from, *to)))
        }
        Note::Edge { .. } => return None,
        Note::Plan { path } if path.is_empty() => return None,
        Note::Plan { path } => {
            let path: Vec<_> = path.iter().map(|id| vertex(*id)).collect();
            (robot, Level::Debug, format!("plan: {}", path.join(" -> ")))
        }
        Note::Log { text } => (robot, Level::Info, text.clone()),
    })
}

/// A cause in a few words.
fn why(cause: &Cause) -> String {
    let nearest = |what: &str, contacts: &[Contact]| {
        let least = contacts.iter().map(|c| c.distance).fold(f64::INFINITY, f64::min);
        if least.is_finite() { format!("{what}, {:.1} mm", least * 1e3) } else { what.to_owned() }
    };
    match cause {
        Cause::Contact(contacts) => nearest("contact", contacts),
        Cause::Foreseen(contacts) => nearest("contact foreseen", contacts),
        Cause::Stall { motor, by, motion } => {
            format!("{motor} does not follow, by {}: something holds it", motion.told(*by, 2))
        }
        Cause::ExternalTorque { motor, torque, motion } => {
            format!("{motor} is pushed with {torque:.1} {}", motion.effort_unit())
        }
        Cause::Constraint { part, clause } => format!("constraint {clause} of {part}"),
        Cause::TargetMissed => "the target was missed".to_owned(),
        Cause::AgentDied => "the agent died".to_owned(),
        Cause::Stale => "the encoders are stale".to_owned(),
        Cause::ActorDied(actor) => format!("{actor} died"),
        Cause::Crashed => "the process ended in mid-motion".to_owned(),
        Cause::Displaced { motor, by, motion } => displaced(motor, &motion.told(*by, 2)),
        Cause::BoardFault(what) => format!("the board reports {what}"),
        Cause::Asked => "asked for".to_owned(),
    }
}
