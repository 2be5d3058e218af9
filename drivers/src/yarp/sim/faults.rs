//! What can go wrong between the driver and a board.

use mobee_contract::Time;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::fmt;
use std::time::Duration;

/// What is wrong with the wire to a board, or with whoever sits at its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WireFault {
    /// Answers take up to so long, half of it on the way there.
    Late(Duration),
    /// Of so many words one gets lost, there or back.
    Lossy(u32),
    /// All connections break, and none can be made.
    Cut,
    /// Nothing gets through, and nobody is told.
    Hole,
    /// No states come.
    Silent,
    /// Each state takes so long.
    Behind(Duration),
    /// Each state takes up to so long: they overtake each other.
    Shuffled(Duration),
    /// Each state comes twice.
    Doubled,
    /// States are stamped so many seconds too late.
    Stamps(f64),
    /// Of so many orders one is answered `[fail]` and not carried out.
    Nack(u32),
    /// The next stops, so many, are answered `[ok]` and have no effect.
    Deaf(u32),
    /// After one of so many of our words another program sets the board's references to its greatest.
    Meddled(u32),
    /// A task of the driver panics.
    Dies(Who),
}

/// A task of the driver at one board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Who {
    /// Its hand.
    Hand,
    /// Its brake.
    Brake,
    /// The reader of its states.
    Reader,
    /// Its connection.
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
    /// Whether a stop may not get to the board while it lasts, whatever the driver does.
    pub(super) fn keeps_stops_away(&self) -> bool {
        matches!(self, WireFault::Lossy(_) | WireFault::Cut | WireFault::Hole | WireFault::Nack(_) | WireFault::Dies(_))
    }
}

/// A fault and its span of time.
#[derive(Clone, Copy, Debug)]
struct Span {
    fault: WireFault,
    from: Time,
    until: Time,
    /// What is left of those that are used up.
    left: u32,
}

/// What becomes of a word on its way to a board and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fate {
    pub there: Duration,
    pub back: Duration,
    /// It does not arrive.
    pub lost: bool,
    /// Its answer does not.
    pub unanswered: bool,
    /// It fails.
    pub nack: bool,
}

/// The faults of one wire, and the dice they are thrown with.
#[derive(Debug)]
pub(super) struct Faults {
    spans: Vec<Span>,
    dice: ChaCha8Rng,
}

impl Faults {
    /// A sound wire.
    pub fn new(dice: ChaCha8Rng) -> Faults {
        Faults { spans: Vec::new(), dice }
    }

    /// A fault known beforehand.
    pub fn plan(&mut self, fault: WireFault, from: Time, until: Time) {
        let left = match fault {
            WireFault::Deaf(stops) => stops,
            _ => 1,
        };
        self.spans.push(Span { fault, from, until, left });
    }

    /// What is wrong now.
    pub fn on(&self, now: Time) -> impl Iterator<Item = WireFault> + '_ {
        self.spans.iter().filter(move |s| s.from <= now && now < s.until).map(|s| s.fault)
    }

    /// When the last fault that keeps stops away ended, or will have ended, of those that have begun.
    pub fn disturbed_until(&self, now: Time) -> Time {
        let hinders = self.spans.iter().filter(|s| s.from <= now && s.fault.keeps_stops_away());
        hinders.map(|s| s.until).max().unwrap_or(Time::ZERO)
    }

    /// Whether one of these was on since then.
    pub fn any_since(&self, since: Time, now: Time, which: impl Fn(&WireFault) -> bool) -> bool {
        self.spans.iter().any(|s| s.from <= now && s.until > since && which(&s.fault))
    }

    /// Uses up one of a fault that comes by the piece.
    pub fn take(&mut self, now: Time, which: impl Fn(&WireFault) -> bool) -> bool {
        let due = |s: &&mut Span| s.from <= now && now < s.until && s.left > 0 && which(&s.fault);
        self.spans.iter_mut().find(due).is_some_and(|s| {
            s.left -= 1;
            true
        })
    }

    /// Throws the dice for a word.
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

    /// Whether another program meddles after this word.
    pub fn meddles(&mut self, now: Time) -> bool {
        let of = self.on(now).find_map(|f| if let WireFault::Meddled(of) = f { Some(of) } else { None });
        of.is_some_and(|of| self.one_of(of))
    }

    /// After what times a state that is sent now comes, and by how much its stamp is off, s.
    pub fn states(&mut self, now: Time) -> (Vec<Duration>, f64) {
        let (mut ways, mut off) = (vec![Duration::ZERO], 0.0);
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
