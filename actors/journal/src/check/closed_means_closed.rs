//! I1: from `Disabled` to `Enabled` no command of an agent reaches the driver, and the reflex writes under its token only.
//!
//! A token is open if an `Enabled` event introduced it, and closed otherwise, until the next token. Every
//! command must carry the token that is current when it is written, and that token must admit its writer:
//! agents write under open tokens, the reflex under closed ones. The filter does not open between `Halted` and
//! `Released`. Supervise also writes under closed tokens, but only stops and control modes. A stream is
//! recorded when it ends, so it is judged by the time span in which it was written. The driver itself only
//! stops.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommandKind, Event, Time, Writer};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct ClosedMeansClosed {
    robots: BTreeMap<String, TokenWatch>,
}

struct TokenWatch {
    token: u64,
    /// Per token: whether it is open, and since when.
    tokens: BTreeMap<u64, (bool, Time)>,
    /// True if a person has halted the robot.
    halted: bool,
}

impl Default for TokenWatch {
    fn default() -> TokenWatch {
        TokenWatch { token: 0, tokens: BTreeMap::from([(0, (false, Time::ZERO))]), halted: false }
    }
}

impl TokenWatch {
    fn turn(&mut self, token: u64, open: bool, at: Time, found: &mut FoundViolations<'_>) {
        if token <= self.token {
            found.report(format!("token {token} follows token {}: tokens only grow", self.token));
        }
        self.token = token;
        self.tokens.insert(token, (open, at));
    }

    fn may_write(&self, writer: Writer, token: u64) -> bool {
        let open = self.tokens.get(&token).map(|t| t.0);
        match writer {
            Writer::Agent => open == Some(true),
            Writer::Reflex | Writer::Supervise => open == Some(false),
            Writer::Driver => true,
        }
    }

    /// Time at which a token was replaced.
    fn until(&self, token: u64) -> Option<Time> {
        self.tokens.range(token + 1..).next().map(|(_, (_, from))| *from)
    }
}

impl Invariant for ClosedMeansClosed {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Halted { robot } => self.robots.entry(robot.clone()).or_default().halted = true,
            Event::Released { robot } => self.robots.entry(robot.clone()).or_default().halted = false,
            Event::Enabled { robot, token } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                if filter.halted {
                    found.report(format!("{robot}: the filter opened while the robot was halted"));
                }
                filter.turn(*token, true, line.at, found);
            }
            Event::Disabled { robot, token, .. } => {
                self.robots.entry(robot.clone()).or_default().turn(*token, false, line.at, found);
            }
            Event::Command { robot, token, writer, kind, .. } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                let now = filter.token;
                if matches!(writer, Writer::Driver | Writer::Supervise)
                    && !matches!(kind, CommandKind::Stop | CommandKind::Mode)
                {
                    let subject = if *writer == Writer::Driver { "the driver" } else { "supervise" };
                    found.report(format!(
                        "{robot}: {subject} itself wrote a `{}`; it may only stop and set modes",
                        kind.word()
                    ));
                } else if *writer == Writer::Driver {
                    // The driver stops its board after every start, whatever the filter's state.
                } else if *token != now || !filter.may_write(*writer, *token) {
                    let state = if filter.may_write(Writer::Agent, now) { "open" } else { "closed" };
                    found.report(format!(
                        "{robot}: {writer:?} wrote a `{}` under token {token} while the filter was {state} under {now}",
                        kind.word()
                    ));
                }
            }
            Event::Streamed { robot, token, writer, span, .. } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                if *writer == Writer::Supervise || !filter.may_write(*writer, *token) {
                    found.report(format!("{robot}: {writer:?} streamed under token {token}, which is not its own"));
                } else if let Some(until) = filter.until(*token).filter(|until| span.1 > *until) {
                    found.report(format!(
                        "{robot}: {writer:?} streamed under token {token} until {}, after it ended at {until}",
                        span.1
                    ));
                }
            }
            _ => {}
        }
    }
}
