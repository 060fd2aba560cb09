//! Asking the memory for samples before they are needed.

/// Bytes of a cache line.
const LINE: usize = 64;

/// Asks for the cache lines of `values[from..from + count]`, as far as there are such, without waiting for them.
///
/// Between two accesses to memory engines compute for longer than the CPU looks ahead by itself: without this they would
/// wait for every line in turn (decision 0011).
#[inline(always)]
#[expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]
pub fn prefetch<T>(values: &[T], from: usize, count: usize) {
    let until = values.len().min(from.saturating_add(count));
    for index in (from..until).step_by(LINE / size_of::<T>()) {
        request(&values[index]);
    }
}

#[inline(always)]
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "std has no safe prefetch")]
fn request<T>(value: &T) {
    use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
    // SAFETY: a prefetch neither reads nor writes as far as the program can see, and every x86-64 CPU has it.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast()) }
}

#[inline(always)]
#[cfg(not(target_arch = "x86_64"))]
fn request<T>(_value: &T) {}
