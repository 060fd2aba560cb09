//! The outputs of a call, block after block.

#![expect(clippy::indexing_slicing, reason = "blocks are cut to the samples and to the points of the transform")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::loudness::{loud, quiet, window_peaks};
use super::{Buffers, Fft};
use crate::engine::negacyclic::multiply;
use crate::engine::{Sample, Windows};

/// The part of a block that a call wants.
struct Part {
    /// Where the block's first sample lies in `x`.
    start: isize,
    /// The wanted windows, counted from the block's start.
    wanted: Range<usize>,
    /// Where their outputs lie in `outs`.
    outputs: Range<usize>,
}

impl Part {
    /// Where the first wanted window starts in `x`.
    fn first(&self) -> usize {
        (self.start + self.wanted.start.cast_signed()).cast_unsigned()
    }
}

pub(super) struct Apply<'a, 'o, T: Sample> {
    pub(super) fft: &'a Fft<T>,
    pub(super) windows: Windows<'a, 'o, T>,
    pub(super) buffers: &'a mut Buffers<T>,
}

impl<T: Sample> WithSimd for Apply<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _simd: S) {
        let outputs = self.windows.outs.first().map_or(0, |out| out.len());
        let hop = self.fft.grid();
        let mut done = 0;
        while done < outputs {
            let first = (self.windows.first + done).cast_signed();
            let offset = (self.windows.origin + first).rem_euclid(hop.cast_signed());
            let skipped = offset.cast_unsigned();
            let end = outputs.min(done + hop - skipped);
            let wanted = skipped..skipped + end - done;
            self.block(&Part { start: first - offset, wanted, outputs: done..end });
            done = end;
        }
    }
}

impl<T: Sample> Apply<'_, '_, T> {
    #[inline(always)]
    fn block(&mut self, part: &Part) {
        let there = self.load(part.start);
        if let Some(peak) = loud(&self.buffers.samples[there.clone()], self.fft.taps) {
            self.level(part, peak, None::<&fn(T) -> bool>);
            return;
        }
        let Buffers { samples, values, peaks, .. } = &mut *self.buffers;
        window_peaks(samples, self.fft.taps, peaks, values);
        self.settle(part);
        if self.fft.taps == 0 {
            return;
        }
        let mut below = T::from_f64(f64::INFINITY);
        loop {
            // All windows that are there, wanted or not, decide on the levels.
            let windows = there.start..(there.end + 1).saturating_sub(self.fft.taps);
            let left = self.buffers.peaks[windows].iter().filter(|peak| **peak < below);
            let peak = left.fold(T::default(), |most, peak| if *peak > most { *peak } else { most });
            if peak <= T::default() {
                return;
            }
            let floor = peak * quiet();
            let served = move |size: T| size <= peak && size >= floor && size > T::default();
            if self.buffers.peaks[part.wanted.clone()].iter().any(|size| served(*size)) {
                self.level(part, peak, Some(&served));
            }
            below = floor;
        }
    }

    /// Fills `samples` with those of the block that are there, and says which.
    #[inline(always)]
    fn load(&mut self, start: isize) -> Range<usize> {
        let lag = usize::from(self.fft.on_differences);
        let samples = &mut self.buffers.samples;
        let place = |index: usize| (index.cast_signed() - start).clamp(0, samples.len().cast_signed()).cast_unsigned();
        let there = place(0)..place(self.windows.x.len() - lag);
        let x = &self.windows.x[(there.start.cast_signed() + start).cast_unsigned()..][..there.len() + lag];
        samples[..there.start].fill(T::default());
        samples[there.end..].fill(T::default());
        let samples = &mut samples[there.clone()];
        if self.fft.on_differences {
            for ((difference, older), newer) in samples.iter_mut().zip(x).zip(&x[1..]) {
                *difference = *newer - *older;
            }
        } else {
            samples.copy_from_slice(x);
        }
        there
    }

    /// Outputs of windows that hold nothing but zeros, or anything but numbers; the others follow.
    #[inline(always)]
    fn settle(&mut self, part: &Part) {
        let infinity = T::from_f64(f64::INFINITY);
        for (order, out) in self.fft.orders.iter().zip(self.windows.outs.iter_mut()) {
            let out = &mut out[part.outputs.clone()];
            for (value, size) in out.iter_mut().zip(&self.buffers.peaks[part.wanted.clone()]) {
                *value = if *size < infinity { T::default() } else { T::from_f64(f64::NAN) };
            }
            order.add_anchors(&self.windows.x[part.first()..], out);
        }
    }

    /// Outputs of the windows whose largest sample is as `served` says, or of all, from the samples that are not larger
    /// than `peak`.
    #[inline(always)]
    fn level(&mut self, part: &Part, peak: T, served: Option<&impl Fn(T) -> bool>) {
        let Fft { orders, transform, .. } = self.fft;
        let Buffers { samples, values, peaks, spectrum, product, work } = &mut *self.buffers;
        let half = transform.half();
        // Neither sums nor products of samples near 1 leave the range of numbers.
        let exponent = exponent(peak.to_f64()).clamp(-most::<T>(), most::<T>());
        transform.forward(samples, (peak, power(-exponent)), spectrum, work);
        for (order, out) in orders.iter().zip(self.windows.outs.iter_mut()) {
            let out = &mut out[part.outputs.clone()];
            multiply(spectrum, &order.spectrum, product);
            let factors = halves(exponent + order.exponent);
            if served.is_none() && part.wanted == (0..self.fft.grid()) && out.len() > half {
                let (low, high) = out.split_at_mut(half);
                transform.inverse(product, work, factors, low, high);
                order.add_anchors(&self.windows.x[part.first()..], out);
                continue;
            }
            let (low, high) = values.split_at_mut(half);
            transform.inverse(product, work, factors, low, high);
            let sums = &mut values[part.wanted.clone()];
            order.add_anchors(&self.windows.x[part.first()..], sums);
            for ((value, sum), size) in out.iter_mut().zip(sums).zip(&peaks[part.wanted.clone()]) {
                if served.is_none_or(|served| served(*size)) {
                    *value = *sum;
                }
            }
        }
    }
}

/// The largest exponent whose powers of 2, up and down, are numbers with all their digits.
fn most<T>() -> i32 {
    if size_of::<T>() == 4 { 126 } else { 1022 }
}

/// The exponent e of `2^(e - 1) <= value < 2^e`.
pub(super) fn exponent(value: f64) -> i32 {
    libm::frexp(value).1
}

fn power<T: Sample>(exponent: i32) -> T {
    T::from_f64(libm::ldexp(1.0, exponent))
}

/// Two factors whose product is `2^exponent`, which may be out of range itself.
fn halves<T: Sample>(exponent: i32) -> (T, T) {
    let half = (exponent / 2).clamp(-most::<T>(), most::<T>());
    (power(half), power((exponent - half).clamp(-most::<T>(), most::<T>())))
}
