//! The camera kind `yarp`: a camera behind a YARP image port.
//!
//! ```text
//! their port ──images──> our port (newest wins) ──thread──> cell: the newest image ──frame──> caller
//! ```

use crate::{instant, network_of};
use mobee_contract::{
    Camera, CameraContext, CameraMount, Frame, Intrinsics, Kind, KindError, Registered, SkippedPictures, Time, settings,
};
use mobee_sim::eyes::{LensSettings, Mount, in_range, size};
use mobee_yarp::{Carrier, Dialect, Image, InputPort, Message, Network, PixelCode, Queue, StreamSource};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::{Instant, sleep};

/// A camera behind a YARP image port.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct YarpCameraSettings {
    /// Image port, such as `/icub/cam/left`.
    pub port: String,
    /// Width and height of its images, pixels.
    #[serde(default = "size")]
    pub size: [u32; 2],
    /// Projection of the camera.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub lens: LensSettings,
    /// Greatest number of images per second: the rate at which the camera is polled.
    #[serde(default = "fps")]
    pub fps: f64,
    /// Time from an image's exposure to its arrival, ms.
    #[serde(default = "delay_ms")]
    #[schemars(extend("expert" = true))]
    pub delay_ms: f64,
    /// Address of the name server, `HOST:PORT`. Default: from YARP's own files and environment.
    #[serde(default)]
    pub server: Option<String>,
    /// Name of our own port; default: `/MoBeE/ROBOT` before the camera's.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub name: Option<String>,
    /// Address of this machine on which our port listens; default: 127.0.0.1, for this machine only.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub listen: Option<String>,
    /// Marker of the robot's model that the camera is attached to, looking along its normal. Used by the
    /// recording only; locators ignore it.
    #[serde(default)]
    pub marker: Option<String>,
    /// Carrier of the images: `tcp` (the sender skips images while one is in transit), `fast_tcp` or `udp`.
    #[serde(default = "carrier")]
    #[schemars(extend("expert" = true))]
    pub carrier: String,
}

fn fps() -> f64 {
    30.0
}
fn delay_ms() -> f64 {
    30.0
}
fn carrier() -> String {
    "tcp".into()
}

/// Pause before a port that can't be reached is tried again.
const RETRY_PAUSE: Duration = Duration::from_millis(500);
/// Silence after which a new connection is requested from the camera: this number of periods, and at least this
/// time.
const PERIODS: u32 = 10;
const SILENCE: Duration = Duration::from_secs(2);

/// Images received by the thread.
#[derive(Default)]
struct ReceivedImages {
    newest: Option<(Instant, Vec<u8>)>,
    /// Number of images replaced by newer ones before a request.
    dropped: u64,
    /// Received messages that are not images of this camera.
    skipped: Option<SkippedPictures>,
}

type ImageCell = Arc<Mutex<ReceivedImages>>;

fn lock(cell: &ImageCell) -> MutexGuard<'_, ReceivedImages> {
    cell.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A camera behind a YARP image port. Its thread starts with the first request, and ends with the camera.
pub struct YarpCamera {
    settings: YarpCameraSettings,
    lens: Intrinsics,
    network: Option<Network>,
    own: String,
    carrier: Carrier,
    mount: Option<CameraMount>,
    cell: ImageCell,
    /// Sender whose drop ends the thread.
    thread: Option<watch::Sender<()>>,
}

impl YarpCamera {
    /// Creates a camera for a robot of this name. Opens and queries nothing yet.
    ///
    /// # Errors
    /// Settings that can't be used.
    pub fn new(settings: &YarpCameraSettings, robot: &str) -> Result<YarpCamera, KindError> {
        let [width, height] = settings.size.map(f64::from);
        let mut checks = vec![
            in_range(("size[0]", width, 1.0, 4096.0)),
            in_range(("size[1]", height, 1.0, 4096.0)),
            in_range(("fps", settings.fps, 0.01, 1000.0)),
            in_range(("delay_ms", settings.delay_ms, 0.0, 10_000.0)),
        ];
        if !settings.port.starts_with('/') || settings.port.contains(char::is_whitespace) {
            let what = format!("`{}` is no port name", settings.port);
            checks.push(Err(KindError::new("port", what, "give the camera's output port, such as /icub/cam/left")));
        }
        let carrier = settings.carrier.parse().ok().filter(|c: &Carrier| !c.is_text());
        if carrier.is_none() {
            let what = format!("`{}` carries no pictures", settings.carrier);
            checks.push(Err(KindError::new("carrier", what, "give tcp, fast_tcp or udp")));
        }
        let network = network_of(settings.server.as_deref(), settings.listen.as_deref());
        checks.push(network.as_ref().map(drop).map_err(Clone::clone));
        KindError::gather(checks)?;
        Ok(YarpCamera {
            lens: settings.lens.intrinsics(settings.size).map_err(|e| e.under("lens"))?,
            network: network?,
            own: settings.name.clone().unwrap_or_else(|| format!("/MoBeE/{robot}{}", settings.port)),
            carrier: carrier.unwrap_or_default(),
            settings: settings.clone(),
            mount: None,
            cell: ImageCell::default(),
            thread: None,
        })
    }

    /// Same camera on an existing network.
    #[must_use]
    pub fn on(self, network: &Network) -> YarpCamera {
        YarpCamera { network: Some(network.clone()), ..self }
    }

    /// Number of images replaced by newer ones before a request.
    pub fn dropped(&self) -> u64 {
        lock(&self.cell).dropped
    }

    fn listen(&self) -> Result<watch::Sender<()>, String> {
        let network = match &self.network {
            Some(network) => network.clone(),
            None => {
                mobee_yarp::config::network_or_default(&mobee_yarp::config::Env::real()).map_err(|e| e.to_string())?
            }
        };
        let (end, mut ended) = watch::channel(());
        let receiver = ImageReceiver {
            cell: Arc::clone(&self.cell),
            network,
            own: self.own.clone(),
            theirs: self.settings.port.clone(),
            carrier: self.carrier,
            size: self.settings.size,
            patience: SILENCE.max(PERIODS * self.period()),
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|e| format!("no thread for the camera's network: {e}"))?;
        let work = async move {
            tokio::select! {
                () = receiver.listen() => {}
                _ = ended.changed() => {}
            }
        };
        let thread = std::thread::Builder::new().name(format!("camera {}", self.settings.port));
        thread.spawn(move || runtime.block_on(work)).map_err(|e| format!("no thread for the camera's network: {e}"))?;
        Ok(end)
    }
}

impl Camera for YarpCamera {
    fn period(&self) -> Duration {
        Duration::try_from_secs_f64(1.0 / self.settings.fps).unwrap_or(Duration::from_millis(33))
    }

    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        if self.thread.is_none() {
            self.thread = Some(self.listen()?);
        }
        let mut received = lock(&self.cell);
        let Some((arrived, pixels)) = received.newest.take() else { return Ok(None) };
        let age = arrived.elapsed() + Duration::try_from_secs_f64(self.settings.delay_ms * 1e-3).unwrap_or_default();
        let exposed = Time(now.0.saturating_sub(age.as_nanos() as u64));
        Ok(Some(Frame { exposed, intrinsics: self.lens, pixels: pixels.into() }))
    }

    fn skipped(&mut self) -> Option<SkippedPictures> {
        lock(&self.cell).skipped.take()
    }

    fn runs_in_virtual_time(&self) -> bool {
        false
    }

    fn mount(&self) -> Option<CameraMount> {
        self.mount.clone()
    }
}

/// Receiver of images, which runs in the thread.
struct ImageReceiver {
    cell: ImageCell,
    network: Network,
    own: String,
    theirs: String,
    carrier: Carrier,
    size: [u32; 2],
    /// Silence after which a new connection is requested from the camera.
    patience: Duration,
}

impl ImageReceiver {
    /// Receives without end, because a port that is missing may come back.
    async fn listen(&self) {
        let mut last_warning = String::new();
        loop {
            match self.connected().await {
                Ok(mut port) => {
                    last_warning.clear();
                    self.receive(&mut port, &mut last_warning).await;
                    port.close().await;
                }
                Err(why) => self.warn(why, &mut last_warning),
            }
            sleep(RETRY_PAUSE).await;
        }
    }

    /// Logs each reason once.
    fn warn(&self, why: String, last_warning: &mut String) {
        if why != *last_warning {
            tracing::warn!(camera = self.theirs, why, "no pictures from this camera; it is asked again");
            *last_warning = why;
        }
    }

    async fn connected(&self) -> Result<InputPort, String> {
        let mut port = InputPort::open(&self.network, &self.own, Queue::Newest).await.map_err(|e| e.to_string())?;
        match port.connect_from(&self.theirs, self.carrier).await {
            Ok(()) => Ok(port),
            Err(e) => {
                port.close().await;
                Err(e.to_string())
            }
        }
    }

    /// Receives images while the port is open.
    async fn receive(&self, port: &mut InputPort, last_warning: &mut String) {
        let mut source = StreamSource::new(&self.theirs, self.carrier, self.patience);
        let mut dropped = 0;
        loop {
            match source.recv(port).await {
                Ok(Some(message)) => {
                    last_warning.clear();
                    let picture = pixels(&message, self.network.dialect(), self.size);
                    let mut received = lock(&self.cell);
                    received.dropped += port.dropped() - dropped;
                    dropped = port.dropped();
                    match picture {
                        Ok(pixels) => {
                            received.dropped += u64::from(received.newest.replace((instant(), pixels)).is_some());
                        }
                        Err(why) => SkippedPictures::add(&mut received.skipped, format!("{}: {why}", self.theirs)),
                    }
                }
                Ok(None) => return,
                Err(why) => self.warn(why.to_string(), last_warning),
            }
        }
    }
}

/// Pixels of an image message: red, green and blue, row by row.
fn pixels(message: &Message, dialect: Dialect, size: [u32; 2]) -> Result<Vec<u8>, String> {
    let bottle = message.payload.bottle(dialect).map_err(|e| format!("what came is no image: {e}"))?;
    let image = Image::from_bottle(bottle).map_err(|e| format!("what came is no image: {e}"))?;
    if [image.width, image.height] != size {
        let [width, height] = size;
        let found = format!("its pictures are {}x{} pixels, not {width}x{height}", image.width, image.height);
        return Err(format!("{found}: set `size`"));
    }
    let bytes = image.pixels();
    let each = |count: usize, order: [usize; 3]| {
        let pick = |p: &[u8]| order.map(|k| p.get(k).copied().unwrap_or(0));
        bytes.chunks_exact(count).flat_map(pick).collect()
    };
    match image.pixel {
        PixelCode::RGB => Ok(bytes),
        PixelCode::BGR => Ok(each(3, [2, 1, 0])),
        PixelCode::RGBA => Ok(each(4, [0, 1, 2])),
        PixelCode::BGRA => Ok(each(4, [2, 1, 0])),
        PixelCode::MONO => Ok(each(1, [0, 0, 0])),
        other => Err(format!("its pixels are {:?}: only rgb, bgr, rgba, bgra and mono are understood", other.0)),
    }
}

fn build(value: &Value, context: &CameraContext) -> Result<Box<dyn Camera>, KindError> {
    let settings: YarpCameraSettings = settings(value)?;
    let mut camera = YarpCamera::new(&settings, &context.robot.name)?;
    let mount = settings.marker.as_ref().map(|marker| Mount::new(&context.robot, marker, [0.0; 3], [0.0; 3]));
    camera.mount = mount.transpose()?.map(|mount| mount.to_contract(context.index));
    Ok(Box::new(camera))
}

inventory::submit! {
    Registered(&Kind::<dyn Camera> {
        name: "yarp",
        doc: "A camera behind a YARP image port, in real time: the newest picture wins, what comes in between is dropped and counted. \
              Pictures of rgb, bgr, rgba, bgra or mono pixels. A port that is not there is asked again until it is.",
        schema: || schemars::schema_for!(YarpCameraSettings),
        example: |_| Err("it needs a camera behind YARP"),
        build,
    })
}
