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
//! The grid of blocks lies on the row, so that no cut of a run changes a bit.
//!
//! The error is at most [`Moments::error_bound`] `* eps * sum |W| * max |s|` with the taps W and the stream s of a window.

mod design;
mod kernel;
mod strip;

use super::{Sample, Scratch, Taps, bring_home};
use crate::error::{Error, resize};

pub use design::Shape;
use design::Tables;
use strip::Strip;

/// Columns of a strip, in blocks of lanes: enough that what is kept between two strips is a small part.
const LANE_BLOCKS: usize = 8;

/// The taps of every order, and the tables that they share.
#[derive(Debug)]
pub struct Moments<T> {
    tables: Tables<T>,
    span: usize,
    on_differences: bool,
}

/// A thread's own memory: the strip of samples, its moments and results.
#[derive(Debug, Default)]
pub struct Room<T> {
    strip: Strip<T>,
    stream: Vec<T>,
    staged: Vec<T>,
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
        let outputs = outs.first().map_or(0, |out| out.len());
        if outputs == 0 {
            return Ok(());
        }
        let group = self.tables.shape.group_length();
        let Room { strip, stream, staged } = &mut scratch.moments;
        // Places on the row's grid, from the start of the group that holds the first window's start.
        let lead = (origin + first.cast_signed()).rem_euclid(group.cast_signed()).cast_unsigned();
        let groups = (lead + outputs).div_ceil(group);
        strip.prepare_rows(&self.tables, groups.next_multiple_of(T::LANES).min(LANE_BLOCKS * T::LANES))?;
        resize(stream, strip.fresh(true) * group + design::SPILL)?;
        resize(staged, strip.columns() * group)?;
        for start in (0..groups).step_by(strip.columns()) {
            let fresh = strip.fresh(start == 0);
            let column = start + strip.width() - fresh;
            // Sample `place - lead + first` of x stands at `place` of the grid.
            let stream = &mut stream[..fresh * group + design::SPILL];
            super::stream(x, self.on_differences, (column * group + first).cast_signed() - lead.cast_signed(), stream);
            strip.gather(&self.tables, stream, fresh);
            let columns = strip.columns().min(groups - start);
            for (order, (taps, out)) in self.tables.orders.iter().zip(outs.iter_mut()).enumerate() {
                strip.evaluate(&self.tables, order, columns);
                strip.scatter(&self.tables, columns, staged);
                let from = (start * group).max(lead);
                let until = ((start + columns) * group).min(lead + outputs);
                let place = first + from - lead;
                let anchored = taps.anchor.map(|anchor| &x[place + anchor..]);
                bring_home(
                    &staged[from - start * group..until - start * group],
                    taps.scale,
                    anchored,
                    &mut out[from - lead..until - lead],
                );
            }
            strip.keep(&self.tables);
        }
        Ok(())
    }
}
