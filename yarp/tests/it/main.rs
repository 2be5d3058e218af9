//! The tests of this package from outside, one module per promise, in one binary: a binary for each took longer to link than to run.

mod board_words;
mod common;
mod exchanges;
mod fuzz_corpus;
mod name_server;
mod ports;
mod real_time;
mod vectors;
