//! Settings of the memory allocator.

/// Makes the C library return freed blocks of at least 1 MiB to the system. By default glibc keeps blocks of sizes
/// that were freed before; gaps left by the setup of a solver were a tenth of the memory of a run. Time steps do not
/// allocate, so the run time is unchanged. Without glibc this function does nothing.
pub fn return_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            fn mallopt(parameter: i32, value: i32) -> i32;
        }
        const M_MMAP_THRESHOLD: i32 = -3;
        // SAFETY: a function of the C library that the program is linked with, of this
        // signature; it may be called at any time and changes where later blocks lie only.
        unsafe { mallopt(M_MMAP_THRESHOLD, 1 << 20) };
    }
}
