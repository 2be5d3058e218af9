//! The program `mobee`: see [`mobee::cli`].

fn main() -> std::process::ExitCode {
    mobee::cli::main()
}
