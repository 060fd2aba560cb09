//! Spectra of blocks: overlap-save, one forward transform for all orders.
//!
//! **Grid.** Block g holds the windows that start at the samples `g H .. (g + 1) H` of the row, `H = N - taps + 1`, and
//! is transformed whole whatever part of it is wanted, so that an output's bits depend on the samples of its block alone.
//! Nor does N depend on the data: a short row costs a block.
//!
//! **Error.** A transform errs by a part of all that went into it, not of the window that an output reads. With exact
//! taps w, and s the samples (or differences) of the block, the computed sums err by at most
//! `8 eps log2(N) norm2(w) norm2(s)`: each of the `log2(M)` stages, `M = N / 2`, of the transforms of s and of w is
//! a unitary matrix, up to a factor, applied with a relative error of `5 eps / 2` in the 2-norm, which
//! `sum |W_k| |dS_k| / M <= norm2(w) norm2(ds)` carries over to every single output; and in the inverse transform a
//! tree of as many stages leads to each output, which errs by `log2(M) 5 eps / 2` of `sum |W_k S_k| / M <= norm2(w) norm2(s)`.
//!
//! **Quiet windows.** Next to a loud sample this would be nothing worth for a window that does not hold it. So windows
//! whose largest sample is smaller than 2^-10 (single precision: 2^-5) of the block's are computed from a second
//! transform, of the block without the samples that are larger than any of theirs, and so on. For every output, s in
//! the bound may be read as the samples up to 2^10 (2^5) times the largest in its own window. Windows of zeros give 0.
//!
//! **NaN and inf** are louder than everything, by the same rule: they spoil the windows that hold them, and no others.

#![expect(
    clippy::indexing_slicing,
    reason = "a transform is longer than the taps, and an anchor is one of their samples"
)]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

mod block;
mod loudness;

use nalgebra::Complex;
use pulp::Arch;

use self::block::{Apply, exponent};
use super::negacyclic::Negacyclic;
use super::{Sample, Scratch, Taps, Windows};
use crate::error::{Error, resize, try_vec};

/// The spectra of the taps of every order.
#[derive(Debug)]
pub struct Fft<T> {
    orders: Vec<Order<T>>,
    span: usize,
    taps: usize,
    on_differences: bool,
    transform: Negacyclic<T>,
}

#[derive(Debug)]
struct Order<T> {
    spectrum: Vec<Complex<T>>,
    /// The taps' scale is 2 to this power.
    exponent: i32,
    anchor: Option<usize>,
}

/// A thread's own memory for one block.
#[derive(Debug, Default)]
pub struct Buffers<T> {
    /// The samples, or their differences; 0 where there are none.
    samples: Vec<T>,
    /// What the inverse transform gives.
    values: Vec<T>,
    /// The size of the largest sample of every window.
    peaks: Vec<T>,
    spectrum: Vec<Complex<T>>,
    product: Vec<Complex<T>>,
    work: Vec<Complex<T>>,
}

impl<T: Sample> Buffers<T> {
    fn prepare(&mut self, half: usize, work: usize) -> Result<(), Error> {
        if self.spectrum.len() != half || self.work.len() != work {
            for real in [&mut self.samples, &mut self.values, &mut self.peaks] {
                resize(real, 2 * half)?;
            }
            for (complex, len) in [(&mut self.spectrum, half), (&mut self.product, half), (&mut self.work, work)] {
                *complex = try_vec(len, Complex::new(T::default(), T::default()))?;
            }
        }
        Ok(())
    }
}

impl<T: Sample> Fft<T> {
    pub(super) fn new(orders: &[&Taps]) -> Result<Self, Error> {
        let taps = orders.first().map_or(0, |taps| taps.double.len());
        let half = points(taps) / 2;
        let double = Negacyclic::<f64>::new(half)?;
        Ok(Self {
            orders: orders.iter().map(|taps| Order::new(taps, &double)).collect::<Result<_, Error>>()?,
            span: orders.first().map_or(0, |taps| taps.span()),
            taps,
            on_differences: orders.iter().all(|taps| taps.on_differences),
            transform: Negacyclic::new(half)?,
        })
    }

    pub(super) fn span(&self) -> usize {
        self.span
    }

    /// A transform takes about as long as 16 taps, forth and back once more for every order.
    pub(super) fn work(&self) -> usize {
        40 * (1 + self.orders.len())
    }

    /// Outputs of a block.
    pub(super) fn grid(&self) -> usize {
        2 * self.transform.half() + 1 - self.taps.max(1)
    }

    pub(super) fn apply(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        scratch.fft.prepare(self.transform.half(), self.transform.work())?;
        Arch::new().dispatch(Apply { fft: self, windows, buffers: &mut scratch.fft });
        Ok(())
    }
}

/// The length of the blocks for so many taps: the least cost per output.
///
/// A sample costs `log2(N)` and a bit for the loops around the transforms, more where the block leaves the caches. Long
/// windows cost memory, so that their blocks are not much longer.
pub(super) fn points(taps: usize) -> usize {
    let cost = |points: &usize| {
        let octaves = (*points as f64).log2();
        let outputs = (points + 1).saturating_sub(taps.max(1)) as f64;
        let memory = 0.5 * (octaves - 15.0).max(0.0) + 2.5 * (octaves - 18.0).max(0.0);
        (octaves - 1.0 + memory) * *points as f64 / outputs
    };
    let sizes = (8..usize::BITS - 4).flat_map(|octave| [1 << octave, 3 << (octave - 1)]);
    let useful = sizes.skip_while(|points| *points <= taps).take_while(|points| *points <= (2 * taps).max(1 << 20));
    useful.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or(256)
}

impl<T: Sample> Order<T> {
    /// The taps meet the samples in reverse order, and what wraps around comes negated: tap k stands at N - k.
    fn new(taps: &Taps, transform: &Negacyclic<f64>) -> Result<Self, Error> {
        let half = transform.half();
        let mut sequence = try_vec(2 * half, 0.0)?;
        let share = 1.0 / half as f64;
        for (k, tap) in taps.double.iter().enumerate() {
            match k {
                0 => sequence[0] = tap * share,
                _ => sequence[2 * half - k] = -tap * share,
            }
        }
        let mut double = try_vec(half, Complex::new(0.0, 0.0))?;
        let mut work = try_vec(transform.work(), Complex::new(0.0, 0.0))?;
        transform.forward(&sequence, (1.0, 1.0), &mut double, &mut work);
        let mut spectrum = try_vec(half, Complex::new(T::default(), T::default()))?;
        for (point, double) in spectrum.iter_mut().zip(double) {
            *point = Complex::new(T::from_f64(double.re), T::from_f64(double.im));
        }
        Ok(Self { spectrum, exponent: exponent(taps.scale) - 1, anchor: taps.anchor })
    }

    /// Adds what the sums of windows are relative to; `x[0]` is the first sample of the first.
    #[inline(always)]
    fn add_anchors(&self, x: &[T], sums: &mut [T]) {
        if let Some(anchor) = self.anchor {
            sums.iter_mut().zip(&x[anchor..]).for_each(|(sum, sample)| *sum = *sum + *sample);
        }
    }
}

#[cfg(test)]
mod tests;
