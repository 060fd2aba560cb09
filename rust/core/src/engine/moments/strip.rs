//! A strip of groups, lying side by side as lanes, with its moments and results.

use pulp::{Arch, Simd, WithSimd};

use super::super::Sample;
use super::super::transpose::transpose;
use super::design::{SPILL, Tables};
use super::kernel::{self, Buffers, Steps};
use crate::error::{Error, resize};

/// The groups of one row side by side: a column of `samples` is a group and the samples after it that a tile may read.
#[derive(Debug, Default)]
pub struct Strip<T> {
    samples: Vec<T>,
    moments: Vec<T>,
    groups: Vec<T>,
    results: Vec<T>,
    room: Vec<T>,
    /// Columns that get outputs, and all columns: those that the windows reach into follow.
    columns: usize,
    width: usize,
}

impl<T: Sample> Strip<T> {
    /// Makes room for `columns` groups with outputs, a multiple of the lanes.
    pub fn prepare_rows(&mut self, tables: &Tables<T>, columns: usize) -> Result<(), Error> {
        let shape = tables.shape;
        self.columns = columns;
        self.width = columns + shape.halo().next_multiple_of(4);
        resize(&mut self.samples, (shape.group_length() + SPILL) * self.width)?;
        resize(&mut self.moments, shape.group * shape.moments * self.width)?;
        if shape.groups.is_some() {
            resize(&mut self.groups, shape.moments * self.width)?;
        }
        resize(&mut self.results, shape.group_length() * columns)?;
        resize(&mut self.room, 4 * shape.moments * T::LANES)
    }

    /// Columns that get outputs.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// All columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Columns that must be gathered for the first strip of a row, and for those that follow.
    pub fn fresh(&self, first: bool) -> usize {
        if first { self.width } else { self.columns }
    }

    /// Takes in the last `fresh` columns from the stream that starts at the first of them, and forms their moments.
    pub fn gather(&mut self, tables: &Tables<T>, stream: &[T], fresh: usize) {
        Arch::new().dispatch(Gather { strip: self, tables, stream, fresh });
    }

    /// The outputs of one order.
    pub fn evaluate(&mut self, tables: &Tables<T>, order: usize, columns: usize) {
        Arch::new().dispatch(Evaluate { strip: self, tables, order, columns });
    }

    /// Hands the results out in the order of the row.
    pub fn scatter(&self, tables: &Tables<T>, columns: usize, out: &mut [T]) {
        let length = tables.shape.group_length();
        Arch::new().dispatch(Scatter { strip: self, length, columns: columns.next_multiple_of(4), out });
    }

    /// Moves the columns that the next strip needs to the front.
    pub fn keep(&mut self, tables: &Tables<T>) {
        let shape = tables.shape;
        for row in self.samples.chunks_mut(self.width).chain(self.moments.chunks_mut(self.width)) {
            row.copy_within(self.columns.., 0);
        }
        if shape.groups.is_some() {
            self.groups.chunks_mut(self.width).for_each(|row| row.copy_within(self.columns.., 0));
        }
    }
}

struct Gather<'a, T: Sample> {
    strip: &'a mut Strip<T>,
    tables: &'a Tables<T>,
    stream: &'a [T],
    fresh: usize,
}

impl<T: Sample> WithSimd for Gather<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { strip, tables, stream, fresh } = self;
        let length = tables.shape.group_length();
        let kept = strip.width - fresh;
        transpose(simd, stream, length, &mut strip.samples[kept..], strip.width, fresh, length + SPILL);
        match T::LANES {
            8 => form::<T, S, 8>(strip, tables, kept),
            _ => form::<T, S, 16>(strip, tables, kept),
        }
    }
}

#[inline(always)]
fn form<T: Sample, S: Simd, const N: usize>(strip: &mut Strip<T>, tables: &Tables<T>, kept: usize) {
    let width = strip.width;
    for column in (kept..width).step_by(N) {
        // The last lanes may be formed twice.
        let column = column.min(width - N);
        let moments = &mut strip.moments[column..];
        if S::IS_SCALAR {
            kernel::moments::<T, N, false>(tables, &strip.samples[column..], width, moments, width);
        } else {
            kernel::moments::<T, N, true>(tables, &strip.samples[column..], width, moments, width);
        }
        if tables.shape.groups.is_some() {
            let groups = &mut strip.groups[column..];
            if S::IS_SCALAR {
                kernel::group_moments::<T, N, false>(tables, &strip.moments[column..], width, groups, width);
            } else {
                kernel::group_moments::<T, N, true>(tables, &strip.moments[column..], width, groups, width);
            }
        }
    }
}

struct Evaluate<'a, T: Sample> {
    strip: &'a mut Strip<T>,
    tables: &'a Tables<T>,
    order: usize,
    columns: usize,
}

impl<T: Sample> WithSimd for Evaluate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        match T::LANES {
            8 => evaluate::<T, S, 8>(self),
            _ => evaluate::<T, S, 16>(self),
        }
    }
}

#[inline(always)]
fn evaluate<T: Sample, S: Simd, const N: usize>(job: Evaluate<'_, T>) {
    let Evaluate { strip, tables, order, columns } = job;
    let place = Steps { group: 1, place: strip.width };
    let buffers = Buffers {
        samples: &strip.samples,
        at_samples: place,
        moments: &strip.moments,
        at_moments: place,
        groups: &strip.groups,
        at_groups: place,
    };
    let order = &tables.orders[order];
    for column in (0..columns).step_by(N) {
        let out = &mut strip.results[column..];
        if S::IS_SCALAR {
            kernel::outputs::<T, N, false>(tables, order, &buffers, column, &mut strip.room, out, strip.columns);
        } else {
            kernel::outputs::<T, N, true>(tables, order, &buffers, column, &mut strip.room, out, strip.columns);
        }
    }
}

struct Scatter<'a, T: Sample> {
    strip: &'a Strip<T>,
    length: usize,
    columns: usize,
    out: &'a mut [T],
}

impl<T: Sample> WithSimd for Scatter<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { strip, length, columns, out } = self;
        transpose(simd, &strip.results, strip.columns, out, length, length, columns);
    }
}
