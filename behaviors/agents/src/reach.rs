//! The reaching agent: looks for an object, brings a hand over a roadmap to a pre-grasp pose, to
//! the object, and back (paper, section 3.3, figure 8).
//!
//! ```text
//!          seen: postures chosen, certified        at the pre-grasp          in the grasp posture      at the pre-grasp
//!  Look ──────────────────────────────────> Go ───────────────────> Approach ───────────────> Back ───────────────> Home ──> Look ...
//!   ^  \                                   ^  \__ the object moved: new postures, the motion is redirected
//!   │   └─ not seen: the eyes turn         └──── rolled back: the map records it, another path
//!   └── no posture, no path: a miss, with its cause
//! ```
//!
//! The [`Walker`] drives the arm. Postures are vertices of its map, so rollbacks, certificates and
//! changes of the world are handled as for every agent with a map. If no path of the map leads to a
//! goal, a planner searches for one, and its waypoints become vertices.

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
use aim::ReachHand;
use choice::{HandPositions, NoChoice};
use end::{Counts, Miss, Missed};
use follow::Check;
use look::{Gaze, LookResult, Looking};
use map::Own;
use mobee_contract::*;
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::planners::JointSpace;
use mobee_planning::planners::escape::caught;
use mobee_planning::roadmap::Roadmap;
use mobee_planning::roadmap::walk::{WalkProgress, WalkStep, Walker};
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use settings::GazePlan;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// Maximum number of steps within one call: more would be a loop.
const MAX_STEPS: usize = 20;
/// Number of failed choices of postures in a row that count as a miss.
const MAX_CHOICES: u32 = 6;
/// Time between two attempts to see the object or to choose postures.
const RETRY_INTERVAL: Duration = Duration::from_millis(500);
/// Maximum number of plans, in one reach, to goals that no path of the map leads to.
const MAX_PLANS: u32 = 3;
/// Maximum number of unreachable postures, in one reach, that are replaced by others.
const MAX_OTHER_POSTURES: usize = 4;
/// Number of gaze targets without a detection that count as a miss: each of them twice.
const MAX_GLANCES: u32 = 26;
/// Maximum number of attempts to find a path home, a second apart.
const MAX_HOMEWARD: u32 = 60;

/// Phase of a reach: part of the agent's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ReachPhase {
    Look,
    Go,
    Approach,
    Back,
    Home,
}

/// Target of the hand: part of the agent's state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReachTarget {
    /// Center of the object when the target was chosen, world frame, meters.
    object: [f64; 3],
    /// Index of the hand among the agent's.
    #[serde(default)]
    hand: usize,
    /// Vertex from which the search for the postures started.
    from: u32,
    /// Vertex of the pre-grasp posture.
    pre: u32,
    /// Vertex of the grasp posture.
    grasp: u32,
}

/// Reaches for an object.
pub struct ReachAgent {
    robot: Arc<Robot>,
    settings: ReachSettings,
    walker: Walker,
    /// Marker of each hand and the direction out of its palm, in the marker's frame.
    hands: Vec<(usize, Unit<Vector3<f64>>)>,
    palm_toward: Unit<Vector3<f64>>,
    gaze_plan: Option<GazePlan>,
    wait: Duration,
    seed: u64,
    /// Vertex of the rest posture.
    rest: u32,
    /// Hands and gaze, which depend on the view: created by the first call.
    ready: Option<ReachHardware>,
    space: Option<JointSpace>,
    /// Vertices that have been noted, for drawings.
    noted: BTreeSet<u32>,
    mind: Mind,
}

struct ReachHardware {
    hands: Vec<ReachHand>,
    gaze: Option<Gaze>,
}

/// State of the agent apart from its map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Mind {
    phase: ReachPhase,
    looking: Looking,
    /// True if the motion in progress is one of the eyes.
    eyes_turn: bool,
    place: Option<ReachTarget>,
    /// Failed choices of postures in this reach.
    in_vain: u32,
    /// Plans made in this reach.
    plans: u32,
    /// Attempts to find a path home in this reach.
    homeward: u32,
    /// Start vertices, in this reach, of postures that no path led to.
    tried: BTreeSet<u32>,
    /// Number of times, in this reach, that the pre-grasp was corrected.
    refined: u32,
    /// True if the motion in progress was redirected.
    #[serde(default)]
    turned: bool,
    /// True if a redirected motion was rolled back in this reach.
    #[serde(default)]
    bumped: bool,
    /// Number of checks, in this reach, whether the object is still where it was.
    #[serde(default)]
    checks: u32,
    /// The check in progress.
    #[serde(default)]
    check: Option<Check>,
    own: Own,
    /// True if the rest posture has been joined to the map.
    joined: bool,
    counts: Counts,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReachState {
    map: Value,
    progress: WalkProgress,
    mind: Mind,
}

impl ReachAgent {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// Unknown motors and markers, positions outside the limits, numbers out of bounds and a broken
    /// map, each with its path.
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
            phase: ReachPhase::Look,
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
            noted: BTreeSet::new(),
            mind,
            walker,
            settings,
        })
    }

    /// The current roadmap.
    pub fn map(&self) -> &Roadmap {
        &self.walker.map
    }

    /// Returns the positions of the hand for an object at this position, world frame, meters.
    fn places(&self, object: Vector3<f64>) -> HandPositions {
        let from = |mm: [f64; 3]| object + Vector3::from(mm) * 1e-3;
        HandPositions { pre: from(self.settings.pre_grasp_mm), grasp: from(self.settings.grasp_mm) }
    }

    /// Chooses postures for an object at this position and adds them to the map. `vertices`: sizes
    /// of the batches of start vertices. Returns the vertex of the pre-grasp posture.
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

    /// Sets out for an object that is seen. Returns the next step if that is not possible now.
    fn begin(&mut self, object: Vector3<f64>, view: &View) -> Option<Intent> {
        match self.set_out(object, &choice::BATCHES_AT_REST, view) {
            Ok(pre) => {
                self.mind.counts.set_out(view.at, self.mind.looking.first_seen());
                let name = self.mind.place.as_ref().and_then(|place| self.name_of(place.hand));
                let which = name.filter(|_| self.hands.len() > 1).unwrap_or("the hand");
                self.walker.log(format!("{} is seen: {which} sets out", self.settings.object));
                self.enter_phase(ReachPhase::Go, pre);
                None
            }
            Err(why) => {
                self.mind.in_vain += 1;
                if self.mind.in_vain >= MAX_CHOICES {
                    self.mind.in_vain = 0;
                    self.miss(&why.into());
                    if self.is_done() {
                        return Some(self.done("all reaches are done"));
                    }
                }
                self.mind.looking = Looking::from(view.at);
                Some(Intent::Wait(RETRY_INTERVAL))
            }
        }
    }

    fn enter_phase(&mut self, phase: ReachPhase, goal: u32) {
        (self.mind.phase, self.mind.check) = (phase, None);
        self.walker.goto(goal);
    }

    fn go_home(&mut self) {
        self.mind.homeward = 0;
        self.enter_phase(ReachPhase::Home, self.rest);
    }

    /// Handles a robot that rests at a vertex without a goal. Returns the next step; `None`: the
    /// next step of the loop determines it.
    fn arrived(&mut self, at: u32, view: &View) -> Option<Intent> {
        let place = self.mind.place.clone();
        let goal = match (self.mind.phase, &place) {
            (ReachPhase::Look, _) => return Some(Intent::Wait(RETRY_INTERVAL)),
            (ReachPhase::Home, _) | (_, None) => self.rest,
            (ReachPhase::Go | ReachPhase::Back, Some(place)) => place.pre,
            (ReachPhase::Approach, Some(place)) => place.grasp,
        };
        if at != goal {
            self.walker.goto(goal);
            return None;
        }
        match (self.mind.phase, place) {
            (ReachPhase::Go, Some(_)) if self.has_moved(view).is_some() || self.is_gone(view) => self.look_anew(),
            (ReachPhase::Go, Some(_)) if self.refine(view) => {}
            (ReachPhase::Go, Some(place)) => {
                let (at, off) = self.hand_at(view);
                self.mind.counts.before(view.at, at, off);
                self.enter_phase(ReachPhase::Approach, place.grasp);
            }
            (ReachPhase::Approach, Some(place)) => {
                self.mind.counts.reached_by(place.hand);
                (self.mind.checks, self.mind.bumped) = (0, false);
                let count = self.mind.counts.reached;
                self.walker.log(format!("{} is reached, {count} times so far", self.settings.object));
                self.enter_phase(ReachPhase::Back, place.pre);
                return (!self.wait.is_zero()).then_some(Intent::Wait(self.wait));
            }
            (ReachPhase::Back, _) => self.go_home(),
            (ReachPhase::Home, _) if self.is_done() => return Some(self.done("all reaches are done")),
            _ => {
                self.mind.phase = ReachPhase::Look;
                self.mind.looking = Looking::from(view.at);
                self.mind.place = None;
                (self.mind.plans, self.mind.refined) = (0, 0);
                self.mind.tried.clear();
            }
        }
        None
    }

    /// Aborts the motion in progress.
    fn stop(&mut self) -> Intent {
        self.mind.turned = false;
        self.walker.give_up()
    }

    /// Returns the marker name of one of the agent's hands.
    fn name_of(&self, hand: usize) -> Option<&str> {
        let (marker, _) = self.hands.get(hand)?;
        self.robot.markers.get(*marker).map(|m| m.name.as_str())
    }

    /// Returns the hand that goes to the object.
    fn hand(&self) -> Option<&ReachHand> {
        self.ready.as_ref()?.hands.get(self.mind.place.as_ref()?.hand)
    }

    /// Returns the position of the hand and its distance from the pre-grasp position, by the model,
    /// meters.
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
        for _ in 0..MAX_STEPS {
            if self.mind.phase == ReachPhase::Look && !caught(view) {
                let gaze = self.ready.as_ref().and_then(|r| r.gaze.as_ref());
                match self.mind.looking.step(&self.settings.object, gaze, view) {
                    LookResult::Do(_) if self.mind.looking.glances() > MAX_GLANCES => {
                        self.mind.looking = Looking::from(view.at);
                        self.miss(&Missed { miss: Miss::Unseen, why: "it is not seen".to_owned() });
                        if self.is_done() {
                            return self.done("all reaches are done");
                        }
                    }
                    LookResult::Do(intent) => {
                        self.mind.eyes_turn = matches!(intent, Intent::MoveTo(_));
                        return intent;
                    }
                    LookResult::Seen(object) => {
                        if let Some(intent) = self.begin(object, view) {
                            return intent;
                        }
                    }
                }
            }
            let may_turn = self.mind.phase == ReachPhase::Go && !caught(view);
            if may_turn && (self.mind.check.is_some() || self.doubts(view)) {
                self.walker.learn(last.take(), view);
                if let Some(intent) = self.check(view) {
                    return intent;
                }
            }
            if self.mind.phase == ReachPhase::Go && (self.has_moved(view).is_some() || self.is_gone(view)) {
                let Some(pre) = self.follow(&choice::BATCHES_AT_REST, view) else {
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
        let goes = self.mind.phase == ReachPhase::Go;
        if goes && self.mind.check.is_some() {
            return None;
        }
        if goes && self.doubts(view) {
            return Some(self.stop());
        }
        match self.mind.phase {
            ReachPhase::Go | ReachPhase::Approach if self.is_gone(view) => {
                self.look_anew();
                Some(self.stop())
            }
            ReachPhase::Go if self.has_moved(view).is_some() => {
                // A posture that is not found during the motion is searched for at rest.
                let Some(pre) = self.follow(&choice::BATCHES_MOVING, view) else { return Some(self.stop()) };
                // A moving robot deviates slightly from the line: after a redirected motion was
                // rolled back, stop first.
                let straight = !self.mind.bumped && self.is_straight(pre, view);
                let turned = straight.then(|| self.walker.turn_to(pre, view)).flatten();
                self.mind.turned = turned.is_some();
                Some(turned.unwrap_or_else(|| {
                    self.walker.goto(pre);
                    self.stop()
                }))
            }
            ReachPhase::Approach if self.has_moved(view).is_some() => {
                self.mind.phase = ReachPhase::Go;
                Some(self.stop())
            }
            ReachPhase::Look => None,
            _ if !self.settings.follow => None,
            _ => self.walker.revise(view),
        }
    }

    fn notes(&mut self) -> Vec<Note> {
        self.pending_notes()
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
        let map = self.walker.map.export(&self.robot);
        let progress = self.walker.progress().clone();
        seal("reach", 2, &ReachState { map, progress, mind: self.mind.clone() })
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: ReachState = open(&from, "reach", 2)?;
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
        doc: "Reaches for an object: turns the eyes until it is detected, brings the hand over a roadmap to \
              a pre-grasp pose, to the object, and back. If the object moves during a reach, the motion is \
              redirected; after a rollback another path is taken.",
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
