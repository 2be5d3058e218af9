//! The commands that relay streams: `sample`, `merge`.

use super::ports::{WAITING, carrier_of, printed};
use super::{Failure, because, info, seconds};
use crate::signals::Interrupt;
use mobee_runtime::clock::{Clock, ClockKind};
use mobee_yarp::{Bottle, Carrier, Delivery, InputPort, Message, Network, OutputPort, Payload, Queue, Relay, Stamp};
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval};

/// The arguments of `sample`.
#[derive(clap::Args)]
pub(super) struct SampleArgs {
    /// The port to open, which both receives and sends the messages.
    #[arg(long, value_name = "PORT")]
    output: String,
    /// A port to read from.
    #[arg(long, value_name = "PORT")]
    input: Option<String>,
    /// Time between two messages.
    #[arg(long, value_name = "SECONDS", required_unless_present = "rate")]
    period: Option<f64>,
    /// Messages per second.
    #[arg(long, value_name = "HZ", conflicts_with = "period")]
    rate: Option<f64>,
    /// The carrier from the input: tcp, fast_tcp, text, text_ack or udp.
    #[arg(long, default_value = "tcp")]
    carrier: Carrier,
    /// Also print the data.
    #[arg(long)]
    show: bool,
}

/// The arguments of `merge`.
#[derive(clap::Args)]
pub(super) struct MergeArgs {
    /// The ports to read from.
    #[arg(required_unless_present = "input", conflicts_with = "input")]
    ports: Vec<String>,
    /// The ports to read from, in the original's alternative form.
    #[arg(long, num_args = 1.., value_name = "PORT")]
    input: Vec<String>,
    /// The port to open for the merged messages.
    #[arg(long, value_name = "PORT", default_value = "/portsMerge/o0")]
    output: String,
    /// Prefix of the names of the reading ports; a number follows.
    #[arg(long, value_name = "PREFIX", default_value = "/portsMerge/i")]
    worker: String,
    /// The carrier from the inputs: tcp, fast_tcp, text, text_ack or udp.
    #[arg(long, default_value = "udp")]
    carrier: Carrier,
}

/// `sample`: forwards the newest message at a constant rate, from the first on; repeats it if no newer one has arrived.
pub(super) async fn sample(network: &Network, args: SampleArgs) -> Result<(), Failure> {
    let period = match (args.period, args.rate) {
        (Some(period), _) => seconds(period, "--period")?,
        (None, rate) => seconds(rate.map_or(0.0, |rate| 1.0 / rate), "--rate")?,
    };
    let mut interrupt = Interrupt::new();
    let opened = Relay::open(network, &args.output, Queue::Newest, Delivery::Newest).await;
    let mut relay = opened.map_err(because)?;
    info(format_args!("Port {} active at {}", args.output, relay.contact()));
    if let Some(input) = &args.input {
        relay.connect_from(input, carrier_of(input, args.carrier)?).await.map_err(because)?;
    }
    let work = async {
        let mut newest = relay.recv().await?;
        let mut ticks = interval(period);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                message = relay.recv() => newest = message?,
                _ = ticks.tick() => {
                    relay.write(newest.payload.clone(), newest.envelope.clone());
                    if args.show && !shown(network, &newest) {
                        return None;
                    }
                }
            }
        }
    };
    let _: Option<()> = tokio::select! {
        ended = work => ended,
        () = interrupt.wait() => None,
    };
    relay.close().await;
    Ok(())
}

/// Prints a message; `false` when the reader has closed the output.
fn shown(network: &Network, message: &Message) -> bool {
    let text = message.payload.bottle(network.dialect()).map(|bottle| bottle.to_text());
    printed(&text.unwrap_or_else(|e| e.to_string().into_bytes()))
}

/// `merge`: whenever a message arrives at one of the ports, sends the newest ones of all ports as one.
pub(super) async fn merge(network: &Network, args: MergeArgs) -> Result<(), Failure> {
    let sources = if args.input.is_empty() { args.ports } else { args.input };
    let mut interrupt = Interrupt::new();
    let output = OutputPort::open(network, &args.output, Delivery::Newest).await.map_err(because)?;
    let (come, mut newest) = mpsc::channel(WAITING);
    let mut readers = tokio::task::JoinSet::new();
    for (number, source) in sources.iter().enumerate() {
        let name = format!("{}{number}", args.worker);
        let mut reader = InputPort::open(network, &name, Queue::Newest).await.map_err(because)?;
        reader.connect_from(source, carrier_of(source, args.carrier)?).await.map_err(because)?;
        let come = come.clone();
        let dialect = network.dialect();
        readers.spawn(async move {
            while let Some(message) = reader.recv().await {
                if let Ok(bottle) = message.payload.bottle(dialect)
                    && come.send((number, bottle)).await.is_err()
                {
                    break;
                }
            }
        });
    }
    info(format_args!("Port {} active: ready, from {}", output.name(), sources.join(" ")));
    let clock = Clock::new(ClockKind::Real);
    let mut stamp = Stamp::default();
    let work = async {
        let mut parts = vec![Bottle::new(); sources.len()];
        while let Some((number, bottle)) = newest.recv().await {
            parts.get_mut(number).into_iter().for_each(|part| *part = bottle.clone());
            stamp = stamp.next(clock.time_of_day(clock.now()));
            let merged = Bottle(parts.iter().flat_map(|part| part.0.iter().cloned()).collect());
            output.write(Payload::from(merged), Some(stamp.envelope()));
        }
    };
    tokio::select! {
        () = work => {}
        () = interrupt.wait() => {}
    }
    // the ports unregister when they are dropped
    readers.shutdown().await;
    output.close().await;
    Ok(())
}
