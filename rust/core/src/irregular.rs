//! Where the windows lie among samples that are evenly spaced or not, and the places of the samples in them.

#![expect(clippy::indexing_slicing, reason = "windows lie between the first and the last time")]

use crate::ends::Mode;
use crate::gaps::Whole;

/// When the samples were taken.
#[derive(Debug, Clone, Copy)]
pub enum Times<'a> {
    /// At equal steps.
    Even {
        /// The step.
        delta: f64,
    },
    /// At these times, ascending.
    Stamps {
        /// One for every sample of a row.
        t: &'a [f64],
        /// Windows of so much time, by default of as many samples as the design has.
        duration: Option<Span>,
    },
}

/// A window of some duration.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// Its duration.
    pub duration: f64,
    /// By how much it may reach beyond the first and the last sample: half a usual step.
    pub beyond: f64,
}

/// Where estimates are wanted.
#[derive(Debug, Clone, Copy)]
pub enum Wanted<'a> {
    /// At every sample.
    Samples,
    /// At `tau` of every whole window.
    Windows,
    /// At these times.
    At(&'a [f64]),
}

/// What places windows.
#[derive(Debug, Clone, Copy)]
pub struct Windows<'a> {
    /// When the samples were taken.
    pub times: Times<'a>,
    /// Where estimates are wanted.
    pub wanted: Wanted<'a>,
    /// What happens at the ends.
    pub mode: Mode,
    /// At the ends the window shrinks to this many samples before it is shifted; by default it is shifted at once.
    pub least: Option<usize>,
    /// Samples of a row.
    pub samples: usize,
    /// The point of estimation.
    pub tau: f64,
    /// The sample of the window that lies at `tau`.
    pub center: isize,
}

/// One window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window {
    /// Its first sample, of the extended row if the mode extends it.
    pub start: isize,
    /// Its number of samples.
    pub count: usize,
    /// The point of estimation on [0, 1].
    pub place: f64,
    /// Whether it lies around the estimate as the design says, of even samples.
    pub ideal: bool,
    /// When it begins, and its duration; for even steps in samples.
    pub origin: f64,
    /// See `origin`.
    pub length: f64,
}

impl Windows<'_> {
    /// Estimates of a row.
    pub(crate) fn outputs(&self, whole: &Whole) -> usize {
        match self.wanted {
            Wanted::Samples => self.samples,
            Wanted::Windows => (self.samples + 1).saturating_sub(whole.span()),
            Wanted::At(times) => times.len(),
        }
    }

    /// The window of the estimate number `output`; none where the mode gives none.
    pub(crate) fn window(&self, whole: &Whole, output: usize) -> Option<Window> {
        match self.times {
            Times::Even { .. } => self.even(whole, output),
            Times::Stamps { t, duration: None } => self.counted(whole, t, output),
            Times::Stamps { t, duration: Some(span) } => self.timed(t, span, output),
        }
    }

    /// Whether a window lies in the row, unextended.
    pub(crate) fn inside(&self, window: &Window) -> bool {
        window.start >= 0 && window.start + window.count.cast_signed() <= self.samples.cast_signed()
    }

    /// From derivatives for `u = 2 s - 1` to derivatives in time.
    pub(crate) fn unit(&self, window: &Window) -> f64 {
        match self.times {
            Times::Even { delta } => 2.0 / (window.length * delta),
            Times::Stamps { .. } => 2.0 / window.length,
        }
    }

    /// Half the width of a sample's cell on [0, 1].
    pub(crate) fn half(&self, window: &Window) -> f64 {
        match self.times {
            Times::Stamps { duration: Some(span), .. } => span.beyond / window.length,
            Times::Even { .. } => 0.5 / window.length,
            Times::Stamps { .. } => 0.5 / window.count as f64,
        }
    }

    /// The times of the window's samples, of even ones their numbers, for which there is `room`.
    pub(crate) fn times<'t>(&'t self, window: &Window, room: &'t mut [f64]) -> &'t [f64] {
        if let Times::Stamps { t, .. } = self.times {
            return &t[window.start.cast_unsigned()..][..window.count];
        }
        room.iter_mut().enumerate().for_each(|(j, time)| *time = j as f64);
        room
    }

    fn even(&self, whole: &Whole, output: usize) -> Option<Window> {
        let span = whole.span();
        let length = whole.window_length() as f64;
        let at = |start: isize, position: f64| Window {
            start,
            count: span,
            place: whole.place(position),
            ideal: true,
            origin: -whole.place(0.0) * length,
            length,
        };
        let sample = output.cast_signed();
        if let Wanted::Windows = self.wanted {
            return Some(Window { place: self.tau, ..at(sample, 0.0) });
        }
        let start = sample - self.center;
        if self.mode.extends() {
            return Some(at(start, self.center as f64));
        }
        let ideal = start;
        let (start, count) = self.at_sample(start, sample, span)?;
        let window = Window { ideal: start == ideal, ..at(start, (sample - start) as f64) };
        if count == span {
            return Some(window);
        }
        let length = count as f64;
        let place = ((sample - start) as f64 + 0.5) / length;
        Some(Window { start, count, place, ideal: false, origin: -0.5, length })
    }

    /// The window of `span` samples for the estimate next to `sample`: `start` as far as the ends and the mode allow.
    fn at_sample(&self, start: isize, sample: isize, span: usize) -> Option<(isize, usize)> {
        let last = self.samples.cast_signed() - span.cast_signed();
        if (0..=last).contains(&start) {
            return Some((start, span));
        }
        if self.mode == Mode::Nan {
            return None;
        }
        let Some(least) = self.least else { return Some((start.clamp(0, last), span)) };
        // As odd or even as the whole window, so that both ends are alike; on the sample next to `tau`, the newer one of two.
        let mut count = span;
        loop {
            let start = sample - (self.tau * count as f64 + 1e-9).floor() as isize;
            let last = self.samples.cast_signed() - count.cast_signed();
            if (0..=last).contains(&start) || count < least + 2 {
                return Some((start.clamp(0, last), count));
            }
            count -= 2;
        }
    }

    fn counted(&self, whole: &Whole, t: &[f64], output: usize) -> Option<Window> {
        let (sample, time) = match self.wanted {
            Wanted::At(times) => (nearest(t, times[output]).cast_signed(), times[output]),
            _ => (output.cast_signed(), t[output.min(t.len() - 1)]),
        };
        let (start, count) = match self.wanted {
            Wanted::Windows => (sample, whole.span()),
            _ => self.at_sample(sample - self.center, sample, whole.span())?,
        };
        let first = start.cast_unsigned();
        let (begin, end, steps) = (t[first], t[first + count - 1], (count - 1) as f64);
        let step = if count > 1 { (end - begin) / steps } else { 1.0 };
        let (origin, length) = (begin - 0.5 * step, step * count as f64);
        let place = if let Wanted::Windows = self.wanted { self.tau } else { (time - origin) / length };
        Some(Window { start, count, place, ideal: false, origin, length })
    }

    fn timed(&self, t: &[f64], span: Span, output: usize) -> Option<Window> {
        let time = if let Wanted::At(times) = self.wanted { times[output] } else { t[output] };
        let length = span.duration;
        let (first, last) = (t[0] - span.beyond, t[t.len() - 1] + span.beyond - length);
        let ideal = time - self.tau * length;
        // Rounding must not decide between a window that just fits and one that does not.
        let slack = 1e-9 * span.beyond;
        let mut origin = ideal;
        if !(ideal >= first - slack && ideal <= last + slack) {
            if self.mode == Mode::Nan {
                return None;
            }
            origin = ideal.min(last).max(first);
        }
        let start = t.partition_point(|t| *t < origin);
        let count = t[start..].partition_point(|t| *t <= origin + length);
        let (start, place) = (start.cast_signed(), (time - origin) / length);
        Some(Window { start, count, place, ideal: false, origin, length })
    }
}

/// The sample nearest to `time`, the newer one of two.
fn nearest(t: &[f64], time: f64) -> usize {
    let after = t.partition_point(|t| *t <= time);
    match after {
        0 => 0,
        after if after == t.len() => after - 1,
        after if time - t[after - 1] < t[after] - time => after - 1,
        after => after,
    }
}
