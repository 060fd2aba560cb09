//! One thread's part of a run: the outputs of rows and columns, their interior by the engine and their ends by the mode.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::control::Unattended;
use crate::ends::Mode;
use crate::engine::{Runner, Sample, Scratch};
use crate::error::{Error, resize, try_vec};
use crate::fit::Fit;
use crate::plan::Plan;

/// Outputs of one row that are worked on at a time, at most.
pub const PIECE: usize = 1 << 13;

/// Multiplications between two looks at the stop flag: a few milliseconds.
const SLICE: usize = 1 << 22;

/// Columns that are gathered together when the differentiated axis is not the last: a cache line of them.
const COLUMN_BYTES: usize = 64;

/// Samples gathered at a time, over all columns of a group: bounds the memory for long windows.
const GATHERED: usize = 1 << 19;

/// The shape of a contiguous array around the differentiated axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Product of the sizes of the axes before.
    pub outer: usize,
    /// Samples along the differentiated axis.
    pub samples: usize,
    /// Product of the sizes of the axes after.
    pub inner: usize,
}

impl Layout {
    /// A single row.
    #[must_use]
    pub fn row(samples: usize) -> Self {
        Self { outer: 1, samples, inner: 1 }
    }

    /// Outputs of one row.
    #[must_use]
    pub fn outputs(self, mode: Mode, window_length: usize) -> usize {
        match mode {
            Mode::Valid => (self.samples + 1).saturating_sub(window_length),
            _ => self.samples,
        }
    }

    pub(crate) fn size(self, per_row: usize) -> Option<usize> {
        self.outer.checked_mul(per_row)?.checked_mul(self.inner)
    }
}

/// What every thread of a run needs to know.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a, T: Sample> {
    /// The design.
    pub plan: &'a Plan,
    /// The engine of the interior.
    pub runner: &'a Runner<T>,
    /// The fit that estimates the ends, for [`Mode::Fit`].
    pub fit: Option<&'a Fit>,
    /// How the ends are treated.
    pub mode: Mode,
    /// Output `i` reads the window that starts at sample `i - center`.
    pub center: isize,
    /// The interior outputs of a row: `interior.0..interior.1`.
    pub interior: (usize, usize),
    /// The array.
    pub layout: Layout,
}

impl<T: Sample> Rows<'_, T> {
    /// Outputs of one row.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.layout.outputs(self.mode, self.plan.span())
    }

    /// Whether rows are gathered together with their extensions, so that every output is an interior one: columns, and
    /// rows so short that their ends are most of them.
    #[must_use]
    pub fn gathers_ends(&self) -> bool {
        self.mode.extends() && (self.layout.inner > 1 || self.outputs() <= PIECE)
    }
}

/// One row of a contiguous array: every `step`-th sample from `first`.
#[derive(Clone, Copy)]
struct Row<'a, T> {
    x: &'a [T],
    step: usize,
    first: usize,
}

impl<T: Copy> Row<'_, T> {
    fn get(&self, index: usize) -> T {
        self.x[self.first + index * self.step]
    }
}

/// A thread's own memory, and the signal to stop.
pub struct Worker<'a, T: Sample> {
    rows: Rows<'a, T>,
    stop: &'a AtomicBool,
    scratch: Scratch<T>,
    gathered: Vec<T>,
    results: Vec<T>,
    window: Vec<f64>,
    /// The last fit at an end, and the row and window that it belongs to: a long end comes in several pieces.
    fitted: Option<((usize, usize), Vec<f64>)>,
}

impl<'a, T: Sample> Worker<'a, T> {
    /// Memory for one thread.
    pub fn new(rows: Rows<'a, T>, stop: &'a AtomicBool) -> Self {
        let scratch = Scratch::default();
        Self { rows, stop, scratch, gathered: Vec::new(), results: Vec::new(), window: Vec::new(), fitted: None }
    }

    /// Outputs `start..` of the matrix `x` of `(samples, inner)`, as many as `out` of `(outputs, inner)` holds.
    pub fn run(&mut self, x: &[T], start: usize, out: &mut [T], between: &mut impl FnMut()) -> Result<(), Error> {
        let inner = self.rows.layout.inner;
        if inner == 1 && !self.rows.gathers_ends() {
            let (head, body, tail) = self.split(start, out);
            let row = Row { x, step: 1, first: 0 };
            self.end(row, start, head, between)?;
            let first = start + head.len();
            self.end(row, first + body.len(), tail, between)?;
            // Where there is no interior, its window may start beyond the data.
            let window = if body.is_empty() { 0 } else { self.window_start(first) };
            return self.interior(x, window, 0, body, between);
        }
        let end = start + out.len() / inner;
        let group = (GATHERED / (end - start + self.rows.runner.span())).clamp(1, COLUMN_BYTES / size_of::<T>());
        for column in (0..inner).step_by(group) {
            self.columns(x, (start, end), column, group.min(inner - column), out, between)?;
            between();
            if self.stopped() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Outputs `start..end` of `width` neighbouring columns: gathered into rows, computed, and put back.
    fn columns(
        &mut self,
        x: &[T],
        (start, end): (usize, usize),
        column: usize,
        width: usize,
        out: &mut [T],
        between: &mut impl FnMut(),
    ) -> Result<(), Error> {
        let inner = self.rows.layout.inner;
        let outputs = end - start;
        let mut results = std::mem::take(&mut self.results);
        let mut gathered = std::mem::take(&mut self.gathered);
        resize(&mut results, outputs * width)?;
        let samples = self.gather(x, (start, end), column, width, &mut gathered)?;
        for (offset, result) in results.chunks_mut(outputs).enumerate() {
            let (head, body, tail) = self.split(start, result);
            let row = Row { x, step: inner, first: column + offset };
            self.end(row, start, head, between)?;
            self.end(row, end - tail.len(), tail, between)?;
            let origin = (start + head.len()).cast_signed() - self.rows.center;
            self.interior(&gathered[offset * samples..(offset + 1) * samples], 0, origin, body, between)?;
        }
        for (index, line) in out[column..].chunks_mut(inner).enumerate() {
            for (offset, value) in line.iter_mut().take(width).enumerate() {
                *value = results[offset * outputs + index];
            }
        }
        (self.results, self.gathered) = (results, gathered);
        Ok(())
    }

    /// Gathers the samples that the interior outputs of `start..end` read, one column after another; says how many of each.
    fn gather(
        &self,
        x: &[T],
        (start, end): (usize, usize),
        column: usize,
        width: usize,
        gathered: &mut Vec<T>,
    ) -> Result<usize, Error> {
        let Rows { runner, mode, layout, center, .. } = self.rows;
        let (first, last) = self.interior_within(start, end);
        let samples = if first < last { last - first + runner.span() - 1 } else { 0 };
        resize(gathered, samples * width)?;
        let constant = T::from_f64(if let Mode::Constant(value) = mode { value } else { 0.0 });
        for (index, place) in (0..samples).zip(first.cast_signed() - center..) {
            let line = mode.source(place, layout.samples).map(|source| &x[source * layout.inner + column..][..width]);
            for offset in 0..width {
                gathered[offset * samples + index] = line.map_or(constant, |line| line[offset]);
            }
        }
        Ok(samples)
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Where the window of an interior output starts.
    fn window_start(&self, output: usize) -> usize {
        (output.cast_signed() - self.rows.center).max(0).cast_unsigned()
    }

    fn interior_within(&self, start: usize, end: usize) -> (usize, usize) {
        let (first, last) = self.rows.interior;
        (first.clamp(start, end), last.clamp(start, end))
    }

    /// The outputs from `start` in three parts: before, in and after the interior.
    fn split<'o>(&self, start: usize, out: &'o mut [T]) -> (&'o mut [T], &'o mut [T], &'o mut [T]) {
        let (first, last) = self.interior_within(start, start + out.len());
        let (head, rest) = out.split_at_mut(first - start);
        let (body, tail) = rest.split_at_mut(last - first);
        (head, body, tail)
    }

    /// Outputs whose windows start at `x[first]` and on, in slices short enough to stop between them.
    fn interior(
        &mut self,
        x: &[T],
        first: usize,
        origin: isize,
        out: &mut [T],
        between: &mut impl FnMut(),
    ) -> Result<(), Error> {
        let span = self.rows.runner.span();
        let slice = (SLICE / span.max(1)).max(64);
        for (index, piece) in out.chunks_mut(slice).enumerate() {
            if index > 0 {
                between();
                if self.stopped() {
                    return Err(Error::Interrupted);
                }
            }
            self.rows.runner.apply(x, first + index * slice, origin, &mut [piece], &mut self.scratch)?;
        }
        Ok(())
    }

    /// Outputs from `start`, all before or all after the interior.
    fn end(&mut self, row: Row<'_, T>, start: usize, out: &mut [T], between: &mut impl FnMut()) -> Result<(), Error> {
        if out.is_empty() {
            return Ok(());
        }
        match (self.rows.mode, self.rows.fit) {
            (Mode::Fit, Some(fit)) => self.fitted_end(fit, row, start, out),
            (mode, _) if mode.extends() => self.extended_end(row, start, out, between),
            _ => {
                out.fill(T::from_f64(f64::NAN));
                Ok(())
            }
        }
    }

    /// The fit of the first or last whole window, evaluated at the samples themselves.
    fn fitted_end(&mut self, fit: &Fit, row: Row<'_, T>, start: usize, out: &mut [T]) -> Result<(), Error> {
        let Rows { plan, interior, layout, .. } = self.rows;
        let (deriv, length) = (plan.design().deriv, fit.span());
        let first = if start < interior.0 { 0 } else { layout.samples - length };
        // Where constants are reproduced, any may be taken out first: what is left has the size of the signal's variation.
        let reference = if plan.keeps_constants() { row.get(first).to_f64() } else { 0.0 };
        let key = (row.x.as_ptr().wrapping_add(row.first) as usize, first);
        if self.fitted.as_ref().is_none_or(|(fitted, _)| *fitted != key) {
            resize(&mut self.window, length)?;
            for (index, value) in self.window.iter_mut().enumerate() {
                *value = row.get(first + index).to_f64() - reference;
            }
            self.fitted = Some((key, fit.coefficients(&self.window, &Unattended)?));
        }
        let coefficients = self.fitted.as_ref().map_or(&[][..], |(_, coefficients)| coefficients);
        let derivative = fit.derivative(coefficients, deriv);
        let back = if deriv == 0 { reference } else { 0.0 };
        for (value, output) in out.iter_mut().zip(start..) {
            let position = (output.cast_signed() - first.cast_signed()) as f64;
            *value = T::from_f64(derivative(position) * plan.unit() + back);
        }
        Ok(())
    }

    /// The interior's taps on the extended data.
    fn extended_end(
        &mut self,
        row: Row<'_, T>,
        start: usize,
        out: &mut [T],
        between: &mut impl FnMut(),
    ) -> Result<(), Error> {
        let Rows { mode, layout, center, runner, .. } = self.rows;
        let constant = if let Mode::Constant(value) = mode { value } else { 0.0 };
        let mut extended = try_vec(out.len() + runner.span() - 1, T::from_f64(constant))?;
        let window = start.cast_signed() - center;
        for (value, index) in extended.iter_mut().zip(window..) {
            if let Some(source) = mode.source(index, layout.samples) {
                *value = row.get(source);
            }
        }
        self.interior(&extended, 0, window, out, between)
    }
}
