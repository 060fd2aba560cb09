//! How samples, moments and outputs lie in registers.

use super::super::Sample;
use super::design::{Order, Tables};

/// A way to lay them: a row along the registers, or neighbouring rows across. Both form the same sums in the same order.
///
/// The moments, or coefficients, of a block are `width` values.
pub trait Lay<T: Sample>: Copy {
    /// Values of a sample.
    const UNIT: usize;
    /// Blocks whose outputs are computed together.
    const TOGETHER: usize;
    /// Values of the moments of a block.
    fn width(self, tables: &Tables<T>) -> usize;
    /// The moments of the first blocks of `samples`, as many as `moments` has room for.
    fn moments(self, tables: &Tables<T>, samples: &[T], moments: &mut [T]);
    /// `to += matrix from`.
    fn product(self, tables: &Tables<T>, matrix: &[T], from: &[T], to: &mut [T]);
    /// `to += matrix from`, or `to = matrix from`, for each block of `to`, with matrices for [`super::run::FEW`] blocks at a time.
    fn products(self, tables: &Tables<T>, matrices: &[T], from: &[T], to: &mut [T], add: bool);
    /// `from` in every block of `to`, or zero.
    fn repeat(self, tables: &Tables<T>, from: Option<&[T]>, to: &mut [T]);
    /// Copies `values`; and the sums up to each of them, on top of `running`, which becomes the last one.
    fn run_up(self, tables: &Tables<T>, values: &[T], copy: &mut [T], running: &mut [T], sums: &mut [T]);
    /// The sums of `values` after each of them, in their place.
    fn run_down(self, tables: &Tables<T>, values: &mut [T]);
    /// The coefficients of blocks from the moments of those after each, without groups; `moments` starts with those of the
    /// block after the first.
    fn blocks(self, tables: &Tables<T>, order: &Order<T>, moments: &[T], coefficients: &mut [T]);
    /// The outputs of blocks, times `scale`, as many as `out` has room for; `samples` are those of the blocks, and
    /// those after the whole blocks of the first.
    fn outputs(
        self,
        tables: &Tables<T>,
        order: &Order<T>,
        samples: [&[T]; 2],
        coefficients: &[T],
        scale: T,
        out: &mut [T],
    );
}
