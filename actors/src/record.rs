//! What a run leaves behind: taps on threads of their own, the journal, digests of all files, the tracks of poses, and the ring of poses that survives a crash.

pub mod files;
pub mod journal;
pub mod names;
pub mod ring;
pub mod tap;
pub mod track;
