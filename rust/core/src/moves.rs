//! Samples moved between rows or columns and strips, a cache line at a time.
//!
//! A strip is a matrix with [`Sample::LANES`] columns, seen as lines of `N` samples; several strips lie `step` lines apart.

#![expect(clippy::indexing_slicing, reason = "shares and weights of a moved window are as many as its samples")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use crate::engine::Sample;

/// Rows and columns that are transposed at a time.
const BLOCK: usize = 8;

/// Spreads lines of `width` samples, which lie `inner` apart in `x`, over the strips from their line `at` on.
pub struct Spread<'a, T> {
    /// The samples, from the first of the first line on.
    pub x: &'a [T],
    /// From line to line.
    pub inner: usize,
    /// Number of lines.
    pub count: usize,
    /// Samples of a line.
    pub width: usize,
    /// The strips.
    pub strips: &'a mut [T],
    /// From strip to strip, in lines.
    pub step: usize,
    /// Line of the strips that the first line goes to.
    pub at: usize,
}

/// Collects lines from strips: the reverse of [`Spread`].
pub struct Collect<'a, 'l, T> {
    /// The strips, from the line on that the first line comes from.
    pub strips: &'a [T],
    /// From strip to strip, in lines.
    pub step: usize,
    /// The lines, of which the columns `offset` to `offset + width` are written.
    pub lines: &'a mut [&'l mut [T]],
    /// The first column.
    pub offset: usize,
    /// Number of columns.
    pub width: usize,
}

/// `to[j][i] = from[i][j]` for `rows` by `columns`, with the given steps from row to row.
pub struct Transpose<'a, T> {
    /// The matrix.
    pub from: &'a [T],
    /// From row to row in it.
    pub from_step: usize,
    /// Its transposed.
    pub to: &'a mut [T],
    /// From row to row in that.
    pub to_step: usize,
    /// Rows of `from`.
    pub rows: usize,
    /// Columns of `from`.
    pub columns: usize,
}

/// Moves samples with the registers that this CPU has.
pub fn dispatch(moves: impl WithSimd<Output = ()>) {
    Arch::new().dispatch(moves);
}

impl<T: Sample> WithSimd for Spread<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        if T::LANES == 8 { self.run::<8>() } else { self.run::<16>() }
    }
}

impl<T: Sample> Spread<'_, T> {
    #[inline(always)]
    fn run<const N: usize>(self) {
        let Self { x, inner, count, width, strips, step, at } = self;
        let (strips, _) = strips.as_chunks_mut::<N>();
        for (index, line) in x.chunks(inner).take(count).enumerate() {
            let (whole, rest) = line[..width].as_chunks::<N>();
            for (strip, values) in strips[at + index..].iter_mut().step_by(step).zip(whole) {
                *strip = *values;
            }
            if !rest.is_empty() {
                let strip = &mut strips[at + index + whole.len() * step];
                *strip = [T::default(); N];
                strip[..rest.len()].copy_from_slice(rest);
            }
        }
    }
}

impl<T: Sample> WithSimd for Collect<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        if T::LANES == 8 { self.run::<8>() } else { self.run::<16>() }
    }
}

impl<T: Sample> Collect<'_, '_, T> {
    #[inline(always)]
    fn run<const N: usize>(self) {
        let Self { strips, step, lines, offset, width } = self;
        let (strips, _) = strips.as_chunks::<N>();
        for (index, line) in lines.iter_mut().enumerate() {
            let (whole, rest) = line[offset..offset + width].as_chunks_mut::<N>();
            for (strip, values) in strips[index..].iter().step_by(step).zip(whole.iter_mut()) {
                *values = *strip;
            }
            if !rest.is_empty() {
                rest.copy_from_slice(&strips[index + whole.len() * step][..rest.len()]);
            }
        }
    }
}

impl<T: Sample> WithSimd for Transpose<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self { from, from_step, to, to_step, rows, columns } = self;
        for i in (0..rows).step_by(BLOCK) {
            for j in (0..columns).step_by(BLOCK) {
                if i + BLOCK <= rows && j + BLOCK <= columns {
                    transpose_block(&from[i * from_step + j..], from_step, &mut to[j * to_step + i..], to_step);
                    continue;
                }
                for i in i..rows.min(i + BLOCK) {
                    for j in j..columns.min(j + BLOCK) {
                        to[j * to_step + i] = from[i * from_step + j];
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn transpose_block<T: Sample>(from: &[T], from_step: usize, to: &mut [T], to_step: usize) {
    let empty = [T::default(); BLOCK];
    let mut rows = [&empty; BLOCK];
    for (row, from) in rows.iter_mut().zip(from.chunks(from_step)) {
        *row = from.first_chunk().unwrap_or(&empty);
    }
    for (k, to) in to.chunks_mut(to_step).take(BLOCK).enumerate() {
        let Some(line) = to.first_chunk_mut::<BLOCK>() else { return };
        // Straight into place: a block put together elsewhere would be read before its parts are stored.
        for (value, row) in line.iter_mut().zip(rows) {
            *value = row[k];
        }
    }
}
