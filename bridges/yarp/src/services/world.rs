//! Service of the world's RPC: one request at a time, edits made before the reply.

use mobee_contract::{Credit, Event, Pose, Running, Time};
use mobee_filter::world_rpc::{Answered, Errand, WorldRefusal, WorldReply, WorldRequest, WorldRpc, WorldView};
use mobee_model::{Edit, Object, load_world};
use mobee_yarp::{Dialect, Handler, Message, Network, Payload, PortError, RpcServer};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Mutex;

/// Period at which grabbed objects are moved with their markers.
const PERIOD: Duration = Duration::from_millis(20);
/// Time limit of an edit.
const EDIT_TIMEOUT: Duration = Duration::from_secs(5);
/// Changes of the world per second, for all programs together: the model makes each on the thread that
/// supervises the robots, and each is a line in the journal.
const PER_SECOND: f64 = 200.0;
/// Largest number of changes at once.
const MAX_CHANGES: f64 = 400.0;
/// Shortest time between two reports of refused changes.
const SUM_UP: Duration = Duration::from_secs(1);

/// World RPC of a running system.
pub struct WorldService {
    running: Arc<dyn Running>,
    folder: Option<PathBuf>,
    core: Mutex<WorldCore>,
}

/// State that only one request at a time may use.
struct WorldCore {
    rpc: WorldRpc,
    /// Budget of changes.
    credit: Credit,
    /// Changes refused since the last report, and the time of that report.
    refused: (u64, Time),
}

impl WorldService {
    /// Creates the service for this system; `folder` is the location of saved worlds, if any.
    pub fn new(running: Arc<dyn Running>, folder: Option<PathBuf>) -> WorldService {
        let now = running.now();
        let credit = Credit::full(now, PER_SECOND, MAX_CHANGES);
        let core = WorldCore { rpc: WorldRpc::default(), credit, refused: (0, now) };
        WorldService { running, folder, core: Mutex::new(core) }
    }

    /// Opens the port.
    ///
    /// # Errors
    /// The port can't be opened.
    pub(super) async fn open(
        network: &Network,
        name: &str,
        running: Arc<dyn Running>,
        folder: Option<PathBuf>,
    ) -> Result<(Arc<WorldService>, RpcServer), PortError> {
        let service = Arc::new(WorldService::new(running, folder));
        let server = RpcServer::open(network, name, Arc::new(Port(service.clone(), network.dialect()))).await?;
        Ok((service, server))
    }

    /// Moves grabbed objects with their markers; never returns.
    pub async fn follow(self: Arc<Self>) {
        let mut ticks = tokio::time::interval(PERIOD);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            ticks.tick().await;
            let mut core = self.core.lock().await;
            self.sum_up(&mut core.refused);
            if core.rpc.holds_anything() {
                let edits = self.view(|view| core.rpc.follow(view));
                // an object that lags behind is moved in the next cycle
                if edits.is_empty() || !core.credit.take(self.running.now()) {
                    continue;
                }
                core.credit.owe(edits.len() - 1);
                for edit in edits {
                    // an object that has just been removed is released in the next cycle
                    let _ = tokio::time::timeout(EDIT_TIMEOUT, self.running.edit(edit)).await;
                }
            }
        }
    }

    fn sum_up(&self, (count, last): &mut (u64, Time)) {
        let now = self.running.now();
        if *count > 0 && now >= *last + SUM_UP {
            let text = format!("the world: {count} changes were refused; they come too quickly");
            (*count, *last) = (0, now);
            self.running.tell(Event::Warning { text });
        }
    }

    fn view<T>(&self, f: impl FnOnce(&WorldView) -> T) -> T {
        let scene = self.running.scene();
        let mut poses: Vec<Pose> = scene.home();
        for robot in self.running.robots() {
            if let Some(pose) = poses.get_mut(robot.index()) {
                *pose = robot.latest().q;
            }
        }
        f(&WorldView { scene: &scene, poses: &poses })
    }

    /// Answers one request; edits are made before the reply.
    ///
    /// # Errors
    /// The reason why it was not executed.
    pub async fn answer(&self, request: WorldRequest) -> Result<WorldReply, WorldRefusal> {
        let core = &mut *self.core.lock().await;
        if request.is_change() && !core.credit.take(self.running.now()) {
            core.refused.0 += 1;
            return Err(WorldRefusal::Busy { per_second: PER_SECOND });
        }
        let changed = match self.view(|view| core.rpc.on(&request, view))? {
            Answered::Reply(reply) => return Ok(reply),
            Answered::Changed(changed) => changed,
            Answered::Errand(errand) => match self.run(errand).await? {
                FileTransfer::Saved(file) => return Ok(WorldReply::Saved(file)),
                FileTransfer::Loaded(file, objects) => self.view(|view| core.rpc.loaded(&file, objects, view))?,
            },
        };
        core.credit.owe(changed.edits.len().saturating_sub(1));
        match self.make(&changed.edits).await {
            Ok(()) => Ok(changed.reply),
            Err((made, why)) => {
                core.rpc.not_made(changed, made);
                Err(why)
            }
        }
    }

    /// Makes these edits in order.
    ///
    /// # Errors
    /// The number of edits made before the one that failed, and the reason.
    async fn make(&self, edits: &[Edit]) -> Result<(), (usize, WorldRefusal)> {
        for (made, edit) in edits.iter().enumerate() {
            match tokio::time::timeout(EDIT_TIMEOUT, self.running.edit(edit.clone())).await {
                Ok(done) => done.map_err(|why| (made, WorldRefusal::Model(why)))?,
                Err(_) => return Err((made, WorldRefusal::ModelSilent)),
            }
        }
        Ok(())
    }

    async fn run(&self, errand: Errand) -> Result<FileTransfer, WorldRefusal> {
        let folder = self.folder.clone().ok_or(WorldRefusal::FilesOff)?;
        let run = move || match errand {
            Errand::Save { file, text } => {
                save(&folder, &file, &text).map_err(|e| WorldRefusal::NotSaved(e.to_string()))?;
                Ok(FileTransfer::Saved(file))
            }
            Errand::Load { file } => {
                let world = load_world(folder.join(&file)).map_err(|e| WorldRefusal::NotLoaded(e.to_string()))?;
                Ok(FileTransfer::Loaded(file, world.value))
            }
        };
        tokio::task::spawn_blocking(run).await.map_err(|e| WorldRefusal::NotDone(e.to_string()))?
    }
}

enum FileTransfer {
    Saved(String),
    Loaded(String, Vec<Object>),
}

/// Writes a file completely or not at all.
fn save(folder: &Path, file: &str, text: &str) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let new = folder.join(format!(".{file}.new"));
    std::fs::write(&new, text)?;
    std::fs::rename(&new, folder.join(file))
}

/// Handler of the port.
struct Port(Arc<WorldService>, Dialect);

impl Handler for Port {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let world = self.0.clone();
        let dialect = self.1;
        Box::pin(async move {
            // a message that is not a bottle is answered like an unknown request
            let request = request.payload.bottle(dialect).unwrap_or_default();
            Some(crate::world::answer(&world, &request).await.into())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::{Answer, Filtered};
    use mobee_model::{Robot, Scene};
    use mobee_yarp::Bottle;
    use std::sync::{Mutex as Cell, PoisonError};

    /// A world without robots, whose clock the test sets.
    struct Still {
        scene: Cell<Arc<Scene>>,
        now: Cell<Time>,
        told: Cell<Vec<Event>>,
        /// Number of edits after which all are refused.
        edits_left: Cell<usize>,
    }

    fn of<T: Clone>(cell: &Cell<T>) -> T {
        cell.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    impl Running for Still {
        fn now(&self) -> Time {
            of(&self.now)
        }
        fn time_of_day(&self, at: Time) -> f64 {
            at.secs()
        }
        fn robots(&self) -> &[Arc<dyn Filtered>] {
            &[]
        }
        fn models(&self) -> Vec<Arc<Robot>> {
            Vec::new()
        }
        fn sleep_until(&self, _: Time) -> Answer<()> {
            Box::pin(std::future::ready(()))
        }
        fn scene(&self) -> Arc<Scene> {
            of(&self.scene)
        }
        fn edit(&self, edit: Edit) -> Answer<Result<(), String>> {
            let left = of(&self.edits_left).checked_sub(1);
            let Some(left) = left else { return Box::pin(std::future::ready(Err("planted".into()))) };
            *self.edits_left.lock().unwrap() = left;
            let next = self.scene().edit(&edit).map(Arc::new).map_err(|e| e.to_string());
            let done = next.map(|next| *self.scene.lock().unwrap() = next);
            Box::pin(std::future::ready(done))
        }
        fn tell(&self, event: Event) {
            self.told.lock().unwrap().push(event);
        }
    }

    async fn say(world: &WorldService, words: &str) -> String {
        crate::world::answer(world, &Bottle::parse(words, Dialect::V3).unwrap()).await.to_string()
    }

    fn still() -> Arc<Still> {
        let scene = Cell::new(Arc::new(Scene::new(Vec::new(), Vec::new()).unwrap()));
        let edits_left = Cell::new(usize::MAX);
        Arc::new(Still { scene, now: Cell::default(), told: Cell::default(), edits_left })
    }

    /// A change that the model refuses is not recorded: the next `undo` undoes the one before. An `undo` that the
    /// model refuses can be repeated.
    #[tokio::test(start_paused = true)]
    async fn what_was_not_made_is_not_undone() {
        let still = still();
        let world = WorldService::new(still.clone(), None);
        let allow = |edits: usize| *still.edits_left.lock().unwrap() = edits;
        let count = || still.scene().objects().count();
        for _ in 0..3 {
            say(&world, "mk ssph 0.05 3 3 3").await;
        }
        allow(0);
        for request in ["mk ssph 0.05 3 3 3", "rm ssph 1", "clr", "undo"] {
            assert!(say(&world, request).await.contains("planted"), "{request}");
        }
        allow(usize::MAX);
        assert!(say(&world, "mk ssph 0.05 3 3 3").await.contains("ssph4"), "a refused object uses no number");
        say(&world, "clr").await;
        allow(1);
        assert!(say(&world, "undo").await.contains("planted"));
        assert_eq!(count(), 1, "one of four objects is back");
        allow(usize::MAX);
        for left in [4, 3, 2, 1, 0] {
            assert!(say(&world, "undo").await.contains("Undone"));
            assert_eq!(count(), left);
        }
        assert!(!say(&world, "undo").await.contains("Undone"));
    }

    #[tokio::test(start_paused = true)]
    async fn a_flood_of_changes_is_refused_and_a_question_is_not() {
        let still = still();
        let world = Arc::new(WorldService::new(still.clone(), None));
        let mut busy = 0;
        for _ in 0..500 {
            busy += usize::from(say(&world, "mk ssph 0.05 3 3 3").await.contains("Busy"));
        }
        assert_eq!((busy, still.scene().objects().count()), (100, 400));
        assert!(say(&world, "ls").await.contains("ssph400"));
        // edits that belong together are made together and are charged together: two seconds for 400 objects
        *still.now.lock().unwrap() = Time(10_000_000);
        assert!(say(&world, "clr").await.contains("Removed"));
        assert!(say(&world, "undo").await.contains("Undone"));
        assert_eq!(still.scene().objects().count(), 400);
        *still.now.lock().unwrap() = Time(1_900_000_000);
        assert!(say(&world, "rm ssph 1").await.contains("Busy"));
        let follow = tokio::spawn(world.clone().follow());
        tokio::time::sleep(PERIOD * 2).await;
        follow.abort();
        let text = "the world: 101 changes were refused; they come too quickly".to_owned();
        assert_eq!(of(&still.told), [Event::Warning { text }]);
        *still.now.lock().unwrap() = Time(2_100_000_000);
        assert!(say(&world, "rm ssph 1").await.contains("Removed"));
    }
}
