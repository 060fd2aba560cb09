//! Taps as polynomials, and polynomials in the bases of blocks.

#![expect(
    clippy::indexing_slicing,
    reason = "the first and the last tap exist: there are at least as many as a polynomial needs"
)]

use super::super::Taps;
use crate::error::{Error, try_vec};
use crate::jacobi::{Jacobi, Recurrence};

/// Moments of a block, at most: beyond, the basis costs more than the products that it saves.
pub const MOMENTS: usize = 12;

/// Taps, at least.
const SHORTEST: usize = 24;

/// Taps may differ from a polynomial by this much of the largest: the rounding of the weights themselves, which grows with
/// the window where they are sums.
fn allowed_residual(taps: usize) -> f64 {
    1e-14 + 8.0 * f64::EPSILON * (taps as f64).sqrt()
}

/// Taps without a jump, and the anchor that goes with them.
pub struct Smooth {
    pub taps: Vec<f64>,
    pub anchor: Option<usize>,
}

impl Smooth {
    /// Taps of a smoother jump by one at their anchor: with the newest sample as the anchor they are a polynomial.
    fn new(order: &Taps) -> Result<Self, Error> {
        let mut taps = try_vec(order.double.len(), 0.0)?;
        taps.copy_from_slice(&order.double);
        if let Some(anchor) = order.anchor {
            taps[anchor..].iter_mut().for_each(|tap| *tap -= 1.0 / order.scale);
        }
        let newest = taps.len();
        Ok(Self { taps, anchor: order.anchor.map(|_| newest) })
    }
}

/// The taps of every order with the polynomials that they are; none if one of them is not.
pub fn polynomials(orders: &[&Taps]) -> Result<Option<Vec<(Smooth, Polynomial)>>, Error> {
    let taps = orders.iter().map(|order| order.double.len()).min().unwrap_or(0);
    if taps < SHORTEST || orders.iter().any(|order| order.double.len() != taps) {
        return Ok(None);
    }
    let mut found = Vec::new();
    for order in orders {
        let smooth = Smooth::new(order)?;
        let Some(polynomial) = Polynomial::through(&smooth.taps)? else { return Ok(None) };
        found.push((smooth, polynomial));
    }
    Ok(Some(found))
}

/// The taps as a polynomial in their index, by the polynomials that are orthogonal on the indices.
pub struct Polynomial {
    pub coefficients: Vec<f64>,
    middle: f64,
    count: f64,
    pub residual: f64,
    /// Whether the last tap lies on it as well.
    pub to_the_end: bool,
}

impl Polynomial {
    /// The polynomial of the lowest degree through all taps but the first and the last, if there is one.
    fn through(taps: &[f64]) -> Result<Option<Self>, Error> {
        let inner = &taps[1..taps.len() - 1];
        let (middle, count) = (0.5 * (taps.len() - 1) as f64, inner.len() as f64);
        let mut found = Self { coefficients: Vec::new(), middle, count, residual: f64::INFINITY, to_the_end: false };
        let mut rest = try_vec(inner.len(), 0.0)?;
        rest.copy_from_slice(inner);
        let mut older = try_vec(inner.len(), 0.0)?;
        let mut newer = try_vec(inner.len(), 1.0)?;
        let allowed = allowed_residual(taps.len()) * inner.iter().fold(0.0, |peak: f64, tap| peak.max(tap.abs()));
        for degree in 0..MOMENTS.min(inner.len() / 2) {
            let norm: f64 = newer.iter().map(|p| p * p).sum();
            let coefficient = rest.iter().zip(&newer).map(|(r, p)| r * p).sum::<f64>() / norm;
            rest.iter_mut().zip(&newer).for_each(|(r, p)| *r -= coefficient * p);
            found.coefficients.push(coefficient);
            found.residual = rest.iter().fold(0.0, |peak: f64, r| peak.max(r.abs()));
            if found.residual <= allowed {
                let last = taps.len() - 1;
                found.to_the_end = (taps[last] - found.at(last as f64)).abs() <= allowed;
                return Ok(Some(found));
            }
            let factor = found.factor(degree);
            for (k, (older, newer)) in older.iter_mut().zip(&mut newer).enumerate() {
                let next = found.place(k as f64 + 1.0) * *newer - factor * *older;
                *older = std::mem::replace(newer, next);
            }
        }
        Ok(None)
    }

    fn place(&self, index: f64) -> f64 {
        2.0 * (index - self.middle) / self.count
    }

    /// The recurrence's factor of the polynomial before: `p_(d+1) = u p_d - factor p_(d-1)`.
    fn factor(&self, degree: usize) -> f64 {
        let square = (degree * degree) as f64;
        square * (1.0 - square / (self.count * self.count)) / (4.0 * square - 1.0)
    }

    fn at(&self, index: f64) -> f64 {
        let place = self.place(index);
        let (mut older, mut newer, mut sum) = (0.0, 1.0, 0.0);
        for (degree, coefficient) in self.coefficients.iter().enumerate() {
            sum += coefficient * newer;
            let next = place * newer - self.factor(degree) * older;
            older = std::mem::replace(&mut newer, next);
        }
        sum
    }
}

/// Legendre polynomials on [0, 1] of norm 1, and the Gauss rule that projects on them.
pub struct Legendre {
    recurrence: Recurrence,
    /// Nodes, and at each the polynomials times the node's weight.
    nodes: Vec<(f64, Vec<f64>)>,
    moments: usize,
}

impl Legendre {
    pub fn new(moments: usize) -> Self {
        let family = Jacobi { alpha: 0.0, beta: 0.0 };
        let recurrence = family.recurrence(moments - 1);
        let node = |(tau, weight): (f64, f64)| (tau, recurrence.values(tau).iter().map(|p| weight * p).collect());
        let nodes = family.gauss(moments).into_iter().map(node).collect();
        Self { recurrence, nodes, moments }
    }

    pub fn at(&self, tau: f64) -> Vec<f64> {
        self.recurrence.values(tau)
    }

    /// Appends the matrix of `W(offset + from tau - to tau')` in the polynomials of tau (rows: the samples) and tau'
    /// (columns: the outputs), its rows `stride` apart.
    pub fn matrix(
        &self,
        polynomial: &Polynomial,
        offset: f64,
        [from, to]: [f64; 2],
        stride: usize,
        to_end: &mut Vec<f64>,
    ) {
        let start = to_end.len();
        to_end.resize(start + self.moments * stride, 0.0);
        let mut half = vec![0.0; self.moments];
        for (sample, rows) in &self.nodes {
            half.fill(0.0);
            for (output, columns) in &self.nodes {
                let value = polynomial.at(offset + from * sample - to * output);
                half.iter_mut().zip(columns).for_each(|(half, column)| *half += value * column);
            }
            for (row, weight) in to_end[start..].chunks_mut(stride).zip(rows) {
                row.iter_mut().zip(&half).for_each(|(entry, half)| *entry += weight * half);
            }
        }
    }

    /// The polynomials of a group of `group` blocks on its block `block`: entry (d', d) is the part of `p_d'` of the block in
    /// `p_d` of the group.
    pub fn lift(&self, block: usize, group: usize) -> Vec<f64> {
        let mut matrix = vec![0.0; self.moments * self.moments];
        for (tau, parts) in &self.nodes {
            let whole = self.at((block as f64 + tau) / group as f64);
            for (row, part) in matrix.chunks_mut(self.moments).zip(parts) {
                row.iter_mut().zip(&whole).for_each(|(entry, value)| *entry += part * value);
            }
        }
        matrix
    }
}
