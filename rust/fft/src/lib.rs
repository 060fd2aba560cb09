//! Complex transforms of single and double precision.
//!
//! `rustfft` is generic, so that the crate which names a type compiles it all. That takes longer than everything else in
//! this project, and is done here once instead of with every change of the core.

use std::fmt;

pub use rustfft::num_complex::Complex;
use rustfft::{FftNum, FftPlanner};

/// A transform in place, and its working memory.
type Transform<T> = Box<dyn Fn(&mut [Complex<T>], &mut [Complex<T>]) + Send + Sync>;

/// The transforms of one length, without a factor.
pub struct Transforms<T> {
    forward: Transform<T>,
    inverse: Transform<T>,
    work: usize,
}

impl Transforms<f64> {
    /// The transforms of so many points.
    #[must_use]
    pub fn double(points: usize) -> Self {
        Self::new(points)
    }
}

impl Transforms<f32> {
    /// The transforms of so many points.
    #[must_use]
    pub fn single(points: usize) -> Self {
        Self::new(points)
    }
}

impl<T: FftNum> Transforms<T> {
    fn new(points: usize) -> Self {
        let mut planner = FftPlanner::new();
        let (forward, inverse) = (planner.plan_fft_forward(points), planner.plan_fft_inverse(points));
        Self {
            work: forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len()),
            forward: Box::new(move |values, work| forward.process_with_scratch(values, work)),
            inverse: Box::new(move |values, work| inverse.process_with_scratch(values, work)),
        }
    }
}

impl<T> Transforms<T> {
    /// Numbers of working memory that a transform needs.
    #[must_use]
    pub fn work(&self) -> usize {
        self.work
    }

    /// `sum over k of values[k] exp(-2 pi i k l / points)`, for every l, in place; `work` is [`Transforms::work`] numbers.
    pub fn forward(&self, values: &mut [Complex<T>], work: &mut [Complex<T>]) {
        (self.forward)(values, work);
    }

    /// The same with `exp(2 pi i k l / points)`: `points` times the inverse.
    pub fn inverse(&self, values: &mut [Complex<T>], work: &mut [Complex<T>]) {
        (self.inverse)(values, work);
    }
}

impl<T> fmt::Debug for Transforms<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Transforms").field("work", &self.work).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::{Complex, Transforms};

    #[test]
    fn transforms_are_the_sums_that_they_say() {
        for points in [1, 2, 12, 64] {
            let transforms = Transforms::double(points);
            let mut work = vec![Complex::new(0.0, 0.0); transforms.work()];
            let values: Vec<_> = (0..points).map(|k| Complex::new((k as f64).cos(), (k * k) as f64)).collect();
            let turn = std::f64::consts::TAU / points as f64;
            let mut there = values.clone();
            transforms.forward(&mut there, &mut work);
            for (l, found) in there.iter().enumerate() {
                let sum: Complex<f64> =
                    values.iter().enumerate().map(|(k, value)| value * Complex::cis(-turn * (k * l) as f64)).sum();
                assert!((found - sum).norm() <= 1e-13 * values.iter().map(|value| value.norm()).sum::<f64>());
            }
            transforms.inverse(&mut there, &mut work);
            for (back, value) in there.iter().zip(&values) {
                assert!((back / points as f64 - value).norm() <= 1e-12 * (1.0 + value.norm()));
            }
        }
    }
}
