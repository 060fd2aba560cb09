//! The outputs of one window, as streams want them: in the same order of the taps, without memory of their own, and without a
//! way to panic.

#![expect(clippy::indexing_slicing, reason = "the samples are as many as the taps")]

use super::super::Sample;
use super::order::in_order;
use super::{Direct, Order};

/// Channels side by side: what compilers turn into the registers that every CPU of a family has.
const MANY: usize = 16;

/// Channels side by side that are left over; samples are padded to a multiple of it, unless there is one channel.
const FEW_CHANNELS: usize = 4;

/// Elements from one sample of so many channels to the next in the window that [`Direct::latest`] takes.
#[inline]
pub(crate) fn stride(channels: usize) -> usize {
    if channels <= 1 { channels } else { channels.div_ceil(FEW_CHANNELS).wrapping_mul(FEW_CHANNELS) }
}

impl<T: Sample> Direct<T> {
    /// The outputs of the window `x`, whose samples lie [`stride`] elements apart, of the order number `index`: one for every channel.
    #[inline]
    pub(crate) fn latest(&self, index: usize, x: &[T], channels: usize, out: &mut [T]) {
        let (Some(order), stride) = (self.orders.get(index), stride(channels)) else { return };
        match (self.few(), self.on_differences, const { T::LANES == 8 }) {
            (true, true, true) => all::<T, 4, 16, true>(order, x, stride, out),
            (true, false, true) => all::<T, 4, 16, false>(order, x, stride, out),
            (false, true, true) | (true, true, false) => all::<T, 8, 32, true>(order, x, stride, out),
            (false, false, true) | (true, false, false) => all::<T, 8, 32, false>(order, x, stride, out),
            (false, true, false) => all::<T, 16, 64, true>(order, x, stride, out),
            (false, false, false) => all::<T, 16, 64, false>(order, x, stride, out),
        }
    }

    /// How many orders there are.
    #[inline]
    pub(crate) fn count(&self) -> usize {
        self.orders.len()
    }
}

/// All channels of one order.
#[inline]
fn all<T: Sample, const W: usize, const G: usize, const DIFFERENCES: bool>(
    order: &Order<T>,
    x: &[T],
    stride: usize,
    out: &mut [T],
) {
    if stride == 1 {
        let sum = alone::<T, W, G, DIFFERENCES>(&order.taps, x);
        return finish(order, [sum], x, 1, out);
    }
    let mut x = x;
    let (whole, rest) = out.as_chunks_mut::<MANY>();
    for out in whole {
        side::<T, W, MANY, DIFFERENCES>(order, x, stride, out);
        x = x.get(MANY..).unwrap_or_default();
    }
    for out in rest.chunks_mut(FEW_CHANNELS) {
        side::<T, W, FEW_CHANNELS, DIFFERENCES>(order, x, stride, out);
        x = x.get(FEW_CHANNELS..).unwrap_or_default();
    }
}

/// The sum of the one channel, whose samples are neighbours: whole groups of `G`, four strides of taps, without asking where they end.
#[inline]
fn alone<T: Sample, const W: usize, const G: usize, const DIFFERENCES: bool>(taps: &[T], x: &[T]) -> T {
    let mut sum = T::default();
    let (groups, rest) = taps.as_chunks::<G>();
    let newer = if DIFFERENCES { x.get(1..).unwrap_or_default() } else { x };
    for ((taps, older), newer) in groups.iter().zip(x.as_chunks::<G>().0).zip(newer.as_chunks::<G>().0) {
        in_order(G, W, |tap| sum = sum + term::<T, DIFFERENCES>(taps[tap], older[tap], newer[tap]));
    }
    let done = taps.len().wrapping_sub(rest.len());
    let (x, newer) = (x.get(done..).unwrap_or_default(), newer.get(done..).unwrap_or_default());
    in_order(rest.len(), W, |tap| {
        if let (Some(&weight), Some(&older), Some(&newer)) = (rest.get(tap), x.get(tap), newer.get(tap)) {
            sum = sum + term::<T, DIFFERENCES>(weight, older, newer);
        }
    });
    sum
}

/// As many channels side by side as there are `out`, at most `L`.
#[inline]
fn side<T: Sample, const W: usize, const L: usize, const DIFFERENCES: bool>(
    order: &Order<T>,
    x: &[T],
    stride: usize,
    out: &mut [T],
) {
    let newer = if DIFFERENCES { x.get(stride..).unwrap_or_default() } else { x };
    let mut sums = [T::default(); L];
    in_order(order.taps.len(), W, |tap| {
        let at = tap.wrapping_mul(stride);
        let (weight, older, newer) = (order.taps.get(tap), lanes::<T, L>(x, at), lanes::<T, L>(newer, at));
        if let (Some(&weight), Some(older), Some(newer)) = (weight, older, newer) {
            for lane in 0..L {
                sums[lane] = sums[lane] + term::<T, DIFFERENCES>(weight, older[lane], newer[lane]);
            }
        }
    });
    finish(order, sums, x, stride, out);
}

/// What a tap adds.
#[inline]
fn term<T: Sample, const DIFFERENCES: bool>(weight: T, older: T, newer: T) -> T {
    weight * if DIFFERENCES { newer - older } else { older }
}

/// Scales sums, adds the samples that they are relative to, if any, and writes as many as are wanted: all at once, so that
/// compilers see that the sums belong into registers side by side.
#[inline]
fn finish<T: Sample, const L: usize>(order: &Order<T>, sums: [T; L], x: &[T], stride: usize, out: &mut [T]) {
    let own = T::from_f64(order.scale);
    let mut values = sums;
    if own.to_f64() == order.scale {
        values.iter_mut().for_each(|value| *value = *value * own);
    } else {
        values.iter_mut().for_each(|value| *value = T::from_f64(value.to_f64() * order.scale));
    }
    if let Some(samples) = order.anchor.and_then(|anchor| lanes::<T, L>(x, anchor.wrapping_mul(stride))) {
        values.iter_mut().zip(samples).for_each(|(value, sample)| *value = *value + *sample);
    }
    if let Some(out) = out.first_chunk_mut() {
        *out = values;
    } else {
        out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
    }
}

#[inline]
fn lanes<T, const L: usize>(x: &[T], at: usize) -> Option<&[T; L]> {
    x.get(at..).and_then(<[T]>::first_chunk)
}
