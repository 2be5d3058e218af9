use super::*;
use mobee_contract::{Camera, SeenPicture};
use std::time::Duration;

use crate::eyes::{RecordedCamera, RecordedCameraSettings};

/// Temporary folder, removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let dir = std::env::temp_dir().join(format!("mobee-frames-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&dir);
        std::fs::create_dir_all(&dir).unwrap();
        Folder(dir)
    }
    fn left(&self) -> PathBuf {
        self.0.join("eyes.left.frames")
    }
    fn keep(&self) -> Result<KeptFrames, String> {
        KeptFrames::open(&self.0, &["eyes/left".into()])
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Frame of noise-like pixels, exposed at this time, ms.
fn frame(ms: u64) -> Frame {
    let size = [5, 3 + ms as u32 % 2];
    let bytes = size[0] * size[1] * 3;
    Frame {
        exposed: Time(ms * 1_000_000),
        intrinsics: Intrinsics {
            size,
            focal: [257.3, 250.1],
            center: [2.5, 1.5],
            distortion: [-0.3, 0.2, 1e-3, -1e-3],
        },
        pixels: (0..bytes).map(|i| (i * 97 + ms as u32 * 31) as u8).collect(),
    }
}

fn write(sink: &mut dyn Sink, camera: &str, frame: &Frame) -> Result<(), String> {
    let seen = SeenPicture { frame: frame.clone(), regions: Vec::new().into(), mask: None, mount: None };
    sink.write(Time::ZERO, &Entry::Picture { camera: camera.into(), seen: Arc::new(seen) })
}

fn put(sink: &mut dyn Sink, times: &[u64]) {
    times.iter().for_each(|ms| write(sink, "eyes/left", &frame(*ms)).unwrap());
}

/// Exposure times of the frames in the file, ms. Each frame is compared with the one written.
fn kept(dir: &Folder) -> Result<Vec<u64>, String> {
    let mut reader = FrameReader::open(&dir.0, "eyes/left").map_err(|e| e.what)?;
    let mut times = Vec::new();
    while let Some(next) = reader.next_frame()? {
        let (found, ms) = (reader.frame(&next)?, next.exposed.0 / 1_000_000);
        let was = frame(ms);
        assert_eq!((found.exposed, found.intrinsics, &found.pixels), (was.exposed, was.intrinsics, &was.pixels));
        times.push(ms);
    }
    Ok(times)
}

#[test]
fn what_was_kept_is_the_same_to_the_byte_with_time_and_lens() {
    let dir = Folder::new("same");
    let mut sink = dir.keep().unwrap().sink();
    put(sink.as_mut(), &[100, 201, 300]);
    write(sink.as_mut(), "eyes/right", &frame(5)).unwrap();
    // readable before the writer has closed the file
    assert_eq!(kept(&dir), Ok(vec![100, 201, 300]));
}

#[test]
fn a_crash_at_any_byte_costs_the_last_frame_at_most_and_the_file_goes_on() {
    let dir = Folder::new("crash");
    put(dir.keep().unwrap().sink().as_mut(), &[1, 2]);
    let two = std::fs::read(dir.left()).unwrap();
    put(dir.keep().unwrap().sink().as_mut(), &[3]);
    let whole = std::fs::read(dir.left()).unwrap();
    for len in 0..=whole.len() {
        std::fs::write(dir.left(), &whole[..len]).unwrap();
        let before = kept(&dir);
        let count = before.as_ref().map_or(0, Vec::len);
        let least = [0, 2, 3][usize::from(len >= two.len()) + usize::from(len == whole.len())];
        assert!(count >= least && (len < START as usize) == before.is_err(), "{len}: {before:?}");
        put(dir.keep().unwrap().sink().as_mut(), &[9]);
        assert_eq!(kept(&dir).unwrap()[count..], [9], "{len}");
    }
    // a block that never reached the disk, although the file has its full length
    let mut zeros = whole.clone();
    zeros[two.len() + 90..].fill(0);
    std::fs::write(dir.left(), &zeros).unwrap();
    put(dir.keep().unwrap().sink().as_mut(), &[4]);
    assert_eq!(kept(&dir), Ok(vec![1, 2, 4]));
}

/// Exposure times of the readable frames, ms, each compared with the one written, and the reports about damaged
/// ones.
fn readable(dir: &Folder) -> (Vec<u64>, Vec<String>) {
    let mut reader = FrameReader::open(&dir.0, "eyes/left").unwrap();
    let (mut times, mut damage) = (Vec::new(), Vec::new());
    while let Some(next) = reader.next_frame().unwrap() {
        match reader.frame(&next) {
            Ok(found) => {
                let ms = next.exposed.0 / 1_000_000;
                assert_eq!(found.pixels, frame(ms).pixels);
                times.push(ms);
            }
            Err(what) => damage.push(what),
        }
    }
    damage.extend(reader.damage());
    (times, damage)
}

#[test]
fn damage_anywhere_costs_its_frame_alone_and_is_noticed_with_its_place() {
    let dir = Folder::new("changed");
    put(dir.keep().unwrap().sink().as_mut(), &[1, 2]);
    let two = std::fs::metadata(dir.left()).unwrap().len() as usize;
    put(dir.keep().unwrap().sink().as_mut(), &[3]);
    let whole = std::fs::read(dir.left()).unwrap();
    for at in START as usize..whole.len() {
        for flipped in [0x01, 0x40, 0x80] {
            let mut bytes = whole.clone();
            bytes[at] ^= flipped;
            std::fs::write(dir.left(), &bytes).unwrap();
            let (times, damage) = readable(&dir);
            assert_eq!((times.len(), damage.len()), (2, 1), "byte {at}: {times:?} {damage:?}");
            assert!(damage[0].contains("eyes.left.frames") && damage[0].contains(" byte "), "{damage:?}");
            // a writer that continues the file truncates only the incomplete record that a crash may have left
            // at its end
            let kept = dir.keep().unwrap();
            put(kept.sink().as_mut(), &[9]);
            let (after, named) = readable(&dir);
            assert_eq!(after, [&times[..], &[9]].concat(), "byte {at}");
            assert_eq!(named.len(), usize::from(at < two), "byte {at}: {named:?}");
            assert!(kept.damage().iter().all(|d| named.contains(d)), "{:?} {named:?}", kept.damage());
        }
    }
}

#[test]
fn a_frame_whose_time_is_damaged_holds_no_camera_up() {
    let dir = Folder::new("time");
    put(dir.keep().unwrap().sink().as_mut(), &[100, 200, 300, 400]);
    let mut bytes = std::fs::read(dir.left()).unwrap();
    let second = START as usize + 8 + u32::from_le_bytes(bytes[START as usize..][..4].try_into().unwrap()) as usize;
    bytes[second + 4 + 5] ^= 0x10; // days later
    std::fs::write(dir.left(), &bytes).unwrap();
    let settings =
        RecordedCameraSettings { run: dir.0.clone(), camera: "eyes/left".into(), repeat: false, marker: None };
    let mut camera = RecordedCamera::new(&settings).unwrap();
    let seen: Vec<u64> = [100, 200, 300, 400]
        .iter()
        .filter_map(|ms| camera.frame(Time(ms * 1_000_000)).unwrap())
        .map(|f| f.exposed.0 / 1_000_000)
        .collect();
    assert_eq!(seen, [100, 300, 400]);
}

#[test]
fn a_camera_of_one_frame_at_time_zero_repeats_it_once_a_second() {
    let dir = Folder::new("zero");
    put(dir.keep().unwrap().sink().as_mut(), &[0]);
    let settings =
        RecordedCameraSettings { run: dir.0.clone(), camera: "eyes/left".into(), repeat: true, marker: None };
    let mut camera = RecordedCamera::new(&settings).unwrap();
    let seen = (0..3000).filter(|ms| camera.frame(Time(ms * 1_000_000)).unwrap().is_some()).count();
    assert_eq!(seen, 3);
}

#[test]
fn files_of_other_versions_are_refused_by_readers_and_writers() {
    let dir = Folder::new("foreign");
    let refused = |camera: &str| FrameReader::open(&dir.0, camera).err().map(|e| (e.path, e.what, e.help)).unwrap();
    let (path, what, help) = refused("eyes/left");
    assert!(path == "run" && what.ends_with("kept no frames") && help.contains("keep_frames = true"), "{what}; {help}");
    let nowhere = FrameReader::open(&dir.0.join("no"), "eyes/left").unwrap_err();
    assert!(nowhere.what.contains("can't read"), "{nowhere:?}");
    put(dir.keep().unwrap().sink().as_mut(), &[1]);
    let (path, what, help) = refused("eyes/lefd");
    assert!(
        path == "camera" && what.contains("eyes/lefd") && help.contains("did you mean `eyes/left`"),
        "{what}; {help}"
    );
    for (bytes, told) in
        [("mobee frames 2\nxyz", "is of another version"), ("a,b\n1,2\n3,4,5,6,7,8", "holds no frames")]
    {
        std::fs::write(dir.left(), bytes).unwrap();
        assert!(refused("eyes/left").1.contains(told));
        assert!(dir.keep().unwrap_err().contains(told));
        assert_eq!(std::fs::read(dir.left()).unwrap(), bytes.as_bytes(), "it is left alone");
    }
    std::fs::write(dir.left(), "mobee").unwrap();
    assert!(refused("eyes/left").1.contains("has no frame"));
}

#[test]
fn frames_that_are_none_are_not_kept() {
    let dir = Folder::new("none");
    let mut sink = dir.keep().unwrap().sink();
    let with = |size: [u32; 2], bytes: usize| {
        let frame = frame(1);
        Frame { intrinsics: Intrinsics { size, ..frame.intrinsics }, pixels: vec![0; bytes].into(), ..frame }
    };
    for wrong in [with([5, 3], 44), with([0, 3], 0), with([MAX_SIDE_PX + 1, 1], 3 * (MAX_SIDE_PX as usize + 1))] {
        let told = write(sink.as_mut(), "eyes/left", &wrong).unwrap_err();
        assert!(told.contains("can't be kept"), "{told}");
    }
    put(sink.as_mut(), &[7]);
    assert_eq!(kept(&dir), Ok(vec![7]));
}

#[test]
fn a_recorded_camera_delivers_each_frame_at_its_exposure_time_and_late_readers_miss_some() {
    let dir = Folder::new("again");
    put(dir.keep().unwrap().sink().as_mut(), &[100, 250, 300]);
    let looks = |repeat: bool, times: &[u64]| {
        let settings = RecordedCameraSettings { run: dir.0.clone(), camera: "eyes/left".into(), repeat, marker: None };
        let mut camera = RecordedCamera::new(&settings).unwrap();
        let mut look = |ms: &u64| {
            let seen = camera.frame(Time(ms * 1_000_000)).unwrap();
            (seen.map(|f| f.exposed.0 / 1_000_000), camera.period().as_millis() as u64)
        };
        times.iter().map(&mut look).collect::<Vec<_>>()
    };
    let end = (None, 1000);
    assert_eq!(
        looks(false, &[50, 100, 240, 250, 300, 5000]),
        [(None, 50), (Some(100), 150), (None, 10), (Some(250), 50), (Some(300), 1000), end]
    );
    assert_eq!(looks(false, &[5000, 6000]), [(Some(300), 1000), end], "the newest of all");
    // the recording is repeated from 50 ms after its last frame, with frames shifted by 350 ms
    assert_eq!(
        looks(true, &[250, 300, 449, 450, 600, 650, 800, 35_120]),
        [
            (Some(250), 50),
            (Some(300), 150),
            (None, 1),
            (Some(450), 150),
            (Some(600), 50),
            (Some(650), 150),
            (Some(800), 150),
            (Some(35_100), 130)
        ]
    );
    let settings =
        RecordedCameraSettings { run: dir.0.clone(), camera: "eyes/left".into(), repeat: true, marker: None };
    std::fs::remove_file(dir.left()).unwrap();
    put(dir.keep().unwrap().sink().as_mut(), &[0]);
    let mut one = RecordedCamera::new(&settings).unwrap();
    let begun = Time::ZERO + Duration::from_secs(86_400 * 365);
    assert!(one.frame(begun).unwrap().is_some(), "a run of one frame at its beginning ends, too");
}
