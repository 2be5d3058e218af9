//! The sinks of a run's entries: each behind a queue and on a thread of its own.

use super::BUILD;
use super::disk_space::DiskSpace;
use super::event_printer::{EventPrinter, TerminalSettings};
use super::folder::Folder;
use super::log::SCENE_INTERVAL;
use super::progress::Bar;
use super::record_switch::RecordSwitch;
use super::space_guard::SpaceGuard;
use crate::narrate::Narrator;
use mobee_compose::config::{ClockMode, Config, RobotConfig};
use mobee_journal::journal::Journal;
use mobee_journal::ring::Rings;
use mobee_journal::track::Tracks;
use mobee_model::{Object, Scene};
use mobee_recorder::{PoseName, Recorder};
use mobee_runtime::tap::{OpenSink, Pictures, SinkSpec};
use mobee_sim::eyes::KeptFrames;
use mobee_sim::{SIM, UnknownBox};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Maximum number of entries that wait for a sink's thread.
pub(crate) const QUEUE_ENTRIES: usize = 8192;
/// Time limit for writing one entry at the end; a disk that takes longer is considered dead.
pub(crate) const WRITE_TIMEOUT: Duration = Duration::from_secs(30);
/// The same for a viewer or terminal, which must not delay the end.
const VIEWER_TIMEOUT: Duration = Duration::from_secs(3);

/// The name of the viewer's sink.
pub(super) const VIEWER: &str = "viewer";
/// The name of the terminal's sink.
pub(super) const TERMINAL: &str = "terminal";

/// The journal's sink.
pub(super) fn journal(journal: &Journal) -> SinkSpec {
    let journal = journal.clone();
    SinkSpec {
        pictures: Pictures::None,
        name: "journal".into(),
        essential: true,
        poses: None,
        capacity: QUEUE_ENTRIES,
        patience: WRITE_TIMEOUT,
        open: Some(Arc::new(move || journal.is_in_place().map(|()| journal.sink()))),
    }
}

/// The pose rings, from which a resumed run gets the path of a retreat. None in virtual time: there no robot remains.
pub(super) fn rings(config: &Config, folder: &Folder, motors: Vec<usize>) -> Option<SinkSpec> {
    let robots = config.robot.iter().zip(motors);
    let rings: Vec<_> = robots.map(|(r, n)| (r.name.clone(), n, r.controller.history)).collect();
    let dir = folder.path().to_owned();
    (config.clock == ClockMode::Real).then(|| SinkSpec {
        pictures: Pictures::None,
        name: "poses".into(),
        essential: false,
        poses: Some(Duration::ZERO),
        capacity: QUEUE_ENTRIES,
        patience: WRITE_TIMEOUT,
        open: Some(Arc::new(move || Rings::create(&dir, &rings).map(|r| Box::new(r) as _))),
    })
}

/// The measured poses beside the journal. The sink ends before it uses disk space that the journal needs, and a run
/// with too little space has none: then only the invariants that need poses are not checked.
///
/// # Errors
/// If the file can't be written.
pub(super) fn tracks(config: &Config, folder: &Folder, motors: Vec<usize>) -> Result<Option<SinkSpec>, String> {
    if let Some(why) = DiskSpace::at(folder.path()).and_then(DiskSpace::too_little_to_record) {
        eprintln!("warning: the measured poses of this run are not stored: {why}");
        return Ok(None);
    }
    let robots = config.robot.iter().zip(motors);
    let robots: Vec<_> = robots.map(|(r, n)| (r.name.clone(), n, r.controller.tolerance_deg.to_radians())).collect();
    let tracks = Tracks::open(folder.path(), &robots)?;
    let dir = folder.path().to_owned();
    Ok(Some(SinkSpec {
        pictures: Pictures::None,
        name: "track".into(),
        essential: false,
        poses: Some(Duration::ZERO),
        capacity: QUEUE_ENTRIES,
        patience: WRITE_TIMEOUT,
        open: Some(Arc::new(move || {
            DiskSpace::at(&dir).and_then(DiskSpace::too_little_to_record).map_or(Ok(()), Err)?;
            Ok(Box::new(SpaceGuard::new(tracks.sink(), dir.clone())))
        })),
    }))
}

/// The frames of sensors that store them. Damaged frame files of an earlier process are added to `damage`. The sink
/// ends before it uses disk space that the journal needs.
///
/// # Errors
/// If the file can't be written.
pub(super) fn frames(config: &Config, folder: &Folder, damage: &mut Vec<String>) -> Result<Option<SinkSpec>, String> {
    let cameras = config.stored_cameras();
    if cameras.is_empty() {
        return Ok(None);
    }
    if let Some(why) = DiskSpace::at(folder.path()).and_then(DiskSpace::too_little_to_record) {
        eprintln!("warning: the frames of this run are not stored: {why}");
        return Ok(None);
    }
    let frames = KeptFrames::open(folder.path(), &cameras)?;
    let dir = folder.path().to_owned();
    damage.extend(frames.damage().iter().cloned());
    Ok(Some(SinkSpec {
        pictures: Pictures::All(cameras.into()),
        name: "frames".into(),
        essential: false,
        poses: None,
        capacity: QUEUE_ENTRIES,
        patience: WRITE_TIMEOUT,
        open: Some(Arc::new(move || {
            DiskSpace::at(&dir).and_then(DiskSpace::too_little_to_record).map_or(Ok(()), Err)?;
            Ok(Box::new(SpaceGuard::new(frames.sink(), dir.clone())))
        })),
    }))
}

/// The events as lines on the terminal.
pub(super) fn terminal(bar: Bar, settings: TerminalSettings, scene: &Arc<Scene>) -> SinkSpec {
    let scene = scene.clone();
    SinkSpec {
        pictures: Pictures::None,
        name: TERMINAL.into(),
        essential: false,
        poses: Some(SCENE_INTERVAL),
        capacity: QUEUE_ENTRIES,
        patience: VIEWER_TIMEOUT,
        open: Some(Arc::new(move || {
            Ok(Box::new(EventPrinter::new(bar.clone(), settings.clone(), Narrator::new(&scene))))
        })),
    }
}

/// The recorder that the configuration requests: the given one, or the run's own.
pub(super) fn recorder(
    config: &Config,
    folder: &Folder,
    given: Option<OpenSink>,
    recording: Arc<AtomicBool>,
) -> Option<SinkSpec> {
    if !config.record.enabled {
        return None;
    }
    if let Some(why) = DiskSpace::at(folder.path()).and_then(DiskSpace::too_little_to_record) {
        eprintln!("warning: there is no recording of this run: {why}");
        return None;
    }
    let settings = recorder_settings(config, folder);
    let dir = folder.clone();
    let open = given.unwrap_or_else(|| {
        Arc::new(move || {
            DiskSpace::at(dir.path()).and_then(DiskSpace::too_little_to_record).map_or(Ok(()), Err)?;
            // a recorder that is opened again must not overwrite the earlier file
            let settings = mobee_recorder::Settings { path: dir.unused("recording", "rrd"), ..settings.clone() };
            let recorder = Recorder::new(&settings).map_err(|e| e.to_string())?;
            let switched = RecordSwitch::new(recorder, recording.clone());
            Ok(Box::new(SpaceGuard::new(Box::new(switched), dir.path().to_owned())))
        })
    });
    Some(SinkSpec {
        pictures: Pictures::Few,
        name: "recorder".into(),
        essential: false,
        poses: Some(Duration::from_secs_f64(1.0 / config.record.poses_hz)),
        capacity: QUEUE_ENTRIES,
        patience: WRITE_TIMEOUT,
        open: Some(open),
    })
}

/// The viewer that follows live, or may connect later. It is a sink of its own, so that a frozen viewer takes nothing
/// from the file. A run in virtual time has none: it does not wait.
pub(super) fn viewer(config: &Config, folder: &Folder) -> Option<SinkSpec> {
    let settings = recorder_settings(config, folder);
    let open = config.record.live.map(|address| -> OpenSink {
        let settings = mobee_recorder::Settings { live: Some(address.to_string()), ..settings };
        Arc::new(move || Ok(Box::new(Recorder::new(&settings).map_err(|e| e.to_string())?)))
    });
    (config.clock == ClockMode::Real).then(|| SinkSpec {
        pictures: Pictures::Few,
        name: VIEWER.into(),
        essential: false,
        poses: Some(Duration::from_secs_f64(1.0 / config.record.poses_hz)),
        capacity: QUEUE_ENTRIES,
        patience: VIEWER_TIMEOUT,
        open,
    })
}

/// File, names and index of a run's recording.
pub(crate) fn recorder_settings(config: &Config, folder: &Folder) -> mobee_recorder::Settings {
    mobee_recorder::Settings {
        path: folder.unused("recording", "rrd"),
        name: config.name.clone(),
        config: config.name.clone(),
        build: BUILD.to_owned(),
        live: None,
        // a real robot may run for days
        index: config.clock == ClockMode::Virtual,
        names: config.robot.iter().flat_map(pose_names).collect(),
        unknown: config.robot.iter().flat_map(unknown_objects).collect(),
    }
}

/// Objects that only the world of a simulated robot has.
fn unknown_objects(robot: &RobotConfig) -> Vec<Object> {
    let boxes = robot.driver.get("unknown").filter(|_| robot.driver_kind() == SIM);
    let boxes: Option<Vec<UnknownBox>> = boxes.and_then(|boxes| serde_json::from_value(boxes.clone()).ok());
    boxes.iter().flatten().map(UnknownBox::object).collect()
}

/// The poses that an agent's settings name, for labels: `poses = [{ name = "left", q_deg = { ... } }]`. Skips other
/// forms.
fn pose_names(robot: &RobotConfig) -> Vec<PoseName> {
    let poses = robot.agent.as_ref().and_then(|agent| agent.get("poses")?.as_array());
    let named = |pose: &serde_json::Value| {
        let name = pose.get("name")?.as_str()?.to_owned();
        let q_deg = pose.get("q_deg")?.as_object()?;
        let q_deg = q_deg.iter().map(|(motor, deg)| Some((motor.clone(), deg.as_f64()?))).collect::<Option<_>>()?;
        Some(PoseName { robot: robot.name.clone(), name, q_deg })
    };
    poses.into_iter().flatten().filter_map(named).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_of_other_forms_have_no_names_and_harm_nothing() {
        let poses = serde_json::json!([
            { "name": "left", "q_deg": { "elbow": 30, "wrist": -1.5 } },
            { "name": "no numbers", "q_deg": { "elbow": "30" } },
            { "q_deg": { "elbow": 30 } },
            { "name": 3, "q_deg": {} },
            [1, 2],
        ]);
        let agent = |poses: serde_json::Value| Some(serde_json::json!({ "kind": "roadmap", "poses": poses }));
        let robot =
            serde_json::json!({ "name": "arm", "model": "arm.xml", "controller": { "period_ms": 20, "history": 100 } });
        let mut robot: RobotConfig = serde_json::from_value(robot).unwrap();
        assert_eq!(pose_names(&robot), []);
        robot.agent = agent("none".into());
        assert_eq!(pose_names(&robot), []);
        robot.agent = agent(poses);
        let q_deg = [("elbow".to_owned(), 30.0), ("wrist".to_owned(), -1.5)].into();
        assert_eq!(pose_names(&robot), [PoseName { robot: "arm".into(), name: "left".into(), q_deg }]);
    }
    #[test]
    fn objects_that_only_a_simulated_world_has_are_recorded() {
        let robot = |driver: serde_json::Value| -> RobotConfig {
            let controller = serde_json::json!({ "period_ms": 20, "history": 100 });
            let robot =
                serde_json::json!({ "name": "arm", "model": "arm.xml", "driver": driver, "controller": controller });
            serde_json::from_value(robot).unwrap()
        };
        let boxes = serde_json::json!([{ "name": "post", "size_m": [0.1, 0.2, 0.3], "at_m": [0.5, 0.0, 0.3] }]);
        let objects = unknown_objects(&robot(serde_json::json!({ "kind": "sim", "unknown": boxes })));
        assert_eq!(
            objects.iter().map(|o| (o.name.as_str(), o.pose.translation.z)).collect::<Vec<_>>(),
            [("post", 0.3)]
        );
        assert!(unknown_objects(&robot(serde_json::json!({ "kind": "sim" }))).is_empty());
        assert!(unknown_objects(&robot(serde_json::json!({ "kind": "replay", "unknown": boxes }))).is_empty());
    }
}
