//! What the user asks for, checked, and what follows from it before any weight is known.

use std::ops::Range;

use crate::control::Control;
use crate::engine::Taps;
use crate::error::Error;
use crate::fit::Fit;
use crate::jacobi::Jacobi;
use crate::kernel::{Kernel, MAX_TAU, Tau};
use crate::rule::Rule;

/// Windows beyond this are refused: their weights alone would take 80 MB, and a mistyped size should not run for minutes.
pub const MAX_WINDOW: usize = 10_000_000;

/// Positions in samples that differ by less, relative to themselves, differ by rounding only.
pub(crate) const SAME_SAMPLE: f64 = 1e-9;

/// Where in the window the estimate is wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// At this point of the window.
    Tau(Tau),
    /// This long, in the unit of `delta`, before the newest sample.
    Delay(f64),
    /// At this position, in samples from the oldest, with the degree as it is even where a root would gain one.
    Position(f64),
}

/// What the user asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Design {
    /// Number of samples in the window.
    pub window_length: usize,
    /// Order of the derivative.
    pub deriv: usize,
    /// Degree of the local polynomial.
    pub degree: usize,
    /// Exponent of the weight at the oldest end.
    pub kappa: f64,
    /// Exponent of the weight at the newest end.
    pub mu: f64,
    /// Where the estimate is wanted.
    pub place: Place,
    /// Sampling step.
    pub delta: f64,
    /// How the kernel becomes weights.
    pub rule: Rule,
    /// Samples at either end of the window that together hold at most this share of the sum of the weights' sizes are
    /// left out.
    pub trim: f64,
}

impl Design {
    pub(crate) fn check(&self) -> Result<(), Error> {
        let Self { window_length, degree, delta, rule, trim, .. } = *self;
        if window_length > MAX_WINDOW {
            return Err(Error::argument("window_length", window_length, format!("at most {MAX_WINDOW}")));
        }
        rule.check(window_length, degree)?;
        if !(delta.is_finite() && delta > 0.0) {
            return Err(Error::argument("delta", delta, "finite and positive"));
        }
        if !(window_length as f64 * delta).is_finite() {
            return Err(Error::argument("delta", delta, "such that a window does not last longer than any number"));
        }
        if !(0.0..0.5).contains(&trim) {
            return Err(Error::argument("trim", trim, "at least 0 and less than 1/2"));
        }
        Ok(())
    }

    /// The continuous kernel; its `tau` is resolved for this window.
    pub(crate) fn kernel(&self) -> Result<Kernel, Error> {
        let (grid, length) = (self.rule.grid(), self.window_length);
        let newest = (length - 1) as f64;
        let new = |tau| Kernel::new(self.deriv, self.degree, self.kappa, self.mu, tau, grid.tau(newest, length));
        match self.place {
            Place::Tau(tau) => new(tau),
            Place::Delay(delay) => {
                let samples = delay / self.delta;
                if !samples.is_finite() {
                    return Err(Error::argument("delay", delay, "finite"));
                }
                let whole = samples.round();
                let samples = if same_sample(samples, whole) { whole } else { samples };
                let tau = grid.tau(newest - samples, length);
                if tau.abs() > MAX_TAU {
                    return Err(Error::argument("delay", delay, format!("at most {MAX_TAU:e} windows long")));
                }
                new(Tau::At(tau))
            }
            Place::Position(position) => new(Tau::At(grid.tau(position, length))).map(Kernel::without_root),
        }
    }

    pub(crate) fn unit(&self) -> Result<f64, Error> {
        let exponent = i32::try_from(self.deriv).unwrap_or(i32::MAX);
        let unit = (self.rule.grid().steps(self.window_length) * self.delta).powi(exponent).recip();
        if unit.is_finite() && unit > 0.0 {
            return Ok(unit);
        }
        Err(Error::argument(
            "delta",
            self.delta,
            format!("such that delta**{} does not overflow or underflow", self.deriv),
        ))
    }

    pub(crate) fn fit(&self, degree: usize, kept: Range<usize>, control: &impl Control) -> Result<Fit, Error> {
        let family = Jacobi { alpha: self.kappa, beta: self.mu };
        match self.rule {
            Rule::Exact => Fit::least_squares(family, degree, self.window_length, kept, control),
            rule => Fit::quadrature(rule, family, degree, self.window_length, kept, control),
        }
    }

    pub(crate) fn position(&self, tau: f64, kept: &Range<usize>) -> f64 {
        self.rule.grid().position(tau, self.window_length) - kept.start as f64
    }

    pub(crate) fn tau(&self, position: f64, kept: &Range<usize>) -> f64 {
        self.rule.grid().tau(position + kept.start as f64, self.window_length)
    }

    pub(crate) fn keeps_constants(&self) -> bool {
        self.rule.keeps_constants() && (self.rule == Rule::Exact || self.trim == 0.0)
    }

    /// Weights that sum to zero run on first differences, and those that sum to one on differences to the sample nearest to
    /// the estimate; rules that leak offsets must go on leaking them. Sums of weights may overflow where no weight does.
    pub(crate) fn taps(&self, weights: &[f64], position: f64) -> Result<Taps, Error> {
        let taps = if !self.keeps_constants() || (self.deriv == 0 && weights.len() == 1) {
            Taps::plain(weights)?
        } else {
            let nearest = position.round().clamp(0.0, (weights.len() - 1) as f64) as usize;
            Taps::on_differences(weights, (self.deriv == 0).then_some(nearest))?
        };
        if weights.iter().all(|w| w.is_finite()) && taps.are_finite() {
            return Ok(taps);
        }
        Err(Error::argument("delta", self.delta, "large enough for weights that are finite, and their sums"))
    }
}

/// Whether two positions in samples are the same but for rounding.
pub(crate) fn same_sample(position: f64, sample: f64) -> bool {
    (position - sample).abs() <= SAME_SAMPLE * position.abs().max(1.0)
}
