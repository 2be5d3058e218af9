//! Integration tests of this package, one module per property, in one binary: a binary for each
//! took longer to link than to run.

mod explorer;
mod hand_goals;
mod icub;
mod join;
mod locators;
mod map_files;
mod onnx;
mod picture_files;
mod plan_agent;
mod planners;
mod reach_agent;
mod roadmap_agent;
mod short_way;
mod simple_agents;
mod table_map;
mod tags;
mod validation;
mod validity;
mod world;
