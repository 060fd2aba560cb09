//! How large the samples of a block and of its windows are.

#![expect(clippy::indexing_slicing, reason = "groups of samples are numbered within their block")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use crate::engine::Sample;

/// What [`quiet`] is in the two precisions: single precision has fewer digits to lose.
pub(super) const QUIET_DOUBLE: f64 = 1.0 / 1024.0;
const QUIET_SINGLE: f64 = 1.0 / 32.0;

/// Samples that are compared side by side.
const LANES: usize = 8;

/// The size of the largest sample, if it is a number and every window of so many holds one that is not quiet next to it.
///
/// It may overlook that: a window holds a whole piece, in which every lane is asked for a loud sample.
#[inline(always)]
pub(super) fn loud<T: Sample>(samples: &[T], window: usize) -> Option<T> {
    let piece = window.div_ceil(2) / LANES * LANES;
    if piece == 0 {
        return None;
    }
    let larger = |a: T, b: T| if a > b { a } else { b };
    let smaller = |a: T, b: T| if a < b { a } else { b };
    let (mut most, mut least) = ([T::default(); LANES], [T::from_f64(f64::INFINITY); LANES]);
    // Remains 0 unless there is a NaN or inf.
    let mut lost = [T::default(); LANES];
    let mut pieces = samples.chunks_exact(piece);
    for piece in &mut pieces {
        let mut sizes = [T::default(); LANES];
        for row in piece.as_chunks::<LANES>().0 {
            for lane in 0..LANES {
                sizes[lane] = larger(size(row[lane]), sizes[lane]);
                lost[lane] = lost[lane] + row[lane] * T::default();
            }
        }
        for lane in 0..LANES {
            most[lane] = larger(sizes[lane], most[lane]);
            least[lane] = smaller(sizes[lane], least[lane]);
        }
    }
    let mut peak = most.into_iter().fold(T::default(), larger);
    let mut lost = lost.into_iter().fold(T::default(), |sum, lost| sum + lost);
    for sample in pieces.remainder() {
        peak = larger(size(*sample), peak);
        lost = lost + *sample * T::default();
    }
    let least = least.into_iter().fold(peak, smaller);
    (lost == T::default() && least >= peak * quiet() && least > T::default()).then_some(peak)
}

/// The size of the largest of the `window` samples from each on; infinite if one is not a number.
///
/// The reach of the maxima is doubled until the last step closes the window.
#[inline(always)]
pub(super) fn window_peaks<T: Sample>(samples: &[T], window: usize, peaks: &mut Vec<T>, other: &mut Vec<T>) {
    let infinity = T::from_f64(f64::INFINITY);
    for (peak, sample) in peaks.iter_mut().zip(samples) {
        let size = size(*sample);
        *peak = if size < infinity { size } else { infinity };
    }
    if window == 0 {
        peaks.fill(T::default());
    }
    let (mut reach, mut len) = (1, samples.len());
    while reach < window {
        let step = reach.min(window - reach);
        len -= step;
        for ((to, near), far) in other[..len].iter_mut().zip(&peaks[..]).zip(&peaks[step..]) {
            *to = if far > near { *far } else { *near };
        }
        std::mem::swap(peaks, other);
        reach += step;
    }
}

#[inline(always)]
fn size<T: Sample>(sample: T) -> T {
    if sample < T::default() { T::default() - sample } else { sample }
}

/// A window is quiet if its largest sample is smaller than this part of the largest in its block.
pub(super) fn quiet<T: Sample>() -> T {
    T::from_f64(if size_of::<T>() == 4 { QUIET_SINGLE } else { QUIET_DOUBLE })
}
