//! How the weights of one or several orders meet the data.
//!
//! Engines run on contiguous samples and know nothing of ends, axes or threads. [`direct`] adds the taps of every output in
//! one fixed order, so that blocks, streams and threads give the same bits. [`moments`] and [`fft`] work on blocks that lie on a
//! fixed grid of the row, the one for weights that are polynomials, the other for any; [`choice`] says which is the fastest.

mod buffer;
pub mod choice;
pub mod direct;
pub mod fft;
pub mod moments;
mod negacyclic;
mod prefetch;
mod sample;
mod stream;
mod taps;

pub(crate) use buffer::Buffer;
pub use sample::Sample;
pub use taps::Taps;

#[cfg(test)]
mod tests;

use crate::error::{Error, try_vec};

/// The closed set of engines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// Every tap of every output.
    Direct,
    /// Polynomial weights by the moments of blocks.
    Moments,
    /// Spectra of blocks.
    Fft,
}

/// Public names.
pub const ENGINES: [(&str, Engine); 3] =
    [("direct", Engine::Direct), ("moments", Engine::Moments), ("fft", Engine::Fft)];

/// An engine prepared for the taps of one or several orders, which share the samples that they read: shareable between
/// threads, never changed.
#[derive(Debug)]
pub enum Runner<T: Sample> {
    /// Every tap of every output.
    Direct(direct::Direct<T>),
    /// Polynomial weights by the moments of blocks.
    Moments(moments::Moments<T>),
    /// Spectra of blocks.
    Fft(fft::Fft<T>),
}

/// The windows of a row that start at `x[first]`, `x[first + 1]` and on, as many as each of `outs` holds values.
///
/// `x[0]` is the sample `origin` of its row. Engines whose sums depend on a grid lay it on the row, not on `x`; they may
/// read any sample of `x`, but the outputs depend on those outside of their windows by rounding only.
#[derive(Debug)]
pub struct Windows<'a, 'o, T> {
    /// Samples of the row.
    pub x: &'a [T],
    /// Where the first window starts in them.
    pub first: usize,
    /// Which sample of the row they start with.
    pub origin: isize,
    /// The outputs, for every order.
    pub outs: &'a mut [&'o mut [T]],
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub struct Scratch<T: Sample> {
    differences: Vec<T>,
    moments: moments::Room<T>,
    fft: fft::Buffers<T>,
}

impl<T: Sample> Runner<T> {
    /// Prepares `engine` for `orders`, which have the same span.
    pub fn new(engine: Engine, orders: &[&Taps]) -> Result<Self, Error> {
        match engine {
            Engine::Direct => direct::Direct::new(orders).map(Self::Direct),
            Engine::Moments => moments::Moments::new(orders)?.map(Self::Moments).ok_or_else(|| {
                let allowed =
                    "'auto', 'direct' or 'fft' for these weights: they are no polynomial of a low degree, or too few";
                Error::argument("engine", "moments", allowed)
            }),
            Engine::Fft => fft::Fft::new(orders).map(Self::Fft),
        }
    }

    /// Prepares the engine that is likely to be the fastest.
    pub fn fastest(orders: &[&Taps]) -> Result<Self, Error> {
        for engine in choice::ranked(orders, size_of::<T>() == 4) {
            match engine {
                // Its error may turn out to be too large.
                Engine::Moments => {
                    if let Some(moments) = moments::Moments::new(orders)? {
                        return Ok(Self::Moments(moments));
                    }
                }
                engine => return Self::new(engine, orders),
            }
        }
        Self::new(Engine::Direct, orders)
    }

    /// Which engine it is.
    #[must_use]
    pub fn engine(&self) -> Engine {
        match self {
            Self::Direct(_) => Engine::Direct,
            Self::Moments(_) => Engine::Moments,
            Self::Fft(_) => Engine::Fft,
        }
    }

    /// Samples that one output reads.
    #[must_use]
    pub fn span(&self) -> usize {
        match self {
            Self::Direct(direct) => direct.span(),
            Self::Moments(moments) => moments.span(),
            Self::Fft(fft) => fft.span(),
        }
    }

    /// The step of the grid on which sums depend: a call on a part of a row gives the same bits if the part starts at a multiple
    /// of it, and holds, from there to another multiple or to the end of the row, all samples that the windows read. 1 where
    /// any part will do.
    #[must_use]
    pub fn grid(&self) -> usize {
        match self {
            Self::Direct(_) => 1,
            Self::Moments(moments) => moments.grid(),
            Self::Fft(fft) => fft.grid(),
        }
    }

    /// What one output of every order costs, in multiplications of the direct engine, roughly.
    #[must_use]
    pub fn work(&self) -> usize {
        match self {
            Self::Direct(direct) => direct.work(),
            Self::Moments(moments) => moments.work(),
            Self::Fft(fft) => fft.work(),
        }
    }

    /// Outputs of a row from which on what a call costs at its start does not show.
    #[must_use]
    pub fn stretch(&self) -> usize {
        match self {
            Self::Direct(_) => 1,
            Self::Moments(moments) => 4 * moments.span(),
            Self::Fft(fft) => fft.grid(),
        }
    }

    /// Whether [`Runner::apply`] on single rows is faster than [`Runner::apply_lanes`], gathering included.
    #[must_use]
    pub fn prefers_rows(&self) -> bool {
        matches!(self, Self::Fft(_))
    }

    /// The outputs of `windows`, for every order.
    pub fn apply(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        T::apply(self, windows, scratch)
    }

    /// The same for [`Sample::LANES`] neighbouring rows at once: the samples are the matrix `(samples, LANES)`, and so are the
    /// outputs.
    pub fn apply_lanes(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        T::apply_lanes(self, windows, scratch)
    }

    fn run(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        match self {
            Self::Direct(direct) => direct.apply(windows, scratch),
            Self::Moments(moments) => moments.apply(windows, scratch),
            Self::Fft(fft) => fft.apply(windows, scratch),
        }
    }

    fn run_lanes(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        match self {
            Self::Direct(direct) => direct.apply_lanes(windows, scratch),
            Self::Moments(moments) => moments.apply_lanes(windows, scratch),
            Self::Fft(_) => self.apply_each(windows, scratch),
        }
    }

    /// One lane after the other.
    fn apply_each(&self, windows: Windows<'_, '_, T>, scratch: &mut Scratch<T>) -> Result<(), Error> {
        let Windows { x, first, origin, outs } = windows;
        let lanes = T::LANES;
        let outputs = outs.first().map_or(0, |out| out.len() / lanes);
        let mut row = try_vec(x.len() / lanes, T::default())?;
        let mut results = try_vec(outputs * outs.len(), T::default())?;
        for lane in 0..lanes {
            row.iter_mut().zip(x.iter().skip(lane).step_by(lanes)).for_each(|(value, sample)| *value = *sample);
            let mut each: Vec<&mut [T]> = results.chunks_mut(outputs.max(1)).collect();
            self.run(Windows { x: &row, first, origin, outs: &mut each }, scratch)?;
            for (out, result) in outs.iter_mut().zip(each) {
                out.iter_mut().skip(lane).step_by(lanes).zip(result).for_each(|(value, result)| *value = *result);
            }
        }
        Ok(())
    }
}
