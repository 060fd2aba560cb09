//! The loops over lanes: neighbouring rows, or neighbouring groups of one row, side by side.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use super::super::Sample;
use super::design::{Order, Shape, TILE, Tables};

/// Where the numbers of a place stand in a buffer; the lanes of a place are neighbours.
#[derive(Debug, Clone, Copy, Default)]
pub struct Steps {
    /// From one group to the next.
    pub group: usize,
    /// From one place of a group to the next.
    pub place: usize,
}

/// The buffers of a strip.
#[derive(Debug)]
pub struct Buffers<'a, T> {
    pub samples: &'a [T],
    pub at_samples: Steps,
    /// Moments: place `block * moments + d` of a group.
    pub moments: &'a [T],
    pub at_moments: Steps,
    /// Moments of groups: place d.
    pub groups: &'a [T],
    pub at_groups: Steps,
}

#[inline(always)]
fn add<T: Sample, const N: usize, const FMA: bool>(sum: &mut [T; N], weight: T, values: &[T; N]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum = if FMA { value.mul_add(weight, *sum) } else { *sum + *value * weight };
    }
}

#[inline(always)]
fn load<T: Sample, const N: usize>(values: &[T]) -> [T; N] {
    let mut lanes = [T::default(); N];
    lanes.copy_from_slice(&values[..N]);
    lanes
}

/// Adds `row[q] * input` for every input and its row.
#[inline(always)]
fn combine<'a, T: Sample + 'a, const N: usize, const Q: usize, const FMA: bool>(
    sums: &mut [[T; N]; Q],
    inputs: impl Iterator<Item = (&'a [T], &'a [T])>,
) {
    for (input, row) in inputs {
        let lanes = load::<T, N>(input);
        let row = load::<T, Q>(row);
        for (sum, weight) in sums.iter_mut().zip(row) {
            add::<T, N, FMA>(sum, weight, &lanes);
        }
    }
}

/// Calls with up to four outputs at a time.
macro_rules! by_fours {
    ($count:expr, |$first:ident, $q:ident| $body:block) => {
        let mut $first = 0;
        while $first < $count {
            match $count - $first {
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
                _ => {
                    const $q: usize = 4;
                    $body
                }
            }
            $first += 4;
        }
    };
}

/// The moments of the blocks of a group, from its samples at `samples`, into `moments`.
#[inline(always)]
pub fn moments<T: Sample, const N: usize, const FMA: bool>(
    tables: &Tables<T>,
    samples: &[T],
    sample_step: usize,
    moments: &mut [T],
    moment_step: usize,
) {
    let Shape { block, group, moments: count, .. } = tables.shape;
    for index in 0..group {
        let rows = &samples[index * block * sample_step..];
        by_fours!(count, |first, Q| {
            let mut sums = [[T::default(); N]; Q];
            let table = tables.basis.chunks(count).map(|row| &row[first..]);
            combine::<T, N, Q, FMA>(&mut sums, rows.chunks(sample_step).zip(table));
            for (place, sum) in (index * count + first..).zip(&sums) {
                moments[place * moment_step..][..N].copy_from_slice(sum);
            }
        });
    }
}

/// The moments of a group from those of its blocks.
#[inline(always)]
pub fn group_moments<T: Sample, const N: usize, const FMA: bool>(
    tables: &Tables<T>,
    moments: &[T],
    moment_step: usize,
    groups: &mut [T],
    group_step: usize,
) {
    let count = tables.shape.moments;
    by_fours!(count, |first, Q| {
        let mut sums = [[T::default(); N]; Q];
        let table = tables.lift.chunks(count).map(|row| &row[first..]);
        combine::<T, N, Q, FMA>(&mut sums, moments.chunks(moment_step).zip(table));
        for (place, sum) in (first..).zip(&sums) {
            groups[place * group_step..][..N].copy_from_slice(sum);
        }
    });
}

/// The outputs of one group for one order.
#[inline(always)]
pub fn outputs<T: Sample, const N: usize, const FMA: bool>(
    tables: &Tables<T>,
    order: &Order<T>,
    buffers: &Buffers<'_, T>,
    group: usize,
    room: &mut [T],
    out: &mut [T],
    out_step: usize,
) {
    let Shape { block, group: blocks, moments: count, whole, reach, taps, groups } = tables.shape;
    let square = count * count;
    let step = buffers.at_samples.place;
    let place_of = |index: usize| {
        // Block `index` from the start of this group.
        (group + index / blocks) * buffers.at_samples.group + index % blocks * block * step
    };
    let moments_of = |index: usize| {
        let at =
            (group + index / blocks) * buffers.at_moments.group + index % blocks * count * buffers.at_moments.place;
        buffers.moments[at..].chunks(buffers.at_moments.place).take(count)
    };
    // Room for the coefficients: of the group without and with one group more, of the block without and with one block more.
    let (of_groups, of_blocks) = room.split_at_mut(2 * count * N);
    if let Some(groups) = groups {
        by_fours!(count, |first, Q| {
            let mut sums = [[T::default(); N]; Q];
            let mut matrices = order.groups.chunks(square);
            for (index, matrix) in matrices.by_ref().take(groups).enumerate() {
                let inputs =
                    buffers.groups[(group + 1 + index) * buffers.at_groups.group..].chunks(buffers.at_groups.place);
                combine::<T, N, Q, FMA>(
                    &mut sums,
                    inputs.zip(matrix.chunks(count).take(count - first).map(|row| &row[first..])),
                );
            }
            for (place, sum) in (first..).zip(&sums) {
                of_groups[place * N..][..N].copy_from_slice(sum);
            }
            if let Some(matrix) = matrices.next() {
                let inputs =
                    buffers.groups[(group + 1 + groups) * buffers.at_groups.group..].chunks(buffers.at_groups.place);
                combine::<T, N, Q, FMA>(
                    &mut sums,
                    inputs.zip(matrix.chunks(count).take(count - first).map(|row| &row[first..])),
                );
            }
            for (place, sum) in (count + first..).zip(&sums) {
                of_groups[place * N..][..N].copy_from_slice(sum);
            }
        });
    }
    for index in 0..blocks {
        // Distances of the blocks whose moments are added one by one: up to the end of this group, and from the start of
        // the group in which the whole blocks end; all of them without groups.
        let (near, far, one_more) = match groups {
            None => (whole, whole + 1..whole + 1, false),
            Some(groups) => {
                let near = blocks - 1 - index;
                let rest = whole - near - groups * blocks;
                let one_more = rest >= blocks;
                let start = near + (groups + usize::from(one_more)) * blocks + 1;
                (near, start..whole + 1, one_more)
            }
        };
        let (first_far, _) = tables.shape.far();
        let stored = |distance: usize| {
            let at =
                if distance <= tables.shape.near() { distance - 1 } else { tables.shape.near() + distance - first_far };
            order.blocks[at * square..][..square].chunks(count)
        };
        by_fours!(count, |first, Q| {
            let mut sums = [[T::default(); N]; Q];
            if groups.is_some() {
                let coefficients = &of_groups[usize::from(one_more) * count * N..][first * N..count * N];
                let table =
                    tables.restrict[index * square..][..square].chunks(count).skip(first).map(|row| &row[first..]);
                combine::<T, N, Q, FMA>(&mut sums, coefficients.chunks(N).zip(table));
            }
            for distance in (1..=near).chain(far.clone()) {
                let table = stored(distance).take(count - first).map(|row| &row[first..]);
                combine::<T, N, Q, FMA>(&mut sums, moments_of(index + distance).zip(table));
            }
            for (place, sum) in (first..).zip(&sums) {
                of_blocks[place * N..][..N].copy_from_slice(sum);
            }
            let table = stored(whole + 1).take(count - first).map(|row| &row[first..]);
            combine::<T, N, Q, FMA>(&mut sums, moments_of(index + whole + 1).zip(table));
            for (place, sum) in (count + first..).zip(&sums) {
                of_blocks[place * N..][..N].copy_from_slice(sum);
            }
        });
        for (tile, places) in tables.places.chunks(TILE * count).enumerate() {
            let start = tile * TILE;
            let mut sums = [[T::default(); N]; TILE];
            let crosses = start + reach > block;
            let coefficients = &of_blocks[usize::from(crosses) * count * N..][..count * N];
            combine::<T, N, TILE, FMA>(&mut sums, coefficients.chunks(N).zip(places.chunks(TILE)));
            let near = &buffers.samples[place_of(index) + start * step..];
            beginnings::<T, N, FMA>(&mut sums, &order.taps, near, step, block - start);
            let (skipped, length) =
                if crosses { (whole + 2, start + reach - block) } else { (whole + 1, start + reach) };
            let far = &buffers.samples[place_of(index + skipped)..];
            ends::<T, N, FMA>(&mut sums, &order.taps[taps - length - (TILE - 1)..], far, step, length);
            for (place, sum) in (index * block + start..).zip(&sums) {
                out[place * out_step..][..N].copy_from_slice(sum);
            }
        }
    }
}

/// What the `length` samples to the end of the block add: output p starts at sample p.
#[inline(always)]
fn beginnings<T: Sample, const N: usize, const FMA: bool>(
    sums: &mut [[T; N]; TILE],
    taps: &[T],
    samples: &[T],
    step: usize,
    length: usize,
) {
    let mut rows = samples.chunks(step);
    let first = load::<T, TILE>(taps);
    for sample in 0..TILE {
        let Some(row) = rows.next() else { return };
        let lanes = load::<T, N>(row);
        for output in 0..TILE {
            if output <= sample {
                add::<T, N, FMA>(&mut sums[output], first[sample - output], &lanes);
            }
        }
    }
    for (row, window) in rows.take(length - TILE).zip(taps[1..].windows(TILE)) {
        let lanes = load::<T, N>(row);
        let window = load::<T, TILE>(window);
        for output in 0..TILE {
            add::<T, N, FMA>(&mut sums[output], window[TILE - 1 - output], &lanes);
        }
    }
}

/// What the last samples add: the window of output p ends with `length + p` samples; `taps` are the last ones, as many as
/// the longest of these ends holds.
#[inline(always)]
fn ends<T: Sample, const N: usize, const FMA: bool>(
    sums: &mut [[T; N]; TILE],
    taps: &[T],
    samples: &[T],
    step: usize,
    length: usize,
) {
    let mut rows = samples.chunks(step);
    for (row, window) in rows.by_ref().take(length).zip(taps.windows(TILE)) {
        let lanes = load::<T, N>(row);
        let window = load::<T, TILE>(window);
        for output in 0..TILE {
            add::<T, N, FMA>(&mut sums[output], window[TILE - 1 - output], &lanes);
        }
    }
    let last = load::<T, { TILE - 1 }>(&taps[length..]);
    for sample in 0..TILE - 1 {
        let Some(row) = rows.next() else { return };
        let lanes = load::<T, N>(row);
        for output in 0..TILE {
            if output > sample {
                add::<T, N, FMA>(&mut sums[output], last[TILE - 1 - output + sample], &lanes);
            }
        }
    }
}
