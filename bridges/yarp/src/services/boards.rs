//! Service of the filter: a control board in front of each part of a robot.

use super::YarpSettings;
use mobee_contract::{CommitId, Filtered, NativeMessage, Refusal, Running, Status, Verdict};
use mobee_filter::filter::{BoardClient, BoardReply, FilterCore, FilterDecision, Question, RobotSnapshot, closed};
use mobee_model::Robot;
use mobee_yarp::board::{BoardServer, Device, Reply, Units};
use mobee_yarp::{Bottle, Dialect, JointData, Message, Network, Payload, PortError, Stamp};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// Number of retries of a motion while the robot is about to be ready, and the pause between them.
const RETRIES: (usize, Duration) = (30, Duration::from_millis(10));
/// Number of retries, with the same pauses, for a robot that is still starting: a program may connect as soon
/// as it finds the port.
const STARTING: usize = 200;
/// Number of streamed commands that may wait; more are dropped, since each one replaces the one before.
const WAITING: usize = 64;

/// Filtered boards of one robot, open until closed or dropped.
pub(crate) struct FilteredBoards {
    servers: Vec<BoardServer>,
    tasks: Vec<JoinHandle<()>>,
}

impl FilteredBoards {
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
    ) -> Result<FilteredBoards, PortError> {
        let period = settings.period();
        let core = FilterCore::new(filtered.name(), model, filtered.board(), &filtered.latest().q, settings.speed);
        let robot = Arc::new(RobotFilter {
            filtered: filtered.clone(),
            running: running.clone(),
            core: Mutex::new(core),
            network: network.clone(),
        });
        let mut boards = FilteredBoards { servers: Vec::new(), tasks: Vec::new() };
        for ((index, part), prefix) in model.parts.iter().enumerate().zip(prefixes) {
            let Some(prefix) = prefix else { continue };
            let (jobs, waiting) = mpsc::channel(WAITING);
            let units = robot.with(|core, _| crate::board::units(core.board(index)));
            let robot = robot.clone();
            let name = part.name.clone();
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

/// Filter of one robot: the core, and its access to the run.
struct RobotFilter {
    filtered: Arc<dyn Filtered>,
    running: Arc<dyn Running>,
    core: Mutex<FilterCore>,
    network: Network,
}

impl RobotFilter {
    /// Calls the core with the present state of the robot.
    fn with<T>(&self, f: impl FnOnce(&mut FilterCore, &RobotSnapshot) -> T) -> T {
        let latest = self.filtered.latest();
        let end_of = |id: CommitId| self.filtered.end_of(id);
        let to_blame = |id: CommitId| self.filtered.to_blame(id);
        let now = self.running.now();
        let seen = RobotSnapshot { now, status: latest.status, q: &latest.q, end_of: &end_of, to_blame: &to_blame };
        let mut core = self.core.lock().unwrap_or_else(PoisonError::into_inner);
        core.sense(latest.at, &latest.q, latest.status);
        f(&mut core, &seen)
    }
}

/// Filter of one part.
struct PartFilter {
    robot: Arc<RobotFilter>,
    index: usize,
    name: String,
    /// Units of its joints on the wire.
    units: Units,
    /// Stamp of the last answer given on behalf of the board.
    answers: Mutex<Stamp>,
}

impl PartFilter {
    async fn rpc(self: Arc<Self>, message: Message) -> Payload {
        let dialect = self.robot.network.dialect();
        self.started().await;
        let client = BoardClient {
            part: self.index,
            connection: message.connection,
            from: &message.from,
            listens: message.wants_reply,
        };
        // a message that is not a bottle is answered like an unknown request
        let request = message.payload.bottle(dialect).unwrap_or_else(|_| Bottle::of(["", ""]));
        let parsed = crate::board::parse(&request, &self.units);
        let (failed, step) =
            self.robot.with(|core, seen| (core.has_failed(&client, seen), core.request(&client, &parsed, seen)));
        match &step {
            FilterDecision::Reply(reply) => self.explained(*reply, failed, None).into(),
            FilterDecision::Question(question) => self.query(&client, question, &message, &request).await,
            FilterDecision::Commit(_) | FilterDecision::Stream(_) | FilterDecision::Stop => {
                let (reply, refusal) = self.act(&client, &step).await;
                self.explained(reply, false, refusal).into()
            }
        }
    }

    /// Encodes a reply. A refusal that the client could not foresee includes the reason; a request that no
    /// board accepts is refused without one, as boards do.
    fn explained(&self, reply: BoardReply, failed: bool, refusal: Option<Refusal>) -> Bottle {
        let bottle = crate::board::reply(reply);
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

    /// Waits for a robot that is still starting, for a limited time; after that its filter counts as closed.
    async fn started(&self) {
        for _ in 0..STARTING {
            if self.robot.filtered.latest().status != Status::Starting {
                return;
            }
            tokio::time::sleep(RETRIES.1).await;
        }
    }

    /// Passes a query on to the board, and its answer back.
    async fn query(
        &self,
        client: &BoardClient<'_>,
        question: &Question,
        message: &Message,
        request: &Bottle,
    ) -> Payload {
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
        // an answer that is not a bottle is discarded
        let answer = replied.ok().and_then(Result::ok).map(|answer| answer.0);
        match answer.and_then(|bytes| Some((Bottle::decode(&bytes, dialect).ok()?, bytes))) {
            Some((bottle, bytes)) => {
                crate::board::corrected(&known, &bottle).map_or_else(|| bytes.into(), |corrected| corrected.into())
            }
            None => crate::board::reply(BoardReply::Refused).into(),
        }
    }

    /// Answers a query on behalf of a board that has no protocol of its own.
    fn answer(&self, client: &BoardClient<'_>, question: &Question, request: &Bottle) -> Bottle {
        let known = self.robot.with(|core, seen| match core.knows_better(client, question, seen) {
            Ok(known) => {
                let mut stamp = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
                *stamp = stamp.next(self.robot.running.time_of_day(seen.now));
                Ok(crate::board::answer(core.board(self.index), &known, request, *stamp))
            }
            Err(reply) => Err(reply),
        });
        known.unwrap_or_else(|reply| self.explained(reply, true, None))
    }

    /// Moves or stops the robot. Returns the reply, and the reason of a refusal.
    async fn act(&self, client: &BoardClient<'_>, step: &FilterDecision) -> (BoardReply, Option<Refusal>) {
        let filtered = &self.robot.filtered;
        let agent = self.robot.with(|core, _| core.agent());
        let verdict: Verdict = match step {
            FilterDecision::Commit(commit) => self.patiently(|| filtered.commit(commit.clone())).await,
            FilterDecision::Stream(setpoints) => {
                self.patiently(|| filtered.stream(agent.clone(), setpoints.clone())).await
            }
            FilterDecision::Stop => {
                filtered.stop(agent);
                return (BoardReply::Accepted, None);
            }
            FilterDecision::Reply(_) | FilterDecision::Question(_) => return (BoardReply::Refused, None),
        };
        if let Err(refusal) = &verdict {
            tracing::debug!(part = self.name, from = client.from, %refusal, "a motion was refused");
        }
        (self.robot.with(|core, seen| core.accepted(client, step, &verdict, seen)), verdict.err())
    }

    /// Retries for a moment while the robot is not ready, because it may have only just come to rest.
    async fn patiently(&self, mut attempt: impl FnMut() -> mobee_contract::Answer<Verdict>) -> Verdict {
        let mut verdict = attempt().await;
        for _ in 0..RETRIES.0 {
            let soon = matches!(verdict, Err(Refusal::NotReady { .. }));
            if !soon || closed(self.robot.filtered.latest().status) {
                break;
            }
            tokio::time::sleep(RETRIES.1).await;
            verdict = attempt().await;
        }
        verdict
    }

    /// Passes streamed commands on, in order.
    async fn give_on(self: Arc<Self>, mut waiting: mpsc::Receiver<StreamedCommand>) {
        while let Some(job) = waiting.recv().await {
            let client = BoardClient { part: self.index, connection: job.connection, from: &job.from, listens: false };
            self.act(&client, &job.step).await;
        }
    }

    /// Reads the reference speeds of the real board, as soon as it answers.
    async fn learn(self: Arc<Self>) {
        let dialect = self.robot.network.dialect();
        let read = |code: &'static str| {
            let words = Bottle::of([mobee_yarp::Vocab::new("get"), mobee_yarp::Vocab::new(code)]).encode(dialect);
            self.robot.filtered.passthrough(&self.name, NativeMessage(words))
        };
        loop {
            let (Some(speeds), Some(accelerations)) = (read("vels"), read("accs")) else { return };
            if let (Ok(speeds), Ok(accelerations)) = (speeds.await, accelerations.await) {
                let values =
                    |bytes: &[u8]| crate::board::references(&Bottle::decode(bytes, dialect).ok()?, &self.units);
                let speeds = values(&speeds.0);
                let accelerations = values(&accelerations.0);
                self.robot.with(|core, _| {
                    core.learn(self.index, &speeds.unwrap_or_default(), &accelerations.unwrap_or_default());
                });
                return;
            }
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    }
}

/// Reason why a robot in this state refuses a request, unless the request itself is at fault. `met` is the
/// contact of its last motion, `failed` is true if the client has not been informed that its motion failed,
/// and `refusal` is the verdict on a motion.
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

/// A streamed command in transit.
struct StreamedCommand {
    connection: u64,
    from: String,
    step: FilterDecision,
}

/// Device behind a part's four ports.
struct PartDevice {
    part: Arc<PartFilter>,
    jobs: mpsc::Sender<StreamedCommand>,
    published: Mutex<(Stamp, Option<u64>)>,
}

impl Device for PartDevice {
    fn rpc(&self, request: Message) -> Reply {
        Box::pin(self.part.clone().rpc(request))
    }

    fn command(&self, from: &str, connection: u64, head: Bottle, body: Vec<f64>) {
        let client = BoardClient { part: self.part.index, connection, from, listens: false };
        let parsed = crate::board::streamed(&head, &body, &self.part.units);
        let step = self.part.robot.with(|core, seen| core.streamed(&client, &parsed, seen));
        if let Some(step) = step
            && self.jobs.try_send(StreamedCommand { connection, from: from.to_owned(), step }).is_err()
        {
            tracing::debug!(part = self.part.name, from, "a streamed command was dropped: they come too quickly");
        }
    }

    fn state(&self) -> Option<(Stamp, JointData)> {
        let robot = &self.part.robot;
        let index = self.part.index;
        let native = robot.filtered.native_state(&self.part.name);
        let at = robot.filtered.latest().at;
        let seq = native.as_ref().map_or(at.0, |native| native.seq);
        let mut published = self.published.lock().unwrap_or_else(PoisonError::into_inner);
        // without a new reading nothing is published, so that a client detects a silent robot
        if published.1.replace(seq) == Some(seq) {
            return None;
        }
        published.0 = match native.as_ref().and_then(|native| native.stamp) {
            Some((count, time)) => Stamp { count, time },
            None => published.0.next(robot.running.time_of_day(at)),
        };
        let native = native.and_then(|native| JointData::decode(&native.message.0, Dialect::V3).ok());
        let state = robot.with(|core, _| crate::board::state(core.board(index), native));
        Some((published.0, state))
    }

    fn gone(&self, connection: u64) {
        self.part.robot.with(|core, _| core.gone(connection));
    }
}
