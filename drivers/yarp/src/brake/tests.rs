//! Messages of a brake to a board of one joint, with their times. Runs in virtual time.

use super::super::layout::{Layout, Patch};
use super::super::motion::End;
use super::super::remote::Later;
use super::*;
use std::sync::Mutex;

const LATENCY: f64 = 0.05;

/// Messages received on the stop connection, each with its time, ms, and whether the board answers.
#[derive(Clone, Default)]
struct Line {
    received: Arc<Mutex<Vec<(u64, &'static str)>>>,
    broken: Arc<Mutex<bool>>,
    cell: Option<Arc<SharedBoards>>,
}

impl StopLine for Line {
    fn send<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        let word = if matches!(request, Ask::Set(Set::Stop(_))) { "stop" } else { "question" };
        let ms = self.cell.as_ref().map_or(0.0, |cell| cell.secs(instant()) * 1e3);
        self.received.lock().unwrap().push((ms.round() as u64, word));
        let answer = if *self.broken.lock().unwrap() { reply::fail() } else { reply::ok() };
        Box::pin(async move { Ok(answer) })
    }
}

/// A board with one moving joint, its brake, and the clock.
struct Rig {
    cell: Arc<SharedBoards>,
    line: Line,
    halt: watch::Sender<Arc<Halt>>,
    end: watch::Sender<bool>,
    q: f64,
}

impl Rig {
    fn new() -> Rig {
        let patch = Patch { part: "arm".into(), port: "/arm".into(), motors: 0..1, units: Default::default() };
        let layout = Layout {
            patches: vec![patch],
            home: vec![0.0],
            names: vec!["m".into()],
            limits: vec![(-1.0, 1.0)],
            speeds: Vec::new(),
            motions: Vec::new(),
        };
        let cell = Arc::new(SharedBoards::new(&layout));
        cell.take();
        cell.lock().boards[0].reached = true;
        let line = Line { cell: Some(cell.clone()), ..Line::default() };
        let (halt, halts) = watch::channel(Arc::new(Halt::default()));
        let (end, ends) = watch::channel(false);
        let (port, stop_line) = ("/arm".into(), Box::new(line.clone()));
        let brake = Brake { cell: cell.clone(), index: 0, port, line: stop_line, halt: halts, latency: LATENCY };
        tokio::spawn(brake.work(ends));
        Rig { cell, line, halt, end, q: 0.0 }
    }

    /// Moves the joint at this speed, deg/s, for this time, s, with a state every 10 ms. Returns the messages
    /// received meanwhile.
    async fn goes(&mut self, speed: f64, secs: f64) -> Vec<(u64, &'static str)> {
        for _ in 0..(secs * 100.0).round() as u32 {
            tokio::time::sleep(Duration::from_millis(10)).await;
            self.q += speed * 0.01;
            let now = self.cell.secs(instant());
            self.cell.lock().boards[0].motions.read(now, &[self.q]);
        }
        std::mem::take(&mut *self.line.received.lock().unwrap())
    }

    fn stops(&self, ticket: u64) {
        self.halt.send_modify(|halt| {
            let epoch = halt.epoch + 1;
            *halt = Arc::new(Halt { epoch, tickets: vec![ticket], joints: Vec::new() });
        });
    }

    /// Number of stops and of queries received meanwhile.
    async fn counted(&mut self, speed: f64, secs: f64) -> (usize, usize) {
        let received = self.goes(speed, secs).await;
        let of = |word: &str| received.iter().filter(|(_, w)| *w == word).count();
        (of("stop"), of("question"))
    }
}

/// The first message on a connection is a stop; after that, while the board rests, the connection is tested
/// every 0.5 s.
#[tokio::test(start_paused = true)]
async fn an_idle_line_is_tried() {
    let mut rig = Rig::new();
    assert_eq!(rig.goes(0.0, 0.1).await.first().map(|(_, word)| *word), Some("stop"));
    let received = rig.goes(0.0, 3.0).await;
    assert!(received.iter().all(|(_, word)| *word == "question") && (5..=6).contains(&received.len()), "{received:?}");
    assert!(received.windows(2).all(|w| (500..=520).contains(&(w[1].0 - w[0].0))), "{received:?}");
    rig.cell.lock().boards[0].motions.order(&[0], End::Reported);
    assert_eq!(rig.counted(0.0, 2.0).await, (0, 0), "no question is in the way of a stop");
    rig.end.send_replace(true);
    assert_eq!(rig.counted(0.0, 0.1).await, (1, 0), "the last word is a stop, too");
    assert_eq!(rig.counted(0.0, 1.0).await, (0, 0));
}

/// A stop without effect is repeated once an effect should have been visible: after 50 ms for the board and 100
/// ms for the readings.
#[tokio::test(start_paused = true)]
async fn a_stop_without_visible_effect_is_repeated() {
    let mut rig = Rig::new();
    rig.cell.lock().boards[0].motions.order(&[0], End::Reported);
    rig.goes(20.0, 0.5).await;
    rig.stops(0);
    let begun = (rig.cell.secs(instant()) * 1e3).round() as u64;
    let received: Vec<u64> = rig.goes(20.0, 1.0).await.into_iter().map(|(ms, _)| ms - begun).collect();
    assert!(received[0] <= 10 && (6..=7).contains(&received.len()), "{received:?}");
    assert!(received.windows(2).all(|w| (150..=180).contains(&(w[1] - w[0]))), "{received:?}");
    // the joint decelerates and comes to rest
    for speed in [16.0, 12.0, 8.0, 4.0] {
        rig.goes(speed, 0.17).await;
    }
    assert!(rig.goes(0.0, 0.3).await.len() <= 2);
    assert_eq!(rig.counted(0.0, 0.4).await.0, 0);
    assert_eq!(rig.counted(20.0, 1.0).await.0, 0, "what it does later is no answer to that stop");
}

/// The effect is checked as soon as the board may act and the readings may show it, without waiting for another
/// check.
#[tokio::test(start_paused = true)]
async fn a_stop_is_given_no_longer_than_it_takes() {
    let mut rig = Rig::new();
    rig.cell.lock().boards[0].motions.order(&[0], End::Reported);
    rig.goes(20.0, 0.51).await;
    rig.stops(0);
    let received = rig.goes(20.0, 0.2).await;
    assert_eq!(received, [(510, "stop"), (660, "stop")], "50 ms for the board, 100 ms for the readings");
}

/// A board that brakes at once gets a single stop. A board that rests as far as is known, but whose states are
/// missing, gets stops until it is read again.
#[tokio::test(start_paused = true)]
async fn a_stop_with_effect_is_sent_once() {
    let mut rig = Rig::new();
    rig.goes(20.0, 0.5).await;
    rig.stops(0);
    let mut stops = 0;
    for speed in [14.0, 10.0, 6.0, 3.0, 0.0, 0.0] {
        stops += rig.counted(speed, 0.15).await.0;
    }
    assert_eq!(stops, 1);
    rig.stops(0);
    tokio::time::sleep(Duration::from_secs(1)).await;
    assert!(rig.counted(0.0, 0.0).await.0 >= 6, "without readings nobody knows");
    assert!(rig.counted(0.0, 0.3).await.0 <= 1);
    assert_eq!(rig.counted(0.0, 0.5).await.0, 0);
}

/// Orders after the stop may move the joints; orders before it may not.
#[tokio::test(start_paused = true)]
async fn orders_after_a_stop_are_let_alone() {
    for (moved, stops) in [(3, true), (4, false)] {
        let mut rig = Rig::new();
        rig.goes(20.0, 0.5).await;
        rig.stops(3);
        rig.goes(20.0, 0.05).await;
        rig.cell.lock().boards[0].moved = moved;
        assert_eq!(rig.counted(20.0, 1.0).await.0 > 3, stops, "ticket {moved} after a stop of ticket 3");
    }
}

/// A board whose stop connection is in doubt, or that refuses a stop, is stopped at each check until it
/// confirms a stop. A board that is no longer ours is not.
#[tokio::test(start_paused = true)]
async fn a_doubted_line_shows_that_it_is_good() {
    let mut rig = Rig::new();
    rig.goes(0.0, 0.1).await;
    let trouble = |rig: &Rig| rig.cell.lock().boards[0].brake.clone();
    assert_eq!(trouble(&rig), None);
    rig.cell.lock().boards[0].brake = Some("reached anew".into());
    assert_eq!(rig.counted(0.0, 0.2).await.0, 1);
    assert_eq!(trouble(&rig), None);
    *rig.line.broken.lock().unwrap() = true;
    rig.stops(0);
    assert_eq!(rig.counted(0.0, 0.2).await, (11, 0), "at once, and at ten looks");
    assert!(trouble(&rig).is_some_and(|why| why.contains("fail")));
    *rig.line.broken.lock().unwrap() = false;
    assert_eq!(rig.counted(0.0, 0.2).await.0, 1);
    assert_eq!(trouble(&rig), None);
    rig.cell.let_go();
    rig.stops(0);
    assert_eq!(rig.counted(20.0, 0.5).await, (0, 0), "another drives it now");
}

#[test]
fn a_joint_that_slows_down_obeys_and_one_that_goes_on_does_not() {
    let watched = |joints: Joints, first: Option<Vec<f64>>| Effect {
        ticket: 1,
        joints,
        checked: 0.0,
        speeds: first.clone(),
        first,
        sent: 0.0,
    };
    let at = |speeds: &[f64]| MeasuredSpeeds::At(speeds.to_vec());
    let on = |joints: &[usize]| BrakeObservation::Nothing(Joints::Group(joints.to_vec()));
    let mut effect = watched(Joints::All, None);
    assert_eq!(effect.seen(0.0, at(&[30.0, 0.0])), on(&[0, 1]), "nothing to compare with yet");
    assert_eq!(effect.seen(0.0, at(&[20.0, 0.0])), BrakeObservation::Slower);
    assert_eq!(effect.seen(0.0, at(&[19.9, 0.0])), on(&[0]));
    assert_eq!(effect.seen(0.0, at(&[16.0, 0.0])), on(&[0]), "so much it may slow down as its motion ends anyway");
    assert_eq!(effect.seen(0.0, at(&[10.0, 18.0])), on(&[1]), "another one sets out");
    assert_eq!(effect.seen(0.0, MeasuredSpeeds::Unknown), BrakeObservation::Nothing(Joints::All));
    assert_eq!(effect.seen(0.0, MeasuredSpeeds::Rest), BrakeObservation::Rest);
    // only the joints of the group count, and only if they move in the same direction as before
    let mut effect = watched(Joints::Group(vec![0, 1]), Some(vec![20.0, 20.0, 20.0]));
    assert_eq!(effect.seen(0.0, at(&[20.0, -20.0, 20.0])), on(&[0]));
}

/// An arm that sinks after each stop first looks like a slow continuation of its motion, and gets the time to
/// settle.
#[test]
fn a_slow_joint_is_stopped_again_once_it_had_time_to_sink() {
    let speeds = Some(vec![9.0]);
    let mut effect = Effect { ticket: 1, joints: Joints::All, checked: 0.0, first: speeds.clone(), speeds, sent: 0.0 };
    let looks = (1..=20).map(|i| 0.15 * f64::from(i));
    let again: Vec<f64> =
        looks.filter(|at| effect.seen(*at, MeasuredSpeeds::At(vec![9.0])) != BrakeObservation::Slower).collect();
    assert_eq!(again.len(), 5, "{again:?}");
    assert!(again.windows(2).all(|w| w[1] - w[0] > 0.49), "{again:?}");
}

/// Joints at rest are not stopped, because an arm would sink.
#[tokio::test(start_paused = true)]
async fn a_halt_that_names_no_joint_is_no_stop() {
    let mut rig = Rig::new();
    rig.goes(0.0, 0.5).await;
    let joints = rig.cell.lock().boards[0].motions.to_stop(rig.cell.secs(instant()));
    assert_eq!(joints, Some(vec![]));
    rig.halt.send_modify(|halt| {
        *halt = Arc::new(Halt { epoch: 1, tickets: vec![0], joints: vec![joints] });
    });
    assert_eq!(rig.counted(0.0, 1.0).await.0, 0);
    rig.goes(20.0, 0.3).await;
    assert_eq!(rig.cell.lock().boards[0].motions.to_stop(rig.cell.secs(instant())), Some(vec![0]));
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert_eq!(rig.cell.lock().boards[0].motions.to_stop(rig.cell.secs(instant())), None, "it is not read any more");
}
