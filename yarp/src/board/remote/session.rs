//! Life cycle of a connection: reached, watched, lost, and reached again.

use super::{LinkState, SharedRemote, facts, stream};
use crate::board::{Ask, Get};
use crate::{Contact, PortError};
use std::sync::Arc;
use std::time::Duration;

/// Shortest and longest pause between two attempts.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(2));

/// Time that another program, which also found the name free, may take to register it.
const SETTLES: Duration = Duration::from_millis(100);

/// Reaches the board, watches it, and starts again when it is lost, until `leave` is set.
pub(super) async fn run(shared: Arc<SharedRemote>) {
    let mut stream = None;
    let mut leave = shared.leave.subscribe();
    tokio::select! {
        biased;
        _ = leave.wait_for(|leave| *leave) => {}
        () = stay(&shared, &mut stream) => {}
    }
    if let Some(stream) = stream {
        stream.close().await;
    }
}

/// Maintains the connection, without end.
async fn stay(shared: &Arc<SharedRemote>, stream: &mut Option<stream::AxisStream>) {
    let mut pause = BACK_OFF.0;
    let mut generation = 0;
    loop {
        match reach(shared, stream).await {
            Ok(up) => {
                pause = BACK_OFF.0;
                generation += 1;
                tracing::info!(board = shared.port, "connected");
                shared.link.send_replace(LinkState::Up(generation));
                let why = watch(shared, up).await;
                tracing::warn!(board = shared.port, why = ?why, "lost");
                shared.link.send_replace(why);
                *stream = stream.take().filter(|stream| !stream.is_over());
            }
            Err(why) => {
                shared.link.send_if_modified(|link| {
                    let changed = *link != why;
                    *link = why;
                    changed
                });
            }
        }
        tokio::time::sleep(pause).await;
        pause = (pause * 2).min(BACK_OFF.1);
        // trouble notified while disconnected does not concern the next connection
        let _ = tokio::time::timeout(Duration::ZERO, shared.trouble.notified()).await;
    }
}

async fn reach<'a>(
    shared: &Arc<SharedRemote>,
    stream: &'a mut Option<stream::AxisStream>,
) -> Result<&'a mut stream::AxisStream, LinkState> {
    if stream.is_none() {
        *stream = Some(stream::AxisStream::open(shared.clone()).await.map_err(|e| match e {
            PortError::Taken(other) => taken(&other),
            e @ PortError::Silent(_) => LinkState::Taken(super::in_words(&e)),
            e => LinkState::Down(super::in_words(&e)),
        })?);
        // the original's name server lets two programs that start at the same time both register: the later
        // one gets the name
        tokio::time::sleep(SETTLES).await;
    }
    let Some(stream) = stream else { return Err(LinkState::Down("no port for states".into())) };
    if let Some(other) = stream.port.roll_call().await {
        return Err(taken(&other));
    }
    shared.control.lock().await.pause().await;
    let axes = facts::query(shared).await.map_err(LinkState::Down)?;
    let known = shared.facts.borrow().clone();
    match known {
        Some(known) if known != axes => {
            let why = "the board has other axes or limits than before; start anew to use it";
            return Err(LinkState::Down(why.into()));
        }
        Some(_) => {}
        None => {
            shared.facts.send_replace(Some(axes.clone()));
        }
    }
    stream.begin(shared, axes.len()).await.map_err(LinkState::Down)?;
    Ok(stream)
}

/// Watches the connection until it is lost, and returns the reason.
async fn watch(shared: &Arc<SharedRemote>, stream: &mut stream::AxisStream) -> LinkState {
    let port = stream.port.clone();
    let mut look = tokio::time::interval(shared.options.stale.max(Duration::from_millis(20)));
    look.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let axes = shared.facts.borrow().as_ref().map_or(0, |f| f.len());
    let mut quiet = 0u32;
    loop {
        tokio::select! {
            () = shared.trouble.notified() => return LinkState::Down("a request got no answer".into()),
            _ = look.tick() => {
                let age = shared.state.borrow().as_ref().map(|s| s.arrived.elapsed());
                if age.is_some_and(|a| a < shared.options.stale) {
                    quiet = 0;
                    continue;
                }
                // the states have stopped: checks that the board is there, then requests them again, at
                // growing intervals
                if let Err(e) = shared.ask(&Ask::Get(Get::Axes).bottle()).await {
                    return LinkState::Down(e.to_string());
                }
                quiet += 1;
                if quiet.is_power_of_two()
                    && let Err(why) = stream.begin(shared, axes).await
                {
                    tracing::debug!(board = shared.port, why, "no states");
                }
            }
            () = stream.over() => return LinkState::Down("the reader of its states died".into()),
            other = port.name_taken() => return taken(&other),
        }
    }
}

fn taken(other: &Contact) -> LinkState {
    let Contact { name, host, port, .. } = other;
    LinkState::Taken(format!(
        "another program holds the port name {name} (at {host}:{port}): two would write to one robot; end it, or choose another name"
    ))
}
