//! Integration tests of this package, one module per promise, in one binary: separate binaries took longer to link than
//! to run.

mod distance_pairs;
mod engines;
mod fields;
mod hulls;
mod oracle;
mod oracle_load;
mod own_robots;
mod pair_rules;
mod pairs_listed;
mod pairs_oracle;
mod slides;
mod sweep;
mod turns;
mod watch_follows;
mod zrp_load;
mod zrp_reach;
