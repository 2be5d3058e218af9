//! The supervision tree.
//!
//! ```text
//! controller                    one-for-one
//! ├── model                     one for all robots
//! └── <robot>                   rest-for-one: driver, history, supervise, reflex
//! agents                        one-for-one, each with its own budget
//! └── <robot>/agents/agent
//! services                      one-for-one, each with its own budget; beside the safety chain
//! └── <service>/services/service
//! sensors                       one-for-one, each with its own budget; beside the safety chain
//! └── <sensor>/sensor           one-for-one: camera and detector of each of its cameras, locator
//! taps                          one-for-one: monitors of the threads of journal and recorder
//! ├── journal
//! └── recorder
//! ```

use crate::load::Measured;
use crate::shell::{
    AgentActor, CameraActor, CameraChannel, DetectorActor, DriverActor, GRACE, HistoryActor, LocatorActor, ModelActor,
    ReflexActor, Sensor, ServiceActor, ServiceSlot, SuperviseActor,
};
use crate::supervision::{Child, Group, Intensity, Restart, Strategy};
use crate::tap::TapActor;
use crate::wiring::{LatestCell, RobotContext, SharedContext, Troubled};
use mobee_contract::{Event, Time};
use mobee_journal::names::{CAMERA, DETECTOR, SENSOR, SERVICE, SERVICES};
use ractor::{Actor, ActorCell};
use std::sync::Arc;
use std::time::Duration;

/// Restarts of a robot's controller, or of an agent, that are allowed within [`PERIOD`].
const MAX_RESTARTS: u32 = 8;
/// Period of [`MAX_RESTARTS`].
const PERIOD: Duration = Duration::from_secs(30);

/// Creates a child that is spawned with these arguments.
fn child<A>(
    shared: &SharedContext,
    name: String,
    actor: fn() -> A,
    arguments: impl Fn() -> A::Arguments + Send + Sync + 'static,
) -> Child
where
    A: Actor + 'static,
    A::Arguments: Send,
{
    let own = name.clone();
    let troubles = shared.troubles.clone();
    let load = shared.loads.as_ref().map(|loads| loads.of(&name));
    Child::new(name, move |parent: ActorCell| {
        let arguments = arguments();
        let troubled = troubles.clone().map(|t| Troubled::new(actor(), own.clone(), t));
        let load = load.clone();
        async move {
            let spawned = match (troubled, load) {
                (Some(troubled), _) => Actor::spawn_linked(None, troubled, arguments, parent).await,
                (None, Some(load)) => Actor::spawn_linked(None, Measured::new(actor(), load), arguments, parent).await,
                (None, None) => Actor::spawn_linked(None, actor(), arguments, parent).await,
            };
            spawned.map(|(actor, _)| actor.get_cell()).map_err(|e| e.to_string())
        }
    })
}

fn group(name: &str, strategy: Strategy, shared: &Arc<SharedContext>) -> Group {
    let intensity = Intensity { restarts: MAX_RESTARTS, period: PERIOD };
    let restarted = shared.clone();
    let gave_up = shared.clone();
    Group::new(name.to_string(), strategy, intensity, shared.clock.clone(), shared.taps.emitter())
        .on_restart(move |_, _| restarted.counts.lock().restarts += 1)
        .on_give_up(move || {
            let mut counts = gave_up.counts.lock();
            counts.gave_up += 1;
            counts.is_given_up = true;
        })
}

/// Group of the actors that monitor the sinks and reopen a failed one. Their deaths have no effect on other
/// actors.
pub fn taps(shared: &Arc<SharedContext>) -> Group {
    shared.taps.names().fold(group("taps", Strategy::OneForOne, shared), |root, name| {
        let taps = shared.taps.clone();
        let clock = shared.clock.clone();
        let sink = name.to_owned();
        root.child(child(shared, name.to_owned(), || TapActor, move || (taps.clone(), clock.clone(), sink.clone())))
    })
}

/// Group of the safety chain of all robots.
pub fn controller(shared: &Arc<SharedContext>) -> Group {
    let fence = shared.clone();
    let model = shared.clone();
    let mut root = group("controller", Strategy::OneForOne, shared)
        .on_death(move |name, _| {
            // The model's death closes all robots' filters, a group's death its own.
            for context in fence.robots.iter().filter(|w| name == "model" || name == w.name) {
                fence.fence(context, name);
            }
        })
        .child(child(shared, "model".into(), || ModelActor, move || model.clone()));
    for context in &shared.robots {
        root = root.child(Child::group(robot(shared, context)).restart(Restart::Temporary));
    }
    root
}

fn robot(shared: &Arc<SharedContext>, context: &Arc<RobotContext>) -> Group {
    let name = |part: &str| format!("{}/{part}", context.name);
    let both = || {
        let shared = shared.clone();
        let context = context.clone();
        move || (shared.clone(), context.clone())
    };
    let fence = shared.clone();
    let fenced = context.clone();
    group(&context.name, Strategy::RestForOne, shared)
        .on_death(move |name, reason| {
            fence.fence(&fenced, name);
            fence.count_against(&fenced, &format!("{name} died: {reason}"));
        })
        .child(child(shared, name("driver"), || DriverActor, both()))
        .child(child(shared, name("history"), || HistoryActor, both()))
        .child(child(shared, name("supervise"), || SuperviseActor, both()))
        .child(child(shared, name("reflex"), || ReflexActor, both()))
}

/// Group of the agents: their deaths can't affect a controller.
pub fn agents(shared: &Arc<SharedContext>) -> Group {
    let mut root = group("agents", Strategy::OneForOne, shared);
    for context in shared.robots.iter().filter(|w| w.slot.lock().maker.is_some()) {
        root = root.child(Child::group(agent(shared, context)).restart(Restart::Temporary));
    }
    root
}

/// Group of the agent of one robot.
pub fn agent(shared: &Arc<SharedContext>, context: &Arc<RobotContext>) -> Group {
    let orphan = context.clone();
    let arguments = {
        let shared = shared.clone();
        let context = context.clone();
        move || (shared.clone(), context.clone())
    };
    group(&format!("{}/agents", context.name), Strategy::OneForOne, shared)
        .on_death(move |_, _| {
            orphan.agent_died(orphan.agent_name.clone());
        })
        .child(child(shared, context.agent_name.to_string(), || AgentActor, arguments))
}

/// Group of the services: the run continues after the failure of any of them.
pub fn services(shared: &Arc<SharedContext>, service_slots: &[Arc<ServiceSlot>]) -> Group {
    service_slots.iter().fold(group("services", Strategy::OneForOne, shared), |root, service_slot| {
        let fallen = service_slot.clone();
        let run = shared.clone();
        let given_up = service_slot.clone();
        let gone = shared.clone();
        let arguments = {
            let shared = shared.clone();
            let service_slot = service_slot.clone();
            move || (shared.clone(), service_slot.clone())
        };
        let served = child(shared, format!("{}/{SERVICE}", service_slot.name()), || ServiceActor, arguments);
        let own = group(&services_of(service_slot.name()), Strategy::OneForOne, shared)
            .on_death(move |_, reason| fallen.failed(&run, reason))
            .on_give_up(move || given_up.give_up(&gone))
            .child(served.restart(Restart::Transient).grace(Some(GRACE)));
        root.child(Child::group(own).restart(Restart::Temporary))
    })
}

/// Name of the group of a service.
pub fn services_of(service: &str) -> String {
    format!("{service}/{SERVICES}")
}

/// Name of the group of a sensor.
pub fn sensor_of(sensor: &str) -> String {
    format!("{sensor}/{SENSOR}")
}

/// Group of the sensors: their deaths only make objects stale.
pub fn sensors(shared: &Arc<SharedContext>, sensors: &[Arc<Sensor>]) -> Group {
    sensors.iter().fold(group("sensors", Strategy::OneForOne, shared), |root, sensor| {
        root.child(Child::group(self::sensor(shared, sensor)).restart(Restart::Temporary))
    })
}

fn sensor(shared: &Arc<SharedContext>, sensor: &Arc<Sensor>) -> Group {
    let gone = shared.clone();
    let blind = sensor.clone();
    let run = shared.clone();
    let channels = sensor.channels.clone();
    let locator_slot = sensor.locator_slot.clone();
    // Reason for the last restart.
    let last = Arc::new(LatestCell::<String>::default());
    let cause = last.clone();
    let mut own = group(&sensor_of(&sensor.name), Strategy::OneForOne, shared)
        .on_death(move |name, reason| {
            let detector = |channel: &&Arc<CameraChannel>| *name == format!("{}/{DETECTOR}", channel.name);
            channels.iter().filter(detector).for_each(|channel| channel.failed(&run, reason));
            locator_slot
                .iter()
                .filter(|locator_slot| locator_slot.name == *name)
                .for_each(|locator_slot| locator_slot.failed(&run, reason));
            *cause.lock() = format!("{name} died: {reason}");
        })
        .on_give_up(move || {
            let why = last.lock().clone();
            let text = format!("sensor {} has used up its restarts and is down: {why}", blind.name);
            gone.emit(Event::Warning { text });
            gone.give_up_beside(&blind.name, why);
            // The sensor no longer checks for stale objects.
            blind.locator_slot.iter().for_each(|locator_slot| locator_slot.report_stale(&gone, Time(u64::MAX)));
        });
    for channel in &sensor.channels {
        let both = || {
            let shared = shared.clone();
            let channel = channel.clone();
            move || (shared.clone(), channel.clone())
        };
        let name = |part: &str| format!("{}/{part}", channel.name);
        own = own.child(child(shared, name(CAMERA), || CameraActor, both())).child(child(
            shared,
            name(DETECTOR),
            || DetectorActor,
            both(),
        ));
    }
    if let Some(locator_slot) = &sensor.locator_slot {
        let name = locator_slot.name.clone();
        let run = shared.clone();
        let channels = sensor.channels.clone();
        let locator_slot = locator_slot.clone();
        let arguments = move || (run.clone(), channels.clone(), locator_slot.clone());
        own = own.child(child(shared, name, || LocatorActor, arguments));
    }
    own
}
