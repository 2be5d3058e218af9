//! Integration tests of this package, one module per promise, in one binary: separate binaries took longer to link than
//! to run.

mod fit;
mod import;
mod mesh_files;
mod robots_corpus;
mod robots_oracle;
mod srdf;
mod surfaces;
mod survey;
mod urdf_heeded;
mod urdf_import;
mod urdf_nasty;
