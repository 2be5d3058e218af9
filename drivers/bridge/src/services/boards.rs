//! The filter's shell: a control board in front of each part of a robot.

use super::YarpSettings;
use crate::filter::{BoardReply, Client, FilterCore, Question, Seen, Step, closed};
use crate::yarp;
use mobee_contract::{CommitId, Filtered, NativeMessage, Refusal, Running, Status, Verdict};
use mobee_model::Robot;
use mobee_yarp::board::{BoardServer, Device, Reply, Units};
use mobee_yarp::{Bottle, Dialect, JointData, Message, Network, Payload, PortError, Stamp};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// How often, and after which pauses, a motion is tried again while the robot is about to be ready.
const PATIENCE: (usize, Duration) = (30, Duration::from_millis(10));
/// How often, with the same pauses, a robot that is still starting is asked again: a program may connect as soon as it finds the port.
const STARTING: usize = 200;
/// How many streamed commands may wait; more are dropped, since each one replaces the one before.
const WAITING: usize = 64;

/// The filtered boards of one robot, open until closed or dropped.
pub(crate) struct Boards {
    servers: Vec<BoardServer>,
    tasks: Vec<JoinHandle<()>>,
}

impl Boards {
    /// Opens a board for every part that has a port prefix.
    ///
    /// # Errors
    /// A port that can't be opened; those opened before are closed again.
    pub(crate) async fn open(
        network: &Network,
        running: &Arc<dyn Running>,
        filtered: &Arc<dyn Filtered>,
        model: &Robot,
        prefixes: &[Option<String>],
        settings: &YarpSettings,
    ) -> Result<Boards, PortError> {
        let period = settings.period();
        let core = FilterCore::new(filtered.name(), model, filtered.board(), &filtered.latest().q, settings.speed);
        let robot = Arc::new(RobotFilter {
            filtered: filtered.clone(),
            running: running.clone(),
            core: Mutex::new(core),
            network: network.clone(),
        });
        let mut boards = Boards { servers: Vec::new(), tasks: Vec::new() };
        for ((index, part), prefix) in model.parts.iter().enumerate().zip(prefixes) {
            let Some(prefix) = prefix else { continue };
            let (jobs, waiting) = mpsc::channel(WAITING);
            let units = robot.with(|core, _| yarp::board::units(core.board(index)));
            let (robot, name) = (robot.clone(), part.name.clone());
            let part = Arc::new(PartFilter { robot, index, name, units, answers: Mutex::default() });
            let device = Arc::new(PartDevice { part: part.clone(), jobs, published: Mutex::default() });
            match BoardServer::open(network, prefix, device, period).await {
                Ok(server) => boards.servers.push(server),
                Err(error) => {
                    boards.close().await;
                    return Err(error);
                }
            }
            boards.tasks.push(tokio::spawn(part.clone().give_on(waiting)));
            boards.tasks.push(tokio::spawn(part.learn()));
        }
        Ok(boards)
    }

    /// Closes the ports.
    pub(crate) async fn close(self) {
        for task in &self.tasks {
            task.abort();
        }
        for server in self.servers {
            server.close().await;
        }
    }
}

/// One robot's filter: the core, and what it needs to know of the run.
struct RobotFilter {
    filtered: Arc<dyn Filtered>,
    running: Arc<dyn Running>,
    core: Mutex<FilterCore>,
    network: Network,
}

impl RobotFilter {
    /// Asks the core, with what is known of the robot now.
    fn with<T>(&self, f: impl FnOnce(&mut FilterCore, &Seen) -> T) -> T {
        let latest = self.filtered.latest();
        let end_of = |id: CommitId| self.filtered.end_of(id);
        let to_blame = |id: CommitId| self.filtered.to_blame(id);
        let now = self.running.now();
        let seen = Seen { now, status: latest.status, q: &latest.q, end_of: &end_of, to_blame: &to_blame };
        let mut core = self.core.lock().unwrap_or_else(PoisonError::into_inner);
        core.sense(latest.at, &latest.q, latest.status);
        f(&mut core, &seen)
    }
}

/// One part of it.
struct PartFilter {
    robot: Arc<RobotFilter>,
    index: usize,
    name: String,
    /// What its joints count on the wire.
    units: Units,
    /// The stamp of the last answer given on the board's behalf.
    answers: Mutex<Stamp>,
}

impl PartFilter {
    async fn rpc(self: Arc<Self>, message: Message) -> Payload {
        let dialect = self.robot.network.dialect();
        self.started().await;
        let client = Client {
            part: self.index,
            connection: message.connection,
            from: &message.from,
            listens: message.wants_reply,
        };
        // what is no bottle is answered as what is unknown
        let request = message.payload.bottle(dialect).unwrap_or_else(|_| Bottle::of(["", ""]));
        let asked = yarp::board::parse(&request, &self.units);
        let (failed, step) =
            self.robot.with(|core, seen| (core.has_failed(&client, seen), core.request(&client, &asked, seen)));
        match &step {
            Step::Reply(reply) => self.explained(*reply, failed, None).into(),
            Step::Question(question) => self.ask(&client, question, &message, &request).await,
            Step::Commit(_) | Step::Stream(_) | Step::Stop => {
                let (reply, refusal) = self.act(&client, &step).await;
                self.explained(reply, false, refusal).into()
            }
        }
    }

    /// A reply, which says why if it is a refusal that the client could not foresee. What no board takes is refused as a board
    /// does it.
    fn explained(&self, reply: BoardReply, failed: bool, refusal: Option<Refusal>) -> Bottle {
        let bottle = yarp::board::reply(reply);
        if reply != BoardReply::Refused {
            return bottle;
        }
        let latest = self.robot.filtered.latest();
        let scene = self.robot.running.scene();
        let met = latest.contacts.first().map(|c| [c.pair.0, c.pair.1].map(|shape| scene.shape_name(shape)));
        match in_words(latest.status, met, failed, refusal) {
            Some(why) => bottle.with(why),
            None => bottle,
        }
    }

    /// Waits a while for a robot that is still starting; after that its filter counts as closed.
    async fn started(&self) {
        for _ in 0..STARTING {
            if self.robot.filtered.latest().status != Status::Starting {
                return;
            }
            tokio::time::sleep(PATIENCE.1).await;
        }
    }

    /// Passes a question on, and its answer back.
    async fn ask(&self, client: &Client<'_>, question: &Question, message: &Message, request: &Bottle) -> Payload {
        let dialect = self.robot.network.dialect();
        let words = message.payload.binary(dialect).map(|b| b.to_vec()).unwrap_or_default();
        let Some(answer) = self.robot.filtered.passthrough(&self.name, NativeMessage(words)) else {
            return self.answer(client, question, request).into();
        };
        let replied = tokio::time::timeout(self.robot.network.timeout(), answer).await;
        let known = match self.robot.with(|core, seen| core.knows_better(client, question, seen)) {
            Ok(known) => known,
            Err(reply) => return self.explained(reply, true, None).into(),
        };
        // what is no bottle is no answer
        let answer = replied.ok().and_then(Result::ok).map(|answer| answer.0);
        match answer.and_then(|bytes| Some((Bottle::decode(&bytes, dialect).ok()?, bytes))) {
            Some((bottle, bytes)) => {
                yarp::board::corrected(&known, &bottle).map_or_else(|| bytes.into(), |corrected| corrected.into())
            }
            None => yarp::board::reply(BoardReply::Refused).into(),
        }
    }

    /// Answers a question on behalf of a board that has no protocol of its own.
    fn answer(&self, client: &Client<'_>, question: &Question, request: &Bottle) -> Bottle {
        let known = self.robot.with(|core, seen| match core.knows_better(client, question, seen) {
            Ok(known) => {
                let mut stamp = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
                *stamp = stamp.next(self.robot.running.time_of_day(seen.now));
                Ok(yarp::board::answer(core.board(self.index), &known, request, *stamp))
            }
            Err(reply) => Err(reply),
        });
        known.unwrap_or_else(|reply| self.explained(reply, true, None))
    }

    /// Moves or stops the robot: the reply, and why it is none.
    async fn act(&self, client: &Client<'_>, step: &Step) -> (BoardReply, Option<Refusal>) {
        let filtered = &self.robot.filtered;
        let agent = self.robot.with(|core, _| core.agent());
        let verdict: Verdict = match step {
            Step::Commit(commit) => self.patiently(|| filtered.commit(commit.clone())).await,
            Step::Stream(setpoints) => self.patiently(|| filtered.stream(agent.clone(), setpoints.clone())).await,
            Step::Stop => {
                filtered.stop(agent);
                return (BoardReply::Accepted, None);
            }
            Step::Reply(_) | Step::Question(_) => return (BoardReply::Refused, None),
        };
        if let Err(refusal) = &verdict {
            tracing::debug!(part = self.name, from = client.from, %refusal, "a motion was refused");
        }
        (self.robot.with(|core, seen| core.accepted(client, step, &verdict, seen)), verdict.err())
    }

    /// Tries again for a moment while the robot is not ready: it may only just have come to rest.
    async fn patiently(&self, mut attempt: impl FnMut() -> mobee_contract::Answer<Verdict>) -> Verdict {
        let mut verdict = attempt().await;
        for _ in 0..PATIENCE.0 {
            let soon = matches!(verdict, Err(Refusal::NotReady { .. }));
            if !soon || closed(self.robot.filtered.latest().status) {
                break;
            }
            tokio::time::sleep(PATIENCE.1).await;
            verdict = attempt().await;
        }
        verdict
    }

    /// Passes streamed commands on, in order.
    async fn give_on(self: Arc<Self>, mut waiting: mpsc::Receiver<Job>) {
        while let Some(job) = waiting.recv().await {
            let client = Client { part: self.index, connection: job.connection, from: &job.from, listens: false };
            self.act(&client, &job.step).await;
        }
    }

    /// Reads the reference speeds that the real board has, as soon as it answers.
    async fn learn(self: Arc<Self>) {
        let dialect = self.robot.network.dialect();
        let read = |code: &'static str| {
            let words = Bottle::of([mobee_yarp::Vocab::new("get"), mobee_yarp::Vocab::new(code)]).encode(dialect);
            self.robot.filtered.passthrough(&self.name, NativeMessage(words))
        };
        loop {
            let (Some(speeds), Some(accelerations)) = (read("vels"), read("accs")) else { return };
            if let (Ok(speeds), Ok(accelerations)) = (speeds.await, accelerations.await) {
                let values = |bytes: &[u8]| yarp::board::references(&Bottle::decode(bytes, dialect).ok()?, &self.units);
                let (speeds, accelerations) = (values(&speeds.0), values(&accelerations.0));
                self.robot.with(|core, _| {
                    core.learn(self.index, &speeds.unwrap_or_default(), &accelerations.unwrap_or_default());
                });
                return;
            }
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    }
}

/// Why a robot in this state refuses a request, if that is not the request's own fault: what its last motion met, whether the
/// client has yet to learn that its motion failed, and what was said to a motion.
fn in_words(status: Status, met: Option<[String; 2]>, failed: bool, refusal: Option<Refusal>) -> Option<String> {
    let met = || met.as_ref().map_or_else(|| "the motion was stopped".into(), |[a, b]| format!("{a} touched {b}"));
    Some(match status {
        Status::Stopping | Status::Retreating | Status::Settling => {
            format!("rolled back: {}, retreat until the robot is at rest again", met())
        }
        Status::Starting => "the robot is not ready yet: its filter opens once it is at rest".into(),
        Status::Holding(hold) if closed(status) || failed => format!("the robot holds: {hold}"),
        Status::Rest | Status::Moving | Status::Escaping if failed => {
            format!("rolled back: {}; the retreat is over, plan anew from where the robot is", met())
        }
        Status::Rest | Status::Moving | Status::Escaping | Status::Holding(_) => refusal?.to_string(),
    })
}

/// A streamed command on its way.
struct Job {
    connection: u64,
    from: String,
    step: Step,
}

/// What stands behind a part's four ports.
struct PartDevice {
    part: Arc<PartFilter>,
    jobs: mpsc::Sender<Job>,
    published: Mutex<(Stamp, Option<u64>)>,
}

impl Device for PartDevice {
    fn rpc(&self, request: Message) -> Reply {
        Box::pin(self.part.clone().rpc(request))
    }

    fn command(&self, from: &str, connection: u64, head: Bottle, body: Vec<f64>) {
        let client = Client { part: self.part.index, connection, from, listens: false };
        let asked = yarp::board::streamed(&head, &body, &self.part.units);
        let step = self.part.robot.with(|core, seen| core.streamed(&client, &asked, seen));
        if let Some(step) = step
            && self.jobs.try_send(Job { connection, from: from.to_owned(), step }).is_err()
        {
            tracing::debug!(part = self.part.name, from, "a streamed command was dropped: they come too quickly");
        }
    }

    fn state(&self) -> Option<(Stamp, JointData)> {
        let (robot, index) = (&self.part.robot, self.part.index);
        let told = robot.filtered.native_state(&self.part.name);
        let at = robot.filtered.latest().at;
        let seq = told.as_ref().map_or(at.0, |told| told.seq);
        let mut published = self.published.lock().unwrap_or_else(PoisonError::into_inner);
        // no new reading, no message: a client then sees that the robot is silent
        if published.1.replace(seq) == Some(seq) {
            return None;
        }
        published.0 = match told.as_ref().and_then(|told| told.stamp) {
            Some((count, time)) => Stamp { count, time },
            None => published.0.next(robot.running.time_of_day(at)),
        };
        let told = told.and_then(|told| JointData::decode(&told.message.0, Dialect::V3).ok());
        let state = robot.with(|core, _| yarp::board::state(core.board(index), told));
        Some((published.0, state))
    }

    fn gone(&self, connection: u64) {
        self.part.robot.with(|core, _| core.gone(connection));
    }
}
