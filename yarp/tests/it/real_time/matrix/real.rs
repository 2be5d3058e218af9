//! The real ports, handled by us.

use super::program::{Program, Tools};
use super::{Cell, at, blame, line, until, within};
use mobee_yarp::{Bottle, Carrier, Dialect, InputPort, Network, Queue, RpcClient, remote};
use std::time::Duration;

pub async fn row(tools: &Tools, network: &Network, base: &str, carrier: Carrier) -> [Cell; 6] {
    let mut cells: [Cell; 6] = [const { None }; 6];
    let streams = streams(tools, network, base, carrier, &mut cells).await;
    blame(&mut cells, streams);
    cells[4] = Some(persistent(tools, network, base, carrier).await);
    cells[5] = match carrier {
        Carrier::Udp => None,
        _ => Some(rpc(tools, network, base, carrier).await),
    };
    cells
}

async fn streams(
    tools: &Tools,
    network: &Network,
    base: &str,
    carrier: Carrier,
    cells: &mut [Cell; 6],
) -> Result<(), String> {
    let (w, r, c) = (&format!("{base}/w"), &format!("{base}/r"), carrier.name());
    let mut writer = tools.start("yarp", &["write", w]);
    line(&mut writer, "yarp write", |l| l.contains("active")).await?;
    let mut reader = within("open", InputPort::open(network, r, Queue::Bounded(100))).await?.map_err(at("open"))?;
    let listed = network.list(base).await.map_err(at("list"))?;
    if !listed.iter().any(|contact| contact.name == *w) {
        return Err(format!("not listed: {listed:?}"));
    }
    cells[0] = Some(Ok(()));
    remote::connect(network, w, r, Some(c)).await.map_err(at("connect"))?;
    cells[1] = Some(Ok(()));
    reads(&mut writer, &mut reader, network.dialect()).await?;
    cells[2] = Some(Ok(()));
    let said = remote::ping(network, w).await.map_err(at("ping"))?.join("\n");
    if !(said.contains("output connection") && said.contains(&format!("using {c}"))) {
        return Err(format!("ping says: {said}"));
    }
    if !remote::exists(network, w).await.map_err(at("exists"))? {
        return Err("it is said not to exist".into());
    }
    cells[3] = Some(Ok(()));
    let ended = async {
        remote::disconnect(network, w, r).await.map_err(at("disconnect"))?;
        let gone = async || matches!(remote::connection(network, w, r).await, Ok(None)) && reader.peers().is_empty();
        until("disconnected", gone).await
    };
    cells[1] = Some(ended.await);
    reader.close().await;
    Ok(())
}

/// Types lines until one arrives: connections and datagrams may come too late for the first.
async fn reads(writer: &mut Program, reader: &mut InputPort, dialect: Dialect) -> Result<(), String> {
    let wanted = "hello \"two words\" 3 2.5";
    let mut beat = tokio::time::interval(Duration::from_millis(50));
    let work = async {
        loop {
            tokio::select! {
                _ = beat.tick() => writer.type_line(wanted)?,
                message = reader.recv() => {
                    let message = message.ok_or("our reader ended")?;
                    let got = message.payload.bottle(dialect).map_err(|e| e.to_string())?;
                    return if got.to_string() == wanted { Ok(()) } else { Err(format!("got {got}")) };
                }
            }
        }
    };
    within("what was written", work).await?
}

async fn persistent(tools: &Tools, network: &Network, base: &str, carrier: Carrier) -> Result<(), String> {
    let (w, r) = (&format!("{base}/pw"), &format!("{base}/pr"));
    let mut writer = tools.start("yarp", &["write", w]);
    line(&mut writer, "yarp write", |l| l.contains("active")).await?;
    let to = format!("{carrier}:/{r}");
    network.ask(&["subscribe", w, &to]).await.map_err(at("subscribe"))?;
    let mut reader = within("open", InputPort::open(network, r, Queue::Bounded(100))).await?.map_err(at("open"))?;
    reads(&mut writer, &mut reader, network.dialect()).await?;
    network.ask(&["unsubscribe", w, r]).await.map_err(at("unsubscribe"))?;
    reader.close().await;
    Ok(())
}

async fn rpc(tools: &Tools, network: &Network, base: &str, carrier: Carrier) -> Result<(), String> {
    let s = &format!("{base}/s");
    let mut server = tools.start("yarp", &["rpcserver", "--echo", s]);
    line(&mut server, "yarp rpcserver", |l| l.contains("active")).await?;
    let connect = RpcClient::connect(network, "/m/client", s, carrier);
    let mut client = within("connect", connect).await?.map_err(at("connect"))?;
    let request = Bottle::parse("[get] encs (1 2.5)", network.dialect()).map_err(at("request"))?;
    let reply = client.call(&request).await.map_err(at("call"))?;
    client.close().await;
    if reply == request { Ok(()) } else { Err(format!("the reply is {reply}")) }
}
