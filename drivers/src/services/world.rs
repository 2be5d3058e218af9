//! The shell of the world's RPC: one request at a time, edits made before the reply.

use crate::words::line;
use crate::world_rpc::{Answered, Errand, WorldRpc, WorldView};
use mobee_contract::{Pose, Running};
use mobee_model::{Object, load_world};
use mobee_yarp::{Bottle, Dialect, Handler, Message, Network, Payload, PortError, RpcServer};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Mutex;

/// How often what is grabbed is brought after its marker.
const PERIOD: Duration = Duration::from_millis(20);
/// Times that a request waits for another one's edits.
const PATIENCE: Duration = Duration::from_secs(5);

/// The world's RPC in a running system.
pub struct WorldService {
    running: Arc<dyn Running>,
    folder: Option<PathBuf>,
    core: Mutex<WorldRpc>,
}

impl WorldService {
    /// For this system; `folder` is where worlds are saved and loaded, if anywhere.
    pub fn new(running: Arc<dyn Running>, folder: Option<PathBuf>) -> WorldService {
        WorldService { running, folder, core: Mutex::new(WorldRpc::default()) }
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

    /// Keeps what is grabbed with its marker; for ever.
    pub async fn follow(self: Arc<Self>) {
        let mut ticks = tokio::time::interval(PERIOD);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            ticks.tick().await;
            let mut core = self.core.lock().await;
            if core.holds_anything() {
                let edits = self.view(|view| core.follow(view));
                for edit in edits {
                    // an object that somebody else has just removed is let go at the next look
                    let _ = tokio::time::timeout(PATIENCE, self.running.edit(edit)).await;
                }
            }
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
    pub async fn answer(&self, request: Bottle) -> Bottle {
        let mut core = self.core.lock().await;
        let answered = self.view(|view| core.on(&request, view));
        let answered = match answered.errand {
            None => answered,
            Some(errand) => match self.run(errand).await {
                Ok(Done::Saved(file)) => return line(format!("Saved {file}.")),
                Ok(Done::Loaded(file, objects)) => self.view(|view| core.loaded(&file, objects, view)),
                Err(sentence) => return line(sentence),
            },
        };
        self.make(answered).await
    }

    async fn make(&self, answered: Answered) -> Bottle {
        for edit in answered.edits {
            match tokio::time::timeout(PATIENCE, self.running.edit(edit)).await {
                Ok(Ok(())) => {}
                Ok(Err(sentence)) => return line(sentence),
                Err(_) => return line("The model does not answer; the world may have changed in part."),
            }
        }
        answered.reply
    }

    async fn run(&self, errand: Errand) -> Result<Done, String> {
        let off = "Saving and loading are off; set save_folder in the table [yarp] of the configuration.";
        let folder = self.folder.clone().ok_or(off)?;
        let run = move || match errand {
            Errand::Save { file, text } => save(&folder, &file, &text).map(|()| Done::Saved(file)),
            Errand::Load { file } => {
                let world = load_world(folder.join(&file)).map_err(|e| format!("Not loaded: {e}"))?;
                Ok(Done::Loaded(file, world.value))
            }
        };
        tokio::task::spawn_blocking(run).await.map_err(|e| format!("Not done: {e}"))?
    }
}

enum Done {
    Saved(String),
    Loaded(String, Vec<Object>),
}

/// Writes a file whole or not at all.
fn save(folder: &Path, file: &str, text: &str) -> Result<(), String> {
    let wrong = |e: std::io::Error| format!("Not saved: {e}");
    std::fs::create_dir_all(folder).map_err(wrong)?;
    let new = folder.join(format!(".{file}.new"));
    std::fs::write(&new, text).map_err(wrong)?;
    std::fs::rename(&new, folder.join(file)).map_err(wrong)
}

/// What the port calls.
struct Port(Arc<WorldService>, Dialect);

impl Handler for Port {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let (world, dialect) = (self.0.clone(), self.1);
        Box::pin(async move {
            // what is no bottle is answered as what is unknown
            let request = request.payload.bottle(dialect).unwrap_or_default();
            Some(world.answer(request).await.into())
        })
    }
}
