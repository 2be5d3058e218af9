//! Settings to restore on a board: modes and references of its joints as found before the first change.
//!
//! ```text
//! as found ──a motion sets references, or switches modes──> ours ──the joint rests and nothing drives it──> as found
//! ```
//! Other programs rely on a board's reference speeds and modes, and some boards hold a joint at rest with
//! them: a reference speed near zero that is left behind lets the torso of iCub_SIM sag, and a joint left in
//! setpoint mode makes another program's move fail.
//!
//! Modes in which a joint would not hold its position (idle, torque, duty cycle) are not restored, because
//! the joint would drop.

use mobee_contract::AsFound;
use mobee_yarp::Vocab;
use mobee_yarp::board::{Joints, Set, mode};

/// Settings of one joint as found; `None` if the board does not report them or has not been queried yet.
/// Degrees or millimeters, and seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Finding {
    pub mode: Option<Vocab>,
    pub interaction: Option<Vocab>,
    pub speed: Option<f64>,
    pub acceleration: Option<f64>,
}

impl Finding {
    /// Converts to the contract's type, for this motor.
    pub fn to_contract(self, motor: usize) -> AsFound {
        let radians = |v: Option<f64>| v.map(f64::to_radians);
        AsFound {
            motor,
            mode: self.mode.map(super::cell::from_word),
            compliant: self.interaction.map(|word| word == mode::COMPLIANT),
            speed: radians(self.speed),
            acceleration: radians(self.acceleration),
        }
    }

    /// Converts from the contract's type, as reported to an earlier process.
    pub fn of(found: &AsFound) -> Finding {
        // exact to the digit: the value restored is the one that was read, without rounding by radians
        let digits = |v: f64| (v.to_degrees() * 1e9).round() / 1e9;
        let degrees = |v: Option<f64>| v.filter(|v| v.is_finite() && *v >= 0.0).map(digits);
        Finding {
            mode: found.mode.map(super::cell::word),
            interaction: found.compliant.map(|soft| if soft { mode::COMPLIANT } else { mode::STIFF }),
            speed: degrees(found.speed),
            acceleration: degrees(found.acceleration),
        }
    }
}

/// Kind of setting that may have to be restored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restored {
    /// Its reference speed.
    Speed,
    /// Its reference acceleration.
    Acceleration,
    /// Its interaction mode.
    Interaction,
    /// Its control mode. It comes last, because in setpoint mode a joint may belong to a stream that
    /// continues.
    Mode,
}

const KINDS: [Restored; 4] = [Restored::Speed, Restored::Acceleration, Restored::Interaction, Restored::Mode];

/// Command that restores settings of some joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Due {
    pub kind: Restored,
    pub joints: Vec<usize>,
    pub set: Set,
}

/// Number of refusals in a row after which a command is dropped, and the time until it is retried, s: a board
/// may refuse only temporarily.
const REFUSALS: (u32, f64) = (3, 1.0);

/// Settings to restore on one board.
#[derive(Clone, Debug)]
pub struct Owed {
    joints: Vec<Finding>,
    known: bool,
    ours: Vec<[bool; 4]>,
    /// Number of times in a row that the board has refused to restore a setting.
    refusals: u32,
    /// Refused settings, with the time at which to retry them, s.
    refused: Vec<(f64, Restored, Vec<usize>)>,
    /// Kinds whose refusal has been reported.
    reported: Vec<Restored>,
}

impl Owed {
    /// Creates the list for a board with `axes` joints, of which nothing is known.
    pub fn new(axes: usize) -> Owed {
        Owed {
            joints: vec![Finding::default(); axes],
            known: false,
            ours: vec![[false; 4]; axes],
            refusals: 0,
            refused: Vec::new(),
            reported: Vec::new(),
        }
    }

    /// True once the settings as found are known.
    pub fn is_known(&self) -> bool {
        self.known
    }

    /// Stores the settings as found; later calls have no effect.
    pub fn find(&mut self, joints: Vec<Finding>) {
        if !self.known && joints.len() == self.joints.len() {
            (self.joints, self.known) = (joints, true);
        }
    }

    /// Takes over the settings that an earlier process found. It may have died with any of them changed, so
    /// all are to be restored.
    pub fn inherit(&mut self, joints: Vec<Finding>) {
        self.find(joints);
        self.ours.iter_mut().for_each(|ours| *ours = [true; 4]);
    }

    /// Settings of the joints as found.
    pub fn findings(&self) -> &[Finding] {
        if self.known { &self.joints } else { &[] }
    }

    /// Marks a setting of these joints as about to be changed.
    pub fn changes(&mut self, kind: Restored, joints: &[usize]) {
        joints.iter().for_each(|j| self.mark(*j, kind, true));
    }

    /// Records that the board refused a command. After too many refusals the command is postponed in favor of
    /// others. Returns true if that is to be reported, once per kind.
    pub fn refused(&mut self, due: &Due, now: f64) -> bool {
        self.refusals += 1;
        if self.refusals < REFUSALS.0 {
            return false;
        }
        self.paid(due);
        self.refused.push((now + REFUSALS.1, due.kind, due.joints.clone()));
        let is_news = !self.reported.contains(&due.kind);
        self.reported.extend(is_news.then_some(due.kind));
        is_news
    }

    /// Retries settings that were refused a while ago.
    pub fn offer_again(&mut self, now: f64) {
        let again: Vec<_> = self.refused.extract_if(.., |(at, ..)| *at <= now).collect();
        for (_, kind, joints) in again {
            self.changes(kind, &joints);
        }
    }

    /// Marks a command as executed.
    pub fn paid(&mut self, due: &Due) {
        self.refusals = 0;
        due.joints.iter().for_each(|j| self.mark(*j, due.kind, false));
    }

    fn mark(&mut self, joint: usize, kind: Restored, is_ours: bool) {
        if let Some(slot) = self.ours.get_mut(joint).and_then(|all| all.get_mut(kind as usize)) {
            *slot = is_ours;
        }
    }

    /// Takes note of the modes that the board reports. A joint that has been released since, by a program or
    /// by a fault, is left alone.
    pub fn see(&mut self, modes: &[Vocab]) {
        for (j, _) in modes.iter().enumerate().filter(|(_, word)| !holds_position(**word)) {
            self.mark(j, Restored::Mode, false);
        }
    }

    /// Mode that a joint was found in.
    pub fn word(&self, kind: Restored, joint: usize) -> Option<Vocab> {
        let found = self.joints.get(joint)?;
        if kind == Restored::Mode { found.mode } else { found.interaction }
    }

    /// True if anything is left to restore.
    pub fn is_any(&self) -> bool {
        (0..self.joints.len()).any(|j| KINDS.iter().any(|kind| self.owes(j, *kind)))
    }

    fn owes(&self, joint: usize, kind: Restored) -> bool {
        let ours = self.ours.get(joint).is_some_and(|ours| ours.get(kind as usize) == Some(&true));
        let known = self.joints.get(joint).is_some_and(|found| match kind {
            Restored::Speed => found.speed.is_some(),
            Restored::Acceleration => found.acceleration.is_some(),
            Restored::Mode => found.mode.is_some_and(holds_position),
            Restored::Interaction => found.interaction.is_some(),
        });
        ours && known
    }

    /// Next command for joints that rest; modes only for joints that nothing drives.
    pub fn due(&self, rests: impl Fn(usize) -> bool, is_free: impl Fn(usize) -> bool) -> Option<Due> {
        let modes = |kind| matches!(kind, Restored::Mode | Restored::Interaction);
        KINDS.iter().find_map(|kind| {
            let is_due = |j: &usize| self.owes(*j, *kind) && rests(*j) && (!modes(*kind) || is_free(*j));
            let joints: Vec<usize> = (0..self.joints.len()).filter(is_due).collect();
            let found = || joints.iter().filter_map(|j| self.joints.get(*j));
            let group = || Joints::Group(joints.clone());
            let set = match kind {
                Restored::Speed => Set::Speed(group(), found().filter_map(|f| f.speed).collect()),
                Restored::Acceleration => Set::Acceleration(group(), found().filter_map(|f| f.acceleration).collect()),
                Restored::Mode => Set::Mode(group(), found().filter_map(|f| f.mode).collect()),
                Restored::Interaction => Set::Interaction(group(), found().filter_map(|f| f.interaction).collect()),
            };
            (!joints.is_empty()).then_some(Due { kind: *kind, joints, set })
        })
    }
}

/// True if a joint at rest holds its position in this mode.
fn holds_position(word: Vocab) -> bool {
    [mode::POSITION, mode::DIRECT, mode::VELOCITY, mode::MIXED].contains(&word)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(mode: Vocab) -> Finding {
        Finding { mode: Some(mode), interaction: Some(mode::COMPLIANT), speed: Some(10.0), acceleration: None }
    }

    #[test]
    fn changed_settings_are_restored_once_and_in_order() {
        let mut owed = Owed::new(3);
        owed.changes(Restored::Speed, &[0]);
        assert!(!owed.is_any(), "nobody knows how they were found");
        owed.find(vec![found(mode::POSITION), found(mode::DIRECT), found(mode::IDLE)]);
        owed.find(vec![Finding::default(); 3]);
        assert_eq!(owed.findings()[0], found(mode::POSITION), "as they were found first");
        owed.changes(Restored::Acceleration, &[0, 1, 2]);
        owed.changes(Restored::Interaction, &[1]);
        owed.changes(Restored::Mode, &[1, 2, 7]);
        let all = |_: usize| true;
        let none = |_: usize| false;
        let group = |joints: &[usize]| Joints::Group(joints.to_vec());
        assert_eq!(owed.due(none, all), None, "while they move");
        let first = owed.due(all, none).unwrap();
        assert_eq!(first.set, Set::Speed(group(&[0]), vec![10.0]));
        owed.paid(&first);
        assert_eq!(owed.due(all, none), None, "somebody drives them");
        // an acceleration that the board does not report is not restored, and neither is a mode that holds no
        // position
        let second = owed.due(all, all).unwrap();
        assert_eq!(second.set, Set::Interaction(group(&[1]), vec![mode::COMPLIANT]));
        owed.paid(&second);
        let third = owed.due(all, all).unwrap();
        assert_eq!(third.set, Set::Mode(group(&[1]), vec![mode::DIRECT]));
        assert!(owed.is_any());
        owed.paid(&third);
        assert!(!owed.is_any());
        // a setting that the board refuses is sent three times, and again after a pause, but reported once
        owed.changes(Restored::Speed, &[0]);
        let refused = owed.due(all, none).unwrap();
        assert_eq!([0; 3].map(|_| owed.refused(&refused, 5.0)), [false, false, true]);
        owed.offer_again(5.5);
        assert!(!owed.is_any());
        owed.offer_again(6.0);
        assert_eq!(owed.due(all, none).as_ref(), Some(&refused));
        assert_eq!([0; 3].map(|_| owed.refused(&refused, 6.0)), [false; 3]);
        owed.offer_again(7.0);
        owed.paid(&refused);
        owed.offer_again(9.0);
        assert!(!owed.is_any(), "a board that took it is not asked again");
        // a joint that was released since is not switched back
        owed.changes(Restored::Mode, &[0, 1]);
        owed.see(&[mode::IDLE, mode::POSITION, mode::POSITION]);
        assert_eq!(owed.due(all, all).map(|due| due.joints), Some(vec![1]));
    }

    #[test]
    fn an_earlier_process_may_have_changed_anything() {
        let as_found = Finding { acceleration: Some(30.0), ..found(mode::POSITION) };
        let converted = as_found.to_contract(4);
        assert_eq!((converted.motor, converted.compliant), (4, Some(true)));
        let again = Finding::of(&converted);
        assert_eq!(again, as_found, "to the last bit");
        let nonsense = AsFound { speed: Some(f64::NAN), acceleration: Some(-1.0), ..converted };
        assert_eq!((Finding::of(&nonsense).speed, Finding::of(&nonsense).acceleration), (None, None));
        let mut owed = Owed::new(1);
        owed.inherit(vec![again]);
        for kind in KINDS {
            let due = owed.due(|_| true, |_| true).unwrap();
            assert_eq!(due.kind, kind);
            owed.paid(&due);
        }
        assert!(!owed.is_any());
    }
}
