//! A thread's own memory.

#![expect(clippy::indexing_slicing, reason = "places are kept between the start and the end of what is held")]

use super::super::Sample;
use super::super::buffer::Buffer;
use super::super::stream::stream;
use super::design::Tables;
use super::run::STEP;
use crate::error::Error;

/// Samples that are formed between two moves of what is left of the stream, at least.
const PIECE: usize = 2048;

/// Samples up to which a window and what is formed around it is kept in one piece.
const JOINED: usize = 1 << 13;

/// A block: its group, and its number there.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub group: isize,
    pub index: usize,
}

impl Place {
    /// Block number `block`, with `group` of them in a group, a power of two.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "two operations")]
    pub fn new(block: isize, group: usize) -> Self {
        Self { group: block >> group.trailing_zeros(), index: block.cast_unsigned() & (group - 1) }
    }
}

/// What the stream is formed from: samples of `unit` values.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a, T> {
    pub x: &'a [T],
    pub unit: usize,
    pub on_differences: bool,
}

/// A part of the stream.
#[derive(Debug, Default)]
pub struct Line<T> {
    values: Buffer<T>,
    start: isize,
    end: isize,
}

impl<T: Sample> Line<T> {
    /// Forms samples up to `until`; those before `from` are no longer needed.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
    )]
    pub fn bring(&mut self, source: Source<'_, T>, from: isize, until: isize) {
        let unit = source.unit;
        if until <= self.end {
            return;
        }
        let at = |place: isize, start: isize| (place - start).cast_unsigned() * unit;
        if at(until, self.start) > self.values.len() {
            let from = from.min(self.end);
            self.values.copy_within(at(from, self.start)..at(self.end, self.start), 0);
            self.start = from;
        }
        let place = at(self.end, self.start)..at(until, self.start);
        stream(source.x, unit, source.on_differences, self.end, &mut self.values[place]);
        self.end = until;
    }

    /// The samples from `place` on.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a slice")]
    pub fn from(&self, unit: usize, place: isize) -> &[T] {
        &self.values[(place - self.start).cast_unsigned() * unit..]
    }
}

/// Values that come one after the other, of which the last are needed.
#[derive(Debug, Default)]
pub struct Tail<T> {
    values: Buffer<T>,
    end: usize,
}

impl<T: Sample> Tail<T> {
    /// Room for the next `count` values; `kept` before them stay.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a slice")]
    pub fn next(&mut self, count: usize, kept: usize) -> &mut [T] {
        if self.end + count > self.values.len() {
            let from = self.end.saturating_sub(kept);
            self.values.copy_within(from..self.end, 0);
            self.end -= from;
        }
        self.end += count;
        &mut self.values[self.end - count..self.end]
    }

    /// The last `count` values.
    pub fn last(&self, count: usize) -> &[T] {
        &self.values[self.end - count..self.end]
    }
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub struct Room<T> {
    /// The stream where windows start, unless one piece holds both, and where their whole blocks end.
    pub near: Line<T>,
    /// The latter.
    pub far: Line<T>,
    /// Whether one piece holds both.
    pub joined: bool,
    /// Moments of blocks where there are no groups.
    pub plain: Tail<T>,
    /// Moments of the blocks of a step.
    pub fresh: Buffer<T>,
    /// What they add to the moments of their groups.
    pub parts: Buffer<T>,
    /// Groups that are held at a time, a power of two. For every block of each its part of the group's moments; once the group is complete,
    /// the sums over the blocks after it.
    pub slots: usize,
    /// The parts, or sums.
    pub lifted: Buffer<T>,
    /// Moments of the groups.
    pub totals: Buffer<T>,
    /// The moments so far of the group that is being formed.
    pub running: Buffer<T>,
    /// Of the group in which the whole blocks end for every block of a step.
    pub prefix: Buffer<T>,
    /// What whole groups add to the outputs of a group, for every order, and for the blocks of a step.
    pub whole: Buffer<T>,
    /// The latter.
    pub wholes: Buffer<T>,
    /// Of the polynomials in the outputs' places.
    pub coefficients: Buffer<T>,
    /// Outputs of a step that are not all wanted.
    pub spare: Buffer<T>,
}

impl<T: Sample> Room<T> {
    /// Room for samples of `unit` values, and moments of a block of `width`.
    pub fn prepare(&mut self, tables: &Tables<T>, unit: usize, width: usize) -> Result<(), Error> {
        let shape = tables.shape;
        let step = STEP * shape.block;
        // A step, what warms up before it, and what is formed at a time.
        let span = 3 * step + (shape.whole + 1) * shape.block + shape.reach;
        self.joined = span <= JOINED;
        let (near, far) = if self.joined { (0, span + span.max(PIECE)) } else { (step + PIECE, 4 * step + PIECE) };
        self.near.values.fit(near * unit)?;
        self.far.values.fit(far * unit)?;
        self.spare.fit(step * unit)?;
        self.coefficients.fit(STEP * width)?;
        let Some(group) = shape.group else {
            self.plain.end = 0;
            return self.plain.values.fit((shape.whole + 32 * STEP) * width);
        };
        self.slots = ((shape.whole + 2 * STEP) / group + 3).next_power_of_two();
        self.fresh.fit(STEP * width)?;
        self.parts.fit(STEP * width)?;
        self.lifted.fit(self.slots * group * width)?;
        self.totals.fit(self.slots * width)?;
        self.running.fit(width)?;
        self.prefix.fit(STEP * width)?;
        self.whole.fit(tables.orders.len() * width)?;
        self.wholes.fit(STEP * width)
    }

    /// Forgets the stream: it goes on at `near` and `far`.
    pub fn restart(&mut self, near: isize, far: isize) {
        let far = if self.joined { near.min(far) } else { far };
        (self.near.start, self.near.end) = (near, near);
        (self.far.start, self.far.end) = (far, far);
    }
}
