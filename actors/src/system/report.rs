//! How a running system is: what a status line, or a person's "why does it not move?", is answered from.

use super::RunCounts;
use crate::runtime::clock::processor_time_of_all;
use crate::runtime::load::Loads;
use crate::runtime::stream::StreamCounters;
use crate::runtime::supervision::Health;
use crate::shell::{KeptObject, Sensor};
use crate::wiring::{RobotContext, SharedContext};
use mobee_contract::{AnswerTime, Status, SwapPart, SwapStep, Time};
use mobee_model::{Contact, Scene};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// A running system at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct SystemReport {
    /// When.
    pub at: Time,
    /// The robots.
    pub robots: Vec<RobotReport>,
    /// The last step of the exchange of each part beside the robots that was ever exchanged, by the name of what it is a part of.
    pub beside: BTreeMap<(String, SwapPart), SwapStep>,
    /// When the last step of each exchange was taken, by the name of what the part is a part of.
    pub swapped_at: BTreeMap<(String, SwapPart), Time>,
    /// The sensors.
    pub sensors: Vec<SensorReport>,
    /// Who runs, group by group.
    pub tree: Vec<Health>,
    /// The bounded links between actors, by name.
    pub links: Vec<(String, StreamCounters)>,
    /// Processor time that each actor and each sink has taken so far, by name; by a real clock.
    pub busy: BTreeMap<String, Duration>,
    /// Processor time of the whole process so far: libraries have threads of their own.
    pub process: Duration,
    /// The counters of the run.
    pub counts: RunCounts,
}

/// One robot at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotReport {
    /// Its name.
    pub name: String,
    /// The state of its filter.
    pub status: Status,
    /// The age of its newest reading.
    pub age: Duration,
    /// The greatest age of a reading that is still fresh.
    pub fresh: Duration,
    /// How long its board took to answer of late, if that is known.
    pub answers: Option<AnswerTime>,
    /// The motors that are commanded beside their targets, so that they rest there: name and offset, rad.
    pub hold_offsets: Vec<(String, f64)>,
    /// Whether it has an agent of its own.
    pub has_agent: bool,
    /// Whether its own agent may make motions.
    pub acts: bool,
    /// What touches it, or is nearer than its margin, as it was last seen: two labels and the distance, m, nearest first.
    pub touches: Vec<(String, String, f64)>,
    /// The last step of the exchange of each part that was ever exchanged.
    pub swaps: BTreeMap<SwapPart, SwapStep>,
}

/// One sensor at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorReport {
    /// Its name.
    pub name: String,
    /// The objects that it keeps.
    pub objects: Vec<KeptObject>,
}

impl SensorReport {
    fn of(sensor: &Sensor) -> SensorReport {
        let gate = sensor.placing.iter().find_map(|placing| placing.gate.as_ref());
        SensorReport { name: sensor.name.clone(), objects: gate.map(|gate| gate.lock().kept()).unwrap_or_default() }
    }
}

impl SystemReport {
    /// The system as it is, but for its tree.
    pub(super) fn of(shared: &SharedContext, sensors: &[Arc<Sensor>], tree: Vec<Health>) -> SystemReport {
        let at = shared.clock.now();
        let of_robot =
            |w: &RobotContext| [&w.to_history, &w.to_reflex, &w.to_supervise].map(|s| (s.name(), s.counters()));
        let mut links: Vec<(String, StreamCounters)> = shared.robots.iter().flat_map(|w| of_robot(w)).collect();
        links.push((shared.to_model.name(), shared.to_model.counters()));
        links.extend(sensors.iter().flat_map(|s| &s.eyes).flat_map(|eye| eye.counters()));
        links.extend(shared.taps.counters());
        let scene = shared.scene.lock().clone();
        let robots = shared.robots.iter().map(|w| RobotReport::of(w, &scene, at)).collect();
        let counts = shared.counts.lock().clone();
        let beside = shared.swaps_beside.lock().clone();
        let swapped_at = shared.swapped_at.lock().clone();
        let sensors = sensors.iter().map(|s| SensorReport::of(s)).collect();
        let mut busy = shared.loads.as_ref().map(Loads::busy).unwrap_or_default();
        for (sink, time) in shared.taps.busy() {
            *busy.entry(sink).or_default() += time;
        }
        let process = processor_time_of_all();
        SystemReport { at, robots, beside, swapped_at, sensors, tree, links, busy, process, counts }
    }

    /// The last step of an exchange, by the name of the robot, or of what runs beside the robots.
    pub fn swap(&self, name: &str, part: SwapPart) -> Option<&SwapStep> {
        match part {
            SwapPart::Agent | SwapPart::Controller | SwapPart::Driver => {
                self.robots.iter().find(|r| r.name == name)?.swaps.get(&part)
            }
            SwapPart::Bridge | SwapPart::Detector | SwapPart::Locator => self.beside.get(&(name.to_owned(), part)),
        }
    }
}

impl RobotReport {
    fn of(context: &RobotContext, scene: &Scene, now: Time) -> RobotReport {
        let latest = context.latest.lock().clone();
        let pair = |c: &Contact| (scene.label(c.pair.0), scene.label(c.pair.1), c.distance);
        let mut touches: Vec<_> = latest.contacts.iter().map(pair).collect();
        touches.sort_by(|a, b| a.2.total_cmp(&b.2));
        let rules = context.rules();
        let offsets = context.hold_offsets.lock().clone();
        let hold_offset = |(m, offset): (usize, f64)| Some((rules.axes.get(m)?.name.clone(), offset));
        RobotReport {
            name: context.name.clone(),
            status: latest.status,
            age: now.since(latest.at),
            fresh: rules.fresh,
            answers: *context.answers.lock(),
            hold_offsets: offsets.into_iter().filter_map(hold_offset).collect(),
            has_agent: context.slot.lock().maker.is_some(),
            acts: context.agent_acts.load(Ordering::SeqCst),
            touches,
            swaps: context.swaps.lock().clone(),
        }
    }
}
