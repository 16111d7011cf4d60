//! The command line `ripstop`.

fn main() -> std::process::ExitCode {
    coupler::cli::main()
}
