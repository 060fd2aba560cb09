//! Everything decided before the first sample: the weights of a window, and how they will meet the data.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::control::Control;
use crate::engine::Taps;
use crate::error::Error;
use crate::fit::{Fit, Grid};
use crate::jacobi::Jacobi;
use crate::kernel::{Kernel, MAX_TAU, Tau};

/// Windows beyond this are refused: their weights alone would take 80 MB, and a mistyped size should not run for minutes.
pub const MAX_WINDOW: usize = 10_000_000;

/// Positions in samples that differ by less, relative to themselves, differ by rounding only.
const SAME_SAMPLE: f64 = 1e-9;

/// How the continuous kernel becomes weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Rule {
    /// Discrete weighted least squares on cells: every polynomial up to the exactness degree, at every window length.
    Exact,
    /// The trapezoidal rule on nodes, as in the source: leaks offsets, kept for reproduction.
    Trapezoid,
}

impl Rule {
    /// Where the samples lie.
    #[must_use]
    pub fn grid(self) -> Grid {
        match self {
            Self::Exact => Grid::Cells,
            Self::Trapezoid => Grid::Nodes,
        }
    }
}

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
}

/// A frozen design: shareable between threads, and never changed.
#[derive(Debug)]
pub struct Plan {
    design: Design,
    kernel: Kernel,
    weights: Vec<f64>,
    fit_degree: usize,
    exactness: Option<usize>,
    unit: f64,
    at_tau: Taps,
    aligned: OnceLock<Taps>,
    fit: OnceLock<Fit>,
    ends_checked: AtomicBool,
}

impl Plan {
    /// Designs the weights.
    pub fn new(design: &Design, control: &impl Control) -> Result<Self, Error> {
        design.check()?;
        let kernel = design.kernel()?;
        let unit = design.unit()?;
        // At a root the fit has one degree more, unless the window holds just degree + 1 samples.
        let fit_degree = match design.rule {
            Rule::Exact => kernel.exactness().min(design.window_length - 1),
            Rule::Trapezoid => design.degree,
        };
        let fit = design.fit(fit_degree, control)?;
        let (mut weights, _) = fit.weights(&kernel.moments(fit_degree), control)?;
        let symmetric = design.kappa == design.mu && kernel.tau() == 0.5;
        if symmetric {
            make_symmetric(&mut weights, design.deriv);
        }
        let exactness = match design.rule {
            // By symmetry the middle gains its degree also where the window is too short for the larger fit.
            Rule::Exact if symmetric => Some(kernel.exactness()),
            Rule::Exact => Some(fit_degree),
            Rule::Trapezoid => measured_exactness(&kernel.moments(fit_degree), &fit, &weights, control)?,
        };
        weights.iter_mut().for_each(|w| *w *= unit);
        if !weights.iter().all(|w| w.is_finite()) {
            return Err(Error::argument("delta", design.delta, "large enough for weights that are finite"));
        }
        let at_tau = design.taps(&weights, design.rule.grid().position(kernel.tau(), design.window_length))?;
        let plan = Self {
            design: *design,
            kernel,
            weights,
            fit_degree,
            exactness,
            unit,
            at_tau,
            aligned: OnceLock::new(),
            fit: OnceLock::new(),
            ends_checked: AtomicBool::new(false),
        };
        if fit_degree == design.degree {
            let _ = plan.fit.set(fit);
        }
        Ok(plan)
    }

    /// The design.
    #[must_use]
    pub fn design(&self) -> &Design {
        &self.design
    }

    /// The continuous kernel that the weights discretise.
    #[must_use]
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// The weights, oldest sample first, in units of `1 / delta^deriv`.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The highest degree up to which the weights differentiate every polynomial to 1e-10; none if they leak a constant.
    #[must_use]
    pub fn exactness(&self) -> Option<usize> {
        self.exactness
    }

    /// The position of the estimate in the window, in samples from the oldest.
    #[must_use]
    pub fn position(&self) -> f64 {
        self.design.rule.grid().position(self.kernel.tau(), self.design.window_length)
    }

    /// Samples from the estimate to the newest sample.
    #[must_use]
    pub fn delay_samples(&self) -> f64 {
        let delay = (self.design.window_length - 1) as f64 - self.position();
        let whole = delay.round();
        if same_sample(delay, whole) { whole } else { delay }
    }

    /// The sample of the window on which the outputs of the full-length modes lie: the one nearest to `tau`, the newer one
    /// of two.
    #[must_use]
    pub fn aligned_position(&self) -> isize {
        let position = self.position();
        // Rounding must not decide between two samples that are equally near.
        (position + 0.5 + SAME_SAMPLE * position.abs().max(1.0)).floor() as isize
    }

    /// Taps of the estimate at `tau`.
    #[must_use]
    pub fn taps(&self) -> &Taps {
        &self.at_tau
    }

    /// Taps of the estimate on the sample [`Plan::aligned_position`]: the ones at `tau` if that is a sample.
    pub fn aligned_taps(&self, control: &impl Control) -> Result<&Taps, Error> {
        let sample = self.aligned_position() as f64;
        if same_sample(self.position(), sample) {
            return Ok(&self.at_tau);
        }
        if let Some(taps) = self.aligned.get() {
            return Ok(taps);
        }
        // Next to a root the fit keeps its extra degree, which costs next to no noise there.
        let wider =
            if self.fit_degree > self.design.degree { Some(self.design.fit(self.fit_degree, control)?) } else { None };
        let fit = match &wider {
            Some(fit) => fit,
            None => self.fit(control)?,
        };
        let tau = self.design.rule.grid().tau(sample, self.design.window_length);
        let moments = self.kernel.family().derivatives(self.fit_degree, self.design.deriv, tau);
        let (mut weights, _) = fit.weights(&moments, control)?;
        weights.iter_mut().for_each(|w| *w *= self.unit);
        let taps = self.design.taps(&weights, sample)?;
        Ok(self.aligned.get_or_init(|| taps))
    }

    /// The fit of degree `degree`, by which the ends of the data are estimated: refused if it misses its moments there.
    pub fn fit_for_ends(&self, control: &impl Control) -> Result<&Fit, Error> {
        let fit = self.fit(control)?;
        if self.design.rule == Rule::Exact && !self.ends_checked.load(Ordering::Relaxed) {
            fit.check_ends(self.design.deriv)?;
            self.ends_checked.store(true, Ordering::Relaxed);
        }
        Ok(fit)
    }

    fn fit(&self, control: &impl Control) -> Result<&Fit, Error> {
        if let Some(fit) = self.fit.get() {
            return Ok(fit);
        }
        let fit = self.design.fit(self.design.degree, control)?;
        Ok(self.fit.get_or_init(|| fit))
    }

    /// `1 / T^deriv`: from derivatives on [0, 1] to derivatives in time.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.unit
    }
}

impl Design {
    fn check(&self) -> Result<(), Error> {
        let Self { window_length, degree, delta, rule, .. } = *self;
        if window_length > MAX_WINDOW {
            return Err(Error::argument("window_length", window_length, format!("at most {MAX_WINDOW}")));
        }
        let least = match rule {
            Rule::Exact => degree.saturating_add(1),
            Rule::Trapezoid => degree.saturating_add(1).max(2),
        };
        if window_length < least {
            return Err(Error::argument("window_length", window_length, format!("at least degree + 1 = {least}")));
        }
        if !(delta.is_finite() && delta > 0.0) {
            return Err(Error::argument("delta", delta, "finite and positive"));
        }
        Ok(())
    }

    /// The continuous kernel; its `tau` is resolved for this window.
    fn kernel(&self) -> Result<Kernel, Error> {
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

    fn unit(&self) -> Result<f64, Error> {
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

    fn fit(&self, degree: usize, control: &impl Control) -> Result<Fit, Error> {
        let family = Jacobi { alpha: self.kappa, beta: self.mu };
        match self.rule {
            Rule::Exact => Fit::least_squares(family, degree, self.window_length, control),
            Rule::Trapezoid => Fit::trapezoid(family, degree, self.window_length),
        }
    }

    /// Weights that sum to zero run on first differences, and those that sum to one on differences to the sample nearest to
    /// the estimate; the trapezoidal rule leaks offsets and must go on leaking them.
    fn taps(&self, weights: &[f64], position: f64) -> Result<Taps, Error> {
        match (self.rule, self.deriv) {
            (Rule::Trapezoid, _) => Taps::plain(weights),
            (Rule::Exact, 0) if self.window_length == 1 => Taps::plain(weights),
            (Rule::Exact, 0) => {
                let anchor = position.round().clamp(0.0, (self.window_length - 1) as f64);
                Taps::on_differences(weights, Some((anchor as isize).cast_unsigned()))
            }
            (Rule::Exact, _) => Taps::on_differences(weights, None),
        }
    }
}

/// Whether two positions in samples are the same but for rounding.
fn same_sample(position: f64, sample: f64) -> bool {
    (position - sample).abs() <= SAME_SAMPLE * position.abs().max(1.0)
}

/// Equal exponents and an estimate in the middle: weights symmetric for even and antisymmetric for odd `deriv`, to the bit.
fn make_symmetric(weights: &mut [f64], deriv: usize) {
    let sign = if deriv.is_multiple_of(2) { 1.0 } else { -1.0 };
    let half = weights.len().div_ceil(2);
    let last = weights.len() - 1;
    for j in 0..half {
        let mean = 0.5 * (weights[j] + sign * weights[last - j]);
        weights[last - j] = sign * mean;
        weights[j] = mean;
    }
}

/// The degree up to which the moments are met to 1e-10 of the largest.
fn measured_exactness(
    moments: &[f64],
    fit: &Fit,
    weights: &[f64],
    control: &impl Control,
) -> Result<Option<usize>, Error> {
    let scale = moments.iter().fold(0.0, |peak: f64, d| peak.max(d.abs()));
    let missing = fit.missing_moments(moments, weights, control)?;
    Ok(missing.iter().take_while(|r| r.abs() <= 1e-10 * scale).count().checked_sub(1))
}
