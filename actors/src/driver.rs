//! Driver: the actor that owns one robot's hardware.
//!
//! It takes commands under the present token of the gate and throws all others away, polls the encoders, and begins the
//! pulse with every sample. On every start it first stops the board; nothing else ever moves by its own will.
//! A board that does not answer is asked again; the missing samples are what closes the filter.

mod core;

use crate::{address::Address, clock::Clock, controller::Rules, gate::Gate, pulse::Pulse, stream::Stream};
use crate::{supervision::Child, tap::Taps};
use core::{DriverCore, DriverOut};
use mobee_contract::{Command, DriverFault, Hardware, Time, Writer};
use mobee_model::Contact;
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::time::Duration;

/// How long to wait before a board that does not answer is asked again: at first, and at the most.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(2));

/// What the driver actor is told.
#[derive(Debug)]
pub enum DriverMsg {
    /// A command, and under which token who wrote it.
    Command {
        /// The token.
        token: u64,
        /// Who.
        writer: Writer,
        /// What.
        command: Command,
    },
    /// The board may move until then.
    Lease(Time),
    /// Time to look at the encoders, or to ask for the board again.
    Poll,
}

/// What a driver actor is made of; it outlives the actor.
#[derive(Clone)]
pub struct DriverParts {
    /// The hardware that outlives it.
    pub hardware: Arc<dyn Hardware>,
    /// The robot's gate.
    pub gate: Arc<Gate>,
    /// The robot's rules.
    pub rules: Arc<Rules>,
    /// Who is told of commands.
    pub taps: Taps,
    /// The time.
    pub clock: Clock,
    /// Where the pulse begins.
    pub out: Stream<Pulse>,
    /// Where the actor is reached.
    pub address: Address<DriverMsg>,
    /// Called when the board reports a fault of its own.
    pub on_fault: Arc<dyn Fn(DriverFault) + Send + Sync>,
}

/// A driver actor as a child of the robot's group.
pub fn child(name: &str, parts: DriverParts) -> Child {
    Child::new(name, move |supervisor| {
        let parts = parts.clone();
        async move {
            let (actor, _) =
                Actor::spawn_linked(None, DriverActor, parts, supervisor).await.map_err(|e| e.to_string())?;
            Ok(actor.get_cell())
        }
    })
}

struct DriverActor;

struct State {
    core: DriverCore,
    parts: DriverParts,
    none: Arc<[Contact]>,
    back_off: Duration,
}

impl Actor for DriverActor {
    type Msg = DriverMsg;
    type State = State;
    type Arguments = DriverParts;

    async fn pre_start(&self, myself: ActorRef<DriverMsg>, parts: DriverParts) -> Result<State, ActorProcessingErr> {
        parts.address.set(myself.clone());
        let core = DriverCore::new(parts.rules.clone());
        myself.cast(DriverMsg::Poll)?;
        Ok(State { core, parts, none: Vec::new().into(), back_off: BACK_OFF.0 })
    }

    async fn handle(
        &self,
        myself: ActorRef<DriverMsg>,
        message: DriverMsg,
        state: &mut State,
    ) -> Result<(), ActorProcessingErr> {
        let (parts, now) = (&state.parts, state.parts.clock.now());
        let out = match message {
            DriverMsg::Command { token, writer, command } => {
                state.core.command(now, parts.gate.token(), token, writer, &command)
            }
            DriverMsg::Lease(until) => {
                state.core.lease(now, until);
                return Ok(());
            }
            DriverMsg::Poll => {
                if state.core.is_connected() {
                    state.core.poll(now)
                } else {
                    match parts.hardware.connect() {
                        Ok(driver) => {
                            state.back_off = BACK_OFF.0;
                            state.core.connected(now, driver, parts.gate.token())
                        }
                        Err(_) => {
                            let wait = state.back_off;
                            state.back_off = (wait * 2).min(BACK_OFF.1);
                            myself.send_after(wait, || DriverMsg::Poll);
                            return Ok(());
                        }
                    }
                }
            }
        };
        for o in out {
            match o {
                DriverOut::Event(event) => parts.taps.event(now, event),
                DriverOut::Sample(sample) => parts.out.push(Pulse::new(sample, &state.none)),
                DriverOut::Fault(fault) => (parts.on_fault)(fault),
                DriverOut::PollAt(at) => {
                    myself.send_after(at.since(now), || DriverMsg::Poll);
                }
            }
        }
        Ok(())
    }
}
