//! Handler of requests at the control port.

use super::swap_offer::{BridgeRef, BridgeRequest, BuiltPart, DetectorRequest, LocatorRequest, PartRequest};
use super::wire::{Reply, Request, SentConfig};
use super::{show, swap_offer};
use crate::narrate::{fresh_remedy, swap_step_text};
use crate::run::{LogBook, Recording};
use mobee_bridge_yarp::WorldService;
use mobee_contract::{Running, SwapPart, SwapStep};
use mobee_model::Labels;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{Control, SystemReport};
use mobee_yarp::{Bottle, Dialect, Text, Value, Vocab};
use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// Time in which the system must reply. A swap is built and checked within its own budget.
pub(super) const SYSTEM_TIMEOUT: Duration = Duration::from_secs(30);

/// Default address of a viewer.
const DEFAULT_VIEWER: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 9876);

/// The reply while the run ends; the farewell follows.
pub(super) const ENDING: &str = "the run is ending";

/// The names of the run's swappable parts that do not belong to its robots.
#[derive(Clone, Debug, Default)]
pub(crate) struct BesideNames {
    /// The bridges.
    pub(crate) bridges: Vec<String>,
    /// The cameras, each as `<sensor>/<camera>`.
    pub(crate) cameras: Vec<String>,
}

/// Handles requests.
pub(super) struct RequestHandler {
    pub(super) running: Arc<dyn Running>,
    world: Arc<WorldService>,
    controls: mpsc::Sender<Control>,
    recording: Arc<Recording>,
    pub(super) beside: BesideNames,
    /// The newest events as sentences.
    pub(super) log: LogBook,
    /// The last report, from which rates are computed.
    before: Mutex<Option<SystemReport>>,
}

const HELP: &str = "Commands: status; swap ROBOT agent|controller|driver [SHADOW_S PROBATION_S BUDGET_S [fresh]]; \
                    swap NAME bridge [0 PROBATION_S BUDGET_S]; swap SENSOR[/CAMERA] detector [SHADOW_S PROBATION_S BUDGET_S [fresh]]; swap SENSOR locator [0 PROBATION_S BUDGET_S [fresh]]; swapped NAME PART; pause|resume|recover|halt|release|pose [ROBOT]; go ROBOT SPEED MOTOR=DEG...; home ROBOT SPEED; restart [NAME]; ended ROBOT ID; brake ROBOT; log last|from N; stop [now]; world ...; \
                    record on|off|connect [ADDRESS].";

impl RequestHandler {
    /// A handler for a running system: `controls` sends to the system, `beside` are the names of the parts that do not
    /// belong to its robots.
    pub(super) fn new(
        running: Arc<dyn Running>,
        controls: mpsc::Sender<Control>,
        recording: Arc<Recording>,
        beside: BesideNames,
        log: LogBook,
    ) -> Arc<RequestHandler> {
        let world = Arc::new(WorldService::new(running.clone(), None));
        Arc::new(RequestHandler { running, world, controls, recording, beside, log, before: Mutex::new(None) })
    }

    /// Keeps grabbed objects at their markers; never returns.
    pub(super) async fn follow(&self) {
        self.world.clone().follow().await;
    }

    /// Handles one request.
    pub(super) async fn reply(&self, request: Request) -> Reply {
        let (done, lines) = match self.answer(request).await {
            Ok(lines) => (true, lines),
            Err(why) => (false, vec![why]),
        };
        // replies show labels of shapes in place of their names
        let labels = Labels::new(self.running.scene().robots());
        let lines = lines.into_iter().map(|line| labels.read(&line).into_owned()).collect();
        Reply { done, lines, over: false }
    }

    async fn answer(&self, request: Request) -> Result<Vec<String>, String> {
        let Request { words, offer } = request;
        // the words get into the journal and onto the run's terminal
        let name = offer.as_ref().map(|o| o.file.to_string_lossy().into_owned());
        if words.iter().chain(&name).any(|w| w.chars().any(char::is_control)) {
            return Err("this contains control characters; use plain text".into());
        }
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        match words.as_slice() {
            ["status"] => self.status().await,
            ["swap", robot, part, rest @ ..] => {
                let sent =
                    offer.ok_or("the configuration was not sent along; use `mobee ctl` of the run's own version")?;
                self.swap(robot, part, sent, rest).await
            }
            ["swapped", robot, part] => self.swapped(robot, part).await,
            [verb @ ("pause" | "resume"), rest @ ..] => self.act(rest, *verb == "resume"),
            ["recover", rest @ ..] => {
                let all = self.running.robots();
                let selected: Vec<_> = self.robots(rest)?.iter().filter_map(|i| all.get(*i)).collect();
                let mut lines = Vec::new();
                let mut tried = false;
                for robot in selected {
                    let answer = robot.recover();
                    tried |= answer.is_ok();
                    let answer = answer.map_or_else(|why| why, |()| "the retreat is being retried".into());
                    lines.push(format!("{}: {answer}", robot.name()));
                }
                if tried { Ok(lines) } else { Err(lines.join("\n")) }
            }
            ["restart", name @ ..] => self.restart(name).await,
            ["halt", rest @ ..] => self.halt(rest).await,
            ["release", rest @ ..] => self.release(rest),
            ["pose", rest @ ..] => self.pose(rest),
            ["go", robot, speed, motors @ ..] => self.go(robot, speed, motors).await,
            ["home", robot, speed] => self.home(robot, speed).await,
            ["ended", robot, id] => self.ended(robot, id).await,
            ["brake", robot] => self.brake(robot),
            ["log", which @ ("last" | "from"), number] => self.lines_of_log(which, number),
            ["stop"] => self.send(Control::Stop).await.map(|()| vec!["the run ends".into()]),
            ["stop", "now"] => self.send(Control::Abort).await.map(|()| vec!["the run ends now".into()]),
            ["world", words @ ..] => {
                let request = Bottle::parse(words.join(" "), Dialect::V3).map_err(|e| e.to_string())?;
                let reply = mobee_bridge_yarp::world::judged(&self.world, &request).await;
                let lines = |reply: &Bottle| match reply.0.as_slice() {
                    // one element per line, as YARP's own programs print it
                    [Value::Vocab(many), lines @ ..] if *many == Vocab::new("many") => lines.iter().map(word).collect(),
                    words => vec![words.iter().map(word).collect::<Vec<_>>().join(" ")],
                };
                reply.map(|reply| lines(&reply)).map_err(|refused| lines(&refused).join("\n"))
            }
            ["record", what @ ("on" | "off")] => {
                self.recording.switch(*what == "on").map(|()| vec![format!("the recording is {what}")])
            }
            ["record", "connect", address @ ..] => self.connect(address).await,
            ["record", ..] => Err("say `record on`, `record off` or `record connect [ADDRESS:PORT]`".into()),
            _ => Err(HELP.into()),
        }
    }

    pub(super) async fn send(&self, control: Control) -> Result<(), String> {
        let sent = tokio::time::timeout(SYSTEM_TIMEOUT, self.controls.send(control)).await;
        sent.map_err(|_| "the run does not answer".to_owned())?.map_err(|_| ENDING.to_owned())
    }

    pub(super) async fn report(&self) -> Result<SystemReport, String> {
        let (reply, report) = oneshot::channel();
        self.send(Control::Status(reply)).await?;
        let report = tokio::time::timeout(SYSTEM_TIMEOUT, report).await;
        report.map_err(|_| "the run does not answer".to_owned())?.map_err(|_| ENDING.into())
    }

    async fn status(&self) -> Result<Vec<String>, String> {
        let mut before = self.before.lock().unwrap_or_else(PoisonError::into_inner).take();
        if before.is_none() {
            before = Some(self.report().await?);
            tokio::time::sleep(Duration::from_millis(300)).await;
        }
        let now = self.report().await?;
        let lines = show::lines(&now, before.as_ref());
        *self.before.lock().unwrap_or_else(PoisonError::into_inner) = Some(now);
        Ok(lines)
    }

    /// The indices of the named robot, or of all robots.
    pub(super) fn robots(&self, names: &[&str]) -> Result<Vec<usize>, String> {
        let all = self.running.robots();
        match names {
            [] => Ok((0..all.len()).collect()),
            [name] => all.iter().position(|r| r.name() == *name).map(|i| vec![i]).ok_or_else(|| self.unknown(name)),
            _ => Err(HELP.into()),
        }
    }

    fn unknown(&self, name: &str) -> String {
        let names: Vec<&str> = self.running.robots().iter().map(|r| r.name()).collect();
        format!("there is no robot `{name}` in this run; there are: {}", names.join(", "))
    }

    /// The index of the named robot, or of the only one.
    pub(super) fn robot(&self, name: &str) -> Result<usize, String> {
        match self.robots(if name.is_empty() { &[] } else { std::slice::from_ref(&name) })?.as_slice() {
            [one] => Ok(*one),
            _ => Err(format!("name the robot with --robot; {}", self.unknown(name))),
        }
    }

    fn act(&self, names: &[&str], acts: bool) -> Result<Vec<String>, String> {
        let mut lines = Vec::new();
        for i in self.robots(names)? {
            let Some(robot) = self.running.robots().get(i) else { continue };
            let state = if acts { "acts" } else { "pauses after the motion under way" };
            match robot.let_agent_act(acts) {
                Ok(()) => lines.push(format!("{}: its agent {state}", robot.name())),
                Err(refusal) if !names.is_empty() => return Err(format!("{refusal}; {}", refusal.remedy())),
                Err(_) => lines.push(format!("{}: has no agent of its own", robot.name())),
            }
        }
        Ok(lines)
    }

    /// The name of the given bridge, or of the only one.
    fn bridge(&self, name: &str) -> Result<String, String> {
        let there = self.beside.bridges.join(", ");
        match (self.beside.bridges.as_slice(), name) {
            ([], _) => {
                Err("there is no bridge in this run; add a table [yarp] or [[bridge]], and start it again".into())
            }
            ([only], "") => Ok(only.clone()),
            (_, "") => Err(format!("name the bridge with --bridge; there are: {there}")),
            (all, name) => match all.iter().find(|bridge| *bridge == name) {
                Some(bridge) => Ok(bridge.clone()),
                None => Err(format!("there is no bridge `{name}` in this run; there are: {there}")),
            },
        }
    }

    /// The cameras by a camera's or a sensor's name, or those of the only sensor.
    fn cameras(&self, name: &str) -> Result<Vec<String>, String> {
        let sensor = |camera: &str| camera.split_once('/').map_or(String::new(), |(sensor, _)| sensor.to_owned());
        let sensors: BTreeSet<String> = self.beside.cameras.iter().map(|camera| sensor(camera)).collect();
        let there = || format!("there are: {}", self.beside.cameras.join(", "));
        if sensors.is_empty() {
            return Err("there is no sensor in this run; add a table [[sensor]], and start it again".into());
        }
        if name.is_empty() && sensors.len() > 1 {
            return Err(format!("name the sensor with --sensor; {}", there()));
        }
        let meant = |camera: &&String| name.is_empty() || *camera == name || sensor(camera) == name;
        let meant: Vec<String> = self.beside.cameras.iter().filter(meant).cloned().collect();
        if meant.is_empty() {
            Err(format!("there is no sensor or camera `{name}` in this run; {}", there()))
        } else {
            Ok(meant)
        }
    }

    /// The names of the owners of a part: more than one only for a detector with several cameras.
    fn owners(&self, name: &str, part: SwapPart) -> Result<Vec<String>, String> {
        match part {
            SwapPart::Bridge => self.bridge(name).map(|name| vec![name]),
            SwapPart::Detector => self.cameras(name),
            SwapPart::Locator => {
                let cameras = self.cameras(name)?;
                let sensor = cameras.first().and_then(|camera| camera.split_once('/')).map(|(sensor, _)| sensor.into());
                sensor.map(|sensor| vec![sensor]).ok_or_else(|| format!("there is no sensor `{name}` in this run"))
            }
            SwapPart::Agent | SwapPart::Controller | SwapPart::Driver => {
                let robot = self.running.robots().get(self.robot(name)?).map(|robot| vec![robot.name().to_owned()]);
                robot.ok_or_else(|| self.unknown(name))
            }
        }
    }

    async fn swap(&self, name: &str, part: &str, sent: SentConfig, rest: &[&str]) -> Result<Vec<String>, String> {
        let part = swappable(part)?;
        let owners = self.owners(name, part)?;
        let terms = terms(rest)?;
        let fresh = rest.contains(&"fresh");
        if part == SwapPart::Locator && !terms.shadow.is_zero() {
            return Err("a locator can't observe; omit --shadow".into());
        }
        let has_state = matches!(part, SwapPart::Agent | SwapPart::Detector | SwapPart::Locator);
        if !has_state && (fresh || !terms.shadow.is_zero()) {
            return Err(format!("a {part} can't observe, and has no state to discard; omit --shadow and --fresh"));
        }
        let models = self.running.models();
        let robots = self.running.robots();
        let robot = owners.first().and_then(|name| robots.iter().position(|robot| robot.name() == name));
        let model = robot.and_then(|i| models.get(i)).cloned();
        let wanted = owners.clone();
        let build = move || -> Result<Vec<BuiltPart>, String> {
            let offer = |name: &String| match (part, &model) {
                (SwapPart::Bridge, _) => {
                    let wanted = BridgeRequest { which: BridgeRef::Named(name), models: &models, terms };
                    swap_offer::sent_bridge(sent.clone(), &wanted)
                }
                (SwapPart::Detector, _) => {
                    swap_offer::sent_detector(sent.clone(), &DetectorRequest { camera: name, fresh, terms })
                }
                (SwapPart::Locator, _) => swap_offer::sent_locator(
                    sent.clone(),
                    &LocatorRequest { sensor: name, models: &models, fresh, terms },
                ),
                (part, Some(model)) => swap_offer::sent(sent.clone(), &PartRequest { part, name, model, fresh, terms }),
                (part, None) => Err(format!("there is no {part} of {name}")),
            };
            // build all before the first is offered
            wanted.iter().map(offer).collect()
        };
        let built = tokio::task::spawn_blocking(build).await;
        let offers = built.map_err(|e| format!("it could not be built: {e}"))??;
        for (name, offer) in owners.into_iter().zip(offers) {
            let (reply, done) = oneshot::channel();
            self.send(offer.control(name, reply)).await?;
            let done =
                tokio::time::timeout(SYSTEM_TIMEOUT, done).await.map_err(|_| "the run does not answer".to_owned())?;
            let done = done.map_err(|_| ENDING.to_owned())?;
            done.map_err(|why| format!("{why}{}", fresh_remedy(part, &why)))?;
        }
        Ok(vec!["built and checked".into()])
    }

    /// The state of a part's swap; of several detectors, of the one that failed or is least advanced.
    async fn swapped(&self, name: &str, part: &str) -> Result<Vec<String>, String> {
        let part = swappable(part)?;
        let report = self.report().await?;
        let steps: Vec<&SwapStep> =
            self.owners(name, part)?.iter().filter_map(|name| report.swap(name, part)).collect();
        let word = |step: &SwapStep| match step {
            SwapStep::Refused { .. } => (0, "refused"),
            SwapStep::Reverted { .. } => (1, "reverted"),
            SwapStep::Offered { .. } => (2, "offered"),
            SwapStep::TookOver { .. } => (3, "took over"),
            SwapStep::Settled => (4, "settled"),
        };
        let step = steps.into_iter().min_by_key(|step| word(step).0).ok_or("it was never swapped")?;
        Ok(vec![word(step).1.into(), swap_step_text(part, step)])
    }

    /// Connects a viewer, by default at [`DEFAULT_VIEWER`].
    async fn connect(&self, address: &[&str]) -> Result<Vec<String>, String> {
        let address = match address {
            [] => Ok(DEFAULT_VIEWER),
            [address] => address.parse().map_err(|e| format!("`{address}`: {e}; give one such as {DEFAULT_VIEWER}")),
            _ => Err(HELP.into()),
        }?;
        let recording = self.recording.clone();
        let connected = tokio::task::spawn_blocking(move || recording.connect(address)).await;
        connected.map_err(|e| format!("the viewer could not be connected: {e}"))??;
        Ok(vec![format!("the viewer at {address} follows from now on")])
    }
}

/// A value as a word, without quotes.
fn word(value: &Value) -> String {
    match value {
        Value::String(Text(bytes)) => String::from_utf8_lossy(bytes).into_owned(),
        Value::Vocab(v) => String::from_utf8_lossy(&v.0.to_le_bytes()).trim_end_matches('\0').to_owned(),
        other => Bottle(vec![other.clone()]).to_string(),
    }
}

fn swappable(part: &str) -> Result<SwapPart, String> {
    use SwapPart::{Agent, Bridge, Controller, Detector, Driver, Locator};
    let all = [Agent, Controller, Driver, Bridge, Detector, Locator];
    let found = all.into_iter().find(|p| p.to_string() == part);
    found.ok_or_else(|| {
        format!("`{part}` can't be swapped; agent, controller, driver, bridge, detector and locator can")
    })
}

/// Parses shadow, probation and budget, seconds.
fn terms(rest: &[&str]) -> Result<SwapPolicy, String> {
    let secs = |i: usize, name: &str, default: Duration| match rest.get(i).filter(|w| **w != "fresh") {
        None => Ok(default),
        Some(word) => word
            .parse()
            .ok()
            .filter(|s| (0.0..=1e6).contains(s))
            .map(Duration::from_secs_f64)
            .ok_or_else(|| format!("{word} is not a {name} in seconds; give a number from 0")),
    };
    let default = SwapPolicy::default();
    Ok(SwapPolicy {
        shadow: secs(0, "shadow", default.shadow)?,
        probation: secs(1, "probation", default.probation)?,
        budget: secs(2, "budget", default.budget)?,
    })
}
