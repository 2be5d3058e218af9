//! Ports that come and go leave nothing: no open file, no task, no name.

use crate::common::names;
use mobee_yarp::{
    Bottle, Carrier, Delivery, Handler, InputPort, Message, NameServer, Network, Payload, PortOptions, Queue,
};
use mobee_yarp::{OutputPort, RpcClient, RpcServer, Sender, ServerOptions, Value};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::task::yield_now;
use tokio::time::timeout;

async fn soon<T>(work: impl Future<Output = T>) -> T {
    timeout(Duration::from_secs(60), work).await.expect("it hangs")
}

/// Open files and tasks alive.
fn used() -> (usize, usize) {
    (std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count), Handle::current().metrics().num_alive_tasks())
}

struct Echo;

impl Handler for Echo {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        Box::pin(async move { Some(request.payload) })
    }
}

/// One life of every kind of port; every other time nobody says goodbye.
async fn cycle(network: &Network, round: usize) {
    let carrier = Carrier::ALL[round % 5];
    let options = PortOptions { renew: Duration::from_millis(20), ..PortOptions::default() };
    let mut reader = InputPort::open_with(network, "/in", Queue::Newest, options).await.unwrap();
    let writer = OutputPort::open(network, "/out", Delivery::Newest).await.unwrap();
    let server = RpcServer::open(network, "/rpc", Arc::new(Echo)).await.unwrap();
    reader.connect_from("/out", carrier).await.unwrap();
    let hello = Bottle(vec![Value::Int32(round as i32)]);
    writer.write(&hello, None);
    let message = soon(reader.recv()).await.unwrap();
    assert_eq!(message.payload.bottle(network.dialect()).unwrap(), hello);
    let mut client = RpcClient::connect(network, "/client", "/rpc", Carrier::Tcp).await.unwrap();
    assert_eq!(soon(client.call(&hello)).await.unwrap(), hello);
    let mut sender = Sender::connect(network, "/sender", "/in", carrier).await.unwrap();
    sender.send(&hello, None).await.unwrap();
    if round.is_multiple_of(2) {
        sender.close().await;
        client.close().await;
        soon(writer.close()).await;
        soon(server.close()).await;
        soon(reader.close()).await;
        assert!(network.query("/in").await.unwrap().is_none());
    }
}

#[tokio::test]
async fn a_hundred_lives_of_ports_leave_nothing() {
    let (mut server, network) = names().await;
    cycle(&network, 0).await;
    let before = used();
    for round in 0..100 {
        cycle(&network, round).await;
        // what was only dropped ends in the background
        soon(async {
            while network.list("/in").await.is_ok_and(|it| !it.is_empty())
                || network.list("/out").await.is_ok_and(|it| !it.is_empty())
                || network.list("/rpc").await.is_ok_and(|it| !it.is_empty())
            {
                yield_now().await;
            }
        })
        .await;
        if round % 10 == 9 {
            let address = server.address();
            server.close().await;
            server = soon(async {
                loop {
                    match NameServer::bind(address, ServerOptions::default()).await {
                        Ok(server) => return server,
                        Err(_) => yield_now().await,
                    }
                }
            })
            .await;
        }
    }
    soon(async {
        while used().0 > before.0 || used().1 > before.1 {
            yield_now().await;
        }
    })
    .await;
    server.close().await;
}
