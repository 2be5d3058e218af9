//! Integration tests of this package, one module per promise, in one binary: separate binaries took longer to link than
//! to run.

mod distance_pairs;
mod engines;
mod fields;
mod fit;
mod hulls;
mod import;
mod mesh_files;
mod oracle;
mod oracle_load;
mod own_robots;
mod pair_rules;
mod pairs_listed;
mod pairs_oracle;
mod robots_corpus;
mod robots_oracle;
mod slides;
mod srdf;
mod surfaces;
mod survey;
mod sweep;
mod turns;
mod urdf_heeded;
mod urdf_import;
mod urdf_nasty;
mod watch_follows;
mod zrp_load;
mod zrp_reach;
