//! Every tap of every output, in one fixed order.
//!
//! A tile of neighbouring outputs is held in registers while the taps go by. Taps come in strides of 32 bytes, four at a time: tap
//! 0 of each stride, tap 1 of each, and so on; the taps that are left come one after the other. So a register of samples
//! serves four taps, and the loads, which bound the speed, are few. Adding the two samples of equal taps first, which
//! symmetric weights would allow, saves multiplications but doubles the loads (decision 0007).
//! Multiplication and addition stay apart (no fused operation), so every CPU gives the same bits.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use super::stream::rescale;
use super::{Sample, Scratch, Taps};
use crate::error::{Error, at_least, try_vec};

/// Outputs for which differences are formed at a time: with their taps they stay in the nearest caches.
const BLOCK: usize = 4096;

/// Taps of a stride, in bytes: a register of most CPUs.
const STRIDE_BYTES: usize = 32;

/// Registers of a tile of outputs, at most: with four weights and a sample they fit into sixteen.
const TILE: usize = 8;

/// Taps that a sample is used for while it is in a register, at most.
const DEPTH: usize = 4;

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
    pub(super) fn new(orders: &[&Taps]) -> Result<Self, Error> {
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

    pub(super) fn span(&self) -> usize {
        self.span
    }

    pub(super) fn work(&self) -> usize {
        self.orders.iter().map(|order| order.taps.len()).sum()
    }

    pub(super) fn apply(
        &self,
        x: &[T],
        first: usize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        if self.on_differences {
            at_least(&mut scratch.differences, BLOCK + self.span)?;
        }
        let x = &x[first..];
        Arch::new().dispatch(Apply { direct: self, x, outs, differences: &mut scratch.differences });
        Ok(())
    }
}

/// The same for neighbouring rows.
mod lanes;

struct Apply<'a, 'o, T> {
    direct: &'a Direct<T>,
    x: &'a [T],
    outs: &'a mut [&'o mut [T]],
    differences: &'a mut [T],
}

impl<T: Sample> WithSimd for Apply<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { direct: Direct { orders, span, on_differences }, x, outs, differences } = self;
        let outputs = outs.first().map_or(0, |out| out.len());
        for start in (0..outputs).step_by(BLOCK) {
            let end = outputs.min(start + BLOCK);
            let samples = &x[start..end + span - 1];
            if !on_differences {
                for (order, out) in orders.iter().zip(outs.iter_mut()) {
                    correlate(simd, &order.taps, order.scale, samples, &mut out[start..end]);
                }
                continue;
            }
            let differences = &mut differences[..samples.len() - 1];
            for ((difference, older), newer) in differences.iter_mut().zip(samples).zip(&samples[1..]) {
                *difference = *newer - *older;
            }
            for (order, out) in orders.iter().zip(outs.iter_mut()) {
                let block = &mut out[start..end];
                correlate(simd, &order.taps, order.scale, differences, block);
                if let Some(anchor) = order.anchor {
                    block.iter_mut().zip(&samples[anchor..]).for_each(|(value, sample)| *value = *value + *sample);
                }
            }
        }
    }
}

/// `out[i] = scale * sum of taps[k] x[i + k]`.
#[inline(always)]
fn correlate<T: Sample, S: Simd>(simd: S, taps: &[T], scale: f64, x: &[T], out: &mut [T]) {
    let mut done = 0;
    if size_of::<T::Register<S>>() == STRIDE_BYTES {
        done += tiles::<T, S, TILE>(simd, taps, scale, x, out);
        done += tiles::<T, S, 2>(simd, taps, scale, after(x, done), &mut out[done..]);
        done += tiles::<T, S, 1>(simd, taps, scale, after(x, done), &mut out[done..]);
    }
    match STRIDE_BYTES / size_of::<T>() {
        4 => one_by_one::<T, 4>(taps, scale, after(x, done), &mut out[done..]),
        _ => one_by_one::<T, 8>(taps, scale, after(x, done), &mut out[done..]),
    }
}

/// The rest of the stream: nothing beyond its end, which without taps comes before that of the outputs.
#[inline(always)]
fn after<T>(x: &[T], done: usize) -> &[T] {
    x.get(done..).unwrap_or_default()
}

/// Fills as many outputs as whole tiles of `N` registers cover, and says how many.
#[inline(always)]
fn tiles<T: Sample, S: Simd, const N: usize>(simd: S, taps: &[T], scale: f64, x: &[T], out: &mut [T]) -> usize {
    let width = STRIDE_BYTES / size_of::<T>();
    let mut done = 0;
    for tile in out.chunks_exact_mut(N * width) {
        let mut sums = [T::splat(simd, T::default()); N];
        let mut x = &x[done..];
        let mut deep = taps.chunks_exact(DEPTH * width);
        for taps in &mut deep {
            strides::<T, S, N, DEPTH>(simd, &mut sums, taps, x);
            x = &x[DEPTH * width..];
        }
        let mut flat = deep.remainder().chunks_exact(width);
        for taps in &mut flat {
            strides::<T, S, N, 1>(simd, &mut sums, taps, x);
            x = &x[width..];
        }
        for (at, tap) in flat.remainder().iter().enumerate() {
            let tap = T::splat(simd, *tap);
            for (sum, samples) in sums.iter_mut().zip(x[at..].chunks_exact(width)) {
                *sum = T::plus(simd, *sum, T::times(simd, tap, T::registers::<S>(samples)[0]));
            }
        }
        for (values, sum) in tile.chunks_exact_mut(width).zip(sums) {
            T::registers_mut::<S>(values)[0] = sum;
        }
        rescale(tile, scale);
        done += N * width;
    }
    done
}

/// Adds `D` strides of taps: of tap r of every stride, then of tap r + 1 of every stride.
#[inline(always)]
fn strides<T: Sample, S: Simd, const N: usize, const D: usize>(
    simd: S,
    sums: &mut [T::Register<S>; N],
    taps: &[T],
    x: &[T],
) {
    let width = STRIDE_BYTES / size_of::<T>();
    let (taps, x) = (&taps[..D * width], &x[..(N + D) * width - 1]);
    let mut held = *sums;
    for place in 0..width {
        let mut weights = [T::splat(simd, T::default()); D];
        for (stride, weight) in weights.iter_mut().enumerate() {
            *weight = T::splat(simd, taps[stride * width + place]);
        }
        // A register of samples meets one tap of every stride, each for another register of outputs.
        for (at, samples) in x[place..].chunks_exact(width).take(N + D - 1).enumerate() {
            let samples = T::registers::<S>(samples)[0];
            for stride in 0..D {
                if at >= stride && at - stride < N {
                    let sum = &mut held[at - stride];
                    *sum = T::plus(simd, *sum, T::times(simd, weights[stride], samples));
                }
            }
        }
    }
    *sums = held;
}

/// The same sums in the same order, for CPUs with other registers and for what is left.
#[inline(always)]
fn one_by_one<T: Sample, const W: usize>(taps: &[T], scale: f64, x: &[T], out: &mut [T]) {
    let mut lanes = out.chunks_exact_mut(W);
    let mut done = 0;
    for out in &mut lanes {
        let mut sums = [T::default(); W];
        in_order(taps, W, |k| {
            for (sum, sample) in sums.iter_mut().zip(&x[done + k..done + k + W]) {
                *sum = *sum + taps[k] * *sample;
            }
        });
        out.copy_from_slice(&sums);
        rescale(out, scale);
        done += W;
    }
    for out in lanes.into_remainder() {
        let mut sum = T::default();
        in_order(taps, W, |k| sum = sum + taps[k] * x[done + k]);
        *out = sum;
        rescale(std::slice::from_mut(out), scale);
        done += 1;
    }
}

/// Calls with the index of every tap, in the order in which they are added.
#[inline(always)]
fn in_order<T>(taps: &[T], width: usize, mut add: impl FnMut(usize)) {
    let (deep, flat) = (taps.len() / (DEPTH * width) * (DEPTH * width), taps.len());
    for start in (0..deep).step_by(DEPTH * width) {
        for place in 0..width {
            for stride in 0..DEPTH {
                add(start + stride * width + place);
            }
        }
    }
    (deep..flat).for_each(add);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(length: usize) -> Vec<f64> {
        // A linear congruential generator: seeded, and rough enough to show any shift.
        let mut state = 12_345_u64;
        let step = |state: &mut u64| {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..length).map(|_| step(&mut state)).collect()
    }

    fn run(taps: &Taps, x: &[f64]) -> Vec<f64> {
        let mut out = vec![f64::NAN; x.len() + 1 - taps.span()];
        let direct = Direct::new(&[taps]).expect("small");
        direct.apply(x, 0, &mut [&mut out], &mut Scratch::default()).expect("small");
        out
    }

    #[test]
    fn agrees_with_the_plain_sum() {
        for (length, outputs) in [(1, 1), (2, 7), (5, 33), (61, 4096), (61, 4097), (200, 5000)] {
            let weights = signal(length);
            let x = signal(length + outputs - 1);
            let out = run(&Taps::plain(&weights).expect("small"), &x);
            for (i, value) in out.iter().enumerate() {
                let expected: f64 = weights.iter().zip(&x[i..]).map(|(w, x)| w * x).sum();
                assert!((value - expected).abs() <= 1e-16 * (length * length) as f64, "{length} {outputs} {i}");
            }
        }
    }

    #[test]
    fn differences_agree_with_the_plain_sum_and_forget_the_offset() {
        for length in [2, 3, 8, 61] {
            let mut weights = signal(length);
            let mean = weights.iter().sum::<f64>() / length as f64;
            weights.iter_mut().for_each(|w| *w -= mean);
            let taps = Taps::on_differences(&weights, None).expect("small");
            assert_eq!(taps.span(), length);
            let x = signal(300);
            let out = run(&taps, &x);
            for (i, value) in out.iter().enumerate() {
                let expected: f64 = weights.iter().zip(&x[i..]).map(|(w, x)| w * x).sum();
                assert!((value - expected).abs() <= 1e-16 * (length * length) as f64);
            }
            assert!(run(&taps, &vec![1e300; 300]).iter().all(|value| *value == 0.0));
        }
    }

    #[test]
    fn an_anchored_smoother_agrees_and_keeps_constants() {
        for (length, anchor) in [(1, 0), (2, 1), (5, 0), (5, 4), (37, 20)] {
            let mut weights = signal(length);
            let excess = (weights.iter().sum::<f64>() - 1.0) / length as f64;
            weights.iter_mut().for_each(|w| *w -= excess);
            let taps = Taps::on_differences(&weights, Some(anchor)).expect("small");
            assert_eq!(taps.span(), length);
            let x = signal(300);
            for (i, value) in run(&taps, &x).iter().enumerate() {
                let expected: f64 = weights.iter().zip(&x[i..]).map(|(w, x)| w * x).sum();
                assert!((value - expected).abs() <= 1e-16 * (length * length + 4) as f64, "{length} {anchor}");
            }
            assert!(run(&taps, &vec![1.1; 300]).iter().all(|value| *value == 1.1));
        }
    }

    #[test]
    fn any_cut_gives_the_same_bits() {
        let weights = signal(37);
        let x = signal(9000);
        for taps in [Taps::plain(&weights).expect("small"), Taps::on_differences(&weights, None).expect("small")] {
            let whole = run(&taps, &x);
            for cut in [1, 7, 31, 32, 33, 4000, 4096, 4100] {
                let (left, right) = (run(&taps, &x[..cut + 36]), run(&taps, &x[cut..]));
                assert!(left.iter().chain(&right).map(|v| v.to_bits()).eq(whole.iter().map(|v| v.to_bits())));
            }
        }
    }
}
