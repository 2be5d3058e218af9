//! What a run leaves behind: taps on threads of their own, the journal, the tracks of poses, and the ring of poses that survives a crash.

pub mod journal;
pub mod names;
pub mod ring;
pub mod tap;
pub mod track;
