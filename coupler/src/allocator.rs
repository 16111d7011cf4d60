//! What the program asks of the C library's allocator.

/// Blocks of 256 KiB and more are mapped by themselves, and so returned to the system when they are freed.
///
/// glibc does so only until the first of their size has been freed, and then keeps them in its heap, where smaller blocks come to lie
/// between them. The model of the flow is remade as the canopy turns, with matrices of a megabyte: on the
/// 10 000 windows of `cases/hard/long-descent` the process grew from 22 to 27 MiB. Elsewhere than with glibc this does nothing.
pub fn map_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: called once before any other thread starts; it changes no block in use.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 256 << 10);
    }
}
