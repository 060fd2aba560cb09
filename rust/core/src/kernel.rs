//! The continuous estimator: `x^(deriv)(t0 + T tau) ~ T^-deriv * integral over [0, 1] of k(s) x(t0 + T s) ds`.
//!
//! `k(s) = rho(s) * sum over m of [d^deriv p_m](tau) p_m(s)`, with `p_m` orthonormal for the density `rho` of the exponents
//! (kappa, mu): the `deriv`-th derivative at `tau` of the weighted least-squares polynomial of degree `degree`.

use crate::control::Control;
use crate::error::Error;
use crate::jacobi::{Jacobi, Recurrence, ln_beta};

/// Degrees beyond this are refused: no window that fits in memory gives them a use, and a design would take seconds.
pub const MAX_DEGREE: usize = 500;

/// Points further from the window than this are refused: no digit of such an extrapolation would be left.
pub const MAX_TAU: f64 = 1e6;

/// Exponents beyond this are refused: the weight would be a single sample's.
pub const MAX_EXPONENT: f64 = 1e4;

/// Where in the window the derivative is estimated: 0 is the oldest, 1 the newest end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tau {
    /// The middle, 1/2.
    Center,
    /// The root of the orthogonal polynomial that is nearest to the newest sample: one more degree is reproduced there.
    Root,
    /// The newest sample: no delay.
    Newest,
    /// This point; within 1e-12 of a root it counts as the root.
    At(f64),
}

/// A continuous kernel on [0, 1], for windows of length T = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    deriv: usize,
    degree: usize,
    kappa: f64,
    mu: f64,
    tau: f64,
    at_root: bool,
}

impl Kernel {
    /// A kernel; `newest` is where [`Tau::Newest`] lies: 1 for a continuous window, half a sample less on a grid of cells.
    pub fn new(deriv: usize, degree: usize, kappa: f64, mu: f64, tau: Tau, newest: f64) -> Result<Self, Error> {
        if degree > MAX_DEGREE {
            return Err(Error::argument("degree", degree, format!("at most {MAX_DEGREE}")));
        }
        if degree < deriv {
            return Err(Error::argument("degree", degree, format!("at least deriv = {deriv}")));
        }
        for (name, value) in [("kappa", kappa), ("mu", mu)] {
            if !(value > -1.0 && value <= MAX_EXPONENT) {
                let allowed = format!("finite and greater than -1, and at most {MAX_EXPONENT:e}");
                return Err(Error::argument(name, value, allowed));
            }
        }
        let family = Jacobi { alpha: kappa, beta: mu }.raised(deriv);
        let order = degree - deriv + 1;
        let wanted = match tau {
            Tau::Center => 0.5,
            Tau::Newest => newest,
            Tau::Root => family.roots(order).last().copied().unwrap_or(0.5),
            Tau::At(point) if point.abs() <= MAX_TAU => point,
            Tau::At(point) => {
                let allowed = format!("finite and at most {MAX_TAU:e} in size, or 'center', 'root' or 'newest'");
                return Err(Error::argument("tau", point, allowed));
            }
        };
        let root = family.root_near(order, wanted);
        // Within its own rounding the point stays as it was said: the middle is 1/2 to the bit.
        let tau = root.filter(|root| (root - wanted).abs() > f64::EPSILON).unwrap_or(wanted);
        let kernel = Self { deriv, degree, kappa, mu, tau, at_root: root.is_some() };
        if kernel.moments(degree).iter().all(|d| (d * d).is_finite()) {
            return Ok(kernel);
        }
        Err(Error::argument("deriv", deriv, format!("small enough for values that are finite at degree {degree}")))
    }

    /// The same kernel, taken for a fit of its degree even at a root.
    #[must_use]
    pub fn without_root(self) -> Self {
        Self { at_root: false, ..self }
    }

    /// Order of the derivative.
    #[must_use]
    pub fn deriv(&self) -> usize {
        self.deriv
    }

    /// Degree of the local polynomial.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Exponents at the oldest and at the newest end.
    #[must_use]
    pub fn exponents(&self) -> (f64, f64) {
        (self.kappa, self.mu)
    }

    /// The point of estimation.
    #[must_use]
    pub fn tau(&self) -> f64 {
        self.tau
    }

    /// Polynomials up to this degree are differentiated exactly: `degree`, and one more at a root.
    #[must_use]
    pub fn exactness(&self) -> usize {
        self.degree + usize::from(self.at_root)
    }

    /// The family of the weight itself.
    #[must_use]
    pub fn family(&self) -> Jacobi {
        Jacobi { alpha: self.kappa, beta: self.mu }
    }

    /// The points at which one more degree is reproduced, ascending: `degree - deriv + 1` of them.
    #[must_use]
    pub fn roots(&self) -> Vec<f64> {
        self.family().raised(self.deriv).roots(self.degree - self.deriv + 1)
    }

    /// `d^deriv p_m / d tau^deriv` at the point of estimation, for `m` up to `fit_degree`: the moments that the kernel must have.
    #[must_use]
    pub fn moments(&self, fit_degree: usize) -> Vec<f64> {
        self.family().derivatives(fit_degree, self.deriv, self.tau)
    }

    /// The kernel of one order less and with both exponents raised by one, of which minus this one is the derivative.
    ///
    /// Only for `deriv >= 1`.
    #[must_use]
    pub(crate) fn integrated(&self) -> Self {
        let (kappa, mu) = (self.kappa + 1.0, self.mu + 1.0);
        Self { deriv: self.deriv - 1, degree: self.degree - 1, kappa, mu, ..*self }
    }

    /// `k` at one point.
    #[must_use]
    pub(crate) fn value(&self, tau: f64) -> f64 {
        self.value_with(&self.family().recurrence(self.degree), &self.moments(self.degree), tau)
    }

    fn value_with(&self, recurrence: &Recurrence, moments: &[f64], tau: f64) -> f64 {
        let sum = recurrence.sum(moments, tau);
        match tau {
            tau if tau.is_nan() => tau,
            // A zero of the polynomial outweighs a density that is infinite there.
            tau if !(0.0..=1.0).contains(&tau) || sum == 0.0 => 0.0,
            tau => self.family().ln_density(tau, 1.0 - tau).exp() * sum,
        }
    }

    /// `k` at `points`, into `out`; zero outside of [0, 1], infinite at an end with a negative exponent.
    pub fn values(&self, points: &[f64], out: &mut [f64], control: &impl Control) -> Result<(), Error> {
        if points.len() != out.len() {
            return Err(Error::argument("out", out.len(), format!("of {} elements", points.len())));
        }
        let (recurrence, moments) = (self.family().recurrence(self.degree), self.moments(self.degree));
        for (index, (value, &tau)) in out.iter_mut().zip(points).enumerate() {
            if index % 4096 == 4095 {
                control.check(index as f64 / points.len() as f64)?;
            }
            *value = self.value_with(&recurrence, &moments, tau);
        }
        Ok(())
    }

    /// `p` and `C` of the leading error `C T^p x^(deriv + p)` on a noise-free signal: `C = -pi_p(tau) / p!` with the monic
    /// orthogonal polynomial `pi_p` of the family raised by `deriv`.
    #[must_use]
    pub fn bias(&self) -> (usize, f64) {
        let order = self.exactness() + 1 - self.deriv;
        let recurrence = self.family().raised(self.deriv).recurrence(order);
        let value = recurrence.values(self.tau).last().copied().unwrap_or(1.0);
        let monic_over_factorial: f64 =
            recurrence.off_diagonal().iter().enumerate().map(|(k, b)| b / (k + 1) as f64).product();
        (order, -value * monic_over_factorial)
    }

    /// The integral of `k^2`: white noise of variance `s^2` sampled every `delta` gives the variance
    /// `s^2 delta norm2 / T^(2 deriv + 1)`. Infinite when an exponent is -1/2 or less.
    #[must_use]
    pub fn norm2(&self) -> f64 {
        let (kappa, mu) = self.exponents();
        if kappa <= -0.5 || mu <= -0.5 {
            return f64::INFINITY;
        }
        let square = Jacobi { alpha: 2.0 * kappa, beta: 2.0 * mu };
        let (recurrence, moments) = (self.family().recurrence(self.degree), self.moments(self.degree));
        let integral: f64 =
            square.gauss(self.degree + 1).iter().map(|&(tau, w)| w * recurrence.sum(&moments, tau).powi(2)).sum();
        integral * (ln_beta(2.0 * kappa + 1.0, 2.0 * mu + 1.0) - 2.0 * ln_beta(kappa + 1.0, mu + 1.0)).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;

    fn kernel(deriv: usize, degree: usize, kappa: f64, mu: f64, tau: Tau) -> Kernel {
        Kernel::new(deriv, degree, kappa, mu, tau, 1.0).expect("valid")
    }

    #[test]
    fn closed_forms() {
        // Known kernels for T = 1, ascending powers of tau.
        type Case = (usize, usize, f64, f64, f64, &'static [f64]);
        let cases: [Case; 5] = [
            (1, 1, 0.0, 0.0, 0.0, &[-6.0, 12.0]),
            (1, 2, 0.0, 0.0, 0.0, &[-36.0, 192.0, -180.0]),
            (2, 2, 0.0, 0.0, 0.5, &[60.0, -360.0, 360.0]),
            (1, 2, 1.0, 0.0, 0.0, &[0.0, -240.0, 900.0, -720.0]),
            (0, 1, 0.0, 0.0, 0.0, &[4.0, -6.0]),
        ];
        let points = [0.0, 0.1, 0.5, 0.9, 1.0];
        for (deriv, degree, kappa, mu, tau, coefficients) in cases {
            let mut values = [0.0; 5];
            kernel(deriv, degree, kappa, mu, Tau::At(tau))
                .values(&points, &mut values, &Unattended)
                .expect("same length");
            for (value, point) in values.iter().zip(points) {
                let expected = coefficients.iter().rev().fold(0.0, |sum, c| sum * point + c);
                assert!((value - expected).abs() < 1e-12, "{deriv} {degree}: {value} {expected}");
            }
        }
    }

    #[test]
    fn known_gains() {
        for (kernel, expected) in [
            (kernel(1, 1, 0.0, 0.0, Tau::Center), 12.0),
            (kernel(1, 2, 0.0, 0.0, Tau::Newest), 192.0),
            (kernel(1, 2, 0.0, 0.0, Tau::Root), 48.0),
            (kernel(1, 3, 0.0, 0.0, Tau::Center), 75.0),
        ] {
            assert!((kernel.norm2() / expected - 1.0).abs() < 1e-13);
        }
        assert_eq!(kernel(1, 1, -0.5, 0.0, Tau::Center).norm2(), f64::INFINITY);
    }

    #[test]
    fn a_root_gains_one_degree() {
        let root = kernel(1, 2, 0.0, 0.0, Tau::Root);
        assert!((root.tau() - (5.0 + 5.0_f64.sqrt()) / 10.0).abs() < 2e-16);
        assert_eq!((root.exactness(), root.bias().0), (3, 3));
        assert_eq!(kernel(1, 2, 0.0, 0.0, Tau::At(root.tau() + 5e-13)).tau(), root.tau());
        assert_eq!(kernel(1, 2, 0.0, 0.0, Tau::At(root.tau() + 5e-12)).exactness(), 2);
    }

    #[test]
    fn refusals_name_the_argument() {
        let message = |result: Result<Kernel, Error>| result.expect_err("refused").to_string();
        assert!(
            message(Kernel::new(2, 1, 0.0, 0.0, Tau::Center, 1.0)).starts_with("degree must be at least deriv = 2")
        );
        assert!(message(Kernel::new(1, 1, -1.0, 0.0, Tau::Center, 1.0)).starts_with("kappa must be"));
        assert!(message(Kernel::new(1, 1, 0.0, f64::NAN, Tau::Center, 1.0)).starts_with("mu must be"));
        assert!(message(Kernel::new(1, 1, 0.0, 0.0, Tau::At(f64::NAN), 1.0)).starts_with("tau must be"));
    }
}
