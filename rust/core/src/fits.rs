//! Every estimate by a fit of its own: where samples are missing, unevenly spaced or of unequal weight, and where the error of
//! each estimate is wanted.

#![expect(
    clippy::indexing_slicing,
    reason = "lanes are fewer than a panel has, and rows are numbered within their shape"
)]

pub(crate) mod panel;
mod work;

use panel::{Lanes, MOST};
use work::{Memory, Row, Work};

use crate::control::Control;
use crate::engine::Sample;
use crate::error::Error;
use crate::frame::Layout;
use crate::gaps::Whole;
use crate::irregular::{Times, Wanted, Windows};
use crate::local::{Model, SIDE};
use crate::tasks::cut;
use crate::threads::{Load, share};

/// Work of a piece, after which a thread looks whether to go on: some milliseconds.
const PIECE: usize = 1 << 22;

/// A number for every sample.
#[derive(Debug, Clone, Copy)]
pub enum PerSample<'a> {
    /// The same for all rows.
    Shared(&'a [f64]),
    /// In the layout of the samples.
    Each(&'a [f64]),
}

/// The noise whose share in the estimates is wanted.
#[derive(Debug, Clone, Copy)]
pub enum Noise<'a> {
    /// White noise of variance 1.
    Unit,
    /// White noise with this standard deviation.
    Level(PerSample<'a>),
    /// Noise with this covariance of samples so many samples apart.
    Autocovariance(&'a [f64]),
}

/// Which windows give an estimate.
#[derive(Debug, Clone, Copy)]
pub struct Allowed {
    /// Whether samples may be missing at all.
    pub missing: bool,
    /// Samples that a window must hold.
    pub support: usize,
    /// How much larger the noise gain may be than that of the whole window, evenly filled, at the same point: without and
    /// with missing samples.
    pub gain: [f64; 2],
}

/// Fits of one array.
#[derive(Debug, Clone, Copy)]
pub struct Fits<'a> {
    /// What is fitted.
    pub model: &'a Model,
    /// The whole window.
    pub whole: &'a Whole,
    /// Where the windows lie.
    pub windows: Windows<'a>,
    /// Which estimates are wanted, as indices of the array of all of them; by default all, those of all rows at one time
    /// after the other.
    pub listed: Option<&'a [i64]>,
    /// The samples' own weights.
    pub weights: Option<PerSample<'a>>,
    /// What the standard deviation is of.
    pub noise: Noise<'a>,
    /// Which windows give an estimate.
    pub allowed: Allowed,
    /// The array.
    pub layout: Layout,
    /// Threads at most; 0 for as many as the process may use.
    pub threads: usize,
}

/// Where the results go: for every order one after the other, as many numbers as there are estimates.
#[derive(Debug)]
pub struct Results<'o, T> {
    /// The estimates.
    pub estimate: &'o mut [T],
    /// Their standard deviations.
    pub std: Option<&'o mut [T]>,
    /// How much they differ from the fit of the higher degree.
    pub bias: Option<&'o mut [T]>,
    /// The numbers of samples used, once for all orders.
    pub support: Option<&'o mut [i64]>,
}

/// A part of the results.
struct Piece<'o, T> {
    first: usize,
    estimate: Vec<&'o mut [T]>,
    std: Vec<&'o mut [T]>,
    bias: Vec<&'o mut [T]>,
    support: &'o mut [i64],
}

impl Fits<'_> {
    /// How many estimates there are.
    #[must_use]
    pub fn count(&self) -> usize {
        let rows = self.layout.outer.saturating_mul(self.layout.inner);
        self.listed.map_or_else(|| self.windows.outputs(self.whole).saturating_mul(rows), <[i64]>::len)
    }

    /// All fits.
    pub fn run<T: Sample>(&self, x: &[T], results: Results<'_, T>, control: &impl Control) -> Result<(), Error> {
        let count = self.count();
        self.check(x.len(), &results, count)?;
        if count == 0 {
            return Ok(());
        }
        let work = self.work();
        let panelled = self.panelled() && results.bias.is_none();
        let group = if panelled { SIDE * self.layout.outer * self.layout.inner } else { 1 };
        let piece = (PIECE / work).clamp(1, 1 << 13).next_multiple_of(group).min(count);
        let sizes = (count, count, piece);
        let mut estimate = cut(Some(results.estimate), sizes);
        let (mut std, mut bias) = (cut(results.std, sizes), cut(results.bias, sizes));
        let mut support = results.support.map(|support| support.chunks_mut(piece));
        let mut first = 0;
        let tasks = std::iter::from_fn(|| {
            let estimate: Vec<&mut [T]> = estimate.iter_mut().filter_map(Iterator::next).collect();
            let length = estimate.first()?.len();
            first += length;
            Some(Piece {
                first: first - length,
                estimate,
                std: std.iter_mut().filter_map(Iterator::next).collect(),
                bias: bias.iter_mut().filter_map(Iterator::next).collect(),
                support: support.as_mut().and_then(Iterator::next).unwrap_or_default(),
            })
        });
        let load = Load { outputs: count, work, tasks: count.div_ceil(piece), threads: self.threads };
        share(tasks, load, control, |next, progress, between| {
            let mut memory = Memory::default();
            while let Some(piece) = next() {
                let done = piece.estimate.first().map_or(0, |part| part.len());
                Work { fits: self, x, memory: &mut memory, piece, panelled }.run()?;
                progress.proceed(done, between)?;
            }
            Ok(())
        })
    }

    /// Refuses slices that do not fit together.
    fn check<T>(&self, held: usize, results: &Results<'_, T>, count: usize) -> Result<(), Error> {
        let Layout { outer, samples, inner } = self.layout;
        let all = outer.saturating_mul(samples).saturating_mul(inner);
        let wanted = count.saturating_mul(self.model.orders.len());
        let as_long = |part: &Option<&mut [T]>| part.as_ref().is_none_or(|part| part.len() == wanted);
        let one_each = |values: PerSample<'_>| match values {
            PerSample::Shared(values) => values.len() == samples,
            PerSample::Each(values) => values.len() == all,
        };
        let level = if let Noise::Level(level) = self.noise { Some(level) } else { None };
        let stamps = if let Times::Stamps { t, .. } = self.windows.times { t.len() } else { samples };
        let outputs = all / samples.max(1) * self.windows.outputs(self.whole);
        let fits = held == all
            && self.windows.samples == samples
            && stamps == samples
            && results.estimate.len() == wanted
            && as_long(&results.std)
            && as_long(&results.bias)
            && results.support.as_ref().is_none_or(|support| support.len() == count)
            && self.weights.is_none_or(one_each)
            && level.is_none_or(one_each)
            && self.listed.is_none_or(|all| all.iter().all(|&one| (0..outputs as i64).contains(&one)));
        if fits {
            Ok(())
        } else {
            Err(Error::argument("out", results.estimate.len(), "as long as there are estimates"))
        }
    }

    /// Whether windows of uneven samples may be fitted side by side: nothing makes one different from its neighbour.
    fn panelled(&self) -> bool {
        let levels = matches!(self.noise, Noise::Unit | Noise::Level(PerSample::Shared(_)));
        let counted = matches!(self.windows.times, Times::Stamps { duration: None, .. });
        let samples = matches!(self.windows.wanted, Wanted::Samples);
        let alike = self.weights.is_none() && self.listed.is_none() && self.allowed.gain[0] == f64::INFINITY;
        let small = self.model.degree < MOST && self.allowed.support <= self.whole.span() && self.whole.span() > 1;
        levels && counted && samples && alike && small && self.model.whole_exponents()
    }

    /// Where the windows of [`SIDE`] estimates from `output` on lie, if all of them lie around their estimates.
    fn neighbours(&self, output: usize) -> Option<(usize, Lanes)> {
        let (center, span, samples) = (self.windows.center, self.whole.span(), self.windows.samples);
        let first = output.cast_signed() - center;
        if first < 0 || output + SIDE > samples || first.cast_unsigned() + span + SIDE - 1 > samples {
            return None;
        }
        let mut lanes = Lanes::default();
        for lane in 0..SIDE {
            let window = self.windows.window(self.whole, output + lane)?;
            lanes.origin[lane] = window.origin;
            lanes.factor[lane] = window.length.recip();
            lanes.place[lane] = 2.0 * window.place - 1.0;
        }
        Some((first.cast_unsigned(), lanes))
    }

    /// What one estimate costs, in multiplications, roughly.
    fn work(&self) -> usize {
        let size = self.model.top() + 1;
        self.whole.span().saturating_mul(size * (size + 2)).saturating_add(200)
    }

    /// The estimate number `index`: which of its row, and of which row.
    fn place(&self, index: usize) -> (usize, Row) {
        let inner = self.layout.inner;
        let Some(listed) = self.listed else {
            let rows = self.layout.outer * inner;
            return (index / rows, Row { outer: index % rows / inner, inner: index % inner });
        };
        let (index, outputs) = (listed[index].unsigned_abs() as usize, self.windows.outputs(self.whole));
        (index / inner % outputs, Row { outer: index / inner / outputs, inner: index % inner })
    }

    /// What stands at `place` of the extended row.
    fn of_sample(&self, values: PerSample<'_>, row: Row, place: isize) -> f64 {
        let Layout { samples, inner, .. } = self.layout;
        // A constant beyond the data is as good as the last sample.
        let clamped = || place.clamp(0, samples.cast_signed() - 1).cast_unsigned();
        let j = self.windows.mode.source(place, samples).unwrap_or_else(clamped);
        match values {
            PerSample::Shared(values) => values[j],
            PerSample::Each(values) => values[(row.outer * samples + j) * inner + row.inner],
        }
    }
}
