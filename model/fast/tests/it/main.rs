//! Promise: the verdicts on many poses at once equal those of the scalar engine, pose by pose; and a verdict on an edge
//! holds for every pose on it.

mod edges;
mod edits;
mod scenes;
mod verdicts;
