//! A name server for one test: just enough of the plain-text protocol (spec section 3.1).
#![allow(dead_code)]

use mobee_yarp::Network;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpListener;

/// Starts a name server and gives the network it serves.
pub async fn names() -> Network {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let network = Network::at(listener.local_addr().unwrap());
    let table: Arc<Mutex<BTreeMap<String, String>>> = Arc::default();
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            let table = table.clone();
            tokio::spawn(async move {
                let mut stream = BufReader::new(stream);
                let mut line = String::new();
                while stream.read_line(&mut line).await.is_ok_and(|n| n > 0) {
                    let words: Vec<_> = line.split_whitespace().skip_while(|w| *w != "NAME_SERVER").skip(1).collect();
                    let mut reply = match words.as_slice() {
                        ["register", name, carrier, host, port, ..] => {
                            let entry = format!("registration name {name} ip {host} port {port} type {carrier}\r\n");
                            table.lock().unwrap().insert((*name).into(), entry.clone());
                            entry
                        }
                        ["query", name] => table.lock().unwrap().get(*name).cloned().unwrap_or_default(),
                        ["unregister", name] => {
                            table.lock().unwrap().remove(*name);
                            String::new()
                        }
                        ["announce", ..] => "[ok]\r\n".into(),
                        _ => String::new(),
                    };
                    if !reply.starts_with('[') {
                        reply += "*** end of message\r\n";
                    }
                    if stream.write_all(reply.as_bytes()).await.is_err() {
                        return;
                    }
                    line.clear();
                }
            });
        }
    });
    network
}
