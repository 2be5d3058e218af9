//! Faults of the wires to boards behind YARP (F30). They are drawn separately from a seed's other faults, so that known
//! seeds stay the same.

use super::faults::FaultAction;
use super::plan::{Facts, Planned};
use mobee_contract::Time;
use mobee_driver_yarp::{Who, WireFault};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Duration;

/// The faults of a seed's wires; unordered.
pub fn plan(seed: u64, facts: &Facts) -> Vec<Planned> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x77_69_72_65);
    let wired: Vec<(usize, usize)> = facts.wires.iter().copied().enumerate().filter(|(_, n)| *n > 0).collect();
    let mut all = Vec::new();
    if wired.is_empty() {
        return all;
    }
    let between = if facts.mild { 150.0 } else { 4.0 };
    let clusters = (facts.secs * rng.random_range(0.5..1.5) / between).ceil() as u64;
    for _ in 0..clusters {
        let (robot, boards) = wired[rng.random_range(0..wired.len())];
        let board = rng.random_range(0..boards);
        let every = rng.random_range(0..4) == 0;
        let (fault, lasts) = draw(&mut rng);
        let mut at = Time::from_secs(rng.random_range(0.0..(facts.healed().secs() - 1.0).max(0.1)));
        for _ in 0..rng.random_range(1..=3) {
            let most = facts.healed().since(at);
            for board in (0..boards).filter(|b| every || *b == board) {
                let planned = Planned { at, what: FaultAction::Wire { robot, board, fault, lasts: lasts.min(most) } };
                if !all.iter().any(|before| deafen_together(before, &planned)) {
                    all.push(planned);
                }
            }
            at = at + Duration::from_secs_f64(rng.random_range(0.05..4.0));
            if at > facts.healed() {
                break;
            }
        }
    }
    all
}

/// True if two simultaneous faults make one board ignore more stops than a driver can compensate.
fn deafen_together(one: &Planned, other: &Planned) -> bool {
    let deaf = |p: &Planned| match p.what {
        FaultAction::Wire { robot, board, fault: WireFault::Deaf(_), lasts } => Some((robot, board, lasts)),
        _ => None,
    };
    let (Some((robot, board, lasts)), Some((other_robot, other_board, other_lasts))) = (deaf(one), deaf(other)) else {
        return false;
    };
    (robot, board) == (other_robot, other_board) && one.at < other.at + other_lasts && other.at < one.at + lasts
}

fn draw(rng: &mut ChaCha8Rng) -> (WireFault, Duration) {
    let secs = Duration::from_secs_f64;
    let some = secs(rng.random_range(0.1..4.0));
    let fault = match rng.random_range(0..13) {
        0 | 1 => WireFault::Late(secs(rng.random_range(0.02..0.3))),
        2 => WireFault::Lossy(rng.random_range(3..40)),
        3 => WireFault::Cut,
        4 => WireFault::Hole,
        5 => WireFault::Silent,
        6 => WireFault::Behind(secs(rng.random_range(0.02..0.9))),
        7 => WireFault::Shuffled(secs(rng.random_range(0.02..0.3))),
        8 if rng.random() => WireFault::Doubled,
        8 => WireFault::Stamps(rng.random_range(-2.0..2.0)),
        9 => WireFault::Nack(rng.random_range(2..10)),
        // faults that are counted wait for their occasion; a board that ignores more stops than three moves on for
        // longer than a closed filter may allow (I17): see `deafen_together`
        10 => return (WireFault::Deaf(rng.random_range(1..=3)), secs(10.0)),
        11 => return (WireFault::Meddled(rng.random_range(1..4)), secs(10.0)),
        _ => {
            let who = [Who::Hand, Who::Brake, Who::Reader, Who::Connection][rng.random_range(0..4)];
            return (WireFault::Dies(who), secs(0.6));
        }
    };
    (fault, some)
}
