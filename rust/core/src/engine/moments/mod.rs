//! Polynomial weights by the moments of blocks of samples.
//!
//! Taps that are a polynomial of degree D in their index, but for the first and the last of them, need not be multiplied
//! one by one. The stream (first differences, or the samples) is cut into blocks of B. A window that starts in block b
//! consists of the rest of block b, of m whole blocks, and of what is left. The two ends are products, of B taps together
//! and of those, 1 to B, by which the window is longer than whole blocks. Of every whole block only its D + 1 moments in a
//! Legendre basis matter, which all windows share: what they add to the outputs of block b is a polynomial of degree D in
//! the output's place, with the coefficients `sum over l of C_l M_(b+l)`.
//!
//! Where m is large, G blocks form a group. The m blocks are then the end of one group, whole groups, and the beginning of
//! another. The moments of ends and beginnings are running sums, over one group at most, of what every block adds to the
//! moments of its group: for every block one product with a matrix to form them, and one for each of the three to use them,
//! however long the window.
//!
//! Nothing is subtracted or carried on, so there is no drift, and what is not finite stays in the windows that hold it.
//! The grid of blocks and groups lies on the row, so that no cut of a run changes a bit. CPUs with fused multiplication and
//! addition use it: bits may differ between CPUs.
//!
//! The error is at most [`Moments::error_bound`] `* eps * sum |W| * max |s|` with the taps W and the stream s of a window.

mod across;
mod along;
mod design;
mod lay;
mod polynomial;
mod room;
mod run;

use pulp::Arch;

use super::{Sample, Scratch, Taps, Windows};
use crate::error::Error;

use across::Rows;
pub use design::Shape;
use design::Tables;
pub use room::Room;
use run::{Run, STEP};

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

    /// The step of the grid on which outputs are computed.
    pub(super) fn grid(&self) -> usize {
        STEP * self.tables.shape.block
    }

    pub(super) fn work(&self) -> usize {
        let (shared, each) = self.tables.shape.cost;
        let registers = shared + each * self.tables.orders.len() as f64;
        (registers * T::LANES as f64).ceil() as usize
    }

    /// The factor of the error bound.
    #[must_use]
    pub fn error_bound(&self) -> f64 {
        self.tables.error_bound
    }

    pub(super) fn apply(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        let room = &mut scratch.moments;
        room.prepare(&self.tables, 1, self.tables.stride)?;
        Arch::new().dispatch(Run { moments: self, windows, room });
        Ok(())
    }

    pub(super) fn apply_lanes(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        let room = &mut scratch.moments;
        room.prepare(&self.tables, T::LANES, self.tables.shape.moments * T::LANES)?;
        Arch::new().dispatch(Rows(Run { moments: self, windows, room }));
        Ok(())
    }
}

#[cfg(test)]
mod tests;
