//! Where outputs and the samples that they read lie in a row.

use std::ops::Range;

use crate::columns::Gather;
use crate::ends::Mode;
use crate::engine::{Runner, Sample};
use crate::fit::ends::End;

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

    /// Rows and columns.
    pub(crate) fn rows(self) -> Option<usize> {
        self.outer.checked_mul(self.inner)
    }
}

/// What every thread of a run needs to know. Outputs and samples are counted from the start of the whole row.
#[derive(Debug)]
pub struct Frame<'a, T: Sample> {
    /// The engine of the interior.
    pub runner: &'a Runner<T>,
    /// The estimates at the ends, for every order, in [`Mode::Fit`].
    pub ends: Vec<End<'a>>,
    /// How the ends are treated.
    pub mode: Mode,
    /// Output `i` reads the window that starts at sample `i - center`.
    pub center: isize,
    /// The outputs whose windows lie inside the row.
    pub interior: Range<usize>,
    /// Samples of a row.
    pub samples: usize,
    /// The array as far as it is at hand.
    pub layout: Layout,
    /// The first sample that is at hand.
    pub start: usize,
    /// The outputs that are wanted.
    pub wanted: Range<usize>,
    /// Number of orders.
    pub orders: usize,
    /// How rows are gathered.
    pub gather: Gather,
}

impl<T: Sample> Frame<'_, T> {
    /// Outputs of one row.
    pub fn outputs(&self) -> usize {
        self.wanted.len()
    }

    /// Where the window of an output starts.
    pub fn window(&self, output: usize) -> isize {
        output.cast_signed() - self.center
    }

    /// How many outputs from `output` on make a piece that ends on the grid.
    pub fn piece(&self, output: usize, at_most: usize) -> usize {
        let grid = self.runner.grid();
        let length = at_most.next_multiple_of(grid).max(1);
        length - self.window(output).rem_euclid(grid.cast_signed()).cast_unsigned()
    }

    /// The interior outputs of `outputs`, where the data are extended all of them.
    pub fn body(&self, outputs: &Range<usize>) -> Range<usize> {
        if self.mode.extends() { outputs.clone() } else { self.inside(outputs) }
    }

    /// The outputs of `outputs` whose windows lie inside the row.
    pub fn inside(&self, outputs: &Range<usize>) -> Range<usize> {
        let within = |output: usize| output.clamp(outputs.start, outputs.end);
        within(self.interior.start)..within(self.interior.end)
    }

    /// Where the window starts whose fit estimates `outputs`, all of them at the same end.
    pub fn end_window(&self, outputs: &Range<usize>) -> isize {
        if outputs.start < self.interior.start {
            return 0;
        }
        self.samples.cast_signed() - self.runner.span().cast_signed()
    }

    /// The samples, of the extended row if the mode extends it, that the windows of `outputs` and the ends' fits hold.
    pub fn reads(&self, outputs: &Range<usize>) -> Range<isize> {
        let (span, samples) = (self.runner.span().cast_signed(), self.samples.cast_signed());
        let body = self.body(outputs);
        let (mut first, mut last) = (isize::MAX, isize::MIN);
        if !body.is_empty() {
            (first, last) = (self.window(body.start), self.window(body.end - 1) + span);
        }
        if !self.ends.is_empty() {
            if outputs.start < body.start {
                (first, last) = (first.min(0), last.max(span));
            }
            if body.end < outputs.end {
                (first, last) = (first.min(samples - span), last.max(samples));
            }
        }
        if first < last { first..last } else { 0..0 }
    }

    /// The samples of the row itself behind [`Frame::reads`].
    pub fn needs(&self, outputs: &Range<usize>) -> Range<usize> {
        let reads = self.reads(outputs);
        let inside = self.within(&reads);
        let mut needs = inside.start.cast_unsigned()..inside.end.cast_unsigned();
        // Extensions repeat after two rows.
        let outside = (reads.start..inside.start).rev().take(2 * self.samples);
        for place in outside.chain((inside.end..reads.end).take(2 * self.samples)) {
            if let Some(source) = self.mode.source(place, self.samples) {
                needs = if needs.is_empty() {
                    source..source + 1
                } else {
                    needs.start.min(source)..needs.end.max(source + 1)
                };
            }
        }
        needs
    }

    /// The part of `reads` that lies in the row itself; where there is none, it is empty and lies where that would be.
    pub fn within(&self, reads: &Range<isize>) -> Range<isize> {
        let samples = self.samples.cast_signed();
        let start = reads.start.max(0).min(reads.end);
        start..reads.end.min(samples).max(start)
    }

    /// Where in the rows at hand the sample at `place` of the extended row is; none where a constant stands.
    pub fn source(&self, place: isize) -> Option<usize> {
        self.mode.source(place, self.samples).map(|sample| sample - self.start)
    }

    /// What stands where there is no sample.
    pub fn constant(&self) -> T {
        T::from_f64(if let Mode::Constant(value) = self.mode { value } else { 0.0 })
    }
}
