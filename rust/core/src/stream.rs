//! Estimates sample by sample, as a control program wants them: the newest window of one or several designs.
//!
//! [`Stream`] keeps the last samples of every channel and gives, with every sample, the estimates at `tau` of the windows that end
//! with it: to the bit what [`Mode::Valid`] of the engine "direct" gives, however samples and blocks are pushed. [`Stream::push`] takes
//! no memory and has no way to panic (`rust/core/examples/control_loop.rs` has the linker prove it). [`Fitted`] adds what needs a fit:
//! windows that are still growing, miss samples or have times of their own.
//!
//! ```
//! use std::sync::Arc;
//! use algdiff_core::{bank::Bank, control::Unattended, design::{Design, Place}, kernel::Tau, plan::Plan, rule::Rule, stream::Stream};
//!
//! let design = Design { window_length: 5, deriv: 1, degree: 2, kappa: 0.0, mu: 0.0, place: Place::Tau(Tau::Newest), delta: 0.1, rule: Rule::Exact, trim: 0.0 };
//! let bank = Arc::new(Bank::new(vec![Arc::new(Plan::new(&design, &Unattended)?)], None)?);
//! let mut stream = Stream::<f64>::new(&[bank], 1)?;
//! let mut slope = [0.0];
//! for i in 0..20 {
//!     stream.push(&[(0.1 * f64::from(i)).powi(2)], &mut slope);
//! }
//! assert!((slope[0] - 2.0 * 1.9).abs() < 1e-12);
//! # Ok::<(), algdiff_core::error::Error>(())
//! ```

#![expect(clippy::indexing_slicing, reason = "blocks are cut to whole samples of all channels")]

mod fitted;
mod row;
mod window;

use std::sync::Arc;

pub use fitted::{Fitted, Missing, Results, Wanted};
pub use window::Point;

use crate::bank::Bank;
use crate::control::Control;
use crate::engine::direct::{Direct, stride};
use crate::engine::{Engine, Sample, Taps};
use crate::error::{Error, try_vec};
use crate::run::{Job, Layout, Mode};

/// Samples of a block that are faster one by one.
const FEW: usize = 4;

/// The last samples of one or several channels, and the designs that are applied to them.
#[derive(Debug, Clone)]
pub struct Stream<T: Sample> {
    parts: Vec<Part<T>>,
    channels: usize,
    /// Samples of the longest window.
    length: usize,
    /// Elements from sample to sample.
    stride: usize,
    /// Every sample twice, `length` samples apart: so that every window is one slice.
    ring: Vec<T>,
    /// The place of the next sample, below `length`.
    next: usize,
    count: u64,
}

/// A design: one window, one or several orders.
#[derive(Debug, Clone)]
struct Part<T: Sample> {
    bank: Arc<Bank>,
    direct: Arc<Direct<T>>,
    span: usize,
    /// Whether the engine of the bank gives the same bits.
    sequential: bool,
}

impl<T: Sample> Stream<T> {
    /// A stream of `channels` channels for all of `banks`, whose windows may differ.
    pub fn new(banks: &[Arc<Bank>], channels: usize) -> Result<Self, Error> {
        if channels == 0 {
            return Err(Error::argument("channels", channels, "at least 1"));
        }
        let part = |bank: &Arc<Bank>| {
            let taps: Vec<&Taps> = bank.plans().iter().map(|plan| plan.taps()).collect();
            let direct = Arc::new(Direct::new(&taps)?);
            let sequential = bank.engine::<T>()? == Engine::Direct;
            Ok(Part { bank: Arc::clone(bank), span: direct.span(), direct, sequential })
        };
        let parts = banks.iter().map(part).collect::<Result<Vec<_>, Error>>()?;
        let length = parts.iter().map(|part| part.span).max();
        let Some(length) = length else { return Err(Error::argument("banks", "none", "one or several")) };
        let stride = stride(channels);
        let ring = try_vec(length.saturating_mul(2).saturating_mul(stride), T::default())?;
        Ok(Self { parts, channels, length, stride, ring, next: 0, count: 0 })
    }

    /// Numbers in a sample.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// How many orders there are, of all designs together.
    #[must_use]
    pub fn orders(&self) -> usize {
        self.parts.iter().map(|part| part.direct.count()).sum()
    }

    /// How many designs there are.
    #[must_use]
    pub fn designs(&self) -> usize {
        self.parts.len()
    }

    /// Samples of the longest window.
    #[must_use]
    pub fn length(&self) -> usize {
        self.length
    }

    /// Samples pushed since the start.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Forgets all samples.
    pub fn reset(&mut self) {
        (self.next, self.count) = (0, 0);
    }

    /// Takes one sample, a number for every channel, and writes the newest estimates: for every order one number for every channel,
    /// NaN until the window of the order is full.
    ///
    /// Channels that `sample` does not hold are NaN; what does not fit into `out` is not written.
    #[inline]
    pub fn push(&mut self, sample: &[T], out: &mut [T]) {
        self.keep(sample);
        self.estimates(out.chunks_mut(self.channels.max(1)));
    }

    /// The newest estimates, for every order of all designs.
    #[inline]
    fn estimates<'o>(&self, outs: impl Iterator<Item = &'o mut [T]>)
    where
        T: 'o,
    {
        let mut outs = outs;
        for part in &self.parts {
            self.estimate(part, outs.by_ref().take(part.direct.count()));
        }
    }

    /// The newest estimates of a design, for every order.
    #[inline]
    fn estimate<'o>(&self, part: &Part<T>, outs: impl Iterator<Item = &'o mut [T]>)
    where
        T: 'o,
    {
        let window = self.newest(part.span);
        for (order, out) in outs.enumerate() {
            match window {
                Some(window) => part.direct.latest(order, window, self.channels, out),
                None => out.fill(T::from_f64(f64::NAN)),
            }
        }
    }

    /// Takes a block of samples and writes what [`Stream::push`] would have given one after the other: for every order a block.
    ///
    /// On an error, as when `control` stops it, the stream is as it was before. The engine is that of the bank, on `threads` threads
    /// at most (0 for as many as the process may use); any but "direct" agrees with [`Stream::push`] to rounding.
    pub fn push_block(
        &mut self,
        block: &[T],
        out: &mut [T],
        threads: usize,
        control: &impl Control,
    ) -> Result<(), Error> {
        let outs = self.cut(block, out)?;
        self.push_parts(block, outs, threads, control)
    }

    /// The outputs of a block, for every order.
    fn cut<'o>(&self, block: &[T], out: &'o mut [T]) -> Result<Vec<&'o mut [T]>, Error> {
        if !block.len().is_multiple_of(self.channels) {
            return Err(Error::argument("x", block.len(), format!("samples of {} channels", self.channels)));
        }
        if Some(out.len()) != block.len().checked_mul(self.orders()) {
            return Err(Error::argument("out", out.len(), "as long as x, for every order"));
        }
        Ok(out.chunks_mut(block.len().max(1)).collect())
    }

    fn push_parts(
        &mut self,
        block: &[T],
        outs: Vec<&mut [T]>,
        threads: usize,
        control: &impl Control,
    ) -> Result<(), Error> {
        if block.len() <= FEW * self.channels && self.parts.iter().all(|part| part.sequential) {
            self.push_each(block, outs);
            return Ok(());
        }
        let mut outs = outs.into_iter();
        for part in &self.parts {
            let outs = outs.by_ref().take(part.direct.count()).collect();
            self.block(part, block, outs, threads, control)?;
        }
        self.keep_block(block);
        Ok(())
    }

    /// One sample after the other.
    fn push_each(&mut self, block: &[T], outs: Vec<&mut [T]>) {
        let mut outs = outs;
        for (row, sample) in block.chunks_exact(self.channels).enumerate() {
            self.keep(sample);
            self.estimates(outs.iter_mut().map(|out| &mut out[row * self.channels..][..self.channels]));
        }
    }

    /// The outputs of a block for one design: first those whose windows reach back before it.
    fn block(
        &self,
        part: &Part<T>,
        block: &[T],
        outs: Vec<&mut [T]>,
        threads: usize,
        control: &impl Control,
    ) -> Result<(), Error> {
        let (channels, samples) = (self.channels, block.len() / self.channels);
        let before = part.span.saturating_sub(1);
        let held = self.held().min(before);
        let missing = (before - held).min(samples);
        let inside = before.min(samples);
        let (mut head, mut tail) = (Vec::new(), Vec::new());
        for out in outs {
            let (warmup, rest) = out.split_at_mut(missing * channels);
            warmup.fill(T::from_f64(f64::NAN));
            let (reaching, whole) = rest.split_at_mut((inside - missing) * channels);
            head.push(reaching);
            tail.push(whole);
        }
        let job = |samples: usize| {
            let layout = Layout { outer: 1, samples, inner: channels };
            Job { threads, ..Job::new(&part.bank, Mode::Valid, layout) }
        };
        if inside > missing {
            let x = self.before(held, &block[..inside * channels])?;
            job(held + inside).run_into(&x, head, control)?;
        }
        if samples > inside { job(samples).run_into(block, tail, control) } else { Ok(()) }
    }

    /// The newest `held` samples, and those of a block behind them.
    fn before(&self, held: usize, block: &[T]) -> Result<Vec<T>, Error> {
        let mut x = try_vec(held * self.channels + block.len(), T::default())?;
        let (old, new) = x.split_at_mut(held * self.channels);
        self.copy_newest(held, old);
        new.copy_from_slice(block);
        Ok(x)
    }

    /// Samples at hand.
    #[inline]
    fn held(&self) -> usize {
        usize::try_from(self.count).map_or(self.length, |count| count.min(self.length))
    }

    /// The newest `span` samples, if there are as many.
    #[inline]
    fn newest(&self, span: usize) -> Option<&[T]> {
        if self.held() < span {
            return None;
        }
        // The newest sample stands just before `next`, or a ring later.
        let end = self.next.wrapping_add(self.length).wrapping_mul(self.stride);
        self.ring.get(end.wrapping_sub(span.wrapping_mul(self.stride))..end)
    }

    #[inline]
    fn keep(&mut self, sample: &[T]) {
        for place in [self.next, self.next.wrapping_add(self.length)] {
            let start = place.wrapping_mul(self.stride);
            let row = self.ring.get_mut(start..).unwrap_or_default().iter_mut().take(self.channels);
            let given = sample.iter().copied().chain(std::iter::repeat(T::from_f64(f64::NAN)));
            row.zip(given).for_each(|(place, value)| *place = value);
        }
        let next = self.next.wrapping_add(1);
        self.next = if next < self.length { next } else { 0 };
        self.count = self.count.saturating_add(1);
    }

    fn keep_block(&mut self, block: &[T]) {
        let samples = block.len() / self.channels;
        let passed = samples.saturating_sub(self.length);
        self.count = self.count.saturating_add(passed as u64);
        block[passed * self.channels..].chunks_exact(self.channels).for_each(|sample| self.keep(sample));
    }

    /// The newest `count` samples, side by side; as many as are held, at most.
    pub fn copy_newest(&self, count: usize, out: &mut [T]) {
        let rows = self.newest(count).unwrap_or_default().chunks_exact(self.stride);
        for (out, row) in out.chunks_exact_mut(self.channels).zip(rows) {
            out.copy_from_slice(&row[..self.channels]);
        }
    }

    /// Makes the stream one that has seen `count` samples, the last of which are `samples`: all that its windows hold.
    pub fn restore(&mut self, samples: &[T], count: u64) -> Result<(), Error> {
        let kept = count.min(self.length as u64);
        if samples.len() as u64 != kept * self.channels as u64 {
            let allowed = format!("the last {kept} samples of {} channels", self.channels);
            return Err(Error::argument("samples", samples.len(), allowed));
        }
        self.reset();
        self.keep_block(samples);
        self.count = count;
        Ok(())
    }
}
