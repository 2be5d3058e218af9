//! Restart of a part beside the robots: a sensor or a service that is running, or has used up its restarts.

use super::tree;
use crate::shell::{Sensor, ServiceSlot};
use crate::supervision::{Between, GroupMsg};
use crate::wiring::SharedContext;
use ractor::ActorRef;
use std::sync::Arc;
use tokio::sync::oneshot;

/// Restarts a sensor or a service; the run continues during the restart.
pub(super) fn restart(
    shared: &Arc<SharedContext>,
    (sensors, seen): (&[Arc<Sensor>], Option<&ActorRef<GroupMsg>>),
    (service_slots, services): (&[Arc<ServiceSlot>], Option<&ActorRef<GroupMsg>>),
    name: String,
    reply: oneshot::Sender<Result<(), String>>,
) {
    let sensor = sensors.iter().any(|s| s.name == name).then(|| tree::sensor_of(&name)).zip(seen);
    let service = service_slots.iter().any(|p| p.name() == name).then(|| tree::services_of(&name)).zip(services);
    let Some((group, root)) = sensor.or(service).map(|(group, root)| (group, root.clone())) else {
        let names = sensors.iter().map(|s| s.name.as_str()).chain(service_slots.iter().map(|p| p.name()));
        let names: Vec<&str> = names.collect();
        let there =
            if names.is_empty() { "this run has none".into() } else { format!("there are: {}", names.join(", ")) };
        // The caller may have timed out.
        let _ = reply.send(Err(format!("there is no sensor or service `{name}`; {there}")));
        return;
    };
    let shared = shared.clone();
    tokio::spawn(async move {
        let run = shared.clone();
        let own = name.clone();
        let between = Between(Box::new(move || drop(run.counts.lock().down.remove(&own))));
        let started = ractor::call!(root, GroupMsg::Renew, group, between);
        let answer = started.map_err(|_| {
            let why = shared.counts.lock().down.get(&name).cloned();
            format!("{name} could not be started: {}", why.unwrap_or_else(|| "the journal says why".into()))
        });
        let _ = reply.send(answer);
    });
}
