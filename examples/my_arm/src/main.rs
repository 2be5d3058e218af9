//! The whole program: every subcommand of MoBeE, with the kinds of this crate.

// links the kinds of the library
use my_arm as _;

fn main() -> std::process::ExitCode {
    mobee::cli::main()
}
