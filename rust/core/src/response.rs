//! The frequency response of a continuous kernel: `H(w) = integral of k(s) exp(i w (s - r))` for T = 1 and the phase
//! reference `r`; `H = (i w)^deriv G` with the low-pass `G`, the mean of `exp(i w (s - r))` under the density of order
//! `deriv`.
//!
//! Near the pass band the integral for G keeps its digits relative to `w^deriv`. Far in the stop band, where H is much
//! smaller than its integrand, the path of integration is bent upwards from both ends of the window, along which
//! `exp(i w s)` decays: what is left are two Laplace integrals, each of the size of its end's own contribution.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use nalgebra::Complex;

use crate::control::Control;
use crate::error::Error;
use crate::jacobi::{Recurrence, ln_beta};
use crate::kernel::Kernel;
use crate::quadrature::{laplace_nodes, nodes};

/// How many steps of [`Kernel::half_power`] are tried: beyond, exponents near -1 have not yet damped anything.
const MAX_STEPS: f64 = 5e4;

/// Evaluates the frequency response of one kernel.
#[derive(Debug)]
pub struct Response {
    deriv: i32,
    points: Vec<f64>,
    /// Masses of G and of H at the points.
    low: Vec<f64>,
    high: Vec<f64>,
    /// Sums of the sizes of the masses: rounding errors are in proportion to them.
    low_size: f64,
    high_size: f64,
    ends: Ends,
    /// From here on the two ends are the better way.
    switch: f64,
}

impl Response {
    /// Prepares frequencies up to `largest` in size.
    #[must_use]
    pub fn new(kernel: &Kernel, largest: f64) -> Self {
        let still = Self::on_nodes(kernel, 0.0, Ends::new(kernel));
        let mut switch = still.ends.least;
        while switch < largest && still.ends.at(switch, 0.0).1 > still.size(switch) {
            switch *= 1.25;
        }
        Self { switch, ..Self::on_nodes(kernel, largest.min(switch), still.ends) }
    }

    fn on_nodes(kernel: &Kernel, largest: f64, ends: Ends) -> Self {
        let (deriv, degree) = (kernel.deriv(), kernel.degree());
        let (family, raised) = (kernel.family(), kernel.family().raised(deriv));
        let (whole, rest) = (family.recurrence(degree), raised.recurrence(degree - deriv));
        let (moments, projection) = (kernel.moments(degree), rest.values(kernel.tau()));
        let rule = nodes(family, degree, largest);
        let low: Vec<f64> = rule.iter().map(|node| node.mass(raised) * rest.sum(&projection, node.s)).collect();
        let high: Vec<f64> = rule.iter().map(|node| node.mass(family) * whole.sum(&moments, node.s)).collect();
        let size = |masses: &[f64]| masses.iter().map(|mass| mass.abs()).sum();
        Self {
            deriv: deriv as i32,
            points: rule.iter().map(|node| node.s).collect(),
            low_size: size(&low),
            high_size: size(&high),
            low,
            high,
            ends,
            switch: f64::INFINITY,
        }
    }

    /// The sum of the sizes of the terms of the better integral over the window.
    fn size(&self, omega: f64) -> f64 {
        self.high_size.min(self.low_size * omega.powi(self.deriv))
    }

    /// `H` at `omega` with the phase reference `reference`.
    #[must_use]
    pub fn at(&self, omega: f64, reference: f64) -> Complex<f64> {
        let size = omega.abs();
        let value = if size >= self.switch {
            self.ends.at(size, reference).0
        } else {
            let power = size.powi(self.deriv);
            if power * self.low_size <= self.high_size {
                self.low_pass(size, reference) * turn(0.25 * f64::from(self.deriv)) * power
            } else {
                transform(&self.points, &self.high, size, reference)
            }
        };
        if omega < 0.0 { value.conj() } else { value }
    }

    fn low_pass(&self, omega: f64, reference: f64) -> Complex<f64> {
        transform(&self.points, &self.low, omega, reference)
    }

    /// `|G|` at a positive frequency.
    fn gain(&self, omega: f64) -> f64 {
        if omega >= self.switch {
            self.ends.at(omega, 0.5).0.norm() / omega.powi(self.deriv)
        } else {
            self.low_pass(omega, 0.5).norm()
        }
    }
}

fn transform(points: &[f64], masses: &[f64], omega: f64, reference: f64) -> Complex<f64> {
    points.iter().zip(masses).map(|(s, mass)| Complex::from_polar(1.0, omega * (s - reference)) * *mass).sum()
}

/// `exp(2 pi i turns)`, exact for quarters.
fn turn(turns: f64) -> Complex<f64> {
    let quarters = (4.0 * turns).rem_euclid(4.0);
    let whole = quarters.round();
    let (sin, cos) = (0.5 * PI * (quarters - whole)).sin_cos();
    match whole as i64 % 4 {
        0 => Complex::new(cos, sin),
        1 => Complex::new(-sin, cos),
        2 => Complex::new(-cos, -sin),
        _ => Complex::new(sin, -cos),
    }
}

/// The contributions of the two ends of the window.
#[derive(Debug)]
struct Ends {
    exponents: (f64, f64),
    ln_beta: f64,
    recurrence: Recurrence,
    moments: Vec<f64>,
    oldest: Vec<(f64, f64)>,
    newest: Vec<(f64, f64)>,
    least: f64,
}

impl Ends {
    fn new(kernel: &Kernel) -> Self {
        let (kappa, mu) = kernel.exponents();
        let degree = kernel.degree();
        // Below, the density of the other end and the polynomial turn too fast along the bent path.
        let least = 30.0 + kappa.abs() + mu.abs() + 2.0 * degree as f64;
        let rate = |own: f64, other: f64| (other.abs() + degree as f64) * (own.abs() + 20.0) / least;
        Self {
            exponents: (kappa, mu),
            ln_beta: ln_beta(kappa + 1.0, mu + 1.0),
            recurrence: kernel.family().recurrence(degree),
            moments: kernel.moments(degree),
            oldest: laplace_nodes(kappa, rate(kappa, mu)),
            newest: laplace_nodes(mu, rate(mu, kappa)),
            least,
        }
    }

    /// `H` at a positive frequency, and the sum of the sizes of its terms.
    ///
    /// With `s = i x / w` and `s = 1 + i x / w`, H is
    /// `(i / w)^(kappa + 1) / B * integral of x^kappa e^-x (1 - i x / w)^mu S(i x / w)` less
    /// `e^(i w) i (-i)^mu / w^(mu + 1) / B * integral of x^mu e^-x (1 + i x / w)^kappa S(1 + i x / w)`.
    fn at(&self, omega: f64, reference: f64) -> (Complex<f64>, f64) {
        let (kappa, mu) = self.exponents;
        let (start, size) = self.end(&self.oldest, kappa, mu, 0.0, omega);
        let (end, other) = self.end(&self.newest, mu, kappa, 1.0, omega);
        let start = start * turn(0.25 * (kappa + 1.0)) * Complex::from_polar(1.0, -omega * reference);
        let end = end * turn(0.25 * (1.0 - mu)) * Complex::from_polar(1.0, omega * (1.0 - reference));
        (start - end, size + other)
    }

    fn end(&self, rule: &[(f64, f64)], own: f64, other: f64, place: f64, omega: f64) -> (Complex<f64>, f64) {
        let scale = (libm::lgamma(own + 1.0) - self.ln_beta - (own + 1.0) * omega.ln()).exp();
        let sign = 2.0 * place - 1.0;
        let (mut sum, mut size) = (Complex::new(0.0, 0.0), 0.0);
        for &(x, weight) in rule {
            let t = x / omega;
            let density = Complex::from_polar((0.5 * other * (t * t).ln_1p()).exp(), sign * other * t.atan());
            let term = density * self.recurrence.sum_complex(&self.moments, Complex::new(place, t)) * weight;
            sum += term;
            size += term.norm();
        }
        (sum * scale, size * scale)
    }
}

impl Kernel {
    /// `H` at every `omega`, with the phase reference `reference`, into `out`.
    pub fn frequency_response(
        &self,
        omega: &[f64],
        reference: f64,
        out: &mut [Complex<f64>],
        control: &impl Control,
    ) -> Result<(), Error> {
        if !reference.is_finite() {
            return Err(Error::argument("reference", reference, "finite"));
        }
        if let Some(wrong) = omega.iter().find(|omega| !omega.is_finite()) {
            return Err(Error::argument("omega_T", wrong, "finite"));
        }
        let response = Response::new(self, omega.iter().fold(0.0, |peak, omega| omega.abs().max(peak)));
        for (index, (value, &omega)) in out.iter_mut().zip(omega).enumerate() {
            if index % 64 == 63 {
                control.check(0.0)?;
            }
            *value = response.at(omega, reference);
        }
        Ok(())
    }

    /// `ln A0` and `ln A1` of the bound `|G| <= A0 / w^(a+1) + A1 / w^(b+1)` that the ends of the window set at high
    /// frequencies, a = kappa + deriv and b = mu + deriv: the steps of the raised density times its polynomial. Minus
    /// infinity where the polynomial has a zero at that end.
    #[must_use]
    pub fn ln_asymptotes(&self) -> (f64, f64) {
        let family = self.family().raised(self.deriv());
        let recurrence = family.recurrence(self.degree() - self.deriv());
        let projection = recurrence.values(self.tau());
        let ln_constant = |exponent: f64, end: f64| {
            let values = recurrence.values(end);
            let terms = || projection.iter().zip(&values).map(|(p, v)| p * v);
            let (sum, size) = (terms().sum::<f64>().abs(), terms().map(f64::abs).sum::<f64>());
            let ln_sum = if sum > 1e-12 * size { sum.ln() } else { f64::NEG_INFINITY };
            libm::lgamma(exponent + 1.0) + ln_sum - ln_beta(family.alpha + 1.0, family.beta + 1.0)
        };
        (ln_constant(family.alpha, 0.0), ln_constant(family.beta, 1.0))
    }

    /// The power of `1/w` with which `|G|` falls: `min(kappa, mu) + deriv + 1`.
    #[must_use]
    pub fn roll_off(&self) -> f64 {
        let (kappa, mu) = self.exponents();
        kappa.min(mu) + self.deriv() as f64 + 1.0
    }

    /// Kiltz and Rudolph's cutoff: where the asymptote of the end that governs meets 1. None if the kernel has a zero there,
    /// or if the model has no number for it, next to an exponent of -1.
    #[must_use]
    pub fn cutoff(&self) -> Option<f64> {
        let (kappa, mu) = self.exponents();
        let (oldest, newest) = self.ln_asymptotes();
        let ln_constant = match kappa.total_cmp(&mu) {
            std::cmp::Ordering::Less => oldest,
            std::cmp::Ordering::Greater => newest,
            std::cmp::Ordering::Equal => oldest.max(newest),
        };
        Some((ln_constant / self.roll_off()).exp()).filter(|cutoff| cutoff.is_normal())
    }

    /// The omega T of the finest detail of the size of the response: the wider the weight, the finer.
    pub(crate) fn detail(&self) -> f64 {
        let family = self.family().raised(self.deriv());
        let (p, q) = (family.alpha + 1.0, family.beta + 1.0);
        let width = (p * q / (p + q + 1.0)).sqrt() / (p + q);
        (0.02 / width).max(0.2)
    }

    /// The smallest frequency at which `|G|` falls through `1 / sqrt(2)`.
    pub fn half_power(&self, control: &impl Control) -> Result<Option<f64>, Error> {
        let step = self.detail();
        let mut largest = 32.0 * step;
        let mut low = 0.0;
        while low < MAX_STEPS * step {
            let response = Response::new(self, largest);
            while low < largest {
                control.check(0.0)?;
                if response.gain(low + step) < FRAC_1_SQRT_2 {
                    return Ok(Some(bisect(low, low + step, |omega| response.gain(omega) < FRAC_1_SQRT_2)));
                }
                low += step;
            }
            largest *= 2.0;
        }
        Ok(None)
    }
}

/// The point between `low` and `high` from which on `beyond` holds.
pub(crate) fn bisect(mut low: f64, mut high: f64, beyond: impl Fn(f64) -> bool) -> f64 {
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if beyond(middle) { high = middle } else { low = middle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
    use crate::kernel::Tau;

    #[test]
    fn a_mean_has_the_response_of_a_mean() {
        let kernel = Kernel::new(0, 0, 0.0, 0.0, Tau::Center, 1.0).expect("valid");
        for omega in [1e-300_f64, 1e-3, 1.0, 31.0, 33.0, 1e3, 1e6] {
            let expected = (0.5 * omega).sin() / (0.5 * omega);
            let got = Response::new(&kernel, 1e6).at(omega, 0.5);
            // In the stop band either end has the size 1 / omega, and its phase an error of eps times omega.
            assert!((got - expected).norm() < 4e-16 * 8.0, "{omega} {got}");
            assert_eq!(Response::new(&kernel, 1e6).at(-omega, 0.5), got.conj());
        }
        assert!((kernel.half_power(&Unattended).expect("runs").expect("exists") - 2.783_114_756_503_022).abs() < 1e-14);
    }

    #[test]
    fn both_ways_agree_where_they_meet() {
        for (deriv, degree, kappa, mu, tau) in [
            (0, 2, 0.0, 0.0, 0.5),
            (1, 2, 0.5, -0.5, 0.9),
            (2, 4, 1.0, 3.5, 0.3),
            (3, 4, 0.0, 2.0, 1.0),
            (1, 12, 4.0, 4.0, 0.7),
        ] {
            let kernel = Kernel::new(deriv, degree, kappa, mu, Tau::At(tau), 1.0).expect("valid");
            let response = Response::new(&kernel, 1e4);
            let plain = Response::on_nodes(&kernel, 4.0 * response.switch, Ends::new(&kernel));
            for factor in [1.0, 1.7, 4.0] {
                let omega = factor * response.switch;
                let ((bent, size), straight) = (response.ends.at(omega, tau), plain.at(omega, tau));
                let allowed = 1e-14 * (size + plain.size(omega));
                assert!((bent - straight).norm() < allowed, "{deriv} {degree} {omega}: {bent} {straight}");
            }
        }
    }
}
