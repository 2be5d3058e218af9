//! MoBeE's own YARP ports as one service.
//!
//! ```text
//! /MoBeE/<robot>/<part>/{rpc:i,command:i,state:o,stateExt:o}   the port filter: a safe board for any YARP program
//! /MoBeE/world                                                 objects around the robots
//! /MoBeE/<part>/{rpc,cmd:i,state:o}                            markers and frames; the force-field controller
//! /MoBeE/<robot>/{rpc,collisions:o,observation:o}              state, pausing the built-in agent, contacts
//! ```

mod boards;
mod held;
mod network;
mod parts;
mod settings;
mod steering;
mod world;

pub use settings::{RobotPorts, YarpSettings};
pub use world::WorldService;

use boards::FilteredBoards;
use mobee_contract::{Answer, Bridge, Kind, KindError, Registered, Running, Service};
use mobee_model::Robot;
use mobee_yarp::{NameServer, Network, RpcServer};
use std::collections::BTreeSet;
use std::sync::Arc;
use tokio::sync::watch;
use tokio::task::JoinHandle;

inventory::submit! {
    Registered(&Kind::<dyn Bridge> {
        name: YarpServices::KIND,
        doc: "MoBeE's own YARP ports: a filtered control board for each part, at which any YARP program moves the robot by transactions, the world's RPC, \
              and the ports of the parts with their force-field controllers. The table [yarp] is short for one of these.",
        schema: || schemars::schema_for!(YarpSettings),
        example: |_| Ok(serde_json::json!({})),
        build: |value, _| Ok(Arc::new(YarpServices::new(mobee_contract::settings(value)?)?)),
    })
}

/// MoBeE's YARP ports, served beside the safety chain of a run.
pub struct YarpServices {
    settings: YarpSettings,
}

impl YarpServices {
    /// The kind's name in configuration files.
    pub const KIND: &str = "yarp";

    /// Creates the service for the ports of these settings; opens nothing yet.
    ///
    /// # Errors
    /// The first invalid setting, with the valid values.
    pub fn new(settings: YarpSettings) -> Result<YarpServices, KindError> {
        settings.validate()?;
        Ok(YarpServices { settings })
    }

    /// Its settings.
    pub fn settings(&self) -> &YarpSettings {
        &self.settings
    }
}

impl Service for YarpServices {
    fn name(&self) -> String {
        "yarp".into()
    }

    /// Checks that no other program holds one of the port names.
    fn prepare(self: Arc<Self>, robots: Vec<Arc<Robot>>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            let (network, server) = network::open(&self.settings).await?;
            if let Some(server) = server {
                // it starts with the service, and a server that has just started has no registrations
                server.close().await;
                return Ok(());
            }
            for name in self.settings.port_names(&robots) {
                mobee_yarp::check_free(&network, &network.full_name(&name)).await.map_err(|e| held::refusal(&e))?;
            }
            Ok(())
        })
    }

    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            let (network, server) = network::open(&self.settings).await?;
            let mut open = OpenPorts::new(server);
            let mut result = open.all(&self.settings, &network, &running).await;
            if result.is_ok() {
                let names = self.settings.port_names(&running.models());
                result = tokio::select! {
                    biased;
                    () = until => Ok(()),
                    lost = held::lost(&network, &names) => Err(lost),
                };
            }
            open.close().await;
            result
        })
    }
}

impl Bridge for YarpServices {
    fn check(&self, robots: &[Arc<Robot>]) -> Result<(), KindError> {
        self.settings.check_robots(robots)
    }

    fn speed(&self) -> Option<f64> {
        self.settings.filter.then_some(self.settings.speed)
    }

    fn serves(&self, robots: &[Arc<Robot>]) -> Vec<String> {
        let settings = &self.settings;
        let mut names = Vec::new();
        for robot in robots {
            let boards = robot.parts.iter().filter(|part| settings.serves(&robot.name, &part.name));
            names.extend(boards.map(|part| format!("{}/{}", settings.robot_prefix(&robot.name), part.name)));
            if settings.parts {
                let own = format!("{}/{}", settings.prefix, robot.name);
                names.extend(["rpc", "collisions:o", "observation:o"].map(|port| format!("{own}/{port}")));
            }
        }
        names.extend(settings.world.then(|| format!("{}/world", settings.prefix)));
        names
    }
}

/// All open ports and tasks, in the order in which they are closed.
struct OpenPorts {
    server: Option<NameServer>,
    boards: Vec<FilteredBoards>,
    world: Option<RpcServer>,
    robots: Vec<JoinHandle<()>>,
    tasks: Vec<JoinHandle<()>>,
    leave: watch::Sender<bool>,
}

impl OpenPorts {
    fn new(server: Option<NameServer>) -> OpenPorts {
        let leave = watch::Sender::new(false);
        OpenPorts { server, boards: Vec::new(), world: None, robots: Vec::new(), tasks: Vec::new(), leave }
    }

    async fn all(
        &mut self,
        settings: &YarpSettings,
        network: &Network,
        running: &Arc<dyn Running>,
    ) -> Result<(), String> {
        let models = running.models();
        let mut taken = BTreeSet::new();
        for (filtered, model) in running.robots().iter().zip(&models) {
            let name = filtered.name();
            let prefix = |part: &mobee_model::Part| {
                settings.serves(name, &part.name).then(|| format!("{}/{}", settings.robot_prefix(name), part.name))
            };
            let prefixes: Vec<_> = model.parts.iter().map(prefix).collect();
            let boards = FilteredBoards::open(network, running, filtered, model, &prefixes, settings).await;
            self.boards.push(boards.map_err(|e| e.to_string())?);
            if settings.parts {
                let ports =
                    parts::OpenRobotPorts::open(network, running, filtered, model, settings, &mut taken).await?;
                self.robots.push(tokio::spawn(ports.serve(self.leave.subscribe())));
            }
        }
        if settings.world {
            let name = format!("{}/world", settings.prefix);
            let folder = settings.save_folder.clone();
            let opened = world::WorldService::open(network, &name, running.clone(), folder).await;
            let (service, server) = opened.map_err(|e| e.to_string())?;
            self.world = Some(server);
            self.tasks.push(tokio::spawn(service.follow()));
        }
        Ok(())
    }

    async fn close(self) {
        for task in &self.tasks {
            task.abort();
        }
        self.leave.send_replace(true);
        for robot in self.robots {
            let _ = robot.await;
        }
        for boards in self.boards {
            boards.close().await;
        }
        if let Some(world) = self.world {
            world.close().await;
        }
        if let Some(server) = self.server {
            server.close().await;
        }
    }
}
