//! Supervision as in OTP, on top of ractor, which reports deaths but has no restart strategies.
//!
//! A [`Group`] starts its children in order and stops them in reverse order, one at a time (ractor's own order
//! is not stable). After a failure it restarts the child, and its siblings according to the [`Strategy`]. If
//! more restarts are needed in a period than its [`Intensity`] allows, it stops all children, emits `GaveUp`,
//! and fails, so that its parent is notified. Groups nest.
//!
//! A planned end drains a child's mailbox (`stop` would discard the queued messages) and kills the child only
//! after its grace period. A kill counts as a failure. State that must survive a restart is owned by the
//! child's start closure, not by the child.

mod plan;
pub use plan::{Input, Intensity, Restart, RestartPlan, RestartStep, Strategy};

use crate::clock::Clock;
use mobee_contract::{Event, Time};
use ractor::{
    Actor, ActorCell, ActorId, ActorProcessingErr, ActorRef, ActorStatus, RpcReplyPort, SpawnErr, SupervisionEvent,
};
use std::collections::VecDeque;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

/// Result of a start closure: the child's cell, linked to the supervisor that it was called with.
pub type Starting = Pin<Box<dyn Future<Output = Result<ActorCell, String>> + Send>>;
type Hook<A> = Arc<dyn Fn(A) + Send + Sync>;

/// A child of a group: its start closure and restart policy. Cheap to clone.
#[derive(Clone)]
pub struct Child {
    name: Arc<str>,
    restart: Restart,
    grace: Option<Duration>,
    start: Arc<dyn Fn(ActorCell) -> Starting + Send + Sync>,
}

impl Child {
    /// Creates a permanent child with one second of grace. `start` is called with the supervisor's cell, to be
    /// passed to `spawn_linked`. Actors must have no registered name, because ractor's registry is shared by
    /// the whole process.
    pub fn new<F>(name: impl Into<Arc<str>>, start: impl Fn(ActorCell) -> F + Send + Sync + 'static) -> Child
    where
        F: Future<Output = Result<ActorCell, String>> + Send + 'static,
    {
        Child {
            name: name.into(),
            restart: Restart::Permanent,
            grace: Some(Duration::from_secs(1)),
            start: Arc::new(move |supervisor| Box::pin(start(supervisor))),
        }
    }

    /// Creates a child that is a group. It may take any time to stop.
    pub fn group(group: Group) -> Child {
        let name = group.name.clone();
        let start = move |supervisor: ActorCell| {
            let group = group.clone();
            async move { group.start(Some(supervisor)).await.map(|g| g.get_cell()).map_err(|e| e.to_string()) }
        };
        Child { grace: None, ..Child::new(name, start) }
    }

    /// Sets the restart policy.
    pub fn restart(self, restart: Restart) -> Child {
        Child { restart, ..self }
    }

    /// Sets the time to drain its mailbox before it is killed; `None` sets no limit.
    pub fn grace(self, grace: Option<Duration>) -> Child {
        Child { grace, ..self }
    }
}

/// Receiver of events about the lives of children, with the time of the run.
pub type Emit = Arc<dyn Fn(Time, Event) + Send + Sync>;

/// A group of children under one supervisor. Cheap to clone: each clone can be started.
#[derive(Clone)]
pub struct Group {
    name: Arc<str>,
    strategy: Strategy,
    intensity: Intensity,
    children: Vec<Child>,
    clock: Clock,
    emit: Emit,
    on_death: Hook<(Arc<str>, String)>,
    on_restart: Hook<(Arc<str>, u32)>,
    on_give_up: Hook<()>,
}

impl Group {
    /// Creates a group without children or hooks.
    pub fn new(name: impl Into<Arc<str>>, strategy: Strategy, intensity: Intensity, clock: Clock, emit: Emit) -> Group {
        Group {
            name: name.into(),
            strategy,
            intensity,
            children: Vec::new(),
            clock,
            emit,
            on_death: Arc::new(|_| ()),
            on_restart: Arc::new(|_| ()),
            on_give_up: Arc::new(|()| ()),
        }
    }

    /// Adds a child, started after the others.
    pub fn child(mut self, child: Child) -> Group {
        self.children.push(child);
        self
    }

    /// Sets a hook that is called with (name, reason) when a child has died, before any other reaction.
    pub fn on_death(self, hook: impl Fn(&str, &str) + Send + Sync + 'static) -> Group {
        Group { on_death: Arc::new(move |(name, reason)| hook(&name, &reason)), ..self }
    }

    /// Sets a hook that is called with (name, restarts within the period) after a child was restarted.
    pub fn on_restart(self, hook: impl Fn(&str, u32) + Send + Sync + 'static) -> Group {
        Group { on_restart: Arc::new(move |(name, count)| hook(&name, count)), ..self }
    }

    /// Sets a hook that is called when the restarts are used up and all children have been stopped.
    pub fn on_give_up(self, hook: impl Fn() + Send + Sync + 'static) -> Group {
        Group { on_give_up: Arc::new(move |()| hook()), ..self }
    }

    /// Starts the supervisor and its children.
    ///
    /// # Errors
    /// If a child could not be started within the restart limit; those before it have then been stopped again.
    pub async fn start(&self, parent: Option<ActorCell>) -> Result<ActorRef<GroupMsg>, SpawnErr> {
        let (group, _) = match parent {
            Some(parent) => Actor::spawn_linked(None, Supervisor, self.clone(), parent).await?,
            None => Actor::spawn(None, Supervisor, self.clone()).await?,
        };
        Ok(group)
    }
}

/// Requests to a supervisor.
#[derive(Debug)]
pub enum GroupMsg {
    /// Stop all children in reverse order, then the supervisor; the reply comes when the children have ended.
    Stop(RpcReplyPort<()>),
    /// Report the state of the children.
    Status(RpcReplyPort<Health>),
    /// Kill the child of this name, here or in a group below, as a fault would: a group fails after stopping
    /// its children in order. The reply is whether there was one.
    Kill(String, RpcReplyPort<bool>),
    /// Stop all children of the group of this name, or of a child group, in reverse order, run the closure, and
    /// start them again. This counts neither as a failure nor as a restart. A child group that is down is
    /// started, with all its restarts available. The reply comes when they are up; there is none if there is no
    /// such group, or it could not be started.
    Renew(String, Between, RpcReplyPort<()>),
    /// Fail, as after a fault.
    Fail,
}

/// Closure that runs while no child of a group runs.
pub struct Between(pub Box<dyn FnOnce() + Send>);

impl std::fmt::Debug for Between {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Between")
    }
}

/// State of a group or child.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Health {
    /// Its name.
    pub name: String,
    /// True if it is running.
    pub alive: bool,
    /// Restarts since its supervisor was started; for the group that answers, those within its period.
    pub restarts: u32,
    /// A group's children in their order.
    pub children: Vec<Health>,
}

struct Supervisor;

struct RunningGroup {
    group: Group,
    plan: RestartPlan,
    cells: Vec<Option<ActorCell>>,
    restarts: Vec<u32>,
    begun: bool,
}

impl RunningGroup {
    /// Executes the steps of the plan until none is left.
    ///
    /// # Errors
    /// If the group gave up.
    async fn run(&mut self, input: Input, me: &ActorCell) -> Result<(), ActorProcessingErr> {
        let mut steps: VecDeque<RestartStep> = self.plan.on(input, self.group.clock.now()).into();
        while let Some(step) = steps.pop_front() {
            match step {
                RestartStep::Stop(child) => {
                    self.stop(child).await;
                    self.plan.on(Input::Stopped(child), self.group.clock.now());
                }
                // ractor links no child to an actor that is being drained: `post_stop` stops the children that
                // still run.
                RestartStep::Start(_) if is_ending(me) => drop(self.plan.on(Input::End, self.group.clock.now())),
                RestartStep::Start(child) => {
                    if let Err(reason) = self.start(child, me).await {
                        if is_ending(me) {
                            continue;
                        }
                        self.report_death(child, reason);
                        steps = self.plan.on(Input::Died { child, failed: true }, self.group.clock.now()).into();
                    }
                }
                RestartStep::GiveUp => {
                    let group = self.group.name.to_string();
                    (self.group.emit)(self.group.clock.now(), Event::GaveUp { group });
                    (self.group.on_give_up)(());
                    return Err(format!("{} used up its restarts", self.group.name).into());
                }
            }
        }
        Ok(())
    }

    async fn start(&mut self, i: usize, me: &ActorCell) -> Result<(), String> {
        let Some(child) = self.group.children.get(i).cloned() else { return Ok(()) };
        let cell = (child.start)(me.clone()).await?;
        if let Some(slot) = self.cells.get_mut(i) {
            *slot = Some(cell);
        }
        let now = self.group.clock.now();
        self.plan.on(Input::Started(i), now);
        if self.begun {
            if let Some(count) = self.restarts.get_mut(i) {
                *count += 1;
            }
            let restarts = self.plan.restarts(now);
            (self.group.emit)(now, Event::Restarted { actor: child.name.to_string(), restarts });
            (self.group.on_restart)((child.name, restarts));
        }
        Ok(())
    }

    async fn stop(&mut self, i: usize) {
        let Some(cell) = self.cells.get_mut(i).and_then(Option::take) else { return };
        let grace = self.group.children.get(i).and_then(|c| c.grace);
        // An error means that it has already ended, or did not end in time.
        if cell.drain_and_wait(grace).await.is_err() {
            cell.kill();
            let _ = cell.wait(grace).await;
        }
    }

    async fn renew(&mut self, between: Between, me: &ActorCell) -> Result<(), ActorProcessingErr> {
        for child in (0..self.cells.len()).rev() {
            if self.plan.is_up(child) {
                self.stop(child).await;
                self.plan.on(Input::Stopped(child), self.group.clock.now());
            }
        }
        (between.0)();
        self.begun = false;
        let renewed = self.run(Input::Begin, me).await;
        self.begun = true;
        renewed
    }

    fn report_death(&mut self, child: usize, reason: String) {
        let Some(name) = self.group.children.get(child).map(|c| c.name.clone()) else { return };
        (self.group.on_death)((name.clone(), reason.clone()));
        (self.group.emit)(self.group.clock.now(), Event::Died { actor: name.to_string(), reason });
    }

    /// Child that has this cell now; `None` if it was stopped or replaced since.
    fn find(&self, id: ActorId) -> Option<usize> {
        self.cells.iter().position(|c| c.as_ref().is_some_and(|c| c.get_id() == id))
    }

    async fn health(&self) -> Health {
        let mut children = Vec::new();
        for ((child, cell), restarts) in self.group.children.iter().zip(&self.cells).zip(&self.restarts) {
            let below = match cell.as_ref().and_then(as_group) {
                Some(group) => ractor::call!(group, GroupMsg::Status).map(|h| h.children).unwrap_or_default(),
                None => Vec::new(),
            };
            let name = child.name.to_string();
            let alive = cell.is_some();
            children.push(Health { name, alive, restarts: *restarts, children: below });
        }
        let restarts = self.plan.restarts(self.group.clock.now());
        Health { name: self.group.name.to_string(), alive: true, restarts, children }
    }

    /// The child of this name, if it is a running group.
    fn child_group(&self, name: &str) -> Option<ActorRef<GroupMsg>> {
        let child = self.group.children.iter().position(|c| &*c.name == name)?;
        self.cells.get(child)?.as_ref().and_then(as_group)
    }

    async fn kill(&self, name: &str) -> bool {
        let own = self.group.children.iter().position(|c| &*c.name == name);
        if let Some(cell) = own.and_then(|i| self.cells.get(i)).and_then(Option::as_ref) {
            match as_group(cell) {
                Some(group) => return group.send_message(GroupMsg::Fail).is_ok(),
                None => cell.kill(),
            }
            return true;
        }
        for group in self.cells.iter().flatten().filter_map(as_group) {
            if ractor::call!(group, GroupMsg::Kill, name.to_string()).unwrap_or(false) {
                return true;
            }
        }
        false
    }
}

/// True if this supervisor is being drained or is ending: no child can be linked to it any more.
fn is_ending(me: &ActorCell) -> bool {
    me.get_status() >= ActorStatus::Draining
}

fn as_group(cell: &ActorCell) -> Option<ActorRef<GroupMsg>> {
    (cell.is_message_type_of::<GroupMsg>() == Some(true)).then(|| cell.clone().into())
}

impl Actor for Supervisor {
    type Msg = GroupMsg;
    type State = RunningGroup;
    type Arguments = Group;

    async fn pre_start(&self, myself: ActorRef<GroupMsg>, group: Group) -> Result<RunningGroup, ActorProcessingErr> {
        let n = group.children.len();
        let policies = group.children.iter().map(|c| c.restart).collect();
        let plan = RestartPlan::new(group.strategy, group.intensity, policies);
        let mut running = RunningGroup { group, plan, cells: vec![None; n], restarts: vec![0; n], begun: false };
        running.run(Input::Begin, &myself.get_cell()).await?;
        running.begun = true;
        Ok(running)
    }

    async fn handle(
        &self,
        myself: ActorRef<GroupMsg>,
        message: GroupMsg,
        running: &mut RunningGroup,
    ) -> Result<(), ActorProcessingErr> {
        let me = myself.get_cell();
        match message {
            GroupMsg::Stop(reply) => {
                running.run(Input::End, &me).await?;
                let _ = reply.send(());
                myself.stop(None);
            }
            GroupMsg::Status(reply) => {
                let _ = reply.send(running.health().await);
            }
            GroupMsg::Kill(name, reply) => {
                let _ = reply.send(running.kill(&name).await);
            }
            GroupMsg::Renew(name, between, reply) => {
                if *name == *running.group.name {
                    running.renew(between, &me).await?;
                    let _ = reply.send(());
                } else if let Some(group) = running.child_group(&name) {
                    let _ = group.send_message(GroupMsg::Renew(name, between, reply));
                } else if let Some(child) = running.group.children.iter().position(|c| *c.name == *name) {
                    (between.0)();
                    match running.start(child, &me).await {
                        Ok(()) => drop(reply.send(())),
                        Err(reason) => running.report_death(child, reason),
                    }
                }
            }
            GroupMsg::Fail => {
                running.run(Input::End, &me).await?;
                return Err("killed".into());
            }
        }
        Ok(())
    }

    async fn handle_supervisor_evt(
        &self,
        myself: ActorRef<GroupMsg>,
        event: SupervisionEvent,
        running: &mut RunningGroup,
    ) -> Result<(), ActorProcessingErr> {
        let (id, failed, reason) = match event {
            SupervisionEvent::ActorFailed(actor, error) => (actor.get_id(), true, error.to_string()),
            SupervisionEvent::ActorTerminated(actor, _, reason) => {
                let failed = matches!(reason.as_deref(), Some("killed" | "actor_task_cancelled"));
                (actor.get_id(), failed, reason.unwrap_or_else(|| "ended".into()))
            }
            _ => return Ok(()),
        };
        let Some(child) = running.find(id) else { return Ok(()) };
        if let Some(slot) = running.cells.get_mut(child) {
            *slot = None;
        }
        let permanent = running.group.children.get(child).is_some_and(|c| c.restart == Restart::Permanent);
        if failed || permanent {
            running.report_death(child, reason);
        }
        running.run(Input::Died { child, failed }, &myself.get_cell()).await
    }

    /// Stops the children in the group's order, not in ractor's, when the group itself is drained or stopped.
    async fn post_stop(
        &self,
        myself: ActorRef<GroupMsg>,
        running: &mut RunningGroup,
    ) -> Result<(), ActorProcessingErr> {
        running.run(Input::End, &myself.get_cell()).await
    }
}
