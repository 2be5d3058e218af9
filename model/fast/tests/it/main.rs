//! Promise: the verdicts of many poses at once are the scalar engine's, pose for pose.

mod edges;
mod scenes;
mod verdicts;
