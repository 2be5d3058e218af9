//! Stops by the lease watch, and the consequences when a task or a thread ends. Runs in virtual time.

use super::super::cell::instant;
use super::super::crew::poison;
use super::super::questions::Questions;
use super::super::remote::{Later, Remote, StopLine};
use super::*;
use mobee_yarp::board::{Ask, AxisFacts, LinkState, RemoteState, Streamed, reply};
use mobee_yarp::{Bottle, CallError};

/// Time limit of the driver for an answer.
const TIMEOUT: Duration = Duration::from_millis(300);

/// A connection to boards that answer everything or nothing.
struct FakeWire {
    answers: bool,
}

struct FakeBoard {
    answers: bool,
    link: watch::Sender<LinkState>,
    facts: watch::Sender<Option<Arc<[AxisFacts]>>>,
    state: watch::Sender<Option<Arc<RemoteState>>>,
}

async fn answer(answers: bool) -> Result<Bottle, CallError> {
    if !answers {
        std::future::pending::<()>().await;
    }
    Ok(reply::ok())
}

impl Wire for FakeWire {
    fn board(&self, _patch: &Patch, _options: RemoteOptions) -> Option<Arc<dyn Remote>> {
        let link = watch::Sender::new(LinkState::Up(1));
        let (facts, state) = (watch::Sender::new(None), watch::Sender::new(None));
        Some(Arc::new(FakeBoard { answers: self.answers, link, facts, state }))
    }
    fn stop_line(&self, _patch: &Patch, _own: &str, _timeout: Duration) -> Option<Box<dyn StopLine>> {
        Some(Box::new(FakeWire { answers: self.answers }))
    }
    fn questions(&self, _patch: &Patch, _local: &str, _timeout: Duration) -> Option<Questions> {
        None
    }
}

impl StopLine for FakeWire {
    fn send<'a>(&'a mut self, _request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        Box::pin(answer(self.answers))
    }
}

impl Remote for FakeBoard {
    fn port(&self) -> &str {
        "/arm"
    }
    fn link(&self) -> watch::Receiver<LinkState> {
        self.link.subscribe()
    }
    fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>> {
        self.facts.subscribe()
    }
    fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>> {
        self.state.subscribe()
    }
    fn lost(&self) -> u64 {
        0
    }
    fn ask<'a>(&'a self, _request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        Box::pin(answer(self.answers))
    }
    fn stream(&self, _command: Streamed) -> bool {
        true
    }
    fn hush(&self) {}
    fn died(&self) -> Later<'_, ()> {
        Box::pin(std::future::pending())
    }
    fn close(&self) -> Later<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}

/// Starts both threads, as tasks, for a robot of this name whose only board has the same name.
fn started(robot: &str, answers: bool) -> super::super::Started {
    let port = format!("/{robot}");
    let settings = YarpDriverSettings { timeout_ms: 300.0, ..YarpDriverSettings::of([("arm", port.as_str())]) };
    let patch = Patch { part: "arm".into(), port, motors: 0..1, units: Default::default() };
    let (names, limits) = (vec!["m".into()], vec![(-1.0, 1.0)]);
    let layout = Arc::new(Layout {
        patches: vec![patch],
        home: vec![0.0],
        names,
        limits,
        speeds: Vec::new(),
        motions: Vec::new(),
    });
    let cell = Arc::new(SharedBoards::new(&layout));
    cell.take();
    start((Arc::new(FakeWire { answers }), ThreadPlacement::Here), &settings, robot, layout, cell).unwrap()
}

async fn after(ms: u64) {
    tokio::time::sleep(Duration::from_millis(ms)).await;
}

/// Trouble of the only board, and of its stop connection.
fn trouble(reach: &Reach) -> (Option<Trouble>, Option<String>) {
    let inner = reach.cell.lock();
    (inner.boards[0].trouble.clone(), inner.boards[0].brake.clone())
}

fn halts(reach: &Reach) -> u64 {
    reach.halt.newest().epoch
}

/// At the end, the threads wait until the settings are restored, but no longer than that may take, plus three
/// answers.
#[tokio::test(start_paused = true)]
async fn threads_end_though_a_board_does_not_answer() {
    for (answers, most) in [(true, 0.1), (false, (ENDING + 3 * TIMEOUT).as_secs_f64())] {
        let mut running = started("ending", answers);
        after(100).await;
        assert!(!running.thread.is_broken());
        let threads = std::mem::take(&mut running.thread.threads);
        let begun = instant();
        running.thread.leave();
        for thread in threads {
            let Thread::Here(task) = thread else { panic!("a thread in virtual time") };
            task.await.unwrap();
        }
        let took = begun.elapsed().as_secs_f64();
        assert!((most - 0.1..most + 0.01).contains(&took), "{answers}: {took}");
        assert_eq!(halts(&running.reach), 0, "who ends in order has not died");
    }
}

/// Threads end on request, and no subscriber remains.
#[tokio::test(start_paused = true)]
async fn threads_end_on_request() {
    let running = started("told", true);
    after(100).await;
    assert_eq!(running.reach.lease.receiver_count(), 2, "the hand, and who watches the lease");
    running.thread.end();
    after(50).await;
    assert_eq!((running.reach.lease.receiver_count(), halts(&running.reach)), (0, 0));
}

/// The end of a task stops the boards, which are not available before all tasks of its thread have been
/// restarted.
#[tokio::test(start_paused = true)]
async fn the_end_of_a_task_stops_the_boards() {
    let all = [
        ("hand at /mortal", false),
        ("reader of /mortal", false),
        ("connection to /mortal", false),
        ("brake of /mortal", true),
        ("watch over the lease of /MoBeE/mortal/driver", true),
    ];
    let running = started("mortal", true);
    let reach = &running.reach;
    for (who, is_a_brake) in all {
        after(300).await;
        assert_eq!(trouble(reach), (None, None), "all are there");
        let was = halts(reach);
        poison::kill(who);
        after(10).await;
        assert_eq!(halts(reach), was + 1, "{who}");
        let told = format!("/mortal: {who} panicked");
        let expected = if is_a_brake { (None, Some(told)) } else { (Some(Trouble::Lost(told)), None) };
        assert_eq!(trouble(reach), expected);
        after(150).await;
        assert_eq!(trouble(reach), expected, "it is not back yet");
        assert!(!running.thread.is_broken());
    }
    after(300).await;
    assert_eq!(trouble(reach), (None, None));
    // a board that another program drives is left alone
    let taken = Some(Trouble::Forbidden("taken".into()));
    reach.cell.lock().boards[0].trouble = taken.clone();
    poison::kill("hand at /mortal");
    after(10).await;
    assert_eq!(trouble(reach).0, taken);
}

/// The end of a whole thread stops the boards, too, and the next connection attempt detects it.
#[tokio::test(start_paused = true)]
async fn the_end_of_a_thread_stops_the_boards() {
    for name in ["yarp fatal", "yarp stop fatal"] {
        let running = started("fatal", true);
        after(300).await;
        assert!(trouble(&running.reach) == (None, None) && !running.thread.is_broken());
        poison::kill(&format!("thread {name}"));
        after(1).await;
        assert!(halts(&running.reach) > 0 && running.thread.is_broken(), "{name}");
        let ended = format!("/fatal: thread `{name}` ended");
        assert_eq!(trouble(&running.reach).0, Some(Trouble::Lost(ended)));
        running.thread.leave();
        after(100).await;
    }
}

/// The end of a lease that is not renewed stops everything, once.
#[tokio::test(start_paused = true)]
async fn the_end_of_a_lease_stops_everything() {
    let running = started("leased", true);
    let reach = &running.reach;
    let lease = |ms: u64| reach.lease.send_replace(Some(instant() + Duration::from_millis(ms)));
    after(100).await;
    lease(0);
    after(100).await;
    assert_eq!(halts(reach), 0, "what is over when it is given changes nothing");
    for _ in 0..10 {
        lease(100);
        after(50).await;
    }
    after(45).await;
    assert_eq!(halts(reach), 0);
    after(10).await;
    assert_eq!(halts(reach), 1);
    after(1000).await;
    assert_eq!(halts(reach), 1, "once");
    lease(500);
    after(10).await;
    reach.lease.send_replace(None);
    after(5).await;
    assert_eq!(halts(reach), 2, "it was given up");
    // the next lease watch does not know whether the previous one has seen the end
    lease(100);
    after(10).await;
    poison::kill("watch over the lease of /MoBeE/leased/driver");
    after(150).await;
    assert_eq!(halts(reach), 3, "for the watch");
    after(200).await;
    assert_eq!(halts(reach), 4, "for the lease");
}
