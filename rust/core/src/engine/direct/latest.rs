//! The outputs of one window, as streams want them: in the same order of the taps, without memory of their own, and without a
//! way to panic.

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
            (true, true, true) => all::<T, 4, true>(order, x, stride, out),
            (true, false, true) => all::<T, 4, false>(order, x, stride, out),
            (false, true, true) | (true, true, false) => all::<T, 8, true>(order, x, stride, out),
            (false, false, true) | (true, false, false) => all::<T, 8, false>(order, x, stride, out),
            (false, true, false) => all::<T, 16, true>(order, x, stride, out),
            (false, false, false) => all::<T, 16, false>(order, x, stride, out),
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
fn all<T: Sample, const W: usize, const DIFFERENCES: bool>(order: &Order<T>, x: &[T], stride: usize, out: &mut [T]) {
    if stride == 1 {
        return side::<T, W, 1, DIFFERENCES>(order, x, 1, out);
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

/// As many channels side by side as there are `out`, at most `L`.
#[inline]
fn side<T: Sample, const W: usize, const L: usize, const DIFFERENCES: bool>(
    order: &Order<T>,
    x: &[T],
    stride: usize,
    out: &mut [T],
) {
    let newer = x.get(stride..).unwrap_or_default();
    let mut sums = [T::default(); L];
    in_order(order.taps.len(), W, |tap| {
        let at = tap.wrapping_mul(stride);
        let (Some(&weight), Some(samples)) = (order.taps.get(tap), lanes::<T, L>(x, at)) else { return };
        if DIFFERENCES {
            let Some(newer) = lanes::<T, L>(newer, at) else { return };
            for ((sum, older), newer) in sums.iter_mut().zip(samples).zip(newer) {
                *sum = *sum + weight * (*newer - *older);
            }
        } else {
            for (sum, sample) in sums.iter_mut().zip(samples) {
                *sum = *sum + weight * *sample;
            }
        }
    });
    let own = T::from_f64(order.scale);
    let exact = own.to_f64() == order.scale;
    let anchored = order.anchor.and_then(|anchor| lanes::<T, L>(x, anchor.wrapping_mul(stride)));
    for (lane, (out, sum)) in out.iter_mut().zip(sums).enumerate() {
        *out = if exact { sum * own } else { T::from_f64(sum.to_f64() * order.scale) };
        if let Some(sample) = anchored.and_then(|samples| samples.get(lane)) {
            *out = *out + *sample;
        }
    }
}

#[inline]
fn lanes<T, const L: usize>(x: &[T], at: usize) -> Option<&[T; L]> {
    x.get(at..).and_then(<[T]>::first_chunk)
}
