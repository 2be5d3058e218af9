//! One connection to another port.

use super::PortOptions;
use super::core::PortCore;
use super::dial::{self, DialedConnection};
use super::link::{Link, LinkError};
use super::slot::{Packet, Slot};
use crate::wire::{Carrier, datagram, frame, line};
use crate::{Contact, Dialect, Network};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::time::timeout;

/// Parameters of an output.
pub(crate) struct Job {
    pub core: Arc<PortCore>,
    pub id: u64,
    pub to: Contact,
    pub carrier: Carrier,
    pub slot: Arc<Slot>,
}

/// Sends the packets of the slot until it has to quit or the other side is gone. After a missing
/// acknowledgment it reconnects once; a second one without success in between ends it.
pub(crate) async fn run(job: Job, mut line: DialedConnection) {
    let Job { core, to, carrier, slot, .. } = &job;
    let mut retry = true;
    let end = loop {
        match serve(core, *carrier, slot, &mut line, &mut retry).await {
            Err(LinkError::Late(..)) if retry => {
                retry = false;
                core.dropped.fetch_add(1, Ordering::Relaxed);
                let again = async {
                    let to = dial::find(&core.network, &Contact { host: String::new(), port: 0, ..to.clone() }).await?;
                    dial::dial(&core.network, &core.options, &to, *carrier, &core.name).await
                };
                match again.await {
                    Ok(again) => line = again,
                    Err(error) => break Err(error.to_string()),
                }
            }
            Err(error) => break Err(error.to_string()),
            Ok(()) => break Ok(()),
        }
    };
    match end {
        Ok(()) => {
            if let Err(error) = leave(&core.network, &core.options, &core.name, *carrier, line).await {
                tracing::debug!(port = core.name, to = to.name, %error, "no orderly end of an output");
            }
        }
        Err(error) => tracing::debug!(port = core.name, to = to.name, error, "output ended"),
    }
    slot.close();
    core.forget_output(job.id);
}

/// Sends until the slot has to quit.
async fn serve(
    core: &PortCore,
    carrier: Carrier,
    slot: &Slot,
    line: &mut DialedConnection,
    retry: &mut bool,
) -> Result<(), LinkError> {
    let dialect = core.network.dialect();
    loop {
        let packet = match line {
            DialedConnection::Stream(link) => tokio::select! {
                packet = slot.take() => packet,
                error = link.until_closed() => return Err(error),
            },
            DialedConnection::Datagrams(..) => slot.take().await,
        };
        let Some(packet) = packet else { return Ok(()) };
        if !send(line, carrier, b'D', &packet, dialect, &core.options).await? {
            core.dropped.fetch_add(1, Ordering::Relaxed);
        }
        *retry = true;
    }
}

/// Sends one message and waits for its acknowledgment; `false` if it has no form for this carrier.
pub(crate) async fn send(
    line: &mut DialedConnection,
    carrier: Carrier,
    key: u8,
    packet: &Packet,
    dialect: Dialect,
    options: &PortOptions,
) -> Result<bool, LinkError> {
    let envelope = packet.envelope.as_deref();
    match line {
        DialedConnection::Stream(link) if carrier.is_text() => {
            let Some(text) = packet.text(dialect) else { return Ok(false) };
            link.write(&[&line::encode(key, envelope, text)]).await?;
            acknowledged(link, carrier, options).await?;
        }
        DialedConnection::Stream(link) => {
            let Some(bytes) = packet.binary(dialect) else { return Ok(false) };
            link.write(&[&frame::encode(key, envelope, bytes.len()), bytes]).await?;
            acknowledged(link, carrier, options).await?;
        }
        DialedConnection::Datagrams(socket, _) => {
            let Some(bytes) = packet.binary(dialect) else { return Ok(false) };
            let message = [&frame::encode(key, envelope, bytes.len()), bytes].concat();
            for piece in datagram::split(&message) {
                // A missing listener shows as an error of a later send; it is ignored, because datagrams may
                // get lost anyway.
                let _ = timeout(options.write, socket.send(&piece)).await;
                tokio::task::yield_now().await;
            }
        }
    }
    Ok(true)
}

/// Waits for an acknowledgment, if the carrier has them.
pub(crate) async fn acknowledged(link: &mut Link, carrier: Carrier, options: &PortOptions) -> Result<(), LinkError> {
    let late = |_| LinkError::Late(options.ack, "an acknowledgement");
    match carrier {
        Carrier::Tcp => {
            let ack = link.take(|bytes| Ok::<_, LinkError>(frame::parse_ack(bytes)?.map(|used| ((), used))));
            timeout(options.ack, ack).await.map_err(late)?
        }
        Carrier::TextAck => timeout(options.ack, link.ack_line()).await.map_err(late)?,
        _ => Ok(()),
    }
}

/// Ends a connection in order.
pub(crate) async fn leave(
    network: &Network,
    options: &PortOptions,
    own_name: &str,
    carrier: Carrier,
    line: DialedConnection,
) -> Result<(), LinkError> {
    match line {
        DialedConnection::Stream(mut link) => leave_stream(&mut link, carrier, options).await,
        DialedConnection::Datagrams(_, reader) => leave_datagrams(network, options, own_name, &reader).await,
    }
}

/// Sends quit and waits for the acknowledgment.
async fn leave_stream(link: &mut Link, carrier: Carrier, options: &PortOptions) -> Result<(), LinkError> {
    let quit = if carrier.is_text() { b"q\r\n".to_vec() } else { frame::quit() };
    link.write(&[&quit]).await?;
    acknowledged(link, carrier, options).await?;
    link.shutdown().await;
    Ok(())
}

/// Notifies a reader of datagrams out of band that no more will follow.
async fn leave_datagrams(
    network: &Network,
    options: &PortOptions,
    own_name: &str,
    reader: &Contact,
) -> Result<(), LinkError> {
    let stream = network.connect_tcp(&reader.host, reader.port).await?;
    let mut link = Link::new(stream, options);
    link.write(&[format!("CONNECT admin\r\n~{own_name}\r\nq\r\n").as_bytes()]).await?;
    let _ = timeout(options.ack, link.until_closed()).await;
    Ok(())
}
