//! The robot moves as committed, and as nothing else: a motor that no commit names does not leave its place, and one that is
//! named comes back to where it was sent, however often.

use crate::common::{Ran, Trial, ball};
use mobee_contract::*;
use mobee_model::ObjectClass;
use std::sync::Arc;

/// Moves one motor into an obstacle and is taken back, so often; or streams set-points towards it.
struct Pushes {
    times: usize,
    streams: bool,
    at: f64,
}

const FAR: f64 = 1.2;

impl Agent for Pushes {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        self.times -= usize::from(last.is_some());
        if self.times == 0 {
            return Intent::Done(Summary { text: "pushed".into(), figures: Vec::new() });
        }
        self.at = view.pose().first().copied().unwrap_or_default();
        let target = Target { motors: vec![0], q: vec![FAR], speed: 0.3 };
        if self.streams { Intent::Stream(setpoint(self.at)) } else { Intent::MoveTo(target) }
    }
    fn revise(&mut self, _view: &View) -> Option<Intent> {
        self.at = (self.at + 0.007).min(FAR);
        self.streams.then(|| Intent::Stream(setpoint(self.at)))
    }
    fn export(&self) -> Snapshot {
        Snapshot { kind: "pushes".into(), version: 1, state: 0.into() }
    }
    fn import(&mut self, _: Snapshot) -> Result<(), Refusal> {
        Ok(())
    }
}

fn setpoint(q: f64) -> Setpoints {
    Setpoints { motors: vec![0], values: Values::Position(vec![q]) }
}

fn pushed(times: usize, streams: bool) -> Ran {
    let make = move || Ok(Box::new(Pushes { times, streams, at: 0.0 }) as Box<dyn Agent>);
    let objects = vec![ball("ball", [0.5, 0.25, 0.2], ObjectClass::Obstacle)];
    let limit = std::time::Duration::from_secs(7200);
    // undone whole: where half a second of a stream leads back to is no place that a motor was sent to
    Trial { objects, agent: Some(Arc::new(make)), limit, undo_s: 3600.0, ..Trial::default() }.run()
}

#[test]
fn a_motor_that_nobody_commanded_stays_where_it_is() {
    for streams in [false, true] {
        let ran = pushed(100, streams);
        let outcomes = ran.outcomes();
        assert_eq!(outcomes, vec![Outcome::RolledBack; 100], "streams: {streams}");
        assert_eq!(ran.violations(), [], "streams: {streams}");
        let q = ran.hardware.positions(ran.end.ended_at);
        assert_eq!(q[1..], [0.0, 0.0], "streams: {streams}");
        // the place that it was never sent to was read once, with the noise of its encoder
        assert!(q[0].to_degrees().abs() < 0.1, "streams: {streams}: {q:?}");
        let modes = ran.hardware.connect().unwrap().modes();
        assert_eq!(modes, [ControlMode::Position; 3], "streams: {streams}");
    }
}
