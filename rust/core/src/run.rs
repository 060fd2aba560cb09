//! A bank meets an array: which outputs are interior, which samples they need, and what is refused.
//!
//! The array is contiguous and seen as `(outer, samples, inner)`; the middle axis is differentiated. Work is cut into
//! tasks that own their parts of the output. The cuts change no bit, because every output is computed alone.

use crate::bank::Bank;
use crate::columns::Gather;
use crate::control::Control;
pub use crate::ends::Mode;
use crate::engine::Sample;
use crate::error::Error;
use crate::frame::Frame;
pub use crate::frame::Layout;
use crate::tasks::Tasks;
use crate::threads;

/// Where the outputs of the full-length modes lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alignment {
    /// On the samples: `tau` is moved to the nearest one if need be.
    Sample,
    /// Half a sample later for even windows: `SciPy`'s convention, `tau` stays in the middle.
    HalfSample,
}

/// A part of longer rows: the samples at hand and the outputs that are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// The first sample that is at hand; the layout says how many.
    pub start: usize,
    /// Samples of a whole row.
    pub samples: usize,
    /// The first output that is wanted.
    pub first: usize,
    /// How many outputs of a row are wanted.
    pub outputs: usize,
}

/// One run of a bank.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// What to run.
    pub bank: &'a Bank,
    /// What happens at the ends of the data.
    pub mode: Mode,
    /// Where full-length outputs lie.
    pub alignment: Alignment,
    /// In [`Mode::Valid`]: estimates on the samples, as the full-length modes give them, not at `tau`.
    pub aligned: bool,
    /// The array.
    pub layout: Layout,
    /// The part of longer rows that the array is; by default it is all.
    pub part: Option<Part>,
    /// Threads at most; 0 for as many as the process may use.
    pub threads: usize,
}

impl<'a> Job<'a> {
    /// A run of `bank` on whole rows, by as many threads as are useful.
    #[must_use]
    pub fn new(bank: &'a Bank, mode: Mode, layout: Layout) -> Self {
        Self { bank, mode, alignment: Alignment::Sample, aligned: false, layout, part: None, threads: 0 }
    }

    /// Samples of a whole row.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.part.map_or(self.layout.samples, |part| part.samples)
    }

    /// Outputs of a whole row.
    #[must_use]
    pub fn outputs(&self) -> usize {
        match self.mode {
            Mode::Valid => (self.samples() + 1).saturating_sub(self.bank.first().span()),
            _ => self.samples(),
        }
    }

    /// Outputs of a row that are wanted.
    #[must_use]
    pub fn wanted(&self) -> usize {
        self.part.map_or(self.outputs(), |part| part.outputs)
    }

    /// Estimates into `out`: for every order an array of the shape of `x` but for [`Job::wanted`] along the differentiated
    /// axis.
    pub fn run<T: Sample>(&self, x: &[T], out: &mut [T], control: &impl Control) -> Result<(), Error> {
        let results = self.results();
        if results.and_then(|results| results.checked_mul(self.bank.plans().len())) != Some(out.len()) {
            return Err(self.misfit(out.len()));
        }
        self.run_into(x, out.chunks_mut(results.unwrap_or_default().max(1)).collect(), control)
    }

    /// The same, with a place of its own for every order.
    pub fn run_into<T: Sample>(&self, x: &[T], outs: Vec<&mut [T]>, control: &impl Control) -> Result<(), Error> {
        let (samples, window_length) = (self.samples(), self.bank.first().span());
        if window_length > samples && !self.mode.extends() {
            let allowed = format!("at most the {samples} samples of x in mode '{}'", self.mode.name());
            return Err(Error::argument("window_length", window_length, allowed));
        }
        let rows = self.layout.rows();
        if rows.and_then(|rows| rows.checked_mul(self.layout.samples)) != Some(x.len()) {
            return Err(self.misfit(x.len()));
        }
        self.check_part()?;
        if self.results() == Some(0) {
            return Ok(());
        }
        if outs.len() != self.bank.plans().len() || outs.iter().any(|out| Some(out.len()) != self.results()) {
            return Err(self.misfit(outs.len()));
        }
        let frame = self.frame(control)?;
        self.check_samples(&frame)?;
        threads::work(&frame, x, Tasks::new(&frame, outs), self.threads, control)
    }

    /// Results of one order.
    fn results(&self) -> Option<usize> {
        self.layout.rows()?.checked_mul(self.wanted())
    }

    fn misfit(&self, got: usize) -> Error {
        Error::argument("out", got, format!("as long as {:?} and mode '{}' say", self.layout, self.mode.name()))
    }

    /// Decides what every thread needs to know.
    fn frame<T: Sample>(&self, control: &impl Control) -> Result<Frame<'a, T>, Error> {
        let (plan, mode, outputs, samples) = (self.bank.first(), self.mode, self.outputs(), self.samples());
        let window_length = plan.span();
        let half_sample = self.alignment == Alignment::HalfSample && window_length.is_multiple_of(2);
        let (runner, center) = match mode {
            Mode::Valid if self.aligned => (self.bank.aligned(control)?, 0),
            Mode::Valid => (self.bank.at_tau()?, 0),
            _ if half_sample => (self.bank.at_tau()?, (window_length / 2).cast_signed() - 1),
            _ => (self.bank.aligned(control)?, plan.aligned_position()),
        };
        let windows = (samples + 1).saturating_sub(window_length).cast_signed();
        let clamp = |output: isize| output.clamp(0, outputs.cast_signed()).cast_unsigned();
        let mut interior = clamp(center)..clamp(windows + center);
        if half_sample && mode == Mode::Fit {
            interior = window_length / 2..outputs - window_length / 2;
        }
        let fitted = mode == Mode::Fit && interior != (0..outputs);
        let plans = self.bank.plans().iter().take(if fitted { usize::MAX } else { 0 });
        let ends = plans.map(|plan| plan.end(control)).collect::<Result<_, _>>()?;
        let (start, first) = self.part.map_or((0, 0), |part| (part.start, part.first));
        let (orders, layout) = (self.bank.plans().len(), self.layout);
        let wanted = first..first + self.wanted();
        let gather = Gather::new(runner, layout, orders, outputs, wanted.len());
        Ok(Frame { runner, ends, mode, center, interior, samples, layout, start, wanted, orders, gather })
    }

    /// Refuses parts that lie outside of their rows.
    fn check_part(&self) -> Result<(), Error> {
        let Some(Part { start, samples, first, outputs }) = self.part else { return Ok(()) };
        let within = |first: usize, count: usize, all: usize| first.checked_add(count).is_some_and(|end| end <= all);
        if within(start, self.layout.samples, samples) && within(first, outputs, self.outputs()) {
            return Ok(());
        }
        let allowed = format!("samples and outputs of one row, which has {} outputs", self.outputs());
        Err(Error::argument("part", (start, samples, first), allowed))
    }

    /// Refuses outputs that need samples which are not at hand.
    fn check_samples<T: Sample>(&self, frame: &Frame<'_, T>) -> Result<(), Error> {
        let Some(Part { start, samples, first, .. }) = self.part else { return Ok(()) };
        let (needs, held) = (frame.needs(&frame.wanted), start..start + self.layout.samples);
        if needs.is_empty() || (held.start <= needs.start && needs.end <= held.end) {
            return Ok(());
        }
        let allowed = format!(
            "such that x, which holds the samples {} to {}, holds what the outputs {} to {} need: {} to {}",
            held.start,
            held.end.saturating_sub(1),
            frame.wanted.start,
            frame.wanted.end - 1,
            needs.start,
            needs.end - 1
        );
        Err(Error::argument("part", (start, samples, first), allowed))
    }
}
