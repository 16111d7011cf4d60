//! The command line `ripstop`.

fn main() -> std::process::ExitCode {
    coupler::allocator::map_large_blocks();
    coupler::cli::main()
}
