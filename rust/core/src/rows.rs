//! One thread's part of a run, row by row: the interior by the engine, the ends by the mode.

#![expect(clippy::indexing_slicing, reason = "windows lie in their rows, which are extended before they are cut")]

use std::ops::Range;

use crate::ends::Mode;
use crate::engine::{Buffer, Sample, Scratch, Windows};
use crate::error::{Error, at_least};
use crate::fit::ends::End;
use crate::frame::Frame;
use crate::threads::Progress;

/// Multiplications between two looks at the stop flag: less than a few milliseconds.
const SLICE: usize = 1 << 22;

/// A thread's own memory, and the signal to stop.
pub struct Worker<'a, T: Sample> {
    pub(crate) frame: &'a Frame<'a, T>,
    progress: &'a Progress,
    pub(crate) scratch: Scratch<T>,
    pub(crate) gathered: Buffer<T>,
    pub(crate) results: Buffer<T>,
    extended: Vec<T>,
    pub(crate) coefficients: Vec<f64>,
    /// The last fits at an end of a long window, and where it is: a long end comes in several pieces.
    fitted: Vec<(Key, Vec<f64>)>,
}

/// An end of a row: which row, and where its window starts.
type Key = (usize, isize);

/// A row: `x[0]` is the sample `start` of it.
#[derive(Clone, Copy)]
pub struct Row<'x, T> {
    /// The samples at hand.
    pub x: &'x [T],
    /// Where they start.
    pub start: isize,
    /// Tells rows apart.
    pub number: usize,
    /// Whether `x` goes on beyond the ends as the mode says.
    pub extended: bool,
}

impl<'x, T> Row<'x, T> {
    /// The samples from `place` on.
    fn from(&self, place: isize) -> &'x [T] {
        &self.x[(place - self.start).cast_unsigned()..]
    }
}

impl<'a, T: Sample> Worker<'a, T> {
    /// Memory for one thread.
    pub fn new(frame: &'a Frame<'a, T>, progress: &'a Progress) -> Self {
        Self {
            frame,
            progress,
            scratch: Scratch::default(),
            gathered: Buffer::default(),
            results: Buffer::default(),
            extended: Vec::new(),
            coefficients: Vec::new(),
            fitted: Vec::new(),
        }
    }

    /// Whether to go on.
    pub fn proceed(&self, between: &mut dyn FnMut()) -> Result<(), Error> {
        self.progress.proceed(0, between)
    }

    /// `outputs` of one row, for every order.
    pub fn row(
        &mut self,
        row: Row<'_, T>,
        outputs: Range<usize>,
        outs: &mut [&mut [T]],
        between: &mut dyn FnMut(),
    ) -> Result<(), Error> {
        let body = if row.extended { outputs.clone() } else { self.frame.inside(&outputs) };
        self.end(row, outputs.start..body.start, &mut part(outs, 0..body.start - outputs.start), between)?;
        let at = |output: usize| output - outputs.start;
        if !body.is_empty() {
            self.interior(row, &body, &mut part(outs, at(body.start)..at(body.end)), between)?;
        }
        self.end(row, body.end..outputs.end, &mut part(outs, at(body.end)..at(outputs.end)), between)
    }

    /// Outputs whose windows lie in `row`, in slices short enough to stop between them.
    fn interior(
        &mut self,
        row: Row<'_, T>,
        outputs: &Range<usize>,
        outs: &mut [&mut [T]],
        between: &mut dyn FnMut(),
    ) -> Result<(), Error> {
        let frame = self.frame;
        let slice = (SLICE / frame.runner.work().max(1)).max(64).max(frame.runner.stretch());
        let mut done = 0;
        while done < outputs.len() {
            let output = outputs.start + done;
            let first = (frame.window(output) - row.start).cast_unsigned();
            let next = frame.piece(output, slice).min(outputs.len() - done);
            if next == outputs.len() {
                return frame.runner.apply(Windows { x: row.x, first, origin: row.start, outs }, &mut self.scratch);
            }
            let outs = &mut part(outs, done..done + next);
            frame.runner.apply(Windows { x: row.x, first, origin: row.start, outs }, &mut self.scratch)?;
            done += next;
            self.proceed(between)?;
        }
        Ok(())
    }

    /// Outputs all before or all after the interior.
    fn end(
        &mut self,
        row: Row<'_, T>,
        outputs: Range<usize>,
        outs: &mut [&mut [T]],
        between: &mut dyn FnMut(),
    ) -> Result<(), Error> {
        if outputs.is_empty() {
            return Ok(());
        }
        match self.frame.mode {
            Mode::Fit => self.fitted_end(row, &outputs, outs),
            mode if mode.extends() => self.extended_end(row, &outputs, outs, between),
            _ => {
                outs.iter_mut().for_each(|out| out.fill(T::from_f64(f64::NAN)));
                Ok(())
            }
        }
    }

    /// The fit of the first or last whole window, evaluated at the samples themselves.
    fn fitted_end(&mut self, row: Row<'_, T>, outputs: &Range<usize>, outs: &mut [&mut [T]]) -> Result<(), Error> {
        let frame = self.frame;
        let first = frame.end_window(outputs);
        let position = outputs.start.cast_signed() - first;
        let window = row.from(first);
        for (order, (end, out)) in frame.ends.iter().zip(outs).enumerate() {
            if let Some(tables) = end.tables {
                end.estimate(tables, window, position, out, &mut self.coefficients)?;
                continue;
            }
            let reference = if end.keeps_constants { window[0].to_f64() } else { 0.0 };
            let coefficients = self.fitted(end, order, (row.number, first), window, reference)?;
            end.evaluate(coefficients, reference, position, out);
        }
        Ok(())
    }

    /// The coefficients of the fit to `window`, the last ones if they are of the same end.
    fn fitted(&mut self, end: &End<'_>, order: usize, key: Key, window: &[T], reference: f64) -> Result<&[f64], Error> {
        if self.fitted.len() <= order {
            self.fitted.resize(order + 1, ((usize::MAX, 0), Vec::new()));
        }
        let fitted = &mut self.fitted[order];
        if fitted.0 != key {
            let fill = |start: usize, part: &mut [f64]| {
                part.iter_mut().zip(&window[start..]).for_each(|(value, sample)| *value = sample.to_f64() - reference);
            };
            *fitted = (key, end.fit.coefficients(fill)?);
        }
        Ok(&fitted.1)
    }

    /// The interior's taps on the extended data.
    fn extended_end(
        &mut self,
        row: Row<'_, T>,
        outputs: &Range<usize>,
        outs: &mut [&mut [T]],
        between: &mut dyn FnMut(),
    ) -> Result<(), Error> {
        let (frame, mut extended) = (self.frame, std::mem::take(&mut self.extended));
        let reads = frame.window(outputs.start)..frame.window(outputs.end - 1) + frame.runner.span().cast_signed();
        let length = (reads.end - reads.start).cast_unsigned();
        at_least(&mut extended, length)?;
        for (value, place) in extended.iter_mut().zip(reads.clone()) {
            *value = frame.source(place).map_or(frame.constant(), |source| row.x[source]);
        }
        let row = Row { x: &extended[..length], start: reads.start, ..row };
        let result = self.interior(row, outputs, outs, between);
        self.extended = extended;
        result
    }
}

/// The same part of every slice.
fn part<'o, T>(outs: &'o mut [&mut [T]], range: Range<usize>) -> Vec<&'o mut [T]> {
    outs.iter_mut().map(|out| &mut out[range.clone()]).collect()
}
