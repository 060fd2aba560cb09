//! Samples into the stream that engines run on, and sums into outputs.

#![expect(clippy::indexing_slicing, reason = "what is known is cut to the samples first")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use super::Sample;

/// The stream that engines run on, from its sample `start` on: first differences of x, or x; zero where x has no samples.
/// Samples are `unit` neighbouring values.
#[inline(always)]
pub fn stream<T: Sample>(x: &[T], unit: usize, on_differences: bool, start: isize, out: &mut [T]) {
    let lag = if on_differences { unit } else { 0 };
    let (start, held) = (start * unit.cast_signed(), x.len().saturating_sub(lag).cast_signed());
    let inside = |place: isize| (place - start).clamp(0, out.len().cast_signed()).cast_unsigned();
    let (from, until) = (inside(0), inside(held).max(inside(0)));
    let (before, rest) = out.split_at_mut(from);
    let (known, after) = rest.split_at_mut(until - from);
    before.fill(T::default());
    after.fill(T::default());
    let Some(x) = x.get((start + from.cast_signed()).max(0).cast_unsigned()..) else { return };
    if on_differences {
        let (older, newer) = (&x[..known.len()], &x[lag..][..known.len()]);
        for ((value, older), newer) in known.iter_mut().zip(older).zip(newer) {
            *value = *newer - *older;
        }
    } else {
        known.copy_from_slice(&x[..until - from]);
    }
}

/// Multiplies by a power of two, rounding once.
#[inline(always)]
pub fn rescale<T: Sample>(values: &mut [T], scale: f64) {
    let own = T::from_f64(scale);
    if own.to_f64() == scale {
        values.iter_mut().for_each(|value| *value = *value * own);
    } else {
        values.iter_mut().for_each(|value| *value = T::from_f64(value.to_f64() * scale));
    }
}
