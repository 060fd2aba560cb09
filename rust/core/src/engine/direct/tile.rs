//! Sums of a tile of outputs, whose registers stay where they are while the taps go by.

#![expect(
    clippy::indexing_slicing,
    reason = "tiles are cut to whole registers of the outputs; checks that fail stop, and the compiler removes those that cannot"
)]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::ops::Range;

use pulp::Simd;

use super::super::Sample;
use super::super::stream::rescale;
use super::{DEPTH, Order};

/// Places of 64 bytes beside each other are one row, or one sample each of [`Sample::LANES`] rows.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    /// From sample to sample, in elements.
    pub sample: usize,
    /// From one register of samples to the next that is loaded.
    pub load: usize,
    /// Loads from one register of outputs to the next.
    pub outputs: usize,
    /// Loads from stride to stride of taps.
    pub stride: usize,
}

impl Shape {
    /// For strides of `W` taps: of a row, registers beside each other; of neighbouring rows (`SIDE`), registers `W` samples
    /// apart.
    #[inline(always)]
    pub const fn new<T: Sample, S: Simd, const W: usize, const SIDE: bool>() -> Self {
        let register = size_of::<T::Register<S>>() / size_of::<T>();
        if SIDE {
            return Self { sample: T::LANES, load: W * T::LANES, outputs: 1, stride: 1 };
        }
        let load = if register < W { register } else { W };
        Self { sample: 1, load, outputs: register / load, stride: W / load }
    }

    /// Which register of outputs the load `at` adds to with a tap of `stride`, if it is one of `registers`.
    #[inline(always)]
    const fn output(self, at: usize, stride: usize, registers: usize) -> Option<usize> {
        let skipped = stride * self.stride;
        if at < skipped || !(at - skipped).is_multiple_of(self.outputs) {
            return None;
        }
        let output = (at - skipped) / self.outputs;
        if output < registers { Some(output) } else { None }
    }
}

/// What an output still needs when all taps have gone by.
#[derive(Debug, Clone, Copy)]
pub struct Finish<'a, T> {
    scale: f64,
    /// The scale in the type of the samples, if it is a number of that type.
    own: Option<T>,
    /// The sample that is added to every output.
    anchored: Option<&'a [T]>,
}

impl<'a, T: Sample> Finish<'a, T> {
    /// Of an order; `samples[anchor]` belongs to the first output, `sample` elements lie between samples.
    #[inline(always)]
    pub fn new(order: &Order<T>, samples: &'a [T], sample: usize) -> Self {
        let own = T::from_f64(order.scale);
        let own = (own.to_f64() == order.scale).then_some(own);
        Self { scale: order.scale, own, anchored: order.anchor.map(|anchor| &samples[anchor * sample..]) }
    }

    /// For the outputs from the element `start` on.
    #[inline(always)]
    pub fn from(&self, start: usize) -> Self {
        Self { anchored: self.anchored.map(|samples| &samples[start..]), ..*self }
    }

    /// A sum that stands in memory.
    #[inline(always)]
    pub fn values(&self, out: &mut [T]) {
        rescale(out, self.scale);
        if let Some(samples) = self.anchored {
            out.iter_mut().zip(samples).for_each(|(out, sample)| *out = *out + *sample);
        }
    }

    /// Sums that stand in registers, `apart` elements from one to the next.
    #[inline(always)]
    fn registers<S: Simd, const N: usize>(&self, simd: S, sums: &[T::Register<S>; N], apart: usize, out: &mut [T]) {
        let width = size_of::<T::Register<S>>() / size_of::<T>();
        let out = &mut out[..(N - 1) * apart + width];
        let Some(own) = self.own else {
            for (output, sum) in sums.iter().enumerate() {
                let at = output * apart;
                T::registers_mut::<S>(&mut out[at..at + width])[0] = *sum;
                self.from(at).values(&mut out[at..at + width]);
            }
            return;
        };
        let own = T::splat(simd, own);
        if let Some(samples) = self.anchored {
            let samples = &samples[..out.len()];
            for (output, sum) in sums.iter().enumerate() {
                let at = output * apart;
                let sample = T::registers::<S>(&samples[at..at + width])[0];
                T::registers_mut::<S>(&mut out[at..at + width])[0] = T::plus(simd, T::times(simd, own, *sum), sample);
            }
            return;
        }
        for (output, sum) in sums.iter().enumerate() {
            let at = output * apart;
            T::registers_mut::<S>(&mut out[at..at + width])[0] = T::times(simd, own, *sum);
        }
    }
}

/// How many strides the taps after the last whole group make, and how many taps the last of them has; none, and none.
pub const fn rest(taps: usize, width: usize) -> (usize, usize) {
    let rest = taps % (DEPTH * width);
    let strides = rest.div_ceil(width);
    (strides, rest - strides.saturating_sub(1) * width)
}

/// Fills `N` registers of outputs, where `D` strides are left after the last whole group, and `E` is one less.
#[inline(always)]
pub fn tile<T: Sample, S: Simd, const N: usize, const D: usize, const E: usize, const W: usize, const SIDE: bool>(
    simd: S,
    taps: &[T],
    x: &[T],
    finish: &Finish<'_, T>,
    out: &mut [T],
) {
    let shape = const { Shape::new::<T, S, W, SIDE>() };
    let mut sums = [T::splat(simd, T::default()); N];
    let (mut x, mut groups) = (x, taps.chunks_exact(DEPTH * W));
    for taps in &mut groups {
        sums = places::<T, S, N, DEPTH, W, SIDE>(simd, sums, taps, x, 0..W);
        // Nothing if no taps are left.
        x = x.get(DEPTH * W * shape.sample..).unwrap_or_default();
    }
    let (_, last) = rest(taps.len(), W);
    if D > 0 {
        sums = places::<T, S, N, D, W, SIDE>(simd, sums, groups.remainder(), x, 0..last);
    }
    if E > 0 {
        sums = places::<T, S, N, E, W, SIDE>(simd, sums, groups.remainder(), x, last..W);
    }
    finish.registers::<S, N>(simd, &sums, shape.outputs * shape.load, out);
}

/// Adds the taps at `range` of each of `D` strides: of every stride the tap at one place, then at the next.
#[inline(always)]
fn places<T: Sample, S: Simd, const N: usize, const D: usize, const W: usize, const SIDE: bool>(
    simd: S,
    sums: [T::Register<S>; N],
    taps: &[T],
    x: &[T],
    range: Range<usize>,
) -> [T::Register<S>; N] {
    let shape = const { Shape::new::<T, S, W, SIDE>() };
    let width = size_of::<T::Register<S>>() / size_of::<T>();
    let loads = shape.outputs * (N - 1) + shape.stride * D.saturating_sub(1) + 1;
    let mut held = sums;
    for place in range {
        let taps = &taps[place..][..=D.saturating_sub(1) * W];
        let mut weights = [T::splat(simd, T::default()); D];
        for (stride, weight) in weights.iter_mut().enumerate() {
            *weight = T::splat(simd, taps[stride * W]);
        }
        // A register of samples meets one tap of every stride, each for another register of outputs.
        let x = &x[place * shape.sample..][..(loads - 1) * shape.load + width];
        for at in 0..loads {
            let samples = T::registers::<S>(&x[at * shape.load..][..width])[0];
            for (stride, weight) in weights.iter().enumerate() {
                if let Some(output) = shape.output(at, stride, N) {
                    held[output] = T::plus(simd, held[output], T::times(simd, *weight, samples));
                }
            }
        }
    }
    held
}
