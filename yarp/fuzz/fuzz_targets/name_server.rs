#![no_main]

#[path = "../promises/name_server.rs"]
mod name_server;

libfuzzer_sys::fuzz_target!(|input: &[u8]| name_server::hold(input));
