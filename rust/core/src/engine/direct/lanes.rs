//! Neighbouring rows side by side: every sample is a place of 64 bytes, and the same sums are formed in every lane.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use super::super::stream::rescale;
use super::super::{Sample, Scratch};
use super::{Direct, Order, STRIDE_BYTES, in_order};
use crate::error::{Error, at_least};

/// Outputs for which differences are formed at a time.
const BLOCK: usize = 256;

/// Outputs of a tile.
const TILE: usize = 4;

impl<T: Sample> Direct<T> {
    /// `x` is the matrix `(samples, LANES)`, and so are `outs`.
    pub(in super::super) fn apply_lanes(
        &self,
        x: &[T],
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        if self.on_differences {
            at_least(&mut scratch.differences, (BLOCK + self.span) * T::LANES)?;
        }
        let arch = Arch::new();
        let outputs = outs.first().map_or(0, |out| out.len() / T::LANES);
        for start in (0..outputs).step_by(BLOCK) {
            let end = outputs.min(start + BLOCK);
            let samples = &x[start * T::LANES..(end + self.span - 1) * T::LANES];
            let stream = if self.on_differences {
                let differences = &mut scratch.differences[..samples.len() - T::LANES];
                arch.dispatch(Difference { samples, differences });
                &*differences
            } else {
                samples
            };
            for (order, out) in self.orders.iter().zip(outs.iter_mut()) {
                let out = &mut out[start * T::LANES..end * T::LANES];
                let anchored = order.anchor.map(|anchor| &samples[anchor * T::LANES..]);
                arch.dispatch(Correlate { order, stream, anchored, out });
            }
        }
        Ok(())
    }
}

struct Difference<'a, T> {
    samples: &'a [T],
    differences: &'a mut [T],
}

impl<T: Sample> WithSimd for Difference<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let newer = &self.samples[T::LANES..];
        for ((difference, older), newer) in self.differences.iter_mut().zip(self.samples).zip(newer) {
            *difference = *newer - *older;
        }
    }
}

struct Correlate<'a, T> {
    order: &'a Order<T>,
    stream: &'a [T],
    anchored: Option<&'a [T]>,
    out: &'a mut [T],
}

impl<T: Sample> WithSimd for Correlate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { order, stream, anchored, out } = self;
        with_registers!(simd, T, S, correlate(&order.taps, stream, out));
        rescale(out, order.scale);
        if let Some(samples) = anchored {
            out.iter_mut().zip(samples).for_each(|(out, sample)| *out = *out + *sample);
        }
    }
}

#[inline(always)]
fn correlate<T: Sample, S: Simd, const R: usize>(simd: S, taps: &[T], x: &[T], out: &mut [T]) {
    let mut done = 0;
    let mut tiles = out.chunks_exact_mut(TILE * T::LANES);
    for tile in &mut tiles {
        tile_of::<T, S, R, TILE>(simd, taps, &x[done..], tile);
        done += TILE * T::LANES;
    }
    for tile in tiles.into_remainder().chunks_exact_mut(T::LANES) {
        tile_of::<T, S, R, 1>(simd, taps, &x[done..], tile);
        done += T::LANES;
    }
}

/// The sums of `N` outputs, each in `R` registers.
#[inline(always)]
fn tile_of<T: Sample, S: Simd, const R: usize, const N: usize>(simd: S, taps: &[T], x: &[T], out: &mut [T]) {
    let mut sums = [[T::splat(simd, T::default()); R]; N];
    in_order(taps, STRIDE_BYTES / size_of::<T>(), |k| {
        let tap = T::splat(simd, taps[k]);
        let places = T::registers::<S>(&x[k * T::LANES..(k + N) * T::LANES]);
        for (sum, place) in sums.iter_mut().zip(places.chunks_exact(R)) {
            for (sum, samples) in sum.iter_mut().zip(place) {
                *sum = T::plus(simd, *sum, T::times(simd, tap, *samples));
            }
        }
    });
    for (sum, out) in sums.iter().zip(out.chunks_exact_mut(T::LANES)) {
        T::registers_mut::<S>(out).copy_from_slice(sum);
    }
}
