//! Promise: the verdicts of many poses at once are the scalar engine's, pose for pose; and what is said of an edge holds
//! for every pose on it.

mod edges;
mod scenes;
mod verdicts;
