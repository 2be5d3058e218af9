//! The program `mobee`.
fn main() {}
