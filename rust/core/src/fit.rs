//! The weighted least-squares fit on the samples of one window: weights of an estimate, and the fitted polynomial itself.
//!
//! With base weights `W_j` and `V_mj = p_m(tau_j)` the discrete fit is `(V W V^T) a = V W x`, its derivative at `tau` is
//! `sum d_m a_m` with `d_m = [d^deriv p_m](tau)`, and so the weights of an estimate are `w = W V^T (V W V^T)^-1 d`: the ones
//! of least `sum w^2 / W` that meet the moments `V w = d`. The orthonormal basis makes `V W V^T` nearly the identity up to
//! degrees of about 2 sqrt(window); beyond, only a QR factorisation of `sqrt(W) V^T` keeps the digits.

#![expect(clippy::indexing_slicing, reason = "columns and coefficients are as many as the degree says")]

pub mod ends;

use std::ops::Range;

use faer::Mat;

use crate::control::{Control, Unattended};
use crate::error::{Error, try_vec};
use crate::jacobi::{Jacobi, Recurrence, ln_power};
use crate::rule::{Rule, functionals};

/// Rows of the basis that are formed at a time: windows up to this length keep their whole factorisation, longer ones
/// (whose basis is always well conditioned) keep only its triangle and form the basis again, so that memory stays bounded.
const CHUNK: usize = 4096;

/// Moments that are missed by more than this, relative to the largest, or weights that may be wrong by more, relative to
/// themselves, make a design an error.
const ALLOWED_ERROR: f64 = 1e-10;

/// Where the samples of a window lie on [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Grid {
    /// `(j + 1/2) / L`: every sample in the middle of its cell, T = L steps.
    Cells,
    /// `j / (L - 1)`: samples at both ends, T = L - 1 steps.
    Nodes,
}

impl Grid {
    /// Window length T in sampling steps.
    #[must_use]
    pub fn steps(self, window_length: usize) -> f64 {
        match self {
            Self::Cells => window_length as f64,
            Self::Nodes => (window_length - 1) as f64,
        }
    }

    /// `tau` of the sample at `position` (0 = oldest), which may lie between samples or outside of the window.
    #[must_use]
    pub fn tau(self, position: f64, window_length: usize) -> f64 {
        match self {
            Self::Cells => (position + 0.5) / window_length as f64,
            Self::Nodes => position / (window_length - 1) as f64,
        }
    }

    /// The position of `tau` in the window, in samples from the oldest.
    #[must_use]
    pub fn position(self, tau: f64, window_length: usize) -> f64 {
        match self {
            Self::Cells => tau * window_length as f64 - 0.5,
            Self::Nodes => tau * (window_length - 1) as f64,
        }
    }
}

/// A fit of fixed degree on the samples of a window.
#[derive(Debug)]
pub struct Fit {
    family: Jacobi,
    recurrence: Recurrence,
    grid: Grid,
    /// The whole window; `kept` are the samples of it that have a weight.
    window_length: usize,
    kept: Range<usize>,
    base: Vec<f64>,
    factor: Factor,
    /// Norms of the rows of `R^-1`.
    inverse_rows: Vec<f64>,
}

/// How `(V W V^T)^-1` is applied.
#[derive(Debug)]
enum Factor {
    /// `sqrt(W) V^T = Q R`, with `sqrt(W) Q` kept: `w = (sqrt(W) Q) R^-T d`.
    Orthogonal { scaled_q: Mat<f64>, r: Mat<f64> },
    /// Only R kept: `w = W V^T R^-1 R^-T d`.
    Triangle { r: Mat<f64> },
    /// A quadrature rule, which takes `V W V^T` for the identity: column m holds the weights of coefficient m.
    Functionals(Vec<Vec<f64>>),
}

impl Fit {
    /// The discrete least-squares fit on cells with the sampled weight `tau^kappa (1 - tau)^mu`; a negative exponent is
    /// averaged over its cell, so that no weight is infinite.
    pub fn least_squares(
        family: Jacobi,
        degree: usize,
        window_length: usize,
        kept: Range<usize>,
        control: &impl Control,
    ) -> Result<Self, Error> {
        let mut base = try_vec(kept.len(), 0.0)?;
        let mut peak = f64::NEG_INFINITY;
        for (start, part) in kept.clone().step_by(CHUNK).zip(base.chunks_mut(CHUNK)) {
            if start > kept.start {
                control.check(0.0)?;
            }
            for (j, weight) in (start..).zip(part) {
                *weight = ln_cell(j, window_length, family.alpha)
                    + ln_cell(window_length - 1 - j, window_length, family.beta);
                peak = peak.max(*weight);
            }
        }
        for (number, part) in base.chunks_mut(CHUNK).enumerate() {
            if number > 0 {
                control.check(0.0)?;
            }
            part.iter_mut().for_each(|weight| *weight = (*weight - peak).exp());
        }
        let sum: f64 = base.iter().sum();
        base.iter_mut().for_each(|weight| *weight /= sum);
        let recurrence = family.recurrence(degree);
        let (grid, factor, inverse_rows) = (Grid::Cells, Factor::Functionals(Vec::new()), Vec::new());
        let mut fit = Self { family, recurrence, grid, window_length, kept, base, factor, inverse_rows };
        fit.factor = fit.factorise(control)?;
        if let Factor::Orthogonal { r, .. } | Factor::Triangle { r } = &fit.factor {
            fit.inverse_rows = inverse_rows_of(r);
        }
        Ok(fit)
    }

    /// The continuous fit by a quadrature rule.
    pub fn quadrature(
        rule: Rule,
        family: Jacobi,
        degree: usize,
        window_length: usize,
        kept: Range<usize>,
        control: &impl Control,
    ) -> Result<Self, Error> {
        let factor = Factor::Functionals(functionals(rule, family, degree, window_length, &kept, control)?);
        let (recurrence, grid) = (family.recurrence(degree), rule.grid());
        let (base, inverse_rows) = (Vec::new(), Vec::new());
        Ok(Self { family, recurrence, grid, window_length, kept, base, factor, inverse_rows })
    }

    /// Number of samples that have a weight.
    #[must_use]
    pub fn span(&self) -> usize {
        self.kept.len()
    }

    fn tau(&self, position: f64) -> f64 {
        self.grid.tau(position + self.kept.start as f64, self.window_length)
    }

    /// Degree of the fit.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.recurrence.degree()
    }

    /// Weights whose moments are `moments`, and the largest moment error relative to the largest moment.
    pub fn weights(&self, moments: &[f64], control: &impl Control) -> Result<(Vec<f64>, f64), Error> {
        let scale = moments.iter().fold(0.0, |peak: f64, d| peak.max(d.abs()));
        let mut weights = try_vec(self.span(), 0.0)?;
        self.add_weights(moments, &mut weights, control)?;
        let mut missing = self.missing_moments(moments, &weights, control)?;
        let mut residual = relative(&missing, scale);
        if let Factor::Functionals(_) = self.factor {
            return Ok((weights, residual));
        }
        while residual > f64::EPSILON {
            let mut refined = try_vec(weights.len(), 0.0)?;
            refined.copy_from_slice(&weights);
            self.add_weights(&missing, &mut refined, control)?;
            let rest = self.missing_moments(moments, &refined, control)?;
            let better = relative(&rest, scale);
            if better.is_nan() || better >= residual {
                break;
            }
            let done = better > 0.5 * residual;
            (weights, missing, residual) = (refined, rest, better);
            if done {
                break;
            }
        }
        self.check(residual)?;
        self.check(self.rounding(moments))?;
        Ok((weights, residual))
    }

    /// How far the moments `V w` of the given weights fall short of `moments`.
    pub fn missing_moments(&self, moments: &[f64], weights: &[f64], control: &impl Control) -> Result<Vec<f64>, Error> {
        let mut missing = moments.to_vec();
        self.for_each_chunk(control, |start, columns| {
            for (rest, column) in missing.iter_mut().zip(columns) {
                *rest -= dot(column, &weights[start..start + column.len()]);
            }
        })?;
        Ok(missing)
    }

    /// Coefficients, in the orthonormal basis, of the polynomial fitted to a window, whose samples from `start` on
    /// `fill(start, samples)` hands over.
    pub fn coefficients(&self, mut fill: impl FnMut(usize, &mut [f64])) -> Result<Vec<f64>, Error> {
        let mut sums = vec![0.0; self.degree() + 1];
        let mut samples = try_vec(self.span().min(CHUNK), 0.0)?;
        if let Factor::Triangle { .. } = self.factor {
            self.for_each_chunk(&Unattended, |start, columns| {
                let x = &mut samples[..columns[0].len()];
                fill(start, x);
                x.iter_mut().zip(&self.base[start..]).for_each(|(x, weight)| *x *= weight);
                sums.iter_mut().zip(columns).for_each(|(sum, column)| *sum += dot(column, x));
            })?;
            self.solve_normal(&mut sums);
            return Ok(sums);
        }
        for start in (0..self.span()).step_by(CHUNK) {
            let x = &mut samples[..CHUNK.min(self.span() - start)];
            fill(start, x);
            for (m, sum) in sums.iter_mut().enumerate() {
                *sum += match &self.factor {
                    Factor::Functionals(columns) => dot(&columns[m][start..start + x.len()], x),
                    _ => x.iter().zip(start..).map(|(x, k)| self.functional(m, k) * x).sum(),
                };
            }
        }
        if let Factor::Orthogonal { r, .. } = &self.factor {
            solve_upper(r, &mut sums);
        }
        Ok(sums)
    }

    /// The `deriv`-th derivative, for T = 1, of the polynomial with the given coefficients, as a function of the position
    /// in samples from the oldest.
    pub fn derivative(&self, coefficients: &[f64], deriv: usize) -> impl Fn(f64) -> f64 + use<> {
        let (grid, length, first) = (self.grid, self.window_length, self.kept.start as f64);
        let lower = self.family.raised(deriv).recurrence(self.degree() - deriv);
        let factors = self.family.derivative_factors(self.degree(), deriv);
        let scaled: Vec<f64> = factors.iter().zip(&coefficients[deriv..]).map(|(factor, a)| factor * a).collect();
        move |position| lower.sum(&scaled, grid.tau(position + first, length))
    }

    /// Refuses estimates of the `deriv`-th derivative at the first or the last sample through the fitted coefficients, if
    /// their rounding would show.
    pub fn check_ends(&self, deriv: usize) -> Result<(), Error> {
        for place in [0.0, (self.span() - 1) as f64] {
            self.check(self.rounding(&self.family.derivatives(self.degree(), deriv, self.tau(place))))?;
        }
        Ok(())
    }

    /// A bound for the error of the weights with the given moments, relative to the weights, from rounding alone.
    ///
    /// The weights are `sqrt(W) Q R^-T d`, so that an error of eps in `d_m` moves them by eps `|d_m|` times row `m` of
    /// `R^-1`, in the norm in which they have the size `|R^-T d|`. The same holds for estimates through the coefficients
    /// `a = R^-1 Q^T sqrt(W) x`. Where the basis is well conditioned on the window, the bound is a few eps.
    fn rounding(&self, moments: &[f64]) -> f64 {
        let (Factor::Orthogonal { r, .. } | Factor::Triangle { r }) = &self.factor else { return 0.0 };
        let moved: f64 = moments.iter().zip(&self.inverse_rows).map(|(d, row)| d.abs() * row).sum();
        let mut solution = moments.to_vec();
        solve_lower(r, &mut solution);
        f64::EPSILON * moved / norm(&solution)
    }

    fn check(&self, error: f64) -> Result<(), Error> {
        if error <= ALLOWED_ERROR {
            return Ok(());
        }
        if error.is_nan() {
            let Jacobi { alpha, beta } = self.family;
            let (name, exponent) = if alpha > beta { ("kappa", alpha) } else { ("mu", beta) };
            let allowed = format!("so small that {} samples of the window have a weight", self.degree() + 1);
            return Err(Error::argument(name, exponent, allowed));
        }
        Err(Error::Moments { degree: self.degree(), window_length: self.span(), error })
    }

    /// `weights += W V^T (V W V^T)^-1 moments`.
    fn add_weights(&self, moments: &[f64], weights: &mut [f64], control: &impl Control) -> Result<(), Error> {
        let mut solution = moments.to_vec();
        if let Factor::Orthogonal { scaled_q, r } = &self.factor {
            solve_lower(r, &mut solution);
            for (q, factor) in scaled_q.col_iter().zip(solution) {
                weights.iter_mut().zip(q.iter()).for_each(|(w, q)| *w += factor * q);
            }
            return Ok(());
        }
        if let Factor::Functionals(columns) = &self.factor {
            for (column, moment) in columns.iter().zip(moments) {
                weights.iter_mut().zip(column).for_each(|(w, value)| *w += moment * value);
            }
            return Ok(());
        }
        self.solve_normal(&mut solution);
        self.for_each_chunk(control, |start, columns| {
            for (offset, (weight, base)) in weights[start..].iter_mut().zip(&self.base[start..]).take(CHUNK).enumerate()
            {
                *weight += base * columns.iter().zip(&solution).map(|(column, c)| c * column[offset]).sum::<f64>();
            }
        })
    }

    fn solve_normal(&self, rhs: &mut [f64]) {
        if let Factor::Triangle { r } = &self.factor {
            solve_lower(r, rhs);
            solve_upper(r, rhs);
        }
    }

    /// Calls `body(start, columns)` with `columns[m][j] = p_m(tau_{start + j})` for one chunk of the window after another.
    fn for_each_chunk(&self, control: &impl Control, mut body: impl FnMut(usize, &[Vec<f64>])) -> Result<(), Error> {
        let length = self.span();
        let mut columns = vec![Vec::new(); self.degree() + 1];
        for start in (0..length).step_by(CHUNK) {
            if start > 0 {
                control.check(0.0)?;
            }
            let tau: Vec<f64> = (start..length.min(start + CHUNK)).map(|j| self.tau(j as f64)).collect();
            self.recurrence.fill(&tau, &mut columns);
            body(start, &columns);
        }
        Ok(())
    }

    /// QR of `sqrt(W) V^T`, whole or chunk by chunk with the triangle of the chunks before on top.
    fn factorise(&self, control: &impl Control) -> Result<Factor, Error> {
        let (size, length) = (self.degree() + 1, self.span());
        if length <= CHUNK {
            let mut columns = Vec::new();
            self.for_each_chunk(control, |_, chunk| columns = chunk.to_vec())?;
            // Heaviest samples first: Householder's reflections then keep the digits of the light ones too, which under
            // large exponents are smaller by many powers of ten.
            let mut order: Vec<usize> = (0..length).collect();
            order.sort_by(|&i, &j| self.base[j].total_cmp(&self.base[i]));
            let root: Vec<f64> = order.iter().map(|&j| self.base[j].sqrt()).collect();
            let qr = Mat::from_fn(length, size, |row, m| root[row] * columns[m][order[row]]).qr();
            let thin_q = qr.compute_thin_Q();
            let mut scaled_q = Mat::zeros(length, size);
            for (row, &j) in order.iter().enumerate() {
                for m in 0..size {
                    scaled_q[(j, m)] = root[row] * thin_q[(row, m)];
                }
            }
            return Ok(Factor::Orthogonal { scaled_q, r: qr.thin_R().to_owned() });
        }
        let mut r: Mat<f64> = Mat::zeros(0, size);
        self.for_each_chunk(control, |start, columns| {
            let above = r.nrows();
            let stacked = Mat::from_fn(above + columns[0].len(), size, |row, m| {
                if row < above { r[(row, m)] } else { self.base[start + row - above].sqrt() * columns[m][row - above] }
            });
            let qr = stacked.qr();
            r = Mat::from_fn(
                size.min(stacked.nrows()),
                size,
                |row, m| if row <= m { qr.thin_R()[(row, m)] } else { 0.0 },
            );
        })?;
        Ok(Factor::Triangle { r })
    }
}

/// `ln` of the weight of cell `j` of `window_length` at an end with this exponent: the value at the middle of the cell, or
/// for a negative exponent the mean over the cell, `((j+1)^(e+1) - j^(e+1)) / ((e+1) L^e)` without its cancellation.
fn ln_cell(j: usize, window_length: usize, exponent: f64) -> f64 {
    let (j, length) = (j as f64, window_length as f64);
    if exponent >= 0.0 {
        return ln_power((j + 0.5) / length, exponent);
    }
    let power = exponent + 1.0;
    let mean = if j == 0.0 { 1.0 } else { j.powf(power) * (power * j.recip().ln_1p()).exp_m1() };
    (mean / power).ln() - exponent * length.ln()
}

fn relative(missing: &[f64], scale: f64) -> f64 {
    // Not a plain maximum: it would pass over NaN.
    missing.iter().map(|r| r.abs() / scale).fold(0.0, |peak, r| if r <= peak { peak } else { r })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(values: &[f64]) -> f64 {
    // Scaled: moments of high derivatives may overflow when squared.
    values.iter().fold(0.0_f64, |norm, value| norm.hypot(*value))
}

fn inverse_rows_of(r: &Mat<f64>) -> Vec<f64> {
    let mut rows = vec![0.0_f64; r.ncols()];
    for k in 0..r.ncols() {
        let mut column = vec![0.0; r.ncols()];
        column[k] = 1.0;
        solve_upper(r, &mut column);
        rows.iter_mut().zip(column).for_each(|(row, entry)| *row = row.hypot(entry));
    }
    rows
}

fn solve_upper(r: &Mat<f64>, rhs: &mut [f64]) {
    r.solve_upper_triangular_in_place(faer::ColMut::from_slice_mut(rhs).as_mat_mut());
}

fn solve_lower(r: &Mat<f64>, rhs: &mut [f64]) {
    r.transpose().solve_lower_triangular_in_place(faer::ColMut::from_slice_mut(rhs).as_mat_mut());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same fit, once with its whole factorisation and once by its triangle alone.
    fn both_ways(family: Jacobi, degree: usize, window_length: usize) -> (Fit, Fit) {
        let whole = Fit::least_squares(family, degree, window_length, 0..window_length, &Unattended).expect("fits");
        let Factor::Orthogonal { r, .. } = &whole.factor else { panic!("a short window keeps its Q") };
        let (base, recurrence, factor) =
            (whole.base.clone(), family.recurrence(degree), Factor::Triangle { r: r.clone() });
        let inverse_rows = whole.inverse_rows.clone();
        let kept = 0..window_length;
        let triangle = Fit { family, recurrence, grid: Grid::Cells, window_length, kept, base, factor, inverse_rows };
        (whole, triangle)
    }

    #[test]
    fn as_many_coefficients_as_samples_need_the_orthogonal_factor() {
        // p_20 on 21 samples has the coefficients 0, ..., 0, 1.
        let family = Jacobi { alpha: 0.0, beta: 0.0 };
        let (whole, triangle) = both_ways(family, 20, 21);
        let values = |j: i32| family.recurrence(20).values(Grid::Cells.tau(f64::from(j), 21))[20];
        let x: Vec<f64> = (0..21).map(values).collect();
        let error = |fit: &Fit| {
            let coefficients =
                fit.coefficients(|start, part| part.copy_from_slice(&x[start..][..part.len()])).expect("fits");
            let wanted = |m: usize| if m == 20 { 1.0 } else { 0.0 };
            coefficients.iter().enumerate().map(|(m, a)| (a - wanted(m)).abs()).fold(0.0, f64::max)
        };
        assert!(error(&whole) < 1e-11, "{:e}", error(&whole));
        assert!(error(&triangle) > 1e-9, "{:e}", error(&triangle));
        // Weights are refined, and so equally good both ways.
        let moments = family.derivatives(20, 1, Grid::Cells.tau(20.0, 21));
        for fit in [whole, triangle] {
            assert!(fit.weights(&moments, &Unattended).expect("meets its moments").1 < 1e-11);
        }
    }

    #[test]
    fn long_windows_take_the_other_path_to_the_same_weights() {
        let family = Jacobi { alpha: 0.5, beta: 1.0 };
        let (whole, triangle) = both_ways(family, 4, 3000);
        let moments = family.derivatives(4, 1, 0.7);
        let (expected, _) = whole.weights(&moments, &Unattended).expect("meets its moments");
        let (weights, _) = triangle.weights(&moments, &Unattended).expect("meets its moments");
        let peak = expected.iter().fold(0.0, |peak: f64, w| peak.max(w.abs()));
        for (w, e) in weights.iter().zip(&expected) {
            assert!((w - e).abs() <= 1e-14 * peak);
        }
        let x: Vec<f64> = (0..3000).map(|j| (f64::from(j) / 3000.0).sin()).collect();
        let coefficients =
            |fit: &Fit| fit.coefficients(|start, part| part.copy_from_slice(&x[start..][..part.len()])).expect("fits");
        let (a, b) = (coefficients(&whole), coefficients(&triangle));
        a.iter().zip(&b).for_each(|(a, b)| assert!((a - b).abs() < 1e-14));
    }

    #[test]
    fn long_windows_meet_their_moments() {
        let family = Jacobi { alpha: 0.0, beta: 0.0 };
        let fit = Fit::least_squares(family, 3, 20_001, 0..20_001, &Unattended).expect("fits");
        let (_, residual) = fit.weights(&family.derivatives(3, 2, 0.9), &Unattended).expect("meets its moments");
        assert!(residual < 1e-14);
    }

    #[test]
    fn a_degree_beyond_the_window_is_an_error() {
        let family = Jacobi { alpha: 0.0, beta: 0.0 };
        let fit = Fit::least_squares(family, 59, 60, 0..60, &Unattended).expect("factorises");
        let error = fit.weights(&family.derivatives(59, 1, 1.0), &Unattended).expect_err("cannot");
        assert!(matches!(error, Error::Moments { degree: 59, window_length: 60, .. }));
    }

    #[test]
    fn negative_exponents_average_their_cells() {
        // sum of u_e(j) / L is the integral of tau^e: 1 / (e + 1).
        for length in [7_usize, 1000] {
            let sum: f64 = (0..length).map(|j| ln_cell(j, length, -0.5).exp()).sum();
            assert!((sum / length as f64 - 2.0).abs() < 1e-13);
        }
    }
}
