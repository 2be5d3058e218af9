//! MoBeE's own YARP ports as one service: port filter, world RPC, part ports.

mod settings;

pub use settings::{RobotPorts, YarpSettings};

use mobee_contract::{Answer, KindError, Running, Service};
use std::sync::Arc;

/// MoBeE's YARP ports, to be served beside the safety chain of a run.
pub struct YarpServices {
    settings: YarpSettings,
}

impl YarpServices {
    /// The ports that these settings ask for; nothing is opened yet.
    ///
    /// # Errors
    /// The first setting that makes no sense, with what would.
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

    fn serve(self: Box<Self>, _running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            until.await;
            Ok(())
        })
    }
}
