//! Supervision with real ractor actors that panic, are killed or end, in virtual time.

use mobee_contract::Event;
use mobee_runtime::clock::{Clock, ClockKind, runtime};
use mobee_runtime::supervision::{Child, Group, GroupMsg, Health, Intensity, Restart, Strategy};
use mobee_runtime::tap::{Collected, Taps};
use ractor::{Actor, ActorCell, ActorProcessingErr, ActorRef, call};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[derive(Debug)]
enum Msg {
    Panic,
    Stop,
    Work,
    Block,
}

/// What happened in a test, in order, and the children's present references.
#[derive(Clone, Default)]
struct World {
    lines: Arc<Mutex<Vec<String>>>,
    children: Arc<Mutex<BTreeMap<String, ActorRef<Msg>>>>,
}

impl World {
    fn log(&self, line: impl Into<String>) {
        self.lines.lock().unwrap().push(line.into());
    }
    fn take(&self) -> Vec<String> {
        std::mem::take(&mut self.lines.lock().unwrap())
    }
    fn tell(&self, name: &str, msg: Msg) {
        let to = self.children.lock().unwrap().get(name).cloned().unwrap();
        to.send_message(msg).unwrap();
    }
    fn child(&self, name: &'static str) -> Child {
        let world = self.clone();
        Child::new(name, move |supervisor| start(world.clone(), name, supervisor))
    }
}

async fn start(world: World, name: &'static str, supervisor: ActorCell) -> Result<ActorCell, String> {
    let args = (world.clone(), name);
    let (child, _) = Actor::spawn_linked(None, Worker, args, supervisor).await.map_err(|e| e.to_string())?;
    world.children.lock().unwrap().insert(name.into(), child.clone());
    Ok(child.get_cell())
}

struct Worker;

impl Actor for Worker {
    type Msg = Msg;
    type State = (World, &'static str);
    type Arguments = (World, &'static str);

    async fn pre_start(&self, _: ActorRef<Msg>, args: Self::State) -> Result<Self::State, ActorProcessingErr> {
        args.0.log(format!("+{}", args.1));
        Ok(args)
    }
    async fn handle(&self, me: ActorRef<Msg>, msg: Msg, state: &mut Self::State) -> Result<(), ActorProcessingErr> {
        match msg {
            Msg::Panic => panic!("planned"),
            Msg::Stop => me.stop(None),
            Msg::Work => state.0.log(format!("work {}", state.1)),
            Msg::Block => std::future::pending::<()>().await,
        }
        Ok(())
    }
    async fn post_stop(&self, _: ActorRef<Msg>, state: &mut Self::State) -> Result<(), ActorProcessingErr> {
        state.0.log(format!("-{}", state.1));
        Ok(())
    }
}

fn group(name: &str, strategy: Strategy, world: &World, clock: &Clock, taps: &Taps) -> Group {
    let intensity = Intensity { restarts: 2, period: Duration::from_secs(10) };
    let (a, b, c) = (world.clone(), world.clone(), world.clone());
    let own = name.to_string();
    Group::new(name, strategy, intensity, clock.clone(), taps.emitter())
        .on_death(move |name, reason| a.log(format!("death {name}: {reason}")))
        .on_restart(move |name, count| b.log(format!("again {name} {count}")))
        .on_give_up(move || c.log(format!("{own} gives up")))
}

fn three(strategy: Strategy, world: &World, clock: &Clock, taps: &Taps) -> Group {
    group("g", strategy, world, clock, taps).child(world.child("a")).child(world.child("b")).child(world.child("c"))
}

/// Runs a test in virtual time; `settle` lets everything happen that is due.
fn run<F: Future<Output = ()>>(test: impl FnOnce(World, Clock, Taps, Collected) -> F) {
    runtime(ClockKind::Virtual).unwrap().block_on(async {
        let (taps, collected) = Taps::collect();
        test(World::default(), Clock::new(ClockKind::Virtual), taps, collected).await;
    });
}

async fn settle(clock: &Clock) {
    clock.sleep(Duration::from_millis(10)).await;
}

#[test]
fn rest_for_one_tells_before_it_restarts() {
    run(|world, clock, taps, collected| async move {
        three(Strategy::RestForOne, &world, &clock, &taps).start(None).await.unwrap();
        assert_eq!(world.take(), ["+a", "+b", "+c"]);
        world.tell("b", Msg::Panic);
        settle(&clock).await;
        assert_eq!(world.take(), ["death b: planned", "-c", "+b", "again b 1", "+c", "again c 1"]);
        let events: Vec<_> = collected.events().into_iter().map(|(_, e)| (*e).clone()).collect();
        assert_eq!(
            events,
            [
                Event::Died { actor: "b".into(), reason: "planned".into() },
                Event::Restarted { actor: "b".into(), restarts: 1 },
                Event::Restarted { actor: "c".into(), restarts: 1 },
            ]
        );
    });
}

#[test]
fn a_kill_counts_as_a_failure_for_a_transient_child_but_its_end_does_not() {
    run(|world, clock, taps, _| async move {
        let g = group("g", Strategy::OneForOne, &world, &clock, &taps)
            .child(world.child("a").restart(Restart::Transient))
            .child(world.child("b").restart(Restart::Transient));
        let g = g.start(None).await.unwrap();
        assert!(call!(g, GroupMsg::Kill, "a".to_string()).unwrap());
        world.tell("b", Msg::Stop);
        settle(&clock).await;
        let log = world.take();
        let after: Vec<_> = log[2..].iter().filter(|l| *l != "-b").collect();
        assert_eq!(after, ["death a: killed", "+a", "again a 1"]);
        let alive: Vec<bool> = health(&g).await.children.iter().map(|c| c.alive).collect();
        assert_eq!(alive, [true, false]);
    });
}

async fn health(g: &ActorRef<GroupMsg>) -> Health {
    call!(g, GroupMsg::Status).unwrap()
}

#[test]
fn a_stop_is_in_reverse_order_and_loses_no_message() {
    run(|world, clock, taps, _| async move {
        let g = three(Strategy::OneForOne, &world, &clock, &taps).start(None).await.unwrap();
        world.take();
        for name in ["a", "b", "c"] {
            world.tell(name, Msg::Work);
        }
        call!(g, GroupMsg::Stop).unwrap();
        let log = world.take();
        assert_eq!(log.iter().filter(|l| l.starts_with('-')).collect::<Vec<_>>(), ["-c", "-b", "-a"]);
        assert_eq!(log.iter().filter(|l| l.starts_with("work")).count(), 3);
        g.get_cell().wait(None).await.unwrap();
    });
}

#[test]
fn a_stuck_child_is_killed_after_its_grace() {
    run(|world, clock, taps, _| async move {
        let g = three(Strategy::OneForOne, &world, &clock, &taps).start(None).await.unwrap();
        world.tell("b", Msg::Block);
        settle(&clock).await;
        let before = clock.now();
        call!(g, GroupMsg::Stop).unwrap();
        assert_eq!(clock.now().since(before).as_secs(), 1);
        assert!(world.take().contains(&"-a".to_string()));
    });
}

#[test]
fn a_used_up_budget_stops_all_and_fails_upwards() {
    run(|world, clock, taps, collected| async move {
        let inner = three(Strategy::OneForOne, &world, &clock, &taps);
        let outer =
            group("top", Strategy::OneForOne, &world, &clock, &taps).child(Child::group(inner)).child(world.child("z"));
        let top = outer.start(None).await.unwrap();
        for _ in 0..2 {
            world.tell("b", Msg::Panic);
            settle(&clock).await;
        }
        world.take();
        world.tell("b", Msg::Panic);
        settle(&clock).await;
        assert_eq!(
            world.take(),
            [
                "death b: planned",
                "-c",
                "-a",
                "g gives up",
                "death g: g used up its restarts",
                "+a",
                "+b",
                "+c",
                "again g 1"
            ]
        );
        assert!(collected.events().iter().any(|(_, e)| **e == Event::GaveUp { group: "g".into() }));
        let tree = health(&top).await;
        assert_eq!(
            tree.children.iter().map(|c| (c.name.as_str(), c.alive, c.restarts)).collect::<Vec<_>>(),
            [("g", true, 1), ("z", true, 0)]
        );
        assert_eq!(tree.children[0].children.len(), 3);
    });
}

#[test]
fn a_group_that_is_killed_or_drained_ends_its_children_in_order() {
    run(|world, clock, taps, _| async move {
        let inner = three(Strategy::OneForOne, &world, &clock, &taps);
        let top = group("top", Strategy::OneForOne, &world, &clock, &taps).child(Child::group(inner));
        let top = top.start(None).await.unwrap();
        world.take();
        assert!(call!(top, GroupMsg::Kill, "g".to_string()).unwrap());
        settle(&clock).await;
        assert_eq!(world.take(), ["-c", "-b", "-a", "death g: killed", "+a", "+b", "+c", "again g 1"]);
        assert!(call!(top, GroupMsg::Kill, "b".to_string()).unwrap());
        settle(&clock).await;
        assert_eq!(world.take(), ["death b: killed", "+b", "again b 1"]);
        call!(top, GroupMsg::Stop).unwrap();
        assert_eq!(world.take(), ["-c", "-b", "-a"]);
    });
}

#[test]
fn a_start_that_always_fails_gives_up_and_leaves_nothing_running() {
    run(|world, clock, taps, _| async move {
        let g = group("g", Strategy::OneForOne, &world, &clock, &taps)
            .child(world.child("a"))
            .child(Child::new("bad", |_| async { Err("no board".to_string()) }));
        assert!(g.start(None).await.is_err());
        let log = world.take();
        assert_eq!(log[1..], ["death bad: no board", "death bad: no board", "death bad: no board", "-a", "g gives up"]);
    });
}

/// A group begins to end while a child of it is being started again: nothing can be linked to it any more, and that is no death.
#[test]
fn a_group_that_ends_restarts_nothing() {
    run(|world, clock, taps, collected| async move {
        let (started, waits) = (world.clone(), clock.clone());
        let slow = Child::new("slow", move |supervisor| {
            let (world, clock) = (started.clone(), waits.clone());
            async move {
                clock.sleep(Duration::from_millis(5)).await;
                start(world, "slow", supervisor).await
            }
        });
        let inner = group("g", Strategy::RestForOne, &world, &clock, &taps).child(world.child("a")).child(slow);
        let top = group("top", Strategy::OneForOne, &world, &clock, &taps).child(Child::group(inner));
        let top = top.start(None).await.unwrap();
        world.take();
        assert!(call!(top, GroupMsg::Kill, "slow".to_string()).unwrap());
        clock.sleep(Duration::from_millis(1)).await;
        call!(top, GroupMsg::Stop).unwrap();
        assert_eq!(world.take(), ["death slow: killed", "+slow", "-a"]);
        let events: Vec<_> = collected.events().into_iter().map(|(_, e)| (*e).clone()).collect();
        assert_eq!(events, [Event::Died { actor: "slow".into(), reason: "killed".into() }]);
    });
}
