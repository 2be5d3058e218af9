//! Names that a journal's readers go by.

use mobee_contract::Event;

/// What a simulation says, as [`Event::Injected`], when all faults have healed.
pub const HEALED: &str = "nothing more: all faults have healed";

/// An actor that serves a service: the last part of its name.
pub const SERVICE: &str = "service";
/// The group of a service.
pub const SERVICES: &str = "services";
/// The group of a sensor.
pub const SENSOR: &str = "sensor";
/// A camera's actor.
pub const CAMERA: &str = "camera";
/// A detector's actor.
pub const DETECTOR: &str = "detector";
/// A locator's actor.
pub const LOCATOR: &str = "locator";

/// Whether an event tells of the life of what runs beside the safety chain: it excuses nobody there.
pub fn is_beside(event: &Event) -> bool {
    let (Event::Died { actor: name, .. } | Event::Restarted { actor: name, .. } | Event::GaveUp { group: name }) =
        event
    else {
        return false;
    };
    name.rsplit_once('/')
        .is_some_and(|(_, last)| [SERVICE, SERVICES, SENSOR, CAMERA, DETECTOR, LOCATOR].contains(&last))
}
