//! The fits of neighbouring windows side by side, one in every lane: the same process as in [`crate::local`], without its sums across
//! lanes, for which a single short window waits longer than it computes.

#![expect(clippy::indexing_slicing, reason = "a panel has its sizes as constants, and its samples are cut to them")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::{Arch, Simd, WithSimd};

use crate::error::{Error, at_least};
use crate::local::{Block, Model, SIDE, VANISHES, load, reciprocal, store};

/// Coefficients of a fit, at most.
pub(crate) const MOST: usize = 8;

/// Numbers of the windows of [`SIDE`] neighbouring estimates.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Lanes {
    /// When the windows begin.
    pub origin: Block,
    /// Reciprocals of their lengths.
    pub factor: Block,
    /// Where the estimates are, from -1 to 1.
    pub place: Block,
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub(crate) struct Panel {
    places: Vec<Block>,
    base: Vec<Block>,
    basis: Vec<Block>,
    /// Of every order the weights, sample by sample, and the sums of their squares.
    weights: Vec<Block>,
    pub gains: Vec<Block>,
    count: usize,
    arch: Arch,
}

impl Panel {
    /// The weights of `count` samples of windows of which each begins with the next of `times`; false if one of them is too hard
    /// for this.
    pub fn weigh(&mut self, model: &Model, times: &[f64], count: usize, lanes: Lanes) -> Result<bool, Error> {
        let (size, orders) = (model.degree + 1, model.orders.len());
        self.count = count;
        at_least(&mut self.places, count)?;
        at_least(&mut self.base, count)?;
        at_least(&mut self.basis, count * size)?;
        at_least(&mut self.weights, count * orders)?;
        at_least(&mut self.gains, orders)?;
        let exponents = [model.family.alpha as usize, model.family.beta as usize];
        let arch = self.arch;
        Ok(arch.dispatch(Weigh { panel: self, model, times, lanes, exponents }))
    }

    /// The estimates of the order number `index` from `samples`, of which each window begins with the next, less one number for
    /// each of them; and the sums of the squares of weights times `levels`.
    pub fn apply(&self, index: usize, samples: &[f64], levels: Option<&[f64]>, reference: &Block) -> (Block, Block) {
        let weights = &self.weights[index * self.count..][..self.count];
        let mut sums = ([0.0; SIDE], self.gains[index]);
        let (estimates, variances) = (&mut sums.0, &mut sums.1);
        self.arch.dispatch(Apply { weights, samples, levels, reference, estimates, variances });
        sums
    }
}

struct Weigh<'a> {
    panel: &'a mut Panel,
    model: &'a Model,
    times: &'a [f64],
    lanes: Lanes,
    exponents: [usize; 2],
}

impl WithSimd for Weigh<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { panel, model, times, lanes, exponents } = self;
        let width = size_of::<S::f64s>() / size_of::<f64>();
        let mut good = true;
        for first in (0..SIDE).step_by(width) {
            let mut group = Group::<S> {
                simd,
                first,
                width,
                places: &mut panel.places[..panel.count],
                base: &mut panel.base[..panel.count],
                basis: &mut panel.basis,
                h: [[simd.splat_f64s(0.0); MOST]; MOST],
                inverse: [simd.splat_f64s(0.0); MOST],
            };
            group.lay(times, &lanes, exponents);
            good &= group.orthonormalise(model.degree);
            let (weights, gains) = (&mut panel.weights, &mut panel.gains);
            group.weights(model, load::<S>(&lanes.place[first..]), weights, gains);
        }
        good
    }
}

/// As many windows as a register has lanes.
struct Group<'a, S: Simd> {
    simd: S,
    first: usize,
    width: usize,
    places: &'a mut [Block],
    base: &'a mut [Block],
    basis: &'a mut [Block],
    h: [[S::f64s; MOST]; MOST],
    /// Reciprocals of the norms.
    inverse: [S::f64s; MOST],
}

impl<S: Simd> Group<'_, S> {
    /// Places and weights.
    #[inline(always)]
    fn lay(&mut self, times: &[f64], lanes: &Lanes, [kappa, mu]: [usize; 2]) {
        let (simd, first) = (self.simd, self.first);
        let (origin, factor) = (load::<S>(&lanes.origin[first..]), load::<S>(&lanes.factor[first..]));
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        for (j, (u, base)) in self.places.iter_mut().zip(self.base.iter_mut()).enumerate() {
            let t = load::<S>(&times[first + j..]);
            let s = simd.mul_f64s(simd.sub_f64s(t, origin), factor);
            store::<S>(&mut u[first..], simd.sub_f64s(simd.add_f64s(s, s), one));
            let (s, rest) = (simd.max_f64s(s, zero), simd.max_f64s(simd.sub_f64s(one, s), zero));
            let mut product = one;
            for _ in 0..kappa {
                product = simd.mul_f64s(product, s);
            }
            for _ in 0..mu {
                product = simd.mul_f64s(product, rest);
            }
            store::<S>(&mut base[first..], product);
        }
    }

    #[inline(always)]
    fn orthonormalise(&mut self, degree: usize) -> bool {
        let (simd, first, count) = (self.simd, self.first, self.places.len());
        let mut mass = simd.splat_f64s(0.0);
        for base in &*self.base {
            mass = simd.add_f64s(mass, load::<S>(&base[first..]));
        }
        let mut good = true;
        self.inverse[0] = self.reciprocal_root(mass, &mut good);
        for q in &mut self.basis[..count] {
            store::<S>(&mut q[first..], self.inverse[0]);
        }
        for m in 0..degree {
            match m {
                0 => self.next::<1>(&mut good),
                1 => self.next::<2>(&mut good),
                2 => self.next::<3>(&mut good),
                3 => self.next::<4>(&mut good),
                4 => self.next::<5>(&mut good),
                5 => self.next::<6>(&mut good),
                _ => self.next::<7>(&mut good),
            }
        }
        good
    }

    /// The polynomial number `N` from those before.
    #[inline(always)]
    fn next<const N: usize>(&mut self, good: &mut bool) {
        let (simd, first, count) = (self.simd, self.first, self.places.len());
        let zero = simd.splat_f64s(0.0);
        let (done, rest) = self.basis.split_at_mut(N * count);
        let next = &mut rest[..count];
        let mut columns: [&[Block]; N] = [&[]; N];
        for n in 0..N {
            columns[n] = &done[n * count..][..count];
        }
        let mut along = zero;
        for j in 0..count {
            let q = load::<S>(&columns[N - 1][j][first..]);
            let value = simd.mul_f64s(q, load::<S>(&self.places[j][first..]));
            along = simd.mul_add_e_f64s(simd.mul_f64s(value, q), load::<S>(&self.base[j][first..]), along);
            store::<S>(&mut next[j][first..], value);
        }
        // The norm of the last one was `1 / inverse`, and what it shares with the one before it.
        let before = if N > 1 { reciprocal::<S>(self.inverse[N - 1]) } else { zero };
        let mut shares = [zero; N];
        for j in 0..count {
            let mut value = load::<S>(&next[j][first..]);
            value = simd.sub_f64s(value, simd.mul_f64s(along, load::<S>(&columns[N - 1][j][first..])));
            if N > 1 {
                value = simd.sub_f64s(value, simd.mul_f64s(before, load::<S>(&columns[N - 2][j][first..])));
            }
            store::<S>(&mut next[j][first..], value);
            let weighted = simd.mul_f64s(value, load::<S>(&self.base[j][first..]));
            for n in 0..N {
                shares[n] = simd.mul_add_e_f64s(weighted, load::<S>(&columns[n][j][first..]), shares[n]);
            }
        }
        let mut square = zero;
        for j in 0..count {
            let mut value = load::<S>(&next[j][first..]);
            for n in 0..N {
                value = simd.sub_f64s(value, simd.mul_f64s(shares[n], load::<S>(&columns[n][j][first..])));
            }
            square = simd.mul_add_e_f64s(simd.mul_f64s(value, value), load::<S>(&self.base[j][first..]), square);
            store::<S>(&mut next[j][first..], value);
        }
        let h = &mut self.h[N - 1];
        h[..N].copy_from_slice(&shares);
        h[N - 1] = simd.add_f64s(h[N - 1], along);
        if N > 1 {
            h[N - 2] = simd.add_f64s(h[N - 2], before);
        }
        let inverse = self.reciprocal_root(square, good);
        self.inverse[N] = inverse;
        for next in &mut self.basis[N * count..][..count] {
            let value = simd.mul_f64s(load::<S>(&next[first..]), inverse);
            store::<S>(&mut next[first..], value);
        }
    }

    /// The weights of every order, and the sums of their squares.
    #[inline(always)]
    fn weights(&self, model: &Model, u: S::f64s, weights: &mut [Block], gains: &mut [Block]) {
        let (simd, first, count, size) = (self.simd, self.first, self.places.len(), model.degree + 1);
        let zero = simd.splat_f64s(0.0);
        let mut values = [[zero; MOST]; MOST];
        for order in 0..=model.highest() {
            values[order][0] = if order == 0 { self.inverse[0] } else { zero };
            for m in 0..model.degree {
                let mut next = simd.mul_f64s(u, values[order][m]);
                for (h, value) in self.h[m].iter().zip(&values[order]).take(m + 1) {
                    next = simd.sub_f64s(next, simd.mul_f64s(*h, *value));
                }
                if order > 0 {
                    next = simd.mul_add_e_f64s(simd.splat_f64s(order as f64), values[order - 1][m], next);
                }
                values[order][m + 1] = simd.mul_f64s(next, self.inverse[m + 1]);
            }
        }
        for (index, &order) in model.orders.iter().enumerate() {
            let moments = &values[order];
            let mut gain = zero;
            for (j, weight) in weights[index * count..][..count].iter_mut().enumerate() {
                let mut sum = zero;
                for (m, moment) in moments.iter().enumerate().take(size) {
                    sum = simd.mul_add_e_f64s(*moment, load::<S>(&self.basis[m * count + j][first..]), sum);
                }
                let value = simd.mul_f64s(sum, load::<S>(&self.base[j][first..]));
                gain = simd.mul_add_e_f64s(value, value, gain);
                store::<S>(&mut weight[first..], value);
            }
            store::<S>(&mut gains[index][first..], gain);
        }
    }

    /// `1 / sqrt(square)`; not good if a polynomial vanishes on the samples of a window.
    #[inline(always)]
    fn reciprocal_root(&self, square: S::f64s, good: &mut bool) -> S::f64s {
        let root = self.simd.sqrt_f64s(square);
        let mut numbers = [1.0; SIDE];
        store::<S>(&mut numbers, root);
        for number in &numbers[..self.width] {
            *good &= *number > VANISHES && number.is_finite();
        }
        reciprocal::<S>(root)
    }
}

struct Apply<'a> {
    weights: &'a [Block],
    samples: &'a [f64],
    levels: Option<&'a [f64]>,
    reference: &'a Block,
    estimates: &'a mut Block,
    variances: &'a mut Block,
}

impl WithSimd for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { weights, samples, levels, reference, estimates, variances } = self;
        for first in (0..SIDE).step_by(size_of::<S::f64s>() / size_of::<f64>()) {
            let (reference, mut sum) = (load::<S>(&reference[first..]), simd.splat_f64s(0.0));
            for (j, weight) in weights.iter().enumerate() {
                let sample = simd.sub_f64s(load::<S>(&samples[first + j..]), reference);
                sum = simd.mul_add_e_f64s(load::<S>(&weight[first..]), sample, sum);
            }
            store::<S>(&mut estimates[first..], sum);
            let Some(levels) = levels else { continue };
            let mut sum = simd.splat_f64s(0.0);
            for (j, weight) in weights.iter().enumerate() {
                let share = simd.mul_f64s(load::<S>(&weight[first..]), load::<S>(&levels[first + j..]));
                sum = simd.mul_add_e_f64s(share, share, sum);
            }
            store::<S>(&mut variances[first..], sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jacobi::Jacobi;
    use crate::local::Sheet;

    #[test]
    fn weights_are_those_of_each_window_alone() {
        let times: Vec<f64> = (0..60).map(|k| f64::from(k) + 0.4 * (1.7 * f64::from(k)).sin()).collect();
        for (count, degree, orders) in [(7, 2, vec![1]), (30, 3, vec![0, 1, 2]), (50, 7, vec![2, 0])] {
            let family = Jacobi { alpha: 2.0, beta: 1.0 };
            let whole = vec![degree; orders.len()];
            let model = Model { family, degree, whole, beyond: degree, orders };
            let mut lanes = Lanes::default();
            for lane in 0..SIDE {
                let step = (times[lane + count - 1] - times[lane]) / (count - 1) as f64;
                (lanes.origin[lane], lanes.factor[lane]) = (times[lane] - 0.5 * step, 1.0 / (step * count as f64));
                lanes.place[lane] = 0.1 * lane as f64 - 0.3;
            }
            let mut panel = Panel::default();
            assert!(panel.weigh(&model, &times[..count + SIDE - 1], count, lanes).expect("small"));
            let levels: Vec<f64> = times.iter().map(|t| 1.0 + 0.01 * t).collect();
            for lane in 0..SIDE {
                let (mut sheet, mut values) = (Sheet::default(), Vec::new());
                let own = &times[lane..][..count];
                sheet.lay(&model, own, lanes.origin[lane], lanes.factor[lane], 0.0).expect("small");
                assert!(sheet.orthonormalise());
                sheet.derive(lanes.place[lane], model.highest(), &mut values).expect("small");
                let mut weights = vec![[0.0; SIDE]; sheet.blocks()];
                for (index, order) in model.orders.iter().enumerate() {
                    sheet.weigh(0, &values[order * sheet.size()..][..sheet.size()], &mut weights);
                    let alone = &weights.as_flattened()[..count];
                    let size: f64 = alone.iter().map(|w| w.abs()).sum();
                    for (j, weight) in alone.iter().enumerate() {
                        let beside = panel.weights[index * count + j][lane];
                        assert!((beside - weight).abs() < 1e-13 * size, "{count} {order} {lane}: {beside} {weight}");
                    }
                    let (estimates, variances) = panel.apply(index, &times, Some(&levels), &[3.0; SIDE]);
                    let wanted: f64 = alone.iter().zip(own).map(|(w, t)| w * (t - 3.0)).sum();
                    assert!((estimates[lane] - wanted).abs() < 1e-12 * size * 60.0);
                    let shares = alone.iter().zip(&levels[lane..]).map(|(w, level)| (w * level).powi(2));
                    assert!((variances[lane] - shares.sum::<f64>()).abs() < 1e-12 * size * size);
                }
            }
        }
    }

    #[test]
    fn a_window_that_is_too_hard_is_noticed() {
        let times = [0.0; 12];
        let model =
            Model { family: Jacobi { alpha: 1.0, beta: 1.0 }, degree: 3, whole: vec![3], beyond: 3, orders: vec![1] };
        assert!(!Panel::default().weigh(&model, &times, 5, Lanes::default()).expect("small"));
    }
}
