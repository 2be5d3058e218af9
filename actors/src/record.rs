//! Records of a run: taps on their own threads, the journal, digests of all files, the tracks of
//! configurations, and the configuration ring that survives a crash.

pub mod files;
pub mod journal;
pub mod names;
pub mod ring;
pub mod tap;
pub mod track;
