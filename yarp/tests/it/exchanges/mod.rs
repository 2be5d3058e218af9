//! The captured exchanges of real YARPs (spec section 20), replayed with our side as either end: our ports against the
//! client's bytes, our clients and outputs against the server's bytes.

mod client;
mod script;
mod server;

use script::Exchange;
use std::time::Duration;
use tokio::time::timeout;

const PREFIXES: [&str; 10] =
    ["hs-", "text-", "msg-", "ping", "admin-", "connect-", "rpc-", "udp-session", "stream-", "persist-"];

/// Exchanges that our clients can't have, and why. As listeners we can have all of them.
const NOT_AS_CLIENT: [(&str, &str); 7] = [
    ("admin-unknown", "a vocab of five letters, which our bottles can't hold"),
    ("hs-fast-tcp", "a request that gets no answer at all, for which our clients would wait; see connect-fast-tcp"),
    ("hs-unknown", "no client of ours begins with unknown bytes"),
    ("msg-envelope", "an envelope on data with a reply allowed (d); ours go with D, see stream-*"),
    ("msg-pipelined", "our clients wait for each acknowledgement"),
    ("text-session", "an unknown key, and requests over text without any answer, which our clients would wait for"),
    ("text-ack-session", "an envelope on data with a reply allowed (d); ours go with D, see stream-*"),
];

fn exchanges() -> Vec<Exchange> {
    let all: Vec<_> =
        script::load().into_iter().filter(|it| PREFIXES.iter().any(|prefix| it.name.starts_with(prefix))).collect();
    for prefix in PREFIXES.into_iter().filter(|_| std::env::var_os("YARP_VECTORS").is_none()) {
        assert!(all.iter().any(|it| it.name.starts_with(prefix)), "no exchanges {prefix}*");
    }
    all
}

#[tokio::test]
async fn our_ports_answer_as_the_original_does() {
    let mut failed = Vec::new();
    let all = exchanges();
    for exchange in &all {
        match timeout(Duration::from_secs(20), server::replay(exchange)).await {
            Ok(Ok(())) => {}
            Ok(Err(why)) => failed.push(format!("{}: {why}", exchange.name)),
            Err(_) => failed.push(format!("{}: it hangs", exchange.name)),
        }
    }
    assert!(failed.is_empty(), "{} of {} exchanges differ:\n{}", failed.len(), all.len(), failed.join("\n"));
    println!("{} captured exchanges replayed with our ports as listeners", all.len());
}

#[tokio::test]
async fn our_clients_and_outputs_say_what_the_original_says() {
    let (mut failed, mut replayed) = (Vec::new(), 0);
    let all = exchanges();
    for (name, _) in NOT_AS_CLIENT.into_iter().filter(|_| std::env::var_os("YARP_VECTORS").is_none()) {
        assert!(
            all.iter().any(|it| it.name == name),
            "{name} is listed as not replayable, but there is no such exchange"
        );
    }
    for exchange in &all {
        if let Some((name, why)) = NOT_AS_CLIENT.iter().find(|(name, _)| *name == exchange.name) {
            println!("{name}: not as client: {why}");
            continue;
        }
        replayed += 1;
        match timeout(Duration::from_secs(20), client::replay(exchange)).await {
            Ok(Ok(())) => {}
            Ok(Err(why)) => failed.push(format!("{}: {why}", exchange.name)),
            Err(_) => failed.push(format!("{}: it hangs", exchange.name)),
        }
    }
    assert!(failed.is_empty(), "{} of {replayed} exchanges differ:\n{}", failed.len(), failed.join("\n"));
    println!("{replayed} captured exchanges replayed with our clients and outputs");
}
