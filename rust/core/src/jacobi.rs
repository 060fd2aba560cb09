//! Polynomials orthonormal on [0, 1] for the density `tau^alpha (1 - tau)^beta / B(alpha + 1, beta + 1)`.
//!
//! `p_0 = 1` and `B_{k+1} p_{k+1} = (tau - A_k) p_k - B_k p_{k-1}`. Densities are normalised, so nothing overflows for
//! large exponents, and no monomial or factorial is ever formed. With `x = 2 tau - 1` the weight
//! `tau^alpha (1 - tau)^beta` belongs to the classical `P_m^{(beta, alpha)}(x)`: the exponent of the newest end comes first there.

#![expect(clippy::indexing_slicing, reason = "a recurrence has as many coefficients as its degree says")]

use nalgebra::{Complex, DMatrix};

/// The family with exponents `alpha` at 0 and `beta` at 1, both above -1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jacobi {
    /// Exponent at 0.
    pub alpha: f64,
    /// Exponent at 1.
    pub beta: f64,
}

/// Coefficients of the three-term recurrence: `a[k] = A_k` and `b[k] = B_k` for `k <= degree`, with `B_0 = 0`.
#[derive(Debug, Clone)]
pub struct Recurrence {
    a: Vec<f64>,
    b: Vec<f64>,
}

impl Jacobi {
    /// The recurrence that reaches `degree`.
    ///
    /// `A_0` and `B_1` have forms of their own: the generic ones are 0/0 at `alpha + beta = 0` and `-1`.
    #[must_use]
    pub fn recurrence(self, degree: usize) -> Recurrence {
        let Self { alpha, beta } = self;
        let sum = alpha + beta;
        let (mut a, mut b) = (vec![(alpha + 1.0) / (sum + 2.0)], vec![0.0]);
        for index in 1..=degree {
            let k = index as f64;
            let s = 2.0 * k + sum;
            a.push(0.5 * (1.0 + (alpha - beta) * sum / (s * (s + 2.0))));
            b.push(if index == 1 {
                ((alpha + 1.0) * (beta + 1.0) / (sum + 3.0)).sqrt() / (sum + 2.0)
            } else {
                (k * (k + alpha) / (s + 1.0) * ((k + beta) * (k + sum) / (s - 1.0))).sqrt() / s
            });
        }
        Recurrence { a, b }
    }

    /// `c` in `p_m' = c p_{m-1}`, the polynomial on the right being of the family with both exponents raised by one.
    #[must_use]
    pub fn derivative_factor(self, m: usize) -> f64 {
        let (m, sum) = (m as f64, self.alpha + self.beta);
        (m * (m + sum + 1.0) * ((sum + 2.0) / (self.alpha + 1.0)) * ((sum + 3.0) / (self.beta + 1.0))).sqrt()
    }

    /// The family of the derivatives of order `deriv`.
    #[must_use]
    pub fn raised(self, deriv: usize) -> Self {
        Self { alpha: self.alpha + deriv as f64, beta: self.beta + deriv as f64 }
    }

    /// `c_m` in `d^deriv p_m / d tau^deriv = c_m p_{m - deriv}` for `m = deriv..=degree`, the polynomials on the right being
    /// of the family raised by `deriv`.
    #[must_use]
    pub fn derivative_factors(self, degree: usize, deriv: usize) -> Vec<f64> {
        (deriv..=degree).map(|m| (0..deriv).map(|r| self.raised(r).derivative_factor(m - r)).product()).collect()
    }

    /// `d^deriv p_m / d tau^deriv` at `tau` for `m = 0..=degree`.
    #[must_use]
    pub fn derivatives(self, degree: usize, deriv: usize, tau: f64) -> Vec<f64> {
        let mut values = vec![0.0; deriv.min(degree + 1)];
        if deriv <= degree {
            let lower = self.raised(deriv).recurrence(degree - deriv).values(tau);
            values.extend(self.derivative_factors(degree, deriv).iter().zip(lower).map(|(factor, p)| factor * p));
        }
        values
    }

    /// `p_degree(tau)` and its derivative.
    fn value_and_slope(self, degree: usize, tau: f64) -> (f64, f64) {
        let value = *self.recurrence(degree).values(tau).last().unwrap_or(&1.0);
        (value, *self.derivatives(degree, 1, tau).last().unwrap_or(&0.0))
    }

    /// One or two Newton steps toward the root of `p_degree` next to `tau`.
    fn polish(self, degree: usize, mut tau: f64) -> f64 {
        for _ in 0..2 {
            let (value, slope) = self.value_and_slope(degree, tau);
            tau -= value / slope;
        }
        tau
    }

    /// The roots of `p_degree`, ascending: eigenvalues of the Jacobi matrix (Golub and Welsch), polished by Newton.
    #[must_use]
    pub fn roots(self, degree: usize) -> Vec<f64> {
        let Recurrence { a, b } = self.recurrence(degree);
        let matrix = DMatrix::from_fn(degree, degree, |i, j| match i.abs_diff(j) {
            0 => a[i],
            1 => b[i.max(j)],
            _ => 0.0,
        });
        let mut roots: Vec<f64> =
            matrix.symmetric_eigenvalues().iter().map(|&start| self.polish(degree, start)).collect();
        roots.sort_by(f64::total_cmp);
        roots
    }

    /// The root of `p_degree` within 1e-12 of `tau`, if there is one.
    #[must_use]
    pub fn root_near(self, degree: usize, tau: f64) -> Option<f64> {
        let (value, slope) = self.value_and_slope(degree, tau);
        // Newton's step is the distance to the root up to the square of itself: 2e-12 lets no true root escape.
        if (value / slope).abs() > 2e-12 {
            return None;
        }
        let root = self.polish(degree, tau);
        ((root - tau).abs() <= 1e-12).then_some(root)
    }

    /// Nodes and weights of the Gauss rule with `count` nodes for the density: exact to degree `2 count - 1`, weights summing to 1.
    #[must_use]
    pub fn gauss(self, count: usize) -> Vec<(f64, f64)> {
        let recurrence = self.recurrence(count.saturating_sub(1));
        let christoffel = |tau: f64| 1.0 / recurrence.values(tau).iter().map(|p| p * p).sum::<f64>();
        self.roots(count).into_iter().map(|tau| (tau, christoffel(tau))).collect()
    }

    /// `ln(tau^alpha (1 - tau)^beta / B(alpha + 1, beta + 1))`, with `0^0 = 1`; `rest` is `1 - tau`, given apart so that it can be exact.
    #[must_use]
    pub fn ln_density(self, tau: f64, rest: f64) -> f64 {
        ln_power(tau, self.alpha) + ln_power(rest, self.beta) - ln_beta(self.alpha + 1.0, self.beta + 1.0)
    }
}

impl Recurrence {
    /// The highest degree that it reaches.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.a.len() - 1
    }

    /// The off-diagonal `B_1..=B_degree` of the Jacobi matrix.
    #[must_use]
    pub fn off_diagonal(&self) -> &[f64] {
        &self.b[1..]
    }

    /// `p_0..=p_degree` at `tau`.
    #[must_use]
    pub fn values(&self, tau: f64) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.a.len());
        let (mut before, mut current) = (0.0, 1.0);
        values.push(current);
        for k in 0..self.degree() {
            let next = ((tau - self.a[k]) * current - self.b[k] * before) / self.b[k + 1];
            (before, current) = (current, next);
            values.push(current);
        }
        values
    }

    /// `sum of coefficients[k] p_k(tau)`.
    #[must_use]
    pub fn sum(&self, coefficients: &[f64], tau: f64) -> f64 {
        let (mut before, mut current, mut sum) = (0.0, 1.0, 0.0);
        for (k, coefficient) in coefficients.iter().enumerate() {
            if k > 0 {
                let next = ((tau - self.a[k - 1]) * current - self.b[k - 1] * before) / self.b[k];
                (before, current) = (current, next);
            }
            sum += coefficient * current;
        }
        sum
    }

    /// `sum of coefficients[k] p_k(tau)` at a complex point.
    #[must_use]
    pub fn sum_complex(&self, coefficients: &[f64], tau: Complex<f64>) -> Complex<f64> {
        let (mut before, mut current) = (Complex::new(0.0, 0.0), Complex::new(1.0, 0.0));
        let mut sum = Complex::new(0.0, 0.0);
        for (k, coefficient) in coefficients.iter().enumerate() {
            if k > 0 {
                let next = ((tau - self.a[k - 1]) * current - before * self.b[k - 1]) / self.b[k];
                (before, current) = (current, next);
            }
            sum += current * *coefficient;
        }
        sum
    }

    /// `p_0..=p_degree` at many points: `columns[m][j] = p_m(tau[j])`.
    pub fn fill(&self, tau: &[f64], columns: &mut [Vec<f64>]) {
        for m in 0..columns.len() {
            let (done, rest) = columns.split_at_mut(m);
            let Some(column) = rest.first_mut() else { return };
            column.clear();
            match done {
                [] => column.resize(tau.len(), 1.0),
                [_] => column.extend(tau.iter().map(|t| (t - self.a[0]) / self.b[1])),
                [.., before, current] => {
                    let (a, b, inverse) = (self.a[m - 1], self.b[m - 1], self.b[m].recip());
                    let step =
                        |((t, current), before): ((&f64, &f64), &f64)| ((t - a) * current - b * before) * inverse;
                    column.extend(tau.iter().zip(&*current).zip(&*before).map(step));
                }
            }
        }
    }
}

/// `exponent ln(base)` with `0^0 = 1`.
#[must_use]
pub fn ln_power(base: f64, exponent: f64) -> f64 {
    if exponent == 0.0 { 0.0 } else { exponent * base.ln() }
}

/// `ln B(p, q)`. Above 10 through the remainders of Stirling's series, because the difference of three large `ln Gamma`
/// would lose their common digits (1e-12 at p = q = 1000).
#[must_use]
pub fn ln_beta(p: f64, q: f64) -> f64 {
    let (p, q) = (p.min(q), p.max(q));
    let sum = p + q;
    if p >= 10.0 {
        let remainder = stirling(p) + stirling(q) - stirling(sum);
        return -0.5 * q.ln()
            + 0.5 * (2.0 * std::f64::consts::PI).ln()
            + remainder
            + (p - 0.5) * (p / sum).ln()
            + q * (-p / sum).ln_1p();
    }
    if q >= 10.0 {
        let remainder = stirling(q) - stirling(sum);
        return libm::lgamma(p) + remainder + p - p * sum.ln() + (q - 0.5) * (-p / sum).ln_1p();
    }
    libm::lgamma(p) + libm::lgamma(q) - libm::lgamma(sum)
}

/// `ln Gamma(x) - (x - 1/2) ln x + x - ln sqrt(2 pi)` for `x >= 10`: Stirling's series, whose terms beyond these are below 1e-17.
fn stirling(x: f64) -> f64 {
    const TERMS: [f64; 7] =
        [1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0, 1.0 / 1188.0, -691.0 / 360_360.0, 1.0 / 156.0];
    let square = (x * x).recip();
    TERMS.iter().rev().fold(0.0, |sum, term| sum * square + term) / x
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAMILIES: [(f64, f64); 6] = [(0.0, 0.0), (-0.5, -0.5), (1.0, 0.0), (2.5, 0.5), (10.0, 10.0), (-0.9, 3.0)];

    #[test]
    fn gauss_rule_makes_the_family_orthonormal() {
        for (alpha, beta) in FAMILIES {
            let family = Jacobi { alpha, beta };
            let recurrence = family.recurrence(8);
            let rule = family.gauss(9);
            for m in 0..=8 {
                for k in 0..=8 {
                    let product: f64 =
                        rule.iter().map(|&(tau, w)| w * recurrence.values(tau)[m] * recurrence.values(tau)[k]).sum();
                    let expected = if m == k { 1.0 } else { 0.0 };
                    assert!((product - expected).abs() < 1e-12, "{alpha} {beta} {m} {k}: {product}");
                }
            }
        }
    }

    #[test]
    fn moments_of_the_gauss_rule_are_those_of_the_density() {
        // The m-th moment of the density is B(alpha + 1 + m, beta + 1) / B(alpha + 1, beta + 1).
        for (alpha, beta) in FAMILIES {
            let rule = Jacobi { alpha, beta }.gauss(5);
            let mut expected = 1.0;
            for m in 0..10 {
                let moment: f64 = rule.iter().map(|&(tau, w)| w * tau.powi(m)).sum();
                assert!((moment - expected).abs() < 1e-14, "{alpha} {beta} {m}");
                expected *= (alpha + 1.0 + f64::from(m)) / (alpha + beta + 2.0 + f64::from(m));
            }
        }
    }

    #[test]
    fn roots_are_symmetric_for_equal_exponents_and_found_again() {
        for degree in 1..12 {
            let family = Jacobi { alpha: 1.5, beta: 1.5 };
            let roots = family.roots(degree);
            for (low, high) in roots.iter().zip(roots.iter().rev()) {
                assert!((low + high - 1.0).abs() < 4e-16);
            }
            assert_eq!(family.root_near(degree, roots[0] + 5e-13), Some(family.polish(degree, roots[0] + 5e-13)));
            assert_eq!(family.root_near(degree, roots[0] + 3e-12), None);
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let family = Jacobi { alpha: 0.5, beta: 2.0 };
        let h = 1e-5;
        for deriv in 1..4 {
            let (above, below) = (family.derivatives(6, deriv - 1, 0.3 + h), family.derivatives(6, deriv - 1, 0.3 - h));
            let exact = family.derivatives(6, deriv, 0.3);
            for m in 0..=6 {
                let slope = (above[m] - below[m]) / (2.0 * h);
                assert!((slope - exact[m]).abs() <= 1e-6 * (1.0 + exact[m].abs()), "{deriv} {m}");
            }
        }
    }

    #[test]
    fn ln_beta_keeps_its_digits() {
        // B(p, q) = (p - 1)! (q - 1)! / (p + q - 1)! as a product of ratios.
        for (p, q) in [(1_i32, 1_i32), (3, 5), (3, 40), (11, 11), (200, 300), (9, 11)] {
            let product: f64 = (1..p).map(|i| f64::from(i) / f64::from(q + i)).map(f64::ln).sum();
            let expected = product - f64::from(q).ln();
            assert!((ln_beta(p.into(), q.into()) - expected).abs() <= 4e-16 * f64::from(p + q), "{p} {q}");
        }
    }

    #[test]
    fn fill_equals_values() {
        let recurrence = Jacobi { alpha: 0.3, beta: -0.2 }.recurrence(5);
        let tau = [0.0, 0.2, 0.7, 1.0];
        let mut columns = vec![Vec::new(); 6];
        recurrence.fill(&tau, &mut columns);
        for (j, &t) in tau.iter().enumerate() {
            for (m, value) in recurrence.values(t).into_iter().enumerate() {
                assert!((columns[m][j] - value).abs() <= 1e-14 * (1.0 + value.abs()));
            }
        }
    }
}
