//! The weights of a design as engines take them.

use std::f64::consts::TAU;

use nalgebra::Complex;

use crate::error::{Error, try_vec};

/// The weights of a design in the form that engines apply: `out[i] = scale * sum of taps[k] s[i + k]`, where `s` is the
/// data or their first differences; with an anchor `a`, plus `x[i + a]`.
///
/// The weights of a derivative sum to zero, so by summation by parts `sum w_k x_k = sum W_k (x_{k+1} - x_k)` with
/// `W_k = -(w_0 + ... + w_k)`. On differences a constant gives exactly 0, an offset costs nothing, and W is the better
/// conditioned kernel. The weights of a smoother sum to one: they are the anchor's sample plus weights that sum to zero.
/// `scale` is a power of two that brings the largest tap to [1/2, 1): float32 taps neither overflow nor underflow.
#[derive(Debug)]
pub struct Taps {
    pub(super) double: Vec<f64>,
    pub(super) single: Vec<f32>,
    pub(super) scale: f64,
    pub(super) on_differences: bool,
    pub(super) anchor: Option<usize>,
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

    pub(crate) fn are_finite(&self) -> bool {
        self.double.iter().all(|tap| tap.is_finite())
    }

    /// The power of two by which sums are multiplied.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Whether the taps meet first differences.
    #[must_use]
    pub fn meet_differences(&self) -> bool {
        self.on_differences
    }

    /// The sample that is added to a sum.
    #[must_use]
    pub fn anchor(&self) -> Option<usize> {
        self.anchor
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
