//! YARP encoding of a robot's own RPC (`/MoBeE/<robot>/rpc`).
//!
//! ```text
//! status        state of the filter in one word, and the reason of a hold
//! agent on|off  lets the built-in agent act, or pauses it (at the end of its present motion) in favor of another
//! recover       retries a failed retreat
//! ```

use super::words::{self, line, string};
use mobee_contract::{Filtered, Status};
use mobee_filter::robot_rpc::{self, RobotRefusal, RobotReply, RobotRequest};
use mobee_yarp::{Bottle, Value, Vocab};

/// Answers a request with `[ok]`, or a message.
pub(crate) fn answer(request: &Bottle, robot: &dyn Filtered) -> Bottle {
    reply(parse(request).and_then(|asked| robot_rpc::answer(asked, robot)))
}

fn parse(request: &Bottle) -> Result<RobotRequest, RobotRefusal> {
    let word = |i: usize| words::name(request.0.get(i)).unwrap_or_default();
    match word(0).as_str() {
        "status" => Ok(RobotRequest::Status),
        "agent" => match word(1).as_str() {
            "on" => Ok(RobotRequest::LetAgentAct(true)),
            "off" => Ok(RobotRequest::LetAgentAct(false)),
            _ => Err(RobotRefusal::OnOrOff),
        },
        "recover" => Ok(RobotRequest::Recover),
        _ => Err(RobotRefusal::Unknown),
    }
}

fn reply(reply: Result<RobotReply, RobotRefusal>) -> Bottle {
    match reply {
        Ok(RobotReply::Done) => Bottle(vec![Value::Vocab(Vocab::new("ok"))]),
        Ok(RobotReply::Status(status)) => {
            let mut reply = line(status.word());
            if let Status::Holding(reason) = status {
                reply.0.push(string(reason.to_string()));
            }
            reply
        }
        Err(RobotRefusal::Unknown) => line("Commands: status, agent on|off, recover."),
        Err(RobotRefusal::OnOrOff) => line("Say `agent on` or `agent off`."),
        Err(RobotRefusal::Refused(refusal)) => line(format!("{refusal}; {}", refusal.remedy())),
        Err(RobotRefusal::NotRecovered(why)) => line(why),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_parsed_and_refusals_name_the_valid_ones() {
        let parsed = |text: &str| parse(&Bottle::parse(text, Default::default()).unwrap());
        assert_eq!(parsed("status"), Ok(RobotRequest::Status));
        assert_eq!(parsed("agent on"), Ok(RobotRequest::LetAgentAct(true)));
        assert_eq!(parsed("[agen] off"), Err(RobotRefusal::Unknown), "a vocab holds four letters");
        assert_eq!(parsed("agent off now"), Ok(RobotRequest::LetAgentAct(false)));
        assert_eq!(parsed("recover"), Ok(RobotRequest::Recover));
        for (text, said) in
            [("agent", "Say `agent on` or `agent off`."), ("1", "Commands: status, agent on|off, recover.")]
        {
            assert_eq!(reply(parsed(text).map(|_| RobotReply::Done)), line(said), "{text}");
        }
        assert_eq!(reply(Ok(RobotReply::Done)).to_string(), "[ok]");
    }
}
