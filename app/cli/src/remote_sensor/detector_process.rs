//! `mobee detector run`: the cameras and detectors of a sensor in a process of their own.

use super::{RETRY_DELAY, RemoteSensor, RemoteSensorArgs, WarnOnce};
use crate::signals::Interrupt;
use miette::{IntoDiagnostic, Report};
use mobee_bridge_yarp::seen::SeenRegions;
use mobee_compose::config::ConfigError;
use mobee_contract::{Camera, Detector, Frame, Region, SeenMask, Time, limit_regions};
use mobee_runtime::clock::{Clock, ClockKind};
use mobee_runtime::system::CameraSetup;
use mobee_yarp::{Delivery, Image, OutputPort, PixelCode, Stamp};
use std::time::Duration;
use tokio::task::{JoinSet, spawn_blocking};

/// Time limit for a frame in progress at the end.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);

/// Runs the cameras and detectors of a sensor until Ctrl-C.
///
/// # Errors
/// Complaints about the configuration or the network, before any port is opened.
pub(crate) fn command(args: &RemoteSensorArgs) -> Result<(), Report> {
    let mut configured = RemoteSensor::load(args)?;
    let sensor = configured.sensor()?;
    if sensor.is_simulated {
        let at = format!("sensor[{}].eye[0].camera.kind", configured.index);
        let help = "serve them by `mobee sim`, and read their ports: camera = { kind = \"yarp\", port = \"/icubSim/cam/left\" }";
        let what = "this sensor's cameras are simulated, and only a run has a world that they could see";
        return Err(configured.source.error(&at, what, help).into());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().into_diagnostic()?;
    let done = runtime.block_on(serve(&configured, sensor.cameras));
    runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
    done
}

async fn serve(configured: &RemoteSensor, cameras: Vec<CameraSetup>) -> Result<(), Report> {
    configured.reach().await?;
    let mut interrupt = Interrupt::new();
    let clock = Clock::new(ClockKind::Real);
    let mut eyes = JoinSet::new();
    let mut count = 0;
    for setup in cameras {
        let ports = Ports::open(configured, &setup.name).await?;
        println!("{}\n{}", ports.regions.name(), ports.mask.name());
        eyes.spawn(CameraProcess { setup, ports, clock: clock.clone(), warnings: WarnOnce::default() }.look());
        count += 1;
    }
    let (host, port) = configured.network.server();
    println!("{count} cameras at the name server {host}:{port}; Ctrl-C ends");
    tokio::select! {
        () = interrupt.wait() => {}
        _ = eyes.join_next() => {}
    }
    // the ports unregister when they are dropped
    eyes.shutdown().await;
    Ok(())
}

/// Output ports of one camera.
struct Ports {
    regions: OutputPort,
    mask: OutputPort,
}

impl Ports {
    async fn open(configured: &RemoteSensor, eye: &str) -> Result<Ports, ConfigError> {
        let open = async |what: &str| {
            let name = format!("{}/{eye}/{what}:o", configured.ports);
            let help = "end the program that has it, or choose other names by --prefix";
            let opened = OutputPort::open(&configured.network, &name, Delivery::Newest).await;
            opened.map_err(|e| ConfigError::plain(e.to_string(), help))
        };
        Ok(Ports { regions: open("regions").await?, mask: open("mask").await? })
    }
}

/// A camera with its detector.
struct CameraProcess {
    setup: CameraSetup,
    ports: Ports,
    clock: Clock,
    warnings: WarnOnce,
}

/// The parts that are rebuilt after a failure.
struct CameraParts {
    camera: Box<dyn Camera>,
    detector: Box<dyn Detector>,
}

/// A frame with its detections.
struct Detections {
    frame: Frame,
    regions: Vec<Region>,
    mask: Option<SeenMask>,
}

/// The result of one step of a camera.
#[derive(Default)]
struct StepResult {
    found: Option<Detections>,
    warnings: Vec<String>,
}

impl CameraProcess {
    /// Processes frames forever; rebuilds a camera or detector that fails.
    async fn look(mut self) {
        let mut stamp = Stamp::default();
        loop {
            let camera = self.setup.camera.clone();
            let detector = self.setup.detector.clone();
            let made =
                spawn_blocking(move || Ok::<_, String>(CameraParts { camera: camera()?, detector: detector()? })).await;
            let mut parts = match made.unwrap_or_else(|e| Err(e.to_string())) {
                Ok(parts) => parts,
                Err(why) => {
                    self.complain(&why);
                    tokio::time::sleep(RETRY_DELAY).await;
                    continue;
                }
            };
            loop {
                let now = self.clock.now();
                // a panic drops both parts
                let most = self.setup.max_regions;
                let step = spawn_blocking(move || {
                    let look = parts.step(now, most);
                    (parts, look)
                });
                let look = match step.await {
                    Ok((whole, Ok(look))) => {
                        parts = whole;
                        look
                    }
                    Ok((_, Err(why))) => {
                        self.complain(&why);
                        break;
                    }
                    Err(e) => {
                        self.complain(&e.to_string());
                        break;
                    }
                };
                for what in look.warnings {
                    self.warnings.warn(format!("{}: {what}", self.setup.name));
                }
                if let Some(found) = look.found {
                    stamp = stamp.next(self.clock.time_of_day(found.frame.exposed));
                    self.publish(found, stamp);
                }
                self.clock.sleep_until(now + parts.camera.period()).await;
            }
            tokio::time::sleep(RETRY_DELAY).await;
        }
    }

    fn complain(&mut self, why: &str) {
        let name = &self.setup.name;
        self.warnings.warn(format!("{name}: {why}; it is rebuilt"));
    }

    fn publish(&mut self, found: Detections, stamp: Stamp) {
        let Detections { frame, regions, mask } = found;
        let seen = SeenRegions { intrinsics: frame.intrinsics, regions };
        self.ports.regions.write(seen.bottle(), Some(stamp.envelope()));
        let white = |SeenMask { size: [width, height], objects }: SeenMask| {
            let pixels: Vec<u8> = objects.iter().map(|object| if *object == 0 { 0 } else { u8::MAX }).collect();
            Image::new(PixelCode::MONO, width, height, &pixels).ok()
        };
        if let Some(mask) = mask.filter(|_| !self.ports.mask.peers().is_empty()).and_then(white) {
            self.ports.mask.write(mask.encode(), Some(stamp.envelope()));
        }
    }
}

impl CameraParts {
    /// Processes the newest frame, if there is one, and returns at most `most` regions of each object.
    fn step(&mut self, now: Time, most: usize) -> Result<StepResult, String> {
        let frame = self.camera.frame(now)?;
        let mut look = StepResult::default();
        look.warnings.extend(self.camera.skipped().map(|s| format!("{}; such pictures are skipped", s.why)));
        let Some(frame) = frame else { return Ok(look) };
        let mut regions = self.detector.detect(&frame);
        if let Some(why) = self.detector.failure() {
            return Err(why);
        }
        if self.detector.omitted() + limit_regions(&mut regions, most) > 0 {
            look.warnings.push(format!("more than {most} regions of an object in one image; the others are dropped"));
        }
        look.warnings.extend(self.detector.complaint());
        look.found = Some(Detections { frame, regions, mask: self.detector.mask() });
        Ok(look)
    }
}
