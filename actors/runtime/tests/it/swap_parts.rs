//! Swaps of controller and driver while the robot moves: the filter is closed in between (F22), nothing moves because of one
//! (I10), no command is lost (I6), and what does not fit or breaks is refused or reverted.

use crate::common::{Ran, Trial, arm, ball};
use mobee_contract::*;
use mobee_controller::ControllerSettings;
use mobee_model::{Edit, ObjectClass};
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{Control, NewPart, PartOffer, Reason};
use mobee_sim::{Fault, SimHardware, SimSettings};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// What is wrong with a driver.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    Nothing,
    // before it takes over
    IsLost,
    PanicsWhenConnected,
    HasOtherMotors,
    HasOtherLimits,
    IsElsewhere,
    SaysNothing,
    // later
    PanicsLater,
    FallsSilent,
    BreaksLater,
    IsLostLater,
}
use Wrong::*;

const REFUSED: [Wrong; 6] = [IsLost, PanicsWhenConnected, HasOtherMotors, HasOtherLimits, IsElsewhere, SaysNothing];
const REVERTED: [Wrong; 4] = [PanicsLater, FallsSilent, BreaksLater, IsLostLater];

/// Another way to the same board, sabotaged or not.
struct Other {
    board: SimHardware,
    wrong: Wrong,
    connections: AtomicU32,
    /// Number of times that the board was released to another driver.
    releases: Arc<AtomicU32>,
}

impl Hardware for Other {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        let later = self.connections.fetch_add(1, Ordering::SeqCst) > 0;
        assert!(self.wrong != PanicsWhenConnected, "planted");
        if self.wrong == IsLost || (self.wrong == IsLostLater && later) {
            return Err(DriverFault::Lost);
        }
        let driver = self.board.connect()?;
        let mut board = driver.board().clone();
        match self.wrong {
            HasOtherMotors => board.axes[1].name = "knee".into(),
            HasOtherLimits => board.axes[1].max += 0.1,
            _ => {}
        }
        Ok(Box::new(OtherDriver { driver, board, wrong: self.wrong, later }))
    }

    fn let_go(&self) {
        self.releases.fetch_add(1, Ordering::SeqCst);
    }
}

struct OtherDriver {
    driver: Box<dyn Driver>,
    board: Board,
    wrong: Wrong,
    later: bool,
}

impl Driver for OtherDriver {
    fn board(&self) -> &Board {
        &self.board
    }
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        self.driver.command(now, command)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        assert!(!(self.wrong == PanicsLater && self.later), "planted");
        let sample = self.driver.sample(now)?;
        match self.wrong {
            SaysNothing => Ok(None),
            FallsSilent if self.later => Ok(None),
            BreaksLater if self.later => Err(DriverFault::Hardware("planted".into())),
            IsElsewhere => Ok(sample.map(|s| Sample { q: s.q.iter().map(|q| q + 0.01).collect(), ..s })),
            _ => Ok(sample),
        }
    }
    fn next_sample(&self, now: Time) -> Time {
        self.driver.next_sample(now)
    }
    fn lease(&mut self, now: Time, until: Time) {
        self.driver.lease(now, until);
    }
    fn modes(&self) -> Vec<ControlMode> {
        self.driver.modes()
    }
}

fn offer(part: NewPart, what: String, probation: f64) -> Control {
    let terms = SwapPolicy { probation: Duration::from_secs_f64(probation), ..SwapPolicy::default() };
    let (reply, _) = tokio::sync::oneshot::channel();
    Control::SwapPart { robot: "arm".into(), offer: PartOffer { part, what, terms }, reply }
}

fn driver(board: &SimHardware, wrong: Wrong, probation: f64) -> Control {
    counted(board, wrong, probation, &Arc::default())
}

/// As [`driver`], and counts the releases of its board.
fn counted(board: &SimHardware, wrong: Wrong, probation: f64, releases: &Arc<AtomicU32>) -> Control {
    let (board, releases) = (board.clone(), releases.clone());
    let other = Other { board, wrong, connections: AtomicU32::new(0), releases };
    offer(NewPart::Driver(Arc::new(other)), format!("{wrong:?}"), probation)
}

fn controller(period_s: f64, margin_m: f64, history: usize, probation: f64) -> Control {
    let settings =
        ControllerSettings { period_s, margin_m, history, reserve_m: Some(0.0), ..ControllerSettings::default() };
    offer(NewPart::Controller(Box::new(settings)), "Nothing".into(), probation)
}

/// The steps of all swaps, with the filter closed and every outcome given whenever one took over.
fn steps(ran: &Ran) -> Vec<(SwapPart, SwapStep)> {
    let (mut steps, mut open, mut commits) = (Vec::new(), false, 0);
    for (at, event) in ran.events() {
        match &*event {
            Event::Enabled { .. } => open = true,
            Event::Disabled { .. } => open = false,
            Event::Commit { .. } => commits += 1,
            Event::Outcome { .. } => commits -= 1,
            Event::Swap { part, step, .. } => {
                if matches!(step, SwapStep::TookOver { .. }) {
                    assert!(!open && commits == 0, "at {at}: open {open}, {commits} motions\n{}", ran.lines());
                }
                steps.push((*part, step.clone()));
            }
            _ => {}
        }
    }
    steps
}

fn sound(ran: &Ran) {
    assert_eq!(ran.violations(), [], "{}", ran.lines());
    assert_eq!(ran.end.counts.commits, ran.end.counts.outcomes());
    assert_ne!(ran.end.reason, Reason::GaveUp, "{}", ran.lines());
}

/// The rules that the journal names last.
fn rules(ran: &Ran) -> (f64, f64) {
    let of = |e: &Event| if let Event::Robot { period, margin, .. } = e { Some((*period, *margin)) } else { None };
    ran.events().iter().rev().find_map(|(_, e)| of(e)).unwrap()
}

/// Panics are planted here: only those of the test itself are worth reading.
fn be_quiet() {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let text = info.payload().downcast_ref::<&str>().copied().unwrap_or_default();
        if text != "planted" {
            hook(info);
        }
    }));
}

fn trial() -> Trial {
    let poses = [[30.0, 20.0, 10.0], [0.0, 0.0, 0.0], [-40.0, 30.0, 0.0]];
    Trial { poses: poses.repeat(8), limit: Duration::from_secs(40), ..Trial::default() }
}

#[test]
fn a_new_controller_takes_over_between_two_motions() {
    let swaps = vec![(Duration::from_secs(2), controller(0.03, 0.02, 500, 2.0))];
    let ran = Trial { controls: swaps, ..trial() }.run();
    sound(&ran);
    let steps: Vec<SwapStep> = steps(&ran).into_iter().map(|(_, step)| step).collect();
    let [SwapStep::Offered { .. }, SwapStep::TookOver { gap, .. }, SwapStep::Settled] = steps.as_slice() else {
        panic!("{steps:?}\n{}", ran.lines())
    };
    assert!(*gap < 0.02, "{gap}");
    assert_eq!(rules(&ran), (0.03, 0.02));
    assert!(ran.end.counts.committed > 10 && ran.end.counts.restarts == 0, "{:?}", ran.end.counts);
}

#[test]
fn a_margin_that_touches_already_is_refused() {
    let near = ball("near", [0.55, 0.0, 0.40], ObjectClass::Obstacle);
    let swaps = vec![(Duration::from_secs(2), controller(0.02, 0.5, 3000, 2.0))];
    let ran = Trial { controls: swaps, objects: vec![near], ..trial() }.run();
    sound(&ran);
    let steps = steps(&ran);
    assert!(matches!(&steps[1].1, SwapStep::Refused { why } if why.contains("new margin")), "{steps:?}");
    assert_eq!(rules(&ran), (0.02, 0.01));
    assert!(ran.end.counts.committed > 5);
}

#[test]
fn a_driver_is_exchanged_by_one_that_fits() {
    be_quiet();
    for wrong in [Nothing].into_iter().chain(REFUSED).chain(REVERTED) {
        let releases = Arc::default();
        let swap = |board: &SimHardware| vec![(Duration::from_secs(2), counted(board, wrong, 3.0, &releases))];
        let ran = trial().run_driven(swap);
        sound(&ran);
        // A driver that is not in use must not write any more, not even a stop as it is dropped.
        let released = releases.load(Ordering::SeqCst);
        assert_eq!(released, u32::from(wrong != Nothing), "{wrong:?}\n{}", ran.lines());
        let steps: Vec<SwapStep> = steps(&ran).into_iter().map(|(_, step)| step).collect();
        let fits = match steps.as_slice() {
            [_, SwapStep::TookOver { .. }, SwapStep::Settled] => wrong == Nothing,
            [_, SwapStep::Refused { .. }] => REFUSED.contains(&wrong),
            [_, SwapStep::TookOver { .. }, SwapStep::Reverted { .. }] => REVERTED.contains(&wrong),
            _ => false,
        };
        assert!(fits, "{wrong:?}: {steps:?}\n{}", ran.lines());
        // the robot goes on afterwards
        let last = ran.events().iter().rposition(|(_, e)| matches!(&**e, Event::Swap { .. })).unwrap();
        let after = ran.events()[last..].iter().filter(|(_, e)| matches!(&**e, Event::Commit { .. })).count();
        assert!(after > 3, "{wrong:?}: {after} commits afterwards\n{}", ran.lines());
    }
}

/// Something touches the robot while a part of it is exchanged and breaks: whoever was started with the old parts is started once more,
/// and finds the contact as one that was reported before (I27).
#[test]
fn a_part_that_breaks_in_a_contact_is_reverted_as_any() {
    be_quiet();
    let touches = || Control::Edit(Edit::Add(ball("ball", [0.3, 0.0, 0.2], ObjectClass::Obstacle)));
    let ran = trial().run_driven(|board| {
        vec![(Duration::from_secs(2), touches()), (Duration::from_secs(4), driver(board, PanicsLater, 3.0))]
    });
    assert_eq!(ran.violations(), [], "{}", ran.lines());
    let steps = steps(&ran);
    assert!(matches!(&steps[2].1, SwapStep::Reverted { .. }), "{steps:?}");
    let began = ran.events().iter().filter(|(_, e)| matches!(&**e, Event::ContactBegan { .. })).count();
    assert!(began > 2, "nothing touches it\n{}", ran.lines());
}

#[test]
fn another_robot_is_refused() {
    let swaps = |_: &SimHardware| {
        let settings = SimSettings::ideal();
        let other = SimHardware::new(&settings, &Context { robot: arm(), seed: 7 }).unwrap();
        vec![(Duration::from_secs(2), driver(&other, Nothing, 1.0))]
    };
    let ran = trial().run_driven(swaps);
    sound(&ran);
    let steps = steps(&ran);
    assert!(matches!(&steps[1].1, SwapStep::Refused { why } if why.contains("another robot")), "{steps:?}");
}

#[test]
fn parts_are_exchanged_at_random_instants_under_faults() {
    be_quiet();
    let wanted = std::env::var("SWAPS").ok().and_then(|n| n.parse().ok()).unwrap_or(200);
    let (mut seed, mut tally, mut gaps) = (0, [0_u64; 3], Vec::new());
    while tally.iter().sum::<u64>() < wanted {
        seed += 1;
        let ran = at_random(seed);
        assert_eq!(ran.violations(), [], "seed {seed}\n{}", ran.lines());
        assert_eq!(ran.end.counts.commits, ran.end.counts.outcomes(), "seed {seed}");
        assert_ne!(ran.end.reason, Reason::GaveUp, "seed {seed}");
        let mut offered = String::new();
        for (_, step) in steps(&ran) {
            match step {
                SwapStep::Offered { what, .. } => {
                    assert!(offered.is_empty(), "seed {seed}: two at once");
                    offered = what;
                }
                SwapStep::TookOver { gap, .. } => gaps.push(gap),
                SwapStep::Settled => {
                    assert_eq!(std::mem::take(&mut offered), "Nothing", "seed {seed}: it was not found out");
                    tally[0] += 1;
                }
                SwapStep::Reverted { .. } => {
                    offered.clear();
                    tally[1] += 1;
                }
                SwapStep::Refused { .. } => {
                    offered.clear();
                    tally[2] += 1;
                }
            }
        }
    }
    gaps.sort_by(f64::total_cmp);
    let gap = |share: f64| gaps[((gaps.len() - 1) as f64 * share) as usize];
    let [settled, reverted, refused] = tally;
    eprintln!(
        "{seed} runs: {settled} settled, {reverted} reverted, {refused} refused; gap p50 {} s, p99 {} s",
        gap(0.5),
        gap(0.99)
    );
    assert!(settled > wanted / 10 && reverted > wanted / 20 && refused > wanted / 20, "{tally:?}");
}

fn at_random(seed: u64) -> Ran {
    const ACTORS: [&str; 6] = ["arm/driver", "arm/history", "arm/supervise", "arm/reflex", "arm/agent", "model"];
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let poses: Vec<[f64; 3]> = (0..200)
        .map(|_| [rng.random_range(-60.0..60.0), rng.random_range(-60.0..60.0), rng.random_range(-40.0..40.0)])
        .collect();
    let trial = Trial {
        poses,
        speed: 1.0,
        seed,
        limit: Duration::from_secs(100),
        objects: vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)],
        ..Trial::default()
    };
    trial.run_driven(|board| {
        let lost = Time(rng.random_range(1..60_000_000_000));
        board.faults().plan(Fault::Lost, lost, lost + Duration::from_millis(rng.random_range(50..3000)));
        let mut controls = Vec::new();
        let mut at = Duration::from_millis(100);
        while at < Duration::from_secs(95) {
            at += Duration::from_millis(rng.random_range(200..2000));
            let probation = [0.1, 0.5, 2.0][rng.random_range(0..3)];
            let control = match rng.random_range(0..100) {
                0..=3 => Control::Kill(ACTORS[rng.random_range(0..ACTORS.len())].into()),
                4..=6 => {
                    let at = [rng.random_range(-0.6..0.6), rng.random_range(-0.6..0.6), rng.random_range(0.1..0.3)];
                    Control::Edit(Edit::Add(ball(&format!("ball{}", controls.len()), at, ObjectClass::Obstacle)))
                }
                7..=9 => Control::Edit(Edit::Clear),
                10 => Control::Recover("arm".into()),
                11..=50 => {
                    let (period, margin) = (rng.random_range(0.01..0.04), rng.random_range(0.005..0.03));
                    controller(period, margin, rng.random_range(200..3000), probation)
                }
                51..=75 => driver(board, Nothing, probation),
                76..=88 => driver(board, REFUSED[rng.random_range(0..REFUSED.len())], probation),
                _ => driver(board, REVERTED[rng.random_range(0..REVERTED.len())], probation),
            };
            controls.push((at, control));
        }
        controls
    })
}
