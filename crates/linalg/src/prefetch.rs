//! Hints to the cache.

/// Asks for the cache lines of `ahead` before they are read. Streams through matrices of short rows are broken up by accesses to vectors, and what the
/// processor itself fetches ahead comes late. No effect on the result, nor where the target has no such instruction.
#[inline(always)]
pub(crate) fn prefetch<T>(ahead: &[T]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        const LINE: usize = 64;
        let bytes = ahead.as_ptr().cast::<i8>();
        for at in (0..size_of_val(ahead)).step_by(LINE) {
            // SAFETY: an address within the slice, which is not read.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(bytes.add(at)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = ahead;
}
