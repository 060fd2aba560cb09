//! Rules for integrals against densities with singular ends.
//!
//! The double exponential substitution (Takahasi and Mori 1974) takes [0, 1] to the real line, where the trapezoidal rule
//! converges exponentially: the ends may be singular, the density narrow and the integrand oscillating, and everything is
//! formed from logarithms, so that neither `1 - s` nor a large exponent loses digits.

use std::f64::consts::PI;

use crate::jacobi::{Jacobi, ln_beta, ln_power};

/// Terms below `e^-NEGLIGIBLE` of the largest are left out.
const NEGLIGIBLE: f64 = 45.0;

/// A point of [0, 1], `ln` of it and of its distance to 1, and `ln` of its weight `ds` in the rule.
#[derive(Debug, Clone, Copy)]
pub struct Node {
    /// The point.
    pub s: f64,
    /// `ln s`.
    pub ln_s: f64,
    /// `ln (1 - s)`.
    pub ln_rest: f64,
    /// `ln ds`.
    pub ln_weight: f64,
}

/// Nodes for integrands `s^alpha (1 - s)^beta f(s)` where `f` has no more detail than a polynomial of degree `degree`
/// times `exp(i omega s)`.
#[must_use]
pub fn nodes(family: Jacobi, degree: usize, omega: f64) -> Vec<Node> {
    let Jacobi { alpha, beta } = family;
    on_line(family, 2.0 * PI / rate(alpha + beta, degree as f64, omega.abs()))
}

/// The rule with this step in the new variable, as far as the ends of `family` need it.
fn on_line(family: Jacobi, step: f64) -> Vec<Node> {
    let Jacobi { alpha, beta } = family;
    // `s^(alpha + 1) ds / s` falls below its share at pi sinh(u) (alpha + 1) = NEGLIGIBLE.
    let reach = |exponent: f64| (NEGLIGIBLE / (PI * (exponent + 1.0))).asinh().max(3.3);
    let (first, last) = ((-reach(alpha) / step).floor() as i64, (reach(beta) / step).ceil() as i64);
    (first..=last)
        .map(|index| {
            let u = index as f64 * step;
            let y = PI * u.sinh();
            let (ln_s, ln_rest) = (-ln_one_plus_exp(-y), -ln_one_plus_exp(y));
            Node { s: ln_s.exp(), ln_s, ln_rest, ln_weight: (PI * u.cosh() * step).ln() + ln_s + ln_rest }
        })
        .collect()
}

/// Nodes per unit of the new variable u, times 2 pi, for a relative error of `e^-40`.
///
/// The trapezoidal rule errs by `e^(-rate v)` times the integrand on the line `Im u = v`, for any v below pi/2. There s is
/// `(1 + i t) / 2` at its farthest, `t = tan(pi sin(v) / 2)`, where `exp(i omega s)` has grown by `omega t / 2` in the
/// exponent, `p_m` by `m asinh(t)` and the density times `ds/du` by `(alpha + beta + 2) ln(1 + t^2) / 2`.
fn rate(exponents: f64, degree: f64, omega: f64) -> f64 {
    (1..150)
        .map(|index| {
            let v = 0.01 * f64::from(index);
            let t = (0.5 * PI * v.sin()).tan();
            (40.0 + 0.5 * omega * t + degree * t.asinh() + 0.5 * (exponents + 2.0) * (t * t).ln_1p()) / v
        })
        .fold(f64::INFINITY, f64::min)
}

impl Node {
    /// The density of `family` at the node times the node's weight.
    #[must_use]
    pub fn mass(&self, family: Jacobi) -> f64 {
        let Jacobi { alpha, beta } = family;
        (alpha * self.ln_s + beta * self.ln_rest + self.ln_weight - ln_beta(alpha + 1.0, beta + 1.0)).exp()
    }
}

/// `ln(1 + e^y)` without overflow.
fn ln_one_plus_exp(y: f64) -> f64 {
    if y > 0.0 { y + (-y).exp().ln_1p() } else { y.exp().ln_1p() }
}

/// Nodes and weights, as `(x, weight)`, for integrals of `x^exponent e^-x / Gamma(exponent + 1) f(x)` over `x > 0`, where
/// `f` turns in `ln x` by at most `rate`.
#[must_use]
pub fn laplace_nodes(exponent: f64, rate: f64) -> Vec<(f64, f64)> {
    let power = exponent + 1.0;
    let step = 2.0 * PI / (44.0 + 9.0 * power.sqrt() + rate);
    // x = exp(u - e^-u): x^power falls doubly exponentially to the left, e^-x to the right.
    let first = (-(NEGLIGIBLE / power).ln_1p() / step).floor() as i64;
    let last = ((power + 12.0 * power.sqrt() + 80.0).ln() / step).ceil() as i64;
    let ln_gamma = libm::lgamma(power);
    (first..=last)
        .map(|index| {
            let u = index as f64 * step;
            let ln_x = u - (-u).exp();
            let x = ln_x.exp();
            (x, step * (power * ln_x - x - ln_gamma + (-u).exp().ln_1p()).exp())
        })
        .collect()
}

/// The integral of the density of `family` from 0 to `s`: the regularised incomplete beta function.
#[must_use]
pub fn cumulative_density(family: Jacobi, s: f64) -> f64 {
    let Jacobi { alpha, beta } = family;
    if s <= 0.0 || s >= 1.0 {
        return f64::from(s >= 1.0);
    }
    // From the nearer end, so that the integrand falls away from the far end of the piece.
    if s * (alpha + beta + 2.0) > alpha + 1.0 {
        return 1.0 - lower_tail(Jacobi { alpha: beta, beta: alpha }, 1.0 - s, s);
    }
    lower_tail(family, s, 1.0 - s)
}

/// The integral from 0 to `s = 1 - rest`, with `s v` for the variable.
fn lower_tail(family: Jacobi, s: f64, rest: f64) -> f64 {
    let Jacobi { alpha, beta } = family;
    let scale = (alpha + 1.0) * s.ln() - ln_beta(alpha + 1.0, beta + 1.0);
    // `rest + s (1 - v)` vanishes at v = 1/s, at a distance of about 0.4 from the real line of u for `rest` as small as 1e-3.
    on_line(Jacobi { alpha, beta: 0.0 }, 2.0 * PI / (rate(alpha + beta, 0.0, 0.0) + 80.0))
        .iter()
        .map(|node| {
            let beyond = rest + s * node.ln_rest.exp();
            (scale + alpha * node.ln_s + ln_power(beyond, beta) + node.ln_weight).exp()
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAMILIES: [(f64, f64); 7] =
        [(0.0, 0.0), (-0.9, -0.5), (3.0, 0.5), (40.0, 40.0), (300.0, 2.0), (-0.99, 1000.0), (10_000.0, 10_000.0)];

    #[test]
    fn masses_have_the_moments_of_the_density() {
        for (alpha, beta) in FAMILIES {
            let family = Jacobi { alpha, beta };
            let rule = nodes(family, 4, 0.0);
            let mut expected = 1.0;
            for m in 0..4 {
                let moment: f64 = rule.iter().map(|node| node.mass(family) * (f64::from(m) * node.ln_s).exp()).sum();
                let allowed = 4e-15 * (1.0 + alpha.abs() + beta.abs()).sqrt() * 20.0;
                assert!((moment / expected - 1.0).abs() < allowed, "{alpha} {beta} {m}: {:e}", moment / expected - 1.0);
                expected *= (alpha + 1.0 + f64::from(m)) / (alpha + beta + 2.0 + f64::from(m));
            }
        }
    }

    #[test]
    fn laplace_nodes_have_the_moments_of_the_gamma_density() {
        for exponent in [-0.99, -0.5, 0.0, 2.5, 40.0, 1000.0] {
            let rule = laplace_nodes(exponent, 0.0);
            let mut expected = 1.0;
            for m in 0..5 {
                let moment: f64 = rule.iter().map(|&(x, w)| w * x.powi(m)).sum();
                assert!((moment / expected - 1.0).abs() < 1e-12, "{exponent} {m}: {:e}", moment / expected - 1.0);
                expected *= exponent + 1.0 + f64::from(m);
            }
        }
    }

    #[test]
    fn cumulative_density_in_closed_form() {
        // For beta = 0 it is s^(alpha + 1), and for alpha = 0 it is 1 - (1 - s)^(beta + 1).
        for exponent in [-0.9_f64, 0.0, 0.5, 7.0, 300.0] {
            for s in [1e-3_f64, 0.2, 0.5, 0.9, 0.999] {
                let low = cumulative_density(Jacobi { alpha: exponent, beta: 0.0 }, s);
                assert!((low - s.powf(exponent + 1.0)).abs() < 1e-14, "{exponent} {s}");
                let high = cumulative_density(Jacobi { alpha: 0.0, beta: exponent }, s);
                assert!((high + ((-s).ln_1p() * (exponent + 1.0)).exp_m1()).abs() < 1e-14, "{exponent} {s}");
            }
        }
        for exponent in [0.3, 50.0, 9000.0] {
            assert!(
                (cumulative_density(Jacobi { alpha: exponent, beta: exponent }, 0.5) - 0.5).abs()
                    < 1e-15 * (10.0 + exponent)
            );
        }
    }
}
