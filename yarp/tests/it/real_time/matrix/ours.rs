//! Our ports, handled by the real programs.

use super::program::Tools;
use super::{Cell, at, blame, line, until, within};
use mobee_yarp::{Bottle, Carrier, Delivery, Handler, Message, Network, OutputPort, Payload, RpcServer};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

/// Answers a request by itself.
struct Echo;

impl Handler for Echo {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        Box::pin(async move { Some(request.payload) })
    }
}

pub async fn row(tools: &Tools, network: &Network, base: &str, carrier: Carrier) -> [Cell; 6] {
    let mut cells: [Cell; 6] = [const { None }; 6];
    let streams = streams(tools, network, base, carrier, &mut cells).await;
    blame(&mut cells, streams);
    cells[4] = Some(persistent(tools, network, base, carrier).await);
    cells[5] = match carrier {
        // the real client says that `text` has no replies (ours takes them)
        Carrier::Udp | Carrier::Text => None,
        _ => Some(rpc(tools, network, base, carrier).await),
    };
    cells
}

/// Listing, connecting, writing, looking, disconnecting: each on what the one before it left.
async fn streams(
    tools: &Tools,
    network: &Network,
    base: &str,
    carrier: Carrier,
    cells: &mut [Cell; 6],
) -> Result<(), String> {
    let (w, r, c) = (&format!("{base}/w"), &format!("{base}/r"), carrier.name());
    let writer = within("open", OutputPort::open(network, w, Delivery::Strict(100))).await?.map_err(at("open"))?;
    let mut reader = tools.start("yarp", &["read", r]);
    line(&mut reader, "yarp read", |l| l.contains("active")).await?;
    let listed = tools.succeed(&["name", "list", base]).await?;
    if !listed.contains(&format!("registration name {w} ip 127.0.0.1")) {
        return Err(format!("not listed: {listed}"));
    }
    cells[0] = Some(Ok(()));
    tools.succeed(&["connect", w, r, c]).await?;
    cells[1] = Some(Ok(()));
    writes(&writer, &mut reader, carrier).await?;
    cells[2] = Some(Ok(()));
    let said = tools.succeed(&["ping", w]).await?;
    if !(said.contains("output connection") && said.contains(&format!("using {c}"))) {
        return Err(format!("ping says: {said}"));
    }
    tools.succeed(&["exists", w]).await?;
    cells[3] = Some(Ok(()));
    let ended = async {
        tools.succeed(&["disconnect", w, r]).await?;
        until("disconnected", async || writer.peers().is_empty()).await
    };
    cells[1] = Some(ended.await);
    writer.close().await;
    Ok(())
}

/// Writes until it is read: datagrams may come too early.
async fn writes(writer: &OutputPort, reader: &mut super::Program, carrier: Carrier) -> Result<(), String> {
    let message = Bottle::of(["hello", "two words"]).with(3).with(2.5);
    let wanted = |l: &str| l == "hello \"two words\" 3 2.5";
    if carrier != Carrier::Udp {
        writer.write(message, None);
        return line(reader, "what was written", wanted).await.map(drop);
    }
    let mut beat = tokio::time::interval(Duration::from_millis(50));
    let work = async {
        loop {
            tokio::select! {
                _ = beat.tick() => writer.write(message.clone(), None),
                found = reader.line(wanted) => return found,
            }
        }
    };
    within("what was written", work).await?.map(drop).ok_or_else(|| "the reader ended".to_string())
}

/// The name server connects our port when it appears.
async fn persistent(tools: &Tools, network: &Network, base: &str, carrier: Carrier) -> Result<(), String> {
    let (w, r) = (&format!("{base}/pw"), &format!("{base}/pr"));
    let mut reader = tools.start("yarp", &["read", r]);
    line(&mut reader, "yarp read", |l| l.contains("active")).await?;
    tools.succeed(&["connect", "--persist", w, r, carrier.name()]).await?;
    let writer = within("open", OutputPort::open(network, w, Delivery::Strict(100))).await?.map_err(at("open"))?;
    until("the name server connects", async || writer.peers().contains(r)).await?;
    writes(&writer, &mut reader, carrier).await?;
    tools.succeed(&["disconnect", "--persist", w, r]).await?;
    writer.close().await;
    Ok(())
}

/// `yarp rpc` asks our server.
async fn rpc(tools: &Tools, network: &Network, base: &str, carrier: Carrier) -> Result<(), String> {
    let s = format!("{base}/s");
    let server = within("open", RpcServer::open(network, &s, Arc::new(Echo))).await?.map_err(at("open"))?;
    let mut client = tools.start("yarp", &["rpc", &format!("{carrier}:/{s}")]);
    client.type_line("[get] encs (1 2.5)")?;
    // it prints when it ends
    client.close_input();
    line(&mut client, "the reply", |l| l.contains("Response: [get] encs (1 2.5)")).await?;
    drop(client);
    server.close().await;
    Ok(())
}
