//! Faults between the driver and a board.

use mobee_contract::Time;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::fmt;
use std::time::Duration;

/// Fault of the wire to a board, or of a task at one of its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WireFault {
    /// Answers take up to this time, half of it on the way there.
    Late(Duration),
    /// Of this number of messages one is lost, there or back.
    Lossy(u32),
    /// All connections break, and none can be made.
    Cut,
    /// Nothing gets through, and no error is reported.
    Hole,
    /// No states come.
    Silent,
    /// Each state takes this time.
    Behind(Duration),
    /// Each state takes up to this time, so that states overtake each other.
    Shuffled(Duration),
    /// Each state arrives twice.
    Doubled,
    /// States are stamped this number of seconds too late.
    Stamps(f64),
    /// Of this number of orders one is answered `[fail]` and not executed.
    Nack(u32),
    /// This number of stops are answered `[ok]` and have no effect.
    Deaf(u32),
    /// After one of this number of our messages another program sets the board's references to their maximum.
    Meddled(u32),
    /// A task of the driver panics.
    Dies(Who),
}

/// A task of the driver at one board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Who {
    /// The board worker.
    Hand,
    /// The brake.
    Brake,
    /// The reader of states.
    Reader,
    /// The connection.
    Connection,
}

impl fmt::Display for WireFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |d: &Duration| d.as_secs_f64() * 1e3;
        match self {
            WireFault::Late(most) => write!(f, "answers take up to {:.0} ms", ms(most)),
            WireFault::Lossy(of) => write!(f, "one word of {of} gets lost"),
            WireFault::Cut => f.write_str("no connection"),
            WireFault::Hole => f.write_str("nothing gets through"),
            WireFault::Silent => f.write_str("no states"),
            WireFault::Behind(by) => write!(f, "states take {:.0} ms", ms(by)),
            WireFault::Shuffled(most) => write!(f, "states take up to {:.0} ms, each its own time", ms(most)),
            WireFault::Doubled => f.write_str("states come twice"),
            WireFault::Stamps(by) => write!(f, "states are stamped {by:.2} s late"),
            WireFault::Nack(of) => write!(f, "one order of {of} fails"),
            WireFault::Deaf(stops) => write!(f, "{stops} stops without effect"),
            WireFault::Meddled(of) => write!(f, "another program sets references, after one word of {of}"),
            WireFault::Dies(who) => write!(f, "the death of the {who:?}"),
        }
    }
}

impl WireFault {
    /// True if the fault may prevent a stop from reaching the board, whatever the driver does.
    pub(super) fn blocks_stops(&self) -> bool {
        matches!(self, WireFault::Lossy(_) | WireFault::Cut | WireFault::Hole | WireFault::Nack(_) | WireFault::Dies(_))
    }
}

/// A fault and its interval.
#[derive(Clone, Copy, Debug)]
struct FaultSpan {
    fault: WireFault,
    from: Time,
    until: Time,
    /// Remaining number of effects, for faults with a limited number.
    left: u32,
}

/// Fate of a message on its way to a board and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fate {
    pub there: Duration,
    pub back: Duration,
    /// The message does not arrive.
    pub lost: bool,
    /// The answer does not arrive.
    pub unanswered: bool,
    /// The board answers `[fail]`.
    pub nack: bool,
}

/// Faults of one wire, and the random numbers they depend on.
#[derive(Debug)]
pub(super) struct Faults {
    spans: Vec<FaultSpan>,
    dice: ChaCha8Rng,
}

impl Faults {
    /// Creates a wire without faults.
    pub fn new(dice: ChaCha8Rng) -> Faults {
        Faults { spans: Vec::new(), dice }
    }

    /// Plans a fault.
    pub fn plan(&mut self, fault: WireFault, from: Time, until: Time) {
        let left = match fault {
            WireFault::Deaf(stops) => stops,
            _ => 1,
        };
        self.spans.push(FaultSpan { fault, from, until, left });
    }

    /// Faults active now.
    pub fn on(&self, now: Time) -> impl Iterator<Item = WireFault> + '_ {
        self.spans.iter().filter(move |s| s.from <= now && now < s.until).map(|s| s.fault)
    }

    /// End of the last fault, among those that have begun, that may prevent stops.
    pub fn disturbed_until(&self, now: Time) -> Time {
        let hinders = self.spans.iter().filter(|s| s.from <= now && s.fault.blocks_stops());
        hinders.map(|s| s.until).max().unwrap_or(Time::ZERO)
    }

    /// True if a matching fault was active since then.
    pub fn any_since(&self, since: Time, now: Time, which: impl Fn(&WireFault) -> bool) -> bool {
        self.spans.iter().any(|s| s.from <= now && s.until > since && which(&s.fault))
    }

    /// Uses up one effect of a fault with a limited number.
    pub fn take(&mut self, now: Time, which: impl Fn(&WireFault) -> bool) -> bool {
        let due = |s: &&mut FaultSpan| s.from <= now && now < s.until && s.left > 0 && which(&s.fault);
        self.spans.iter_mut().find(due).is_some_and(|s| {
            s.left -= 1;
            true
        })
    }

    /// Draws the fate of a message.
    pub fn fate(&mut self, now: Time) -> Fate {
        let sound = Duration::from_millis(1);
        let mut fate = Fate { there: Duration::ZERO, back: sound, lost: false, unanswered: false, nack: false };
        let on: Vec<WireFault> = self.on(now).collect();
        for fault in on {
            match fault {
                WireFault::Late(most) => {
                    fate.there = fate.there.max(self.up_to(most / 2));
                    fate.back = fate.back.max(self.up_to(most / 2));
                }
                WireFault::Lossy(of) if self.one_of(of) => {
                    fate.lost = self.one_of(2);
                    fate.unanswered = !fate.lost;
                }
                WireFault::Hole => fate.lost = true,
                WireFault::Nack(of) => fate.nack |= self.one_of(of),
                _ => {}
            }
        }
        fate
    }

    /// True if another program sets references after this message.
    pub fn meddles(&mut self, now: Time) -> bool {
        let of = self.on(now).find_map(|f| if let WireFault::Meddled(of) = f { Some(of) } else { None });
        of.is_some_and(|of| self.one_of(of))
    }

    /// Transit times of the copies of a state sent now, and the error of its stamp, s.
    pub fn states(&mut self, now: Time) -> (Vec<Duration>, f64) {
        let mut ways = vec![Duration::ZERO];
        let mut off = 0.0;
        let on: Vec<WireFault> = self.on(now).collect();
        for fault in on {
            match fault {
                WireFault::Silent | WireFault::Hole | WireFault::Cut => return (Vec::new(), 0.0),
                WireFault::Lossy(of) if self.one_of(of) => return (Vec::new(), 0.0),
                WireFault::Behind(by) => ways.iter_mut().for_each(|way| *way += by),
                WireFault::Shuffled(most) => {
                    let by = self.up_to(most);
                    ways.iter_mut().for_each(|way| *way += by);
                }
                WireFault::Doubled => {
                    let again = self.up_to(Duration::from_millis(60));
                    ways.extend(ways.first().map(|way| *way + again));
                }
                WireFault::Stamps(by) => off += by,
                _ => {}
            }
        }
        (ways, off)
    }

    fn one_of(&mut self, of: u32) -> bool {
        self.dice.random_range(0..of.max(1)) == 0
    }

    fn up_to(&mut self, most: Duration) -> Duration {
        most.mul_f64(self.dice.random_range(0.0..1.0))
    }
}
