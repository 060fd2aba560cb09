//! Polynomial weights by the moments of blocks of samples.
//!
//! Taps that are a polynomial of degree D in their index, but for the first and the last of them, need not be multiplied
//! one by one. The stream (first differences, or the samples) is cut into blocks of B. A window that starts in block b
//! consists of the rest of block b, of m whole blocks, and of the beginning of one more. The two ends are products of at
//! most B taps together. Of every whole block only its D + 1 moments in a Legendre basis matter, which all windows share:
//! what they add to the outputs of block b is a polynomial of degree D in the output's place, with the coefficients
//! `sum over l of C_l M_(b+l)`. Where m is large, G blocks form a group whose moments follow from theirs, and the same
//! holds for the groups between two ends of whole blocks.
//!
//! Nothing is subtracted or carried along, so there is no drift, and what is not finite stays in the windows that hold it.
//! The grid of blocks lies on the row, so that no cut of a run changes a bit. CPUs with fused multiplication and addition
//! use it: bits may differ between CPUs.
//!
//! The error is at most [`Moments::error_bound`] `* eps * sum |W| * max |s|` with the taps W and the stream s of a window.

mod design;
mod kernel;
mod lanes;
mod polynomial;

use super::{Sample, Scratch, Taps};
use crate::error::Error;

pub use design::Shape;
use design::Tables;
pub use lanes::Room;
use lanes::{Columns, Row};

/// The taps of every order, and the tables that they share.
#[derive(Debug)]
pub struct Moments<T> {
    tables: Tables<T>,
    span: usize,
    on_differences: bool,
}

impl<T: Sample> Moments<T> {
    /// The tables of `orders`, or none if their taps are not polynomials of a degree that is low enough for the error to be
    /// small, or too few.
    pub(super) fn new(orders: &[&Taps]) -> Result<Option<Self>, Error> {
        let Some(first) = orders.first() else { return Ok(None) };
        let Some(tables) = Tables::new(orders)? else { return Ok(None) };
        Ok(Some(Self { tables, span: first.span(), on_differences: first.on_differences }))
    }

    pub(super) fn span(&self) -> usize {
        self.span
    }

    pub(super) fn work(&self) -> usize {
        self.tables.shape.cost(self.tables.orders.len()).ceil() as usize
    }

    /// The factor of the error bound.
    #[must_use]
    pub fn error_bound(&self) -> f64 {
        self.tables.error_bound
    }

    /// Blocks, groups and degree.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.tables.shape
    }

    pub(super) fn apply(
        &self,
        x: &[T],
        first: usize,
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        let room = &mut scratch.moments;
        room.prepare_row(&self.tables)?;
        Row { moments: self, x, first, origin, outs, room }.run();
        Ok(())
    }

    pub(super) fn apply_lanes(
        &self,
        x: &[T],
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        let group = self.tables.shape.group_length();
        let outputs = outs.first().map_or(0, |out| out.len()) / T::LANES;
        let lead = origin.rem_euclid(group.cast_signed()).cast_unsigned();
        let room = &mut scratch.moments;
        room.prepare_columns(&self.tables, (lead + outputs).div_ceil(group))?;
        Columns { moments: self, x, lead, outs, room }.run();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
