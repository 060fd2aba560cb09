//! A row along the registers: neighbouring outputs, and the moments of a block, side by side.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]
#![expect(clippy::needless_range_loop, reason = "sums stay in registers where all indices are known when compiled")]

use pulp::{Simd, WithSimd};

use super::super::Sample;
use super::design::{Order, Tables};
use super::lay::Lay;
use super::run::{Run, STEP};

/// Blocks whose moments are formed together: their sums fill the registers' pipeline.
const TOGETHER: usize = 8;

/// `V` registers hold a block of outputs; `N` blocks are computed together.
#[derive(Debug, Clone, Copy)]
struct Along<T: Sample, S: Simd, const V: usize, const N: usize> {
    simd: S,
    /// For every lane: the lanes up to it.
    masks: [T::Mask<S>; 16],
}

impl<T: Sample> WithSimd for Run<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = size_of::<T::Register<S>>() / size_of::<T>();
        let registers = self.moments.tables.shape.block / lanes;
        // As many sums as leave room for samples and taps.
        if size_of::<T::Register<S>>() == 64 {
            match registers {
                1 => self.go(Along::<T, S, 1, 8>::new(simd)),
                2 => self.go(Along::<T, S, 2, 8>::new(simd)),
                _ => self.go(Along::<T, S, 4, 4>::new(simd)),
            }
        } else if size_of::<T::Register<S>>() == 32 {
            match registers {
                2 => self.go(Along::<T, S, 2, 4>::new(simd)),
                4 => self.go(Along::<T, S, 4, 2>::new(simd)),
                _ => self.go(Along::<T, S, 8, 1>::new(simd)),
            }
        } else if size_of::<T::Register<S>>() == 16 {
            match registers {
                4 => self.go(Along::<T, S, 4, 2>::new(simd)),
                8 => self.go(Along::<T, S, 8, 1>::new(simd)),
                _ => self.go(Along::<T, S, 16, 1>::new(simd)),
            }
        } else {
            match registers {
                16 => self.go(Along::<T, S, 16, 1>::new(simd)),
                _ => self.go(Along::<T, S, 32, 1>::new(simd)),
            }
        }
    }
}

impl<T: Sample, S: Simd, const V: usize, const N: usize> Along<T, S, V, N> {
    /// Samples of a register, and of a block.
    const LANES: usize = size_of::<T::Register<S>>() / size_of::<T>();
    const BLOCK: usize = V * Self::LANES;

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

    /// Registers that the moments of a block need.
    #[inline(always)]
    fn registers(tables: &Tables<T>) -> usize {
        tables.shape.moments.div_ceil(Self::LANES)
    }

    /// Adds to the outputs of `N` blocks a row of `rows` for every value of every block, which lie `step` apart.
    #[inline(always)]
    fn add_rows(self, sums: &mut [[T::Register<S>; V]; N], rows: &[T::Register<S>], values: &[T], step: usize) {
        let mut held = *sums;
        for (at, row) in rows.chunks_exact(V).enumerate() {
            let values = &values[at..][..(N - 1) * step + 1];
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
            self.add_rows(&mut sums, T::registers::<S>(&tables.places), coefficients, tables.stride);
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

impl<T: Sample, S: Simd, const V: usize, const N: usize> Lay<T> for Along<T, S, V, N> {
    #[inline(always)]
    fn width(self, tables: &Tables<T>) -> usize {
        tables.stride
    }

    #[inline(always)]
    fn moments(self, tables: &Tables<T>, samples: &[T], moments: &mut [T]) {
        let wide = tables.stride / Self::LANES;
        let samples = &samples[..TOGETHER * Self::BLOCK];
        let basis = &T::registers::<S>(&tables.basis)[..wide * Self::BLOCK];
        let moments = &mut T::registers_mut::<S>(moments)[..TOGETHER * wide];
        for register in 0..Self::registers(tables) {
            let mut sums = [self.zero(); TOGETHER];
            for at in 0..Self::BLOCK {
                let row = basis[at * wide + register];
                let samples = &samples[at..][..(TOGETHER - 1) * Self::BLOCK + 1];
                for n in 0..TOGETHER {
                    sums[n] = self.fused(T::splat(self.simd, samples[n * Self::BLOCK]), row, sums[n]);
                }
            }
            for n in 0..TOGETHER {
                moments[n * wide + register] = sums[n];
            }
        }
    }

    #[inline(always)]
    fn product(self, tables: &Tables<T>, matrix: &[T], from: &[T], to: &mut [T]) {
        let (count, wide) = (tables.shape.moments, tables.stride / Self::LANES);
        let rows = &T::registers::<S>(matrix)[..count * wide];
        let to = &mut T::registers_mut::<S>(to)[..wide];
        for register in 0..Self::registers(tables) {
            let mut sum = to[register];
            for (row, value) in rows[register..].iter().step_by(wide).zip(from) {
                sum = self.fused(T::splat(self.simd, *value), *row, sum);
            }
            to[register] = sum;
        }
    }

    #[inline(always)]
    fn products(self, tables: &Tables<T>, matrices: &[T], from: &[T], to: &mut [T]) {
        let (stride, count, wide) = (tables.stride, tables.shape.moments, tables.stride / Self::LANES);
        let rows = &T::registers::<S>(matrices)[..STEP * count * wide];
        let to = &mut T::registers_mut::<S>(to)[..STEP * wide];
        for register in 0..Self::registers(tables) {
            let mut sums = [self.zero(); STEP];
            for n in 0..STEP {
                sums[n] = to[n * wide + register];
            }
            for d in 0..count {
                let rows = &rows[d * wide + register..][..(STEP - 1) * count * wide + 1];
                let values = &from[d..][..(STEP - 1) * stride + 1];
                for n in 0..STEP {
                    sums[n] = self.fused(T::splat(self.simd, values[n * stride]), rows[n * count * wide], sums[n]);
                }
            }
            for n in 0..STEP {
                to[n * wide + register] = sums[n];
            }
        }
    }

    #[inline(always)]
    fn run_up(self, tables: &Tables<T>, values: &[T], running: &mut [T], sums: &mut [T]) {
        let wide = tables.stride / Self::LANES;
        let (values, sums) = (T::registers::<S>(values), T::registers_mut::<S>(sums));
        for (register, running) in T::registers_mut::<S>(running).iter_mut().enumerate() {
            let mut sum = *running;
            let values = values.iter().skip(register).step_by(wide);
            for (value, to) in values.zip(sums.iter_mut().skip(register).step_by(wide)) {
                sum = T::plus(self.simd, sum, *value);
                *to = sum;
            }
            *running = sum;
        }
    }

    #[inline(always)]
    fn run_down(self, tables: &Tables<T>, values: &mut [T]) {
        let wide = tables.stride / Self::LANES;
        for register in 0..Self::registers(tables) {
            let mut sum = self.zero();
            for value in T::registers_mut::<S>(values)[register..].iter_mut().step_by(wide).rev() {
                let both = T::plus(self.simd, sum, *value);
                *value = std::mem::replace(&mut sum, both);
            }
        }
    }

    #[inline(always)]
    fn blocks(self, tables: &Tables<T>, order: &Order<T>, moments: &[T], coefficients: &mut [T]) {
        let stride = tables.stride;
        let (count, wide) = (tables.shape.moments, stride / Self::LANES);
        let rows = T::registers::<S>(&order.near);
        let coefficients = &mut T::registers_mut::<S>(coefficients)[..STEP * wide];
        for register in 0..Self::registers(tables) {
            let mut sums = [self.zero(); STEP];
            for (distance, rows) in rows.chunks_exact(count * wide).enumerate() {
                let moments = &moments[distance * stride..][..STEP * stride];
                for (d, row) in rows.chunks_exact(wide).enumerate() {
                    let moments = &moments[d..][..(STEP - 1) * stride + 1];
                    for n in 0..STEP {
                        sums[n] = self.fused(T::splat(self.simd, moments[n * stride]), row[register], sums[n]);
                    }
                }
            }
            for n in 0..STEP {
                coefficients[n * wide + register] = sums[n];
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
            let coefficients = &coefficients[tile * N * tables.stride..];
            self.tile(tables, order, [&near[at..], &far[at..]], coefficients, scale, out);
        }
    }
}
