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
//! └── <sensor>/sensor           one-for-one: camera, detector
//! taps                          one-for-one: what watches over the threads of journal and recorder
//! ├── journal
//! └── recorder
//! ```

use super::trouble::Troubled;
use crate::record::tap::TapActor;
use crate::runtime::supervision::{Child, Group, Intensity, Restart, Strategy};
use crate::shell::{
    AgentActor, CameraActor, DetectorActor, DriverActor, GRACE, HistoryActor, ModelActor, Post, ReflexActor, Sensor,
    ServiceActor, SuperviseActor, SuperviseMsg,
};
use crate::wiring::{Hub, Wires};
use mobee_contract::Event;
use ractor::{Actor, ActorCell};
use std::sync::Arc;
use std::time::Duration;

/// Restarts that a robot's controller, and each agent, may need within [`PERIOD`].
const BUDGET: u32 = 8;
const PERIOD: Duration = Duration::from_secs(30);

/// A child that is spawned with these arguments.
fn child<A>(
    hub: &Hub,
    name: String,
    actor: fn() -> A,
    arguments: impl Fn() -> A::Arguments + Send + Sync + 'static,
) -> Child
where
    A: Actor + 'static,
    A::Arguments: Send,
{
    let (own, troubles) = (name.clone(), hub.troubles.clone());
    Child::new(name, move |parent: ActorCell| {
        let (arguments, troubled) = (arguments(), troubles.clone().map(|t| Troubled::new(actor(), own.clone(), t)));
        async move {
            let spawned = match troubled {
                Some(troubled) => Actor::spawn_linked(None, troubled, arguments, parent).await,
                None => Actor::spawn_linked(None, actor(), arguments, parent).await,
            };
            spawned.map(|(actor, _)| actor.get_cell()).map_err(|e| e.to_string())
        }
    })
}

fn group(name: &str, strategy: Strategy, hub: &Arc<Hub>) -> Group {
    let intensity = Intensity { restarts: BUDGET, period: PERIOD };
    let (restarted, gave_up) = (hub.clone(), hub.clone());
    Group::new(name.to_string(), strategy, intensity, hub.clock.clone(), hub.taps.clone())
        .on_restart(move |_, _| restarted.counts.lock().restarts += 1)
        .on_give_up(move || gave_up.counts.lock().gave_up += 1)
}

/// Those who watch over the sinks, and open one anew if it fails. Their deaths harm nobody.
pub fn taps(hub: &Arc<Hub>) -> Group {
    hub.taps.names().fold(group("taps", Strategy::OneForOne, hub), |root, name| {
        let (taps, clock, sink) = (hub.taps.clone(), hub.clock.clone(), name.to_owned());
        root.child(child(hub, name.to_owned(), || TapActor, move || (taps.clone(), clock.clone(), sink.clone())))
    })
}

/// The safety chain of all robots.
pub fn controller(hub: &Arc<Hub>) -> Group {
    let fence = hub.clone();
    let model = hub.clone();
    let mut root = group("controller", Strategy::OneForOne, hub)
        .on_death(move |name, _| {
            // the model's death closes all robots, a group's death its own
            for wires in fence.robots.iter().filter(|w| name == "model" || name == w.name) {
                fence.fence(wires, name);
            }
        })
        .child(child(hub, "model".into(), || ModelActor, move || model.clone()));
    for wires in &hub.robots {
        root = root.child(Child::group(robot(hub, wires)).restart(Restart::Temporary));
    }
    root
}

fn robot(hub: &Arc<Hub>, wires: &Arc<Wires>) -> Group {
    let name = |part: &str| format!("{}/{part}", wires.name);
    let both = || {
        let (hub, wires) = (hub.clone(), wires.clone());
        move || (hub.clone(), wires.clone())
    };
    let (fence, fenced) = (hub.clone(), wires.clone());
    group(&wires.name, Strategy::RestForOne, hub)
        .on_death(move |name, reason| {
            fence.fence(&fenced, name);
            fence.count_against(&fenced, &format!("{name} died: {reason}"));
        })
        .child(child(hub, name("driver"), || DriverActor, both()))
        .child(child(hub, name("history"), || HistoryActor, both()))
        .child(child(hub, name("supervise"), || SuperviseActor, both()))
        .child(child(hub, name("reflex"), || ReflexActor, both()))
}

/// The agents: their deaths can't touch a controller.
pub fn agents(hub: &Arc<Hub>) -> Group {
    let mut root = group("agents", Strategy::OneForOne, hub);
    for wires in hub.robots.iter().filter(|w| w.slot.lock().maker.is_some()) {
        let orphan = wires.clone();
        let arguments = {
            let (hub, wires) = (hub.clone(), wires.clone());
            move || (hub.clone(), wires.clone())
        };
        let own = group(&format!("{}/agents", wires.name), Strategy::OneForOne, hub)
            .on_death(move |_, _| {
                orphan.supervise.send(SuperviseMsg::AgentDied(orphan.agent_name.clone()));
            })
            .child(child(hub, wires.agent_name.to_string(), || AgentActor, arguments));
        root = root.child(Child::group(own).restart(Restart::Temporary));
    }
    root
}

/// The services: whatever becomes of one, the run goes on.
pub fn services(hub: &Arc<Hub>, posts: &[Arc<Post>]) -> Group {
    posts.iter().fold(group("services", Strategy::OneForOne, hub), |root, post| {
        let (vacated, given_up, gone) = (post.clone(), post.clone(), hub.clone());
        let arguments = {
            let (hub, post) = (hub.clone(), post.clone());
            move || (hub.clone(), post.clone())
        };
        let served = child(hub, format!("{}/{SERVICE}", post.name()), || ServiceActor, arguments);
        let own = group(&format!("{}/{SERVICES}", post.name()), Strategy::OneForOne, hub)
            .on_death(move |_, reason| vacated.vacate(reason))
            .on_give_up(move || given_up.give_up(&gone))
            .child(served.restart(Restart::Transient).grace(Some(GRACE)));
        root.child(Child::group(own).restart(Restart::Temporary))
    })
}

/// The sensors: their deaths only make objects stale.
pub fn sensors(hub: &Arc<Hub>, sensors: &[Arc<Sensor>]) -> Group {
    sensors.iter().fold(group("sensors", Strategy::OneForOne, hub), |root, sensor| {
        let both = || {
            let (hub, sensor) = (hub.clone(), sensor.clone());
            move || (hub.clone(), sensor.clone())
        };
        let name = |part: &str| format!("{}/{part}", sensor.name);
        let (gone, blind) = (hub.clone(), sensor.name.clone());
        let own = group(&name(SENSOR), Strategy::OneForOne, hub)
            .on_give_up(move || {
                gone.tell(Event::Warning { text: format!("sensor {blind} is gone until the next run") })
            })
            .child(child(hub, name(CAMERA), || CameraActor, both()))
            .child(child(hub, name(DETECTOR), || DetectorActor, both()));
        root.child(Child::group(own).restart(Restart::Temporary))
    })
}

/// How what runs beside the safety chain is called, after its name.
const SERVICE: &str = "service";
const SERVICES: &str = "services";
const SENSOR: &str = "sensor";
const CAMERA: &str = "camera";
const DETECTOR: &str = "detector";

/// Whether an event tells of the life of what runs beside the safety chain: it excuses nobody there.
pub fn is_beside(event: &Event) -> bool {
    let (Event::Died { actor: name, .. } | Event::Restarted { actor: name, .. } | Event::GaveUp { group: name }) =
        event
    else {
        return false;
    };
    name.rsplit_once('/').is_some_and(|(_, last)| [SERVICE, SERVICES, SENSOR, CAMERA, DETECTOR].contains(&last))
}
