//! Integration tests of this package, one module per property, in one binary: a binary for each
//! took longer to link than to run.

mod locators;
mod onnx;
mod picture_files;
mod tags;
