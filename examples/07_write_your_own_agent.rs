//! Write an agent: it waves with one motor, and turns back wherever a motion fails.
//!
//! An agent is asked what to do whenever the robot rests. It may ask for an infeasible motion: the controller prevents
//! harm, and the agent only learns that the motion failed.
//!
//! `cargo run --release --example 07_write_your_own_agent`

use mobee_contract::{
    Agent, Intent, Kind, KindError, MotionEnd, Refusal, Registered, Snapshot, Summary, Target, View, settings,
};

/// Its settings, as written in a configuration file. `mobee kinds` shows the doc comments.
#[derive(serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct WaveSettings {
    /// The motor to wave with.
    motor: String,
    /// Amplitude about the middle, degrees.
    swing_deg: f64,
    /// How many times.
    times: u32,
}

struct Wave {
    motor: usize,
    middle: f64,
    swing: f64,
    left: u32,
    failed: u32,
}

impl Agent for Wave {
    fn next(&mut self, last: Option<MotionEnd>, _view: &View) -> Intent {
        self.failed += u32::from(last == Some(MotionEnd::Failed));
        if self.left == 0 {
            let text = format!("waved; {} swings met something and were rolled back", self.failed);
            return Intent::Done(Summary { text, figures: vec![("failed".into(), f64::from(self.failed))] });
        }
        self.left -= 1;
        let side = if self.left.is_multiple_of(2) { 1.0 } else { -1.0 };
        Intent::MoveTo(Target { motors: vec![self.motor], q: vec![self.middle + side * self.swing], speed: 0.2 })
    }

    fn export(&self) -> Snapshot {
        Snapshot {
            kind: "wave".into(),
            version: 1,
            state: serde_json::json!({ "left": self.left, "failed": self.failed }),
        }
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let count = |key: &str| from.state[key].as_u64().and_then(|n| u32::try_from(n).ok());
        let (Some(left), Some(failed)) = (count("left"), count("failed")) else {
            return Err(Refusal::State { what: "counts are missing".into() });
        };
        (self.left, self.failed) = (left, failed);
        Ok(())
    }
}

// Registering the kind makes `agent = { kind = "wave", ... }` work in configuration files.
inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "wave",
        doc: "Waves with one motor.",
        schema: || schemars::schema_for!(WaveSettings),
        example: |robot| Ok(serde_json::json!({ "motor": robot.motors[0].name, "swing_deg": 5.0, "times": 2 })),
        build: |value, context| {
            let s: WaveSettings = settings(value)?;
            let motor = context.robot.motor_index(&s.motor).ok_or_else(|| {
                KindError::new("motor", format!("there is no motor `{}`", s.motor), "`mobee model info` lists a robot's motors")
            })?;
            let m = &context.robot.motors[motor];
            let swing = s.swing_deg.to_radians().min(m.home - m.min).min(m.max - m.home);
            Ok(Box::new(Wave { motor, middle: m.home, swing, left: s.times, failed: 0 }))
        },
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let agent = r#"robot.icub.agent={ kind = "wave", motor = "r_shoulder_roll", swing_deg = 30, times = 6 }"#;
    let done = mobee::run::example("configs/behaviors/explore.toml", &[agent, "record.enabled=false"])?;
    println!("{}", serde_json::to_string_pretty(&mobee::run::summary(&done))?);
    assert!(mobee::run::in_order(&done.end), "the agent ends by itself");
    Ok(())
}
