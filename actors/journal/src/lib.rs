//! The record of a run: the journal and its hash chain, the measured configurations beside it, the configuration ring
//! that survives a crash, digests of all files, and the checker of the invariants.
//!
//! ```text
//! events ──Journal──> journal.jsonl ──read──> JournalLine ──┐
//! status ──Tracks──> poses-ROBOT.track ──read──> TrackReading ──check──> CheckReport
//! ```
//!
//! It depends on no actor library and no runtime: a journal is written by any [`Sink`](mobee_contract::Sink) thread, and
//! judged wherever its files are.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod check;
pub mod files;
pub mod journal;
pub mod names;
pub mod ring;
pub mod track;
