//! A stream that fits what sliding weights do not give: growing windows, missing samples, uneven times, errors.

#![expect(clippy::indexing_slicing, reason = "pieces are cut to the block, and results have a place for every sample")]

use std::sync::Arc;

use super::Stream;
use super::row::{Row, Task};
use super::window::{Local, Memory, Point, Seen};
use crate::bank::Bank;
use crate::control::Control;
use crate::engine::Sample;
use crate::error::Error;

/// Numbers of a block that are worked on at a time.
const PIECE: usize = 1 << 14;

/// Fits after which the caller is asked whether to go on.
const BETWEEN: usize = 1 << 10;

/// What a missing sample does, which is NaN.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missing {
    /// Every estimate whose window holds it is NaN.
    Propagate,
    /// The others are fitted.
    Omit,
    /// It is refused.
    Raise,
}

/// What is estimated where a window is not full, or misses samples.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// Whether windows that are not full yet give estimates, as soon as they hold `degree + 1` samples.
    pub grow: bool,
    /// What missing samples do.
    pub missing: Missing,
    /// Samples that a window must hold, if more than `degree + 1`.
    pub support: usize,
    /// By what factor the noise gain may exceed that of the whole, evenly filled window; by default 100 where samples are missing from
    /// a full window, and anything elsewhere.
    pub gain: Option<f64>,
}

/// Where results go: for every order (of all designs) a block, of the support for every design.
#[derive(Debug)]
pub struct Results<'o, T> {
    /// The estimates.
    pub estimate: &'o mut [T],
    /// Their standard deviations, for noise with a standard deviation of 1.
    pub std: Option<&'o mut [T]>,
    /// Samples in their windows that are not missing; 0 if the window is not full and need be.
    pub support: Option<&'o mut [i64]>,
}

/// When samples are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Clock {
    /// No sample has come.
    Unset,
    Even,
    Stamps,
}

/// A stream with whatever it takes to fit the windows that need it.
#[derive(Debug, Clone)]
pub struct Fitted<T: Sample> {
    stream: Stream<T>,
    locals: Vec<Local>,
    wanted: Wanted,
    clock: Clock,
    /// The times of the newest samples, oldest first.
    times: Vec<f64>,
    /// Pushes after which no window holds a missing sample any more, at most.
    tainted: usize,
    memory: Memory,
}

impl<T: Sample> Fitted<T> {
    /// For all of `banks`, each with the point at which windows are estimated that are not its own.
    pub fn new(banks: &[(Arc<Bank>, Point)], channels: usize, wanted: Wanted) -> Result<Self, Error> {
        let only: Vec<Arc<Bank>> = banks.iter().map(|(bank, _)| Arc::clone(bank)).collect();
        let compared = wanted.missing == Missing::Omit || wanted.gain.is_some();
        let local =
            |(bank, point): &(Arc<Bank>, Point)| Local::new(bank.plans().iter().map(Arc::as_ref), *point, compared);
        Ok(Self {
            stream: Stream::new(&only, channels)?,
            locals: banks.iter().map(local).collect::<Result<_, _>>()?,
            wanted,
            clock: Clock::Unset,
            times: Vec::new(),
            tainted: 0,
            memory: Memory::default(),
        })
    }

    /// The stream of full windows.
    #[must_use]
    pub fn stream(&self) -> &Stream<T> {
        &self.stream
    }

    /// The times of the newest samples, oldest first; none if they are even.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Forgets all samples.
    pub fn reset(&mut self) {
        self.stream.reset();
        self.times.clear();
        (self.clock, self.tainted) = (Clock::Unset, 0);
    }

    /// Makes the stream one that has seen `count` samples, of which `samples` are the last, taken at `times` if not at even steps.
    pub fn restore(&mut self, samples: &[T], times: &[f64], count: u64) -> Result<(), Error> {
        let kept = samples.len() / self.stream.channels;
        if !times.is_empty() && times.len() != kept {
            return Err(Error::argument("times", times.len(), format!("one for every of {kept} samples")));
        }
        check_times(times, None)?;
        self.stream.restore(samples, count)?;
        self.times = times.to_vec();
        self.clock = match (count, times) {
            (0, _) => Clock::Unset,
            (_, []) => Clock::Even,
            _ => Clock::Stamps,
        };
        self.tainted = self.stream.length;
        Ok(())
    }

    /// Takes one sample, taken at `time` unless at even steps, and writes the newest estimates, as [`Stream::push`].
    ///
    /// On an error the stream is as it was before, unless it is of memory.
    pub fn push(&mut self, sample: &[T], time: Option<f64>, estimate: &mut [T]) -> Result<(), Error> {
        let whole = self.stream.count.saturating_add(1) >= self.stream.length as u64;
        let missing = self.wanted.missing != Missing::Propagate && (self.tainted > 0 || any_missing(sample));
        if time.is_none() && self.clock != Clock::Stamps && (whole || !self.wanted.grow) && !missing {
            self.clock = Clock::Even;
            self.stream.push(sample, estimate);
            return Ok(());
        }
        self.stream.cut(sample, estimate)?;
        self.admit(sample, time.as_slice())?;
        self.stream.keep(sample);
        self.remember(time.as_slice());
        self.taint(sample);
        self.last(Results { estimate, std: None, support: None })
    }

    /// The newest estimates once more, in places as for one sample.
    pub fn last(&mut self, mut results: Results<'_, T>) -> Result<(), Error> {
        let Self { stream, locals, times, memory, .. } = self;
        let channels = stream.channels;
        let row = Row { number: 0, rows: 1, channels };
        let mut first = 0;
        for (index, (part, local)) in stream.parts.iter().zip(locals).enumerate() {
            let count = part.span.min(stream.held());
            let x = stream.newest(count).unwrap_or_default();
            let times = newest(times, count);
            let own = &mut results.estimate[first * channels..][..part.direct.count() * channels];
            if times.is_none() {
                stream.estimate(part, own.chunks_mut(channels));
            } else {
                own.fill(T::from_f64(f64::NAN));
            }
            let seen = Seen { x, stride: stream.stride, times };
            let task = Task { local, part: (index, first), span: part.span, wanted: self.wanted };
            task.complete(&seen, memory, row, &mut results)?;
            first += part.direct.count();
        }
        Ok(())
    }

    /// Takes a block of samples, taken at `times` unless at even steps, and writes what one after the other would have given.
    ///
    /// On an error, as when `control` stops it, the stream is as it was before.
    pub fn push_block(
        &mut self,
        block: &[T],
        times: Option<&[f64]>,
        mut results: Results<'_, T>,
        threads: usize,
        control: &impl Control,
    ) -> Result<(), Error> {
        let channels = self.stream.channels;
        let rows = block.len() / channels;
        self.stream.cut(block, results.estimate)?;
        let length = |part: usize| rows * channels * part;
        if results.std.as_ref().is_some_and(|std| std.len() != length(self.stream.orders()))
            || results.support.as_ref().is_some_and(|support| support.len() != length(self.locals.len()))
        {
            return Err(Error::argument("out", rows, "as long as there are estimates"));
        }
        if let Some(times) = times.filter(|times| times.len() != rows) {
            return Err(Error::argument("t", times.len(), format!("one time for every of {rows} samples")));
        }
        if rows == 0 {
            return Ok(());
        }
        self.admit(block, times.unwrap_or_default())?;
        let plain = self.wanted.missing != Missing::Omit && !self.wanted.grow && times.is_none();
        if plain && results.std.is_none() && results.support.is_none() {
            self.stream.push_block(block, results.estimate, threads, control)?;
            self.clock = Clock::Even;
            return Ok(());
        }
        let before = self.clone();
        let mut first = 0;
        for piece in block.chunks((PIECE / channels).max(1).saturating_add(self.stream.length) * channels) {
            let times = times.map(|times| &times[first..][..piece.len() / channels]);
            let done = self.piece(piece, times, (first, rows), &mut results, threads, control);
            if let Err(error) = done {
                *self = before;
                return Err(error);
            }
            first += piece.len() / channels;
        }
        Ok(())
    }

    /// A part of a block of `rows` samples, which begins with the one number `first`.
    fn piece(
        &mut self,
        piece: &[T],
        times: Option<&[f64]>,
        (first, rows): (usize, usize),
        results: &mut Results<'_, T>,
        threads: usize,
        control: &impl Control,
    ) -> Result<(), Error> {
        let channels = self.stream.channels;
        let held = self.stream.held().min(self.stream.length - 1);
        let x = self.stream.before(held, piece)?;
        let mut stamps = newest(&self.times, held).unwrap_or_default().to_vec();
        stamps.extend_from_slice(times.unwrap_or_default());
        let outs = results.estimate.chunks_mut(rows * channels);
        let mut outs: Vec<&mut [T]> = outs.map(|out| &mut out[first * channels..][..piece.len()]).collect();
        if times.is_some() {
            outs.iter_mut().for_each(|out| out.fill(T::from_f64(f64::NAN)));
            self.stream.keep_block(piece);
        } else {
            self.stream.push_parts(piece, outs, threads, control)?;
        }
        self.remember(times.unwrap_or_default());
        self.taint(piece);
        let mut order = 0;
        for (index, (part, local)) in self.stream.parts.iter().zip(&self.locals).enumerate() {
            let task = Task { local, part: (index, order), span: part.span, wanted: self.wanted };
            for end in held + 1..=held + piece.len() / channels {
                let start = end - part.span.min(end);
                let times = (!stamps.is_empty()).then(|| &stamps[start..end]);
                let seen = Seen { x: &x[start * channels..end * channels], stride: channels, times };
                let row = Row { number: first + end - held - 1, rows, channels };
                task.complete(&seen, &mut self.memory, row, results)?;
                if end.is_multiple_of(BETWEEN) && !control.proceed((first + end - held) as f64 / rows as f64) {
                    return Err(Error::Interrupted);
                }
            }
            order += part.direct.count();
        }
        Ok(())
    }

    /// Refuses samples that may not be missing, and times that do not go on.
    fn admit(&self, samples: &[T], times: &[f64]) -> Result<(), Error> {
        match self.clock {
            Clock::Stamps if times.is_empty() => {
                return Err(Error::argument(
                    "t",
                    format_args!("none"),
                    "given for every sample, as for the ones before",
                ));
            }
            Clock::Even if !times.is_empty() => {
                return Err(Error::argument(
                    "t",
                    times[0],
                    "left out, as for the samples before, or given from the first on",
                ));
            }
            _ => check_times(times, self.times.last().copied())?,
        }
        if self.wanted.missing == Missing::Raise && any_missing(samples) {
            let gone = samples.iter().filter(|value| is_missing(**value)).count();
            return Err(Error::argument("x", format_args!("{gone} of {}", samples.len()), "without missing samples"));
        }
        Ok(())
    }

    /// Keeps the times of samples that are kept.
    fn remember(&mut self, times: &[f64]) {
        self.clock = if times.is_empty() { Clock::Even } else { Clock::Stamps };
        self.times.extend_from_slice(times);
        self.times.drain(..self.times.len().saturating_sub(self.stream.length));
    }

    fn taint(&mut self, samples: &[T]) {
        let newer = samples.iter().rev().position(|value| is_missing(*value));
        let passed = newer.unwrap_or(samples.len()) / self.stream.channels;
        let from = if newer.is_some() { self.stream.length } else { self.tainted };
        self.tainted = from.saturating_sub(passed);
    }

    /// From the last estimate to the newest sample, in time; NaN as long as there is none.
    #[must_use]
    pub fn delay(&self) -> f64 {
        let Some((part, local)) = self.stream.parts.first().zip(self.locals.first()) else { return f64::NAN };
        let count = part.span.min(self.stream.held());
        let times = newest(&self.times, count);
        let there = count == part.span || (self.wanted.grow && count >= local.least());
        if there { local.delay(count, times) } else { f64::NAN }
    }
}

/// The newest `count` times, if samples have times.
fn newest(times: &[f64], count: usize) -> Option<&[f64]> {
    times.get(times.len().saturating_sub(count)..).filter(|times| !times.is_empty())
}

fn is_missing<T: Sample>(value: T) -> bool {
    value.to_f64().is_nan()
}

fn any_missing<T: Sample>(samples: &[T]) -> bool {
    samples.iter().any(|value| is_missing(*value))
}

/// Refuses times that are not finite and strictly ascending.
fn check_times(times: &[f64], last: Option<f64>) -> Result<(), Error> {
    let mut before = last;
    for &time in times {
        if !time.is_finite() {
            return Err(Error::argument("t", time, "finite"));
        }
        if let Some(before) = before.filter(|before| time <= *before) {
            return Err(Error::argument("t", time, format!("later than that of the sample before, {before:?}")));
        }
        before = Some(time);
    }
    Ok(())
}
