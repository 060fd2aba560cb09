//! Products of real sequences through complex transforms of half as many points.
//!
//! Two sequences of N = 2M real numbers, seen as polynomials in X, are multiplied modulo `X^N + 1`: as in a cyclic product,
//! only that what wraps around comes back negated. Over the complex numbers `X^M - i` divides `X^N + 1`, and modulo it
//! the real polynomial `a + b X^M` is `a + i b`, from which both are read off again. With `X = zeta Y`, `zeta^M = i`, the
//! modulus becomes `Y^M - 1`, whose products are those of the plain transform of M points. So a real block costs one
//! complex transform of half its length and one multiplication with the powers of `zeta` on either side, and no
//! separation of the spectrum into even and odd parts.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::f64::consts::FRAC_PI_2;
use std::fmt;

use algdiff_fft::Transforms;
use nalgebra::Complex;

use super::Sample;
use crate::error::{Error, try_vec};

/// Products modulo `X^N + 1`.
pub(super) struct Negacyclic<T> {
    /// Powers of `zeta`, one for every point of the complex transform.
    twist: Vec<Complex<T>>,
    transforms: Transforms<T>,
}

impl<T> fmt::Debug for Negacyclic<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Negacyclic").field("half", &self.twist.len()).finish_non_exhaustive()
    }
}

impl<T: Sample> Negacyclic<T> {
    /// For sequences of `2 * half` numbers.
    pub(super) fn new(half: usize) -> Result<Self, Error> {
        let mut twist = try_vec(half, Complex::new(T::default(), T::default()))?;
        for (k, power) in twist.iter_mut().enumerate() {
            let (sine, cosine) = (FRAC_PI_2 * k as f64 / half as f64).sin_cos();
            *power = Complex::new(T::from_f64(cosine), T::from_f64(sine));
        }
        Ok(Self { twist, transforms: T::transforms(half) })
    }

    /// Points of the complex transform: half as many as there are numbers.
    pub(super) fn half(&self) -> usize {
        self.twist.len()
    }

    /// Numbers of working memory.
    pub(super) fn work(&self) -> usize {
        self.transforms.work()
    }

    /// The spectrum of `factor` times the values that are not larger than `peak`, with 0 for the others.
    #[inline(always)]
    pub(super) fn forward(
        &self,
        values: &[T],
        (peak, factor): (T, T),
        spectrum: &mut [Complex<T>],
        work: &mut [Complex<T>],
    ) {
        let zero = T::default();
        let kept = |value: T| if value <= peak && zero - peak <= value { value * factor } else { zero };
        let (low, high) = values.split_at(self.half());
        for (((point, &low), &high), &power) in spectrum.iter_mut().zip(low).zip(high).zip(&self.twist) {
            *point = times(Complex::new(kept(low), kept(high)), power);
        }
        self.transforms.forward(spectrum, work);
    }

    /// The values of a product of spectra, times the number of points and both `factors`: the first half of them into `low`,
    /// as many of the others as it holds into `high`.
    #[inline(always)]
    pub(super) fn inverse(
        &self,
        spectrum: &mut [Complex<T>],
        work: &mut [Complex<T>],
        factors: (T, T),
        low: &mut [T],
        high: &mut [T],
    ) {
        self.transforms.inverse(spectrum, work);
        let scaled = |value: T| value * factors.0 * factors.1;
        let real = |point: Complex<T>, power: Complex<T>| scaled(point.re * power.re + point.im * power.im);
        let imaginary = |point: Complex<T>, power: Complex<T>| scaled(point.im * power.re - point.re * power.im);
        let (low, rest) = low.split_at_mut(high.len());
        for (((&point, &power), low), high) in spectrum.iter().zip(&self.twist).zip(low).zip(&mut *high) {
            (*low, *high) = (real(point, power), imaginary(point, power));
        }
        for ((&point, &power), low) in spectrum.iter().zip(&self.twist).skip(high.len()).zip(rest) {
            *low = real(point, power);
        }
    }
}

/// `to[k] = a[k] * b[k]`.
#[inline(always)]
pub(super) fn multiply<T: Sample>(a: &[Complex<T>], b: &[Complex<T>], to: &mut [Complex<T>]) {
    for ((to, &a), &b) in to.iter_mut().zip(a).zip(b) {
        *to = times(a, b);
    }
}

#[inline(always)]
fn times<T: Sample>(a: Complex<T>, b: Complex<T>) -> Complex<T> {
    Complex::new(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re)
}
