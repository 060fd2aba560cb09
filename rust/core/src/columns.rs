//! Several rows at once: columns, and short rows, gathered into strips whose samples stand side by side.

#![expect(
    clippy::indexing_slicing,
    reason = "strips and tiles are cut to the rows that they lie in before anything is computed"
)]

use std::ops::Range;

use crate::ends::Mode;
use crate::engine::{Runner, Sample, Windows};
use crate::error::Error;
use crate::frame::Layout;
use crate::moves::{Collect, Spread, Transpose, dispatch};
use crate::rows::{Row, Worker};

/// Bytes of a tile, gathered samples and results together, that stay in the second cache.
const TILE_BYTES: usize = 384 << 10;

/// Bytes of a strip beside which long windows are gathered one by one.
const STRIP_BYTES: usize = 1 << 20;

/// Outputs of a row up to which rows are worked on side by side.
const SHORT: usize = 1000;

/// How the samples of several rows are gathered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gather {
    /// Not at all: one row after another, where it is.
    Rows,
    /// Short rows, side by side.
    Bundles,
    /// Strips of neighbouring columns.
    Strips {
        /// Outputs at a time.
        outputs: usize,
        /// Columns at a time, in strips of [`Sample::LANES`].
        width: usize,
    },
    /// Neighbouring columns, each as a row.
    Columns {
        /// Outputs at a time.
        outputs: usize,
        /// Columns at a time.
        width: usize,
    },
}

impl Gather {
    /// The way that suits rows of `row` outputs, of which `wanted` are asked for: whether rows go side by side does not
    /// depend on the part that is at hand.
    pub fn new<T: Sample>(runner: &Runner<T>, layout: Layout, orders: usize, row: usize, wanted: usize) -> Self {
        let (span, lanes, size) = (runner.span(), T::LANES, size_of::<T>());
        let rows = runner.prefers_rows();
        if layout.inner == 1 {
            let short = row <= SHORT && span <= SHORT && layout.outer >= lanes;
            return if short && !rows { Self::Bundles } else { Self::Rows };
        }
        let width = |bytes: usize, outputs: usize| bytes / size / (outputs * (1 + orders) + span);
        let outputs = (2 * span).max(256);
        if width(STRIP_BYTES, outputs.min(row)) >= lanes && !rows {
            let outputs = outputs.min(wanted);
            let width = (width(TILE_BYTES, outputs) / lanes).clamp(1, 64) * lanes;
            return Self::Strips { outputs, width };
        }
        let outputs = wanted.min((2 * span).clamp(1 << 13, 1 << 16));
        Self::Columns { outputs, width: width(STRIP_BYTES, outputs).clamp(1, lanes) }
    }
}

impl<T: Sample> Worker<'_, T> {
    /// `outputs` of neighbouring columns of the matrix `x`, from `column` on; `lines` are the places of the results, as
    /// many for every order as there are outputs, each as wide as there are columns.
    pub fn panel(
        &mut self,
        x: &[T],
        column: usize,
        outputs: &Range<usize>,
        lines: &mut [&mut [T]],
        between: &mut dyn FnMut(),
    ) -> Result<(), Error> {
        let wide = lines.first().map_or(0, |line| line.len());
        let (strips, width) = match self.frame.gather {
            Gather::Strips { width, .. } => (true, width),
            Gather::Columns { width, .. } => (false, width),
            Gather::Rows | Gather::Bundles => (false, 1),
        };
        for offset in (0..wide).step_by(width.max(1)) {
            let columns = offset..wide.min(offset + width);
            if strips {
                self.tile(x, column, &columns, outputs, lines)?;
            } else {
                self.group(x, column, &columns, outputs, lines, between)?;
            }
            self.proceed(between)?;
        }
        Ok(())
    }

    /// One tile: `columns` of the panel that starts at `column`.
    fn tile(
        &mut self,
        x: &[T],
        column: usize,
        columns: &Range<usize>,
        outputs: &Range<usize>,
        lines: &mut [&mut [T]],
    ) -> Result<(), Error> {
        let (frame, lanes) = (self.frame, T::LANES);
        let reads = frame.reads(outputs);
        let (length, strips) = ((reads.end - reads.start).cast_unsigned() * lanes, columns.len().div_ceil(lanes));
        let result = outputs.len() * lanes;
        let (mut gathered, mut results) = (std::mem::take(&mut self.gathered), std::mem::take(&mut self.results));
        gathered.fit(length * strips)?;
        results.fit(result * strips * frame.orders)?;
        self.spread(&x[column + columns.start..], columns.len(), &reads, &mut gathered);
        for strip in 0..strips {
            let results = &mut results[strip * result * frame.orders..][..result * frame.orders];
            let mut outs: Vec<&mut [T]> = results.chunks_mut(result.max(1)).collect();
            self.strip(&gathered[strip * length..][..length], &reads, outputs, &mut outs)?;
        }
        for (order, lines) in lines.chunks_mut(outputs.len()).enumerate() {
            let (strips, step) = (&results[order * result..], outputs.len() * frame.orders);
            dispatch(Collect { strips, step, lines, offset: columns.start, width: columns.len() });
        }
        (self.gathered, self.results) = (gathered, results);
        Ok(())
    }

    /// The samples `reads` of the first `width` columns of `x`, in strips.
    fn spread(&self, x: &[T], width: usize, reads: &Range<isize>, strips: &mut [T]) {
        let (frame, inner) = (self.frame, self.frame.layout.inner);
        let step = (reads.end - reads.start).cast_unsigned();
        let inside = frame.within(reads);
        let at = |place: isize| (place - reads.start).cast_unsigned();
        if let Some(source) = inside.clone().next().and_then(|place| frame.source(place)) {
            let (x, count, at) = (&x[source * inner..], at(inside.end) - at(inside.start), at(inside.start));
            dispatch(Spread { x, inner, count, width, strips, step, at });
        }
        for place in (reads.start..inside.start).chain(inside.end..reads.end) {
            let at = at(place);
            if let Some(source) = frame.source(place) {
                dispatch(Spread { x: &x[source * inner..], inner, count: 1, width, strips, step, at });
                continue;
            }
            for line in strips.chunks_mut(T::LANES).skip(at).step_by(step).take(width.div_ceil(T::LANES)) {
                line.fill(frame.constant());
            }
        }
    }

    /// Short rows: `outputs` of every row of `x`, a matrix with the samples at hand of a row in each.
    pub fn bundle(&mut self, x: &[T], outputs: &Range<usize>, outs: &mut [&mut [T]]) -> Result<(), Error> {
        let (frame, lanes) = (self.frame, T::LANES);
        let (held, reads) = (frame.layout.samples, frame.reads(outputs));
        let rows = outs.first().map_or(0, |out| out.len() / outputs.len());
        let length = (reads.end - reads.start).cast_unsigned() * lanes;
        let result = outputs.len() * lanes;
        let (mut gathered, mut results) = (std::mem::take(&mut self.gathered), std::mem::take(&mut self.results));
        gathered.fit(length)?;
        results.fit(result * frame.orders)?;
        if rows < lanes {
            gathered.fill(T::default());
        }
        let inside = frame.within(&reads);
        if let Some(source) = inside.clone().next().and_then(|place| frame.source(place)) {
            let to = &mut gathered[(inside.start - reads.start).cast_unsigned() * lanes..];
            let columns = (inside.end - inside.start).cast_unsigned();
            dispatch(Transpose { from: &x[source..], from_step: held, to, to_step: lanes, rows, columns });
        }
        for (index, place) in reads.clone().enumerate().filter(|(_, place)| !inside.contains(place)) {
            let source = frame.source(place);
            for (row, value) in gathered[index * lanes..][..rows].iter_mut().enumerate() {
                *value = source.map_or(frame.constant(), |source| x[row * held + source]);
            }
        }
        let mut strips: Vec<&mut [T]> = results.chunks_mut(result.max(1)).take(frame.orders).collect();
        self.strip(&gathered[..length], &reads, outputs, &mut strips)?;
        for (strip, out) in strips.iter().zip(outs) {
            let (rows, columns) = (outputs.len(), rows);
            dispatch(Transpose { from: strip, from_step: lanes, to: out, to_step: rows, rows, columns });
        }
        (self.gathered, self.results) = (gathered, results);
        Ok(())
    }

    /// `outputs` of the rows that stand side by side in `x`, whose samples are `reads`.
    fn strip(
        &mut self,
        x: &[T],
        reads: &Range<isize>,
        outputs: &Range<usize>,
        outs: &mut [&mut [T]],
    ) -> Result<(), Error> {
        let (frame, lanes) = (self.frame, T::LANES);
        let body = frame.body(outputs);
        let at = |output: usize| (output - outputs.start) * lanes;
        let from = |place: isize| &x[(place - reads.start).cast_unsigned() * lanes..];
        if !body.is_empty() {
            let window = frame.window(body.start);
            let length = (body.len() + frame.runner.span() - 1) * lanes;
            let mut outs: Vec<&mut [T]> = outs.iter_mut().map(|out| &mut out[at(body.start)..at(body.end)]).collect();
            let windows = Windows { x: &from(window)[..length], first: 0, origin: window, outs: &mut outs };
            frame.runner.apply_lanes(windows, &mut self.scratch)?;
        }
        for end in [outputs.start..body.start, body.end..outputs.end] {
            if end.is_empty() {
                continue;
            }
            for (order, out) in outs.iter_mut().enumerate() {
                let out = &mut out[at(end.start)..at(end.end)];
                let Some(fit) = frame.ends.get(order).filter(|_| frame.mode == Mode::Fit) else {
                    out.fill(T::from_f64(f64::NAN));
                    continue;
                };
                let first = frame.end_window(&end);
                let position = end.start.cast_signed() - first;
                fit.estimate_lanes(from(first), position, out, &mut self.coefficients)?;
            }
        }
        Ok(())
    }

    /// Columns gathered into rows, computed one by one, and put back.
    fn group(
        &mut self,
        x: &[T],
        column: usize,
        columns: &Range<usize>,
        outputs: &Range<usize>,
        lines: &mut [&mut [T]],
        between: &mut dyn FnMut(),
    ) -> Result<(), Error> {
        let (frame, inner) = (self.frame, self.frame.layout.inner);
        let reads = frame.reads(outputs);
        let length = (reads.end - reads.start).cast_unsigned();
        let result = outputs.len() * frame.orders;
        let (mut gathered, mut results) = (std::mem::take(&mut self.gathered), std::mem::take(&mut self.results));
        gathered.fit(length * columns.len())?;
        results.fit(result * columns.len())?;
        for (index, place) in reads.clone().enumerate() {
            let line = frame.source(place).map(|source| &x[source * inner + column..][columns.clone()]);
            for offset in 0..columns.len() {
                gathered[offset * length + index] = line.map_or(frame.constant(), |line| line[offset]);
            }
        }
        for (offset, results) in results.chunks_mut(result.max(1)).take(columns.len()).enumerate() {
            let mut outs: Vec<&mut [T]> = results.chunks_mut(outputs.len()).collect();
            let number = x.as_ptr().wrapping_add(column + columns.start + offset) as usize;
            let x = &gathered[offset * length..][..length];
            let row = Row { x, start: reads.start, number, extended: frame.mode.extends() };
            self.row(row, outputs.clone(), &mut outs, between)?;
        }
        for (index, line) in lines.iter_mut().enumerate() {
            for (offset, value) in line[columns.clone()].iter_mut().enumerate() {
                *value = results[offset * result + index];
            }
        }
        (self.gathered, self.results) = (gathered, results);
        Ok(())
    }
}
