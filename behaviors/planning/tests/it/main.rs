//! Integration tests of this package, one module per property, in one binary: a binary for each
//! took longer to link than to run.

mod map_files;
mod planners;
mod table_map;
mod validity;
#[allow(dead_code, reason = "the tests of the agents use the rest")]
mod world;
