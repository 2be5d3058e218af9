//! The short replies of a board (spec section 12.1).

use super::words;
use crate::{Bottle, Value, Vocab};

fn word(vocab: Vocab) -> Bottle {
    Bottle(vec![Value::Vocab(vocab)])
}

/// `([ok])`: a recognized and successful `[set]`.
pub fn ok() -> Bottle {
    word(words::OK)
}

/// `([fail])`: failure of any kind, an unknown request included.
pub fn fail() -> Bottle {
    word(words::FAIL)
}

/// True if a reply is a failure. The reason may follow the word.
pub fn is_fail(reply: &Bottle) -> bool {
    reply.get(0).and_then(Value::as_vocab) == Some(words::FAIL)
}

/// `([nak])`: a request of fewer than two elements.
pub fn nak() -> Bottle {
    word(words::NAK)
}

/// Reply to an unknown request: `[nak]` if it has fewer than two elements, otherwise `[fail]`.
pub fn unknown(request: &Bottle) -> Bottle {
    if request.0.len() < 2 { nak() } else { fail() }
}

/// True if a reply is the `([ok])` of a successful `[set]`.
pub fn is_ok(reply: &Bottle) -> bool {
    *reply == ok()
}
