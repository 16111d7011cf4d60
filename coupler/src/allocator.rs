//! Settings of the C library's allocator.

/// Maps blocks of 256 KiB and more separately, so that they return to the system when they are freed.
///
/// By default glibc raises this threshold when such a block is first freed, and then allocates blocks of that size on its heap, which
/// fragments. The added-mass surrogate is reassembled as the canopy rotates, with matrices of a megabyte: over the
/// 10 000 windows of `cases/hard/long-descent` the process grew from 22 to 27 MiB. No effect without glibc.
pub fn map_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: called once before any other thread starts; it changes no block in use.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 256 << 10);
    }
}
