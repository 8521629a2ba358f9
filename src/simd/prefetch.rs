//! Asking for memory before it is needed.

/// Asks for `LINES` cache lines from `slice[first]` on. Changes nothing but the time of a later access; a place
/// beyond the end is ignored.
#[inline(always)]
pub fn prefetch<const LINES: usize, T>(slice: &[T], first: usize) {
    let start = slice.as_ptr().wrapping_add(first).cast::<i8>();
    #[cfg(target_arch = "x86_64")]
    #[allow(unsafe_code)]
    for line in 0..LINES {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: SSE is part of x86-64, and a prefetch reads nothing and never faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = start;
}
