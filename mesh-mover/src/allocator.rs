//! What the program asks of the C library's allocator.

/// Gives free memory back to the system, also where it lies between blocks in use.
///
/// The linear system of a new reference grid is set up beside arrays that are free afterwards, and glibc keeps
/// them: it returns only the top of its heap, and maps large blocks by themselves only until the first of their size
/// has been freed. On the 10 000 windows of `cases/hard/long-descent` 20 MiB were in use, and up to 13 MiB more
/// were kept. Elsewhere than with glibc this does nothing.
pub fn release_free_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            fn malloc_trim(pad: usize) -> i32;
        }
        // SAFETY: a function of the C library that the program is linked with, of this signature; it may be
        // called at any time by any thread and changes no block in use.
        unsafe { malloc_trim(0) };
    }
}
