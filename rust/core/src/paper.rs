//! The source paper's own systems: the simultaneous estimators, equations (3) to (5), and the combinations of minimal
//! estimators, equations (16) and (17) for any order and degree.
//!
//! Nothing else is built on them. They say the same as [`crate::kernel::Kernel`], with fewer digits.

#![expect(clippy::indexing_slicing, reason = "rows and columns have the lengths that were compared at the start")]

use faer::Mat;

use crate::control::Control;
use crate::error::Error;
use crate::jacobi::Jacobi;
use crate::kernel::{Kernel, MAX_DEGREE, MAX_TAU, Tau};

/// More integrations than the least by this are refused, as the exponent `mu` of the same kernel is.
const MAX_NU_BEYOND_LEAST: usize = 10_000;

/// The system (5), `P x = integral of Q(tau) y(tau)` over [0, T], for all derivatives at the origin up to order `N`.
#[derive(Debug, Clone)]
pub struct Simultaneous {
    degree: usize,
    nu: usize,
    duration: f64,
    matrix: Mat<f64>,
}

impl Simultaneous {
    /// The system for `N`, `nu` and `T`; refused where an entry of `P` overflows or loses digits to underflow.
    pub fn new(degree: usize, nu: usize, duration: f64) -> Result<Self, Error> {
        if degree > MAX_DEGREE {
            return Err(Error::argument("N", degree, format!("at most {MAX_DEGREE}")));
        }
        let (least, most) = (degree + 2, degree + 2 + MAX_NU_BEYOND_LEAST);
        if nu < least {
            return Err(Error::argument("nu", nu, format!("at least N + 2 = {least}")));
        }
        if nu > most {
            return Err(Error::argument("nu", nu, format!("at most N + {}", most - degree)));
        }
        if !(duration.is_finite() && duration > 0.0) {
            return Err(Error::argument("T", duration, "finite and positive"));
        }
        if let Some(matrix) = matrix(degree, nu, duration) {
            return Ok(Self { degree, nu, duration, matrix });
        }
        if duration == 1.0 || matrix(degree, nu, 1.0).is_none() {
            return Err(Error::argument("nu", nu, format!("small enough for 1 / {}! to be a normal number", nu - 1)));
        }
        let allowed = format!("such that the powers of T in P, up to T**{}, neither overflow nor underflow", nu - 1);
        Err(Error::argument("T", duration, allowed))
    }

    /// `P`: anti-triangular, zero below `i + j = N`.
    #[must_use]
    pub fn matrix(&self) -> &Mat<f64> {
        &self.matrix
    }

    /// `Q` at `points`, row after row: `out[i * points.len() + j] = Q_i(points[j])`, zero outside of [0, T].
    ///
    /// `Q_i = sum over l of C(i, l) (N+1)!/(N+1-l)! (-tau)^(i-l) (T-tau)^e / e!` with `e = nu - N - 2 + l`; the source has
    /// `- l` in `e`. Powers are taken of `tau / T` and `(T - tau) / T`, and those of `T` go with the factorials.
    pub fn right_side(&self, points: &[f64], out: &mut [f64], control: &impl Control) -> Result<(), Error> {
        let (rows, lowest) = (self.degree + 1, self.nu - self.degree - 2);
        if Some(out.len()) != points.len().checked_mul(rows) {
            return Err(Error::argument("out", out.len(), format!("of {rows} rows of {} elements", points.len())));
        }
        let mut first = power_over_factorial(self.duration, lowest);
        for i in 0..rows {
            let mut factors = vec![first];
            for l in 0..i {
                let ratio = (i - l) as f64 / (l + 1) as f64 * ((rows - l) as f64 / (lowest + l + 1) as f64);
                factors.push(factors[l] * ratio);
            }
            if !factors.iter().all(|factor| factor.is_finite()) {
                return Err(Error::argument("nu", self.nu, "such that the coefficients of Q are finite"));
            }
            for (j, &tau) in points.iter().enumerate() {
                if j % 4096 == 4095 {
                    control.check(i as f64 / rows as f64)?;
                }
                let (old, new) = (-tau / self.duration, (self.duration - tau) / self.duration);
                let term = |(l, factor): (usize, &f64)| factor * power(new, lowest + l) * power(old, i - l);
                out[i * points.len() + j] = match tau {
                    tau if tau.is_nan() => tau,
                    tau if !(0.0..=self.duration).contains(&tau) => 0.0,
                    _ => factors.iter().enumerate().map(term).sum(),
                };
            }
            first *= self.duration;
        }
        Ok(())
    }

    /// The 2-norm condition number of `P`.
    ///
    /// As the product of two largest singular values, of `P` and of its inverse: the smallest one of `P` itself would be
    /// rounding alone from a condition of 1e16 on, while substitution gives the inverse to nearly every digit.
    pub fn condition_number(&self) -> Result<f64, Error> {
        let condition = largest_singular_value(&self.matrix)
            .zip(largest_singular_value(&self.inverse()))
            .map_or(f64::INFINITY, |(norm, inverse)| norm * inverse);
        if condition.is_finite() {
            return Ok(condition);
        }
        Err(Error::argument("N", self.degree, "small enough for a condition number that is finite"))
    }

    /// `P^-1`, by substitution from row `N`, which holds the first unknown alone, up to row 0.
    fn inverse(&self) -> Mat<f64> {
        let size = self.degree + 1;
        let mut inverse = Mat::zeros(size, size);
        for column in 0..size {
            for j in 0..size {
                let row = self.degree - j;
                let known: f64 = (0..j).map(|k| self.matrix[(row, k)] * inverse[(k, column)]).sum();
                let right = if row == column { 1.0 } else { 0.0 };
                inverse[(j, column)] = (right - known) / self.matrix[(row, j)];
            }
        }
        inverse
    }
}

/// `P_ij = (N-j)!/(N-i-j)! T^m / m!` with `m = nu - N + i + j - 1`, each entry from the one above it: no factorial is formed.
fn matrix(degree: usize, nu: usize, duration: f64) -> Option<Mat<f64>> {
    let mut matrix = Mat::zeros(degree + 1, degree + 1);
    for j in 0..=degree {
        let mut m = nu - degree + j - 1;
        let mut entry = power_over_factorial(duration, m);
        for i in 0..=degree - j {
            if i > 0 {
                m += 1;
                entry *= (degree - j + 1 - i) as f64 * (duration / m as f64);
            }
            if !entry.is_normal() {
                return None;
            }
            matrix[(i, j)] = entry;
        }
    }
    Some(matrix)
}

/// `base^m / m!`.
fn power_over_factorial(base: f64, m: usize) -> f64 {
    (1..=m).map(|k| base / k as f64).product()
}

fn power(base: f64, exponent: usize) -> f64 {
    base.powi(i32::try_from(exponent).unwrap_or(i32::MAX))
}

/// None where the entries are too large for one.
fn largest_singular_value(matrix: &Mat<f64>) -> Option<f64> {
    let scale = matrix.norm_max();
    if !scale.is_normal() {
        return None;
    }
    let scaled = Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / scale);
    scaled.singular_values().ok()?.first().map(|value| value * scale)
}

/// The `lambda_l` with which minimal estimators give the one of order `n`, degree `N` and exponents `kappa`, `mu` at `tau`,
///
/// `x_tau(kappa, mu; N) = sum over l of lambda_l x(kappa + q - l, mu + l)`, `l = 0..=q`, `q = N - n`,
///
/// for each of `points` in turn: `out[j * (q + 1) + l] = lambda_l(points[j])`.
pub fn lambdas(
    deriv: usize,
    degree: usize,
    exponents: (f64, f64),
    points: &[f64],
    out: &mut [f64],
) -> Result<(), Error> {
    let (kappa, mu) = exponents;
    if degree < deriv {
        return Err(Error::argument("N", degree, format!("at least n = {deriv}")));
    }
    let count = degree - deriv + 1;
    if Some(out.len()) != points.len().checked_mul(count) {
        return Err(Error::argument("out", out.len(), format!("of {} rows of {count} elements", points.len())));
    }
    let weight = Kernel::new(0, 0, kappa, mu, Tau::Center, 1.0)?.family().raised(deriv);
    for (&tau, row) in points.iter().zip(out.chunks_exact_mut(count)) {
        if tau.is_nan() || tau.abs() > MAX_TAU {
            return Err(Error::argument("tau", tau, format!("finite and at most {MAX_TAU:e} in size")));
        }
        if tau <= 0.5 {
            lambdas_near_zero(weight, tau, row);
        } else {
            // The window read backwards: there the sum of `lambdas_near_zero` has terms of both signs, here it has not.
            lambdas_near_zero(Jacobi { alpha: weight.beta, beta: weight.alpha }, 1.0 - tau, row);
            row.reverse();
        }
        if !row.iter().all(|lambda| lambda.is_finite()) {
            return Err(Error::argument("tau", tau, "small enough for lambdas that are finite"));
        }
    }
    Ok(())
}

/// `lambda_l = sum over j of (-1)^(j-q+l) C(j, q-l) P_j^(b+q+1-j, a)(2 tau - 1)`, `j = q-l..=q`, with the classical Jacobi
/// polynomials and the exponents a, b of `weight`. At `tau <= 0` all terms have one sign.
fn lambdas_near_zero(weight: Jacobi, tau: f64, out: &mut [f64]) {
    let q = out.len() - 1;
    out.fill(0.0);
    for j in 0..=q {
        let value = classical(j, weight.beta + (q + 1 - j) as f64, weight.alpha, tau);
        let mut binomial = if j % 2 == 0 { 1.0 } else { -1.0 };
        for k in 0..=j {
            // (-1)^(j-k) C(j, k), with k = q - l.
            out[q - k] += binomial * value;
            binomial *= -((j - k) as f64) / (k + 1) as f64;
        }
    }
}

/// The classical Jacobi polynomial `P_degree^(alpha, beta)(2 tau - 1)`.
///
/// By its value at 0, which is `(-1)^degree C(degree + beta, degree)`, times the running sum of the differences that the
/// recurrence makes of it: near 0 and for large exponents the recurrence itself would subtract what is nearly equal.
fn classical(degree: usize, alpha: f64, beta: f64, tau: f64) -> f64 {
    let sum = alpha + beta;
    let (mut at_zero, mut ratio, mut step) = (1.0, 1.0, 0.0);
    for index in 0..degree {
        let k = index as f64;
        let t = 2.0 * k + sum;
        step = if index == 0 {
            -tau * (sum + 2.0) / (beta + 1.0)
        } else {
            (t + 2.0) * (k * (k + alpha) * step - tau * t * (t + 1.0) * ratio)
                / ((k + beta + 1.0) * (k + sum + 1.0) * t)
        };
        ratio += step;
        at_zero *= -(k + 1.0 + beta) / (k + 1.0);
    }
    at_zero * ratio
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;

    #[test]
    fn the_system_reproduces_polynomials() {
        // With y = tau^m / m! the right side is column m of P, because x^(m)(0) = 1 is all there is. Gauss integrates exactly.
        let rule = Jacobi { alpha: 0.0, beta: 0.0 }.gauss(16);
        for (degree, nu, duration) in [(0, 2, 1.0), (1, 3, 0.5), (3, 5, 2.0), (5, 9, 1.0)] {
            let system = Simultaneous::new(degree, nu, duration).expect("valid");
            let points: Vec<f64> = rule.iter().map(|(tau, _)| tau * duration).collect();
            let mut q = vec![0.0; (degree + 1) * points.len()];
            system.right_side(&points, &mut q, &Unattended).expect("same length");
            for (i, row) in q.chunks(points.len()).enumerate() {
                for m in 0..=degree {
                    let terms = row.iter().zip(&points).zip(&rule);
                    let integral: f64 =
                        terms.map(|((q, &tau), (_, w))| w * duration * q * power_over_factorial(tau, m)).sum();
                    let scale: f64 =
                        row.iter().map(|q| q.abs()).fold(0.0, f64::max) * power_over_factorial(duration, m);
                    let error = (integral - system.matrix()[(i, m)]).abs();
                    assert!(
                        error <= 64.0 * f64::EPSILON * scale * duration.max(1.0),
                        "{degree} {nu} {i} {m}: {error:e}"
                    );
                }
            }
        }
    }

    #[test]
    fn known_condition_numbers() {
        // N = 1, nu = 3, T = 1: P = [[1, 1/2], [1/2, 0]], eigenvalues (1 +- sqrt 2) / 2.
        let condition = |degree, nu| Simultaneous::new(degree, nu, 1.0)?.condition_number();
        let exact = (2.0_f64.sqrt() + 1.0).powi(2);
        assert!((condition(1, 3).expect("finite") / exact - 1.0).abs() < 1e-14);
        assert_eq!(condition(0, 2), Ok(1.0));
        assert!((condition(2, 4).expect("finite") / 68.635_829_312_901_17 - 1.0).abs() < 1e-13);
        // Far beyond 1e16 it goes on growing, as no single factorisation of P would see.
        let far = condition(16, 18).expect("finite");
        assert!(far > 1e26 && far > 1e2 * condition(15, 17).expect("finite"), "{far:e}");
    }

    #[test]
    fn lambdas_meet_their_linear_system() {
        // sum over l of lambda_l (a+q-l+1)_m = (c)_m tau^m with c = a + b + q + 2.
        let rising = |x: f64, m: usize| -> f64 { (0..m).map(|i| x + i as f64).product() };
        for (deriv, q, kappa, mu, tau) in [(0, 0, 0.0, 0.0, 0.3), (1, 2, -0.5, 2.0, 0.9), (3, 4, 1.5, 0.0, 1.2)] {
            let mut values = vec![0.0; q + 1];
            lambdas(deriv, deriv + q, (kappa, mu), &[tau], &mut values).expect("valid");
            let (a, c) = (kappa + deriv as f64, kappa + mu + (2 * deriv + q + 2) as f64);
            for m in 0..=q {
                let terms = values.iter().enumerate().map(|(l, lambda)| lambda * rising(a + (q - l) as f64 + 1.0, m));
                let size: f64 = terms.clone().map(f64::abs).sum();
                assert!((terms.sum::<f64>() - rising(c, m) * power(tau, m)).abs() <= 1e-13 * size, "{deriv} {q} {m}");
            }
        }
    }

    #[test]
    fn refusals_name_the_argument() {
        let message = |degree, nu, duration| Simultaneous::new(degree, nu, duration).expect_err("refused").to_string();
        assert!(message(501, 503, 1.0).starts_with("N must be at most 500"));
        assert!(message(2, 3, 1.0).starts_with("nu must be at least N + 2 = 4"));
        assert!(message(2, 4, f64::NAN).starts_with("T must be finite and positive"));
        assert!(message(2, 400, 1.0).starts_with("nu must be small enough"));
        assert!(message(2, 4, 1e200).starts_with("T must be such that"));
    }
}
