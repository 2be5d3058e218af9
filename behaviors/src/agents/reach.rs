//! The reaching agent: looks for an object, brings a hand before it over a roadmap, to it, and back (paper, section 3.3, figure 8).
//!
//! ```text
//!          seen: postures chosen, certified        at the pre-grasp          in the grasp posture      back before it
//!  Look ──────────────────────────────────> Go ───────────────────> Approach ───────────────> Back ───────────────> Home ──> Look ...
//!   ^  \                                   ^  \__ the object moved: chosen anew, the motion is led there
//!   │   └─ not seen: the eyes turn         └──── rolled back: the map has learned it, another way
//!   └── no posture, no way: a miss, with its cause
//! ```
//!
//! Where the arm goes is the [`Walker`]'s matter: postures are vertices of its map, so that a rollback, a certificate and a world that
//! changes mean here what they mean to every agent with a map. Where no way leads over the map a planner looks for one, and its
//! way-points become vertices.

mod aim;
mod choice;
mod end;
mod exhaustive;
mod follow;
mod look;
mod map;
mod settings;
mod sight;

pub use settings::{GazeSettings, ReachSettings};

use super::{open, seal};
use crate::group;
use crate::planners::JointSpace;
use crate::planners::escape::caught;
use crate::roadmap::Roadmap;
use crate::roadmap::walk::{WalkProgress, WalkStep, Walker};
use aim::Hand;
use choice::{NoChoice, Places};
use end::{Counts, Miss, Missed};
use follow::Check;
use look::{Gaze, Look, Looking};
use map::Own;
use mobee_contract::*;
use mobee_model::Robot;
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use settings::GazePlan;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// Changes of mind within one call: more would be a circle.
const TURNS: usize = 20;
/// So often in a row postures are chosen in vain before that counts as a miss, a pause apart.
const TRIES: u32 = 6;
const PAUSE: Duration = Duration::from_millis(500);
/// Plans made where no way leads to a goal, for one reach.
const PLANS: u32 = 3;
/// Postures that no way leads to, one after the other, for one reach.
const OTHERS: usize = 4;
/// Places to look at in vain before that counts as a miss: all of them twice.
const GLANCES: u32 = 26;
/// How often the way home is looked for, a second apart.
const HOMEWARD: u32 = 60;

/// What is being done: part of the agent's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Phase {
    Look,
    Go,
    Approach,
    Back,
    Home,
}

/// Where the hand is going: part of the agent's state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Place {
    /// The object's middle when it was chosen, meters.
    object: [f64; 3],
    /// The hand, among the agent's.
    #[serde(default)]
    hand: usize,
    /// The vertex that the postures were begun from.
    from: u32,
    /// Vertices of the postures.
    pre: u32,
    grasp: u32,
}

/// Reaches for an object.
pub struct ReachAgent {
    robot: Arc<Robot>,
    settings: ReachSettings,
    walker: Walker,
    /// Markers and, in their frames, the direction out of the palm.
    hands: Vec<(usize, Unit<Vector3<f64>>)>,
    palm_toward: Unit<Vector3<f64>>,
    gaze_plan: Option<GazePlan>,
    wait: Duration,
    seed: u64,
    /// Its rest posture in the map.
    rest: u32,
    /// What follows from the view: made when first asked.
    ready: Option<Ready>,
    space: Option<JointSpace>,
    /// Vertices that were told, for pictures.
    told: BTreeSet<u32>,
    mind: Mind,
}

struct Ready {
    hands: Vec<Hand>,
    gaze: Option<Gaze>,
}

/// What it has in mind: the part of its state that is no map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Mind {
    phase: Phase,
    looking: Looking,
    /// Whether the motion under way is the eyes'.
    eyes_turn: bool,
    place: Option<Place>,
    /// Choices in vain, plans made, times that the way home was looked for: of this reach.
    in_vain: u32,
    plans: u32,
    homeward: u32,
    /// Vertices from which postures were begun that no way led to, and how often the hand was brought over the object once more: of this
    /// reach.
    tried: BTreeSet<u32>,
    refined: u32,
    /// Whether the motion under way was led elsewhere, and whether one that was has been taken back, of this reach.
    #[serde(default)]
    turned: bool,
    #[serde(default)]
    bumped: bool,
    /// How often it was looked into whether the object is where it was, of this reach, and what of that is under way.
    #[serde(default)]
    checks: u32,
    #[serde(default)]
    check: Option<Check>,
    own: Own,
    /// Whether the rest posture was joined to the map.
    joined: bool,
    counts: Counts,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    map: Value,
    progress: WalkProgress,
    mind: Mind,
}

impl ReachAgent {
    /// An agent from its settings.
    ///
    /// # Errors
    /// Unknown motors and markers, positions outside the limits, numbers out of bounds, a broken map: with their path.
    pub fn new(settings: ReachSettings, context: &Context) -> Result<ReachAgent, KindError> {
        let robot = context.robot.clone();
        let map = map::begin(&settings, &robot);
        let speed = group::speed("speed", settings.speed);
        let tolerance = group::tolerance("tolerance_deg", settings.tolerance_deg);
        let wait = group::seconds("wait_s", settings.wait_s);
        let gaze = settings.gaze.as_ref().map(|gaze| gaze.plan(&robot)).transpose();
        let hands = settings.hands(&robot);
        let toward = settings.check();
        KindError::gather([
            map.as_ref().map(drop).map_err(Clone::clone),
            speed.clone().map(drop),
            tolerance.clone().map(drop),
            wait.clone().map(drop),
            gaze.as_ref().map(drop).map_err(Clone::clone),
            hands.clone().map(drop),
            toward.clone().map(drop),
        ])?;
        let (map, rest) = map?;
        let mut hands = hands?;
        if hands.is_empty() {
            hands.extend(group::hand(&robot, map.motors()));
        }
        let palm = settings.palm.map(|palm| group::direction("palm", palm)).transpose()?;
        let palm = |hand: usize| palm.or_else(|| Some(robot.markers.get(hand)?.normal));
        let hands = hands.into_iter().filter_map(|hand| Some((hand, palm(hand)?))).collect();
        let seed = settings.seed.unwrap_or(context.seed);
        let walker = Walker::new(map, speed?, tolerance?, seed).with_validation(settings.validation);
        let walker = walker.with_leaps().with_blame();
        let mind = Mind {
            phase: Phase::Look,
            looking: Looking::default(),
            eyes_turn: false,
            place: None,
            in_vain: 0,
            plans: 0,
            homeward: 0,
            tried: BTreeSet::new(),
            refined: 0,
            turned: false,
            bumped: false,
            checks: 0,
            check: None,
            own: Own::default(),
            joined: false,
            counts: Counts::default(),
        };
        Ok(ReachAgent {
            robot,
            hands,
            palm_toward: toward?,
            gaze_plan: gaze?,
            wait: wait?,
            seed,
            rest,
            ready: None,
            space: None,
            told: BTreeSet::new(),
            mind,
            walker,
            settings,
        })
    }

    /// The roadmap as it is now.
    pub fn map(&self) -> &Roadmap {
        &self.walker.map
    }

    /// Where the hand is to be for an object there.
    fn places(&self, object: Vector3<f64>) -> Places {
        let from = |mm: [f64; 3]| object + Vector3::from(mm) * 1e-3;
        Places { pre: from(self.settings.pre_grasp_mm), grasp: from(self.settings.grasp_mm) }
    }

    /// Chooses postures for an object there, begun from so many vertices, and takes them into the map.
    fn set_out(&mut self, object: Vector3<f64>, vertices: &[usize], view: &View) -> Result<u32, NoChoice> {
        let places = self.places(object);
        self.mind.counts.object = object.into();
        self.look_at_scene(view);
        let (Some(ready), Some(space)) = (&self.ready, self.space.as_mut()) else { return Err(NoChoice::OutOfReach) };
        let choice =
            choice::choose(&self.walker.map, &ready.hands, space, view, (&places, vertices, &self.mind.tried))?;
        let place = self.enter(choice, object, view);
        let pre = place.pre;
        self.mind.place = Some(place);
        self.mind.in_vain = 0;
        Ok(pre)
    }

    /// The object is seen: sets out for it. Answers what to do if that is not possible now.
    fn begin(&mut self, object: Vector3<f64>, view: &View) -> Option<Intent> {
        match self.set_out(object, &choice::VERTICES, view) {
            Ok(pre) => {
                self.mind.counts.set_out(view.at, self.mind.looking.first_seen());
                let name = self.mind.place.as_ref().and_then(|place| self.name_of(place.hand));
                let which = name.filter(|_| self.hands.len() > 1).unwrap_or("the hand");
                self.walker.log(format!("{} is seen: {which} sets out", self.settings.object));
                self.enter_phase(Phase::Go, pre);
                None
            }
            Err(why) => {
                self.mind.in_vain += 1;
                if self.mind.in_vain >= TRIES {
                    self.mind.in_vain = 0;
                    self.miss(&why.into());
                    if self.is_done() {
                        return Some(self.done("all reaches are done"));
                    }
                }
                self.mind.looking = Looking::from(view.at);
                Some(Intent::Wait(PAUSE))
            }
        }
    }

    fn enter_phase(&mut self, phase: Phase, goal: u32) {
        (self.mind.phase, self.mind.check) = (phase, None);
        self.walker.goto(goal);
    }

    fn go_home(&mut self) {
        self.mind.homeward = 0;
        self.enter_phase(Phase::Home, self.rest);
    }

    /// The robot rests at a vertex and no goal is left: what is next. `None`: to be found out by the next step.
    fn arrived(&mut self, at: u32, view: &View) -> Option<Intent> {
        let place = self.mind.place.clone();
        let goal = match (self.mind.phase, &place) {
            (Phase::Look, _) => return Some(Intent::Wait(PAUSE)),
            (Phase::Home, _) | (_, None) => self.rest,
            (Phase::Go | Phase::Back, Some(place)) => place.pre,
            (Phase::Approach, Some(place)) => place.grasp,
        };
        if at != goal {
            self.walker.goto(goal);
            return None;
        }
        match (self.mind.phase, place) {
            (Phase::Go, Some(_)) if self.has_moved(view).is_some() || self.is_gone(view) => self.look_anew(),
            (Phase::Go, Some(_)) if self.refine(view) => {}
            (Phase::Go, Some(place)) => {
                let (at, off) = self.hand_at(view);
                self.mind.counts.before(view.at, at, off);
                self.enter_phase(Phase::Approach, place.grasp);
            }
            (Phase::Approach, Some(place)) => {
                self.mind.counts.reached_by(place.hand);
                (self.mind.checks, self.mind.bumped) = (0, false);
                let count = self.mind.counts.reached;
                self.walker.log(format!("{} is reached, {count} times so far", self.settings.object));
                self.enter_phase(Phase::Back, place.pre);
                return (!self.wait.is_zero()).then_some(Intent::Wait(self.wait));
            }
            (Phase::Back, _) => self.go_home(),
            (Phase::Home, _) if self.is_done() => return Some(self.done("all reaches are done")),
            _ => {
                self.mind.phase = Phase::Look;
                self.mind.looking = Looking::from(view.at);
                self.mind.place = None;
                (self.mind.plans, self.mind.refined) = (0, 0);
                self.mind.tried.clear();
            }
        }
        None
    }

    /// Gives the motion under way up.
    fn stop(&mut self) -> Intent {
        self.mind.turned = false;
        self.walker.give_up()
    }

    /// The marker of one of its hands.
    fn name_of(&self, hand: usize) -> Option<&str> {
        let (marker, _) = self.hands.get(hand)?;
        self.robot.markers.get(*marker).map(|m| m.name.as_str())
    }

    /// The hand that goes to the object.
    fn hand(&self) -> Option<&Hand> {
        self.ready.as_ref()?.hands.get(self.mind.place.as_ref()?.hand)
    }

    /// Where the hand is, and how far that is from where it is to be before the object, as the model has both, meters.
    fn hand_at(&self, view: &View) -> ([f64; 3], f64) {
        let (Some(hand), Some(place)) = (self.hand(), &self.mind.place) else { return ([0.0; 3], 0.0) };
        let pre = self.places(Vector3::from(place.object)).pre;
        (hand.chain.at(view.pose()).at.coords.into(), hand.off(view.pose(), pre).0)
    }
}

impl Agent for ReachAgent {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        self.prepare(view);
        let mut last = last.filter(|_| !std::mem::take(&mut self.mind.eyes_turn));
        self.mind.bumped |= std::mem::take(&mut self.mind.turned) && last == Some(MotionEnd::Failed);
        for _ in 0..TURNS {
            if self.mind.phase == Phase::Look && !caught(view) {
                let gaze = self.ready.as_ref().and_then(|r| r.gaze.as_ref());
                match self.mind.looking.step(&self.settings.object, gaze, view) {
                    Look::Do(_) if self.mind.looking.glances() > GLANCES => {
                        self.mind.looking = Looking::from(view.at);
                        self.miss(&Missed { miss: Miss::Unseen, why: "it is not seen".to_owned() });
                        if self.is_done() {
                            return self.done("all reaches are done");
                        }
                    }
                    Look::Do(intent) => {
                        self.mind.eyes_turn = matches!(intent, Intent::MoveTo(_));
                        return intent;
                    }
                    Look::Seen(object) => {
                        if let Some(intent) = self.begin(object, view) {
                            return intent;
                        }
                    }
                }
            }
            let may_turn = self.mind.phase == Phase::Go && !caught(view);
            if may_turn && (self.mind.check.is_some() || self.doubts(view)) {
                self.walker.learn(last.take(), view);
                if let Some(intent) = self.check(view) {
                    return intent;
                }
            }
            if self.mind.phase == Phase::Go && (self.has_moved(view).is_some() || self.is_gone(view)) {
                let Some(pre) = self.follow(&choice::VERTICES, view) else {
                    self.look_anew();
                    continue;
                };
                self.walker.goto(pre);
            }
            let on = match self.walker.step(last.take(), view) {
                WalkStep::Do(intent) => return intent,
                WalkStep::Lost(why) => return self.lost(&why),
                WalkStep::Unreachable(goal) => self.no_way(goal, view),
                WalkStep::At(at) => self.arrived(at, view),
            };
            if let Some(intent) = on {
                return intent;
            }
        }
        Intent::Wait(Duration::from_secs(1))
    }

    fn revise(&mut self, view: &View) -> Option<Intent> {
        let goes = self.mind.phase == Phase::Go;
        if goes && self.mind.check.is_some() {
            return None;
        }
        if goes && self.doubts(view) {
            return Some(self.stop());
        }
        match self.mind.phase {
            Phase::Go | Phase::Approach if self.is_gone(view) => {
                self.look_anew();
                Some(self.stop())
            }
            Phase::Go if self.has_moved(view).is_some() => {
                // what is not found in passing is looked for at rest
                let Some(pre) = self.follow(&choice::FEW, view) else { return Some(self.stop()) };
                // a robot that moves leaves the line a little: one that was bumped by that stops first
                let straight = !self.mind.bumped && self.is_straight(pre, view);
                let turned = straight.then(|| self.walker.turn_to(pre, view)).flatten();
                self.mind.turned = turned.is_some();
                Some(turned.unwrap_or_else(|| {
                    self.walker.goto(pre);
                    self.stop()
                }))
            }
            Phase::Approach if self.has_moved(view).is_some() => {
                self.mind.phase = Phase::Go;
                Some(self.stop())
            }
            Phase::Look => None,
            _ if !self.settings.follow => None,
            _ => self.walker.revise(view),
        }
    }

    fn notes(&mut self) -> Vec<Note> {
        self.told_notes()
    }

    fn recall(&mut self, past: &[Note]) {
        self.walker.map.recall(past);
    }

    fn requirements(&self) -> Requirements {
        let gaze = self.gaze_plan.iter().flat_map(|gaze| gaze.motors.iter().copied());
        let motors: BTreeSet<usize> = self.walker.map.motors().iter().copied().chain(gaze).collect();
        let rest = self.walker.map.vertex(self.rest).filter(|_| !self.settings.rest_deg.is_empty());
        let rest = rest.map(|v| SetPose { path: "rest_deg".to_owned(), q: v.q.clone(), optional: false });
        Requirements { motors: motors.into_iter().collect(), poses: rest.into_iter().collect() }
    }

    fn export(&self) -> Snapshot {
        let (map, progress) = (self.walker.map.export(&self.robot), self.walker.progress().clone());
        seal("reach", 2, &State { map, progress, mind: self.mind.clone() })
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: State = open(&from, "reach", 2)?;
        let map = Roadmap::import(&state.map, &self.robot).map_err(group::state)?;
        let is_in = |id: u32| map.vertex(id).is_some();
        let place = state.mind.place.iter().all(|p| is_in(p.pre) && is_in(p.grasp) && p.hand < self.hands.len());
        if map.motors() != self.walker.map.motors() || !is_in(self.rest) || !place {
            let what = "map: the roadmap is one of other motors or hands, or lacks a posture".to_owned();
            return Err(Refusal::State { what });
        }
        self.walker.resume(map, state.progress);
        self.mind = state.mind;
        Ok(())
    }
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(ReachAgent::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "reach",
        doc: "Reaches for an object: turns the eyes until it is seen, brings the hand before it over a roadmap of pre-grasp poses, to it, \
              and back. When the object moves on the way it goes where that is now; when it is rolled back it takes another way.",
        schema: || schemars::schema_for!(ReachSettings),
        example: |robot| {
            let part = group::example_part(robot).map(|p| p.name.clone());
            let sweep = [group::example_pose(robot, 0.2), group::example_pose(robot, 0.0)];
            Ok(json!({
                "object": "cup", "motors": [part], "speed": 0.1,
                "gaze": { "motors": [part], "sweep_deg": sweep, "speed": 0.1 },
            }))
        },
        build,
    })
}
