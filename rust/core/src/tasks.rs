//! Work cut into tasks, each of which owns its part of the output.

use std::ops::Range;

use crate::columns::Gather;
use crate::engine::Sample;
use crate::frame::Frame;

/// Work that makes a task worth handing out, in multiplications: some tenths of a millisecond.
const TASK: usize = 1 << 20;

/// What moving a sample from and to memory costs, in multiplications.
const MOVE: usize = 24;

/// Outputs of one row that are worked on at a time, unless the engine needs more to get going.
const PIECE: usize = 1 << 13;

/// A part of the output.
#[derive(Debug)]
pub enum Task<'o, T> {
    /// `outputs` of rows from `outer` on, whole rows if more than one: one slice for every order.
    Rows {
        /// The first row.
        outer: usize,
        /// Outputs of every row.
        outputs: Range<usize>,
        /// Their places.
        outs: Vec<&'o mut [T]>,
    },
    /// `outputs` of neighbouring columns: one line of columns for every order and output.
    Panel {
        /// The matrix of the columns.
        outer: usize,
        /// The first column.
        column: usize,
        /// Outputs of every column.
        outputs: Range<usize>,
        /// Their places.
        lines: Vec<&'o mut [T]>,
    },
}

/// Hands out the output in tasks, in order.
pub struct Tasks<'f, 'o, T: Sample> {
    frame: &'f Frame<'f, T>,
    /// What is left, for every order.
    rest: Vec<&'o mut [T]>,
    /// What is left of the lines that are being cut into panels.
    lines: Vec<&'o mut [T]>,
    outer: usize,
    /// Outputs that the next task begins with, or that `lines` are.
    outputs: Range<usize>,
    /// Whole rows of a task; none if a task is a part of a row.
    rows: usize,
    /// Outputs of a part of a row.
    piece: usize,
    /// Columns of a panel.
    width: usize,
}

/// What one output costs.
pub fn work<T: Sample>(frame: &Frame<'_, T>) -> usize {
    frame.runner.work().saturating_add(MOVE)
}

impl<'f, 'o, T: Sample> Tasks<'f, 'o, T> {
    /// Tasks for `outs`, one slice for every order.
    pub fn new(frame: &'f Frame<'f, T>, outs: Vec<&'o mut [T]>) -> Self {
        let work = work(frame);
        let row = frame.outputs().saturating_mul(work).max(1);
        let start = frame.wanted.start;
        let mut tasks = Self {
            frame,
            rest: outs,
            lines: Vec::new(),
            outer: 0,
            outputs: start..start,
            rows: 0,
            piece: PIECE.max(frame.runner.stretch()),
            width: 0,
        };
        match frame.gather {
            Gather::Rows => tasks.rows = if row > TASK / 2 { 0 } else { TASK / row },
            Gather::Bundles => tasks.rows = (TASK / row).max(1).next_multiple_of(T::LANES),
            Gather::Strips { outputs, width } | Gather::Columns { outputs, width } => {
                tasks.piece = outputs;
                tasks.width = (TASK / (outputs * work).max(1)).max(1).next_multiple_of(width);
            }
        }
        tasks
    }

    /// How many tasks there are, roughly.
    pub fn left(&self) -> usize {
        let size = self.rest.first().map_or(0, |out| out.len());
        let per_task = match (self.width, self.rows) {
            (0, 0) => self.piece.min(self.frame.outputs()),
            (0, rows) => rows * self.frame.outputs(),
            (width, _) => self.piece.min(self.frame.outputs()) * width.min(self.frame.layout.inner),
        };
        size.div_ceil(per_task.max(1))
    }

    /// The next `length` elements of every order.
    fn take(&mut self, length: usize) -> Vec<&'o mut [T]> {
        let cut = |rest| split(rest, length);
        self.rest.iter_mut().map(cut).collect()
    }

    /// Goes on to the next piece of a row, or of the next row.
    fn advance(&mut self) {
        let frame = self.frame;
        if self.outputs.end == frame.wanted.end {
            (self.outer, self.outputs.end) = (self.outer + 1, frame.wanted.start);
        }
        let start = self.outputs.end;
        self.outputs = start..frame.wanted.end.min(start + frame.piece(start, self.piece));
    }

    fn columns(&mut self) -> Task<'o, T> {
        let inner = self.frame.layout.inner;
        if self.lines.is_empty() {
            self.advance();
            let slab = self.take(self.outputs.len() * inner);
            self.lines = slab.into_iter().flat_map(|slab| slab.chunks_mut(inner)).collect();
        }
        let left = self.lines.first().map_or(0, |line| line.len());
        let (outer, column, outputs) = (self.outer, inner - left, self.outputs.clone());
        if left <= self.width {
            return Task::Panel { outer, column, outputs, lines: std::mem::take(&mut self.lines) };
        }
        let cut = |line| split(line, self.width);
        Task::Panel { outer, column, outputs, lines: self.lines.iter_mut().map(cut).collect() }
    }
}

impl<'o, T: Sample> Iterator for Tasks<'_, 'o, T> {
    type Item = Task<'o, T>;

    fn next(&mut self) -> Option<Self::Item> {
        let left = self.rest.first().map_or(0, |out| out.len());
        if left == 0 && self.lines.is_empty() {
            return None;
        }
        if self.width > 0 {
            return Some(self.columns());
        }
        if self.rows > 0 {
            let (outer, outputs) = (self.outer, self.frame.wanted.clone());
            self.outer += self.rows;
            return Some(Task::Rows { outer, outs: self.take(self.rows * outputs.len()), outputs });
        }
        self.advance();
        let (outer, outputs) = (self.outer, self.outputs.clone());
        Some(Task::Rows { outer, outs: self.take(outputs.len()), outputs })
    }
}

/// Takes the first `length` elements off, or all.
#[expect(clippy::mut_mut, reason = "the slice itself is moved on")]
fn split<'o, T>(rest: &mut &'o mut [T], length: usize) -> &'o mut [T] {
    let length = length.min(rest.len());
    rest.split_off_mut(..length).unwrap_or_default()
}

/// For every order its output in the parts that tasks take: `sizes` are those of an order, a matrix and a part of it.
pub fn cut<T>(out: Option<&mut [T]>, sizes: (usize, usize, usize)) -> Vec<impl Iterator<Item = &mut [T]>> {
    let (order, matrix, part) = sizes;
    let orders = out.unwrap_or_default().chunks_mut(order);
    orders.map(|order| order.chunks_mut(matrix).flat_map(move |matrix| matrix.chunks_mut(part))).collect()
}
