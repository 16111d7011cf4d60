//! What the program asks of the allocator.

/// Lets every block of a megabyte and more go back to the system when it is freed. The C
/// library stops doing so for sizes that were freed once, and what building a solver leaves
/// in between its arrays was a tenth of the memory of a run. Nothing allocates in a step, so
/// it costs no time. Elsewhere than with glibc this does nothing.
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
