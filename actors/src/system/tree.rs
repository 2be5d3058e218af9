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
//! taps                          one-for-one: what watches over the threads of journal and recorder
//! ├── journal
//! └── recorder
//! ```

use crate::record::names::{CAMERA, DETECTOR, SENSOR, SERVICE, SERVICES};
use crate::record::tap::TapActor;
use crate::runtime::load::Measured;
use crate::runtime::supervision::{Child, Group, Intensity, Restart, Strategy};
use crate::shell::{
    AgentActor, CameraActor, DetectorActor, DriverActor, Eye, GRACE, HistoryActor, LocatorActor, ModelActor, Post,
    ReflexActor, Sensor, ServiceActor, SuperviseActor,
};
use crate::wiring::{LatestCell, RobotContext, SharedContext, Troubled};
use mobee_contract::{Event, Time};
use ractor::{Actor, ActorCell};
use std::sync::Arc;
use std::time::Duration;

/// Restarts that a robot's controller, and each agent, may need within [`PERIOD`].
const BUDGET: u32 = 8;
const PERIOD: Duration = Duration::from_secs(30);

/// A child that is spawned with these arguments.
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
    let (own, troubles) = (name.clone(), shared.troubles.clone());
    let load = shared.loads.as_ref().map(|loads| loads.of(&name));
    Child::new(name, move |parent: ActorCell| {
        let (arguments, troubled) = (arguments(), troubles.clone().map(|t| Troubled::new(actor(), own.clone(), t)));
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
    let intensity = Intensity { restarts: BUDGET, period: PERIOD };
    let (restarted, gave_up) = (shared.clone(), shared.clone());
    Group::new(name.to_string(), strategy, intensity, shared.clock.clone(), shared.taps.emitter())
        .on_restart(move |_, _| restarted.counts.lock().restarts += 1)
        .on_give_up(move || {
            let mut counts = gave_up.counts.lock();
            counts.gave_up += 1;
            counts.is_given_up = true;
        })
}

/// Those who watch over the sinks, and open one anew if it fails. Their deaths harm nobody.
pub fn taps(shared: &Arc<SharedContext>) -> Group {
    shared.taps.names().fold(group("taps", Strategy::OneForOne, shared), |root, name| {
        let (taps, clock, sink) = (shared.taps.clone(), shared.clock.clone(), name.to_owned());
        root.child(child(shared, name.to_owned(), || TapActor, move || (taps.clone(), clock.clone(), sink.clone())))
    })
}

/// The safety chain of all robots.
pub fn controller(shared: &Arc<SharedContext>) -> Group {
    let fence = shared.clone();
    let model = shared.clone();
    let mut root = group("controller", Strategy::OneForOne, shared)
        .on_death(move |name, _| {
            // the model's death closes all robots, a group's death its own
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
        let (shared, context) = (shared.clone(), context.clone());
        move || (shared.clone(), context.clone())
    };
    let (fence, fenced) = (shared.clone(), context.clone());
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

/// The agents: their deaths can't touch a controller.
pub fn agents(shared: &Arc<SharedContext>) -> Group {
    let mut root = group("agents", Strategy::OneForOne, shared);
    for context in shared.robots.iter().filter(|w| w.slot.lock().maker.is_some()) {
        root = root.child(Child::group(agent(shared, context)).restart(Restart::Temporary));
    }
    root
}

/// The agent of one robot.
pub fn agent(shared: &Arc<SharedContext>, context: &Arc<RobotContext>) -> Group {
    let orphan = context.clone();
    let arguments = {
        let (shared, context) = (shared.clone(), context.clone());
        move || (shared.clone(), context.clone())
    };
    group(&format!("{}/agents", context.name), Strategy::OneForOne, shared)
        .on_death(move |_, _| {
            orphan.agent_died(orphan.agent_name.clone());
        })
        .child(child(shared, context.agent_name.to_string(), || AgentActor, arguments))
}

/// The services: whatever becomes of one, the run goes on.
pub fn services(shared: &Arc<SharedContext>, posts: &[Arc<Post>]) -> Group {
    posts.iter().fold(group("services", Strategy::OneForOne, shared), |root, post| {
        let (fallen, run, given_up, gone) = (post.clone(), shared.clone(), post.clone(), shared.clone());
        let arguments = {
            let (shared, post) = (shared.clone(), post.clone());
            move || (shared.clone(), post.clone())
        };
        let served = child(shared, format!("{}/{SERVICE}", post.name()), || ServiceActor, arguments);
        let own = group(&services_of(post.name()), Strategy::OneForOne, shared)
            .on_death(move |_, reason| fallen.fell(&run, reason))
            .on_give_up(move || given_up.give_up(&gone))
            .child(served.restart(Restart::Transient).grace(Some(GRACE)));
        root.child(Child::group(own).restart(Restart::Temporary))
    })
}

/// The name of the group of a service.
pub fn services_of(service: &str) -> String {
    format!("{service}/{SERVICES}")
}

/// The name of the group of a sensor.
pub fn sensor_of(sensor: &str) -> String {
    format!("{sensor}/{SENSOR}")
}

/// The sensors: their deaths only make objects stale.
pub fn sensors(shared: &Arc<SharedContext>, sensors: &[Arc<Sensor>]) -> Group {
    sensors.iter().fold(group("sensors", Strategy::OneForOne, shared), |root, sensor| {
        root.child(Child::group(self::sensor(shared, sensor)).restart(Restart::Temporary))
    })
}

fn sensor(shared: &Arc<SharedContext>, sensor: &Arc<Sensor>) -> Group {
    let (gone, blind) = (shared.clone(), sensor.clone());
    let (run, eyes, placing) = (shared.clone(), sensor.eyes.clone(), sensor.placing.clone());
    // why it was started again last
    let last = Arc::new(LatestCell::<String>::default());
    let cause = last.clone();
    let mut own = group(&sensor_of(&sensor.name), Strategy::OneForOne, shared)
        .on_death(move |name, reason| {
            let detector = |eye: &&Arc<Eye>| *name == format!("{}/{DETECTOR}", eye.name);
            eyes.iter().filter(detector).for_each(|eye| eye.fell(&run, reason));
            placing.iter().filter(|placing| placing.name == *name).for_each(|placing| placing.fell(&run, reason));
            *cause.lock() = format!("{name} died: {reason}");
        })
        .on_give_up(move || {
            let why = last.lock().clone();
            let text = format!("sensor {} has used up its restarts and is down: {why}", blind.name);
            gone.tell(Event::Warning { text });
            gone.give_up_beside(&blind.name, why);
            // nobody looks any more for what is not seen
            blind.placing.iter().for_each(|placing| placing.tell_stale(&gone, Time(u64::MAX)));
        });
    for eye in &sensor.eyes {
        let both = || {
            let (shared, eye) = (shared.clone(), eye.clone());
            move || (shared.clone(), eye.clone())
        };
        let name = |part: &str| format!("{}/{part}", eye.name);
        own = own.child(child(shared, name(CAMERA), || CameraActor, both())).child(child(
            shared,
            name(DETECTOR),
            || DetectorActor,
            both(),
        ));
    }
    if let Some(placing) = &sensor.placing {
        let (name, run, eyes, placing) = (placing.name.clone(), shared.clone(), sensor.eyes.clone(), placing.clone());
        let arguments = move || (run.clone(), eyes.clone(), placing.clone());
        own = own.child(child(shared, name, || LocatorActor, arguments));
    }
    own
}
