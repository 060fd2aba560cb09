//! Neighbouring rows side by side: every sample is a place of 64 bytes, and the same sums are formed in every lane.
//!
//! The outputs of a tile lie a stride of taps apart, so that a register of samples serves four taps here as well.

#![expect(
    clippy::indexing_slicing,
    reason = "blocks and pieces are cut to the outputs, and every output's window lies in the samples"
)]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::super::{Sample, Scratch, Windows};
use super::tile::{Finish, rest, tile};
use super::{DEPTH, Direct, TILE, aligned, difference, order, pieces};
use crate::error::{Error, at_least};

/// Outputs whose differences are held at a time.
const BLOCK: usize = 256;

/// Outputs that are worth a block of their own.
const WORTHY: usize = 32;

impl<T: Sample> Direct<T> {
    /// What [`Runner::apply_lanes`](super::super::Runner::apply_lanes) does.
    pub(in super::super) fn apply_lanes(
        &self,
        windows: Windows<'_, '_, T>,
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        let Windows { x, first, outs, .. } = windows;
        Arch::new().dispatch(self.lanes(&x[first * T::LANES..], outs, scratch)?);
        Ok(())
    }

    pub(super) fn lanes<'a, 'o>(
        &'a self,
        x: &'a [T],
        outs: &'a mut [&'o mut [T]],
        scratch: &'a mut Scratch<T>,
    ) -> Result<Lanes<'a, 'o, T>, Error> {
        if self.on_differences {
            // A short rest joins the block before.
            at_least(&mut scratch.differences, (BLOCK + WORTHY + 1 + self.span) * T::LANES)?;
        }
        Ok(Lanes { direct: self, x, outs, differences: aligned(&mut scratch.differences) })
    }
}

/// The outputs of neighbouring rows, for every order.
pub(super) struct Lanes<'a, 'o, T> {
    direct: &'a Direct<T>,
    x: &'a [T],
    outs: &'a mut [&'o mut [T]],
    differences: &'a mut [T],
}

impl<T: Sample> WithSimd for Lanes<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        run_with_strides!(self, simd);
    }
}

impl<T: Sample> Lanes<'_, '_, T> {
    #[inline(always)]
    fn run<S: Simd, const W: usize>(self, simd: S) {
        let Self { direct: Direct { orders, span, on_differences }, x, outs, differences } = self;
        let lanes = T::LANES;
        let outputs = outs.first().map_or(0, |out| out.len() / lanes);
        for block in pieces(0..outputs, BLOCK, WORTHY) {
            let samples = &x[block.start * lanes..(block.end + span - 1) * lanes];
            let mut formed = 0;
            for piece in pieces(0..block.len(), TILE * W, 2 * W) {
                let stream = if *on_differences {
                    let held = (piece.end + span - 2) * lanes;
                    difference(&samples[formed..held + lanes], lanes, &mut differences[formed..held]);
                    formed = held;
                    &differences[..held]
                } else {
                    samples
                };
                let stream = stream.get(piece.start * lanes..).unwrap_or_default();
                for (order, out) in orders.iter().zip(outs.iter_mut()) {
                    let finish = Finish::new(order, samples, lanes).from(piece.start * lanes);
                    let out = &mut out[(block.start + piece.start) * lanes..(block.start + piece.end) * lanes];
                    correlate::<T, S, W>(simd, &order.taps, stream, &finish, out);
                }
            }
        }
    }
}

/// `out[i] = sum of taps[k] x[i + k]` in every lane, finished.
#[inline(always)]
fn correlate<T: Sample, S: Simd, const W: usize>(simd: S, taps: &[T], x: &[T], finish: &Finish<'_, T>, out: &mut [T]) {
    if const { size_of::<T::Register<S>>() < 16 } {
        return order::side::<T, W>(taps, x, finish, out);
    }
    match rest(taps.len(), W).0 {
        0 => cover::<T, S, 0, 0, W>(simd, taps, x, finish, out),
        1 => cover::<T, S, 1, 0, W>(simd, taps, x, finish, out),
        2 => cover::<T, S, 2, 1, W>(simd, taps, x, finish, out),
        3 => cover::<T, S, 3, 2, W>(simd, taps, x, finish, out),
        _ => cover::<T, S, DEPTH, 3, W>(simd, taps, x, finish, out),
    }
}

/// Covers the outputs with tiles, for which `D` and `E` are as in [`tile`].
#[inline(always)]
fn cover<T: Sample, S: Simd, const D: usize, const E: usize, const W: usize>(
    simd: S,
    taps: &[T],
    x: &[T],
    finish: &Finish<'_, T>,
    out: &mut [T],
) {
    let outputs = out.len() / T::LANES;
    let mut done = 0;
    while outputs - done >= TILE * W {
        tiles::<T, S, TILE, D, E, W>(simd, taps, x, finish, out, done..done + W);
        done += TILE * W;
    }
    while outputs - done >= 2 * W {
        tiles::<T, S, 2, D, E, W>(simd, taps, x, finish, out, done..done + W);
        done += 2 * W;
    }
    if done < outputs && outputs >= 2 * W {
        // Outputs may be computed twice, as each is computed alone.
        tiles::<T, S, 2, D, E, W>(simd, taps, x, finish, out, outputs - 2 * W..outputs - W);
    } else {
        tiles::<T, S, 1, D, E, W>(simd, taps, x, finish, out, done..outputs);
    }
}

/// Fills the outputs `starts`, and behind each of them `N - 1` more that lie `W` apart.
#[inline(always)]
fn tiles<T: Sample, S: Simd, const N: usize, const D: usize, const E: usize, const W: usize>(
    simd: S,
    taps: &[T],
    x: &[T],
    finish: &Finish<'_, T>,
    out: &mut [T],
    starts: Range<usize>,
) {
    let width = size_of::<T::Register<S>>() / size_of::<T>();
    for start in starts {
        for lane in (0..T::LANES).step_by(width) {
            let at = start * T::LANES + lane;
            let x = x.get(at..).unwrap_or_default();
            tile::<T, S, N, D, E, W, true>(simd, taps, x, &finish.from(at), &mut out[at..]);
        }
    }
}
