//! What a brake says, and when, to a board of one joint: in virtual time.

use super::super::layout::{Layout, Patch};
use super::super::motion::End;
use super::super::remote::Later;
use super::*;
use std::sync::Mutex;

const LATENCY: f64 = 0.05;

/// What was said on the line for stops, and when, in ms; and whether the board answers.
#[derive(Clone, Default)]
struct Line {
    said: Arc<Mutex<Vec<(u64, &'static str)>>>,
    broken: Arc<Mutex<bool>>,
    cell: Option<Arc<SharedBoards>>,
}

impl StopLine for Line {
    fn send<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        let word = if matches!(request, Ask::Set(Set::Stop(_))) { "stop" } else { "question" };
        let ms = self.cell.as_ref().map_or(0.0, |cell| cell.secs(instant()) * 1e3);
        self.said.lock().unwrap().push((ms.round() as u64, word));
        let answer = if *self.broken.lock().unwrap() { reply::fail() } else { reply::ok() };
        Box::pin(async move { Ok(answer) })
    }
}

/// A board whose joint goes at a speed, deg/s, its brake, and the clock.
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
        let (port, said) = ("/arm".into(), Box::new(line.clone()));
        let brake = Brake { cell: cell.clone(), index: 0, port, line: said, halt: halts, latency: LATENCY };
        tokio::spawn(brake.work(ends));
        Rig { cell, line, halt, end, q: 0.0 }
    }

    /// For so many seconds it goes at this speed, and its states are read each 10 ms. Returns what was said meanwhile.
    async fn goes(&mut self, speed: f64, secs: f64) -> Vec<(u64, &'static str)> {
        for _ in 0..(secs * 100.0).round() as u32 {
            tokio::time::sleep(Duration::from_millis(10)).await;
            self.q += speed * 0.01;
            let now = self.cell.secs(instant());
            self.cell.lock().boards[0].motions.read(now, &[self.q]);
        }
        std::mem::take(&mut *self.line.said.lock().unwrap())
    }

    fn stops(&self, ticket: u64) {
        self.halt.send_modify(|halt| {
            let epoch = halt.epoch + 1;
            *halt = Arc::new(Halt { epoch, tickets: vec![ticket], joints: Vec::new() });
        });
    }

    /// How many stops, and how many questions, were said meanwhile.
    async fn counted(&mut self, speed: f64, secs: f64) -> (usize, usize) {
        let said = self.goes(speed, secs).await;
        let of = |word: &str| said.iter().filter(|(_, w)| *w == word).count();
        (of("stop"), of("question"))
    }
}

/// The first word on a line is a stop; then, while nothing moves, it is tried each half a second.
#[tokio::test(start_paused = true)]
async fn an_idle_line_is_tried() {
    let mut rig = Rig::new();
    assert_eq!(rig.goes(0.0, 0.1).await.first().map(|(_, word)| *word), Some("stop"));
    let said = rig.goes(0.0, 3.0).await;
    assert!(said.iter().all(|(_, word)| *word == "question") && (5..=6).contains(&said.len()), "{said:?}");
    assert!(said.windows(2).all(|w| (500..=520).contains(&(w[1].0 - w[0].0))), "{said:?}");
    rig.cell.lock().boards[0].motions.order(&[0], End::Reported);
    assert_eq!(rig.counted(0.0, 2.0).await, (0, 0), "no question is in the way of a stop");
    rig.end.send_replace(true);
    assert_eq!(rig.counted(0.0, 0.1).await, (1, 0), "the last word is a stop, too");
    assert_eq!(rig.counted(0.0, 1.0).await, (0, 0));
}

/// A stop without effect is said again when it should have had one: after 50 ms for the board, and 100 ms for the readings.
#[tokio::test(start_paused = true)]
async fn a_stop_that_shows_no_effect_is_said_again() {
    let mut rig = Rig::new();
    rig.cell.lock().boards[0].motions.order(&[0], End::Reported);
    rig.goes(20.0, 0.5).await;
    rig.stops(0);
    let begun = (rig.cell.secs(instant()) * 1e3).round() as u64;
    let said: Vec<u64> = rig.goes(20.0, 1.0).await.into_iter().map(|(ms, _)| ms - begun).collect();
    assert!(said[0] <= 10 && (6..=7).contains(&said.len()), "{said:?}");
    assert!(said.windows(2).all(|w| (150..=180).contains(&(w[1] - w[0]))), "{said:?}");
    // it slows down, and rests
    for speed in [16.0, 12.0, 8.0, 4.0] {
        rig.goes(speed, 0.17).await;
    }
    assert!(rig.goes(0.0, 0.3).await.len() <= 2);
    assert_eq!(rig.counted(0.0, 0.4).await.0, 0);
    assert_eq!(rig.counted(20.0, 1.0).await.0, 0, "what it does later is no answer to that stop");
}

/// It has its effect as soon as the board may act and the readings may show it: not a look later.
#[tokio::test(start_paused = true)]
async fn a_stop_is_given_no_longer_than_it_takes() {
    let mut rig = Rig::new();
    rig.cell.lock().boards[0].motions.order(&[0], End::Reported);
    rig.goes(20.0, 0.51).await;
    rig.stops(0);
    let said = rig.goes(20.0, 0.2).await;
    assert_eq!(said, [(510, "stop"), (660, "stop")], "50 ms for the board, 100 ms for the readings");
}

/// A board that brakes at once hears of a stop once; one that rests, as far as is known, but is not read any more, until it is.
#[tokio::test(start_paused = true)]
async fn a_stop_with_effect_is_said_once() {
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

/// Who orders something after the stop may move; who was ordered before may not.
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

/// A board whose line for stops is doubted, or which refuses one, is stopped at each look until it takes one; one that was let go is not.
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
    let on = |joints: &[usize]| Seen::Nothing(Joints::Group(joints.to_vec()));
    let mut effect = watched(Joints::All, None);
    assert_eq!(effect.seen(0.0, at(&[30.0, 0.0])), on(&[0, 1]), "nothing to compare with yet");
    assert_eq!(effect.seen(0.0, at(&[20.0, 0.0])), Seen::Slower);
    assert_eq!(effect.seen(0.0, at(&[19.9, 0.0])), on(&[0]));
    assert_eq!(effect.seen(0.0, at(&[16.0, 0.0])), on(&[0]), "so much it may slow down as its motion ends anyway");
    assert_eq!(effect.seen(0.0, at(&[10.0, 18.0])), on(&[1]), "another one sets out");
    assert_eq!(effect.seen(0.0, MeasuredSpeeds::Unknown), Seen::Nothing(Joints::All));
    assert_eq!(effect.seen(0.0, MeasuredSpeeds::Rest), Seen::Rest);
    // of a group only its own joints count, and only in the direction in which they went
    let mut effect = watched(Joints::Group(vec![0, 1]), Some(vec![20.0, 20.0, 20.0]));
    assert_eq!(effect.seen(0.0, at(&[20.0, -20.0, 20.0])), on(&[0]));
}

/// An arm that sinks after each stop looks at first like one that goes on, but slowly: it gets the time to come to rest.
#[test]
fn a_slow_joint_is_stopped_again_once_it_had_time_to_sink() {
    let speeds = Some(vec![9.0]);
    let mut effect = Effect { ticket: 1, joints: Joints::All, checked: 0.0, first: speeds.clone(), speeds, sent: 0.0 };
    let looks = (1..=20).map(|i| 0.15 * f64::from(i));
    let again: Vec<f64> = looks.filter(|at| effect.seen(*at, MeasuredSpeeds::At(vec![9.0])) != Seen::Slower).collect();
    assert_eq!(again.len(), 5, "{again:?}");
    assert!(again.windows(2).all(|w| w[1] - w[0] > 0.49), "{again:?}");
}

/// What rests is not stopped: it would sink.
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
