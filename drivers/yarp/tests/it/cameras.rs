//! Cameras that are not simulated: folders of pictures in their order and at their rate, with bad files refused by name; and YARP
//! image ports, whose newest picture wins.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use mobee_contract::{Camera, Time};
use mobee_driver_yarp::{YarpCamera, YarpCameraSettings};
use mobee_sim::eyes::{FolderCamera, FolderCameraSettings, LensSettings};
use mobee_yarp::name::{NameServer, ServerOptions};
use mobee_yarp::{Carrier, Delivery, Image, Network, OutputPort, PixelCode};
use serde_json::json;
use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn folder(path: &Path, repeat: bool) -> FolderCameraSettings {
    FolderCameraSettings { path: path.to_owned(), fps: 10.0, repeat, lens: LensSettings::default() }
}

fn save(path: &Path, gray: u8, width: u32) {
    image::RgbImage::from_pixel(width, 12, image::Rgb([gray; 3])).save(path).unwrap();
}

/// A folder that is removed in the end.
struct Folder(std::path::PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("mobee-cameras-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_folder_gives_its_pictures_in_order_at_its_rate_and_who_is_late_misses_some() {
    let dir = Folder::new("order");
    let at = |name: &str| dir.0.join(name);
    [("b.png", 20), ("a.png", 10), ("c.png", 30)].iter().for_each(|(name, gray)| save(&at(name), *gray, 16));
    save(&at("a_mask.png"), 99, 16);
    std::fs::write(at("notes.txt"), "no picture").unwrap();
    let looks = |repeat: bool, times: &[u64]| {
        let mut camera = FolderCamera::new(&folder(&dir.0, repeat)).unwrap();
        let look = |ms: &u64| {
            let frame = camera.frame(Time::ZERO + Duration::from_millis(*ms)).unwrap()?;
            assert_eq!((frame.intrinsics.size, frame.pixels.len()), ([16, 12], 16 * 12 * 3));
            Some((frame.pixels[0], (frame.exposed.secs() * 1e3).round()))
        };
        times.iter().map(look).collect::<Vec<_>>()
    };
    let first = Some((10, 1000.0));
    assert_eq!(
        looks(false, &[1000, 1050, 1100, 1250, 1300]),
        [first, None, Some((20, 1100.0)), Some((30, 1200.0)), None]
    );
    assert_eq!(looks(true, &[1000, 1350]), [first, Some((10, 1300.0))], "the fourth is the first again");
}

#[test]
fn pictures_that_are_none_or_of_another_size_are_refused_by_name() {
    let dir = Folder::new("bad");
    let at = |name: &str| dir.0.join(name);
    let refused = || FolderCamera::new(&folder(&dir.0, false)).err().map(|e| (e.path, e.what)).unwrap();
    assert!(refused().1.contains("there are no pictures"));
    save(&at("a.png"), 1, 16);
    save(&at("b.png"), 1, 20);
    let (path, what) = refused();
    assert!(
        path == "path" && what.contains("b.png: this picture is 20x12 pixels, but those before it are 16x12"),
        "{what}"
    );
    std::fs::write(at("b.png"), "").unwrap();
    assert!(refused().1.contains("b.png: this is no picture"));
    // what is torn shows when it is its turn, and is skipped
    save(&at("c.png"), 1, 16);
    let whole = std::fs::read(at("a.png")).unwrap();
    std::fs::write(at("b.png"), &whole[..whole.len() - 20]).unwrap();
    let mut camera = FolderCamera::new(&folder(&dir.0, false)).unwrap();
    assert!(camera.frame(Time::ZERO).unwrap().is_some());
    assert!(camera.skipped().is_none() && camera.frame(Time::from_secs(0.1)).unwrap().is_none());
    let skipped = camera.skipped().unwrap();
    assert!(skipped.count == 1 && skipped.why.contains("b.png: this is no whole picture"), "{skipped:?}");
    assert!(
        camera.frame(Time::from_secs(0.2)).unwrap().is_some() && camera.skipped().is_none(),
        "the next one is whole"
    );
    let gone = FolderCamera::new(&folder(&at("none"), false)).err().unwrap();
    assert!(gone.what.contains("can't read") && gone.help.contains("folder"), "{gone:?}");
}

fn yarp_named(port: &str) -> YarpCameraSettings {
    serde_json::from_value(json!({ "port": port, "size": [3, 2], "delay_ms": 0.0 })).unwrap()
}

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(20);

/// The bytes of a 3x2 picture of the reference vectors: red 10x + y, green 100 + x, blue 200 + y, rows padded to 16 bytes.
const VECTOR: &str = "0001000004000000090000006d6174000900000072676200010100000500000003000000200000000800010003000000020000000c000000200000000064c80a65c81466c8000000000000000164c90b65c91566c900000000000000";

#[test]
fn a_yarp_camera_gives_the_newest_picture_counts_the_others_and_tells_what_is_none() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let server = runtime
        .block_on(NameServer::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), ServerOptions::default()))
        .unwrap();
    let network = Network::at(server.address());
    let port = runtime.block_on(OutputPort::open(&network, "/cam/left", Delivery::Strict(8))).unwrap();
    let mut camera = YarpCamera::new(&yarp_named("/cam/left"), "icub").unwrap().on(&network);
    let wait = |what: &str, there: &mut dyn FnMut() -> bool| {
        let begun = Instant::now();
        while !there() {
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {what}");
            // what is on this thread goes on meanwhile
            runtime.block_on(async { tokio::time::sleep(Duration::from_millis(1)).await });
        }
    };
    wait("a connection", &mut || {
        assert!(camera.frame(Time::from_secs(1.0)).unwrap().is_none());
        !port.peers().is_empty()
    });
    let bytes: Vec<u8> =
        (0..VECTOR.len()).step_by(2).map(|k| u8::from_str_radix(&VECTOR[k..k + 2], 16).unwrap()).collect();
    let mut seen = None;
    port.write(bytes, Some("7 1.5".into()));
    wait("a picture", &mut || {
        seen = camera.frame(Time::from_secs(100.0)).unwrap();
        seen.is_some()
    });
    let frame = seen.unwrap();
    assert_eq!(frame.pixels[..], [0, 100, 200, 10, 101, 200, 20, 102, 200, 1, 100, 201, 11, 101, 201, 21, 102, 201]);
    assert!(frame.exposed <= Time::from_secs(100.0) && frame.exposed > Time::from_secs(80.0));

    let gray = |g: u8| Image::new(PixelCode::MONO, 3, 2, &[g; 6]).unwrap().encode();
    for g in 1..=3 {
        port.write(gray(g), None);
        runtime.block_on(port.drained());
    }
    wait("the last to arrive", &mut || camera.dropped() == 2);
    assert_eq!(camera.frame(Time::from_secs(101.0)).unwrap().unwrap().pixels[..], [3; 18]);

    port.write(Image::new(PixelCode::RGB, 1, 1, &[1, 2, 3]).unwrap().encode(), None);
    let mut told = None;
    wait("a complaint", &mut || {
        assert!(camera.frame(Time::from_secs(102.0)).unwrap().is_none());
        told = camera.skipped();
        told.is_some()
    });
    let told = told.unwrap();
    assert!(told.why.contains("/cam/left: its pictures are 1x1 pixels, not 3x2: set `size`"), "{told:?}");
    port.write(b"no picture at all".to_vec(), None);
    port.write(gray(9), None);
    let mut seen = None;
    wait("the picture after it", &mut || {
        seen = camera.frame(Time::from_secs(103.0)).unwrap();
        seen.is_some()
    });
    assert_eq!(seen.unwrap().pixels[..], [9; 18], "it goes on");
    drop(camera);
    wait("the camera to let go", &mut || port.peers().is_empty());
}

/// A program that is connected and says nothing does not keep a camera that was started again from being connected to.
#[test]
fn a_yarp_camera_that_falls_silent_is_asked_again_whoever_else_is_connected() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let server = NameServer::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), ServerOptions::default());
    let server = runtime.block_on(server).unwrap();
    let network = Network::at(server.address());
    let open = |name: &str| runtime.block_on(OutputPort::open(&network, name, Delivery::Newest)).unwrap();
    let mut camera = YarpCamera::new(&yarp_named("/cam/left"), "icub").unwrap().on(&network);
    let stranger = open("/stranger");
    for life in 1..=2 {
        let port = open("/cam/left");
        let begun = Instant::now();
        while camera.frame(Time::from_secs(1.0)).unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE, "no picture in life {life}");
            port.write(Image::new(PixelCode::MONO, 3, 2, &[life; 6]).unwrap().encode(), None);
            runtime.block_on(async { tokio::time::sleep(Duration::from_millis(1)).await });
        }
        if life == 1 {
            runtime.block_on(stranger.connect("/MoBeE/icub/cam/left", Carrier::Tcp)).unwrap();
        }
        runtime.block_on(port.close());
    }
}

/// The real YARP 3.5 writes a picture that was typed as text.
#[test]
fn a_yarp_camera_reads_what_a_real_yarp_program_writes() {
    let installed = || {
        let default = || Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache/mobee/yarp-3.5.0"));
        let home = std::env::var_os("MOBEE_YARP").map(PathBuf::from).or_else(default)?;
        Some(home.join("build/bin/yarp")).filter(|yarp| yarp.is_file())
    };
    let Some(yarp) = installed() else {
        eprintln!("skipped: the real YARP is not installed (drivers/yarp/tests)");
        return;
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let server = NameServer::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), ServerOptions::default());
    let server = runtime.block_on(server).unwrap();
    let dir = Folder::new("yarp");
    std::fs::write(dir.0.join("yarp.conf"), format!("127.0.0.1 {} yarp\n", server.address().port())).unwrap();
    let mut writer = Command::new(yarp)
        .args(["write", "/cam/real"])
        .env("YARP_CONFIG_HOME", &dir.0)
        .env_remove("YARP_NAMESPACE")
        .env_remove("YARP_PORT_PREFIX")
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut keys = writer.stdin.take().unwrap();
    let mut camera = YarpCamera::new(&yarp_named("/cam/real"), "icub").unwrap().on(&Network::at(server.address()));
    let rows = "0 100 200 10 101 200 20 102 200 0 0 0 0 0 0 0 1 100 201 11 101 201 21 102 201 0 0 0 0 0 0 0";
    let line = format!("[mat] [rgb] (3 32 65544 3 2) {{{rows}}}\n");
    let begun = Instant::now();
    let seen = loop {
        // the first ones may come before the connection
        let _ = keys.write_all(line.as_bytes()).and_then(|()| keys.flush());
        runtime.block_on(async { tokio::time::sleep(Duration::from_millis(20)).await });
        match camera.frame(Time::from_secs(1.0)).unwrap() {
            Some(frame) => break frame,
            None => assert!(begun.elapsed() < PATIENCE, "waited in vain for a picture"),
        }
    };
    let _ = writer.kill().and_then(|()| writer.wait());
    assert_eq!(seen.pixels[..], [0, 100, 200, 10, 101, 200, 20, 102, 200, 1, 100, 201, 11, 101, 201, 21, 102, 201]);
}

#[test]
fn settings_of_a_yarp_camera_that_make_no_sense_are_refused() {
    let refused = |change: serde_json::Value| {
        let mut settings = serde_json::to_value(yarp_named("/cam/left")).unwrap();
        change.as_object().unwrap().iter().for_each(|(k, v)| settings[k] = v.clone());
        let settings = serde_json::from_value(settings).unwrap();
        YarpCamera::new(&settings, "icub").err().unwrap()
    };
    for (change, path) in [
        (json!({ "port": "cam" }), "port"),
        (json!({ "carrier": "text" }), "carrier"),
        (json!({ "server": "nowhere" }), "server"),
        (json!({ "listen": "here" }), "listen"),
        (json!({ "size": [0, 2] }), "size[0]"),
        (json!({ "lens": { "focal": [0.0, 1.0] } }), "lens.focal[0]"),
    ] {
        assert_eq!(refused(change.clone()).path, path, "{change}");
    }
}
