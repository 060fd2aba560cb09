//! The fit of the first or last whole window, evaluated at the samples of an end.
//!
//! An estimate at `position` is `e . c` with `c = Q^T sqrt(W) x`, one set for all outputs of an end, and `e = R^-T d` for
//! each position. R is triangular and the first `deriv` moments of a derivative are zero, so the first `deriv` numbers of
//! `e` are zero too, and of `c` only the others are needed.

#![expect(clippy::indexing_slicing, reason = "columns and coefficients are as many as the degree says")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use faer::Mat;
use pulp::{Arch, Simd, WithSimd};

use super::{Factor, Fit, solve_lower};
use crate::engine::Sample;
use crate::error::{Error, at_least, try_vec};

/// Coefficients that are summed side by side.
const BLOCK: usize = 4;

/// Numbers in a table, at most: half a megabyte. Larger fits estimate without.
const LARGEST: usize = 1 << 16;

/// Rows that are estimated side by side.
const SIDE: usize = 8;

/// Coefficients and estimates of a fit as sums of products.
#[derive(Debug)]
pub struct EndTables {
    span: usize,
    rank: usize,
    /// For every block of coefficients and every sample of the window, their factors.
    functionals: Vec<[f64; BLOCK]>,
    /// For every sample of the window `rank` numbers.
    estimators: Vec<f64>,
}

impl Fit {
    /// The tables for estimates of the `deriv`-th derivative; none if they would be large.
    pub fn end_tables(&self, deriv: usize) -> Result<Option<EndTables>, Error> {
        let (span, rank) = (self.span(), self.degree() + 1 - deriv);
        if span.saturating_mul(rank) > LARGEST || matches!(self.factor, Factor::Triangle { .. }) {
            return Ok(None);
        }
        let mut functionals = try_vec(span * rank.div_ceil(BLOCK), [0.0; BLOCK])?;
        for m in 0..rank {
            let block = &mut functionals[m / BLOCK * span..][..span];
            for (k, factors) in block.iter_mut().enumerate() {
                factors[m % BLOCK] = self.functional(m + deriv, k);
            }
        }
        let taus: Vec<f64> = (0..span).map(|k| self.tau(k as f64)).collect();
        let mut columns = vec![Vec::new(); rank];
        self.family.raised(deriv).recurrence(rank - 1).fill(&taus, &mut columns);
        let scales = self.family.derivative_factors(self.degree(), deriv);
        let mut moments =
            Mat::from_fn(
                rank + deriv,
                span,
                |m, k| if m < deriv { 0.0 } else { scales[m - deriv] * columns[m - deriv][k] },
            );
        if let Factor::Orthogonal { r, .. } = &self.factor {
            r.transpose().solve_lower_triangular_in_place(moments.as_mut());
        }
        let mut estimators = try_vec(span * rank, 0.0)?;
        for (k, row) in estimators.chunks_mut(rank).enumerate() {
            row.iter_mut().enumerate().for_each(|(m, value)| *value = moments[(m + deriv, k)]);
        }
        Ok(Some(EndTables { span, rank, functionals, estimators }))
    }

    /// The factor of sample `k` in the coefficient `m`.
    pub(super) fn functional(&self, m: usize, k: usize) -> f64 {
        match &self.factor {
            Factor::Orthogonal { scaled_q, .. } => scaled_q[(k, m)],
            Factor::Functionals(columns) => columns[m][k],
            Factor::Triangle { .. } => 0.0,
        }
    }

    /// What the tables hold for the samples of the window, for any position.
    fn estimator(&self, deriv: usize, position: f64) -> Vec<f64> {
        let mut moments = self.family.derivatives(self.degree(), deriv, self.tau(position));
        if let Factor::Orthogonal { r, .. } = &self.factor {
            solve_lower(r, &mut moments);
        }
        moments.split_off(deriv)
    }
}

/// What an end needs beside its window.
#[derive(Debug, Clone, Copy)]
pub struct End<'a> {
    /// The fit.
    pub fit: &'a Fit,
    /// Its tables, if they are small.
    pub tables: Option<&'a EndTables>,
    /// Order of the derivative.
    pub deriv: usize,
    /// From derivatives on [0, 1] to derivatives in time.
    pub unit: f64,
    /// Whether any constant may be taken out of the data first: what is left has the size of the signal's variation.
    pub keeps_constants: bool,
}

impl End<'_> {
    /// The outputs at `position` and on of one row, whose window is the start of `window`.
    pub fn estimate<T: Sample>(
        &self,
        tables: &EndTables,
        window: &[T],
        position: isize,
        out: &mut [T],
        coefficients: &mut Vec<f64>,
    ) -> Result<(), Error> {
        self.dispatch(tables, window, position, out, 1, coefficients)
    }

    /// The same for the [`Sample::LANES`] rows that stand side by side in `window` and `out`: by the same operations in the
    /// same order, so that every row has the same bits, alone or with others.
    pub fn estimate_lanes<T: Sample>(
        &self,
        window: &[T],
        position: isize,
        out: &mut [T],
        coefficients: &mut Vec<f64>,
    ) -> Result<(), Error> {
        if let Some(tables) = self.tables {
            for side in (0..T::LANES).step_by(SIDE) {
                self.dispatch(tables, &window[side..], position, &mut out[side..], T::LANES, coefficients)?;
            }
            return Ok(());
        }
        let mut row = try_vec(out.len() / T::LANES, T::default())?;
        for lane in 0..T::LANES {
            let sample = |k: usize| window[k * T::LANES + lane].to_f64();
            let reference = if self.keeps_constants { sample(0) } else { 0.0 };
            let fill = |start: usize, part: &mut [f64]| {
                part.iter_mut().zip(start..).for_each(|(value, k)| *value = sample(k) - reference);
            };
            self.evaluate(&self.fit.coefficients(fill)?, reference, position, &mut row);
            out[lane..].iter_mut().step_by(T::LANES).zip(&row).for_each(|(value, result)| *value = *result);
        }
        Ok(())
    }

    /// The outputs of one row without tables, from what [`Fit::coefficients`] found.
    pub fn evaluate<T: Sample>(&self, coefficients: &[f64], reference: f64, position: isize, out: &mut [T]) {
        let derivative = self.fit.derivative(coefficients, self.deriv);
        let back = if self.deriv == 0 { reference } else { 0.0 };
        for (value, position) in out.iter_mut().zip(position..) {
            *value = T::from_f64(derivative(position as f64) * self.unit + back);
        }
    }

    /// One row if `step` is 1, else [`SIDE`] rows that stand side by side in matrices with `step` columns.
    fn dispatch<T: Sample>(
        &self,
        tables: &EndTables,
        window: &[T],
        position: isize,
        out: &mut [T],
        step: usize,
        coefficients: &mut Vec<f64>,
    ) -> Result<(), Error> {
        at_least(coefficients, tables.functionals.len() / tables.span * BLOCK * SIDE)?;
        Arch::new().dispatch(Estimate { end: self, tables, window, position, out, step, coefficients });
        Ok(())
    }
}

struct Estimate<'a, T> {
    end: &'a End<'a>,
    tables: &'a EndTables,
    window: &'a [T],
    position: isize,
    out: &'a mut [T],
    step: usize,
    coefficients: &'a mut [f64],
}

impl<T: Sample> WithSimd for Estimate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        if self.step == 1 { self.run::<1>() } else { self.run::<SIDE>() }
    }
}

impl<T: Sample> Estimate<'_, T> {
    #[inline(always)]
    fn run<const N: usize>(self) {
        let Self { end, tables, window, position, out, step, coefficients } = self;
        let mut reference = [0.0; N];
        if end.keeps_constants {
            reference.iter_mut().zip(window).for_each(|(value, sample)| *value = sample.to_f64());
        }
        let (coefficients, _) = coefficients.as_chunks_mut::<N>();
        for (block, functionals) in tables.functionals.chunks_exact(tables.span).enumerate() {
            let sums = sums::<T, N>(functionals, window, step, reference);
            coefficients[block * BLOCK..][..BLOCK].copy_from_slice(&sums);
        }
        let back = if end.deriv == 0 { reference } else { [0.0; N] };
        for (row, position) in out.chunks_mut(step).zip(position..) {
            let beyond;
            let estimator = match usize::try_from(position) {
                Ok(k) if k < tables.span => &tables.estimators[k * tables.rank..][..tables.rank],
                _ => {
                    beyond = end.fit.estimator(end.deriv, position as f64);
                    &beyond
                }
            };
            let mut sums = [0.0; N];
            for (factor, coefficients) in estimator.iter().zip(&*coefficients) {
                for (sum, coefficient) in sums.iter_mut().zip(coefficients) {
                    *sum += factor * coefficient;
                }
            }
            for ((value, sum), back) in row.iter_mut().zip(sums).zip(back) {
                *value = T::from_f64(sum * end.unit + back);
            }
        }
    }
}

/// One block of coefficients of `N` rows side by side.
#[inline(always)]
fn sums<T: Sample, const N: usize>(
    functionals: &[[f64; BLOCK]],
    window: &[T],
    step: usize,
    reference: [f64; N],
) -> [[f64; N]; BLOCK] {
    let mut sums = [[0.0; N]; BLOCK];
    for (factors, samples) in functionals.iter().zip(window.chunks(step)) {
        let Some(samples) = samples.first_chunk::<N>() else { return sums };
        let mut values = reference;
        values.iter_mut().zip(samples).for_each(|(value, sample)| *value = sample.to_f64() - *value);
        for (sums, factor) in sums.iter_mut().zip(factors) {
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
    use crate::jacobi::Jacobi;

    #[test]
    fn tables_agree_with_the_fitted_coefficients_and_lanes_with_rows() {
        let family = Jacobi { alpha: 0.5, beta: 1.0 };
        for (deriv, degree, span) in [(0, 2, 9), (1, 3, 61), (2, 7, 40), (3, 3, 8)] {
            let fit = Fit::least_squares(family, degree, span, 0..span, &Unattended).expect("fits");
            let tables = fit.end_tables(deriv).expect("small").expect("small");
            let end = End { fit: &fit, tables: Some(&tables), deriv, unit: 0.5, keeps_constants: true };
            let strip: Vec<f64> = (0..span * 8).map(|k| 3.0 + (0.37 * k as f64).sin()).collect();
            let (outputs, position) = (span + 4, -2);
            let mut lanes = vec![0.0; outputs * 8];
            end.estimate_lanes(&strip, position, &mut lanes, &mut Vec::new()).expect("small");
            for lane in 0..8 {
                let row: Vec<f64> = strip[lane..].iter().step_by(8).copied().collect();
                let (mut alone, mut slow) = (vec![0.0; outputs], vec![0.0; outputs]);
                end.estimate(&tables, &row, position, &mut alone, &mut Vec::new()).expect("small");
                let fill = |start: usize, part: &mut [f64]| {
                    part.iter_mut().zip(&row[start..]).for_each(|(value, x)| *value = x - row[0]);
                };
                end.evaluate(&fit.coefficients(fill).expect("small"), row[0], position, &mut slow);
                let peak = slow.iter().fold(0.0_f64, |peak, value: &f64| peak.max(value.abs()));
                for (index, (alone, slow)) in alone.iter().zip(&slow).enumerate() {
                    assert_eq!(alone.to_bits(), lanes[index * 8 + lane].to_bits());
                    assert!((alone - slow).abs() <= 1e-13 * peak, "{deriv} {index}: {alone} {slow}");
                }
            }
        }
    }
}
