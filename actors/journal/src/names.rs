//! Names that readers of a journal depend on.

use mobee_contract::Event;

/// Text of the [`Event::Injected`] by which a simulation reports that all faults have healed.
pub const HEALED: &str = "nothing more: all faults have healed";

/// Last part of the name of an actor that runs a service.
pub const SERVICE: &str = "service";
/// Supervision group of a service.
pub const SERVICES: &str = "services";
/// Supervision group of a sensor.
pub const SENSOR: &str = "sensor";
/// Actor of a camera.
pub const CAMERA: &str = "camera";
/// Actor of a detector.
pub const DETECTOR: &str = "detector";
/// Actor of a locator.
pub const LOCATOR: &str = "locator";

/// True if the event is about the life of an actor beside the safety chain: it excuses nothing there.
pub fn is_beside(event: &Event) -> bool {
    let (Event::Died { actor: name, .. } | Event::Restarted { actor: name, .. } | Event::GaveUp { group: name }) =
        event
    else {
        return false;
    };
    name.rsplit_once('/')
        .is_some_and(|(_, last)| [SERVICE, SERVICES, SENSOR, CAMERA, DETECTOR, LOCATOR].contains(&last))
}
