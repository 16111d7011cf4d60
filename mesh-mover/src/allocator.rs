//! Calls to the allocator of the C library.

/// Returns free memory to the system, also where it lies between blocks in use.
///
/// The linear system of a new reference grid is assembled next to arrays that are freed afterwards. glibc retains
/// them: it returns only the top of its heap, and maps large blocks separately only until the first of their size has
/// been freed. On the 10 000 windows of `cases/hard/long-descent` 20 MiB were in use, and up to 13 MiB more were
/// retained. No effect with other C libraries.
pub fn release_free_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            fn malloc_trim(pad: usize) -> i32;
        }
        // SAFETY: a function of the C library that the program is linked with, of this signature; it may be called at
        // any time by any thread and does not change blocks in use.
        unsafe { malloc_trim(0) };
    }
}
