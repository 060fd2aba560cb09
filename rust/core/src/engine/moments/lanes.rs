//! What lies side by side in the lanes: groups of one row that follow each other, or neighbouring rows.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use super::super::transpose::{from_lanes, to_lanes};
use super::super::{Sample, bring_home, stream};
use super::Moments;
use super::design::{Order, SPILL, Tables};
use super::kernel::{self, Group, Table};
use crate::error::{Error, resize};

/// Groups of a row whose moments are formed before those of the groups behind are dropped, in lanes.
const STEPS: usize = 8;

/// A thread's own memory.
#[derive(Debug, Default)]
pub struct Room<T> {
    /// Samples as they follow in the row, and results likewise.
    stream: Vec<T>,
    near: Vec<T>,
    far: Vec<T>,
    results: Vec<T>,
    coefficients: Vec<T>,
    /// Moments of blocks and of groups.
    blocks: Vec<T>,
    groups: Vec<T>,
}

/// Sets the length; what the buffer holds does not matter.
fn fit<T: Sample>(buffer: &mut Vec<T>, length: usize) -> Result<(), Error> {
    if buffer.len() == length { Ok(()) } else { resize(buffer, length) }
}

impl<T: Sample> Room<T> {
    pub fn prepare_row(&mut self, tables: &Tables<T>) -> Result<(), Error> {
        let (shape, lanes) = (tables.shape, T::LANES);
        let (length, width) = (shape.group_length(), width(tables, lanes));
        fit(&mut self.stream, length * lanes + shape.block + SPILL)?;
        fit(&mut self.near, length * lanes)?;
        fit(&mut self.far, (length + shape.block + SPILL) * lanes)?;
        fit(&mut self.results, length * lanes)?;
        fit(&mut self.coefficients, 4 * shape.moments * lanes)?;
        fit(&mut self.blocks, shape.group * shape.moments * width)?;
        fit(&mut self.groups, if shape.groups.is_some() { shape.moments * width } else { 0 })
    }

    pub fn prepare_columns(&mut self, tables: &Tables<T>, groups: usize) -> Result<(), Error> {
        let (shape, lanes) = (tables.shape, T::LANES);
        let all = groups + shape.halo();
        fit(&mut self.near, (all * shape.group_length() + SPILL) * lanes)?;
        fit(&mut self.results, shape.group_length() * lanes)?;
        fit(&mut self.coefficients, 4 * shape.moments * lanes)?;
        fit(&mut self.blocks, all * shape.group * shape.moments * lanes)?;
        fit(&mut self.groups, if shape.groups.is_some() { all * shape.moments * lanes } else { 0 })
    }
}

/// Columns of the tables of moments of a row.
fn width<T: Sample>(tables: &Tables<T>, lanes: usize) -> usize {
    (STEPS + 1) * lanes + tables.shape.halo()
}

/// Groups of a row into lanes.
struct Gather<'a, T> {
    x: &'a [T],
    on_differences: bool,
    /// Where in x the first lane starts.
    start: isize,
    /// Samples from one lane to the next, and of each.
    step: usize,
    length: usize,
    line: &'a mut [T],
    lanes: &'a mut [T],
}

impl<T: Sample> WithSimd for Gather<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { x, on_differences, start, step, length, line, lanes } = self;
        let line = &mut line[..(T::LANES - 1) * step + length];
        stream(x, on_differences, start, line);
        to_lanes(simd, line, step, length, lanes);
    }
}

/// The moments of `count` blocks, each in its own place of a table.
struct Form<'a, T: Sample> {
    tables: &'a Tables<T>,
    samples: &'a [T],
    moments: &'a mut [T],
    step: usize,
}

impl<T: Sample> WithSimd for Form<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        use kernel::moments;
        let Self { tables, samples, moments: to, step } = self;
        with_registers!(simd, T, S, moments(tables, samples, to, step));
    }
}

/// The moments of groups.
struct Lift<'a, T: Sample> {
    tables: &'a Tables<T>,
    moments: &'a [T],
    groups: &'a mut [T],
    step: usize,
}

impl<T: Sample> WithSimd for Lift<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        use kernel::group_moments;
        let Self { tables, moments, groups, step } = self;
        with_registers!(simd, T, S, group_moments(tables, moments, step, groups, step));
    }
}

/// The outputs of a group.
struct Evaluate<'a, T: Sample> {
    tables: &'a Tables<T>,
    order: &'a Order<T>,
    group: Group<'a, T>,
    coefficients: &'a mut [T],
    results: &'a mut [T],
}

impl<T: Sample> WithSimd for Evaluate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        use kernel::outputs;
        let Self { tables, order, group, coefficients, results } = self;
        with_registers!(simd, T, S, outputs(tables, order, group, coefficients, results));
    }
}

/// Sums into outputs, back from lanes if they were groups of a row.
struct Deliver<'a, T> {
    /// The line to put them in, and the length of each lane.
    line: Option<(&'a mut [T], usize)>,
    sums: &'a [T],
    from: usize,
    scale: f64,
    anchored: Option<&'a [T]>,
    out: &'a mut [T],
}

impl<T: Sample> WithSimd for Deliver<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { line, sums, from, scale, anchored, out } = self;
        match line {
            None => bring_home(&sums[from..from + out.len()], scale, anchored, out),
            Some((line, length)) => {
                from_lanes(simd, sums, length, line);
                bring_home(&line[from..from + out.len()], scale, anchored, out);
            }
        }
    }
}

/// Groups of one row in the lanes.
pub struct Row<'a, 'o, T: Sample> {
    pub moments: &'a Moments<T>,
    pub x: &'a [T],
    pub first: usize,
    pub origin: isize,
    pub outs: &'a mut [&'o mut [T]],
    pub room: &'a mut Room<T>,
}

impl<T: Sample> Row<'_, '_, T> {
    pub fn run(self) {
        let Self { moments: Moments { tables, on_differences, .. }, x, first, origin, outs, room } = self;
        let Room { stream: line, near, far, results, coefficients, blocks, groups } = room;
        let (arch, lanes, on_differences) = (Arch::new(), T::LANES, *on_differences);
        let (shape, width) = (tables.shape, width(tables, lanes));
        let length = shape.group_length();
        let block_length = shape.block * lanes;
        let outputs = outs.first().map_or(0, |out| out.len());
        // The group that holds the start of the first window starts `lead` before it.
        let lead = (origin + first.cast_signed()).rem_euclid(length.cast_signed()).cast_unsigned();
        let place = first.cast_signed() - lead.cast_signed();
        let offset = (shape.whole + 1) * shape.block;
        // Moments of the whole blocks of the first windows.
        for column in (0..offset.div_ceil(length)).step_by(lanes) {
            let start = place + (column * length).cast_signed();
            arch.dispatch(Gather { x, on_differences, start, step: length, length, line, lanes: near });
            for (block, samples) in near.chunks_exact(block_length).enumerate() {
                let moments = &mut blocks[block * shape.moments * width + column..];
                arch.dispatch(Form { tables, samples, moments, step: width });
            }
        }
        let mut column = 0;
        // Groups whose moments follow from those of their blocks.
        let mut formed = 0;
        for start in (0..outputs + lead).step_by(length * lanes) {
            let here = place + start.cast_signed();
            arch.dispatch(Gather { x, on_differences, start: here, step: length, length, line, lanes: near });
            let (ahead, rows) = (here + offset.cast_signed(), length + shape.block + SPILL);
            arch.dispatch(Gather { x, on_differences, start: ahead, step: length, length: rows, line, lanes: far });
            for (block, samples) in far.chunks_exact(block_length).take(shape.group).enumerate() {
                let at = shape.whole + 1 + block;
                let moments = &mut blocks[at % shape.group * shape.moments * width + column + at / shape.group..];
                arch.dispatch(Form { tables, samples, moments, step: width });
            }
            if shape.groups.is_some() {
                let complete = column + lanes + (shape.whole + 1) / shape.group;
                while formed < complete {
                    let from = formed.min(width - lanes);
                    arch.dispatch(Lift { tables, moments: &blocks[from..], groups: &mut groups[from..], step: width });
                    formed = from + lanes;
                }
                formed = complete;
            }
            let group = Group {
                near,
                far,
                blocks: Table { values: &blocks[column..], group: 1, moment: width },
                groups: Table { values: groups.get(column..).unwrap_or(&[]), group: 1, moment: width },
            };
            let (from, until) = (start.max(lead), (start + length * lanes).min(lead + outputs));
            for (order, out) in tables.orders.iter().zip(outs.iter_mut()) {
                arch.dispatch(Evaluate { tables, order, group, coefficients, results });
                arch.dispatch(Deliver {
                    line: Some((line, length)),
                    sums: results,
                    from: from - start,
                    scale: order.scale,
                    anchored: order.anchor.map(|anchor| &x[first + from - lead + anchor..]),
                    out: &mut out[from - lead..until - lead],
                });
            }
            column += lanes;
            if column + lanes + shape.halo() > width {
                blocks.chunks_mut(width).chain(groups.chunks_mut(width)).for_each(|row| row.copy_within(column.., 0));
                formed -= column.min(formed);
                column = 0;
            }
        }
    }
}

/// Neighbouring rows in the lanes.
pub struct Columns<'a, 'o, T: Sample> {
    pub moments: &'a Moments<T>,
    pub x: &'a [T],
    pub lead: usize,
    pub outs: &'a mut [&'o mut [T]],
    pub room: &'a mut Room<T>,
}

impl<T: Sample> Columns<'_, '_, T> {
    pub fn run(self) {
        let Self { moments: Moments { tables, on_differences, .. }, x, lead, outs, room } = self;
        let Room { near: samples, results, coefficients, blocks, groups, .. } = room;
        let (arch, lanes) = (Arch::new(), T::LANES);
        let shape = tables.shape;
        let length = shape.group_length();
        arch.dispatch(Align { x, on_differences: *on_differences, lead, samples });
        let step = shape.moments * lanes;
        for (samples, moments) in samples.chunks_exact(shape.block * lanes).zip(blocks.chunks_exact_mut(step)) {
            arch.dispatch(Form { tables, samples, moments, step: lanes });
        }
        for (moments, groups) in blocks.chunks_exact(shape.group * step).zip(groups.chunks_exact_mut(step)) {
            arch.dispatch(Lift { tables, moments, groups, step: lanes });
        }
        let outputs = outs.first().map_or(0, |out| out.len()) / lanes;
        for start in (0..lead + outputs).step_by(length) {
            let index = start / length;
            let group = Group {
                near: &samples[start * lanes..][..length * lanes],
                far: &samples[(start + (shape.whole + 1) * shape.block) * lanes..],
                blocks: Table {
                    values: &blocks[index * shape.group * step..],
                    group: shape.group * step,
                    moment: lanes,
                },
                groups: Table { values: groups.get(index * step..).unwrap_or(&[]), group: step, moment: lanes },
            };
            let (from, until) = (start.max(lead), (start + length).min(lead + outputs));
            for (order, out) in tables.orders.iter().zip(outs.iter_mut()) {
                arch.dispatch(Evaluate { tables, order, group, coefficients, results });
                arch.dispatch(Deliver {
                    line: None,
                    sums: results,
                    from: (from - start) * lanes,
                    scale: order.scale,
                    anchored: order.anchor.map(|anchor| &x[(from - lead + anchor) * lanes..]),
                    out: &mut out[(from - lead) * lanes..(until - lead) * lanes],
                });
            }
        }
    }
}

/// The stream of neighbouring rows, from the start of a group on.
struct Align<'a, T> {
    x: &'a [T],
    on_differences: bool,
    lead: usize,
    samples: &'a mut [T],
}

impl<T: Sample> WithSimd for Align<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self { x, on_differences, lead, samples } = self;
        let lanes = T::LANES;
        let held = (x.len() / lanes).saturating_sub(usize::from(on_differences)) * lanes;
        let (before, rest) = samples.split_at_mut(lead * lanes);
        let (known, after) = rest.split_at_mut(held.min(rest.len()));
        before.fill(T::default());
        after.fill(T::default());
        if on_differences {
            for ((known, older), newer) in known.iter_mut().zip(x).zip(&x[lanes.min(x.len())..]) {
                *known = *newer - *older;
            }
        } else {
            known.copy_from_slice(&x[..known.len()]);
        }
    }
}
