//! Everything decided before the first sample: the weights of a window, and how they will meet the data.

#![expect(clippy::indexing_slicing, reason = "pairs are counted from both ends")]

use std::ops::Range;
use std::sync::OnceLock;

use crate::control::Control;
use crate::design::{Design, SAME_SAMPLE, same_sample};
use crate::engine::Taps;
use crate::error::Error;
use crate::fit::Fit;
use crate::fit::ends::{End, EndTables};
use crate::kernel::Kernel;
use crate::rule::Rule;

/// A frozen design: shareable between threads, and never changed.
#[derive(Debug)]
pub struct Plan {
    design: Design,
    kernel: Kernel,
    kept: Range<usize>,
    weights: Vec<f64>,
    fit_degree: usize,
    exactness: Option<usize>,
    unit: f64,
    at_tau: Taps,
    aligned: OnceLock<Taps>,
    fit: OnceLock<Fit>,
    end_tables: OnceLock<Option<EndTables>>,
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
            _ => design.degree,
        };
        let symmetric = design.kappa == design.mu && kernel.tau() == 0.5;
        let moments = kernel.moments(fit_degree);
        let design_on = |kept: Range<usize>| {
            let fit = design.fit(fit_degree, kept, control)?;
            let (mut weights, _) = fit.weights(&moments, control)?;
            if symmetric {
                make_symmetric(&mut weights, design.deriv);
            }
            Ok((fit, weights))
        };
        let mut kept = 0..design.window_length;
        let (mut fit, mut weights) = design_on(kept.clone())?;
        if design.trim > 0.0 {
            kept = trimmed(&weights, design.trim);
            if kept.len() <= fit_degree {
                let allowed = format!("so small that more than {fit_degree} samples are left");
                return Err(Error::argument("trim", design.trim, allowed));
            }
            (fit, weights) = design_on(kept.clone())?;
        }
        if design.deriv == 0
            && design.keeps_constants()
            && let [only] = weights.as_mut_slice()
        {
            // What is estimated from one sample is that sample, to the bit.
            *only = 1.0;
        }
        let exactness = match design.rule {
            // By symmetry the middle gains its degree also where the window is too short for the larger fit.
            Rule::Exact if symmetric => Some(kernel.exactness()),
            Rule::Exact => Some(fit_degree),
            _ => measured_exactness(&kernel, |j| design.tau(j, &kept), &weights),
        };
        weights.iter_mut().for_each(|w| *w *= unit);
        let position = design.position(kernel.tau(), &kept);
        let at_tau = design.taps(&weights, position)?;
        let plan = Self {
            design: *design,
            kernel,
            kept,
            weights,
            fit_degree,
            exactness,
            unit,
            at_tau,
            aligned: OnceLock::new(),
            fit: OnceLock::new(),
            end_tables: OnceLock::new(),
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

    /// The samples of the window that have a weight: all, unless it is trimmed.
    #[must_use]
    pub fn kept(&self) -> Range<usize> {
        self.kept.clone()
    }

    /// Number of weights: the window without what was trimmed.
    #[must_use]
    pub fn span(&self) -> usize {
        self.kept.len()
    }

    /// The position of the estimate, in samples from the oldest that has a weight.
    #[must_use]
    pub fn position(&self) -> f64 {
        self.design.position(self.kernel.tau(), &self.kept)
    }

    /// `tau` at `position`, in samples from the oldest that has a weight.
    #[must_use]
    pub fn tau_at(&self, position: f64) -> f64 {
        self.design.tau(position, &self.kept)
    }

    /// Samples from the estimate to the newest sample.
    #[must_use]
    pub fn delay_samples(&self) -> f64 {
        let delay = (self.span() - 1) as f64 - self.position();
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
            if self.fit_degree > self.design.degree { Some(self.fit_of(self.fit_degree, control)?) } else { None };
        let fit = match &wider {
            Some(fit) => fit,
            None => self.fit(control)?,
        };
        let moments = self.kernel.family().derivatives(self.fit_degree, self.design.deriv, self.tau_at(sample));
        let (mut weights, _) = fit.weights(&moments, control)?;
        weights.iter_mut().for_each(|w| *w *= self.unit);
        let taps = self.design.taps(&weights, sample)?;
        Ok(self.aligned.get_or_init(|| taps))
    }

    /// The fit of degree `degree`, by which the ends of the data are estimated: refused if it misses its moments there.
    pub fn end(&self, control: &impl Control) -> Result<End<'_>, Error> {
        let fit = self.fit(control)?;
        if self.end_tables.get().is_none() {
            if self.design.rule == Rule::Exact {
                fit.check_ends(self.design.deriv)?;
            }
            let _ = self.end_tables.set(fit.end_tables(self.design.deriv)?);
        }
        let tables = self.end_tables.get().and_then(Option::as_ref);
        let (deriv, unit, keeps_constants) = (self.design.deriv, self.unit, self.keeps_constants());
        Ok(End { fit, tables, deriv, unit, keeps_constants })
    }

    fn fit(&self, control: &impl Control) -> Result<&Fit, Error> {
        if let Some(fit) = self.fit.get() {
            return Ok(fit);
        }
        let fit = self.fit_of(self.design.degree, control)?;
        Ok(self.fit.get_or_init(|| fit))
    }

    fn fit_of(&self, degree: usize, control: &impl Control) -> Result<Fit, Error> {
        self.design.fit(degree, self.kept.clone(), control)
    }

    /// Whether constants come out as they should, so that the data may be taken from any origin.
    #[must_use]
    pub fn keeps_constants(&self) -> bool {
        self.design.keeps_constants()
    }

    /// Degree of the fit that the weights come from.
    #[must_use]
    pub fn fit_degree(&self) -> usize {
        self.fit_degree
    }

    /// The window length T in time.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.design.rule.grid().steps(self.design.window_length) * self.design.delta
    }

    /// `1 / T^deriv`: from derivatives on [0, 1] to derivatives in time.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.unit
    }
}

/// The samples that are left when as many as hold `share` of the sum of the weights' sizes are taken from each end.
fn trimmed(weights: &[f64], share: f64) -> Range<usize> {
    let allowed = share * weights.iter().map(|w| w.abs()).sum::<f64>();
    let outer = |sizes: &mut dyn Iterator<Item = &f64>| {
        let mut held = 0.0;
        sizes
            .take_while(|w| {
                held += w.abs();
                held <= allowed
            })
            .count()
    };
    let (oldest, newest) = (outer(&mut weights.iter()), outer(&mut weights.iter().rev()));
    oldest..weights.len() - newest
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

/// The degree, at most the kernel's own, up to which the moments are met to 1e-10 of the largest.
fn measured_exactness(kernel: &Kernel, tau: impl Fn(f64) -> f64, weights: &[f64]) -> Option<usize> {
    let mut missing = kernel.moments(kernel.exactness());
    let scale = missing.iter().fold(0.0, |peak: f64, d| peak.max(d.abs()));
    let recurrence = kernel.family().recurrence(kernel.exactness());
    for (j, weight) in weights.iter().enumerate() {
        missing.iter_mut().zip(recurrence.values(tau(j as f64))).for_each(|(rest, value)| *rest -= weight * value);
    }
    missing.iter().take_while(|rest| rest.abs() <= 1e-10 * scale).count().checked_sub(1)
}
