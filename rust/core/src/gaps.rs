//! Windows of an even grid some of whose samples are missing.
//!
//! On the whole window the fit has orthonormal polynomials: `sqrt(W) q_m` are the columns of a matrix Q with `Q^T Q = 1`. Without
//! the samples of a set M the fit's coefficients `a` solve `G a = Q^T sqrt(W) x`, the missing samples being 0 there, with
//! `G = 1 - sum over M of Q_j Q_j^T`: a system as small as the fit has coefficients, the dual of the one that the hat matrix gives for
//! the missing values. With `G g = q^(n)(u)` the estimate is `g . Q^T sqrt(W) x`, and its weights are `sqrt(W_j) Q_j . g`.

#![expect(
    clippy::indexing_slicing,
    reason = "windows lie in their rows, and sums have one more element than what they sum"
)]

pub mod bulk;

use std::ops::Range;

use pulp::Arch;

use crate::error::{Error, try_vec};
use crate::local::{Block, Model, SIDE, Sheet, dots};

/// A pivot of G below this: so much of the window is missing that the samples that are left are fitted anew.
const SMALLEST_PIVOT: f64 = 1e-3;

/// The whole window: what it gives, and what it takes to leave samples out.
#[derive(Debug)]
pub struct Whole {
    window_length: usize,
    kept: Range<usize>,
    degree: usize,
    size: usize,
    sheet: Sheet,
    /// `sqrt(W) Q`, one column of blocks after another.
    functionals: Vec<Block>,
    /// The rows of Q, if they are no longer than a block.
    rows: Vec<Block>,
    /// `Q^T W Q`: the square of the norm of the weights with coefficients `g` is `g . (Q^T W Q) g`.
    spread: Vec<f64>,
}

/// The fit at one point of the whole window.
#[derive(Debug, Default, Clone)]
pub struct Aim {
    u: f64,
    values: Vec<f64>,
    /// `q_m^(n)(u)`, for one order after another.
    moments: Vec<f64>,
    /// The squares of the norms of the weights, for every order.
    gains: Vec<f64>,
}

impl Aim {
    /// The noise gain of the whole window, for T = 2 and the order number `index`.
    pub(crate) fn gain(&self, index: usize) -> f64 {
        self.gains[index]
    }
}

impl Whole {
    /// The window of `window_length` cells of which the samples `kept` have a weight.
    pub fn new(model: &Model, window_length: usize, kept: Range<usize>) -> Result<Self, Error> {
        let (span, size, length) = (kept.len(), model.top() + 1, window_length as f64);
        let mut places = try_vec(span, 0.0)?;
        places.iter_mut().zip(kept.start..).for_each(|(s, j)| *s = (j as f64 + 0.5) / length);
        let mut sheet = Sheet::default();
        // Where the window is too short for the bias, the rest of it is still good.
        sheet.lay(model, &places, 0.0, 1.0, 0.5 / length)?;
        let blocks = sheet.blocks();
        let complete = sheet.orthonormalise();
        if !complete {
            sheet.prepare(span, model.widest())?;
            if !sheet.orthonormalise() {
                return Err(Error::argument(
                    "window_length",
                    window_length,
                    "such that degree + 1 samples have a weight",
                ));
            }
        }
        let size = if complete { size } else { model.widest() + 1 };
        let mut functionals = try_vec(blocks.saturating_mul(size), [0.0; SIDE])?;
        for (m, column) in functionals.chunks_exact_mut(blocks).enumerate() {
            for ((to, q), root) in column.iter_mut().zip(sheet.column(m)).zip(sheet.root()) {
                to.iter_mut().zip(q.iter().zip(root)).for_each(|(to, (q, root))| *to = q * root);
            }
        }
        let mut rows = Vec::new();
        if size <= SIDE {
            rows = try_vec(span, [0.0; SIDE])?;
            for m in 0..size {
                rows.iter_mut().zip(sheet.column(m).as_flattened()).for_each(|(row, value)| row[m] = *value);
            }
        }
        let arch = Arch::new();
        let mut spread = vec![0.0; size * size];
        for (m, row) in spread.chunks_exact_mut(size).enumerate() {
            for (k, value) in row.iter_mut().enumerate() {
                [*value] = dots(arch, &functionals[m * blocks..][..blocks], [&functionals[k * blocks..][..blocks]]);
            }
        }
        let degree = model.degree;
        Ok(Self { window_length, kept, degree, size, sheet, functionals, rows, spread })
    }

    /// Samples that have a weight.
    #[must_use]
    pub fn span(&self) -> usize {
        self.kept.len()
    }

    /// Square roots of the weights.
    fn root(&self) -> &[f64] {
        &self.sheet.root().as_flattened()[..self.span()]
    }

    /// Samples of the nominal window.
    #[must_use]
    pub fn window_length(&self) -> usize {
        self.window_length
    }

    /// The place on [0, 1] of `position`, in samples from the oldest that has a weight.
    #[must_use]
    pub fn place(&self, position: f64) -> f64 {
        (position + self.kept.start as f64 + 0.5) / self.window_length as f64
    }

    /// Whether the fit reaches the degree by which the bias is judged.
    pub(crate) fn reaches(&self, beyond: usize) -> bool {
        self.size > beyond
    }

    /// Whether samples can be left out of it.
    pub(crate) fn refits(&self) -> bool {
        !self.rows.is_empty()
    }

    /// Makes `aim` that of the point `u`, unless it is already.
    pub(crate) fn aim(&self, model: &Model, u: f64, aim: &mut Aim) -> Result<(), Error> {
        if !aim.gains.is_empty() && aim.u == u {
            return Ok(());
        }
        self.sheet.derive(u, model.highest(), &mut aim.values)?;
        aim.u = u;
        aim.moments.clear();
        aim.gains.clear();
        for &order in &model.orders {
            let moments = &aim.values[order * self.size..][..self.size];
            aim.moments.extend_from_slice(moments);
            aim.gains.push(self.gain(&moments[..=self.degree]));
        }
        Ok(())
    }

    /// The squares of the norms of the whole window's weights, for T = 1: for every order the estimates at all `positions`, as if
    /// they were where the window should be, or by the fit of the plain degree.
    pub fn gains(&self, model: &Model, positions: &[f64], ideal: bool, out: &mut [f64]) -> Result<(), Error> {
        let mut values = Vec::new();
        for (k, &position) in positions.iter().enumerate() {
            self.sheet.derive(2.0 * self.place(position) - 1.0, model.highest(), &mut values)?;
            let orders = model.orders.iter().zip(out.chunks_mut(positions.len()));
            for (index, (order, out)) in orders.enumerate() {
                let degree = model.degree_of(index, ideal);
                out[k] = self.gain(&values[order * self.size..][..=degree]) * 4.0_f64.powi(*order as i32);
            }
        }
        Ok(())
    }

    /// The square of the norm of the weights with the coefficients `g`.
    fn gain(&self, g: &[f64]) -> f64 {
        let rows = self.spread.chunks_exact(self.size).zip(g);
        rows.map(|(row, value)| value * row.iter().zip(g).map(|(s, g)| s * g).sum::<f64>()).sum()
    }

    /// `Q^T sqrt(W) x` of the samples `z`, those missing being 0, and the factors of G without the samples `missing`; false if
    /// too little is left of the window.
    pub(crate) fn without(&self, missing: &[usize], z: &[Block], refit: &mut Refit) -> bool {
        let (size, blocks) = (self.size, self.sheet.blocks());
        refit.g = [[0.0; SIDE]; SIDE];
        refit.g.iter_mut().enumerate().for_each(|(m, row)| row[m] = 1.0);
        for &j in missing {
            let q = &self.rows[j];
            for (row, factor) in refit.g.iter_mut().zip(q) {
                row.iter_mut().zip(q).for_each(|(value, q)| *value -= factor * q);
            }
        }
        for (sum, column) in refit.sums.iter_mut().zip(self.functionals.chunks_exact(blocks)) {
            [*sum] = dots(refit.arch, column, [z]);
        }
        refit.factorise(size)
    }

    /// The estimate of the order number `index` by the fit of the degree `size - 1`.
    pub(crate) fn estimate(&self, aim: &Aim, index: usize, size: usize, refit: &mut Refit) -> f64 {
        refit.solve(&aim.moments[index * self.size..][..size]);
        refit.solution[..size].iter().zip(&refit.sums).map(|(g, sum)| g * sum).sum()
    }

    /// The square of the norm of the weights of the last estimate.
    pub(crate) fn refitted_gain(&self, missing: &[usize], refit: &Refit) -> f64 {
        let (g, root) = (&refit.solution, self.root());
        let left_out: f64 = missing
            .iter()
            .map(|&j| {
                let weight = root[j] * self.rows[j].iter().zip(g).map(|(q, g)| q * g).sum::<f64>();
                weight * weight
            })
            .sum();
        self.gain(&g[..self.size]) - left_out
    }

    /// The weights themselves of the last estimate.
    pub(crate) fn refitted_weights(&self, missing: &[usize], refit: &Refit, weights: &mut [Block]) {
        weights.fill([0.0; SIDE]);
        for (g, column) in refit.solution.iter().zip(self.functionals.chunks_exact(self.sheet.blocks())) {
            for (weights, column) in weights.iter_mut().zip(column) {
                weights.iter_mut().zip(column).for_each(|(weight, value)| *weight += g * value);
            }
        }
        missing.iter().for_each(|&j| weights.as_flattened_mut()[j] = 0.0);
    }
}

/// The small system of one window: a thread's own memory.
#[derive(Debug, Default)]
pub struct Refit {
    /// G, and then its Cholesky factor in the lower triangle, with the inverse pivots on the diagonal.
    g: [Block; SIDE],
    sums: Block,
    solution: Block,
    arch: Arch,
}

impl Refit {
    fn factorise(&mut self, size: usize) -> bool {
        for i in 0..size {
            for j in 0..=i {
                let (above, below) = self.g.split_at_mut(i);
                let row = &mut below[0];
                let mut value = row[j];
                if j < i {
                    value -= row[..j].iter().zip(&above[j][..j]).map(|(a, b)| a * b).sum::<f64>();
                    row[j] = value * above[j][j];
                } else {
                    value -= row[..j].iter().map(|a| a * a).sum::<f64>();
                    if value.is_nan() || value <= SMALLEST_PIVOT {
                        return false;
                    }
                    row[j] = 1.0 / value.sqrt();
                }
            }
        }
        true
    }

    /// Solves for `g`; a shorter right side is one of the leading system, of a fit of a lower degree.
    fn solve(&mut self, right: &[f64]) {
        let size = right.len();
        self.solution = [0.0; SIDE];
        for (i, value) in right.iter().enumerate() {
            let row = &self.g[i];
            let sum: f64 = row[..i].iter().zip(&self.solution).map(|(a, b)| a * b).sum();
            self.solution[i] = (value - sum) * row[i];
        }
        for i in (0..size).rev() {
            let sum: f64 = (i + 1..size).map(|k| self.g[k][i] * self.solution[k]).sum();
            self.solution[i] = (self.solution[i] - sum) * self.g[i][i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jacobi::Jacobi;

    /// The fit without the missing samples, anew.
    fn anew(whole: &Whole, model: &Model, missing: &[usize], u: f64) -> Vec<Vec<f64>> {
        let mut sheet = Sheet::default();
        sheet.prepare(whole.span(), model.degree).expect("small");
        sheet.places.copy_from_slice(&whole.sheet.places);
        sheet.weights.copy_from_slice(&whole.sheet.weights);
        missing.iter().for_each(|&k| sheet.weights.as_flattened_mut()[k] = 0.0);
        assert!(sheet.orthonormalise());
        let mut values = Vec::new();
        sheet.derive(u, model.highest(), &mut values).expect("small");
        let mut weights = vec![[0.0; SIDE]; sheet.blocks()];
        let of_order = |order: &usize| {
            sheet.weigh(0, &values[order * sheet.size()..][..sheet.size()], &mut weights);
            weights.as_flattened()[..whole.span()].to_vec()
        };
        model.orders.iter().map(of_order).collect()
    }

    #[test]
    fn samples_are_left_out_as_if_they_had_never_been() {
        let family = Jacobi { alpha: 1.0, beta: 0.5 };
        for (window_length, degree, missing) in
            [(9, 2, vec![0, 4]), (21, 3, vec![2, 3, 4, 17]), (61, 5, (20..40).collect())]
        {
            let model = Model { family, degree, whole: vec![degree; 3], beyond: degree + 1, orders: vec![0, 1, 2] };
            let whole = Whole::new(&model, window_length, 0..window_length).expect("fits");
            let z: Vec<f64> =
                (0..window_length).map(|k| if missing.contains(&k) { 0.0 } else { (0.7 * k as f64).sin() }).collect();
            let mut blocks = vec![[0.0; SIDE]; window_length.div_ceil(SIDE)];
            blocks.as_flattened_mut()[..window_length].copy_from_slice(&z);
            let (mut aim, mut refit, u) = (Aim::default(), Refit::default(), 0.1);
            whole.aim(&model, u, &mut aim).expect("small");
            assert!(whole.without(&missing, &blocks, &mut refit));
            for (index, weights) in anew(&whole, &model, &missing, u).iter().enumerate() {
                let wanted: f64 = weights.iter().zip(&z).map(|(w, z)| w * z).sum();
                let size: f64 = weights.iter().map(|w| w.abs()).sum();
                let estimate = whole.estimate(&aim, index, degree + 1, &mut refit);
                assert!((estimate - wanted).abs() < 1e-12 * size, "{window_length} {index}: {estimate} {wanted}");
                let gain: f64 = weights.iter().map(|w| w * w).sum();
                assert!((whole.refitted_gain(&missing, &refit) - gain).abs() < 1e-11 * gain);
                let mut own = vec![[0.0; SIDE]; blocks.len()];
                whole.refitted_weights(&missing, &refit, &mut own);
                let far = own.as_flattened().iter().zip(weights).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(far < 1e-12 * size);
            }
        }
    }

    #[test]
    fn too_many_missing_samples_are_noticed() {
        let model =
            Model { family: Jacobi { alpha: 0.0, beta: 0.0 }, degree: 3, whole: vec![3], beyond: 3, orders: vec![1] };
        let whole = Whole::new(&model, 11, 0..11).expect("fits");
        let missing: Vec<usize> = (3..11).collect();
        assert!(!whole.without(&missing, &[[0.0; SIDE]; 2], &mut Refit::default()));
    }
}
