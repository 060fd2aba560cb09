//! A row along the registers: neighbouring outputs, and the moments of a block, side by side.

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
use super::design::{BLOCKS, Order, Tables};
use super::lay::Lay;
use super::run::{FEW, Run};

/// `V` registers hold a block of outputs, `W` the moments of a block; `N` blocks are computed together.
#[derive(Debug, Clone, Copy)]
struct Along<T: Sample, S: Simd, const V: usize, const W: usize, const N: usize> {
    simd: S,
    /// For every lane: the lanes up to it.
    masks: [T::Mask<S>; 16],
}

impl<T: Sample> WithSimd for Run<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let tables = &self.moments.tables;
        let (short, narrow) = (tables.shape.block == BLOCKS[0], tables.stride == T::LANES);
        macro_rules! go {
            (($v:literal, $n:literal), $w:literal) => {
                self.go(Along::<T, S, $v, $w, $n>::new(simd))
            };
        }
        // For registers of so many bytes: those of a block and how many blocks leave room for samples and taps; and those of
        // the moments. Conditions on types come first, as constants, so that only what can be used is compiled.
        macro_rules! pick {
            ($short:tt, $long:tt, $w:tt) => {
                if short { go!($short, $w) } else { go!($long, $w) }
            };
            ($short:tt, $long:tt, $narrow:tt, $wide:tt) => {
                if narrow { pick!($short, $long, $narrow) } else { pick!($short, $long, $wide) }
            };
        }
        if const { size_of::<T>() == 8 } {
            match const { size_of::<T::Register<S>>() } {
                64 => pick!((2, 8), (4, 4), 1, 2),
                32 => pick!((4, 2), (8, 1), 2, 4),
                16 => pick!((8, 1), (16, 1), 4, 8),
                _ => pick!((16, 1), (32, 1), 8, 16),
            }
        } else {
            // The most moments fit into 64 bytes.
            match const { size_of::<T::Register<S>>() } {
                64 => pick!((1, 8), (2, 8), 1),
                32 => pick!((2, 4), (4, 2), 2),
                16 => pick!((4, 2), (8, 1), 4),
                _ => pick!((16, 1), (32, 1), 16),
            }
        }
    }
}

impl<T: Sample, S: Simd, const V: usize, const W: usize, const N: usize> Along<T, S, V, W, N> {
    /// Samples of a register, and of a block.
    const LANES: usize = size_of::<T::Register<S>>() / size_of::<T>();
    const BLOCK: usize = V * Self::LANES;
    /// Elements of the moments of a block.
    const WIDTH: usize = W * Self::LANES;

    #[inline(always)]
    fn new(simd: S) -> Self {
        let mut masks = [T::up_to(simd, 0); 16];
        masks.iter_mut().enumerate().for_each(|(lane, mask)| *mask = T::up_to(simd, lane));
        Self { simd, masks }
    }

    #[inline(always)]
    fn zero(self) -> T::Register<S> {
        T::splat(self.simd, T::default())
    }

    /// `sum + value row` in every lane.
    #[inline(always)]
    fn fused(self, value: T::Register<S>, row: T::Register<S>, sum: T::Register<S>) -> T::Register<S> {
        T::fused(self.simd, value, row, sum)
    }

    /// Registers that the moments of a block fill.
    #[inline(always)]
    fn registers(tables: &Tables<T>) -> usize {
        tables.shape.moments.div_ceil(Self::LANES).min(W)
    }

    /// Adds to the outputs of `N` blocks a row of `rows` for every value of every block, which lie `step` apart.
    #[inline(always)]
    fn add_rows(self, sums: &mut [[T::Register<S>; V]; N], rows: &[T::Register<S>], values: &[T], step: usize) {
        let mut held = *sums;
        for (at, row) in rows.chunks_exact(V).enumerate() {
            let values = &values[at..][..=(N - 1) * step];
            for n in 0..N {
                let value = T::splat(self.simd, values[n * step]);
                for v in 0..V {
                    held[n][v] = self.fused(value, row[v], held[n][v]);
                }
            }
        }
        *sums = held;
    }

    /// Adds the samples of a register's worth of steps: in every step the outputs of register `middle` go over, lane by lane,
    /// from samples after their whole blocks to samples of their own block; those before have done so, those after not yet.
    #[inline(always)]
    fn go_over(
        self,
        sums: &mut [[T::Register<S>; V]; N],
        rows: &[T::Register<S>],
        [near, far]: [&[T]; 2],
        middle: usize,
    ) {
        let mut held = *sums;
        let most = (N - 1) * Self::BLOCK + 1;
        for (lane, mask) in self.masks.iter().take(Self::LANES).enumerate() {
            let at = middle * Self::LANES + lane;
            let row = &rows[at * V..][..V];
            let (near, far) = (&near[at..][..most], &far[at..][..most]);
            for n in 0..N {
                let near = T::splat(self.simd, near[n * Self::BLOCK]);
                let far = T::splat(self.simd, far[n * Self::BLOCK]);
                for v in 0..middle {
                    held[n][v] = self.fused(near, row[v], held[n][v]);
                }
                let both = T::choose(self.simd, *mask, near, far);
                held[n][middle] = self.fused(both, row[middle], held[n][middle]);
                for v in middle + 1..V {
                    held[n][v] = self.fused(far, row[v], held[n][v]);
                }
            }
        }
        *sums = held;
    }

    /// The outputs of `N` blocks.
    #[inline(always)]
    fn tile(
        self,
        tables: &Tables<T>,
        order: &Order<T>,
        [near, far]: [&[T]; 2],
        coefficients: &[T],
        scale: T,
        out: &mut [T],
    ) {
        let mut sums = [[self.zero(); V]; N];
        if tables.shape.whole > 0 {
            self.add_rows(&mut sums, T::registers::<S>(&tables.places), coefficients, Self::WIDTH);
        }
        self.add_rows(&mut sums, T::registers::<S>(&order.rest), far, Self::BLOCK);
        let (near, far) = (&near[..N * Self::BLOCK], &far[tables.shape.reach..][..N * Self::BLOCK]);
        let rows = T::registers::<S>(&order.ring);
        // One by one, so that the compiler knows which registers go over.
        macro_rules! in_turn {
            ($($middle:literal)*) => {
                $(if $middle < V { self.go_over(&mut sums, rows, [near, far], $middle); })*
            };
        }
        in_turn!(0 1 2 3 4 5 6 7);
        for middle in 8..V {
            self.go_over(&mut sums, rows, [near, far], middle);
        }
        let scale = T::splat(self.simd, scale);
        let out = T::registers_mut::<S>(&mut out[..N * Self::BLOCK]);
        for (out, sum) in out.iter_mut().zip(sums.as_flattened()) {
            *out = T::times(self.simd, scale, *sum);
        }
    }
}

impl<T: Sample, S: Simd, const V: usize, const W: usize, const N: usize> Lay<T> for Along<T, S, V, W, N> {
    const UNIT: usize = 1;
    const TOGETHER: usize = N;

    #[inline(always)]
    fn width(self, _tables: &Tables<T>) -> usize {
        Self::WIDTH
    }

    #[inline(always)]
    fn moments(self, tables: &Tables<T>, samples: &[T], moments: &mut [T]) {
        let basis = T::registers::<S>(&tables.basis);
        let few = samples.chunks_exact(FEW * Self::BLOCK);
        for (samples, moments) in few.zip(T::registers_mut::<S>(moments).chunks_exact_mut(FEW * W)) {
            for register in 0..Self::registers(tables) {
                let mut sums = [self.zero(); FEW];
                for (at, row) in basis.chunks_exact(W).enumerate().take(Self::BLOCK) {
                    for n in 0..FEW {
                        let sample = T::splat(self.simd, samples[n * Self::BLOCK + at]);
                        sums[n] = self.fused(sample, row[register], sums[n]);
                    }
                }
                for n in 0..FEW {
                    moments[n * W + register] = sums[n];
                }
            }
        }
    }

    #[inline(always)]
    fn product(self, tables: &Tables<T>, matrix: &[T], from: &[T], to: &mut [T]) {
        let rows = T::registers::<S>(matrix).chunks_exact(W);
        let to = &mut T::registers_mut::<S>(to)[..W];
        for (row, value) in rows.zip(&from[..tables.shape.moments]) {
            let value = T::splat(self.simd, *value);
            for register in 0..W {
                to[register] = self.fused(value, row[register], to[register]);
            }
        }
    }

    #[inline(always)]
    fn products(self, tables: &Tables<T>, matrices: &[T], from: &[T], to: &mut [T], add: bool) {
        let count = tables.shape.moments.min(Self::WIDTH);
        let mut matrices = T::registers::<S>(matrices);
        let few = from.chunks_exact(FEW * Self::WIDTH);
        for (from, to) in few.zip(T::registers_mut::<S>(to).chunks_exact_mut(FEW * W)) {
            let (rows, rest) = matrices.split_at(count * FEW * W);
            matrices = rest;
            for register in 0..Self::registers(tables) {
                let mut sums = [self.zero(); FEW];
                if add {
                    for n in 0..FEW {
                        sums[n] = to[n * W + register];
                    }
                }
                for (d, rows) in rows.chunks_exact(FEW * W).enumerate().take(Self::WIDTH) {
                    for n in 0..FEW {
                        let value = T::splat(self.simd, from[n * Self::WIDTH + d]);
                        sums[n] = self.fused(value, rows[n * W + register], sums[n]);
                    }
                }
                for n in 0..FEW {
                    to[n * W + register] = sums[n];
                }
            }
        }
    }

    #[inline(always)]
    fn repeat(self, _tables: &Tables<T>, from: Option<&[T]>, to: &mut [T]) {
        let mut held = [self.zero(); W];
        if let Some(from) = from {
            held.copy_from_slice(&T::registers::<S>(from)[..W]);
        }
        for to in T::registers_mut::<S>(to).chunks_exact_mut(W) {
            to.copy_from_slice(&held);
        }
    }

    #[inline(always)]
    fn run_up(self, _tables: &Tables<T>, values: &[T], copy: &mut [T], running: &mut [T], sums: &mut [T]) {
        let running = &mut T::registers_mut::<S>(running)[..W];
        let mut held = [self.zero(); W];
        held.copy_from_slice(running);
        let (copy, sums) = (T::registers_mut::<S>(copy), T::registers_mut::<S>(sums));
        let to = copy.chunks_exact_mut(W).zip(sums.chunks_exact_mut(W));
        for ((copy, sums), values) in to.zip(T::registers::<S>(values).chunks_exact(W)) {
            for register in 0..W {
                copy[register] = values[register];
                held[register] = T::plus(self.simd, held[register], values[register]);
                sums[register] = held[register];
            }
        }
        running.copy_from_slice(&held);
    }

    #[inline(always)]
    fn run_down(self, _tables: &Tables<T>, values: &mut [T]) {
        let mut held = [self.zero(); W];
        for values in T::registers_mut::<S>(values).chunks_exact_mut(W).rev() {
            for register in 0..W {
                let both = T::plus(self.simd, held[register], values[register]);
                values[register] = std::mem::replace(&mut held[register], both);
            }
        }
    }

    #[inline(always)]
    fn blocks(self, tables: &Tables<T>, order: &Order<T>, moments: &[T], coefficients: &mut [T]) {
        let (count, matrices) = (tables.shape.moments.min(Self::WIDTH), T::registers::<S>(&order.near));
        let few = T::registers_mut::<S>(coefficients).chunks_exact_mut(FEW * W);
        for (number, coefficients) in few.enumerate() {
            let moments = &moments[number * FEW * Self::WIDTH..];
            for register in 0..Self::registers(tables) {
                let mut sums = [self.zero(); FEW];
                for distance in 0..tables.shape.whole {
                    let moments = &moments[distance * Self::WIDTH..][..FEW * Self::WIDTH];
                    let rows = &matrices[distance * count * W..][..count * W];
                    for (d, row) in rows.chunks_exact(W).enumerate().take(Self::WIDTH) {
                        for n in 0..FEW {
                            let moment = T::splat(self.simd, moments[n * Self::WIDTH + d]);
                            sums[n] = self.fused(moment, row[register], sums[n]);
                        }
                    }
                }
                for n in 0..FEW {
                    coefficients[n * W + register] = sums[n];
                }
            }
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
        for (tile, out) in out.chunks_exact_mut(N * Self::BLOCK).enumerate() {
            let at = tile * N * Self::BLOCK;
            let coefficients = &coefficients[tile * N * Self::WIDTH..];
            self.tile(tables, order, [&near[at..], &far[at..]], coefficients, scale, out);
        }
    }
}
