//! A small robot of three motors, its world, and scripted agents.

use mobee_contract::*;
use mobee_controller::{ControllerSettings, Drive};
use mobee_journal::check::{Violation, check_events};
use mobee_model::{Object, ObjectClass, Primitive, Robot, Scene, Shape, parse_robot};
use mobee_runtime::clock::ClockKind;
use mobee_runtime::system::{
    AgentMaker, Control, RestSetup, RobotSetup, RunEnd, ScriptStep, SensorSetup, Setup, TruthCell, run_under,
};
use mobee_runtime::tap::{Collected, Pictures, SinkSpec, Taps};
use mobee_sim::{SimFaults, SimHardware, SimSettings};
use nalgebra::Isometry3;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::Sender;

pub const ARM: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="arm">
  <bodypart name="arm">
    <link z="0.2" radius="0.03">
      <motor name="pan" minPos="-170" maxPos="170"><joint z="1" length="0.05">
        <link x="0.3" radius="0.03" capsule="true">
          <motor name="elbow" minPos="-120" maxPos="120"><joint z="1" length="0.05">
            <link x="0.25" radius="0.03" capsule="true">
              <motor name="wrist" minPos="-90" maxPos="90"><joint y="1" length="0.05">
                <link x="0.1" radius="0.02" capsule="true"><link x="1"><marker name="tip" nx="1"/></link></link>
              </joint></motor>
            </link>
          </joint></motor>
        </link>
      </joint></motor>
    </link>
  </bodypart>
</ZeroPositionKinematicTree>"#;

pub fn arm() -> Arc<Robot> {
    let text = ARM.replace("length=\"0.05\"", "length=\"0.05\" minPos=\"-180\" maxPos=\"180\"");
    // joint angles equal encoder degrees
    let text = text.replacen("minPos=\"-180\" maxPos=\"180\"", "minPos=\"-170\" maxPos=\"170\"", 1);
    let text = text.replacen("minPos=\"-180\" maxPos=\"180\"", "minPos=\"-120\" maxPos=\"120\"", 1);
    let text = text.replacen("minPos=\"-180\" maxPos=\"180\"", "minPos=\"-90\" maxPos=\"90\"", 1);
    Arc::new(parse_robot("arm.xml", &text).map(|l| l.value).unwrap())
}

pub fn ball(name: &str, at: [f64; 3], class: ObjectClass) -> Object {
    Object {
        name: name.into(),
        class,
        persistent: false,
        pose: Isometry3::translation(at[0], at[1], at[2]),
        shapes: vec![Primitive { shape: Shape::Sphere { radius: 0.05 }, pose: Isometry3::identity() }],
        color: None,
    }
}

/// Goes to each pose in turn (degrees), whatever happened to the one before, and waits in between.
pub struct Poses {
    pub poses: Vec<[f64; 3]>,
    pub speed: f64,
    pub next: usize,
    pub pause: Duration,
    pub rest: bool,
    pub ends: Vec<MotionEnd>,
}

impl Agent for Poses {
    fn next(&mut self, last: Option<MotionEnd>, _view: &View) -> Intent {
        self.ends.extend(last);
        if std::mem::replace(&mut self.rest, false) && !self.pause.is_zero() {
            return Intent::Wait(self.pause);
        }
        let Some(pose) = self.poses.get(self.next) else {
            let figures =
                vec![("reached".into(), self.ends.iter().filter(|e| **e == MotionEnd::Reached).count() as f64)];
            return Intent::Done(Summary { text: "all poses were tried".into(), figures });
        };
        self.next += 1;
        self.rest = true;
        let q = pose.iter().map(|d| d.to_radians()).collect();
        Intent::MoveTo(Target { motors: vec![0, 1, 2], q, speed: self.speed })
    }
    fn export(&self) -> Snapshot {
        Snapshot { kind: "poses".into(), version: 1, state: self.next.into() }
    }
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.next = from.state.as_u64().unwrap_or(0) as usize;
        Ok(())
    }
}

pub struct Trial {
    pub objects: Vec<Object>,
    pub poses: Vec<[f64; 3]>,
    pub speed: f64,
    pub pause: Duration,
    pub history: usize,
    pub period_s: f64,
    pub seed: u64,
    pub script: Vec<ScriptStep>,
    pub limit: Duration,
    pub controls: Vec<(Duration, Control)>,
    pub drive: Drive,
    pub stall_deg: Option<f64>,
    pub undo_s: f64,
    /// Greatest age of a fresh reading; with a real clock three seconds, unless given.
    pub stale_s: Option<f64>,
    pub clock: ClockKind,
    /// Instead of the one that goes through the poses.
    pub agent: Option<AgentMaker>,
    /// The motion at its end.
    pub rest: Option<RestSetup>,
    /// Who is told behind queues, beside what the test sees.
    pub sinks: Vec<SinkSpec>,
    pub sensors: Vec<SensorSetup>,
    pub truth: Option<Arc<TruthCell>>,
}

impl Default for Trial {
    fn default() -> Trial {
        Trial {
            objects: Vec::new(),
            poses: vec![[30.0, 20.0, 10.0], [0.0, 0.0, 0.0]],
            speed: 0.3,
            pause: Duration::ZERO,
            history: 3000,
            period_s: 0.02,
            seed: 1,
            script: Vec::new(),
            limit: Duration::from_secs(120),
            controls: Vec::new(),
            drive: Drive::Straight,
            stall_deg: None,
            undo_s: ControllerSettings::default().undo_s,
            stale_s: None,
            clock: ClockKind::Virtual,
            agent: None,
            rest: None,
            sinks: Vec::new(),
            sensors: Vec::new(),
            truth: None,
        }
    }
}

pub struct Ran {
    pub end: RunEnd,
    pub told: Collected,
    pub hardware: SimHardware,
}

impl Ran {
    pub fn events(&self) -> Vec<(Time, Arc<Event>)> {
        self.told.events()
    }
    pub fn violations(&self) -> Vec<Violation> {
        check_events(self.events())
    }
    pub fn outcomes(&self) -> Vec<Outcome> {
        let of =
            |e: &(Time, Arc<Event>)| if let Event::Outcome { outcome, .. } = &*e.1 { Some(*outcome) } else { None };
        self.events().iter().filter_map(of).collect()
    }
    pub fn lines(&self) -> String {
        self.events().iter().map(|(at, e)| format!("{at} {e:?}\n")).collect()
    }
}

/// Sinks, and one beside them that keeps what it is told.
fn behind(clock: ClockKind, mut sinks: Vec<SinkSpec>) -> (Taps, Collected) {
    let told = Collected::default();
    let (keep, patience) = (told.clone(), Duration::from_secs(30));
    let open: mobee_runtime::tap::OpenSink = Arc::new(move || Ok(Box::new(keep.clone())));
    let (name, essential, poses, capacity) = ("test".into(), false, None, 8192);
    sinks.push(SinkSpec { pictures: Pictures::None, name, essential, poses, capacity, patience, open: Some(open) });
    (Taps::spawn(clock, sinks).unwrap(), told)
}

impl Trial {
    pub fn run(self) -> Ran {
        self.run_with(|_| ())
    }

    pub fn run_with(self, prepare: impl FnOnce(&SimFaults)) -> Ran {
        self.run_all(prepare, |_| Vec::new())
    }

    /// With services that get a line to the run, to stop it.
    pub fn run_all(
        self,
        prepare: impl FnOnce(&SimFaults),
        services: impl FnOnce(Sender<Control>) -> Vec<Arc<dyn Service>>,
    ) -> Ran {
        let prepare = |hardware: &SimHardware| {
            prepare(&hardware.faults());
            Vec::new()
        };
        self.run_whole(prepare, services)
    }

    /// With further controls, which may name the hardware.
    pub fn run_driven(self, controls: impl FnOnce(&SimHardware) -> Vec<(Duration, Control)>) -> Ran {
        self.run_whole(controls, |_| Vec::new())
    }

    fn run_whole(
        self,
        prepare: impl FnOnce(&SimHardware) -> Vec<(Duration, Control)>,
        services: impl FnOnce(Sender<Control>) -> Vec<Arc<dyn Service>>,
    ) -> Ran {
        let (tell, controls) = tokio::sync::mpsc::channel(4);
        let robot = arm();
        let hardware =
            SimHardware::new(&SimSettings::ideal(), &Context { robot: robot.clone(), seed: self.seed }).unwrap();
        let further = prepare(&hardware);
        let scene = Scene::new(vec![(robot, Isometry3::identity())], self.objects).unwrap();
        let (taps, told) = if self.sinks.is_empty() { Taps::collect() } else { behind(self.clock, self.sinks) };
        let (poses, speed, pause) = (self.poses, self.speed, self.pause);
        let agent = move || {
            let agent = Poses { poses: poses.clone(), speed, next: 0, pause, rest: false, ends: Vec::new() };
            Ok(Box::new(agent) as Box<dyn Agent>)
        };
        let setup = Setup {
            scene,
            robots: vec![RobotSetup {
                name: "arm".into(),
                hardware: Arc::new(hardware.clone()),
                controller: ControllerSettings {
                    history: self.history,
                    period_s: self.period_s,
                    drive: self.drive,
                    stall_deg: self.stall_deg,
                    undo_s: self.undo_s,
                    // the paper's Algorithm 6: by the margin alone
                    reserve_m: Some(0.0),
                    // the machine may take all processors away for half a second
                    stale_s: self.stale_s.or((self.clock == ClockKind::Real).then_some(3.0)),
                    ..ControllerSettings::default()
                },
                agent: Some(self.agent.unwrap_or(Arc::new(agent))),
                rest: self.rest,
            }],
            seed: self.seed,
            clock: self.clock,
            taps: taps.clone(),
            config: serde_json::Value::Null,
            script: self.script,
            services: services(tell.clone()),
            sensors: self.sensors,
            truth: self.truth,
            past: None,
        };
        let faults = self.controls.into_iter().chain(further).map(|(at, c)| (Time::ZERO + at, c)).collect();
        let end = run_under(setup, faults, controls, Some(self.limit), |_| ()).unwrap();
        drop(tell);
        taps.finish(end.ended_at, Event::Ended { reason: end.reason.to_string() });
        Ran { end, told, hardware }
    }
}
