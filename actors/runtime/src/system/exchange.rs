//! Exchange of a robot's controller or driver while it runs.
//!
//! ```text
//! Offered ──boundary──> filter closed ──the new part fits──> all four actors stopped, parts replaced, actors restarted ──> TookOver
//!                          │ it does not: filter opens again, Refused
//! TookOver ──ready in time, no death, probation over──> Settled
//!              │ otherwise: the old parts are put back, all four actors restarted, Reverted
//! ```
//! Supervise finds the boundary: the robot is at rest, every outcome is given, and from that moment no command
//! passes (I10, F22). The history ring, the safe pose and the token are owned by the ledger and the gate, and
//! therefore survive the exchange. The exchange connects to a driver only at the boundary, because a new
//! connection begins with a stop.

mod beside;

pub(super) use beside::Beside;
pub use beside::{BesideOffer, NewBeside};

use crate::attempt::{Timed, attempt};
use crate::clock::ClockKind;
use crate::supervision::{Between, GroupMsg};
use crate::swap::SwapPolicy;
use crate::wiring::{HardwareHandle, Parts, Probation, RobotContext, SharedContext, SuperviseMsg};
use mobee_contract::{Board, Driver, DriverFault, Hardware, Pose, Status, SwapPart, SwapStep, Time, distance};
use mobee_controller::ControllerSettings;
use mobee_model::ShapeId;
use ractor::ActorRef;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::task::JoinSet;

/// Longest wait for a boundary.
const BOUNDARY_TIMEOUT: Duration = Duration::from_secs(60);
/// Time limit for connecting to a board.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(30);
/// Time limit for the first reading of a new driver, and for the robot of a new part to become ready.
const READY_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval of the checks of the robot during an exchange.
const CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// A new controller or driver.
#[derive(Clone)]
pub enum NewPart {
    /// Other settings of History, Supervise and Reflex.
    Controller(Box<ControllerSettings>),
    /// Another driver of the same board.
    Driver(Arc<dyn Hardware>),
}

impl NewPart {
    /// Kind of the part.
    pub fn part(&self) -> SwapPart {
        match self {
            NewPart::Controller(_) => SwapPart::Controller,
            NewPart::Driver(_) => SwapPart::Driver,
        }
    }
}

impl std::fmt::Debug for NewPart {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "NewPart({})", self.part())
    }
}

/// Offer of a new part.
#[derive(Clone, Debug)]
pub struct PartOffer {
    /// The new part.
    pub part: NewPart,
    /// Description of the part.
    pub what: String,
    /// Requirements on the part. A controller or driver can't observe: its shadow time is not used.
    pub terms: SwapPolicy,
}

/// The exchanges of a run.
pub(super) struct Exchanges {
    shared: Arc<SharedContext>,
    controller: ActorRef<GroupMsg>,
    pub(super) beside: Beside,
    tasks: JoinSet<()>,
}

impl Exchanges {
    /// Creates the set without any exchange.
    pub(super) fn new(shared: &Arc<SharedContext>, controller: &ActorRef<GroupMsg>) -> Exchanges {
        let beside = Beside::default();
        Exchanges { shared: shared.clone(), controller: controller.clone(), beside, tasks: JoinSet::new() }
    }

    /// Begins an exchange, if the robot exists and no other exchange of it is under way. The run continues
    /// during the exchange.
    pub(super) fn begin(&mut self, robot: &str, offer: PartOffer, reply: oneshot::Sender<Result<(), String>>) {
        while self.tasks.try_join_next().is_some() {}
        let Some(context) = self.shared.robots.iter().find(|w| w.name == robot).cloned() else {
            let _ = reply.send(Err(format!("there is no robot {robot} here")));
            return;
        };
        if std::mem::replace(&mut context.trial.lock().busy, true) {
            let why = "another swap of this robot's controller or driver is under way; wait until it is settled";
            let _ = reply.send(Err(why.into()));
            return;
        }
        let PartOffer { part, what, terms } = offer;
        let shared = self.shared.clone();
        let controller = self.controller.clone();
        let exchange = Exchange { shared, context, controller, part: part.part() };
        exchange.report(SwapStep::Offered { what, shadow: 0.0, probation: terms.probation.as_secs_f64() });
        let _ = reply.send(Ok(()));
        self.tasks.spawn(async move { exchange.carry_out(part, terms).await });
    }

    /// Ends all exchanges with the run: the parts stay as they are.
    pub(super) async fn end(&mut self) {
        self.tasks.shutdown().await;
        // The group answers after a renewal that is under way.
        let _ = ractor::call!(self.controller, GroupMsg::Status);
    }
}

struct Exchange {
    shared: Arc<SharedContext>,
    context: Arc<RobotContext>,
    controller: ActorRef<GroupMsg>,
    part: SwapPart,
}

impl Exchange {
    async fn carry_out(&self, part: NewPart, terms: SwapPolicy) {
        let offered = match &part {
            NewPart::Driver(hardware) => Some(HardwareHandle(hardware.clone())),
            NewPart::Controller(_) => None,
        };
        let last = match self.take_over(part).await {
            Err(why) => {
                // It may be connected already, perhaps to another robot.
                self.release(offered);
                SwapStep::Refused { why }
            }
            Ok(()) => match self.probation(terms).await {
                Ok(old) => {
                    self.release(Some(old.plug));
                    SwapStep::Settled
                }
                Err(why) => {
                    self.revert().await;
                    SwapStep::Reverted { why }
                }
            },
        };
        *self.context.trial.lock() = Probation::default();
        self.report(last);
    }

    fn report(&self, step: SwapStep) {
        self.shared.report_swap(&self.context, self.part, step);
    }

    /// Puts the new part in place at a boundary.
    ///
    /// # Errors
    /// The reason for a refusal; nothing is changed then.
    async fn take_over(&self, part: NewPart) -> Result<(), String> {
        self.boundary().await?;
        let begun = self.shared.clock.now();
        let new = match self.fit(part, begun).await {
            Ok(new) => new,
            Err(why) => {
                self.context.supervise.send(SuperviseMsg::Resume);
                return Err(why);
            }
        };
        let shared = self.shared.clone();
        let context = self.context.clone();
        let renewed = self.renew(move || {
            // A restart in between may have opened the filter.
            if context.ledger.book().open.is_none() {
                if context.gate.is_open() {
                    shared.fence(&context, "a part that is exchanged");
                }
                let old = shared.install(&context, new);
                context.trial.lock().old = Some(old);
            }
        });
        renewed.await?;
        let took_over = {
            let trial = self.context.trial.lock();
            trial.old.is_some() || trial.broke.is_some()
        };
        if !took_over {
            return Err("the robot was moved in between; try again".into());
        }
        let gap = self.shared.clock.now().since(begun).as_secs_f64();
        self.report(SwapStep::TookOver { gap, map: None });
        Ok(())
    }

    /// Waits until supervise has closed the filter at a boundary.
    async fn boundary(&self) -> Result<(), String> {
        let clock = &self.shared.clock;
        let until = clock.now() + BOUNDARY_TIMEOUT;
        while clock.now() < until {
            let (reply, yielded) = ractor::concurrency::oneshot();
            self.context.supervise.send(SuperviseMsg::Yield(reply.into()));
            tokio::select! {
                biased;
                // An error: supervise is being restarted and has lost the request.
                yielded = yielded => if yielded.is_ok() { return Ok(()) },
                () = clock.sleep_until(until) => break,
            }
            clock.sleep(CHECK_INTERVAL).await;
        }
        self.context.supervise.send(SuperviseMsg::Resume);
        let status = self.context.latest.lock().status;
        let state = word(status);
        Err(format!(
            "the robot did not come to rest with all motions ended within {} s ({state})",
            BOUNDARY_TIMEOUT.as_secs()
        ))
    }

    /// Returns the parts with the new one, if it fits the robot at rest.
    async fn fit(&self, part: NewPart, begun: Time) -> Result<Parts, String> {
        let old = self.context.parts.lock().clone();
        match part {
            NewPart::Controller(controller) => {
                let new = old.with_controller(*controller);
                self.check_margin(old.rules.margin, new.rules.margin).map(|()| new)
            }
            NewPart::Driver(hardware) => {
                // Only readings are requested until the robot is identified: another robot must not receive a
                // command.
                let candidate = hardware.clone();
                let look = move || Timed { value: candidate.look(), cost: Duration::ZERO };
                let looked = attempt(&self.shared.clock, CONNECT_TIMEOUT, look).await?;
                let looked_at = looked.is_some();
                let driver = match looked {
                    Some(driver) => driver.map_err(unconnected)?,
                    None => self.connect(&hardware).await?,
                };
                let board = driver.board().clone();
                same_board(&old.board, &board, old.rules.tolerance)?;
                let q = self.first_reading(driver, begun).await?;
                let away = distance(&q, &self.context.latest.lock().q);
                if away.is_nan() || away > old.rules.tolerance {
                    let [away, most] = [away, old.rules.tolerance].map(|q| old.board.units().told(q, 2));
                    return Err(format!(
                        "the pose that it reads is {away} from the robot's, more than {most}; it drives another robot"
                    ));
                }
                if looked_at {
                    self.connect(&hardware).await?;
                }
                Ok(old.with_driver(HardwareHandle(hardware), board))
            }
        }
    }

    /// Checks that a greater margin does not begin with a contact.
    fn check_margin(&self, old: f64, new: f64) -> Result<(), String> {
        let scene = self.shared.scene.lock().clone();
        let poses: Vec<Pose> = self.shared.robots.iter().map(|w| w.latest.lock().q.clone()).collect();
        let own = |id: ShapeId| matches!(id, ShapeId::Robot { robot, .. } if usize::from(robot) == self.context.robot);
        let near =
            scene.contacts(&poses, new).into_iter().find(|c| c.distance >= old && (own(c.pair.0) || own(c.pair.1)));
        let Some(contact) = near else { return Ok(()) };
        let (a, b) = self.shared.names(contact.pair);
        let [distance, margin] = [contact.distance, new].map(|m| m * 1e3);
        Err(format!(
            "{a} is {distance:.1} mm from {b} where the robot rests, nearer than the new margin of {margin} mm"
        ))
    }

    async fn connect(&self, hardware: &Arc<dyn Hardware>) -> Result<Box<dyn Driver>, String> {
        let candidate = hardware.clone();
        let connect = move || Timed { value: candidate.connect(), cost: Duration::ZERO };
        attempt(&self.shared.clock, CONNECT_TIMEOUT, connect).await?.map_err(unconnected)
    }

    /// Returns the first reading that is newer than the boundary.
    async fn first_reading(&self, driver: Box<dyn Driver>, begun: Time) -> Result<Pose, String> {
        let clock = &self.shared.clock;
        let until = clock.now() + READY_TIMEOUT;
        let mut driver = Some(driver);
        while let Some(mut candidate) = driver.take() {
            let now = clock.now();
            if now >= until {
                break;
            }
            let read = move || {
                let value = candidate.sample(now);
                let next = candidate.next_sample(now);
                Timed { value: (value, next, candidate), cost: Duration::ZERO }
            };
            let (read, next, candidate) = attempt(clock, READY_TIMEOUT, read).await?;
            match read {
                Ok(Some(sample)) if sample.at >= begun => return Ok(sample.q),
                Ok(_) => {}
                Err(DriverFault::Hardware(what)) => return Err(format!("the board reports a fault: {what}")),
                Err(fault) => return Err(fault.to_string()),
            }
            clock.sleep_until(next.max(now + Duration::from_millis(1))).await;
            driver = Some(candidate);
        }
        Err(format!("it gives no reading within {} s", READY_TIMEOUT.as_secs()))
    }

    /// Stops the robot's actors in order, runs the closure, and starts them again.
    async fn renew(&self, between: impl FnOnce() + Send + 'static) -> Result<(), String> {
        let robot = self.context.name.clone();
        let between = Between(Box::new(between));
        let renewed = ractor::call!(self.controller, GroupMsg::Renew, robot, between);
        renewed.map_err(|_| "the robot's controller is down".into())
    }

    /// Watches the new part until its probation is over, and returns the old parts then.
    ///
    /// # Errors
    /// The failure of the new part.
    async fn probation(&self, terms: SwapPolicy) -> Result<Parts, String> {
        let clock = &self.shared.clock;
        let begun = clock.now();
        let mut seen: Option<Time> = None;
        loop {
            clock.sleep(CHECK_INTERVAL).await;
            if let Some((why, _)) = &self.context.trial.lock().broke {
                return Err(why.clone());
            }
            let now = clock.now();
            let latest = self.context.latest.lock().clone();
            let status = latest.status;
            let acts = !matches!(status, Status::Starting | Status::Rest | Status::Holding(_));
            let ready = acts || latest.ready;
            if ready {
                seen = Some(now);
            }
            // The board itself may be silent for a while: that is the driver's fault only if it lasts.
            let patience = if seen.is_some() { terms.budget.max(READY_TIMEOUT / 10) } else { READY_TIMEOUT };
            if now > seen.unwrap_or(begun) + patience && (seen.is_none() || self.part == SwapPart::Driver) {
                return Err(format!("the robot is not ready: {}", word(status)));
            }
            if now >= begun + terms.probation && ready {
                let old = self.context.trial.lock().old.take();
                return old.ok_or_else(|| "it broke as its probation ended".into());
            }
        }
    }

    /// Puts the old parts back.
    async fn revert(&self) {
        self.shared.fence(&self.context, &format!("{}/new {}", self.context.name, self.part));
        let shared = self.shared.clone();
        let context = self.context.clone();
        // An actor that died was restarted with the old parts; the others still run with the new ones.
        let renewed = self.renew(move || {
            // Described in either case: a restarted reflex reports contacts again that its predecessor has
            // reported (I27).
            if !shared.count_against(&context, "it is not ready") {
                shared.describe(&context);
            }
        });
        // A controller that is down has reported that.
        let _ = renewed.await;
        let broken = self.context.trial.lock().broke.take().map(|(_, broken)| broken);
        self.release(broken.map(|parts| parts.plug));
    }

    /// Releases hardware that is not used, or no longer; no-op for that in use.
    fn release(&self, plug: Option<HardwareHandle>) {
        let Some(plug) = plug else { return };
        if Arc::ptr_eq(&plug.0, &self.context.parts.lock().plug.0) {
            return;
        }
        plug.0.let_go();
        if self.shared.clock.kind() == ClockKind::Real {
            // The drop may wait for its network.
            tokio::task::spawn_blocking(move || drop(plug));
        }
    }
}

fn word(status: Status) -> String {
    if let Status::Holding(hold) = status { hold.to_string() } else { status.word().into() }
}

fn unconnected(fault: DriverFault) -> String {
    format!("{fault}; see that the board is switched on and connected")
}

/// Checks that two drivers are of the same board.
fn same_board(old: &Board, new: &Board, tolerance: f64) -> Result<(), String> {
    let names = |board: &Board| board.axes.iter().map(|a| a.name.clone()).collect::<Vec<String>>();
    if names(old) != names(new) {
        return Err(format!(
            "it drives other motors: {}; the robot has {}",
            names(new).join(", "),
            names(old).join(", ")
        ));
    }
    for (a, b) in old.axes.iter().zip(&new.axes) {
        let apart = (a.min - b.min).abs().max((a.max - b.max).abs());
        if apart.is_nan() || apart > tolerance {
            let [new, old] = [b, a].map(|axis| axis.motion.told_range([axis.min, axis.max], 2));
            return Err(format!("motor {} goes from {new} by it, and from {old} by the one in force", a.name));
        }
    }
    Ok(())
}
