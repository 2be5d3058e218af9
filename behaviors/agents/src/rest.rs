//! Motion to a rest pose: a tour of the planning agent with a single goal.

use super::PlanAgent;
use mobee_contract::{
    Agent, Context, Intent, KindError, MotionEnd, Note, Refusal, Requirements, Snapshot, View, settings,
};
use serde_json::json;

/// Plans and drives to one pose, then is done. Its summary has the figure `goals_reached`; if that
/// is 0, the text is the reason.
pub struct RestAgent(PlanAgent);

impl RestAgent {
    /// Creates an agent that drives to a pose.
    ///
    /// # Arguments
    /// * `motors`: the motors that it moves, by number; the other motors stay where they are.
    /// * `q`: the pose, rad (encoder units), of the whole robot.
    /// * `speed`: share of each motor's maximum speed, above 0 and up to 1.
    /// * `tolerance_deg`: maximum distance of every motor from the pose, degrees.
    ///
    /// # Errors
    /// As for [`PlanAgent::new`].
    pub fn new(
        motors: &[usize],
        q: &[f64],
        speed: f64,
        tolerance_deg: f64,
        context: &Context,
    ) -> Result<RestAgent, KindError> {
        let moved = motors.iter().filter_map(|m| Some((context.robot.motors.get(*m)?, q.get(*m)?)));
        let (names, q_deg): (Vec<_>, serde_json::Map<_, _>) =
            moved.map(|(motor, q)| (motor.name.clone(), (motor.name.clone(), json!(q.to_degrees())))).unzip();
        let tour = json!({
            "poses": [{ "name": "rest", "q_deg": q_deg }],
            "motors": names,
            "goals": ["rest"],
            "speed": speed,
            "tolerance_deg": tolerance_deg,
        });
        Ok(RestAgent(PlanAgent::new(settings(&tour)?, context)?))
    }
}

impl Agent for RestAgent {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        match self.0.next(last, view) {
            Intent::Done(mut summary) => {
                if let Some(why) = self.0.why_missed() {
                    summary.text = why.to_owned();
                }
                Intent::Done(summary)
            }
            intent => intent,
        }
    }

    fn notes(&mut self) -> Vec<Note> {
        self.0.notes()
    }

    fn requirements(&self) -> Requirements {
        self.0.requirements()
    }

    fn export(&self) -> Snapshot {
        self.0.export()
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.0.import(from)
    }
}
