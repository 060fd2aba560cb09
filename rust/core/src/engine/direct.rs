//! Every tap of every output, in one fixed order.
//!
//! A tile of neighbouring outputs is held in registers while the taps go by. Taps come in strides, four at a time: tap 0 of each
//! stride, tap 1 of each, and so on. So a register of samples serves four taps, and the loads are few. Adding the two samples
//! of equal taps first, which symmetric weights would allow, saves multiplications but doubles the loads (decision 0007).
//! Multiplication and addition stay apart (no fused operation), so every CPU gives the same bits.

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

use super::{Sample, Scratch, Taps, Windows};
use crate::error::{Error, at_least, try_vec};
pub(crate) use latest::stride;
use tile::{Finish, tile};

/// Runs with strides of 32 bytes or of 64, as [`Direct::few`] says. The constant comes first, so that only what can be used is
/// compiled.
macro_rules! run_with_strides {
    ($run:expr, $simd:expr) => {{
        let few = $run.direct.few();
        if const { T::LANES == 8 } {
            if few { $run.run::<S, 4>($simd) } else { $run.run::<S, 8>($simd) }
        } else if few {
            $run.run::<S, 8>($simd);
        } else {
            $run.run::<S, 16>($simd);
        }
    }};
}

/// The same for neighbouring rows.
mod lanes;
/// One output alone.
mod latest;
/// The order of the taps.
mod order;
/// Outputs in registers.
mod tile;

/// Bytes of outputs whose differences are held at a time: with the samples and the outputs they stay in the nearest cache.
const BLOCK_BYTES: usize = 8 << 10;

/// Bytes of outputs between which new differences are formed: memory is read while sums are formed.
const PIECE_BYTES: usize = 2 << 10;

/// Registers of a tile of outputs, at most: with four weights, a sample and a product they fit into sixteen.
const TILE: usize = 8;

/// Strides of taps that a sample is used for while it is in a register, at most.
const DEPTH: usize = 4;

/// Taps up to which strides are of 32 bytes, as otherwise hardly any sample would be used twice; others are of 64 bytes.
const FEW: usize = 16;

/// The taps of every order.
#[derive(Debug)]
pub struct Direct<T> {
    orders: Vec<Order<T>>,
    span: usize,
    on_differences: bool,
}

#[derive(Debug)]
struct Order<T> {
    taps: Vec<T>,
    scale: f64,
    anchor: Option<usize>,
}

impl<T: Sample> Direct<T> {
    pub(crate) fn new(orders: &[&Taps]) -> Result<Self, Error> {
        let order = |taps: &&Taps| {
            let mut own = try_vec(T::taps(taps).len(), T::default())?;
            own.copy_from_slice(T::taps(taps));
            Ok(Order { taps: own, scale: taps.scale, anchor: taps.anchor })
        };
        Ok(Self {
            span: orders.first().map_or(0, |taps| taps.span()),
            on_differences: orders.iter().all(|taps| taps.on_differences),
            orders: orders.iter().map(order).collect::<Result<_, Error>>()?,
        })
    }

    pub(crate) fn span(&self) -> usize {
        self.span
    }

    pub(super) fn work(&self) -> usize {
        self.orders.iter().map(|order| order.taps.len()).sum()
    }

    /// Whether strides are of 32 bytes.
    #[inline]
    fn few(&self) -> bool {
        self.span.saturating_sub(usize::from(self.on_differences)) <= FEW
    }

    pub(super) fn apply(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        let Windows { x, first, outs, .. } = windows;
        let op = self.rows(&x[first..], outs, scratch)?;
        // Few taps wait for memory, which registers of 32 bytes keep busier than those of 64 do (decision 0007).
        #[cfg(target_arch = "x86_64")]
        if self.few()
            && let Some(simd) = pulp::x86::V3::try_new()
        {
            Simd::vectorize(simd, op);
            return Ok(());
        }
        Arch::new().dispatch(op);
        Ok(())
    }

    fn rows<'a, 'o>(
        &'a self,
        x: &'a [T],
        outs: &'a mut [&'o mut [T]],
        scratch: &'a mut Scratch<T>,
    ) -> Result<Rows<'a, 'o, T>, Error> {
        if self.on_differences {
            // A rest that is shorter than a register joins the block before.
            at_least(&mut scratch.differences, BLOCK_BYTES / size_of::<T>() + 2 * T::LANES + self.span)?;
        }
        Ok(Rows { direct: self, x, outs, differences: aligned(&mut scratch.differences) })
    }
}

/// The outputs of a row, for every order.
struct Rows<'a, 'o, T> {
    direct: &'a Direct<T>,
    x: &'a [T],
    outs: &'a mut [&'o mut [T]],
    differences: &'a mut [T],
}

impl<T: Sample> WithSimd for Rows<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        run_with_strides!(self, simd);
    }
}

impl<T: Sample> Rows<'_, '_, T> {
    #[inline(always)]
    fn run<S: Simd, const W: usize>(self, simd: S) {
        let Self { direct: Direct { orders, span, on_differences }, x, outs, differences } = self;
        let outputs = outs.first().map_or(0, |out| out.len());
        for block in pieces(0..outputs, BLOCK_BYTES / size_of::<T>(), T::LANES) {
            let samples = &x[block.start..block.end + span - 1];
            let mut formed = 0;
            for piece in pieces(0..block.len(), PIECE_BYTES / size_of::<T>(), T::LANES) {
                let stream = if *on_differences {
                    let held = piece.end + span - 2;
                    difference(&samples[formed..=held], 1, &mut differences[formed..held]);
                    formed = held;
                    &differences[..held]
                } else {
                    samples
                };
                let stream = stream.get(piece.start..).unwrap_or_default();
                for (order, out) in orders.iter().zip(outs.iter_mut()) {
                    let finish = Finish::new(order, samples, 1).from(piece.start);
                    let out = &mut out[block.start + piece.start..block.start + piece.end];
                    correlate::<T, S, W>(simd, &order.taps, stream, &finish, out);
                }
            }
        }
    }
}

/// `range` in pieces of `length`; what is left joins the last one if it is shorter than `rest`.
#[inline(always)]
fn pieces(range: Range<usize>, length: usize, rest: usize) -> impl Iterator<Item = Range<usize>> {
    let mut start = range.start;
    std::iter::from_fn(move || {
        let left = range.end - start;
        let piece = start..if left < length + rest { range.end } else { start + length };
        start = piece.end;
        (!piece.is_empty()).then_some(piece)
    })
}

/// From the first cache line on that starts in `values`, if any does.
fn aligned<T>(values: &mut [T]) -> &mut [T] {
    let lead = values.as_ptr().align_offset(64);
    if lead < values.len() { &mut values[lead..] } else { values }
}

/// Differences of samples that lie `sample` elements apart.
#[inline(always)]
fn difference<T: Sample>(x: &[T], sample: usize, out: &mut [T]) {
    for ((difference, older), newer) in out.iter_mut().zip(x).zip(&x[sample..]) {
        *difference = *newer - *older;
    }
}

/// `out[i] = sum of taps[k] x[i + k]`, finished.
#[inline(always)]
fn correlate<T: Sample, S: Simd, const W: usize>(simd: S, taps: &[T], x: &[T], finish: &Finish<'_, T>, out: &mut [T]) {
    // A constant first, so that only what can be used is compiled.
    if const { size_of::<T::Register<S>>() < 16 } {
        return order::row::<T, W>(taps, x, finish, out);
    }
    if size_of_val(out) < size_of::<T::Register<S>>() {
        return order::row::<T, W>(taps, x, finish, out);
    }
    match tile::rest(taps.len(), W).0 {
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
    let width = size_of::<T::Register<S>>() / size_of::<T>();
    let mut done = tiles::<T, S, TILE, D, E, W>(simd, taps, x, finish, out, 0);
    done = tiles::<T, S, 2, D, E, W>(simd, taps, x, finish, out, done);
    done = tiles::<T, S, 1, D, E, W>(simd, taps, x, finish, out, done);
    if done < out.len() {
        // Outputs may be computed twice, as each is computed alone.
        tiles::<T, S, 1, D, E, W>(simd, taps, x, finish, out, out.len() - width);
    }
}

/// Fills as many outputs from `start` on as whole tiles of `N` registers cover, and says where they end.
#[inline(always)]
fn tiles<T: Sample, S: Simd, const N: usize, const D: usize, const E: usize, const W: usize>(
    simd: S,
    taps: &[T],
    x: &[T],
    finish: &Finish<'_, T>,
    out: &mut [T],
    start: usize,
) -> usize {
    let length = N * size_of::<T::Register<S>>() / size_of::<T>();
    let mut done = start;
    for out in out[start..].chunks_exact_mut(length) {
        // Nothing beyond the end of the stream, which without taps comes before that of the outputs.
        let x = x.get(done..).unwrap_or_default();
        tile::<T, S, N, D, E, W, false>(simd, taps, x, &finish.from(done), out);
        done += length;
    }
    done
}

#[cfg(test)]
mod tests;
