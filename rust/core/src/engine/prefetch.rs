//! Asking the memory for samples before they are needed.

use branches::prefetch_read_data;

/// Bytes of a cache line.
const LINE: usize = 64;

/// The nearest cache, as `prefetch_read_data` numbers them.
const NEAREST: i32 = 0;

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
    let asked = values.get(from..until).unwrap_or_default();
    asked.iter().step_by(LINE / size_of::<T>()).for_each(|value| prefetch_read_data::<T, NEAREST>(value));
}
