//! One weighted fit on the samples that are there, wherever they lie.
//!
//! The samples of a window at the places `s_j` have the weights `W_j`, the Jacobi weight at their places times their own; a
//! missing sample has none. Polynomials `q_m` orthonormal on these very samples come from the recurrence
//! `h_{m+1} q_{m+1} = u q_m - sum of h_{mk} q_k` with `u = 2 s - 1`, orthogonalised twice (Arnoldi's process on the Vandermonde matrix;
//! Brubeck, Nakatsukasa and Trefethen, SIAM Review 63, 2021): no monomials and no normal equations, so that clustered samples
//! cost no digits that the data have. The estimate of order `n` at `u` is `sum over j of w_j x_j` with
//! `w_j = W_j sum over m of q_m^(n)(u) q_m(s_j)`, and the same recurrence, differentiated, gives `q_m^(n)(u)`.

#![expect(clippy::indexing_slicing, reason = "windows lie in their rows, and levels are numbered among those given")]

mod kernels;

use pulp::Arch;

use crate::error::{Error, at_least};
use crate::jacobi::{Jacobi, ln_power};
use kernels::{Lay, Orthonormalise, Weigh};
pub(crate) use kernels::{dots, load, reciprocal, store};

/// Samples that are worked on side by side.
pub(crate) const SIDE: usize = 8;

/// [`SIDE`] numbers, one for every sample.
pub(crate) type Block = [f64; SIDE];

/// A polynomial whose norm on the samples is below this share of that of `u` times the one before is zero on them but for
/// rounding: there are too few samples for its degree.
pub(crate) const VANISHES: f64 = 1e-14;

/// Exponents up to this one are powers, not logarithms.
const POWERS: f64 = 8.0;

/// What is fitted, and what is asked of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The weight's exponents.
    pub family: Jacobi,
    /// Degree of the fit.
    pub degree: usize,
    /// For every order, the degree of the fit to a window of even samples that is whole and where it should be: at a root one
    /// more.
    pub whole: Vec<usize>,
    /// Degree of a second fit by whose difference the bias is judged; no higher than the others for none.
    pub beyond: usize,
    /// Orders of the derivatives.
    pub orders: Vec<usize>,
}

impl Model {
    /// The Jacobi weight at the places, up to a factor, into `base`; `half` is half the width of the cell of a sample, over
    /// which negative exponents are averaged.
    pub(crate) fn base(&self, places: &[f64], half: f64, base: &mut [f64]) {
        let Jacobi { alpha, beta } = self.family;
        if alpha.max(beta) <= POWERS {
            base.fill(1.0);
            multiply_by_power(base, places, half, alpha, |s| s);
            multiply_by_power(base, places, half, beta, |s| 1.0 - s);
            return;
        }
        let mut peak = f64::NEG_INFINITY;
        for (weight, &s) in base.iter_mut().zip(places) {
            *weight = ln_cell(s, half, alpha) + ln_cell(1.0 - s, half, beta);
            peak = peak.max(*weight);
        }
        base.iter_mut().for_each(|weight| *weight = (*weight - peak).exp());
    }

    /// Whether the weights are products of few factors.
    pub(crate) fn whole_exponents(&self) -> bool {
        [self.family.alpha, self.family.beta]
            .iter()
            .all(|exponent| exponent.fract() == 0.0 && (0.0..=POWERS).contains(exponent))
    }

    /// The highest degree.
    pub(crate) fn top(&self) -> usize {
        self.beyond.max(self.widest())
    }

    /// The highest degree without the second fit.
    pub(crate) fn widest(&self) -> usize {
        self.whole.iter().copied().fold(self.degree, usize::max)
    }

    /// The degree of the fit of the order number `index`, to a window that is whole and where it should be or to another.
    pub(crate) fn degree_of(&self, index: usize, ideal: bool) -> usize {
        if ideal { self.whole[index] } else { self.degree }
    }

    /// The highest order.
    pub(crate) fn highest(&self) -> usize {
        self.orders.iter().copied().max().unwrap_or(0)
    }
}

/// Multiplies by `from_end(s)^exponent`, or for a negative exponent by its mean over the cell around `s`, as far as that lies in
/// the window.
fn multiply_by_power(base: &mut [f64], places: &[f64], half: f64, exponent: f64, from_end: impl Fn(f64) -> f64) {
    let ends = base.iter_mut().zip(places.iter().map(|&s| from_end(s)));
    if exponent < 0.0 {
        ends.for_each(|(weight, s)| *weight *= ln_cell(s, half, exponent).exp());
    } else if exponent.fract() == 0.0 {
        ends.for_each(|(weight, s)| *weight *= s.max(0.0).powi(exponent as i32));
    } else {
        ends.for_each(|(weight, s)| *weight *= s.max(0.0).powf(exponent));
    }
}

fn ln_cell(s: f64, half: f64, exponent: f64) -> f64 {
    if exponent >= 0.0 {
        return ln_power(s.max(0.0), exponent);
    }
    // Rounding must not leave a sliver between the first cell and the end.
    let low = if s - half < 1e-9 * half { 0.0 } else { s - half };
    let high = s + half;
    let power = exponent + 1.0;
    ((high.powf(power) - low.powf(power)) / (power * (high - low))).ln()
}

/// The samples of one window and what was found of them: a thread's own memory.
#[derive(Debug, Default)]
pub(crate) struct Sheet {
    blocks: usize,
    /// `u` of the samples, 0 in the padding.
    pub places: Vec<Block>,
    /// The weights, 0 where there is no sample.
    pub weights: Vec<Block>,
    /// Their square roots.
    root: Vec<Block>,
    /// `sqrt(W) q_m`, one column of blocks after another.
    basis: Vec<Block>,
    /// `h`, row by row, and the norms `h_{m+1}`.
    recurrence: Vec<f64>,
    norms: Vec<f64>,
    /// What the first orthogonalisation leaves.
    rest: Vec<f64>,
    degree: usize,
    arch: Arch,
}

impl Sheet {
    /// Makes room for `samples` samples and polynomials up to `degree`.
    pub fn prepare(&mut self, samples: usize, degree: usize) -> Result<(), Error> {
        (self.blocks, self.degree) = (samples.div_ceil(SIDE), degree);
        let size = degree + 1;
        at_least(&mut self.places, self.blocks)?;
        at_least(&mut self.weights, self.blocks)?;
        at_least(&mut self.root, self.blocks)?;
        at_least(&mut self.basis, self.blocks.saturating_mul(size))?;
        at_least(&mut self.recurrence, size * size)?;
        at_least(&mut self.norms, size)?;
        at_least(&mut self.rest, size)?;
        for column in [&mut self.places, &mut self.weights] {
            column[..self.blocks].as_flattened_mut()[samples..].fill(0.0);
        }
        Ok(())
    }

    /// Puts the samples of a window at the places `(times - origin) factor`, with the model's weights; `half` is half the width of
    /// the cell of a sample.
    pub fn lay(&mut self, model: &Model, times: &[f64], origin: f64, factor: f64, half: f64) -> Result<(), Error> {
        self.prepare(times.len(), model.top())?;
        let Jacobi { alpha, beta } = model.family;
        let (places, weights) = (&mut self.places[..self.blocks], &mut self.weights[..self.blocks]);
        if model.whole_exponents() {
            let exponents = [alpha as usize, beta as usize];
            self.arch.dispatch(Lay { times, origin, factor, exponents, places, weights });
        } else {
            let places = &mut places.as_flattened_mut()[..times.len()];
            places.iter_mut().zip(times).for_each(|(s, t)| *s = (t - origin) * factor);
            model.base(places, half, &mut weights.as_flattened_mut()[..times.len()]);
            places.iter_mut().for_each(|s| *s = 2.0 * *s - 1.0);
        }
        self.weights[..self.blocks].as_flattened_mut()[times.len()..].fill(0.0);
        Ok(())
    }

    /// Square roots of the weights, once the polynomials are found.
    pub fn root(&self) -> &[Block] {
        &self.root[..self.blocks]
    }

    /// Polynomials.
    pub fn size(&self) -> usize {
        self.degree + 1
    }

    /// Blocks of samples.
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// `sqrt(W) q_m` on the samples.
    pub fn column(&self, m: usize) -> &[Block] {
        &self.basis[m * self.blocks..][..self.blocks]
    }

    /// Finds the orthonormal polynomials; false if there are too few samples for the degree.
    pub fn orthonormalise(&mut self) -> bool {
        let arch = self.arch;
        arch.dispatch(Orthonormalise(self))
    }

    /// The polynomials' values and derivatives at `u`, up to the order `highest`: `values[order * size + m]` is
    /// `q_m^(order)(u)`, with `size` the degree plus one.
    pub fn derive(&self, u: f64, highest: usize, values: &mut Vec<f64>) -> Result<(), Error> {
        let size = self.degree + 1;
        at_least(values, size * (highest + 1))?;
        for order in 0..=highest {
            let (below, row) = values.split_at_mut(order * size);
            let below = below.get(below.len().saturating_sub(size)..).unwrap_or_default();
            row[0] = if order == 0 { 1.0 / self.norms[0] } else { 0.0 };
            for m in 0..self.degree {
                let h = &self.recurrence[m * size..][..=m];
                let mut next = u * row[m] - h.iter().zip(&*row).map(|(h, value)| h * value).sum::<f64>();
                if let Some(lower) = below.get(m) {
                    next += order as f64 * lower;
                }
                row[m + 1] = next / self.norms[m + 1];
            }
        }
        Ok(())
    }

    /// The weights of the samples in an estimate with these moments, from the one with `moments[0] = q_first^(n)(u)` on.
    pub fn weigh(&self, first: usize, moments: &[f64], weights: &mut [Block]) {
        self.arch.dispatch(Weigh { sheet: self, first, moments, weights });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet with the weight `s (1 - s)` on these places.
    fn sheet(places: &[f64], degree: usize) -> Sheet {
        let mut sheet = Sheet::default();
        sheet.prepare(places.len(), degree).expect("small");
        let model = Model {
            family: Jacobi { alpha: 1.0, beta: 1.0 },
            degree,
            whole: vec![degree],
            beyond: degree,
            orders: vec![0],
        };
        let mut base = vec![0.0; places.len()];
        model.base(places, 0.0, &mut base);
        for (k, (s, weight)) in places.iter().zip(base).enumerate() {
            sheet.places.as_flattened_mut()[k] = 2.0 * s - 1.0;
            sheet.weights.as_flattened_mut()[k] = weight;
        }
        sheet
    }

    /// Places in clusters, all but the first two of which are much narrower than the window.
    fn clusters(count: usize) -> Vec<f64> {
        (0..count).map(|k| 0.1 + 0.2 * (k % 4) as f64 + 1e-3 * k as f64 + 1e-5 * ((k * k) % 17) as f64).collect()
    }

    #[test]
    fn polynomials_are_orthonormal_on_the_samples() {
        for (count, degree) in [(5, 4), (40, 3), (61, 12), (333, 30)] {
            let mut sheet = sheet(&clusters(count), degree);
            assert!(sheet.orthonormalise());
            for m in 0..=degree {
                for k in 0..=m {
                    let [product] = dots(Arch::new(), sheet.column(m), [sheet.column(k)]);
                    let wanted = if m == k { 1.0 } else { 0.0 };
                    assert!((product - wanted).abs() < 1e-14, "{count} {degree}: {m} {k} {product}");
                }
            }
        }
    }

    #[test]
    fn weights_differentiate_polynomials_and_values_are_those_on_the_samples() {
        let places = clusters(50);
        let mut sheet = sheet(&places, 4);
        assert!(sheet.orthonormalise());
        let mut values = Vec::new();
        sheet.derive(2.0 * places[7] - 1.0, 2, &mut values).expect("small");
        for (m, value) in values.iter().enumerate().take(5) {
            let on_sample = sheet.column(m).as_flattened()[7] / sheet.root().as_flattened()[7];
            assert!((value - on_sample).abs() < 1e-12 * on_sample.abs().max(1.0));
        }
        let u = 0.3;
        sheet.derive(u, 2, &mut values).expect("small");
        let mut weights = vec![[0.0; SIDE]; sheet.blocks()];
        for order in 0..=2 {
            sheet.weigh(0, &values[order * 5..][..5], &mut weights);
            let size: f64 = weights.as_flattened().iter().map(|w| w.abs()).sum();
            for power in 0..=4_i32 {
                let estimate: f64 =
                    weights.as_flattened().iter().zip(&places).map(|(w, s)| w * (2.0 * s - 1.0).powi(power)).sum();
                let falling: f64 = (0..order as i32).map(|r| f64::from(power - r)).product();
                let wanted = if power < order as i32 { 0.0 } else { falling * u.powi(power - order as i32) };
                assert!((estimate - wanted).abs() < 1e-14 * size, "{order} {power}: {estimate} {wanted}");
            }
        }
    }

    #[test]
    fn too_few_samples_are_noticed() {
        let mut few = sheet(&[0.2, 0.4, 0.6], 3);
        assert!(!few.orthonormalise());
        let mut none = sheet(&[], 0);
        assert!(!none.orthonormalise());
    }

    #[test]
    fn weights_are_those_of_the_cells() {
        // Negative exponents are averaged over cells, and large ones do not underflow all together.
        let places: Vec<f64> = (0..10).map(|j| (f64::from(j) + 0.5) / 10.0).collect();
        let mut base = vec![0.0; 10];
        let model = |alpha, beta| Model {
            family: Jacobi { alpha, beta },
            degree: 1,
            whole: vec![1],
            beyond: 1,
            orders: vec![1],
        };
        model(-0.5, 0.0).base(&places, 0.05, &mut base);
        assert!((base[0] - 2.0 / 0.1_f64.sqrt()).abs() < 1e-12);
        model(3000.0, 3000.0).base(&places, 0.05, &mut base);
        assert!((base[4] - 1.0).abs() < 1e-12 && base[0] < 1e-300);
    }
}
