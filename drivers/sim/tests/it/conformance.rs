//! The simulated robot keeps every promise of the driver contract, and the suite notices drivers that don't.

use mobee_conformance::Bench;
use mobee_contract::{Axis, Board, Command, ControlMode, Driver, DriverFault, Hardware, Sample, Time};
use mobee_sim::path::Profile;
use mobee_sim::{SimHardware, SimSettings};

type Wrap = fn(Box<dyn Driver>) -> Box<dyn Driver>;

struct Virtual {
    hardware: SimHardware,
    now: Time,
    wrap: Wrap,
}

impl Bench for Virtual {
    fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
        self.hardware.connect().map(self.wrap).map_err(|e| e.to_string())
    }
    fn now(&self) -> Time {
        self.now
    }
    fn wait_until(&mut self, then: Time) {
        self.now = self.now.max(then);
    }
}

fn axes() -> Vec<Axis> {
    let axis = |(name, min, max): (&str, f64, f64)| Axis {
        name: name.into(),
        min: min.to_radians(),
        max: max.to_radians(),
        max_speed: 100f64.to_radians(),
        max_acceleration: 200f64.to_radians(),
        ..Default::default()
    };
    [("yaw", -50.0, 50.0), ("elbow", 15.0, 106.0), ("finger", 0.0, 250.0), ("stiff", 0.0, 1.0)].map(axis).to_vec()
}

fn failures(settings: &SimSettings, wrap: Wrap) -> Vec<(&'static str, String)> {
    let start = [0.0, 60.0, 0.0, 0.5].map(f64::to_radians);
    mobee_conformance::failures(&mut || {
        let hardware = SimHardware::with_axes(axes(), &start, settings, 11);
        Box::new(Virtual { hardware, now: Time::ZERO, wrap })
    })
}

#[test]
fn the_simulated_robot_keeps_every_promise() {
    for profile in [Profile::MinimumJerk, Profile::Trapezoidal] {
        let settings = SimSettings { move_profile: profile, ..SimSettings::ideal() };
        for variant in [
            settings.clone(),
            settings.clone().exact(),
            SimSettings { latency_ms: 0.0, ..settings.clone() },
            SimSettings { latency_ms: 70.0, rate_hz: 50.0, ..settings.clone() },
        ] {
            assert_eq!(failures(&variant, |d| d), [], "{variant:?}");
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Defect {
    Lease,
    Limits,
    NotFinite,
    AlwaysDone,
    DoneEarly,
    Relative,
    Stop,
    StopsAll,
    References,
    Sequence,
    Modes,
    Halves,
    Repeats,
    Restart,
    Mute,
    Unit,
    Stale,
    Standing,
    Fast,
}

/// A driver with a planted defect.
struct Broken {
    inner: Box<dyn Driver>,
    defect: Defect,
    given: u64,
    last: Option<Sample>,
}

impl Broken {
    fn fit(&self, q: f64, motor: usize) -> f64 {
        self.inner.board().axes.get(motor).map_or(q, |a| q.clamp(a.min, a.max))
    }
}

impl Driver for Broken {
    fn board(&self) -> &Board {
        self.inner.board()
    }
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        let mut command = command.clone();
        match (&mut command, self.defect) {
            (Command::Move(m), Defect::Limits) if !m.relative => {
                m.q = m.q.iter().zip(&m.motors).map(|(q, i)| self.fit(*q, *i)).collect();
            }
            (Command::Move(m), Defect::NotFinite) => {
                m.q.iter_mut().filter(|q| !q.is_finite()).for_each(|q| *q = 0.3);
            }
            (Command::Move(m), Defect::Relative) => m.relative = false,
            (Command::Move(m), Defect::References) => (m.speed, m.acceleration) = (None, None),
            (Command::Move(m), Defect::Unit) => m.q.iter_mut().for_each(|q| *q *= 1.05),
            (Command::Move(m), Defect::Halves) => {
                let ok = |i: usize, q: f64| self.fit(q, i) == q;
                let kept: Vec<usize> = (0..m.q.len()).filter(|k| m.relative || ok(m.motors[*k], m.q[*k])).collect();
                let kept = if kept.is_empty() { vec![0] } else { kept };
                let half = mobee_contract::Move {
                    motors: kept.iter().map(|k| m.motors[*k]).collect(),
                    q: kept.iter().map(|k| m.q[*k]).collect(),
                    relative: m.relative,
                    speed: None,
                    acceleration: None,
                };
                let whole = self.inner.command(now, &command);
                if whole.is_err() {
                    let _ = self.inner.command(now, &Command::Move(half));
                }
                return whole;
            }
            (Command::Stop { .. }, Defect::Stop) => return Ok(()),
            (Command::Stop { motors }, Defect::StopsAll) => motors.clear(),
            (Command::Direct { .. }, Defect::Mute) => return Ok(()),
            (Command::Velocity { .. }, Defect::Standing) => return Ok(()),
            (Command::Velocity { speed, .. }, Defect::Fast) => speed.iter_mut().for_each(|v| *v *= 1.3),
            _ => {}
        }
        self.inner.command(now, &command)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        if self.defect == Defect::Lease {
            self.inner.lease(now, Time::from_secs(1e6));
        }
        let mut sample = self.inner.sample(now)?;
        if let Some(s) = &mut sample {
            match self.defect {
                Defect::AlwaysDone => s.done.fill(true),
                Defect::DoneEarly => {
                    let last = self.last.replace(s.clone()).unwrap_or(s.clone());
                    let slow = s.q.iter().zip(last.q.iter()).map(|(a, b)| (a - b).abs() < 5e-4);
                    s.done = slow.collect();
                }
                Defect::Sequence => s.seq = 0,
                Defect::Restart => {
                    self.given += 1;
                    s.seq = self.given;
                }
                Defect::Stale => s.at = Time(s.at.0 / 1_000_000_000 * 1_000_000_000),
                _ => self.last = Some(s.clone()),
            }
        }
        if self.defect == Defect::Repeats { Ok(self.last.clone()) } else { Ok(sample) }
    }
    fn next_sample(&self, now: Time) -> Time {
        self.inner.next_sample(now)
    }
    fn lease(&mut self, now: Time, until: Time) {
        if self.defect != Defect::Lease {
            self.inner.lease(now, until);
        }
    }
    fn modes(&self) -> Vec<ControlMode> {
        match self.defect {
            Defect::Modes => vec![ControlMode::PositionDirect; self.inner.modes().len()],
            _ => self.inner.modes(),
        }
    }
}

#[test]
fn the_suite_notices_every_planted_defect() {
    macro_rules! defects {
        ($($name:ident),*) => {
            [$((stringify!($name), (|inner| {
                Box::new(Broken { inner, defect: Defect::$name, given: 0, last: None }) as Box<dyn Driver>
            }) as Wrap)),*]
        };
    }
    let defects = defects![
        Lease, Limits, NotFinite, AlwaysDone, DoneEarly, Relative, Stop, StopsAll, References, Sequence, Modes, Halves,
        Repeats, Restart, Mute, Unit, Stale, Standing, Fast
    ];
    for (name, wrap) in defects {
        let seen = failures(&SimSettings::ideal(), wrap);
        eprintln!("{name}: {} promises broken: {:?}", seen.len(), seen.iter().map(|(n, _)| n).collect::<Vec<_>>());
        assert!(!seen.is_empty(), "the suite does not notice the defect {name}");
    }
}
