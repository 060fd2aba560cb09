//! How the weights of one or several orders meet the data.
//!
//! Engines run on contiguous samples and know nothing of ends, axes or threads. [`direct`] adds the taps of every output in
//! one fixed order, so that blocks, streams and threads give the same bits.

pub mod direct;

use std::f64::consts::TAU;
use std::sync::OnceLock;

use nalgebra::Complex;

use crate::bank::Runners;
use crate::error::{Error, try_vec};

/// The closed set of engines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// Every tap of every output.
    Direct,
}

/// Public names.
pub const ENGINES: [(&str, Engine); 1] = [("direct", Engine::Direct)];

/// An engine prepared for the taps of one or several orders, which share the samples that they read: shareable between
/// threads, never changed.
#[derive(Debug)]
pub enum Runner<T: Sample> {
    /// Every tap of every output.
    Direct(direct::Direct<T>),
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub struct Scratch<T: Sample> {
    differences: Vec<T>,
}

impl<T: Sample> Runner<T> {
    /// Prepares `engine` for `orders`, which have the same span.
    pub fn new(engine: Engine, orders: &[&Taps]) -> Result<Self, Error> {
        match engine {
            Engine::Direct => direct::Direct::new(orders).map(Self::Direct),
        }
    }

    /// Samples that one output reads.
    #[must_use]
    pub fn span(&self) -> usize {
        match self {
            Self::Direct(direct) => direct.span(),
        }
    }

    /// What one output of every order costs, in multiplications, roughly.
    #[must_use]
    pub fn work(&self) -> usize {
        match self {
            Self::Direct(direct) => direct.work(),
        }
    }

    /// Whether [`Runner::apply`] on single rows is faster than [`Runner::apply_lanes`], gathering included.
    #[must_use]
    pub fn prefers_rows(&self) -> bool {
        match self {
            Self::Direct(_) => false,
        }
    }

    /// For every order the outputs whose windows start at `x[first]`, `x[first + 1]` and on, as many as each of `outs` holds.
    ///
    /// `x[0]` is the sample `origin` of its row. Engines whose sums depend on a grid lay it on the row, not on `x`; they may
    /// read any sample of `x`, but the outputs depend on those outside of their windows by rounding only.
    pub fn apply(
        &self,
        x: &[T],
        first: usize,
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        let _ = origin;
        match self {
            Self::Direct(direct) => direct.apply(x, first, outs, scratch),
        }
    }

    /// The same for [`Sample::LANES`] neighbouring rows at once: `x` is the matrix `(samples, LANES)`, and so are `outs`.
    pub fn apply_lanes(
        &self,
        x: &[T],
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        let lanes = T::LANES;
        let samples = x.len() / lanes;
        let outputs = (samples + 1).saturating_sub(self.span());
        let mut row = try_vec(samples, T::default())?;
        let mut results = try_vec(outputs * outs.len(), T::default())?;
        for lane in 0..lanes {
            row.iter_mut().zip(x[lane..].iter().step_by(lanes)).for_each(|(value, sample)| *value = *sample);
            let mut each: Vec<&mut [T]> = results.chunks_mut(outputs.max(1)).collect();
            self.apply(&row, 0, origin, &mut each, scratch)?;
            for (out, result) in outs.iter_mut().zip(each) {
                out[lane..].iter_mut().step_by(lanes).zip(result).for_each(|(value, result)| *value = *result);
            }
        }
        Ok(())
    }
}

/// The weights of a design in the form that engines apply: `out[i] = scale * sum of taps[k] s[i + k]`, where `s` is the
/// data or their first differences; with an anchor `a`, plus `x[i + a]`.
///
/// The weights of a derivative sum to zero, so by summation by parts `sum w_k x_k = sum W_k (x_{k+1} - x_k)` with
/// `W_k = -(w_0 + ... + w_k)`. On differences a constant gives exactly 0, an offset costs nothing, and W is the better
/// conditioned kernel. The weights of a smoother sum to one: they are the anchor's sample plus weights that sum to zero.
/// `scale` is a power of two that brings the largest tap to [1/2, 1): float32 taps neither overflow nor underflow.
#[derive(Debug)]
pub struct Taps {
    double: Vec<f64>,
    single: Vec<f32>,
    scale: f64,
    on_differences: bool,
    anchor: Option<usize>,
}

impl Taps {
    /// Taps on the data themselves.
    pub fn plain(weights: &[f64]) -> Result<Self, Error> {
        let mut taps = try_vec(weights.len(), 0.0)?;
        taps.copy_from_slice(weights);
        Self::scaled(taps, false)
    }

    /// Taps on first differences of weights that sum to zero up to rounding, or to one with an anchor.
    ///
    /// Each side of the anchor, by default each half, is summed from its own end: `W_k = w_{k+1} + ... + w_{L-1}` as
    /// well, so that symmetry and the small values at both ends are kept.
    pub fn on_differences(weights: &[f64], anchor: Option<usize>) -> Result<Self, Error> {
        let mut taps = try_vec(weights.len().saturating_sub(1), 0.0)?;
        let middle = anchor.unwrap_or(taps.len().div_ceil(2));
        let (old, new) = taps.split_at_mut(middle);
        accumulate(old.iter_mut().zip(weights), -1.0);
        accumulate(new.iter_mut().rev().zip(weights.iter().rev()), 1.0);
        Ok(Self { anchor, ..Self::scaled(taps, true)? })
    }

    fn scaled(mut double: Vec<f64>, on_differences: bool) -> Result<Self, Error> {
        let peak = double.iter().fold(0.0, |peak: f64, tap| peak.max(tap.abs()));
        let (_, exponent) = libm::frexp(peak);
        // 2^1024 is not a number; and a subnormal scale would cost the result its digits.
        let exponent = exponent.clamp(-1022, 1023);
        double.iter_mut().for_each(|tap| *tap = libm::ldexp(*tap, -exponent));
        let mut single = try_vec(double.len(), 0.0)?;
        single.iter_mut().zip(&double).for_each(|(single, double)| *single = *double as f32);
        Ok(Self { double, single, scale: libm::ldexp(1.0, exponent), on_differences, anchor: None })
    }

    /// The frequency response of what the engines compute, with the phase reference at `position`, in samples from the oldest;
    /// `turns` is the frequency in cycles per sample.
    ///
    /// On differences it carries the factor `z - 1` explicitly, and so keeps its digits at low frequencies.
    #[must_use]
    pub fn response(&self, turns: f64, position: f64) -> Complex<f64> {
        let power = |k: f64| Complex::from_polar(1.0, TAU * (turns * (k - position)).fract());
        // exp(2 pi i turns k) by blocks: one product for every tap, and the errors of 64 of them.
        let step: Vec<Complex<f64>> = (0..self.double.len().clamp(1, 64))
            .map(|k| Complex::from_polar(1.0, TAU * (turns * k as f64).fract()))
            .collect();
        let sum: Complex<f64> = self
            .double
            .chunks(step.len())
            .enumerate()
            .map(|(block, taps)| {
                let inner: Complex<f64> = taps.iter().zip(&step).map(|(tap, z)| z * tap).sum();
                inner * power((block * step.len()) as f64)
            })
            .sum();
        let scaled = sum * self.scale;
        if !self.on_differences {
            return scaled;
        }
        let half = 0.5 * TAU * turns.fract();
        let difference = Complex::new(0.0, 2.0 * half.sin()) * Complex::from_polar(1.0, half);
        scaled * difference + self.anchor.map_or(Complex::new(0.0, 0.0), |anchor| power(anchor as f64))
    }

    /// Samples that one output reads.
    #[must_use]
    pub fn span(&self) -> usize {
        self.double.len() + usize::from(self.on_differences)
    }
}

/// Running sums `sign * (w_0 + ... + w_k)` with the rounding errors carried along (Neumaier).
fn accumulate<'a>(pairs: impl Iterator<Item = (&'a mut f64, &'a f64)>, sign: f64) {
    let (mut sum, mut lost) = (0.0_f64, 0.0);
    for (tap, &weight) in pairs {
        let total = sum + weight;
        lost += if sum.abs() >= weight.abs() { (sum - total) + weight } else { (weight - total) + sum };
        sum = total;
        *tap = sign * (sum + lost);
    }
}

/// The element types that engines run in.
pub trait Sample:
    Copy
    + Default
    + Send
    + Sync
    + std::fmt::Debug
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
{
    /// Rows that run side by side: as many as fit into 64 bytes.
    const LANES: usize = 64 / size_of::<Self>();
    /// Where the runners of this type are kept.
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>>;
    /// The taps in this type.
    fn taps(taps: &Taps) -> &[Self];
    /// The nearest value of this type.
    fn from_f64(value: f64) -> Self;
    /// The same value as f64.
    fn to_f64(self) -> f64;
}

impl Sample for f64 {
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>> {
        &runners.double
    }
    fn taps(taps: &Taps) -> &[Self] {
        &taps.double
    }
    fn from_f64(value: f64) -> Self {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
}

impl Sample for f32 {
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>> {
        &runners.single
    }
    fn taps(taps: &Taps) -> &[Self] {
        &taps.single
    }
    fn from_f64(value: f64) -> Self {
        value as Self
    }
    fn to_f64(self) -> f64 {
        self.into()
    }
}
