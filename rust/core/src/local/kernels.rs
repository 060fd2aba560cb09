//! The sums and products of a [`Sheet`], in the registers of the CPU.

#![expect(clippy::indexing_slicing, reason = "kernels and the places where they are known have the same lengths")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use super::{Block, SIDE, Sheet, VANISHES};

pub(super) struct Orthonormalise<'a>(pub &'a mut Sheet);

impl WithSimd for Orthonormalise<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let sheet = self.0;
        let (blocks, size) = (sheet.blocks, sheet.degree + 1);
        let places = registers::<S>(&sheet.places[..blocks]);
        let weights = registers::<S>(&sheet.weights[..blocks]);
        for (root, weight) in registers_mut::<S>(&mut sheet.root[..blocks]).iter_mut().zip(weights) {
            *root = simd.sqrt_f64s(*weight);
        }
        let root = registers::<S>(&sheet.root[..blocks]);
        let mass = product(simd, root, root);
        if !mass.is_finite() || mass <= 0.0 {
            return false;
        }
        sheet.norms[0] = mass.sqrt();
        let first = registers_mut::<S>(&mut sheet.basis[..blocks]);
        let factor = simd.splat_f64s(1.0 / sheet.norms[0]);
        for (to, root) in first.iter_mut().zip(root) {
            *to = simd.mul_f64s(factor, *root);
        }
        for m in 0..sheet.degree {
            let (done, rest) = sheet.basis.split_at_mut((m + 1) * blocks);
            let next = registers_mut::<S>(&mut rest[..blocks]);
            let h = &mut sheet.recurrence[m * size..][..=m];
            h.fill(0.0);
            let current = registers::<S>(&done[m * blocks..]);
            h[m] = shifted(simd, next, current, places);
            if m > 0 {
                h[m - 1] = sheet.norms[m];
                let before = registers::<S>(&done[(m - 1) * blocks..][..blocks]);
                let _ = subtract(simd, next, [current, before], [h[m], h[m - 1]]);
            } else {
                let _ = subtract(simd, next, [current], [h[m]]);
            }
            let norm = orthogonalise(simd, next, done, blocks, &mut sheet.rest[..=m]).sqrt();
            h.iter_mut().zip(&sheet.rest).for_each(|(h, rest)| *h += rest);
            if norm.is_nan() || norm <= VANISHES {
                return false;
            }
            sheet.norms[m + 1] = norm;
            let factor = simd.splat_f64s(1.0 / norm);
            for next in next {
                *next = simd.mul_f64s(*next, factor);
            }
        }
        true
    }
}

/// `next = u q`; returns the sum of `next q`.
#[inline(always)]
fn shifted<S: Simd>(simd: S, next: &mut [S::f64s], q: &[S::f64s], u: &[S::f64s]) -> f64 {
    let mut sum = simd.splat_f64s(0.0);
    for ((next, q), u) in next.iter_mut().zip(q).zip(u) {
        *next = simd.mul_f64s(*q, *u);
        sum = simd.mul_add_e_f64s(*next, *q, sum);
    }
    simd.reduce_sum_f64s(sum)
}

/// Takes out of `next` what it shares with the columns `done`, says how much of each, and returns the square of its norm.
#[inline(always)]
fn orthogonalise<S: Simd>(simd: S, next: &mut [S::f64s], done: &[Block], blocks: usize, rest: &mut [f64]) -> f64 {
    let groups = done.chunks(4 * blocks).zip(rest.chunks_mut(4));
    for (columns, rest) in groups {
        match rest.len() {
            1 => rest.copy_from_slice(&products::<S, 1>(simd, next, columns, blocks)),
            2 => rest.copy_from_slice(&products::<S, 2>(simd, next, columns, blocks)),
            3 => rest.copy_from_slice(&products::<S, 3>(simd, next, columns, blocks)),
            _ => rest.copy_from_slice(&products::<S, 4>(simd, next, columns, blocks)),
        }
    }
    let mut square = 0.0;
    for (columns, rest) in done.chunks(4 * blocks).zip(rest.chunks(4)) {
        square = match *rest {
            [a] => subtract(simd, next, split::<S, 1>(columns, blocks), [a]),
            [a, b] => subtract(simd, next, split::<S, 2>(columns, blocks), [a, b]),
            [a, b, c] => subtract(simd, next, split::<S, 3>(columns, blocks), [a, b, c]),
            [a, b, c, d, ..] => subtract(simd, next, split::<S, 4>(columns, blocks), [a, b, c, d]),
            [] => square,
        };
    }
    square
}

/// The first `N` columns.
#[inline(always)]
fn split<S: Simd, const N: usize>(columns: &[Block], blocks: usize) -> [&[S::f64s]; N] {
    let mut each = [registers::<S>(&columns[..blocks]); N];
    for (n, each) in each.iter_mut().enumerate() {
        *each = registers::<S>(&columns[n * blocks..][..blocks]);
    }
    each
}

/// The sums of the products of `next` with each of `N` columns.
#[inline(always)]
fn products<S: Simd, const N: usize>(simd: S, next: &[S::f64s], columns: &[Block], blocks: usize) -> [f64; N] {
    let mut columns = split::<S, N>(columns, blocks);
    for column in &mut columns {
        *column = &column[..next.len()];
    }
    let mut sums = [simd.splat_f64s(0.0); N];
    for (k, next) in next.iter().enumerate() {
        for n in 0..N {
            sums[n] = simd.mul_add_e_f64s(*next, columns[n][k], sums[n]);
        }
    }
    let mut results = [0.0; N];
    for n in 0..N {
        results[n] = simd.reduce_sum_f64s(sums[n]);
    }
    results
}

/// `next -= sum of factors columns`; returns the square of its norm.
#[inline(always)]
fn subtract<S: Simd, const N: usize>(
    simd: S,
    next: &mut [S::f64s],
    mut columns: [&[S::f64s]; N],
    factors: [f64; N],
) -> f64 {
    for column in &mut columns {
        *column = &column[..next.len()];
    }
    let mut negative = [simd.splat_f64s(0.0); N];
    for n in 0..N {
        negative[n] = simd.splat_f64s(-factors[n]);
    }
    let mut square = simd.splat_f64s(0.0);
    for (k, next) in next.iter_mut().enumerate() {
        let mut value = *next;
        for n in 0..N {
            value = simd.mul_add_e_f64s(negative[n], columns[n][k], value);
        }
        square = simd.mul_add_e_f64s(value, value, square);
        *next = value;
    }
    simd.reduce_sum_f64s(square)
}

pub(super) struct Weigh<'a> {
    pub sheet: &'a Sheet,
    pub first: usize,
    pub moments: &'a [f64],
    pub weights: &'a mut [Block],
}

impl WithSimd for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { sheet, first, moments, weights } = self;
        let weights = registers_mut::<S>(weights);
        for weight in &mut *weights {
            *weight = simd.splat_f64s(0.0);
        }
        for (m, moment) in (first..).zip(moments) {
            let factor = simd.splat_f64s(*moment);
            for (weight, value) in weights.iter_mut().zip(registers::<S>(sheet.column(m))) {
                *weight = simd.mul_add_e_f64s(factor, *value, *weight);
            }
        }
        for (weight, root) in weights.iter_mut().zip(registers::<S>(sheet.root())) {
            *weight = simd.mul_f64s(*weight, *root);
        }
    }
}

/// Lays the samples of a window out: their places, and the Jacobi weights of whole exponents.
pub(super) struct Lay<'a> {
    pub times: &'a [f64],
    pub origin: f64,
    pub factor: f64,
    pub exponents: [usize; 2],
    pub places: &'a mut [Block],
    pub weights: &'a mut [Block],
}

impl WithSimd for Lay<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { times, origin, factor, exponents: [kappa, mu], places, weights } = self;
        let (origin, factor) = (simd.splat_f64s(origin), simd.splat_f64s(factor));
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let (places, weights) = (registers_mut::<S>(places), registers_mut::<S>(weights));
        let (whole, tail) = S::as_simd_f64s(times);
        for (k, (u, weight)) in places.iter_mut().zip(weights).enumerate() {
            let t = match whole.get(k) {
                Some(t) => *t,
                None if k == whole.len() => simd.partial_load_f64s(tail),
                None => zero,
            };
            let s = simd.mul_f64s(simd.sub_f64s(t, origin), factor);
            let rest = simd.max_f64s(simd.sub_f64s(one, s), zero);
            *u = simd.sub_f64s(simd.add_f64s(s, s), one);
            let s = simd.max_f64s(s, zero);
            let mut product = one;
            for _ in 0..kappa {
                product = simd.mul_f64s(product, s);
            }
            for _ in 0..mu {
                product = simd.mul_f64s(product, rest);
            }
            *weight = product;
        }
    }
}

/// The sums of the products of `a` with each of `others`.
struct Products<'a, const N: usize> {
    a: &'a [Block],
    others: [&'a [Block]; N],
}

impl<const N: usize> WithSimd for Products<'_, N> {
    type Output = [f64; N];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f64; N] {
        let mut sums = [0.0; N];
        for (sum, other) in sums.iter_mut().zip(self.others) {
            *sum = product(simd, registers::<S>(self.a), registers::<S>(other));
        }
        sums
    }
}

/// The sums of the products of `a` with each of `others`.
pub(crate) fn dots<const N: usize>(arch: Arch, a: &[Block], others: [&[Block]; N]) -> [f64; N] {
    arch.dispatch(Products { a, others })
}

#[inline(always)]
fn registers<S: Simd>(blocks: &[Block]) -> &[S::f64s] {
    S::as_simd_f64s(blocks.as_flattened()).0
}

#[inline(always)]
fn registers_mut<S: Simd>(blocks: &mut [Block]) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(blocks.as_flattened_mut()).0
}

/// `sum of a b`, by two sums side by side.
#[inline(always)]
fn product<S: Simd>(simd: S, a: &[S::f64s], b: &[S::f64s]) -> f64 {
    let (a, b) = (a.as_chunks::<2>(), b.as_chunks::<2>());
    let mut sums = [simd.splat_f64s(0.0); 2];
    for (a, b) in a.0.iter().zip(b.0) {
        sums = [simd.mul_add_e_f64s(a[0], b[0], sums[0]), simd.mul_add_e_f64s(a[1], b[1], sums[1])];
    }
    for (a, b) in a.1.iter().zip(b.1) {
        sums[0] = simd.mul_add_e_f64s(*a, *b, sums[0]);
    }
    simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]))
}

/// The first numbers, as many as a register holds.
#[inline(always)]
pub(crate) fn load<S: Simd>(numbers: &[f64]) -> S::f64s {
    S::as_simd_f64s(numbers).0[0]
}

/// Writes a register over the first numbers.
#[inline(always)]
pub(crate) fn store<S: Simd>(numbers: &mut [f64], value: S::f64s) {
    S::as_mut_simd_f64s(numbers).0[0] = value;
}

/// `1 / value` in every lane.
#[inline(always)]
pub(crate) fn reciprocal<S: Simd>(value: S::f64s) -> S::f64s {
    let mut numbers = [1.0; SIDE];
    store::<S>(&mut numbers, value);
    for number in &mut numbers {
        *number = 1.0 / *number;
    }
    load::<S>(&numbers)
}
