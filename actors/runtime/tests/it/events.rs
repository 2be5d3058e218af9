//! Events that the journals of several tests are made of, of one robot with two motors.

use mobee_contract::{Cause, Clauses, Event};

/// Its name.
pub const R: &str = "edge";

/// The robot, with these limits either way (rad) and constraints.
pub fn robot(limit: f64, constraints: Clauses) -> Event {
    Event::Robot {
        robot: R.into(),
        motors: vec!["a".into(), "b".into()],
        sliding: Vec::new(),
        min: vec![-limit; 2],
        max: vec![limit; 2],
        max_speed: vec![2.0; 2],
        period: 0.02,
        fresh: 0.1,
        margin: 0.01,
        tolerance: 0.002,
        rest_speed: 0.01,
        resolution: 0.0,
        hold_error: 0.0,
        deflection: 0.0,
        constraints,
    }
}

pub fn started() -> Event {
    Event::Started { seed: 1, clock: "virtual".into(), config: serde_json::json!({}) }
}

pub fn ended() -> Event {
    Event::Ended { reason: "done".into() }
}

pub fn enabled(token: u64) -> Event {
    Event::Enabled { robot: R.into(), token }
}

pub fn disabled(token: u64) -> Event {
    Event::Disabled { robot: R.into(), token, cause: Cause::Asked }
}
