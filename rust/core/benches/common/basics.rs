//! What all benches share: designs, samples, and estimates against the naive sum.

use std::error::Error as _;
use std::fmt;
use std::sync::Arc;

use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::Sample;
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::rule::Rule;

/// Why a bench cannot go on.
pub enum Failure {
    /// This build has none of this name.
    Unknown(String),
    /// The engine or the design was refused.
    Refused(Error),
    /// An estimate is not the naive sum.
    Wrong(String),
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(what) => write!(f, "this build has no {what}"),
            Self::Refused(error) => write!(f, "{error} {:?}", error.source()),
            Self::Wrong(what) => f.write_str(what),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

pub fn plan(window_length: usize, deriv: usize, tau: Tau) -> Result<Arc<Plan>, Error> {
    let (degree, kappa, mu, delta, rule, trim) = (3, 0.0, 0.0, 1.0, Rule::Exact, 0.0);
    let design = Design { window_length, deriv, degree, kappa, mu, place: Place::Tau(tau), delta, rule, trim };
    Plan::new(&design, &Unattended).map(Arc::new)
}

/// Seeded samples between -1 and 1: a linear congruential generator.
pub fn noise<T: Sample>(length: usize) -> Vec<T> {
    let mut state = 12_345_u64;
    let step = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        T::from_f64((state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
    };
    (0..length).map(step).collect()
}

/// An estimate from the samples of `x` against the naive sum. Samples and differences are at most 2; a sum of L terms errs by
/// L eps times the sum of their sizes, and the engine by `more` eps times that.
pub fn compare<T: Sample>(plan: &Plan, x: &[T], value: T, more: f64, what: fmt::Arguments<'_>) -> Result<(), Failure> {
    let weights = plan.weights();
    let eps = if size_of::<T>() == 8 { f64::EPSILON } else { f64::from(f32::EPSILON) };
    let (mut sum, mut cumulative) = (0.0_f64, 0.0);
    for weight in weights {
        sum += weight;
        cumulative += sum.abs().min((sum - 1.0).abs()) + weight.abs();
    }
    let bound = (weights.len() as f64 + more) * eps * 2.0 * cumulative + 4.0 * eps;
    let naive: f64 = weights.iter().zip(x).map(|(weight, sample)| weight * sample.to_f64()).sum();
    let off = (naive - value.to_f64()).abs();
    if off > bound || off.is_nan() {
        return Err(Failure::Wrong(format!("window {}, {what}: off by {off:e}", weights.len())));
    }
    Ok(())
}
