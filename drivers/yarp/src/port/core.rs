//! What all ports have in common: a listener, connections, administration, an orderly end.

use super::dial::Line;
use super::inbox::Inbox;
use super::slot::{Delivery, Packet, Slot};
use super::{Handler, PortError, PortOptions, dial, input, lock, output};
use crate::wire::admin::{self, Added, Answer, Peer, Removed, View};
use crate::wire::{Carrier, names};
use crate::{Bottle, Contact, Network, Text, Value};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{Notify, watch};
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::{sleep, timeout};

/// What happens with data that comes in.
pub(crate) enum Sink {
    Inbox(Arc<Inbox>),
    Handler(Arc<dyn Handler>),
    /// Acknowledged and forgotten.
    Nothing,
}

pub(crate) struct Core {
    pub name: String,
    pub contact: Contact,
    pub network: Network,
    pub options: PortOptions,
    pub sink: Sink,
    /// How outputs are served; `None`: this port has none.
    delivery: Option<Delivery>,
    state: Mutex<State>,
    pub dropped: Arc<AtomicU64>,
    closing: watch::Sender<bool>,
}

#[derive(Default)]
struct State {
    inputs: BTreeMap<u64, In>,
    outputs: Vec<Out>,
    properties: Vec<(Text, Value)>,
}

struct In {
    peer: Peer,
    end: Arc<Notify>,
}

struct Out {
    id: u64,
    peer: Peer,
    slot: Arc<Slot>,
    task: JoinHandle<()>,
}

/// Numbers for connections, unique within the process.
static NEXT: AtomicU64 = AtomicU64::new(1);

impl Core {
    /// The port as administrative commands see it.
    pub fn view(&self) -> View {
        let state = lock(&self.state);
        View {
            name: self.name.clone(),
            address: format!("tcp://{}:{}/", self.contact.host, self.contact.port),
            is_input: !matches!(self.sink, Sink::Nothing),
            is_output: self.delivery.is_some(),
            is_rpc: matches!(self.sink, Sink::Handler(_)),
            inputs: state.inputs.values().map(|input| input.peer.clone()).collect(),
            outputs: state.outputs.iter().map(|output| output.peer.clone()).collect(),
            properties: state.properties.clone(),
        }
    }

    /// Does an administrative command.
    pub async fn admin(self: &Arc<Self>, command: &Bottle) -> Bottle {
        match admin::answer(&self.view(), command) {
            Answer::Reply(reply) => reply,
            Answer::Add { given, contact } => admin::added(&self.name, &given, self.try_add(&contact).await),
            Answer::Remove(name) => admin::removed(&self.name, &name, self.remove(&name).await),
            Answer::Set(key, value) => {
                let mut state = lock(&self.state);
                state.properties.retain(|(known, _)| *known != key);
                if let Some(value) = value
                    && state.properties.len() < self.options.properties
                {
                    state.properties.push((key, value));
                }
                admin::ok()
            }
        }
    }

    pub async fn try_add(self: &Arc<Self>, contact: &Contact) -> Added {
        if self.delivery.is_none() {
            return Added::NoOutputs;
        }
        match self.add(contact).await {
            Ok(()) => Added::Yes,
            Err(PortError::Unknown(_) | PortError::Name(_)) => Added::Unknown,
            Err(error) => {
                tracing::debug!(port = self.name, %error, "no output added");
                Added::Refused
            }
        }
    }

    /// Connects an output; one to the same port is removed before.
    pub async fn add(self: &Arc<Self>, contact: &Contact) -> Result<(), PortError> {
        let delivery = self.delivery.unwrap_or(Delivery::Newest);
        let refused = |why: String| PortError::Connect { to: contact.to_string(), why };
        let carrier: Carrier = match contact.carrier.as_str() {
            "" => Carrier::Tcp,
            carrier => carrier.parse().map_err(|e: crate::wire::UnknownCarrier| refused(e.to_string()))?,
        };
        let to = dial::find(&self.network, contact).await?;
        let name = if to.name.is_empty() { format!("{}:{}", to.host, to.port) } else { to.name.clone() };
        self.remove_output(&name).await;
        let line = dial::dial(&self.network, &self.options, &to, carrier, &self.name).await?;
        let (id, slot) = (NEXT.fetch_add(1, Ordering::Relaxed), Arc::new(Slot::new(delivery, self.dropped.clone())));
        let job = output::Job { core: self.clone(), id, to: Contact { name: name.clone(), ..to }, carrier, slot };
        let peer = Peer { name, carrier };
        self.start(job, peer, line);
        Ok(())
    }

    /// Starts the task while the list is locked, so that it can't end before it is listed.
    fn start(&self, job: output::Job, peer: Peer, line: Line) {
        let mut state = lock(&self.state);
        if *self.closing.borrow() || state.outputs.len() >= self.options.connections {
            return;
        }
        let (id, slot) = (job.id, job.slot.clone());
        // Two may have connected to the same port at the same time: the later one stays.
        state.outputs.retain(|output| {
            let same = output.peer.name == peer.name;
            if same {
                output.slot.quit();
            }
            !same
        });
        let task = tokio::spawn(output::run(job, line));
        state.outputs.push(Out { id, peer, slot, task });
    }

    /// Ends the output to `name`, or else the input from there.
    pub async fn remove(&self, name: &str) -> Removed {
        if self.remove_output(name).await {
            Removed::Output
        } else if self.remove_input(name) {
            Removed::Input
        } else {
            Removed::None
        }
    }

    /// Sends what waits, quits and waits for the acknowledgement, all within limits.
    pub async fn remove_output(&self, name: &str) -> bool {
        let found = {
            let mut state = lock(&self.state);
            let at = state.outputs.iter().position(|output| output.peer.name == name);
            at.map(|at| state.outputs.remove(at))
        };
        let Some(output) = found else { return false };
        self.end(output).await;
        true
    }

    async fn end(&self, Out { slot, mut task, .. }: Out) {
        slot.quit();
        let limit = self.options.ack + self.options.write;
        if timeout(limit, &mut task).await.is_err() {
            task.abort();
        }
        slot.close();
    }

    /// Ends all inputs from `name`.
    pub fn remove_input(&self, name: &str) -> bool {
        let state = lock(&self.state);
        let mut inputs = state.inputs.values().filter(|input| input.peer.name == name).peekable();
        let found = inputs.peek().is_some();
        inputs.for_each(|input| input.end.notify_one());
        found
    }

    /// Lists an input; others of the same rooted name are ended.
    pub fn admit(self: &Arc<Self>, peer: Peer) -> Admitted {
        let (id, end) = (NEXT.fetch_add(1, Ordering::Relaxed), Arc::new(Notify::new()));
        if peer.name.starts_with('/') {
            self.remove_input(&peer.name);
        }
        lock(&self.state).inputs.insert(id, In { peer, end: end.clone() });
        Admitted { core: self.clone(), id, end }
    }

    /// Gives a packet to every output.
    pub fn publish(&self, packet: Arc<Packet>) {
        for output in &lock(&self.state).outputs {
            output.slot.put(packet.clone());
        }
    }

    /// Waits until all outputs have sent what they have.
    pub async fn drained(&self) {
        let slots: Vec<_> = lock(&self.state).outputs.iter().map(|output| output.slot.clone()).collect();
        for slot in slots {
            slot.drained().await;
        }
    }

    /// An output ended by itself.
    pub fn forget_output(&self, id: u64) {
        lock(&self.state).outputs.retain(|output| output.id != id);
    }

    /// Waits for the port's end.
    pub async fn closed(&self) {
        let _ = self.closing.subscribe().wait_for(|closing| *closing).await;
    }
}

/// An input's place in the list; gives it up when dropped.
pub(crate) struct Admitted {
    core: Arc<Core>,
    pub id: u64,
    pub end: Arc<Notify>,
}

impl Drop for Admitted {
    fn drop(&mut self) {
        lock(&self.core.state).inputs.remove(&self.id);
        if let Sink::Handler(handler) = &self.core.sink {
            handler.gone(self.id);
        }
    }
}

/// An open port. Dropping it closes it in the background.
pub(crate) struct Handle {
    pub core: Arc<Core>,
    listener: Option<JoinHandle<()>>,
}

impl Handle {
    pub async fn open(
        network: &Network,
        name: &str,
        sink: Sink,
        delivery: Option<Delivery>,
        options: PortOptions,
    ) -> Result<Handle, PortError> {
        let name = network.full_name(name);
        if !names::is_rooted(&name) && name != "..." {
            return Err(PortError::BadName(name));
        }
        let address = (network.bind(), options.number);
        let listen =
            |source| PortError::Listen { name: name.clone(), address: format!("{}:{}", address.0, address.1), source };
        let listener = TcpListener::bind(address).await.map_err(listen)?;
        let number = listener.local_addr().map_err(listen)?.port();
        let contact = network.register(&name, &network.host(), number).await?;
        let core = Arc::new(Core {
            name: contact.name.clone(),
            contact,
            network: network.clone(),
            options,
            sink,
            delivery,
            state: Mutex::default(),
            dropped: Arc::default(),
            closing: watch::Sender::new(false),
        });
        let listener = Some(tokio::spawn(listen_loop(core.clone(), listener)));
        let handle = Handle { core, listener };
        // Persistent connections are a courtesy of the name server; without them the port is open all the same.
        if let Err(error) = network.announce(&handle.core.name).await {
            tracing::debug!(port = handle.core.name, %error, "not announced");
        }
        Ok(handle)
    }

    /// Ends connections in order and unregisters.
    pub async fn close(mut self) {
        self.core.closing.send_replace(true);
        if let Some(listener) = self.listener.take() {
            let _ = listener.await;
        }
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.core.closing.send_replace(true);
    }
}

async fn listen_loop(core: Arc<Core>, listener: TcpListener) {
    let mut inputs = JoinSet::new();
    let renewal = tokio::spawn(renew(core.clone()));
    let closed = core.closed();
    tokio::pin!(closed);
    loop {
        tokio::select! {
            () = &mut closed => break,
            Some(_) = inputs.join_next() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) if inputs.len() < core.options.connections => {
                    inputs.spawn(input::serve(core.clone(), stream));
                }
                Ok((_, peer)) => tracing::debug!(port = core.name, %peer, "connection limit reached"),
                Err(error) => {
                    tracing::debug!(port = core.name, %error, "can't accept");
                    sleep(Duration::from_millis(50)).await;
                }
            }
        }
    }
    drop(listener);
    renewal.abort();
    let outputs = std::mem::take(&mut lock(&core.state).outputs);
    let mut ends = JoinSet::new();
    for output in outputs {
        let core = core.clone();
        ends.spawn(async move { core.end(output).await });
    }
    while ends.join_next().await.is_some() {}
    // Inputs end by themselves when they see the port closing.
    let _ = timeout(core.options.write, async { while inputs.join_next().await.is_some() {} }).await;
    inputs.shutdown().await;
    if let Sink::Inbox(inbox) = &core.sink {
        inbox.close();
    }
    // Who has taken the name in the meantime keeps it.
    let unregistered = match core.network.query(&core.name).await {
        Ok(Some(found)) if found.port == core.contact.port => core.network.unregister(&core.name).await,
        Ok(_) => Ok(()),
        Err(error) => Err(error),
    };
    if let Err(error) = unregistered {
        tracing::debug!(port = core.name, %error, "not unregistered");
    }
}

/// Registers the port again when a restarted name server has forgotten it. A name that meanwhile belongs to another
/// port stays with that.
async fn renew(core: Arc<Core>) {
    let mut lost = false;
    loop {
        sleep(core.options.renew).await;
        match core.network.query(&core.name).await {
            Ok(None) => {
                let (host, number) = (core.network.host(), core.contact.port);
                if core.network.register(&core.name, &host, number).await.is_ok() {
                    let _ = core.network.announce(&core.name).await;
                    tracing::info!(port = core.name, "registered again: the name server had forgotten the port");
                }
            }
            Ok(Some(found)) if found.port != core.contact.port && !lost => {
                lost = true;
                tracing::warn!(port = core.name, to = %found, "another program has taken the port's name");
            }
            Ok(Some(_)) | Err(_) => {}
        }
    }
}
