//! The agent `my_arm_wave`: moves one motor to and fro about its home position.
//!
//! An agent plans motions that may be infeasible. The controller rolls back a motion that would collide; the agent then receives
//! `MotionEnd::Failed` and plans again.

use mobee_contract::{
    Agent, Intent, Kind, KindError, MotionEnd, Refusal, Registered, Snapshot, Summary, Target, View, settings,
};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::json;

/// Its settings in the behavior file. `kinds my_arm_wave` prints these comments.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaveSettings {
    /// The motor to move.
    pub motor: String,
    /// Amplitude about the home position, degrees.
    pub swing_deg: f64,
    /// The number of motions; 0: no end.
    #[serde(default)]
    pub count: u32,
    /// Share of the motor's maximum speed, above 0 and up to 1.
    #[serde(default = "default_speed")]
    pub speed: f64,
}

fn default_speed() -> f64 {
    0.2
}

/// Moves one motor to and fro.
pub struct Wave {
    motor: usize,
    /// Position limits of the motion, rad.
    ends: [f64; 2],
    speed: f64,
    count: u32,
    done: u32,
    failed: u32,
}

impl Agent for Wave {
    fn next(&mut self, last: Option<MotionEnd>, _view: &View) -> Intent {
        self.failed += u32::from(last == Some(MotionEnd::Failed));
        if self.count > 0 && self.done == self.count {
            let text = format!("{} motions, {} rolled back", self.done, self.failed);
            return Intent::Done(Summary { text, figures: vec![("failed".into(), f64::from(self.failed))] });
        }
        let [low, high] = self.ends;
        let q = if self.done.is_multiple_of(2) { high } else { low };
        self.done = self.done.wrapping_add(1);
        Intent::MoveTo(Target { motors: vec![self.motor], q: vec![q], speed: self.speed })
    }

    // the state that a successor receives when the agent is swapped in a live run
    fn export(&self) -> Snapshot {
        Snapshot { kind: "my_arm_wave".into(), version: 1, state: json!({ "done": self.done, "failed": self.failed }) }
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let count = |key: &str| from.state[key].as_u64().and_then(|n| u32::try_from(n).ok());
        let (Some(done), Some(failed)) = (count("done"), count("failed")) else {
            return Err(Refusal::State { what: "`done` or `failed` is missing".into() });
        };
        self.done = done;
        self.failed = failed;
        Ok(())
    }
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "my_arm_wave",
        doc: "Moves one motor to and fro about its home position.",
        schema: || schemars::schema_for!(WaveSettings),
        example: |robot| {
            let motor = robot.motors.first().ok_or("it needs a robot with a motor")?;
            Ok(json!({ "motor": motor.name, "swing_deg": 5.0, "count": 2 }))
        },
        build: |value, context| {
            let s: WaveSettings = settings(value)?;
            let motor = context.robot.motor_index(&s.motor).ok_or_else(|| {
                KindError::new("motor", format!("there is no motor `{}`", s.motor), "`model info` lists the motors of a robot file")
            })?;
            if !(s.speed > 0.0 && s.speed <= 1.0) {
                return Err(KindError::new("speed", format!("{} is not a share", s.speed), "give a number above 0, up to 1"));
            }
            if !(s.swing_deg > 0.0 && s.swing_deg.is_finite()) {
                return Err(KindError::new("swing_deg", format!("{} is not an amplitude", s.swing_deg), "give a number above 0"));
            }
            let m = &context.robot.motors[motor];
            let swing = s.swing_deg.to_radians();
            let ends = [(m.home - swing).max(m.min), (m.home + swing).min(m.max)];
            Ok(Box::new(Wave { motor, ends, speed: s.speed, count: s.count, done: 0, failed: 0 }))
        },
    })
}
