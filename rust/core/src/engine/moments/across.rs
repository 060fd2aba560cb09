//! Neighbouring rows across the registers: every sample, moment and output is a place of 64 bytes, a row in each lane.

#![expect(
    clippy::indexing_slicing,
    reason = "matrices, moments and tiles have the sizes that the shape gives all of them"
)]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Simd, WithSimd};

use super::super::Sample;
use super::design::{Order, Tables};
use super::lay::Lay;
use super::run::{FEW, Run};

/// The lanes of one place, in `R` registers.
type Lanes<T, S, const R: usize> = [<T as Sample>::Register<S>; R];

/// Places of `R` registers; `N` outputs are computed together.
#[derive(Debug, Clone, Copy)]
struct Across<T: Sample, S: Simd, const R: usize, const N: usize> {
    simd: S,
    zero: Lanes<T, S, R>,
}

/// The same run on neighbouring rows.
pub struct Rows<'a, 'o, T: Sample>(pub Run<'a, 'o, T>);

impl<T: Sample> WithSimd for Rows<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // A constant, so that only what can be used is compiled.
        match const { 64 / size_of::<T::Register<S>>() } {
            1 => self.0.go(Across::<T, S, 1, 8>::new(simd)),
            2 => self.0.go(Across::<T, S, 2, 4>::new(simd)),
            4 => self.0.go(Across::<T, S, 4, 4>::new(simd)),
            8 => self.0.go(Across::<T, S, 8, 4>::new(simd)),
            _ => self.0.go(Across::<T, S, 16, 4>::new(simd)),
        }
    }
}

#[inline(always)]
fn load<T: Sample, S: Simd, const R: usize>(values: &[T]) -> Lanes<T, S, R> {
    let registers = T::registers::<S>(&values[..T::LANES]);
    let mut lanes = [registers[0]; R];
    lanes.copy_from_slice(&registers[..R]);
    lanes
}

#[inline(always)]
fn store<T: Sample, S: Simd, const R: usize>(lanes: &Lanes<T, S, R>, values: &mut [T]) {
    T::registers_mut::<S>(&mut values[..T::LANES]).copy_from_slice(lanes);
}

/// Runs the body for `$count` results, up to six at a time, whose sums fit into registers.
macro_rules! by_parts {
    ($count:expr, |$first:ident, $q:ident| $body:block) => {
        let mut $first = 0;
        for part in (1..=usize::div_ceil($count, 6)).rev() {
            let width = ($count - $first).div_ceil(part);
            match width {
                1 => {
                    const $q: usize = 1;
                    $body
                }
                2 => {
                    const $q: usize = 2;
                    $body
                }
                3 => {
                    const $q: usize = 3;
                    $body
                }
                4 => {
                    const $q: usize = 4;
                    $body
                }
                5 => {
                    const $q: usize = 5;
                    $body
                }
                _ => {
                    const $q: usize = 6;
                    $body
                }
            }
            $first += width;
        }
    };
}

impl<T: Sample, S: Simd, const R: usize, const N: usize> Across<T, S, R, N> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        Self { simd, zero: [T::splat(simd, T::default()); R] }
    }

    /// Adds `weight * lanes`.
    #[inline(always)]
    fn add_to(self, sum: &mut Lanes<T, S, R>, weight: T, lanes: &Lanes<T, S, R>) {
        let weight = T::splat(self.simd, weight);
        for (sum, lane) in sum.iter_mut().zip(lanes) {
            *sum = T::fused(self.simd, weight, *lane, *sum);
        }
    }

    /// Adds `row[q] * input` for every place of `inputs` and its row.
    #[inline(always)]
    fn combine<'a, const Q: usize>(
        self,
        sums: &mut [Lanes<T, S, R>; Q],
        inputs: &[T],
        rows: impl Iterator<Item = &'a [T]>,
    ) where
        T: 'a,
    {
        let mut held = *sums;
        for (input, row) in inputs.chunks_exact(T::LANES).zip(rows) {
            let lanes = load::<T, S, R>(input);
            for (sum, weight) in held.iter_mut().zip(&row[..Q]) {
                self.add_to(sum, *weight, &lanes);
            }
        }
        *sums = held;
    }

    /// Samples that all outputs of a tile use, each with the taps of their windows.
    #[inline(always)]
    fn slide(self, sums: &mut [Lanes<T, S, R>; N], taps: &[T], samples: &[T]) {
        for (sample, window) in samples.chunks_exact(T::LANES).zip(taps.windows(N)) {
            let lanes = load::<T, S, R>(sample);
            for p in 0..N {
                self.add_to(&mut sums[p], window[N - 1 - p], &lanes);
            }
        }
    }

    /// What the samples to the end of the block add: output p starts at sample p.
    #[inline(always)]
    fn beginnings(self, sums: &mut [Lanes<T, S, R>; N], taps: &[T], samples: &[T]) {
        let (first, rest) = samples.split_at(N * T::LANES);
        let mut held = *sums;
        for k in 0..N {
            let lanes = load::<T, S, R>(&first[k * T::LANES..]);
            for p in 0..=k {
                self.add_to(&mut held[p], taps[k - p], &lanes);
            }
        }
        self.slide(&mut held, &taps[1..], rest);
        *sums = held;
    }

    /// What the last samples add: the window of output p ends with `length + p` of them; `taps` are the last ones, as many
    /// as the longest of these ends holds.
    #[inline(always)]
    fn ends(self, sums: &mut [Lanes<T, S, R>; N], taps: &[T], samples: &[T], length: usize) {
        let (rest, last) = samples.split_at(length * T::LANES);
        let mut held = *sums;
        self.slide(&mut held, taps, rest);
        let taps = &taps[length..length + N - 1];
        for k in 0..N - 1 {
            let lanes = load::<T, S, R>(&last[k * T::LANES..]);
            for p in k + 1..N {
                self.add_to(&mut held[p], taps[N - 1 + k - p], &lanes);
            }
        }
        *sums = held;
    }

    /// Adds what the moments of one block, or group, add to the coefficients from number `first` on; the rows of the matrix are
    /// `step` apart.
    #[inline(always)]
    fn apply<const Q: usize>(
        self,
        tables: &Tables<T>,
        sums: &mut [Lanes<T, S, R>; Q],
        (matrix, step): (&[T], usize),
        from: &[T],
        first: usize,
    ) {
        let rows = matrix[first..].chunks(step);
        self.combine(sums, &from[..tables.shape.moments * T::LANES], rows);
    }
}

impl<T: Sample, S: Simd, const R: usize, const N: usize> Across<T, S, R, N> {
    /// `to = matrix from`, or `to += matrix from`.
    #[inline(always)]
    fn one(self, tables: &Tables<T>, matrix: (&[T], usize), from: &[T], to: &mut [T], add: bool) {
        by_parts!(tables.shape.moments, |first, Q| {
            let to = &mut to[first * T::LANES..];
            let mut sums = [self.zero; Q];
            if add {
                for (sum, to) in sums.iter_mut().zip(to.chunks_exact(T::LANES)) {
                    *sum = load::<T, S, R>(to);
                }
            }
            self.apply(tables, &mut sums, matrix, from, first);
            put::<T, S, R>(&sums, to);
        });
    }
}

impl<T: Sample, S: Simd, const R: usize, const N: usize> Lay<T> for Across<T, S, R, N> {
    const UNIT: usize = T::LANES;
    const TOGETHER: usize = 1;

    #[inline(always)]
    fn width(self, tables: &Tables<T>) -> usize {
        tables.shape.moments * T::LANES
    }

    #[inline(always)]
    fn moments(self, tables: &Tables<T>, samples: &[T], moments: &mut [T]) {
        let (block, count) = (tables.shape.block * T::LANES, tables.shape.moments);
        for (samples, moments) in samples.chunks_exact(block).zip(moments.chunks_exact_mut(count * T::LANES)) {
            by_parts!(count, |first, Q| {
                let mut sums = [self.zero; Q];
                let rows = tables.basis.chunks_exact(tables.stride).map(|row| &row[first..]);
                self.combine(&mut sums, samples, rows);
                put::<T, S, R>(&sums, &mut moments[first * T::LANES..]);
            });
        }
    }

    #[inline(always)]
    fn product(self, tables: &Tables<T>, matrix: &[T], from: &[T], to: &mut [T]) {
        self.one(tables, (matrix, tables.stride), from, to, true);
    }

    #[inline(always)]
    fn products(self, tables: &Tables<T>, matrices: &[T], from: &[T], to: &mut [T], add: bool) {
        let (width, stride) = (self.width(tables), tables.stride);
        for (n, (from, to)) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)).enumerate() {
            let matrix = &matrices[(n / FEW * FEW * tables.shape.moments + n % FEW) * stride..];
            self.one(tables, (matrix, FEW * stride), from, to, add);
        }
    }

    #[inline(always)]
    fn repeat(self, tables: &Tables<T>, from: Option<&[T]>, to: &mut [T]) {
        for to in to.chunks_exact_mut(self.width(tables)) {
            match from {
                Some(from) => to.copy_from_slice(from),
                None => to.fill(T::default()),
            }
        }
    }

    #[inline(always)]
    fn run_up(self, _tables: &Tables<T>, values: &[T], copy: &mut [T], running: &mut [T], sums: &mut [T]) {
        copy.copy_from_slice(values);
        let width = running.len();
        for (values, sums) in values.chunks_exact(width).zip(sums.chunks_exact_mut(width)) {
            for ((running, value), sum) in running.iter_mut().zip(values).zip(sums) {
                *running = *running + *value;
                *sum = *running;
            }
        }
    }

    #[inline(always)]
    fn run_down(self, tables: &Tables<T>, values: &mut [T]) {
        let width = self.width(tables) / T::LANES * R;
        let values = T::registers_mut::<S>(values);
        for column in 0..width {
            let mut sum = self.zero[0];
            for value in values[column..].iter_mut().step_by(width).rev() {
                let both = T::plus(self.simd, sum, *value);
                *value = std::mem::replace(&mut sum, both);
            }
        }
    }

    #[inline(always)]
    fn blocks(self, tables: &Tables<T>, order: &Order<T>, moments: &[T], coefficients: &mut [T]) {
        let count = tables.shape.moments;
        let width = count * T::LANES;
        for (block, coefficients) in coefficients.chunks_exact_mut(width).enumerate() {
            let moments = &moments[block * width..];
            by_parts!(count, |first, Q| {
                let mut sums = [self.zero; Q];
                for (matrix, from) in order.near.chunks_exact(count * tables.stride).zip(moments.chunks_exact(width)) {
                    self.apply(tables, &mut sums, (matrix, tables.stride), from, first);
                }
                put::<T, S, R>(&sums, &mut coefficients[first * T::LANES..]);
            });
        }
    }

    #[inline(always)]
    fn outputs(
        self,
        tables: &Tables<T>,
        order: &Order<T>,
        [near, far]: [&[T]; 2],
        coefficients: &[T],
        scale: T,
        out: &mut [T],
    ) {
        let shape = tables.shape;
        let (length, width) = (shape.block * T::LANES, shape.moments * T::LANES);
        let counted = if shape.whole > 0 { width } else { 0 };
        for (block, out) in out.chunks_exact_mut(length).enumerate() {
            let coefficients = &coefficients[block * width..][..counted];
            let (near, far) = (&near[block * length..][..length], &far[block * length..]);
            for (start, out) in (0..).step_by(N).zip(out.chunks_exact_mut(N * T::LANES)) {
                let mut sums = [self.zero; N];
                let rows = tables.places.chunks_exact(shape.block).map(|row| &row[start..]);
                self.combine(&mut sums, coefficients, rows);
                let samples = shape.reach + start;
                self.ends(&mut sums, &order.taps[shape.taps - samples - (N - 1)..], far, samples);
                self.beginnings(&mut sums, &order.taps, &near[start * T::LANES..]);
                let scale = T::splat(self.simd, scale);
                let sums = sums.as_flattened();
                for (out, sum) in T::registers_mut::<S>(out).iter_mut().zip(sums) {
                    *out = T::times(self.simd, scale, *sum);
                }
            }
        }
    }
}

/// Stores sums, place after place.
#[inline(always)]
fn put<T: Sample, S: Simd, const R: usize>(sums: &[Lanes<T, S, R>], to: &mut [T]) {
    for (sum, to) in sums.iter().zip(to.chunks_exact_mut(T::LANES)) {
        store::<T, S, R>(sum, to);
    }
}
