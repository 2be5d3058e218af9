//! Taps: nothing is lost unnoticed, and nobody waits in real time.

use mobee_contract::{EdgeState, Entry, Event, Frame, Intrinsics, Note, SeenPicture, Sink, Status, Time};
use mobee_model::Scene;
use mobee_runtime::clock::{Clock, ClockKind, runtime};
use mobee_runtime::tap::{Pictures, SinkReport, SinkSpec, TapActor, Taps};
use ractor::Actor;
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// A gate that a sink waits at before each entry, and what it wrote.
#[derive(Default)]
struct Board {
    state: Mutex<(bool, Vec<String>, u32)>,
    moved: Condvar,
}

impl Board {
    fn open_gate(&self) {
        self.state.lock().unwrap().0 = true;
        self.moved.notify_all();
    }
    fn written(&self) -> Vec<String> {
        self.state.lock().unwrap().1.clone()
    }
}

struct Slow(Arc<Board>);

impl Sink for Slow {
    fn write(&mut self, _: Time, entry: &Entry) -> Result<(), String> {
        let mut state = self.0.state.lock().unwrap();
        while !state.0 {
            state = self.0.moved.wait(state).unwrap();
        }
        let text = match entry {
            Entry::Event(e) => match &**e {
                Event::Warning { text } if text == "fail" && state.2 == 0 => {
                    state.2 += 1;
                    return Err("planned".into());
                }
                Event::Warning { text } if text == "panic" && state.2 == 0 => {
                    state.2 += 1;
                    drop(state);
                    panic!("planned panic")
                }
                Event::Warning { text } => text.clone(),
                other => format!("{other:?}"),
            },
            Entry::Pose { robot, .. } => format!("pose {robot}"),
            Entry::Scene(_) => "scene".into(),
            Entry::Picture { camera, .. } => format!("picture {camera}"),
        };
        state.1.push(text);
        Ok(())
    }
    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

fn spec(name: &str, essential: bool, board: &Arc<Board>, capacity: usize) -> SinkSpec {
    let board = board.clone();
    SinkSpec {
        pictures: Pictures::None,
        name: name.into(),
        essential,
        poses: (!essential).then_some(Duration::from_millis(50)),
        capacity,
        patience: Duration::from_millis(200),
        open: Some(Arc::new(move || Ok(Box::new(Slow(board.clone()))))),
    }
}

fn warning(text: impl Into<String>) -> Event {
    Event::Warning { text: text.into() }
}

#[test]
fn in_virtual_time_a_full_queue_is_waited_for() {
    let board = Arc::new(Board::default());
    let taps = Taps::spawn(ClockKind::Virtual, vec![spec("journal", true, &board, 4)]).unwrap();
    board.open_gate();
    (0..1000).for_each(|i| taps.event(Time(i), warning(i.to_string())));
    let reports = taps.finish(Time(1000), Event::Ended { reason: "done".into() });
    assert_eq!((reports[0].sent, reports[0].handled, reports[0].dropped), (1001, 1001, 0));
    assert_eq!(board.written()[..1000], (0..1000).map(|i| i.to_string()).collect::<Vec<_>>());
}

#[test]
fn in_real_time_a_frozen_recorder_drops_poses_first_and_counts() {
    let (frozen, open) = (Arc::new(Board::default()), Arc::new(Board::default()));
    open.open_gate();
    let specs = vec![spec("journal", true, &open, 100), spec("recorder", false, &frozen, 10)];
    let taps = Taps::spawn(ClockKind::Real, specs).unwrap();
    let (q, contacts) = (vec![0.0].into(), Vec::new().into());
    for k in 0..5 {
        taps.event(Time(k), warning(format!("e{k}")));
    }
    for k in 0..200 {
        taps.pose(Time(k * 10_000_000), 0, &q, &contacts);
    }
    assert_eq!(taps.failed(), None);
    frozen.open_gate();
    let reports = taps.finish(Time(9), Event::Ended { reason: "done".into() });
    let recorder = &reports[0];
    assert_eq!(recorder.sent, 5 + 40 + 1, "poses thinned to 20 Hz");
    assert_eq!(recorder.sent, recorder.handled + recorder.queued + recorder.dropped);
    assert!(recorder.dropped >= 30);
    assert!((0..5).all(|k| frozen.written().contains(&format!("e{k}"))), "no event went before the poses");
    assert!(open.written().iter().any(|l| l.starts_with("Link")), "the journal has the loss");
}

/// Tells a hundred and fifty pictures of two cameras to a sink that wants all of one of them, and what became of them.
fn pictures(clock: ClockKind, board: &Arc<Board>, meanwhile: impl FnOnce()) -> SinkReport {
    let spec = spec("frames", false, board, 1000);
    let spec = SinkSpec { pictures: Pictures::All(["eyes/left".to_owned()].into()), poses: None, ..spec };
    let taps = Taps::spawn(clock, vec![spec]).unwrap();
    let intrinsics = Intrinsics { size: [1, 1], focal: [1.0; 2], center: [0.5; 2], distortion: [0.0; 4] };
    for k in 0..150 {
        let frame = Frame { exposed: Time(k), intrinsics, pixels: [0; 3].into() };
        let seen = Arc::new(SeenPicture { frame, regions: [].into(), mask: None, mount: None });
        ["eyes/left", "eyes/right"].iter().for_each(|camera| taps.picture(Time(k), camera, &seen));
    }
    meanwhile();
    taps.finish(Time(200), Event::Ended { reason: "done".into() }).remove(0)
}

#[test]
fn who_keeps_pictures_has_all_by_a_virtual_clock_and_by_a_real_one_few_wait_and_the_rest_is_counted() {
    let board = Arc::new(Board::default());
    board.open_gate();
    let kept = pictures(ClockKind::Virtual, &board, || {});
    assert_eq!((kept.sent, kept.handled, kept.dropped), (151, 151, 0));
    assert_eq!(board.written()[..150], vec!["picture eyes/left"; 150]);
    let frozen = Arc::new(Board::default());
    let kept = pictures(ClockKind::Real, &frozen, || frozen.open_gate());
    assert_eq!((kept.sent, kept.handled), (151, 151 - kept.dropped));
    assert!((20..90).contains(&kept.dropped), "{} dropped: at most 64 wait, and as many are in hand", kept.dropped);
}

#[test]
fn a_lost_event_of_the_journal_is_a_lasting_fault() {
    let frozen = Arc::new(Board::default());
    let taps = Taps::spawn(ClockKind::Real, vec![spec("journal", true, &frozen, 3)]).unwrap();
    (0..3).for_each(|k| taps.event(Time(k), warning("x")));
    assert_eq!(taps.failed(), None);
    (0..3).for_each(|k| taps.event(Time(k), warning("x")));
    frozen.open_gate();
    assert!(taps.failed().unwrap().contains("journal lost an event"));
    assert!(taps.finish(Time(9), Event::Ended { reason: "done".into() })[0].error.is_some());
}

#[test]
fn a_sink_that_fails_or_panics_is_opened_anew_and_writes_the_entry_it_failed_at() {
    for trouble in ["fail", "panic"] {
        let board = Arc::new(Board::default());
        board.open_gate();
        let rt = runtime(ClockKind::Virtual).unwrap();
        rt.block_on(async {
            let clock = Clock::new(ClockKind::Virtual);
            let taps = Taps::spawn(ClockKind::Virtual, vec![spec("journal", true, &board, 2)]).unwrap();
            let args = (taps.clone(), clock.clone(), "journal".to_string());
            let (actor, _) = Actor::spawn(None, TapActor, args).await.unwrap();
            taps.event(Time(1), warning(trouble));
            while taps.failed().is_none() {
                std::thread::yield_now();
            }
            clock.sleep(Duration::from_secs(2)).await;
            assert_eq!(taps.failed(), None);
            actor.stop(None);
            let reports = taps.finish(clock.now(), Event::Ended { reason: "done".into() });
            assert_eq!((reports[0].sent, reports[0].handled), (3, 3));
            let written = board.written();
            assert_eq!(written[0], trouble);
            assert!(written[1].contains("planned") && written[1].contains("opened anew"));
        });
    }
}

fn state(status: Status) -> Event {
    Event::State { robot: "icub".into(), status }
}

fn edge(to: u32, state: EdgeState) -> Event {
    Event::Note { robot: "icub".into(), note: Note::Edge { from: 1, to, state, cause: None } }
}

/// Puts a sink where nobody was yet, or in another's place.
fn attach(taps: &Taps, board: &Arc<Board>) {
    let open = spec("viewer", false, board, 1).open.unwrap();
    taps.attach("viewer", open().unwrap(), open.clone()).unwrap();
}

#[test]
fn who_comes_later_is_told_how_everything_is_now_and_then_what_comes() {
    let viewer = Arc::new(Board::default());
    viewer.open_gate();
    let taps =
        Taps::spawn(ClockKind::Real, vec![SinkSpec { open: None, ..spec("viewer", false, &viewer, 10) }]).unwrap();
    let scene = Arc::new(Scene::new(vec![], vec![]).unwrap());
    taps.scene(Time(1), &scene);
    let past = [
        state(Status::Rest),
        edge(2, EdgeState::Optimistic),
        edge(3, EdgeState::Optimistic),
        edge(2, EdgeState::Removed),
        state(Status::Moving),
        warning("long gone"),
    ];
    past.iter().zip(2..).for_each(|(event, at)| taps.event(Time(at), event.clone()));
    assert_eq!(viewer.written(), [""; 0], "nobody is there yet");
    attach(&taps, &viewer);
    taps.event(Time(9), warning("next"));
    let reports = taps.finish(Time(10), Event::Ended { reason: "done".into() });
    let now = [&past[2], &past[3], &past[4]].map(|e| format!("{e:?}"));
    let written = viewer.written();
    assert_eq!((written[0].as_str(), &written[1..4], written[4].as_str()), ("scene", &now[..], "next"));
    assert_eq!((written.len(), reports[0].sent, reports[0].handled, reports[0].dropped), (6, 2, 2, 0));
    assert!(Taps::none().attach("viewer", Box::new(Slow(viewer.clone())), Arc::new(|| Err("no".into()))).is_err());
}

#[test]
fn a_frozen_viewer_is_replaced_and_what_it_missed_is_counted() {
    let (frozen, viewer) = (Arc::new(Board::default()), Arc::new(Board::default()));
    let taps = Taps::spawn(ClockKind::Real, vec![spec("viewer", false, &frozen, 4)]).unwrap();
    (0..20).for_each(|k| taps.event(Time(k), state(if k < 19 { Status::Moving } else { Status::Rest })));
    viewer.open_gate();
    attach(&taps, &viewer);
    taps.event(Time(30), warning("next"));
    let reports = taps.finish(Time(31), Event::Ended { reason: "done".into() });
    frozen.open_gate();
    let SinkReport { sent, handled, queued, dropped, error, .. } = reports[0].clone();
    assert_eq!((sent, handled, queued, dropped, error), (22, 2, 0, 20, None));
    assert_eq!(viewer.written()[..2], [format!("{:?}", state(Status::Rest)), "next".to_owned()]);
}

#[test]
fn a_sink_that_hangs_at_the_end_is_left_behind() {
    let (frozen, open) = (Arc::new(Board::default()), Arc::new(Board::default()));
    open.open_gate();
    let specs = vec![spec("journal", true, &open, 100), spec("viewer", false, &frozen, 10)];
    let taps = Taps::spawn(ClockKind::Real, specs).unwrap();
    (0..3).for_each(|k| taps.event(Time(k), warning("x")));
    let reports = taps.finish(Time(9), Event::Ended { reason: "done".into() });
    let viewer = &reports[0];
    assert_eq!((viewer.sent, viewer.handled, viewer.queued), (4, 0, 4));
    assert!(viewer.error.as_ref().unwrap().contains("left behind"));
    assert_eq!((reports[1].error.clone(), reports[1].handled), (None, 5), "the journal has the loss");
    frozen.open_gate();
}
