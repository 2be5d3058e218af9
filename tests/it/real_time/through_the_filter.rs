//! A program that speaks nothing but YARP moves the simulated iCub through the port filter, over real sockets: it reaches,
//! runs into the ball, hears `[fail]`, waits, and goes on another way; and the world answers beside it.

use crate::common::{HOLD, Network, Run, network};
use mobee_yarp::board::{Joints, RemoteBoard, RemoteOptions, Streamed};
use mobee_yarp::{Bottle, Carrier, Dialect, RpcClient};
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

const RIGHT: &str = "(-20 75 0 60 10 -15 5)";
const LEFT: &str = "(-45 35 35 95 15 -25 -5)";
const BELOW: &str = "(0 55 10 60 20 -10 -5)";

/// A line typed at an RPC port.
struct Line(RpcClient);

impl Line {
    async fn to(network: &Network, own: &str, port: &str) -> Line {
        let yarp = mobee_yarp::Network::at(SocketAddr::from((Ipv4Addr::LOCALHOST, network.port)));
        let client = RpcClient::connect(&yarp, own, port, Carrier::Tcp).await.expect("a connection");
        Line(client.with_timeout(Duration::from_secs(30)))
    }

    async fn say(&mut self, text: &str) -> String {
        let request = Bottle::parse(text, Dialect::V3).expect("a bottle");
        self.0.call(&request).await.expect("an answer").to_string()
    }

    /// Polls as old programs do, until the motion is done or failed.
    async fn wait(&mut self) -> bool {
        loop {
            let said = self.say("[get] [dons]").await;
            if said.starts_with("[fail]") {
                return false;
            }
            if said.starts_with("[is] [dons] 1") {
                return true;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Waits until the filter is open again.
    async fn open(&mut self) {
        while self.say("[get] [axes]").await.starts_with("[fail]") {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    async fn go(&mut self, pose: &str) -> bool {
        assert_eq!(self.say(&format!("[set] [posg] 7 (0 1 2 3 4 5 6) {pose}")).await, "[ok]", "{pose}");
        self.wait().await
    }

    async fn arm(&mut self) -> Vec<f64> {
        let reply = Bottle::parse(&self.say("[get] [encs]").await, Dialect::V3).expect("a bottle");
        let list = reply.get(2).and_then(|v| v.as_list()).expect("encoders");
        list.numbers().expect("numbers").into_iter().take(7).collect()
    }
}

fn numbers(pose: &str) -> Vec<f64> {
    pose.trim_matches(['(', ')']).split(' ').map(|n| n.parse().expect("a number")).collect()
}

fn near(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1.0)
}

#[tokio::test(flavor = "current_thread")]
async fn a_program_collides_is_refused_waits_and_goes_on() {
    let network = network();
    let mut run = Run::start(&network, "configs/behaviors/filter.toml");
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    let mut arm = Line::to(&network, "/test/rpc:o", "/MoBeE/icub/right_arm/rpc:i").await;
    let mut watcher = Line::to(&network, "/watcher/rpc:o", "/MoBeE/icub/right_arm/rpc:i").await;
    let mut sleeper = Line::to(&network, "/sleeper/rpc:o", "/MoBeE/icub/right_arm/rpc:i").await;
    arm.open().await;
    assert_eq!(arm.say("[get] [prot]").await, "[prot] 1 9 0 [ok]");
    assert_eq!(arm.say("[set] [velg] 7 (0 1 2 3 4 5 6) (20 20 20 20 20 20 20)").await, "[ok]");
    assert!(arm.go(RIGHT).await, "the way to the right of the ball is free");
    assert!(near(&arm.arm().await, &numbers(RIGHT)));

    // two programs move the arm in one transaction; one of them polls, the other comes back when all is over
    assert_eq!(sleeper.say(&format!("[set] [posg] 7 (0 1 2 3 4 5 6) {LEFT}")).await, "[ok]");
    assert!(!arm.go(LEFT).await, "the straight way leads through the ball");
    watcher.open().await;
    assert!(near(&watcher.arm().await, &numbers(RIGHT)), "the arm is back where the motion began");
    let told = sleeper.say("[get] [dons]").await;
    assert!(told.starts_with("[fail] \"rolled back: "), "a slow poller learns that the motion failed, and why: {told}");
    assert!(sleeper.say("[get] [dons]").await.starts_with("[is] [dons] 1"), "once");
    assert!(arm.say("[get] [dons]").await.starts_with("[is] [dons] 1"), "and who has heard it hears it no more");

    assert!(arm.go(BELOW).await);
    assert!(arm.go(LEFT).await, "around the ball");
    assert!(near(&arm.arm().await, &numbers(LEFT)));
    assert_eq!(arm.say("[set] [pos] 0 500").await, "[fail]", "beyond a limit");
    assert_eq!(arm.say("[set] [llim] 0 -500 500").await, "[fail]", "not to be reconfigured");

    let mut world = Line::to(&network, "/typist", "/MoBeE/world").await;
    assert_eq!(world.say("ls").await, "table ball block");
    assert_eq!(world.say("mk sph 0.05 -1 -1 1").await, "sph1");
    assert_eq!(world.say("set sph 1 -1 -1 2").await, "\"Object sph1 found.\" \"Set Cartesian position of object.\"");
    assert_eq!(world.say("undo").await, "\"Undone: changing sph1.\"");
    assert_eq!(world.say("rm sph1").await, "\"Object sph1 found.\" \"Removed object\"");
    let mut part = Line::to(&network, "/typist2", "/MoBeE/right_arm/rpc").await;
    assert_eq!(part.say("getn").await, "16");
    let mut robot = Line::to(&network, "/typist3", "/MoBeE/icub/rpc").await;
    assert_eq!(robot.say("status").await, "rest");

    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    let summary = run.summary();
    assert_eq!(summary["counters"]["rolled_back"], 1, "{summary}");
}

/// Streams set-points by `next` until the elbow has passed `until` degrees, then waits for the transaction's end.
async fn stream(arm: &mut Line, board: &RemoteBoard, until: f64, next: impl Fn(f64) -> Streamed) {
    loop {
        let elbow = arm.arm().await.get(3).copied().expect("an elbow");
        if elbow > until {
            break;
        }
        assert!(board.stream(next(elbow)), "the command goes out");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    board.hush();
    assert!(arm.wait().await, "the stream ends where the arm rests");
}

#[tokio::test(flavor = "current_thread")]
async fn streams_are_transactions_and_what_is_grabbed_follows_the_hand() {
    let network = network();
    let mut run = Run::start(&network, "configs/behaviors/filter.toml");
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    run.wait_for_port("/MoBeE/world");
    let mut arm = Line::to(&network, "/test/rpc:o", "/MoBeE/icub/right_arm/rpc:i").await;
    let mut world = Line::to(&network, "/typist", "/MoBeE/world").await;
    let yarp = mobee_yarp::Network::at(SocketAddr::from((Ipv4Addr::LOCALHOST, network.port)));
    let second = Duration::from_secs(1);
    let options =
        RemoteOptions { local: "/streamer".into(), carrier: Carrier::FastTcp, timeout: 10 * second, stale: second };
    let board = RemoteBoard::new(&yarp, "/MoBeE/icub/right_arm", options);
    board.facts().wait_for(Option::is_some).await.expect("the board answers");
    arm.open().await;

    assert_eq!(world.say("mk sph 0.02 -1 -1 1").await, "sph1");
    world.say("def sph1 gho").await;
    let grabbed = "\"Object sph1 found.\" \"Robot found.\" \"Marker found, grabbing object.\"";
    assert_eq!(world.say("grab sph1 icub r_hand").await, grabbed);
    let before = world.say("get sph1").await;

    let elbow = arm.arm().await.get(3).copied().expect("an elbow");
    assert_eq!(arm.say("[set] [icmd] [cmod] 3 [vel]").await, "[ok]");
    stream(&mut arm, &board, elbow + 3.0, |_| Streamed::Velocity(Joints::One(3), vec![5.0])).await;
    assert_eq!(arm.say("[set] [icmd] [cmod] 3 [posd]").await, "[ok]");
    stream(&mut arm, &board, elbow + 6.0, |q| Streamed::Direct(Joints::One(3), vec![q + 0.5])).await;
    assert_ne!(world.say("get sph1").await, before, "the sphere went with the hand");

    let journal = run.end();
    assert!(journal.contains(" hold") && !journal.contains("broken"), "{journal}");
    let counters = &run.summary()["counters"];
    assert_eq!((&counters["committed"], &counters["rolled_back"]), (&2.into(), &0.into()), "{counters}");
}

/// Gaze streams all day and never pauses. When an arm runs into something the head goes back with it, and then on: it had no part in
/// that.
#[tokio::test(flavor = "current_thread")]
async fn a_stream_goes_on_after_what_another_program_ran_into() {
    let network = network();
    let mut run = Run::start(&network, "configs/behaviors/filter.toml");
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    run.wait_for_port("/MoBeE/icub/head/command:i");
    let mut arm = Line::to(&network, "/test/rpc:o", "/MoBeE/icub/right_arm/rpc:i").await;
    let mut watcher = Line::to(&network, "/watcher/rpc:o", "/MoBeE/icub/head/rpc:i").await;
    arm.open().await;
    assert_eq!(arm.say("[set] [velg] 7 (0 1 2 3 4 5 6) (20 20 20 20 20 20 20)").await, "[ok]");
    assert!(arm.go(RIGHT).await, "the way to the right of the ball is free");
    let yarp = mobee_yarp::Network::at(SocketAddr::from((Ipv4Addr::LOCALHOST, network.port)));
    let options = RemoteOptions {
        local: "/gaze".into(),
        carrier: Carrier::FastTcp,
        timeout: Duration::from_secs(10),
        stale: Duration::from_secs(1),
    };
    let gaze = RemoteBoard::new(&yarp, "/MoBeE/icub/head", options);
    gaze.facts().wait_for(Option::is_some).await.expect("the board answers");
    let looking = tokio::spawn(async move {
        for k in 0.. {
            let speed = if k / 50 % 2 == 0 { 4.0 } else { -4.0 };
            gaze.stream(Streamed::Velocity(Joints::One(2), vec![speed]));
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    });
    // the watcher never commands anything: it is told of no failure
    let moves = async |watcher: &mut Line| {
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for _ in 0..60 {
            let yaw = watcher.arm().await.get(2).copied().expect("a neck");
            (least, most) = (least.min(yaw), most.max(yaw));
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        most - least > 1.0
    };
    assert!(moves(&mut watcher).await, "it looks around");
    assert!(!arm.go(LEFT).await, "the straight way leads through the ball");
    watcher.open().await;
    assert!(moves(&mut watcher).await, "it looks around again");
    looking.abort();
    tokio::time::sleep(Duration::from_secs(1)).await;
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    assert_eq!(run.summary()["counters"]["rolled_back"], 1);
}
