//! Filter and reflex against a reference: an independent model without tokens, queues or readings, with only the
//! positions of the robot and a wall. It predicts the result of every round: the answer, the end of the motion, its
//! position, and the robot's state then.

use super::*;
use Outcome::{Committed, Faulted, RolledBack};

/// Disturbance of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    No,
    Stop,
    AgentDies,
    SuperviseDies,
    ReflexDies,
    Silence,
    Fault,
    /// An obstacle is placed just ahead.
    Wall,
    /// The agent commits again, or another one does.
    Commit(f64, bool),
}

/// Time of the disturbance: half way there, halfway back (during a retreat), or at rest afterwards.
#[derive(Clone, Copy, Debug, PartialEq)]
enum When {
    Going,
    Back,
    Rest,
}

/// Result of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
struct End {
    outcome: Outcome,
    q: f64,
    status: Status,
}

/// The reference: a robot that rests at `q`, and possibly a wall.
#[derive(Clone, Copy, Debug)]
struct Reference {
    q: f64,
    wall: Option<f64>,
}

impl Reference {
    /// Position at which a motion meets the wall, if it does: shapes of 5 cm touch at 1 cm.
    fn meets(&self, from: f64, to: f64) -> Option<f64> {
        let wall = self.wall?;
        let at = wall - 0.06 * (to - from).signum();
        let between = (at - from) * (to - from) >= 0.0 && (at - from).abs() < (to - from).abs();
        ((wall - from) * (to - from) > 0.0 && between).then_some(at)
    }

    /// Answer to a commit for a robot at rest.
    fn answer(&self, to: f64) -> Result<(), &'static str> {
        if to.abs() > 3.0 { Err("limits") } else { Ok(()) }
    }

    /// A motion without disturbance.
    fn plain(&self, from: f64, to: f64) -> End {
        match self.meets(from, to) {
            Some(_) => End { outcome: RolledBack, q: self.q, status: Status::Rest },
            None => End { outcome: Committed, q: to, status: Status::Rest },
        }
    }

    /// A motion to `to`, disturbed when the robot is at `here`.
    fn end(&self, to: f64, trouble: Trouble, when: When, here: f64) -> End {
        let back = End { outcome: RolledBack, q: self.q, status: Status::Rest };
        let lost = End { outcome: Faulted, q: here, status: Status::Rest };
        let plain = self.plain(self.q, to);
        match (when, trouble) {
            (When::Going, Trouble::AgentDies | Trouble::SuperviseDies | Trouble::ReflexDies | Trouble::Wall) => back,
            (When::Back, Trouble::SuperviseDies | Trouble::ReflexDies) => back,
            (When::Going, Trouble::Commit(other, true)) if other.abs() <= 3.0 => self.plain(here, other),
            (When::Going, Trouble::No | Trouble::Commit(..)) => plain,
            (When::Back, Trouble::No | Trouble::Stop | Trouble::AgentDies | Trouble::Commit(..)) => back,
            (When::Back, Trouble::Wall) => End { status: Status::Holding(Hold::RetreatBlocked), ..lost },
            (When::Going | When::Back, _) => lost,
            (When::Rest, Trouble::Wall) => End { status: Status::Holding(Hold::InContact), ..plain },
            (When::Rest, _) => plain,
        }
    }

    /// Answer to a commit in mid-motion.
    fn answer_then(&self, when: When, to: f64, own: bool) -> Result<(), &'static str> {
        self.answer(to)?;
        match when {
            When::Back => Err("closed"),
            _ if own => Ok(()),
            _ => Err("busy"),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Round {
    wall: Option<f64>,
    to: f64,
    trouble: Trouble,
    when: When,
    /// True if a failed retreat is retried, rather than escaped from.
    recover: bool,
}

fn round() -> impl Strategy<Value = Round> {
    let grid = || (-14_i32..=14).prop_map(|n| f64::from(n) * 0.25);
    let trouble = prop_oneof![
        2 => Just(Trouble::No),
        1 => Just(Trouble::Stop),
        1 => Just(Trouble::AgentDies),
        1 => Just(Trouble::SuperviseDies),
        1 => Just(Trouble::ReflexDies),
        1 => Just(Trouble::Silence),
        1 => Just(Trouble::Fault),
        2 => Just(Trouble::Wall),
        2 => (grid(), any::<bool>()).prop_map(|(q, own)| Trouble::Commit(q, own)),
    ];
    let when = prop_oneof![Just(When::Going), Just(When::Back), Just(When::Rest)];
    let wall = prop::option::of(grid().prop_map(|q| q + 0.125));
    (wall, grid(), trouble, when, any::<bool>()).prop_map(|(wall, to, trouble, when, recover)| Round {
        wall,
        to,
        trouble,
        when,
        recover,
    })
}

fn code(verdict: Verdict) -> Result<(), &'static str> {
    verdict.map(drop).map_err(|refusal| refusal.code())
}

/// Readings until the motor has passed half of the way from `from` to `to`.
fn half_way(cell: &mut Cell, from: f64, to: f64) {
    let half = |q: f64| (q - from) * (to - from).signum() >= 0.5 * (to - from).abs();
    assert!(
        (0..3000).any(|_| half(cell.q) || {
            cell.apply(Op::Samples(1));
            false
        }),
        "never half way to {to}: {}",
        cell.q
    );
}

fn befall(cell: &mut Cell, trouble: Trouble, ahead: f64) -> Option<Result<(), &'static str>> {
    match trouble {
        Trouble::No => {}
        Trouble::Stop => cell.apply(Op::Stop),
        Trouble::AgentDies => cell.apply(Op::AgentDies),
        Trouble::SuperviseDies => cell.apply(Op::SuperviseDies),
        Trouble::ReflexDies => cell.apply(Op::ReflexDies),
        Trouble::Silence => cell.apply(Op::Silence(20)),
        Trouble::Fault => cell.apply(Op::Fault),
        Trouble::Wall => cell.wall = Some(cell.q + 0.055 * ahead),
        Trouble::Commit(to, own) => return Some(code(cell.commit(to, own))),
    }
    None
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn filter_and_reflex_match_the_reference(rounds in prop::collection::vec(round(), 1..8)) {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        for r in rounds {
            let wall = r.wall.filter(|wall| (wall - cell.q).abs() > 0.07);
            let reference = Reference { q: cell.q, wall };
            cell.wall = wall;
            let verdict = code(cell.commit(r.to, true));
            prop_assert_eq!(verdict, reference.answer(r.to), "{:?}", r);
            let end = reference.meets(cell.q, r.to).unwrap_or(r.to);
            if verdict.is_err() || (end - cell.q).abs() < 0.2 {
                cell.heal();
                continue;
            }
            let (from, ahead) = (cell.q, (end - cell.q).signum());
            let when = if end == r.to && r.when == When::Back { When::Going } else { r.when };
            match when {
                When::Going => half_way(&mut cell, from, end),
                When::Back => {
                    half_way(&mut cell, from, from + 1.98 * (end - from));
                    half_way(&mut cell, end, from);
                }
                When::Rest => cell.heal(),
            }
            let here = cell.q;
            let expected = reference.end(r.to, r.trouble, when, here);
            if !(when == When::Rest && matches!(r.trouble, Trouble::Commit(..))) {
                let answer = befall(&mut cell, r.trouble, if when == When::Back { -ahead } else { ahead });
                if let (Some(answer), Trouble::Commit(to, own)) = (answer, r.trouble) {
                    prop_assert_eq!(answer, reference.answer_then(when, to, own), "{:?}", r);
                }
            }
            cell.heal();
            let found = End { outcome: cell.outcome.unwrap(), q: cell.q, status: cell.supervise.status() };
            prop_assert_eq!((found.outcome, found.status), (expected.outcome, expected.status), "{:?}", r);
            let off = if expected.outcome == Faulted { 0.03 } else { 0.002 };
            prop_assert!((found.q - expected.q).abs() < off, "{:?}: {:?} and not {:?}", r, found, expected);
            prop_assert_eq!(cell.gate.is_open(), found.status == Status::Rest);
            prop_assert_eq!(cell.outcomes.len() as u64, cell.commits);
            // free again: by itself, or from a retreat that failed
            cell.wall = None;
            cell.heal();
            if cell.supervise.status() == Status::Holding(Hold::RetreatBlocked) {
                let to = if r.recover { from } else { cell.q - 0.1 * ahead };
                match r.recover {
                    true => cell.apply(Op::Recover),
                    false => prop_assert_eq!(code(cell.commit(to, true)), Ok(())),
                }
                cell.heal();
                prop_assert!((cell.q - to).abs() < 0.002, "{:?}: at {} and not {}", r, cell.q, to);
            }
            prop_assert_eq!(cell.supervise.status(), Status::Rest, "{:?}", r);
        }
    }
}
