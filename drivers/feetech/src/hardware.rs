//! An arm of servos as hardware: it outlives its drivers.

use crate::core::{ArmCore, ConnectionStage, CoreNumbers};
use crate::driver::FeetechDriver;
use crate::settings::{FeetechSettings, PERIOD};
use crate::worker::{BusCycles, BusWorker, SharedArm};
use mobee_contract::{Board, Context, Driver, DriverFault, Hardware, Kind, KindError, Known, Registered};
use mobee_model::Robot;
use serde_json::Value;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// The name of this kind in configuration files.
pub const FEETECH: &str = "feetech";

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: FEETECH,
        doc: "An arm of Feetech STS3215 servos on a serial bus, such as an SO-100 or SO-101, at 100 Hz. It follows trajectories of its own, with goals \
              at most `lead_deg` ahead of the readings, reports load as torque, and brakes and holds when its lease expires. It writes nothing that \
              a servo stores.",
        schema: || schemars::schema_for!(FeetechSettings),
        example: |_| Err("it needs an arm at a serial port"),
        build: |settings, context| Ok(Arc::new(FeetechHardware::build(settings, context)?)),
    })
}

/// An arm of servos. Its bus thread begins with the first connection.
pub struct FeetechHardware {
    settings: FeetechSettings,
    board: Board,
    shared: Arc<SharedArm>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl FeetechHardware {
    /// From the settings in a config file.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn build(settings: &Value, context: &Context) -> Result<FeetechHardware, KindError> {
        FeetechHardware::new(&mobee_contract::settings(settings)?, &context.robot)
    }

    /// The arm of this robot. The port is not opened before the first connection.
    ///
    /// # Errors
    /// The first setting that can't be used.
    pub fn new(settings: &FeetechSettings, robot: &Robot) -> Result<FeetechHardware, KindError> {
        settings.validate()?;
        let joints = settings.joints(robot)?;
        let axes = settings.axes(robot, &joints)?;
        let numbers = CoreNumbers {
            period: PERIOD,
            lead: settings.lead_deg.to_radians(),
            hold_error: settings.hold_error_deg.to_radians(),
            torque: settings.torque_nm,
        };
        let board = Board { axes: axes.clone(), period: PERIOD, latency: settings.latency(), position_direct: true };
        let shared = Arc::new(SharedArm::new(ArmCore::new(joints, axes, numbers)));
        Ok(FeetechHardware { settings: settings.clone(), board, shared, thread: Mutex::new(None) })
    }

    /// Duration of the bus cycles.
    pub fn cycles(&self) -> BusCycles {
        self.shared.cycles()
    }

    fn start(&self) -> Result<(), DriverFault> {
        let mut thread = self.thread();
        if thread.as_ref().is_some_and(|thread| !thread.is_finished()) {
            return Ok(());
        }
        let worker = BusWorker::new(self.shared.clone(), self.settings.clone());
        let spawned = std::thread::Builder::new().name("feetech bus".into()).spawn(move || worker.run());
        *thread = Some(spawned.map_err(|e| DriverFault::Hardware(format!("no thread for the servo bus: {e}")))?);
        Ok(())
    }

    /// A driver, once the arm is in a state that this holds for.
    fn driver(&self, looks: bool) -> Result<Box<dyn Driver>, DriverFault> {
        let ready = |state: &crate::worker::SharedState| {
            let core = &state.core;
            if looks { core.is_read() && core.fault().is_none() } else { core.stage() == ConnectionStage::Driving }
        };
        // in a running system the driver reports the fault: no wait
        let known_before = self.shared.lock().was_driven;
        if !known_before && !self.shared.wait_for(self.settings.patience(), ready) {
            let state = self.shared.lock();
            let what = state.core.fault().unwrap_or("the servos give no readings").to_owned();
            return Err(DriverFault::Hardware(what));
        }
        Ok(Box::new(FeetechDriver::new(self.shared.clone(), self.board.clone(), looks)))
    }

    fn thread(&self) -> MutexGuard<'_, Option<JoinHandle<()>>> {
        self.thread.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Hardware for FeetechHardware {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        self.start()?;
        self.shared.lock().taken = true;
        self.driver(false)
    }

    fn look(&self) -> Option<Result<Box<dyn Driver>, DriverFault>> {
        Some(self.start().and_then(|()| self.driver(true)))
    }

    fn let_go(&self) {
        self.shared.lock().let_go = true;
    }

    fn known(&self) -> Known {
        Known { start: None, period: Some(PERIOD), motors: None }
    }
}

impl Drop for FeetechHardware {
    /// Brakes the arm, which then holds, and waits for that.
    fn drop(&mut self) {
        self.shared.end();
        if let Some(thread) = self.thread().take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of a servo bus had panicked");
        }
    }
}
