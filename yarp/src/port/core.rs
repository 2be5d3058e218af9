//! Common state of all ports: lists of connections, and the effects of administrative commands.

use super::dial::DialedConnection;
use super::inbox::Inbox;
use super::slot::{Delivery, Packet, Slot};
use super::{Handler, PortError, PortOptions, dial, lock, output};
use crate::remote::{self, Holder};
use crate::wire::Carrier;
use crate::wire::admin::{self, Added, AdminReply, Peer, PortView, Removed};
use crate::{Bottle, Contact, Network, Text, Value};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use tokio::sync::{Notify, Semaphore, watch};
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::timeout;

/// Receiver of incoming data.
pub(crate) enum InputSink {
    Inbox(Arc<Inbox>),
    Handler(Arc<dyn Handler>),
    /// Data is acknowledged and discarded.
    Nothing,
}

pub(crate) struct PortCore {
    pub name: String,
    pub contact: Contact,
    pub network: Network,
    pub options: PortOptions,
    /// Memory for partial messages, KiB.
    pub budget: Arc<Semaphore>,
    pub sink: InputSink,
    /// Delivery to outputs; `None` if this port has none.
    delivery: Option<Delivery>,
    state: Mutex<PortState>,
    pub dropped: Arc<AtomicU64>,
    closing: watch::Sender<bool>,
    /// Holder of our name, if the name server returns another port for it.
    taken: watch::Sender<Option<Contact>>,
}

#[derive(Default)]
struct PortState {
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

impl PortCore {
    pub fn new(
        network: &Network,
        contact: Contact,
        sink: InputSink,
        delivery: Option<Delivery>,
        options: PortOptions,
    ) -> PortCore {
        PortCore {
            name: contact.name.clone(),
            contact,
            network: network.clone(),
            budget: Arc::new(Semaphore::new(options.max_buffered >> 10)),
            options,
            sink,
            delivery,
            state: Mutex::default(),
            dropped: Arc::default(),
            closing: watch::Sender::new(false),
            taken: watch::Sender::new(None),
        }
    }

    /// Looks up the port's own name at the name server, and registers it again if a restarted server has lost
    /// it, or if another port that holds it does not answer. One that answers keeps it, and is returned (spec
    /// section 17).
    pub async fn roll_call(&self) -> Option<Contact> {
        let ours = &self.contact;
        let taken = match self.network.query(&self.name).await {
            Ok(Some(found)) if (&found.host, found.port) == (&ours.host, ours.port) => None,
            Ok(Some(other)) if remote::holder(&self.network, &other).await == Holder::Port => Some(other),
            Ok(_) => {
                if self.network.register(&self.name, &ours.host, ours.port).await.is_ok() {
                    let _ = self.network.announce(&self.name).await;
                    tracing::info!(
                        port = self.name,
                        "registered again: the name server had forgotten or given away the name"
                    );
                }
                None
            }
            // without an answer, the last result remains valid
            Err(_) => return self.taken.borrow().clone(),
        };
        let news = self.taken.send_replace(taken.clone()) != taken;
        if let Some(by) = taken.as_ref().filter(|_| news) {
            tracing::warn!(port = self.name, %by, "another program has taken the port's name");
        }
        taken
    }

    /// Waits until a roll call finds the port's name with another port.
    pub async fn name_taken(&self) -> Contact {
        loop {
            if let Ok(taken) = self.taken.subscribe().wait_for(Option::is_some).await
                && let Some(by) = taken.clone()
            {
                return by;
            }
        }
    }

    /// View of the port for administrative commands.
    pub fn view(&self) -> PortView {
        let state = lock(&self.state);
        PortView {
            name: self.name.clone(),
            address: format!("tcp://{}:{}/", self.contact.host, self.contact.port),
            is_input: !matches!(self.sink, InputSink::Nothing),
            is_output: self.delivery.is_some(),
            is_rpc: matches!(self.sink, InputSink::Handler(_)),
            inputs: state.inputs.values().map(|input| input.peer.clone()).collect(),
            outputs: state.outputs.iter().map(|output| output.peer.clone()).collect(),
            properties: state.properties.clone(),
        }
    }

    /// Executes an administrative command.
    pub async fn admin(self: &Arc<Self>, command: &Bottle) -> Bottle {
        match admin::answer(&self.view(), command) {
            AdminReply::Reply(reply) => reply,
            AdminReply::Add { given, contact } => admin::added(&self.name, &given, self.try_add(&contact).await),
            AdminReply::Remove(name) => admin::removed(&self.name, &name, self.remove(&name).await),
            AdminReply::Set(key, value) => {
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

    /// Connects an output, after removing an earlier one to the same port.
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
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        let slot = Arc::new(Slot::new(delivery, self.dropped.clone()));
        let job = output::Job { core: self.clone(), id, to: Contact { name: name.clone(), ..to }, carrier, slot };
        let peer = Peer { name, carrier };
        self.start(job, peer, line);
        Ok(())
    }

    /// Starts the task while the list is locked, so that it can't end before it is listed.
    fn start(&self, job: output::Job, peer: Peer, line: DialedConnection) {
        let mut state = lock(&self.state);
        if *self.closing.borrow() || state.outputs.len() >= self.options.connections {
            return;
        }
        let id = job.id;
        let slot = job.slot.clone();
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

    /// Ends the output to `name`, or otherwise the input from there.
    pub async fn remove(&self, name: &str) -> Removed {
        if self.remove_output(name).await {
            Removed::Output
        } else if self.remove_input(name) {
            Removed::Input
        } else {
            Removed::None
        }
    }

    /// Sends what is queued, quits and waits for the acknowledgment, all within time limits.
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
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        let end = Arc::new(Notify::new());
        if peer.name.starts_with('/') {
            self.remove_input(&peer.name);
        }
        lock(&self.state).inputs.insert(id, In { peer, end: end.clone() });
        Admitted { core: self.clone(), id, end }
    }

    /// Passes a packet to every output.
    pub fn publish(&self, packet: Arc<Packet>) {
        for output in &lock(&self.state).outputs {
            output.slot.put(packet.clone());
        }
    }

    /// Waits until all outputs have sent their packets.
    pub async fn drained(&self) {
        let slots: Vec<_> = lock(&self.state).outputs.iter().map(|output| output.slot.clone()).collect();
        for slot in slots {
            slot.drained().await;
        }
    }

    /// Removes an output that ended by itself.
    pub fn forget_output(&self, id: u64) {
        lock(&self.state).outputs.retain(|output| output.id != id);
    }

    /// Ends all outputs, each in order and within time limits.
    pub async fn end_outputs(self: &Arc<Self>) {
        let outputs = std::mem::take(&mut lock(&self.state).outputs);
        let mut ends = JoinSet::new();
        for output in outputs {
            let core = self.clone();
            ends.spawn(async move { core.end(output).await });
        }
        while ends.join_next().await.is_some() {}
    }

    /// Notifies all tasks that the port ends.
    pub fn begin_closing(&self) {
        self.closing.send_replace(true);
    }

    /// Waits for the port's end.
    pub async fn closed(&self) {
        let _ = self.closing.subscribe().wait_for(|closing| *closing).await;
    }
}

/// Entry of an input in the list; removed when dropped.
pub(crate) struct Admitted {
    core: Arc<PortCore>,
    pub id: u64,
    pub end: Arc<Notify>,
}

impl Drop for Admitted {
    fn drop(&mut self) {
        lock(&self.core.state).inputs.remove(&self.id);
        if let InputSink::Handler(handler) = &self.core.sink {
            handler.gone(self.id);
        }
    }
}
