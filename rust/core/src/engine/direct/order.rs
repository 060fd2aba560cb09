//! The order in which the taps of every output are added, and the sums in that order where no tile fits.

#![expect(clippy::indexing_slicing, reason = "outputs are cut to whole groups, whose windows lie in the samples")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use super::super::Sample;
use super::DEPTH;
use super::tile::Finish;

/// Outputs of a row at a time: what compilers turn into the registers that every CPU of a family has.
const ABREAST: usize = 16;

/// Calls with the index of every tap, in the order in which they are added: of every [`DEPTH`] strides of `width` taps the
/// first of each, the second of each, and so on.
#[inline(always)]
pub fn in_order(taps: usize, width: usize, mut add: impl FnMut(usize)) {
    // Nothing saturates: so the compiler knows as well that nothing overflows.
    for group in (0..taps).step_by(DEPTH * width) {
        let end = taps.min(group.saturating_add(DEPTH * width));
        for place in group..end.min(group.saturating_add(width)) {
            // Not by `for_each`, into which the sums would not be inlined.
            for tap in (place..end).step_by(width) {
                add(tap);
            }
        }
    }
}

/// The outputs of a row.
#[inline(always)]
pub fn row<T: Sample, const W: usize>(taps: &[T], x: &[T], finish: &Finish<'_, T>, out: &mut [T]) {
    let whole = out.len() / ABREAST * ABREAST;
    each::<T, W, ABREAST>(taps, x, 1, finish, &mut out[..whole]);
    each::<T, W, 1>(taps, x.get(whole..).unwrap_or_default(), 1, &finish.from(whole), &mut out[whole..]);
}

/// The outputs of neighbouring rows.
#[inline(always)]
pub fn side<T: Sample, const W: usize>(taps: &[T], x: &[T], finish: &Finish<'_, T>, out: &mut [T]) {
    match T::LANES {
        8 => each::<T, W, 8>(taps, x, 8, finish, out),
        _ => each::<T, W, 16>(taps, x, 16, finish, out),
    }
}

/// `L` elements of the output at a time; from one sample to the next lie `sample` elements.
#[inline(always)]
fn each<T: Sample, const W: usize, const L: usize>(
    taps: &[T],
    x: &[T],
    sample: usize,
    finish: &Finish<'_, T>,
    out: &mut [T],
) {
    for (at, out) in out.chunks_exact_mut(L).enumerate() {
        let mut sums = [T::default(); L];
        in_order(taps.len(), W, |tap| {
            for (sum, value) in sums.iter_mut().zip(&x[at * L + tap * sample..][..L]) {
                *sum = *sum + taps[tap] * *value;
            }
        });
        out.copy_from_slice(&sums);
        finish.from(at * L).values(out);
    }
}
