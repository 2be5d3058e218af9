//! State of a running system, for a status line or the diagnosis of a robot that does not move.

use super::RunCounts;
use crate::clock::processor_time_of_all;
use crate::load::Loads;
use crate::shell::{KeptObject, Sensor};
use crate::stream::StreamCounters;
use crate::supervision::Health;
use crate::wiring::{RobotContext, SharedContext};
use mobee_contract::{AnswerTime, Status, SwapPart, SwapStep, Time};
use mobee_model::{Contact, Scene};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// A running system at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct SystemReport {
    /// Time on the run's clock.
    pub at: Time,
    /// Reports of the robots.
    pub robots: Vec<RobotReport>,
    /// Last step of each exchange beside the robots, by the name of the owner and the part.
    pub beside: BTreeMap<(String, SwapPart), SwapStep>,
    /// Time of the last step of each exchange, by the name of the owner and the part.
    pub swapped_at: BTreeMap<(String, SwapPart), Time>,
    /// Reports of the sensors.
    pub sensors: Vec<SensorReport>,
    /// Supervision groups with their children.
    pub tree: Vec<Health>,
    /// Bounded links between actors, by name.
    pub links: Vec<(String, StreamCounters)>,
    /// Processor time of each actor and each sink so far, by name; with a real clock only.
    pub busy: BTreeMap<String, Duration>,
    /// Processor time of the whole process so far, including threads of libraries.
    pub process: Duration,
    /// Counters of the run.
    pub counts: RunCounts,
}

/// One robot at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotReport {
    /// Name of the robot.
    pub name: String,
    /// State of its filter.
    pub status: Status,
    /// Age of its newest reading.
    pub age: Duration,
    /// Greatest age of a fresh reading.
    pub fresh: Duration,
    /// Recent response times of its board, if they are measured.
    pub answers: Option<AnswerTime>,
    /// Motors that are commanded beside their targets to rest there: name and offset, rad.
    pub hold_offsets: Vec<(String, f64)>,
    /// True if it has an agent of its own.
    pub has_agent: bool,
    /// True if its own agent may make motions.
    pub acts: bool,
    /// Contacts, and pairs that are closer than the margin, in the newest reading: two labels and the distance,
    /// m, nearest first.
    pub touches: Vec<(String, String, f64)>,
    /// Last step of each part's exchange.
    pub swaps: BTreeMap<SwapPart, SwapStep>,
}

/// One sensor at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorReport {
    /// Name of the sensor.
    pub name: String,
    /// State of the objects that it tracks.
    pub objects: Vec<KeptObject>,
}

impl SensorReport {
    fn of(sensor: &Sensor) -> SensorReport {
        let gate = sensor.locator_slot.iter().find_map(|locator_slot| locator_slot.gate.as_ref());
        SensorReport { name: sensor.name.clone(), objects: gate.map(|gate| gate.lock().objects()).unwrap_or_default() }
    }
}

impl SystemReport {
    /// Creates the report of the system; the caller provides the tree.
    pub(super) fn of(shared: &SharedContext, sensors: &[Arc<Sensor>], tree: Vec<Health>) -> SystemReport {
        let at = shared.clock.now();
        let of_robot =
            |w: &RobotContext| [&w.to_history, &w.to_reflex, &w.to_supervise].map(|s| (s.name(), s.counters()));
        let mut links: Vec<(String, StreamCounters)> = shared.robots.iter().flat_map(|w| of_robot(w)).collect();
        links.push((shared.to_model.name(), shared.to_model.counters()));
        links.extend(sensors.iter().flat_map(|s| &s.channels).flat_map(|channel| channel.counters()));
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

    /// Last step of an exchange, by the name of the robot or of the owner beside the robots.
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
