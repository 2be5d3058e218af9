//! All interleavings of the steps of filter and reflex, eight steps deep from rest and six steps from eight other
//! moments: I1, I2, I4, I9, I10 and I17 are checked after every step (by [`Cell`] itself and by [`hold`]), and from a
//! sample of all states everything ends well (I15).
//!
//! Messages wait in queues until they are delivered, so that all possible overtaking is covered. A state that was
//! visited before with as many steps left is not explored again: its future is known.

use super::*;
use std::collections::{BTreeMap, BTreeSet};

/// Depth from rest; from other moments two less.
const DEPTH: u8 = 8;
/// Every state with a hash divisible by this is recovered.
const SAMPLE: u64 = 5;

/// Step of an interleaving.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Command,
    /// A reading passes the whole chain, behind the waiting messages.
    Sample,
    /// A reading is taken and waits.
    Late,
    /// An obstacle comes into the way of the motion, or is removed.
    Contact,
    Stop,
    AgentDies,
    SuperviseDies,
    ReflexDies,
    /// A person halts the robot, or releases it.
    Halt,
    /// The oldest message is delivered: to the driver, the reflex, supervise.
    Ack(u8),
}

const STEPS: [Step; 11] = [
    Step::Command,
    Step::Sample,
    Step::Late,
    Step::Contact,
    Step::Stop,
    Step::AgentDies,
    Step::SuperviseDies,
    Step::ReflexDies,
    Step::Ack(0),
    Step::Ack(1),
    Step::Ack(2),
];

fn step(cell: &mut Cell, step: Step) {
    match step {
        Step::Command => {
            let target = if cell.goal == 0.06 { 0.0 } else { 0.06 };
            let _ = cell.commit(target, true);
        }
        Step::Late => {
            cell.tick();
            cell.sample();
        }
        Step::Sample => {
            cell.tick();
            cell.sample();
            cell.settle_chain();
        }
        Step::Contact => {
            let ahead = if cell.goal < cell.q { -0.058 } else { 0.058 };
            cell.wall = if cell.wall.is_none() { Some(cell.q + ahead) } else { None };
        }
        Step::Stop => cell.apply(Op::Stop),
        Step::AgentDies => cell.apply(Op::AgentDies),
        Step::SuperviseDies => cell.apply(Op::SuperviseDies),
        Step::ReflexDies => cell.apply(Op::ReflexDies),
        Step::Halt => cell.apply(if cell.book.halted { Op::Release } else { Op::Halt }),
        Step::Ack(link) => cell.deliver(link),
    }
}

/// Properties that hold in every state.
fn hold(cell: &Cell) {
    let (status, open) = (cell.book.status, cell.book.open.is_some());
    assert_eq!(open, cell.commits > cell.outcomes.len() as u64, "I2: the ledger and the told outcomes differ");
    if matches!(status, Status::Stopping | Status::Retreating | Status::Settling | Status::Starting) {
        assert!(!cell.gate.is_open(), "I1: open while {status:?}");
    }
    assert!(!(cell.book.halted && cell.gate.is_open()), "halted, and open");
}

/// Nine typical moments.
fn moments() -> Vec<Cell> {
    let samples = |cell: &mut Cell, n: u8| cell.apply(Op::Samples(n));
    let until = |cell: &mut Cell, status: Status| {
        (0..100).find(|_| {
            let there = cell.supervise.status() == status;
            if !there {
                cell.apply(Op::Samples(1));
            }
            there
        });
        assert_eq!(cell.supervise.status(), status);
    };
    let starting = Cell::coarse();
    let mut rest = starting.fork();
    samples(&mut rest, 3);
    let mut moving = rest.fork();
    step(&mut moving, Step::Command);
    moving.flush();
    samples(&mut moving, 1);
    let mut stopping = moving.fork();
    step(&mut stopping, Step::Contact);
    until(&mut stopping, Status::Stopping);
    let mut retreating = stopping.fork();
    until(&mut retreating, Status::Retreating);
    let mut settling = stopping.fork();
    until(&mut settling, Status::Settling);
    let mut blocked = retreating.fork();
    blocked.apply(Op::Samples(1));
    blocked.wall = Some(blocked.q - 0.052);
    until(&mut blocked, Status::Holding(Hold::RetreatBlocked));
    let mut touched = rest.fork();
    step(&mut touched, Step::Contact);
    until(&mut touched, Status::Holding(Hold::InContact));
    samples(&mut touched, 3);
    let mut escaping = touched.fork();
    let _ = escaping.commit(-0.06, true);
    until(&mut escaping, Status::Escaping);
    vec![starting, rest, moving, stopping, retreating, settling, blocked, touched, escaping]
}

#[derive(Default)]
struct Search {
    /// Possible steps.
    steps: Vec<Step>,
    /// Visited states, with the number of steps left there.
    seen: BTreeMap<u64, u8>,
    from: String,
    path: Vec<Step>,
    taken: u64,
    healed: u64,
    met: BTreeSet<String>,
}

impl Search {
    fn explore(&mut self, from: &Cell, left: u8) {
        for s in self.steps.clone() {
            if matches!(s, Step::Ack(link) if !from.waits(link)) {
                continue;
            }
            let mut cell = from.fork();
            self.path.push(s);
            self.taken += 1;
            let state = self.check_step(|| {
                step(&mut cell, s);
                hold(&cell);
                cell.state()
            });
            if self.seen.get(&state).is_none_or(|known| *known < left - 1) {
                if self.seen.insert(state, left - 1).is_none() {
                    self.met.insert(format!("{:?}", cell.supervise.status()));
                    if state.is_multiple_of(SAMPLE) {
                        self.healed += 1;
                        self.check_step(|| heal(cell.fork()));
                    }
                }
                if left > 1 {
                    self.explore(&cell, left - 1);
                }
            }
            self.path.pop();
        }
    }

    /// Reports the steps that broke a promise, if they do.
    fn check_step<T>(&self, act: impl FnOnce() -> T) -> T {
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(act));
        done.unwrap_or_else(|_| panic!("from {}, after {:?}", self.from, self.path))
    }
}

/// All faults are repaired: it ends well.
fn heal(mut cell: Cell) {
    if cell.book.halted {
        cell.heal();
        assert!(!cell.gate.is_open() && cell.commit(cell.q, true).is_err(), "halted until it is released");
        cell.apply(Op::Release);
    }
    cell.wall = None;
    cell.heal();
    if let Status::Holding(_) = cell.supervise.status() {
        let _ = cell.commit(cell.q, true);
        cell.heal();
    }
    assert_eq!(cell.supervise.status(), Status::Rest, "I15");
    assert!(cell.gate.is_open(), "I15");
    assert_eq!(cell.outcomes.len() as u64, cell.commits, "I2");
}

#[test]
fn no_eight_steps_break_a_promise() {
    let mut search = Search { steps: STEPS.to_vec(), ..Search::default() };
    for moment in moments() {
        search.from = format!("{:?}", moment.supervise.status());
        search.path.clear();
        let depth = if moment.supervise.status() == Status::Rest { DEPTH } else { DEPTH - 2 };
        search.explore(&moment, depth);
    }
    let Search { seen, taken, healed, met, .. } = search;
    eprintln!("{} states, {taken} steps, {healed} healed, {met:?}", seen.len());
    assert!(seen.len() > 300_000 && healed > 1000 && met.len() >= 10, "{} states, {met:?}", seen.len());
}

/// The same with halts and releases among the steps, five steps deep from every moment.
#[test]
fn no_five_steps_with_halts_break_a_promise() {
    let steps = STEPS.into_iter().chain([Step::Halt]).collect();
    let mut search = Search { steps, ..Search::default() };
    for moment in moments() {
        search.from = format!("{:?}", moment.supervise.status());
        search.explore(&moment, 5);
    }
    let Search { seen, healed, met, .. } = search;
    assert!(seen.len() > 10_000 && healed > 100 && met.contains("Holding(Halted)"), "{} states, {met:?}", seen.len());
}

/// Supervise has not been notified yet that the reflex closed, and requests a retreat as well: the retreat in
/// progress ends, and another one begins.
#[test]
fn a_retreat_that_supervise_overtakes_starts_again() {
    let mut cell = moments().swap_remove(1);
    let contact_and_its_retreat =
        [Step::Command, Step::Contact, Step::Late, Step::Contact, Step::Ack(1), Step::Late, Step::Ack(1)];
    for s in contact_and_its_retreat.into_iter().chain([Step::AgentDies]) {
        step(&mut cell, s);
        hold(&cell);
    }
    heal(cell);
}
