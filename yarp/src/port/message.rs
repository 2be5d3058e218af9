//! Messages, as owners of ports handle them.

use crate::{Bottle, DecodeError, Dialect, Stamp, TextError};
use bytes::Bytes;

/// Content of a message. A connection transports it in binary or as text, which only determines its encoding.
#[derive(Clone, Debug, PartialEq)]
pub enum Payload {
    /// Bytes of a binary carrier: a bottle or another object (spec section 11), in some dialect.
    Binary(Bytes),
    /// Bottle text of a text carrier.
    Text(Vec<u8>),
    /// A bottle that is not encoded yet.
    Bottle(Bottle),
}

/// A payload that is not a bottle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PayloadError {
    /// Malformed bytes.
    #[error(transparent)]
    Binary(#[from] DecodeError),
    /// Malformed text.
    #[error(transparent)]
    Text(#[from] TextError),
}

impl Payload {
    /// Decodes the content as a bottle.
    ///
    /// # Errors
    /// The content is not a bottle; the error gives the position.
    pub fn bottle(&self, dialect: Dialect) -> Result<Bottle, PayloadError> {
        Ok(match self {
            Payload::Binary(bytes) => Bottle::decode(bytes, dialect)?,
            Payload::Text(text) => Bottle::parse(text, dialect)?,
            Payload::Bottle(bottle) => bottle.clone(),
        })
    }

    /// Bytes for a binary carrier.
    ///
    /// # Errors
    /// The content is text that is not a bottle.
    pub fn binary(&self, dialect: Dialect) -> Result<Bytes, PayloadError> {
        Ok(match self {
            Payload::Binary(bytes) => bytes.clone(),
            Payload::Text(text) => Bottle::parse(text, dialect)?.encode(dialect).into(),
            Payload::Bottle(bottle) => bottle.encode(dialect).into(),
        })
    }

    /// Line for a text carrier.
    ///
    /// # Errors
    /// The content is bytes that are not a bottle.
    pub fn text(&self, dialect: Dialect) -> Result<Vec<u8>, PayloadError> {
        Ok(match self {
            Payload::Binary(bytes) => Bottle::decode(bytes, dialect)?.to_text(),
            Payload::Text(text) => text.clone(),
            Payload::Bottle(bottle) => bottle.to_text(),
        })
    }
}

impl From<Bottle> for Payload {
    fn from(bottle: Bottle) -> Payload {
        Payload::Bottle(bottle)
    }
}

impl From<&Bottle> for Payload {
    fn from(bottle: &Bottle) -> Payload {
        Payload::Bottle(bottle.clone())
    }
}

impl From<Bytes> for Payload {
    fn from(bytes: Bytes) -> Payload {
        Payload::Binary(bytes)
    }
}

impl From<Vec<u8>> for Payload {
    fn from(bytes: Vec<u8>) -> Payload {
        Payload::Binary(bytes.into())
    }
}

/// A message as received.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// The content.
    pub payload: Payload,
    /// The envelope, usually a [`Stamp`] as text.
    pub envelope: Option<String>,
    /// Name of the sender without modifiers.
    pub from: String,
    /// Number of the connection, unique within the process.
    pub connection: u64,
    /// True if the sender waits for a reply (`d` instead of `D`).
    pub wants_reply: bool,
}

impl Message {
    /// The envelope as a stamp, if it is one.
    pub fn stamp(&self) -> Option<Stamp> {
        self.envelope.as_deref().and_then(Stamp::from_envelope)
    }
}
