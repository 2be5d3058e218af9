//! A running system as text: one line per robot, then the tree of actors and the links.

use crate::narrate::swap_step_text;
use mobee_contract::{Hold, Status, SwapPart, SwapStep};
use mobee_runtime::supervision::Health;
use mobee_runtime::system::{KeptObject, RobotReport, SystemReport};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

/// Time for which the end of a swap is shown.
const SWAP_NEWS_TIME: Duration = Duration::from_secs(30);

/// The state of a robot as the word of a status line.
pub(super) fn state(robot: &RobotReport, gave_up: bool) -> String {
    if gave_up {
        return "FAULT(gave_up)".into();
    }
    let exchanged = |(part, step): (&SwapPart, &SwapStep)| *part != SwapPart::Agent && !step.is_last();
    match robot.status {
        Status::Holding(Hold::BoardFault) => "FAULT(board)".into(),
        Status::Holding(Hold::SlowBoard) => "CLOSED(slow board)".into(),
        Status::Holding(Hold::Displaced) => "CLOSED(moved at rest)".into(),
        Status::Holding(Hold::Halted) => "HALTED".into(),
        Status::Holding(Hold::Stale) => format!("STALE({:.1} s)", robot.age.as_secs_f64()),
        Status::Starting if robot.swaps.iter().any(exchanged) => "CLOSED(swap)".into(),
        Status::Starting => "CLOSED(starting)".into(),
        _ if robot.age > robot.fresh => format!("STALE({:.1} s)", robot.age.as_secs_f64()),
        Status::Rest | Status::Moving | Status::Escaping => "ARMED".into(),
        Status::Stopping => "CLOSED(stopping)".into(),
        Status::Retreating | Status::Settling => "RETREATING".into(),
        Status::Holding(_) => "HOLDING".into(),
    }
}

/// The robot's next motion, or the reason why it does not move and the remedy.
fn outlook(robot: &RobotReport, gave_up: bool, now: &SystemReport) -> String {
    let name = &robot.name;
    let done = now.counts.done.contains_key(name);
    if gave_up {
        return "a part was restarted too often; the run ends".into();
    }
    let stale = robot.age > robot.fresh;
    match robot.status {
        Status::Holding(Hold::Halted) => {
            format!("a person halted it; it will not move before `mobee ctl release {name}`")
        }
        Status::Starting if stale => "no fresh readings yet; see that its board is switched on and connected".into(),
        Status::Starting => "not ready yet; it will not move before it is seen at rest".into(),
        _ if stale && !matches!(robot.status, Status::Holding(Hold::BoardFault)) => {
            "no fresh readings of its encoders; it acts again by itself when there are some".into()
        }
        Status::Rest if !robot.has_agent => {
            "rests; it moves when a program or `mobee ctl go` commits a motion, or an agent is swapped in".into()
        }
        Status::Rest if !robot.acts => {
            format!("rests; its agent is paused and will not move it before `mobee ctl resume {name}`")
        }
        Status::Rest if done => "rests; its agent is done".into(),
        Status::Rest => "rests; its agent may move it at any time".into(),
        Status::Moving if !robot.acts => "moves; its agent is paused after this motion".into(),
        Status::Moving => "moves".into(),
        Status::Escaping => "moves slowly out of a contact".into(),
        Status::Stopping => "brakes; it was stopped and goes back next".into(),
        Status::Retreating | Status::Settling => "moves back along its own path to where its motion began".into(),
        Status::Holding(Hold::InContact) => {
            let why = touching(robot).unwrap_or_else(|| Hold::InContact.to_string());
            format!("{why}; clear it away, or wait for its agent to escape")
        }
        Status::Holding(hold @ (Hold::RetreatBlocked | Hold::RetreatMissed | Hold::HistoryTooShort)) => {
            let why = touching(robot).map_or_else(|| hold.to_string(), |why| format!("{hold}: {why}"));
            format!("{why}; clear its way, then `mobee ctl recover {name}`")
        }
        Status::Holding(Hold::AfterCrash) => {
            format!("the process had ended in mid-motion; `mobee ctl recover {name}` takes it back")
        }
        Status::Holding(hold) => hold.to_string(),
    }
}

/// The closest pair in contact, and the number of the others.
fn touching(robot: &RobotReport) -> Option<String> {
    let (a, b, distance) = robot.touches.first()?;
    let mm = distance * 1e3;
    let how = if mm < 0.0 { format!("{:.1} mm deep in", -mm) } else { format!("{mm:.1} mm from") };
    let more = match robot.touches.len() {
        1 => String::new(),
        n => format!(", and {} more pairs", n - 1),
    };
    Some(format!("{a} is {how} {b}{more}"))
}

/// True if a swap is under way, or ended recently.
fn is_news(now: &SystemReport, name: &str, part: SwapPart, step: &SwapStep) -> bool {
    let at = now.swapped_at.get(&(name.to_owned(), part));
    !step.is_last() || at.is_none_or(|at| now.at.since(*at) < SWAP_NEWS_TIME)
}

/// The lines of `mobee ctl status`. Rates and shares are taken between `before`, an earlier report, and `now`.
pub(super) fn lines(now: &SystemReport, before: Option<&SystemReport>) -> Vec<String> {
    let mut lines = robot_lines(now);
    let beside = now.beside.iter().filter(|((name, part), step)| is_news(now, name, *part, step));
    lines.extend(
        beside.map(|((name, part), step)| format!("{name}  swap of the {part}: {}", swap_step_text(*part, step))),
    );
    for sensor in &now.sensors {
        lines.extend(sensor.objects.iter().map(|object| format!("{}  {}", sensor.name, object_line(now, object))));
    }
    for (name, why) in &now.counts.down {
        lines.push(format!("{name}  DOWN: {why}; `mobee ctl restart {name}` starts it again"));
    }
    count_lines(now, &mut lines);
    lines.push(String::new());
    let secs = before.map(|b| now.at.since(b.at).as_secs_f64()).filter(|s| *s > 0.0);
    load_lines(now, before, secs, &mut lines);
    lines.push(String::new());
    link_lines(now, before, secs, &mut lines);
    lines
}

/// One line for each robot: state, outlook, board, hold offsets, swaps.
fn robot_lines(now: &SystemReport) -> Vec<String> {
    let wide = now.robots.iter().map(|r| r.name.len()).max().unwrap_or(0);
    let gave_up = now.counts.is_given_up;
    let line = |robot: &RobotReport| {
        let mut line = format!("{:wide$}  {}: {}", robot.name, state(robot, gave_up), outlook(robot, gave_up, now));
        if let Some(answers) = robot.answers {
            let _ = write!(line, "; its board {answers}");
        }
        if !robot.hold_offsets.is_empty() {
            let each = robot.hold_offsets.iter().map(|(motor, rad)| format!("{motor} {:+.1}", rad.to_degrees()));
            let _ = write!(line, "; hold offsets: {} deg", each.collect::<Vec<_>>().join(", "));
        }
        for (part, step) in robot.swaps.iter().filter(|(part, step)| is_news(now, &robot.name, **part, step)) {
            let _ = write!(line, "; swap of the {part}: {}", swap_step_text(*part, step));
        }
        line
    };
    now.robots.iter().map(line).collect()
}

/// The place of an object that a sensor tracks.
fn object_line(now: &SystemReport, KeptObject { object, place, seen, is_stale }: &KeptObject) -> String {
    let Some([x, y, z]) = place else { return format!("{object} has not been seen") };
    let age = now.at.since(*seen).as_secs_f64();
    let stale = if *is_stale { ", STALE" } else { "" };
    format!("{object} at {x:.3} {y:.3} {z:.3} m, seen {age:.1} s ago{stale}")
}

/// The counters: motions and their causes, and those of the others that are not zero.
fn count_lines(now: &SystemReport, lines: &mut Vec<String>) {
    let c = &now.counts;
    lines.push(format!(
        "{:.1} s: {} motions, {} committed, {} rolled back, {} faulted, {} refused, {} contacts, {} restarts",
        now.at.secs(),
        c.commits,
        c.committed,
        c.rolled_back,
        c.faulted,
        c.refused,
        c.contacts,
        c.restarts
    ));
    lines.extend(c.failed_by().map(|causes| format!("motions failed by: {causes}")));
    if c.pictures_skipped + c.regions_omitted > 0 {
        let pictures = c.pictures_skipped;
        let regions = c.regions_omitted;
        lines.push(format!("{pictures} pictures were skipped, {regions} regions omitted; see the journal"));
    }
    if c.hard_contacts > 0 {
        lines.push(format!("{} hard contacts, at most {:.1} mm deep", c.hard_contacts, c.hard_contact_depth_mm));
    }
    if c.push_n > 0.0 {
        lines.push(format!("pushed something with at most {:.1} N, for at most {:.2} s", c.push_n, c.push_s));
    }
    if c.displaced > 0 {
        let times = c.displaced;
        lines.push(format!(
            "motors moved uncommanded {times} times: by another program, by hand or by their weight; see the journal"
        ));
    }
    let taps = now.links.iter().filter_map(|(name, c)| Some((name.strip_prefix("tap>")?.to_owned(), c.dropped)));
    lines.extend(crate::run::overload(c, taps).map(|(what, _)| what));
}

/// The supervision tree, with the share of a core that each actor used in the last `secs` seconds.
fn load_lines(now: &SystemReport, before: Option<&SystemReport>, secs: Option<f64>, lines: &mut Vec<String>) {
    let share = |now: Duration, before: Duration, secs: f64| 100.0 * now.saturating_sub(before).as_secs_f64() / secs;
    let mut shares = BTreeMap::new();
    if let (Some(before), Some(secs)) = (before.filter(|_| !now.busy.is_empty()), secs) {
        let of = |(name, time): (&String, &Duration)| {
            (name.clone(), share(*time, before.busy.get(name).copied().unwrap_or_default(), secs))
        };
        shares = now.busy.iter().map(of).collect();
        let all = share(now.process, before.process, secs);
        let known = shares.values().sum::<f64>();
        lines.push(format!("processor: {all:.1} % of a core, {known:.1} % by these actors and their tasks"));
    }
    for group in &now.tree {
        branch(group, 0, &shares, lines);
    }
    // the supervisors of the sinks are not part of this tree
    let sink = |(name, _): &(String, _)| {
        let sink = name.strip_prefix("tap>")?;
        shares.get(sink).map(|share| format!("  {sink}  {share:.1} %"))
    };
    let mut sinks = now.links.iter().filter_map(sink).peekable();
    if sinks.peek().is_some() {
        lines.push("taps".into());
    }
    lines.extend(sinks);
}

/// The links between the actors: rate in the last `secs` seconds, queue, and dropped messages.
fn link_lines(now: &SystemReport, before: Option<&SystemReport>, secs: Option<f64>, lines: &mut Vec<String>) {
    lines.push(format!("{:28} {:>9} {:>6} {:>8}", "link", "per s", "queue", "dropped"));
    for (name, counters) in &now.links {
        let earlier = before.and_then(|b| b.links.iter().find(|(n, _)| n == name)).map(|(_, c)| c.sent);
        let rate = match (earlier, secs) {
            (Some(sent), Some(secs)) => format!("{:.1}", (counters.sent.saturating_sub(sent)) as f64 / secs),
            _ => "-".into(),
        };
        lines.push(format!("{name:28} {rate:>9} {:>6} {:>8}", counters.queued, counters.dropped));
    }
}

fn branch(health: &Health, depth: usize, shares: &BTreeMap<String, f64>, lines: &mut Vec<String>) {
    let dead = if health.alive { "" } else { "  DOWN" };
    let restarts = match health.restarts {
        0 => String::new(),
        n => format!("  {n} restarts"),
    };
    let share = shares.get(&health.name).map(|share| format!("  {share:.1} %")).unwrap_or_default();
    lines.push(format!("{:indent$}{}{share}{restarts}{dead}", "", health.name, indent = 2 * depth));
    for child in &health.children {
        branch(child, depth + 1, shares, lines);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::{AnswerTime, Time};
    use mobee_runtime::stream::StreamCounters;
    use mobee_runtime::system::{RunCounts, SensorReport};

    fn robot(status: Status, age_ms: u64) -> RobotReport {
        let age = Duration::from_millis(age_ms);
        let fresh = Duration::from_millis(100);
        RobotReport {
            name: "icub".into(),
            status,
            age,
            fresh,
            answers: None,
            hold_offsets: Vec::new(),
            has_agent: true,
            acts: true,
            touches: Vec::new(),
            swaps: BTreeMap::new(),
        }
    }

    #[test]
    fn one_word_says_why_a_robot_does_not_move() {
        let says = |status, age| state(&robot(status, age), false);
        assert_eq!(says(Status::Moving, 10), "ARMED");
        assert_eq!(says(Status::Moving, 1500), "STALE(1.5 s)");
        assert_eq!(says(Status::Starting, 1500), "CLOSED(starting)");
        assert_eq!(says(Status::Settling, 10), "RETREATING");
        assert_eq!(says(Status::Holding(Hold::RetreatBlocked), 10), "HOLDING");
        assert_eq!(says(Status::Holding(Hold::Halted), 10), "HALTED");
        assert_eq!(says(Status::Holding(Hold::BoardFault), 10), "FAULT(board)");
        assert_eq!(says(Status::Holding(Hold::SlowBoard), 10), "CLOSED(slow board)");
        assert_eq!(state(&robot(Status::Rest, 10), true), "FAULT(gave_up)");
        let swaps = BTreeMap::from([(SwapPart::Driver, SwapStep::TookOver { gap: 0.0, map: None })]);
        assert_eq!(state(&RobotReport { swaps, ..robot(Status::Starting, 10) }, false), "CLOSED(swap)");
    }

    #[test]
    fn a_status_says_what_touches_and_what_can_be_done() {
        let now = SystemReport { robots: Vec::new(), ..report_of(Vec::new()) };
        let says = |status, change: fn(&mut RobotReport)| {
            let mut robot = robot(status, 10);
            change(&mut robot);
            outlook(&robot, false, &now)
        };
        let touched = says(Status::Holding(Hold::InContact), |robot| {
            robot.touches = vec![("sph2".into(), "icub right_arm: behind r_elbow".into(), -0.0031)];
        });
        assert_eq!(
            touched,
            "sph2 is 3.1 mm deep in icub right_arm: behind r_elbow; clear it away, or wait for its agent to escape"
        );
        assert!(says(Status::Holding(Hold::Halted), |_| ()).contains("`mobee ctl release icub`"));
        assert!(says(Status::Holding(Hold::RetreatBlocked), |_| ()).contains("`mobee ctl recover icub`"));
        assert!(says(Status::Rest, |robot| robot.has_agent = false).contains("`mobee ctl go`"));
        assert!(says(Status::Rest, |robot| robot.acts = false).contains("`mobee ctl resume icub`"));
        assert!(says(Status::Rest, |robot| robot.age = Duration::from_secs(2)).contains("no fresh readings"));
    }

    fn report_of(robots: Vec<RobotReport>) -> SystemReport {
        SystemReport {
            at: Time::ZERO,
            robots,
            beside: BTreeMap::new(),
            swapped_at: BTreeMap::new(),
            sensors: Vec::new(),
            tree: Vec::new(),
            links: Vec::new(),
            busy: BTreeMap::new(),
            process: Duration::ZERO,
            counts: RunCounts::default(),
        }
    }

    #[test]
    fn a_status_shows_robots_tree_and_links() {
        let child = |name: &str, restarts, alive| Health { name: name.into(), alive, restarts, children: Vec::new() };
        let children = vec![child("model", 0, true), child("icub/driver", 2, false)];
        let counters = |sent| StreamCounters { sent, handled: sent - 3, queued: 1, dropped: 2 };
        let cup = |secs: u64| KeptObject {
            object: "cup".into(),
            place: Some([0.3, -0.1, 1.0]),
            seen: Time((secs - 3) * 1_000_000_000),
            is_stale: true,
        };
        let report = |secs: u64, sent| SystemReport {
            at: Time(secs * 1_000_000_000),
            robots: vec![RobotReport {
                answers: Some(AnswerTime {
                    median: Duration::from_micros(1200),
                    most: Duration::from_millis(3),
                    greatest: Duration::from_millis(40),
                }),
                hold_offsets: vec![("shoulder".into(), 0.031), ("elbow".into(), -0.014)],
                acts: false,
                swaps: BTreeMap::from([(SwapPart::Agent, SwapStep::Settled)]),
                ..robot(Status::Rest, 10)
            }],
            beside: BTreeMap::from([
                (("yarp".into(), SwapPart::Bridge), SwapStep::Settled),
                (("other".into(), SwapPart::Bridge), SwapStep::Settled),
            ]),
            swapped_at: BTreeMap::from([
                (("icub".into(), SwapPart::Agent), Time((secs - 2) * 1_000_000_000)),
                (("other".into(), SwapPart::Bridge), Time(secs.saturating_sub(60) * 1_000_000_000)),
            ]),
            sensors: vec![SensorReport { name: "eyes".into(), objects: vec![cup(secs)] }],
            tree: vec![Health { name: "controller".into(), alive: true, restarts: 0, children: children.clone() }],
            links: vec![("icub/driver>history".into(), counters(sent)), ("tap>recorder".into(), counters(sent))],
            busy: ["model", "recorder"].map(|name| (name.into(), Duration::from_millis(20 * secs))).into(),
            process: Duration::from_millis(90 * secs),
            counts: RunCounts::default(),
        };
        let lines = lines(&report(112, 700), Some(&report(110, 500)));
        let expected = "\
icub  ARMED: rests; its agent is paused and will not move it before `mobee ctl resume icub`; its board answers in 1.2 ms, nine of ten in 3.0 ms, all in 40.0 ms; hold offsets: shoulder +1.8, elbow -0.8 deg; swap of the agent: settled: its probation is over
yarp  swap of the bridge: settled: its probation is over
eyes  cup at 0.300 -0.100 1.000 m, seen 3.0 s ago, STALE
112.0 s: 0 motions, 0 committed, 0 rolled back, 0 faulted, 0 refused, 0 contacts, 0 restarts
overload: 2 entries dropped by the recorder; reduce the load on the machine (`mobee doctor` checks it), or give the controller a longer period_ms or stale_ms

processor: 9.0 % of a core, 4.0 % by these actors and their tasks
controller
  model  2.0 %
  icub/driver  2 restarts  DOWN
taps
  recorder  2.0 %

link                             per s  queue  dropped
icub/driver>history              100.0      1        2
tap>recorder                     100.0      1        2";
        assert_eq!(lines.join("\n"), expected);
    }
}
