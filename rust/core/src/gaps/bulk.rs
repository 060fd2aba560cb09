//! Many windows with missing samples at once.
//!
//! What the small system of a window takes are sliding sums: of the samples against the columns of `sqrt(W) Q`, and of the marks of
//! the missing samples against the products of the columns of Q. The engines form them, at a cost that does not grow with the
//! window, and the systems are solved side by side. Estimates that need more care are left NaN for [`crate::fits`]: too much of
//! the window is missing, or the noise gain may be too large.

#![expect(
    clippy::indexing_slicing,
    reason = "windows lie in their rows, and sums have one more element than what they sum"
)]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::{Aim, SMALLEST_PIVOT, Whole};
use crate::control::Control;
use crate::engine::{Runner, Sample, Scratch, Taps, Windows};
use crate::error::{Error, at_least};
use crate::frame::Layout;
use crate::local::{Model, SIDE, load, reciprocal, store};
use crate::tasks::cut;
use crate::threads::{Load, share};

/// Estimates that are worked on at a time: what they take stays in the second cache. Long windows need more, because neighbours
/// have their samples in common.
const STRETCH: usize = 1 << 11;

/// Stretches of a task.
const STRETCHES: usize = 8;

/// What is decided before the first sample.
#[derive(Debug)]
pub struct Bulk<'a> {
    whole: &'a Whole,
    orders: &'a [usize],
    aim: Aim,
    /// The sums over the samples and over the marks.
    sums: Runner<f64>,
    holes: Runner<f64>,
    center: isize,
    unit: f64,
    /// What the noise gains may be.
    limits: Vec<f64>,
    support: usize,
    /// Whether the gains themselves are wanted, not only bounds for them.
    gains: bool,
}

/// What is asked of the estimates.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// How much larger the noise gain may be than that of the whole window.
    pub limit: f64,
    /// Samples that a window must hold.
    pub support: usize,
    /// Whether standard deviations are wanted, for noise of variance 1.
    pub std: bool,
}

/// The estimates, and what is asked for beside them: all in the same layout.
#[derive(Debug)]
pub struct Found<'o, T> {
    /// Estimates, for every order.
    pub estimate: &'o mut [T],
    /// Standard deviations, for every order.
    pub std: Option<&'o mut [T]>,
    /// Numbers of samples, once for all orders.
    pub support: Option<&'o mut [i64]>,
}

/// The rows and the estimates that have been asked for.
#[derive(Debug, Clone, Copy)]
pub struct Outputs {
    /// The array of the samples.
    pub layout: Layout,
    /// Estimates of a row.
    pub count: usize,
    /// Threads at most; 0 for as many as the process may use.
    pub threads: usize,
}

/// Neighbouring estimates of one row, or of all columns of a matrix.
struct Task<'o, T> {
    outer: usize,
    first: usize,
    outs: Vec<&'o mut [T]>,
    stds: Vec<&'o mut [T]>,
    support: &'o mut [i64],
}

/// A thread's own memory.
#[derive(Debug, Default)]
struct Memory {
    z: Vec<f64>,
    marks: Vec<f64>,
    missing: Vec<usize>,
    sums: Vec<f64>,
    holes: Vec<f64>,
    results: Vec<f64>,
    gains: Vec<f64>,
    scratch: Scratch<f64>,
}

impl<'a> Bulk<'a> {
    /// For estimates at `place` of windows that start `center` samples before. None if the fit has too many coefficients.
    pub fn new(
        model: &'a Model,
        whole: &'a Whole,
        place: f64,
        center: isize,
        delta: f64,
        wanted: Wanted,
    ) -> Result<Option<Self>, Error> {
        let size = model.degree + 1;
        if !whole.refits() {
            return Ok(None);
        }
        let mut aim = Aim::default();
        whole.aim(model, 2.0 * place - 1.0, &mut aim)?;
        let span = whole.span();
        let column = |m: usize| whole.functionals[m * whole.sheet.blocks()..][..span.div_ceil(SIDE)].as_flattened();
        let sums = (0..size).map(|m| Taps::plain(&column(m)[..span])).collect::<Result<Vec<_>, _>>()?;
        let pairs = (0..size).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let product = |(i, j): (usize, usize)| whole.rows.iter().map(|row| row[i] * row[j]).collect::<Vec<_>>();
        let mut products: Vec<Vec<f64>> = pairs.map(product).collect();
        if wanted.std {
            let square = |row: Vec<f64>| row.iter().zip(whole.root()).map(|(q, root)| q * root * root).collect();
            products.extend(products.clone().into_iter().map(square).collect::<Vec<_>>());
        }
        let holes = products.iter().map(|product| Taps::plain(product)).collect::<Result<Vec<_>, _>>()?;
        let limits = aim.gains.iter().map(|gain| gain * wanted.limit).collect();
        Ok(Some(Self {
            whole,
            orders: &model.orders,
            aim,
            sums: Runner::fastest(&sums.iter().collect::<Vec<_>>())?,
            holes: Runner::fastest(&holes.iter().collect::<Vec<_>>())?,
            center,
            unit: 2.0 / (whole.window_length as f64 * delta),
            limits,
            support: wanted.support,
            gains: wanted.std,
        }))
    }

    /// Replaces those estimates that are NaN because a sample of their window in `x` is.
    pub fn run<T: Sample>(
        &self,
        x: &[T],
        found: Found<'_, T>,
        outputs: Outputs,
        control: &impl Control,
    ) -> Result<(), Error> {
        let Outputs { layout, count, threads } = outputs;
        let per_order = layout.outer.saturating_mul(count).saturating_mul(layout.inner);
        let held = layout.outer.saturating_mul(layout.samples).saturating_mul(layout.inner);
        let wanted = per_order.saturating_mul(self.orders.len());
        if x.len() != held
            || found.estimate.len() != wanted
            || found.std.as_ref().is_some_and(|std| std.len() != wanted || !self.gains)
            || found.support.as_ref().is_some_and(|support| support.len() != per_order)
        {
            return Err(Error::argument("out", found.estimate.len(), "as long as there are estimates"));
        }
        if per_order == 0 {
            return Ok(());
        }
        let piece = (STRETCHES * self.longest() / layout.inner).clamp(self.longest().min(count), count);
        let sizes = (per_order, count * layout.inner, piece * layout.inner);
        let mut outs = cut(Some(found.estimate), sizes);
        let (mut stds, mut support) = (cut(found.std, sizes), cut(found.support, sizes));
        let per_matrix = count.div_ceil(piece);
        let mut number = 0;
        let tasks = std::iter::from_fn(|| {
            let outs: Vec<&mut [T]> = outs.iter_mut().filter_map(Iterator::next).collect();
            let stds = stds.iter_mut().filter_map(Iterator::next).collect();
            let support = support.iter_mut().find_map(Iterator::next).unwrap_or_default();
            let (outer, first) = (number / per_matrix, number % per_matrix * piece);
            number += 1;
            (!outs.is_empty()).then_some(Task { outer, first, outs, stds, support })
        });
        let work = self.sums.work() + self.holes.work();
        let load = Load { outputs: per_order, work, tasks: layout.outer * per_matrix, threads };
        share(tasks, load, control, |next, progress, between| {
            let mut memory = Memory::default();
            while let Some(mut task) = next() {
                let done = task.outs.first().map_or(0, |out| out.len());
                for column in 0..layout.inner {
                    self.column(x, &mut task, column, layout, &mut memory)?;
                }
                progress.proceed(done, between)?;
            }
            Ok(())
        })
    }

    fn longest(&self) -> usize {
        STRETCH.max(4 * self.whole.span())
    }

    /// The stretches of one row that a task holds.
    fn column<T: Sample>(
        &self,
        x: &[T],
        task: &mut Task<'_, T>,
        column: usize,
        layout: Layout,
        memory: &mut Memory,
    ) -> Result<(), Error> {
        let (inner, span) = (layout.inner, self.whole.span());
        let count = task.outs.first().map_or(0, |out| out.len() / inner);
        // Estimates whose windows lie inside the data.
        let last = (layout.samples + 1).saturating_sub(span).cast_signed();
        let clamp = |start: isize| (start + self.center - task.first.cast_signed()).clamp(0, count.cast_signed());
        let (begin, end) = (clamp(0).cast_unsigned(), clamp(last).cast_unsigned());
        let row = &x[task.outer * layout.samples * inner + column..];
        let mut k = begin;
        while k < end {
            let gone = |k: usize| T::to_f64(task.outs[0][k * inner + column]).is_nan();
            if !gone(k) {
                k += 1;
                continue;
            }
            let mut stop = k + 1;
            while stop < end && stop - k < self.longest() && gone(stop) {
                stop += 1;
            }
            let start = (task.first + k).cast_signed() - self.center;
            let samples = row[start.cast_unsigned() * inner..].iter().step_by(inner).take(stop - k + span - 1);
            if let Some(reference) = self.stretch(samples.map(|x| x.to_f64()), stop - k, memory)? {
                self.write(task, memory, reference, k..stop, (column, inner));
            }
            k = stop;
        }
        Ok(())
    }

    /// Writes the estimates of a stretch, of one column of `inner`.
    fn write<T: Sample>(
        &self,
        task: &mut Task<'_, T>,
        memory: &Memory,
        reference: f64,
        stretch: Range<usize>,
        (column, inner): (usize, usize),
    ) {
        let (length, room, span) = (stretch.len(), stretch.len().next_multiple_of(SIDE), self.whole.span());
        let first = stretch.start * inner + column;
        for (index, &order) in self.orders.iter().enumerate() {
            let (unit, origin) = (self.unit.powi(order as i32), if order == 0 { reference } else { 0.0 });
            let results = &memory.results[index * room..][..length];
            for (result, out) in results.iter().zip(task.outs[index][first..].iter_mut().step_by(inner)) {
                *out = T::from_f64(result * unit + origin);
            }
            let Some(std) = task.stds.get_mut(index) else { continue };
            let gains = &memory.gains[index * room..][..length];
            for (gain, std) in gains.iter().zip(std[first..].iter_mut().step_by(inner)) {
                *std = T::from_f64(gain.max(0.0).sqrt() * unit);
            }
        }
        if !task.support.is_empty() {
            for (k, support) in task.support[first..].iter_mut().step_by(inner).take(length).enumerate() {
                *support = (span - (memory.missing[k + span] - memory.missing[k])) as i64;
            }
        }
    }

    /// The estimates of neighbouring windows, less what is returned, into `memory.results`; none if no sample or an infinite one is
    /// among theirs.
    fn stretch(
        &self,
        samples: impl Iterator<Item = f64>,
        count: usize,
        memory: &mut Memory,
    ) -> Result<Option<f64>, Error> {
        let (span, size, orders) = (self.whole.span(), self.whole.degree + 1, self.orders.len());
        let (held, room) = (count + span - 1, count.next_multiple_of(SIDE));
        at_least(&mut memory.z, held)?;
        at_least(&mut memory.marks, held)?;
        at_least(&mut memory.missing, held + 1)?;
        let z = &mut memory.z[..held];
        z.iter_mut().zip(samples).for_each(|(z, x)| *z = x);
        let Some(reference) = z.iter().copied().find(|z| !z.is_nan()) else { return Ok(None) };
        let mut finite = true;
        memory.missing[0] = 0;
        for (j, z) in z.iter_mut().enumerate() {
            let gone = z.is_nan();
            memory.marks[j] = f64::from(u8::from(gone));
            memory.missing[j + 1] = memory.missing[j] + usize::from(gone);
            *z = if gone { 0.0 } else { *z - reference };
            finite &= z.is_finite();
        }
        if !finite {
            return Ok(None);
        }
        let pairs = size * (size + 1) / 2 * if self.gains { 2 } else { 1 };
        at_least(&mut memory.sums, size * room)?;
        at_least(&mut memory.holes, pairs * room)?;
        at_least(&mut memory.results, orders * room)?;
        at_least(&mut memory.gains, orders * room)?;
        let apply = |runner: &Runner<f64>, x: &[f64], out: &mut [f64], scratch: &mut Scratch<f64>| {
            let mut outs: Vec<&mut [f64]> = out.chunks_mut(room).map(|order| &mut order[..count]).collect();
            runner.apply(Windows { x, first: 0, origin: 0, outs: &mut outs }, scratch)
        };
        apply(&self.sums, z, &mut memory.sums[..size * room], &mut memory.scratch)?;
        apply(&self.holes, &memory.marks[..held], &mut memory.holes[..pairs * room], &mut memory.scratch)?;
        let (sums, holes, results) = (&memory.sums, &memory.holes, &mut memory.results[..orders * room]);
        let gains = &mut memory.gains[..orders * room];
        Arch::new().dispatch(Solve { bulk: self, sums, holes, results, gains, room });
        for (k, first) in memory.missing[..count].iter().enumerate() {
            if span - (memory.missing[k + span] - first) < self.support {
                results.iter_mut().skip(k).step_by(room).for_each(|result| *result = f64::NAN);
            }
        }
        Ok(Some(reference))
    }
}

/// The systems of many windows side by side.
struct Solve<'a> {
    bulk: &'a Bulk<'a>,
    sums: &'a [f64],
    holes: &'a [f64],
    results: &'a mut [f64],
    gains: &'a mut [f64],
    room: usize,
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { bulk, sums, holes, results, gains, room } = self;
        let lanes = size_of::<S::f64s>() / size_of::<f64>();
        let (size, whole) = (bulk.whole.degree + 1, bulk.whole);
        let zero = simd.splat_f64s(0.0);
        for first in (0..room).step_by(lanes) {
            // L D L^T with unit diagonal; `below` holds L D.
            let (mut lower, mut below, mut inverse) = ([[zero; SIDE]; SIDE], [[zero; SIDE]; SIDE], [zero; SIDE]);
            let mut pivots = simd.splat_f64s(1.0);
            let mut pair = 0;
            for i in 0..size {
                for j in 0..=i {
                    let missing = load::<S>(&holes[pair * room + first..]);
                    let mut value = simd.sub_f64s(simd.splat_f64s(if i == j { 1.0 } else { 0.0 }), missing);
                    for k in 0..j {
                        value = simd.sub_f64s(value, simd.mul_f64s(below[i][k], lower[j][k]));
                    }
                    if i == j {
                        pivots = simd.min_f64s(pivots, value);
                        inverse[i] = reciprocal::<S>(value);
                    } else {
                        below[i][j] = value;
                        lower[i][j] = simd.mul_f64s(value, inverse[j]);
                    }
                    pair += 1;
                }
            }
            for (index, limit) in bulk.limits.iter().enumerate() {
                let moments = &bulk.aim.moments[index * whole.size..][..size];
                let mut g = [zero; SIDE];
                for i in 0..size {
                    g[i] = simd.splat_f64s(moments[i]);
                    for k in 0..i {
                        g[i] = simd.sub_f64s(g[i], simd.mul_f64s(lower[i][k], g[k]));
                    }
                }
                for i in (0..size).rev() {
                    g[i] = simd.mul_f64s(g[i], inverse[i]);
                    for k in i + 1..size {
                        g[i] = simd.sub_f64s(g[i], simd.mul_f64s(lower[k][i], g[k]));
                    }
                }
                let (mut estimate, mut gain) = (zero, zero);
                for (i, &factor) in g.iter().enumerate().take(size) {
                    estimate = simd.mul_add_e_f64s(factor, load::<S>(&sums[i * room + first..]), estimate);
                    let mut row = zero;
                    for (spread, g) in whole.spread[i * whole.size..][..size].iter().zip(g) {
                        row = simd.mul_add_e_f64s(simd.splat_f64s(*spread), g, row);
                    }
                    gain = simd.mul_add_e_f64s(row, factor, gain);
                }
                // Or else the missing samples' share is left in: an upper bound.
                if bulk.gains {
                    let mut pair = size * (size + 1) / 2;
                    for i in 0..size {
                        for j in 0..=i {
                            let twice = simd.splat_f64s(if i == j { 1.0 } else { 2.0 });
                            let share = simd.mul_f64s(simd.mul_f64s(g[i], g[j]), twice);
                            let missing = load::<S>(&holes[pair * room + first..]);
                            gain = simd.sub_f64s(gain, simd.mul_f64s(share, missing));
                            pair += 1;
                        }
                    }
                    store::<S>(&mut gains[index * room + first..], gain);
                }
                let nan = simd.splat_f64s(f64::NAN);
                let bounded = simd.less_than_or_equal_f64s(gain, simd.splat_f64s(*limit));
                let solved = simd.less_than_f64s(simd.splat_f64s(SMALLEST_PIVOT), pivots);
                estimate = simd.select_f64s(bounded, estimate, nan);
                estimate = simd.select_f64s(solved, estimate, nan);
                store::<S>(&mut results[index * room + first..], estimate);
            }
        }
    }
}
