//! `mobee run --watch`: an edit of the running configuration becomes swaps, either all of it or nothing.
//!
//! ```text
//! contents of the files ──Debounce──> unchanged for a moment ──load, check, build──> compared per robot ──> swaps, in sequence
//!                                                              │ an error, or a change that needs a restart: reported, nothing swapped
//! ```

use crate::ctl::swap_offer::{self, BridgeRef, BridgeRequest, PartRequest};
use mobee_compose::Composition;
use mobee_compose::config::{Config, Source};
use mobee_contract::{Answer, Event, Running, Service, SwapPart, SwapStep, Time};
use mobee_model::file::{MIB, read};
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::Control;
use serde_json::Value;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// Interval between two looks at the files.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Time for which the files must be unchanged: editors write in several steps.
const QUIET_TIME: Duration = Duration::from_millis(300);

/// Watches the files of a running configuration.
#[derive(Clone)]
pub struct WatchService {
    set: Vec<String>,
    source: Source,
    running: Value,
    /// The names of its bridges, in their order.
    bridges: Vec<String>,
    world: Option<PathBuf>,
    /// Hash of the world's file when the run began.
    world_hash: u64,
    controls: mpsc::Sender<Control>,
}

impl WatchService {
    /// A watch for the running configuration, which was loaded with these overrides.
    pub fn new(
        source: Source,
        composition: &Composition,
        set: &[String],
        controls: mpsc::Sender<Control>,
    ) -> WatchService {
        let config = &composition.config;
        let bridges = composition.bridge_names();
        let world = config.world.file.as_ref().map(|file| Config::beside(&source, file));
        let running = serde_json::to_value(config).unwrap_or_default();
        let world_hash = hash_of(world.as_slice());
        WatchService { set: set.to_vec(), source, running, bridges, world, world_hash, controls }
    }

    /// The files that the configuration was read from, and its world.
    fn files(&self) -> Vec<PathBuf> {
        self.source.files().into_iter().chain(self.world.clone()).collect()
    }

    /// Swaps the parts that were edited.
    ///
    /// # Errors
    /// The reason why nothing was swapped, or not all.
    async fn reload(&mut self, running: &Arc<dyn Running>) -> Result<Vec<String>, String> {
        let path = self.source.path.clone();
        let set = self.set.clone();
        let before = self.running.clone();
        let bridges = self.bridges.clone();
        let models = running.models();
        let names: Vec<String> = running.robots().iter().map(|r| r.name().to_owned()).collect();
        if hash_of(self.world.as_slice()) != self.world_hash {
            let file = self.world.clone().unwrap_or_default();
            let file = file.display();
            return Err(format!(
                "{file} was edited: `mobee ctl world ...` moves objects while the run goes on; else start it again"
            ));
        }
        let read = move || {
            let (config, source) = Config::load(&path, &set).map_err(|e| format!("{:?}", miette::Report::new(e)))?;
            let now = serde_json::to_value(&config).map_err(|e| e.to_string())?;
            let changes = changes(&before, &now, &bridges);
            if !changes.restart.is_empty() {
                return Err(format!(
                    "{} can't be changed while the run goes on: start it again",
                    changes.restart.join(", ")
                ));
            }
            let mut offers = Vec::new();
            let terms = SwapPolicy::default();
            for (name, part) in changes.swaps {
                let offered = if part == SwapPart::Bridge {
                    let which = BridgeRef::At(bridges.iter().position(|b| *b == name).unwrap_or_default());
                    swap_offer::take_bridge(config.clone(), &source, &BridgeRequest { which, models: &models, terms })?
                } else {
                    let model = names.iter().position(|n| *n == name).and_then(|i| models.get(i));
                    let model = model.ok_or_else(|| format!("there is no robot {name} in this run"))?;
                    let wanted = PartRequest { part, name: &name, model, fresh: false, terms };
                    swap_offer::take(config.clone(), &source, &wanted)?
                };
                offers.push((name, part, offered));
            }
            Ok((source, now, offers))
        };
        let read = tokio::task::spawn_blocking(read).await;
        let (source, now, offers) = read.map_err(|e| format!("it could not be read: {e}"))??;
        self.source = source;
        let mut done = Vec::new();
        for (name, part, offered) in offers {
            let (reply, taken) = oneshot::channel();
            self.controls.send(offered.control(name.clone(), reply)).await.map_err(|_| "the run is ending")?;
            let failure = |why: &str| format!("{name}.{part}: {why}");
            taken.await.map_err(|_| failure("the run is ending"))?.map_err(|why| failure(&why))?;
            match self.last_step(&name, part, running).await? {
                SwapStep::Settled => record_swap(&mut self.running, &now, &self.bridges, &name, part),
                step => return Err(failure(&step.to_string())),
            }
            done.push(format!("{name}.{part} is exchanged"));
        }
        Ok(done)
    }

    /// Waits for the last step of a swap. An edit during the wait is announced at once, and applied after it.
    async fn last_step(&self, name: &str, part: SwapPart, running: &Arc<dyn Running>) -> Result<SwapStep, String> {
        let before = hash_of(&self.files());
        let mut answered = false;
        loop {
            if !answered && hash_of(&self.files()) != before {
                answered = true;
                let text = format!(
                    "the configuration was edited while the swap of {name}.{part} is under way: the edit is taken up once that has ended"
                );
                running.tell(Event::Warning { text });
            }
            let (reply, report) = oneshot::channel();
            self.controls.send(Control::Status(reply)).await.map_err(|_| "the run is ending")?;
            let report = report.await.map_err(|_| "the run is ending")?;
            match report.swap(name, part) {
                Some(step) if step.is_last() => return Ok(step.clone()),
                _ => tokio::time::sleep(POLL_INTERVAL).await,
            }
        }
    }
}

impl Service for WatchService {
    fn name(&self) -> String {
        "watch".into()
    }

    fn keeps_run(&self) -> bool {
        false
    }

    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            // each edit that is applied changes the running configuration
            let mut own = (*self).clone();
            let mut debounce = Debounce::new(hash_of(&own.files()));
            let watch = async {
                loop {
                    tokio::time::sleep(POLL_INTERVAL).await;
                    if !debounce.has_settled(running.now(), hash_of(&own.files())) {
                        continue;
                    }
                    let text = match own.reload(&running).await {
                        Ok(done) if done.is_empty() => continue,
                        Ok(done) => format!("the edited configuration is in force: {}", done.join(", ")),
                        Err(why) => format!("the edited configuration was not taken over: {why}"),
                    };
                    running.tell(Event::Warning { text });
                }
            };
            tokio::select! {
                () = until => Ok(()),
                () = watch => Ok(()),
            }
        })
    }
}

/// Hash of the contents of the files; a file that can't be read counts as well.
fn hash_of(files: &[PathBuf]) -> u64 {
    let mut hasher = DefaultHasher::new();
    files.iter().for_each(|file| read(file, MIB).ok().hash(&mut hasher));
    hasher.finish()
}

/// Detects that something has changed and then stayed the same.
#[derive(Debug)]
struct Debounce {
    taken: u64,
    pending: Option<(u64, Time)>,
}

impl Debounce {
    fn new(hash: u64) -> Debounce {
        Debounce { taken: hash, pending: None }
    }

    /// True if this hash is new and has been the same for [`QUIET_TIME`].
    fn has_settled(&mut self, now: Time, hash: u64) -> bool {
        match self.pending {
            _ if hash == self.taken => self.pending = None,
            Some((seen, since)) if seen == hash => {
                if now.since(since) >= QUIET_TIME {
                    (self.taken, self.pending) = (hash, None);
                    return true;
                }
            }
            _ => self.pending = Some((hash, now)),
        }
        false
    }
}

/// Differences between two configurations.
#[derive(Debug, Default, PartialEq)]
struct Changes {
    /// Changes that a swap can apply: name of the robot or bridge, and part.
    swaps: Vec<(String, SwapPart)>,
    /// The keys of everything else.
    restart: Vec<String>,
}

/// Compares two configurations; `called` are the names of the bridges.
fn changes(old: &Value, new: &Value, called: &[String]) -> Changes {
    let mut found = Changes::default();
    let robots = |config: &Value| config["robot"].as_array().cloned().unwrap_or_default();
    let before = robots(old);
    let after = robots(new);
    let names = |robots: &[Value]| robots.iter().map(|r| r["name"].clone()).collect::<Vec<Value>>();
    if names(&before) == names(&after) {
        for (old, new) in before.iter().zip(&after) {
            let name = old["name"].as_str().unwrap_or_default().to_owned();
            for key in differing(old, new) {
                match key.as_str() {
                    "controller" => found.swaps.push((name.clone(), SwapPart::Controller)),
                    "driver" => found.swaps.push((name.clone(), SwapPart::Driver)),
                    "agent" if !old["agent"].is_null() && !new["agent"].is_null() => {
                        found.swaps.push((name.clone(), SwapPart::Agent));
                    }
                    other => found.restart.push(format!("robot.{name}.{other}")),
                }
            }
        }
    } else {
        found.restart.push("robot".into());
    }
    let before = bridges(old);
    let after = bridges(new);
    let places = |bridges: &[(Place, Value)]| bridges.iter().map(|(place, _)| *place).collect::<Vec<Place>>();
    let same = places(&before) == places(&after);
    let edited = before.iter().zip(&after).zip(called).filter(|((old, new), _)| same && old != new);
    found.swaps.extend(edited.map(|(_, name)| (name.clone(), SwapPart::Bridge)));
    let swapped = |key: &str| key == "robot" || (same && ["yarp", "bridge"].contains(&key));
    found.restart.extend(differing(old, new).into_iter().filter(|key| !swapped(key)));
    found
}

/// Place of a bridge's table: `None` for `[yarp]`, else its index in `[[bridge]]`.
type Place = Option<usize>;

/// The tables of all bridges, as [`Config::bridges`] orders them.
fn bridges(config: &Value) -> Vec<(Place, Value)> {
    let yarp = Some((None, config["yarp"].clone())).filter(|(_, table)| !table.is_null());
    let others = config["bridge"].as_array().into_iter().flatten().enumerate();
    yarp.into_iter().chain(others.map(|(i, table)| (Some(i), table.clone()))).collect()
}

/// The keys whose values differ.
fn differing(old: &Value, new: &Value) -> Vec<String> {
    let keys = |v: &Value| v.as_object().map(|m| m.keys().cloned().collect::<Vec<_>>()).unwrap_or_default();
    let mut all = keys(old);
    all.extend(keys(new));
    all.sort();
    all.dedup();
    all.retain(|key| old[key] != new[key]);
    all
}

/// Records that a part is now as in the new configuration; `names` are those of the bridges.
fn record_swap(running: &mut Value, new: &Value, names: &[String], name: &str, part: SwapPart) {
    if part == SwapPart::Bridge {
        let place = bridges(new).into_iter().zip(names).find(|(_, n)| *n == name);
        match place {
            Some(((None, table), _)) => running["yarp"] = table,
            Some(((Some(i), table), _)) => running["bridge"][i] = table,
            None => {}
        }
        return;
    }
    let of = |config: &Value| config["robot"].as_array()?.iter().position(|r| r["name"] == name);
    if let (Some(here), Some(there)) = (of(running), of(new)) {
        let key = part.to_string();
        running["robot"][here][&key] = new["robot"][there][&key].clone();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_edited_counts_once_it_is_still() {
        let at = |ms: u64| Time(ms * 1_000_000);
        let mut debounce = Debounce::new(1);
        // half-written, then written on, then still
        for (ms, hash, counts) in
            [(0, 1, false), (200, 2, false), (400, 3, false), (600, 3, false), (800, 3, true), (1000, 3, false)]
        {
            assert_eq!(debounce.has_settled(at(ms), hash), counts, "at {ms} ms");
        }
        // changed back in time: nothing happened
        for (ms, hash) in [(1200, 4), (1400, 3), (1600, 4), (1800, 3), (2000, 3)] {
            assert!(!debounce.has_settled(at(ms), hash), "at {ms} ms");
        }
    }

    #[test]
    fn parts_are_exchanged_and_everything_else_needs_a_restart() {
        let config = json!({
            "seed": 1, "world": { "file": "a.xml" },
            "robot": [
                { "name": "left", "model": "m.xml", "driver": { "kind": "sim" }, "controller": { "period_ms": 20.0 }, "agent": { "speed": 0.1 } },
                { "name": "right", "model": "m.xml", "driver": { "kind": "sim" }, "controller": { "period_ms": 20.0 }, "agent": null }
            ]
        });
        let edited = |key: &str, value: Value| {
            let mut new = config.clone();
            *new.pointer_mut(key).expect(key) = value;
            changes(&config, &new, &[])
        };
        let swap = |robot: &str, part| Changes { swaps: vec![(robot.to_owned(), part)], restart: Vec::new() };
        let restart = |key: &str| Changes { swaps: Vec::new(), restart: vec![key.to_owned()] };
        assert_eq!(edited("/seed", json!(1)), Changes::default());
        assert_eq!(edited("/robot/0/agent/speed", json!(0.2)), swap("left", SwapPart::Agent));
        assert_eq!(edited("/robot/1/controller/period_ms", json!(10.0)), swap("right", SwapPart::Controller));
        assert_eq!(edited("/robot/1/driver", json!({ "kind": "yarp" })), swap("right", SwapPart::Driver));
        assert_eq!(edited("/robot/1/agent", json!({ "kind": "random" })), restart("robot.right.agent"));
        assert_eq!(edited("/robot/0/model", json!("n.xml")), restart("robot.left.model"));
        assert_eq!(edited("/world/file", json!("b.xml")), restart("world"));
        assert_eq!(edited("/robot/0/name", json!("middle")), restart("robot"));
        let mut new = config.clone();
        new["robot"][0]["agent"]["speed"] = json!(0.3);
        let mut running = config.clone();
        record_swap(&mut running, &new, &[], "left", SwapPart::Agent);
        assert_eq!(running, new);
    }

    #[test]
    fn edited_bridges_are_exchanged_and_new_ones_need_a_restart() {
        let config =
            json!({ "robot": [], "yarp": { "speed": 0.1 }, "bridge": [{ "kind": "yarp" }, { "kind": "other" }] });
        let names = ["yarp", "yarp-2", "other"].map(str::to_owned);
        let edited = |key: &str, value: Value| {
            let mut new = config.clone();
            *new.pointer_mut(key).expect(key) = value;
            (changes(&config, &new, &names), new)
        };
        for (key, value, name) in [
            ("/yarp", json!({ "speed": 0.2 }), "yarp"),
            ("/bridge/0", json!({ "kind": "yarp", "speed": 0.2 }), "yarp-2"),
            ("/bridge/1", json!({ "kind": "third" }), "other"),
        ] {
            let (changes, new) = edited(key, value);
            assert_eq!(changes, Changes { swaps: vec![(name.to_owned(), SwapPart::Bridge)], restart: Vec::new() });
            let mut running = config.clone();
            record_swap(&mut running, &new, &names, name, SwapPart::Bridge);
            assert_eq!(running, new);
        }
        for (key, value) in [("/yarp", Value::Null), ("/bridge", json!([{ "kind": "yarp" }]))] {
            let restart = vec![key.trim_start_matches('/').to_owned()];
            assert_eq!(edited(key, value).0, Changes { swaps: Vec::new(), restart });
        }
    }
}
