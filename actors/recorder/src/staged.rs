//! A simulated run for demonstrations and tests: a robot explores among obstacles as in a real run, but without
//! a controller.
//!
//! Motions are straight lines at constant speed, contacts come from the scene, and every contact leads to a
//! retreat along the path.

use mobee_contract::{
    CommitId, EdgeState, Entry, Event, Hold, Note, Outcome, Pose, Sink, Status, Summary, Time, WorldChange,
};
use mobee_model::{Contact, Edit, Object, ObjectClass, Robot, Scene};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// Time between two configurations.
const STEP: Duration = Duration::from_millis(50);
/// Distance at which the simulated reflex acts, meters.
const MARGIN: f64 = 0.010;
/// Number of neighbors of a vertex.
const NEIGHBORS: usize = 4;

/// Settings of a staged run.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Objects around it. The last object that is no obstacle becomes one half way through.
    pub objects: Vec<Object>,
    /// The motors that move, as indices into the robot's motors.
    pub motors: Vec<usize>,
    /// Marker whose position is drawn for each vertex.
    pub hand: String,
    /// Number of vertices of the roadmap.
    pub vertices: usize,
    /// Number of motions.
    pub motions: usize,
    /// Seed of the configurations.
    pub seed: u64,
}

/// Writes the whole run to a sink; returns the time of its end.
///
/// # Errors
/// The error of the sink, or that the scene can't be created.
pub fn play(stage: &Stage, sink: &mut dyn Sink) -> Result<Time, String> {
    let robot = Arc::clone(&stage.robot);
    let scene = Scene::new(vec![(Arc::clone(&robot), Isometry3::identity())], stage.objects.clone());
    let mut actor = Actor {
        name: robot.name.clone(),
        scene: Arc::new(scene.map_err(|e| e.to_string())?),
        q: robot.home(),
        at: Time::ZERO,
        random: stage.seed,
        commits: 0,
        states: BTreeMap::new(),
        sink,
    };
    actor.begin(stage)?;
    let poses = actor.vertices(stage)?;
    let edges = actor.edges(&poses)?;
    let mut here = 0;
    for motion in 0..stage.motions {
        if motion == stage.motions / 2 {
            actor.harden()?;
        }
        let untried = |from: u32, states: &BTreeMap<(u32, u32), EdgeState>| {
            edges.iter().copied().find(|e| e.0 == from && states.get(e) == Some(&EdgeState::Optimistic))
        };
        // An untried edge from here, otherwise any edge that was not removed.
        let next = untried(here, &actor.states).or_else(|| {
            let open: Vec<_> =
                edges.iter().filter(|e| e.0 == here && actor.states.get(e) != Some(&EdgeState::Removed)).collect();
            let pick = actor.random(open.len().max(1));
            open.get(pick).map(|e| **e)
        });
        let Some(edge) = next else { break };
        let goal = poses.get(edge.1 as usize).cloned().unwrap_or_default();
        if actor.drive(edge, &goal)? {
            here = edge.1;
        }
    }
    actor.event(Event::Note { robot: actor.name.clone(), note: Note::Plan { path: vec![] } })?;
    actor.event(Event::Done {
        robot: actor.name.clone(),
        summary: Summary { text: "staged".into(), figures: vec![] },
    })?;
    actor.event(Event::Ended { reason: "done".into() })?;
    Ok(actor.at)
}

struct Actor<'a> {
    name: String,
    scene: Arc<Scene>,
    q: Vec<f64>,
    at: Time,
    random: u64,
    commits: u64,
    states: BTreeMap<(u32, u32), EdgeState>,
    sink: &'a mut dyn Sink,
}

impl Actor<'_> {
    fn begin(&mut self, stage: &Stage) -> Result<(), String> {
        self.sink.write(self.at, &Entry::Scene(Arc::clone(&self.scene)))?;
        let config = serde_json::json!({ "staged": true });
        self.event(Event::Started { seed: stage.seed, clock: "virtual".into(), config })?;
        self.state(Status::Starting)?;
        self.stand(Duration::from_millis(500))?;
        self.state(Status::Rest)
    }

    /// Random configurations free of contact, the robot's home first.
    fn vertices(&mut self, stage: &Stage) -> Result<Vec<Vec<f64>>, String> {
        let mut poses = vec![self.q.clone()];
        for _ in 0..200 * stage.vertices {
            if poses.len() >= stage.vertices {
                break;
            }
            let mut q = self.q.clone();
            for m in &stage.motors {
                let share = 0.1 + 0.8 * self.random(1000) as f64 / 1000.0;
                if let (Some(slot), Some(motor)) = (q.get_mut(*m), stage.robot.motors.get(*m)) {
                    let (min, max) = motor.range();
                    *slot = min + share * (max - min);
                }
            }
            if self.touching(&q, 2.0 * MARGIN).is_empty() {
                poses.push(q);
            }
        }
        for (id, q) in poses.iter().enumerate() {
            let hand = stage.robot.markers_at(q).into_iter().zip(&stage.robot.markers);
            let at = hand.filter(|(_, m)| m.name == stage.hand).map(|(p, _)| p.position()).next();
            let at = at.map_or([0.0; 3], |p| p.coords.into());
            self.note(Note::Vertex { id: id as u32, q: q.clone(), at })?;
        }
        Ok(poses)
    }

    /// Edges to the nearest configurations, in both directions.
    fn edges(&mut self, poses: &[Vec<f64>]) -> Result<BTreeSet<(u32, u32)>, String> {
        let mut edges = BTreeSet::new();
        for (a, p) in poses.iter().enumerate() {
            let way = |q: &[f64]| p.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            let mut others: Vec<_> = (0..poses.len()).filter(|b| *b != a).collect();
            others.sort_by(|x, y| {
                let [x, y] = [x, y].map(|i| poses.get(*i).map_or(f64::INFINITY, |q| way(q)));
                x.total_cmp(&y)
            });
            for b in others.into_iter().take(NEIGHBORS) {
                edges.insert((a as u32, b as u32));
                edges.insert((b as u32, a as u32));
            }
        }
        for (from, to) in &edges {
            self.edge((*from, *to), EdgeState::Optimistic, None)?;
        }
        Ok(edges)
    }

    /// Drives an edge; returns true if it was feasible.
    fn drive(&mut self, edge: (u32, u32), goal: &[f64]) -> Result<bool, String> {
        self.commits += 1;
        let id = CommitId(self.commits);
        let robot = self.name.clone();
        let start = self.q.clone();
        self.note(Note::Plan { path: vec![edge.0, edge.1] })?;
        let target: Pose = goal.into();
        let agent = "explorer".into();
        let motors = Vec::new();
        self.event(Event::Commit { robot: robot.clone(), id, agent, target, escape: false, motors, stream: false })?;
        self.state(Status::Moving)?;
        let way = start.iter().zip(goal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let steps = (way / 0.02).ceil().max(1.0) as usize;
        let between = |s: usize| -> Vec<f64> {
            let share = s as f64 / steps as f64;
            start.iter().zip(goal).map(|(a, b)| a + share * (b - a)).collect()
        };
        for s in 0..=steps {
            self.q = between(s);
            let contacts = self.show()?;
            let Some(contact) = contacts.first() else { continue };
            let names = [contact.pair.0, contact.pair.1].map(|id| self.scene.shape_name(id));
            let [a, b] = names;
            let words = format!("{a} - {b}");
            let names = (a, b);
            let contact = *contact;
            let during = Status::Moving;
            self.event(Event::ContactBegan { robot: robot.clone(), contact, names: names.clone(), during })?;
            self.state(Status::Stopping)?;
            self.stand(Duration::from_millis(300))?;
            self.state(Status::Retreating)?;
            let secs = s as f64 * STEP.as_secs_f64();
            self.event(Event::RetreatBegan { robot: robot.clone(), id, poses: s, secs, near: vec![contact] })?;
            for s in (0..s).rev() {
                self.q = between(s);
                self.show()?;
            }
            self.event(Event::ContactEnded { robot: robot.clone(), names, depth: None })?;
            self.state(Status::Settling)?;
            self.stand(Duration::from_millis(400))?;
            self.outcome(id, Outcome::RolledBack, contact)?;
            self.edge(edge, EdgeState::Removed, Some(words))?;
            if self.states.get(&(edge.1, edge.0)) == Some(&EdgeState::Optimistic) {
                self.edge((edge.1, edge.0), EdgeState::Doubtful, None)?;
            }
            return Ok(false);
        }
        self.outcome(id, Outcome::Committed, Contact { pair: NO_PAIR, distance: 1.0, points: Default::default() })?;
        self.edge(edge, EdgeState::Feasible, None)?;
        Ok(true)
    }

    fn outcome(&mut self, id: CommitId, outcome: Outcome, contact: Contact) -> Result<(), String> {
        let cause = (outcome != Outcome::Committed).then(|| mobee_contract::Cause::Contact(vec![contact]));
        let q: Pose = self.q.clone().into();
        self.event(Event::Outcome { robot: self.name.clone(), id, outcome, q, safe: None, cause })?;
        self.state(Status::Rest)?;
        self.stand(Duration::from_millis(500))
    }

    /// A ghost becomes an obstacle.
    fn harden(&mut self) -> Result<(), String> {
        let ghost = self.scene.objects().filter(|(_, o)| o.class != ObjectClass::Obstacle).last();
        let Some(name) = ghost.map(|(_, o)| o.name.clone()) else { return Ok(()) };
        let edit = Edit::Class { name: name.clone(), class: ObjectClass::Obstacle };
        self.scene = Arc::new(self.scene.edit(&edit).map_err(|e| e.to_string())?);
        self.sink.write(self.at, &Entry::Scene(Arc::clone(&self.scene)))?;
        let class = Some(ObjectClass::Obstacle);
        self.event(Event::World { object: name, what: WorldChange::Changed, class, at: None })?;
        if self.touching(&self.q, MARGIN).is_empty() { Ok(()) } else { self.state(Status::Holding(Hold::InContact)) }
    }

    fn stand(&mut self, time: Duration) -> Result<(), String> {
        let end = self.at + time;
        while self.at < end {
            self.show()?;
        }
        Ok(())
    }

    /// Writes the present configuration and advances one step.
    fn show(&mut self) -> Result<Arc<[Contact]>, String> {
        let contacts: Arc<[Contact]> = self.touching(&self.q, MARGIN).into();
        let pose = Entry::Pose { robot: 0, q: self.q.clone().into(), contacts: Arc::clone(&contacts) };
        self.sink.write(self.at, &pose)?;
        self.at = self.at + STEP;
        Ok(contacts)
    }

    fn touching(&self, q: &[f64], within: f64) -> Vec<Contact> {
        self.scene.contacts(&[q], within)
    }

    fn edge(&mut self, edge: (u32, u32), state: EdgeState, cause: Option<String>) -> Result<(), String> {
        self.states.insert(edge, state);
        self.note(Note::Edge { from: edge.0, to: edge.1, state, cause })
    }

    fn note(&mut self, note: Note) -> Result<(), String> {
        self.event(Event::Note { robot: self.name.clone(), note })
    }

    fn state(&mut self, status: Status) -> Result<(), String> {
        self.event(Event::State { robot: self.name.clone(), status })
    }

    fn event(&mut self, event: Event) -> Result<(), String> {
        self.sink.write(self.at, &Entry::Event(Arc::new(event)))
    }

    /// A number below `below`, from a linear congruential generator: sufficient for a staged run.
    fn random(&mut self, below: usize) -> usize {
        self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 33) as usize % below.max(1)
    }
}

/// Placeholder for the pair of an outcome without a contact.
const NO_PAIR: mobee_model::Pair = {
    let id = mobee_model::ShapeId::Robot { robot: 0, node: 0, shape: 0 };
    (id, id)
};
