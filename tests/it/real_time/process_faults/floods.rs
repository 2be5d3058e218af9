//! Programs that send as quickly as they can (F18): they are refused, memory does not grow, and the robot stays safe.

use crate::common::{self, Network, network};
use mobee_yarp::{Bottle, Carrier, Dialect, RpcClient};
use serde_json::Value;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

async fn client(network: &Network, own: &str, port: &str) -> RpcClient {
    let yarp = mobee_yarp::Network::at(SocketAddr::from((Ipv4Addr::LOCALHOST, network.port)));
    let client = RpcClient::connect(&yarp, own, port, Carrier::Tcp).await.expect("a connection");
    client.with_timeout(Duration::from_secs(60))
}

async fn say(client: &mut RpcClient, words: &str) -> String {
    let request = Bottle::parse(words, Dialect::V3).expect("a bottle");
    client.call(&request).await.expect("an answer").to_string()
}

/// Says these in turn, so many times; how often `[ok]` was the answer.
async fn flood(mut client: RpcClient, words: [String; 2], times: usize) -> usize {
    let mut good = 0;
    for k in 0..times {
        good += usize::from(say(&mut client, &words[k % 2]).await == "[ok]");
    }
    good
}

#[tokio::test(flavor = "current_thread")]
async fn a_flood_is_refused_and_the_robot_stays_safe() {
    const HEAD: &str = "/MoBeE/icub/head/rpc:i";
    const WORLD: &str = "/MoBeE/world";
    let network = network();
    let mut run = common::Run::start(&network, "configs/behaviors/filter.toml");
    run.wait_for_port(HEAD);
    run.wait_for_port(WORLD);
    let mut head = client(&network, "/calm", HEAD).await;
    let mut world = client(&network, "/calm/world", WORLD).await;
    // far from the robot, so that the flood alone decides
    for k in 0..4 {
        say(&mut world, &format!("mk ssph 0.05 {} 3 3", k)).await;
    }
    let (_, before) = run.used();
    let mut tasks = tokio::task::JoinSet::new();
    for k in 0..4 {
        let line = client(&network, &format!("/flood{k}"), HEAD).await;
        let words = [5, -5].map(|deg| format!("[set] [pos] {k} {deg}"));
        tasks.spawn(flood(line, words, 700));
        let line = client(&network, &format!("/flood{k}/world"), WORLD).await;
        let words = [3.0, 3.1].map(|x| format!("set ssph{} {x} 3 3", k + 1));
        tasks.spawn(flood(line, words, 125));
        let line = client(&network, &format!("/flood{k}/nonsense"), HEAD).await;
        tasks.spawn(flood(line, ["[set] [pos] 99 nothing", "[set] [poss] (1 2) 3"].map(str::to_owned), 500));
    }
    let good: usize = tasks.join_all().await.into_iter().sum();
    let (_, after) = run.used();
    assert!(after < before + 60_000, "resident memory grew from {before} to {after} kB");
    assert!(good > 100, "some of it was done");
    // when it is over, a calm program is served as ever
    while !say(&mut head, "[get] [dons]").await.starts_with("[is] [dons] 1") {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    while say(&mut head, "[set] [pos] 0 -3").await != "[ok]" {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let said = run.end();
    assert!(said.contains("hold"), "{said}");
    let journal = std::fs::read_to_string(network.path().join("run/journal.jsonl")).expect("a journal");
    let lines: Vec<Value> = journal.lines().filter_map(|l| serde_json::from_str(l).ok()).collect();
    let told = |what: &str| lines.iter().filter(|l| l["event"]["event"] == what).collect::<Vec<_>>();
    let busy = told("refused").iter().filter(|l| l["event"]["refusal"]["code"] == "busy").count();
    let secs = |l: Option<&&Value>| l.and_then(|l| l["t_ns"].as_f64()).unwrap_or(0.0) * 1e-9;
    let amended = told("amended");
    let rate = amended.len() as f64 / (secs(amended.last()) - secs(amended.first())).max(1.0);
    // on a machine that is too slow for a flood there is nothing to refuse
    assert!(busy > 0 || rate < 300.0, "{busy} refused, {} taken, {rate} a second", amended.len());
}
