//! What lies side by side in the lanes: groups of one row that follow each other, or neighbouring rows.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use super::super::Sample;
use super::super::stream::{bring_home, stream};
use super::super::transpose::{from_lanes, to_lanes};
use super::Moments;
use super::design::{Order, SPILL, Tables};
use super::kernel::{self, Group, Table};
use crate::error::{Error, resize};

/// Samples of a row that are worked on between two runs through memory, about, and lanes full of groups, at most.
const RUN: usize = 1 << 15;
const STEPS: usize = 8;

/// Lanes full of groups between two runs through memory.
fn steps<T: Sample>(tables: &Tables<T>) -> usize {
    (RUN / (tables.shape.group_length() * T::LANES)).clamp(1, STEPS)
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub struct Room<T> {
    /// Samples as they follow in the row, from where windows start and from where they end, and results likewise.
    stream: Vec<T>,
    ahead: Vec<T>,
    lines: Vec<T>,
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
    /// Room for groups of one row.
    pub fn prepare_row(&mut self, tables: &Tables<T>) -> Result<(), Error> {
        let (shape, lanes) = (tables.shape, T::LANES);
        let (length, width) = (shape.group_length(), width(tables, lanes));
        let run = steps(tables) * length * lanes;
        fit(&mut self.stream, run)?;
        fit(&mut self.ahead, run + shape.block + SPILL)?;
        fit(&mut self.lines, tables.orders.len() * run)?;
        fit(&mut self.near, length * lanes)?;
        fit(&mut self.far, (length + shape.block + SPILL) * lanes)?;
        fit(&mut self.results, length * lanes)?;
        fit(&mut self.coefficients, 4 * shape.moments * lanes)?;
        fit(&mut self.blocks, shape.group * shape.moments * width)?;
        fit(&mut self.groups, if shape.groups.is_some() { shape.moments * width } else { 0 })
    }

    /// Room for neighbouring rows of `groups` groups with outputs.
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
    steps(tables) * lanes + tables.shape.halo()
}

/// The stream of a row, as far as it is at hand.
struct Stage<'a, T> {
    x: &'a [T],
    on_differences: bool,
    /// Where in x it starts.
    start: isize,
    stream: &'a mut [T],
}

impl<T: Sample> WithSimd for Stage<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        stream(self.x, self.on_differences, self.start, self.stream);
    }
}

/// Groups of a row into lanes: `length` samples of each, `step` after those of the one before.
struct Gather<'a, T> {
    stream: &'a [T],
    step: usize,
    length: usize,
    lanes: &'a mut [T],
}

impl<T: Sample> WithSimd for Gather<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        to_lanes(simd, self.stream, self.step, self.length, self.lanes);
    }
}

/// The moments of a block.
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

/// Results out of lanes, one group of a row after the other.
struct Scatter<'a, T> {
    lanes: &'a [T],
    length: usize,
    line: &'a mut [T],
}

impl<T: Sample> WithSimd for Scatter<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        from_lanes(simd, self.lanes, self.length, self.line);
    }
}

/// Sums into outputs.
struct Deliver<'a, T> {
    sums: &'a [T],
    scale: f64,
    anchored: Option<&'a [T]>,
    out: &'a mut [T],
}

impl<T: Sample> WithSimd for Deliver<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        bring_home(self.sums, self.scale, self.anchored, self.out);
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
        let Room { stream, ahead, near, far, results, lines, coefficients, blocks, groups } = room;
        let (arch, lanes, on_differences) = (Arch::new(), T::LANES, *on_differences);
        let (shape, width) = (tables.shape, width(tables, lanes));
        let length = shape.group_length();
        let (step, block_length) = (length * lanes, shape.block * lanes);
        let most = steps(tables);
        let outputs = outs.first().map_or(0, |out| out.len());
        // The group that holds the start of the first window starts `lead` before it.
        let lead = (origin + first.cast_signed()).rem_euclid(length.cast_signed()).cast_unsigned();
        let place = first.cast_signed() - lead.cast_signed();
        let offset = (shape.whole + 1) * shape.block;
        // Moments of the whole blocks of the first windows.
        for column in (0..offset.div_ceil(length)).step_by(lanes) {
            let (start, stream) = (place + (column * length).cast_signed(), &mut stream[..step]);
            arch.dispatch(Stage { x, on_differences, start, stream });
            arch.dispatch(Gather { stream, step: length, length, lanes: near });
            for (block, samples) in near.chunks_exact(block_length).enumerate() {
                let moments = &mut blocks[block * shape.moments * width + column..];
                arch.dispatch(Form { tables, samples, moments, step: width });
            }
        }
        // Groups whose moments follow from those of their blocks.
        let mut formed = 0;
        for start in (0..outputs + lead).step_by(most * step) {
            // Long runs through memory, and between them work in the caches.
            let steps = (outputs + lead - start).div_ceil(step).min(most);
            let here = place + start.cast_signed();
            let (stream, ahead) = (&mut stream[..steps * step], &mut ahead[..steps * step + shape.block + SPILL]);
            arch.dispatch(Stage { x, on_differences, start: here, stream });
            arch.dispatch(Stage { x, on_differences, start: here + offset.cast_signed(), stream: ahead });
            for (at, column) in (0..steps * step).step_by(step).zip((0..).step_by(lanes)) {
                arch.dispatch(Gather { stream: &stream[at..], step: length, length, lanes: near });
                let further = length + shape.block + SPILL;
                arch.dispatch(Gather { stream: &ahead[at..], step: length, length: further, lanes: far });
                for (block, samples) in far.chunks_exact(block_length).take(shape.group).enumerate() {
                    let at = shape.whole + 1 + block;
                    let moments = &mut blocks[at % shape.group * shape.moments * width + column + at / shape.group..];
                    arch.dispatch(Form { tables, samples, moments, step: width });
                }
                if shape.groups.is_some() {
                    let complete = column + lanes + (shape.whole + 1) / shape.group;
                    while formed < complete {
                        let from = formed.min(width - lanes);
                        let (moments, groups) = (&blocks[from..], &mut groups[from..]);
                        arch.dispatch(Lift { tables, moments, groups, step: width });
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
                for (order, line) in tables.orders.iter().zip(lines.chunks_exact_mut(most * step)) {
                    arch.dispatch(Evaluate { tables, order, group, coefficients, results });
                    arch.dispatch(Scatter { lanes: results, length, line: &mut line[at..at + step] });
                }
            }
            let (from, until) = (start.max(lead), (start + steps * step).min(lead + outputs));
            let all = tables.orders.iter().zip(outs.iter_mut()).zip(lines.chunks_exact(most * step));
            for ((order, out), line) in all {
                arch.dispatch(Deliver {
                    sums: &line[from - start..until - start],
                    scale: order.scale,
                    anchored: order.anchor.map(|anchor| &x[first + from - lead + anchor..]),
                    out: &mut out[from - lead..until - lead],
                });
            }
            let done = most * lanes;
            blocks.chunks_mut(width).chain(groups.chunks_mut(width)).for_each(|row| row.copy_within(done.., 0));
            formed = formed.saturating_sub(done);
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
                    sums: &results[(from - start) * lanes..(until - start) * lanes],
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
