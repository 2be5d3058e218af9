//! A robot's own RPC (`/MoBeE/<robot>/rpc`): what a person at it may want of its controller.
//!
//! ```text
//! status        the filter's state in one word, and the reason of a hold
//! agent on|off  lets the built-in agent make motions, or makes it pause (at the end of its present one) for another
//! recover       tries a failed retreat again
//! ```

use crate::words::{self, line, string};
use mobee_contract::{Filtered, Status};
use mobee_yarp::{Bottle, Value, Vocab};

/// Answers a request; `[ok]`, or a sentence.
pub fn answer(request: &Bottle, robot: &dyn Filtered) -> Bottle {
    let ok = || Bottle(vec![Value::Vocab(Vocab::new("ok"))]);
    let word = |i: usize| words::name(request.0.get(i)).unwrap_or_default();
    match word(0).as_str() {
        "status" => {
            let status = robot.latest().status;
            let mut reply = line(status.word());
            if let Status::Holding(reason) = status {
                reply.0.push(string(reason.to_string()));
            }
            reply
        }
        "agent" => match word(1).as_str() {
            act @ ("on" | "off") => match robot.let_agent_act(act == "on") {
                Ok(()) => ok(),
                Err(refusal) => line(format!("{refusal}; {}", refusal.remedy())),
            },
            _ => line("Say `agent on` or `agent off`."),
        },
        "recover" => robot.recover().map_or_else(line, |()| ok()),
        _ => line("Commands: status, agent on|off, recover."),
    }
}
