//! The loops over lanes: neighbouring rows, or groups of one row that follow each other, side by side.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::Simd;

use super::super::Sample;
use super::design::{Order, Shape, TILE, Tables};

/// The moments of the blocks of all groups around, or those of the groups; the lanes of a moment are neighbours.
#[derive(Debug, Clone, Copy)]
pub struct Table<'a, T> {
    pub values: &'a [T],
    /// From one group to the next.
    pub group: usize,
    /// From one moment to the next.
    pub moment: usize,
}

impl<'a, T> Table<'a, T> {
    /// The moments from number `first` of group `group` on.
    #[inline(always)]
    fn from(self, group: usize, first: usize, count: usize) -> impl Iterator<Item = &'a [T]> {
        self.values[group * self.group + first * self.moment..].chunks(self.moment).take(count)
    }
}

/// The lanes of one place, in `R` registers.
type Lanes<T, S, const R: usize> = [<T as Sample>::Register<S>; R];

#[inline(always)]
fn zero<T: Sample, S: Simd, const R: usize>(simd: S) -> Lanes<T, S, R> {
    [T::splat(simd, T::default()); R]
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

/// Adds `weight * lanes`.
#[inline(always)]
fn add<T: Sample, S: Simd, const R: usize>(simd: S, sum: &mut Lanes<T, S, R>, weight: T, lanes: &Lanes<T, S, R>) {
    let weight = T::splat(simd, weight);
    for (sum, lane) in sum.iter_mut().zip(lanes) {
        *sum = T::fused(simd, weight, *lane, *sum);
    }
}

/// Adds `row[q] * input` for every input and its row.
#[inline(always)]
fn combine<'a, T: Sample + 'a, S: Simd, const R: usize, const Q: usize>(
    simd: S,
    sums: &mut [Lanes<T, S, R>; Q],
    inputs: impl Iterator<Item = (&'a [T], &'a [T])>,
) {
    let mut held = *sums;
    for (input, row) in inputs {
        let lanes = load::<T, S, R>(input);
        for (sum, weight) in held.iter_mut().zip(&row[..Q]) {
            add::<T, S, R>(simd, sum, *weight, &lanes);
        }
    }
    *sums = held;
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

/// Stores sums `step` apart.
#[inline(always)]
fn put<T: Sample, S: Simd, const R: usize>(sums: &[Lanes<T, S, R>], to: &mut [T], step: usize) {
    for (sum, to) in sums.iter().zip(to.chunks_mut(step)) {
        store::<T, S, R>(sum, to);
    }
}

/// The moments of the block that starts with `samples`, each `step` after the one before.
#[inline(always)]
pub fn moments<T: Sample, S: Simd, const R: usize>(
    simd: S,
    tables: &Tables<T>,
    samples: &[T],
    moments: &mut [T],
    step: usize,
) {
    let Shape { block, moments: count, .. } = tables.shape;
    let samples = &samples[..block * T::LANES];
    by_parts!(count, |first, Q| {
        let mut sums = [zero::<T, S, R>(simd); Q];
        let rows = tables.basis.chunks_exact(count).map(|row| &row[first..]);
        combine::<T, S, R, Q>(simd, &mut sums, samples.chunks_exact(T::LANES).zip(rows));
        put::<T, S, R>(&sums, &mut moments[first * step..], step);
    });
}

/// The moments of a group from those of its blocks.
#[inline(always)]
pub fn group_moments<T: Sample, S: Simd, const R: usize>(
    simd: S,
    tables: &Tables<T>,
    moments: &[T],
    moment_step: usize,
    groups: &mut [T],
    group_step: usize,
) {
    let count = tables.shape.moments;
    by_parts!(count, |first, Q| {
        let mut sums = [zero::<T, S, R>(simd); Q];
        let rows = tables.lift.chunks_exact(count).map(|row| &row[first..]);
        combine::<T, S, R, Q>(simd, &mut sums, moments.chunks(moment_step).zip(rows));
        put::<T, S, R>(&sums, &mut groups[first * group_step..], group_step);
    });
}

/// What the kernel reads for one group of outputs, in all lanes.
#[derive(Debug, Clone, Copy)]
pub struct Group<'a, T> {
    /// The group's samples.
    pub near: &'a [T],
    /// The samples after the whole blocks of its first block, one block and [`super::design::SPILL`] more than a group.
    pub far: &'a [T],
    /// Moments of blocks, from this group on.
    pub blocks: Table<'a, T>,
    /// Moments of groups, from this group on.
    pub groups: Table<'a, T>,
}

/// Coefficients of polynomials in the output's place: those without and those with one block, or group, more.
struct Coefficients<'a, T> {
    fewer: &'a mut [T],
    more: &'a mut [T],
}

impl<'a, T: Sample> Coefficients<'a, T> {
    fn new(room: &'a mut [T]) -> Self {
        let (fewer, more) = room.split_at_mut(room.len() / 2);
        Self { fewer, more }
    }

    #[inline(always)]
    fn of(&self, more: bool) -> &[T] {
        if more { self.more } else { self.fewer }
    }
}

/// The outputs of one group for one order; `room` holds four coefficients for every moment.
#[inline(always)]
pub fn outputs<T: Sample, S: Simd, const R: usize>(
    simd: S,
    tables: &Tables<T>,
    order: &Order<T>,
    group: Group<'_, T>,
    room: &mut [T],
    out: &mut [T],
) {
    let Shape { block, group: blocks, moments: count, reach, taps, groups, .. } = tables.shape;
    let (of_groups, of_blocks) = room.split_at_mut(2 * count * T::LANES);
    let mut of_groups = Coefficients::new(of_groups);
    let mut of_blocks = Coefficients::new(of_blocks);
    if groups.is_some() {
        from_groups::<T, S, R>(simd, tables, order, group.groups, &mut of_groups);
    }
    let length = block * T::LANES;
    for index in 0..blocks {
        from_blocks::<T, S, R>(simd, tables, order, group.blocks, index, &of_groups, &mut of_blocks);
        let (near, far) = (&group.near[index * length..][..length], &group.far[index * length..]);
        let tiles = out[index * length..][..length].chunks_exact_mut(TILE * T::LANES);
        for ((out, places), start) in tiles.zip(tables.places.chunks_exact(TILE * count)).zip((0..).step_by(TILE)) {
            let mut sums = [zero::<T, S, R>(simd); TILE];
            let crosses = start + reach > block;
            let coefficients = of_blocks.of(crosses).chunks_exact(T::LANES);
            combine::<T, S, R, TILE>(simd, &mut sums, coefficients.zip(places.chunks_exact(TILE)));
            beginnings::<T, S, R>(simd, &mut sums, &order.taps, &near[start * T::LANES..]);
            let (far, samples) = if crosses { (&far[length..], start + reach - block) } else { (far, start + reach) };
            ends::<T, S, R>(simd, &mut sums, &order.taps[taps - samples - (TILE - 1)..], far, samples);
            put::<T, S, R>(&sums, out, T::LANES);
        }
    }
}

/// What whole groups add to the outputs of a group.
#[inline(always)]
fn from_groups<T: Sample, S: Simd, const R: usize>(
    simd: S,
    tables: &Tables<T>,
    order: &Order<T>,
    moments: Table<'_, T>,
    coefficients: &mut Coefficients<'_, T>,
) {
    let count = tables.shape.moments;
    let whole = tables.shape.groups.unwrap_or(0);
    by_parts!(count, |first, Q| {
        let mut sums = [zero::<T, S, R>(simd); Q];
        for (index, matrix) in order.groups.chunks_exact(count * count).enumerate() {
            if index == whole {
                put::<T, S, R>(&sums, &mut coefficients.fewer[first * T::LANES..], T::LANES);
            }
            // The degrees in sample and output add up to D at most.
            let rows = matrix.chunks_exact(count).map(|row| &row[first..]);
            combine::<T, S, R, Q>(simd, &mut sums, moments.from(1 + index, 0, count - first).zip(rows));
        }
        put::<T, S, R>(&sums, &mut coefficients.more[first * T::LANES..], T::LANES);
    });
}

/// What whole blocks and groups add to the outputs of block `index` of a group.
#[inline(always)]
fn from_blocks<T: Sample, S: Simd, const R: usize>(
    simd: S,
    tables: &Tables<T>,
    order: &Order<T>,
    moments: Table<'_, T>,
    index: usize,
    of_groups: &Coefficients<'_, T>,
    coefficients: &mut Coefficients<'_, T>,
) {
    let shape = tables.shape;
    let Shape { group: blocks, moments: count, whole, .. } = shape;
    // Distances of the blocks that are added one by one: up to the end of this group, and from the start of the group in
    // which the whole blocks end; all of them without groups.
    let (near, far, one_more) = match shape.groups {
        None => (whole, whole + 1, false),
        Some(groups) => {
            let near = blocks - 1 - index;
            let one_more = whole - near - groups * blocks >= blocks;
            (near, near + (groups + usize::from(one_more)) * blocks + 1, one_more)
        }
    };
    let (first_far, _) = shape.far();
    by_parts!(count, |first, Q| {
        let mut sums = [zero::<T, S, R>(simd); Q];
        if shape.groups.is_some() {
            let rows = tables.restrict[index * count * count..].chunks_exact(count).map(|row| &row[first..]);
            let inputs = of_groups.of(one_more).chunks_exact(T::LANES).zip(rows).skip(first);
            combine::<T, S, R, Q>(simd, &mut sums, inputs);
        }
        let (mut group, mut place) = (0, index);
        let mut distance = 0;
        while distance <= whole {
            // The next block; or, beyond the near ones, the first of the far ones.
            let step = if distance == near { far - near } else { 1 };
            distance += step;
            place += step;
            if place >= blocks {
                (group, place) = (group + place / blocks, place % blocks);
            }
            if distance == whole + 1 {
                put::<T, S, R>(&sums, &mut coefficients.fewer[first * T::LANES..], T::LANES);
            }
            let stored = if distance <= shape.near() { distance - 1 } else { shape.near() + distance - first_far };
            let rows = order.blocks[stored * count * count..].chunks_exact(count).map(|row| &row[first..]);
            combine::<T, S, R, Q>(simd, &mut sums, moments.from(group, place * count, count - first).zip(rows));
        }
        put::<T, S, R>(&sums, &mut coefficients.more[first * T::LANES..], T::LANES);
    });
}

/// What the samples to the end of the block add: output p starts at sample p.
#[inline(always)]
fn beginnings<T: Sample, S: Simd, const R: usize>(
    simd: S,
    sums: &mut [Lanes<T, S, R>; TILE],
    taps: &[T],
    samples: &[T],
) {
    let (first, rest) = samples.split_at(TILE * T::LANES);
    let lanes = |sample: usize| load::<T, S, R>(&first[sample * T::LANES..]);
    let [a, b, c, d] = [lanes(0), lanes(1), lanes(2), lanes(3)];
    let taps = &taps[..taps.len().max(TILE)];
    let mut held = *sums;
    add::<T, S, R>(simd, &mut held[0], taps[0], &a);
    add::<T, S, R>(simd, &mut held[0], taps[1], &b);
    add::<T, S, R>(simd, &mut held[1], taps[0], &b);
    add::<T, S, R>(simd, &mut held[0], taps[2], &c);
    add::<T, S, R>(simd, &mut held[1], taps[1], &c);
    add::<T, S, R>(simd, &mut held[2], taps[0], &c);
    add::<T, S, R>(simd, &mut held[0], taps[3], &d);
    add::<T, S, R>(simd, &mut held[1], taps[2], &d);
    add::<T, S, R>(simd, &mut held[2], taps[1], &d);
    add::<T, S, R>(simd, &mut held[3], taps[0], &d);
    slide::<T, S, R>(simd, &mut held, &taps[1..], rest);
    *sums = held;
}

/// What the last samples add: the window of output p ends with `length + p` of them; `taps` are the last ones, as many as
/// the longest of these ends holds.
#[inline(always)]
fn ends<T: Sample, S: Simd, const R: usize>(
    simd: S,
    sums: &mut [Lanes<T, S, R>; TILE],
    taps: &[T],
    samples: &[T],
    length: usize,
) {
    let (rest, last) = samples.split_at(length * T::LANES);
    let mut held = *sums;
    slide::<T, S, R>(simd, &mut held, taps, rest);
    let lanes = |sample: usize| load::<T, S, R>(&last[sample * T::LANES..]);
    let [a, b, c] = [lanes(0), lanes(1), lanes(2)];
    let taps = &taps[length..length + TILE - 1];
    add::<T, S, R>(simd, &mut held[1], taps[2], &a);
    add::<T, S, R>(simd, &mut held[2], taps[1], &a);
    add::<T, S, R>(simd, &mut held[3], taps[0], &a);
    add::<T, S, R>(simd, &mut held[2], taps[2], &b);
    add::<T, S, R>(simd, &mut held[3], taps[1], &b);
    add::<T, S, R>(simd, &mut held[3], taps[2], &c);
    *sums = held;
}

/// Samples that all outputs of a tile use, each with the four taps of its window.
#[inline(always)]
fn slide<T: Sample, S: Simd, const R: usize>(simd: S, sums: &mut [Lanes<T, S, R>; TILE], taps: &[T], samples: &[T]) {
    for (sample, window) in samples.chunks_exact(T::LANES).zip(taps.windows(TILE)) {
        let lanes = load::<T, S, R>(sample);
        add::<T, S, R>(simd, &mut sums[3], window[0], &lanes);
        add::<T, S, R>(simd, &mut sums[2], window[1], &lanes);
        add::<T, S, R>(simd, &mut sums[1], window[2], &lanes);
        add::<T, S, R>(simd, &mut sums[0], window[3], &lanes);
    }
}
