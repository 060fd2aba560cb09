//! How a continuous kernel becomes weights, and the classical rules among the ways.
//!
//! A quadrature rule is linear in the kernel, and so a set of functionals: it gives every basis polynomial `p_m` the weights
//! of `integral of rho p_m x`. Sampling rules take the integrand at the samples; "cell" and "hat" integrate the kernel
//! exactly against a signal that is constant on every cell, or linear between the nodes.

#![expect(clippy::indexing_slicing, reason = "only samples that are kept have a column")]

use std::ops::Range;

use crate::control::Control;
use crate::error::{Error, try_vec};
use crate::fit::Grid;
use crate::jacobi::{Jacobi, ln_beta, ln_power};

/// How the continuous kernel becomes weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Rule {
    /// Discrete weighted least squares on cells: every polynomial up to the exactness degree, at every window length.
    Exact,
    /// The trapezoidal rule on nodes, as in the source: leaks offsets, kept for reproduction.
    Trapezoid,
    /// The kernel at the middles of the cells.
    Midpoint,
    /// Simpson's rule on an odd number of nodes.
    Simpson,
    /// The integral of the kernel over every cell.
    Cell,
    /// The integral of the kernel times the piecewise linear function of every node.
    Hat,
}

/// The rules by their public names.
pub const RULES: [(&str, Rule); 6] = [
    ("exact", Rule::Exact),
    ("trapezoid", Rule::Trapezoid),
    ("midpoint", Rule::Midpoint),
    ("simpson", Rule::Simpson),
    ("cell", Rule::Cell),
    ("hat", Rule::Hat),
];

impl Rule {
    /// Where the samples lie.
    #[must_use]
    pub fn grid(self) -> Grid {
        match self {
            Self::Exact | Self::Midpoint | Self::Cell => Grid::Cells,
            Self::Trapezoid | Self::Simpson | Self::Hat => Grid::Nodes,
        }
    }

    /// Whether a constant signal comes out as it should, at any window length.
    #[must_use]
    pub fn keeps_constants(self) -> bool {
        matches!(self, Self::Exact | Self::Cell | Self::Hat)
    }

    fn name(self) -> &'static str {
        RULES.iter().find(|(_, rule)| *rule == self).map_or("", |(name, _)| name)
    }

    /// Refuses windows that are too short or even where they must be odd.
    pub(crate) fn check(self, window_length: usize, degree: usize) -> Result<(), Error> {
        let least = degree.saturating_add(1).max(if self.grid() == Grid::Nodes { 2 } else { 1 });
        if window_length < least {
            return Err(Error::argument("window_length", window_length, format!("at least degree + 1 = {least}")));
        }
        if self == Self::Simpson && window_length.is_multiple_of(2) {
            return Err(Error::argument("window_length", window_length, "odd with rule = 'simpson'"));
        }
        Ok(())
    }
}

/// `functionals[m][j]`: the weight of sample `kept.start + j` in the rule's `integral of rho p_m x`, for `m` up to `degree`.
pub(crate) fn functionals(
    rule: Rule,
    family: Jacobi,
    degree: usize,
    window_length: usize,
    kept: &Range<usize>,
    control: &impl Control,
) -> Result<Vec<Vec<f64>>, Error> {
    if matches!(rule, Rule::Trapezoid | Rule::Simpson) {
        for (name, exponent) in [("kappa", family.alpha), ("mu", family.beta)] {
            if exponent < 0.0 {
                let name_of_rule = rule.name();
                return Err(Error::argument(
                    name,
                    exponent,
                    format!(
                        "at least 0 with rule = '{name_of_rule}', which samples the singular end; use rule = 'exact'"
                    ),
                ));
            }
        }
    }
    let mut columns = Vec::new();
    for _ in 0..=degree {
        columns.push(try_vec(kept.len(), 0.0)?);
    }
    let recurrence = family.recurrence(degree);
    let mut add = |sample: usize, s: f64, mass: f64| {
        if kept.contains(&sample) {
            let row = columns.iter_mut().zip(recurrence.values(s));
            row.for_each(|(column, value)| column[sample - kept.start] += mass * value);
        }
    };
    let proceed = |j: usize| if j % 4096 == 4095 { control.check(0.0) } else { Ok(()) };
    if let Rule::Cell | Rule::Hat = rule {
        let cells = window_length - usize::from(rule == Rule::Hat);
        let pieces = Pieces::new(family, degree, cells);
        // The piecewise linear function of a node reaches into the cell before it.
        for cell in kept.start.saturating_sub(1)..kept.end.min(cells) {
            proceed(cell)?;
            pieces.visit(cell, |point| {
                if rule == Rule::Cell {
                    add(cell, point.s, point.mass);
                } else {
                    add(cell, point.s, point.mass * (1.0 - point.place));
                    add(cell + 1, point.s, point.mass * point.place);
                }
            });
        }
        return Ok(columns);
    }
    let (last, steps) = (window_length - 1, rule.grid().steps(window_length));
    let shift = if rule.grid() == Grid::Cells { 0.5 } else { 0.0 };
    for j in kept.clone() {
        proceed(j)?;
        let share = match rule {
            Rule::Trapezoid if j == 0 || j == last => 0.5,
            Rule::Simpson if j == 0 || j == last => 1.0 / 3.0,
            Rule::Simpson if j % 2 == 1 => 4.0 / 3.0,
            Rule::Simpson => 2.0 / 3.0,
            _ => 1.0,
        };
        let (s, rest) = ((j as f64 + shift) / steps, ((last - j) as f64 + shift) / steps);
        add(j, s, share / steps * family.ln_density(s, rest).exp());
    }
    Ok(columns)
}

/// A point of a cell: on [0, 1], its place in the cell, and the density's mass that it stands for.
struct Point {
    s: f64,
    place: f64,
    mass: f64,
}

/// Gauss rules on the cells of a window, each cut into as many pieces as a narrow density needs. The first and the last
/// piece have rules of their own, for the densities that are singular there.
struct Pieces {
    family: Jacobi,
    cells: usize,
    per_cell: usize,
    inner: Vec<(f64, f64)>,
    oldest: Vec<(f64, f64)>,
    newest: Vec<(f64, f64)>,
}

impl Pieces {
    fn new(family: Jacobi, degree: usize, cells: usize) -> Self {
        let Jacobi { alpha, beta } = family;
        // Over one piece the density changes by at most a factor of about e^4, and near an end p_m, which turns like
        // cos(2 m sqrt(s)), by a few periods.
        let per_cell = (((alpha.max(0.0) + beta.max(0.0)) / (4.0 * cells as f64)).ceil() as usize).max(1);
        let turns = (4.0 * degree as f64 / (cells as f64).sqrt()).ceil() as usize;
        let count = 14 + turns.min(degree / 2 + 1);
        let rule = |alpha, beta| Jacobi { alpha, beta }.gauss(count);
        let single = cells * per_cell == 1;
        let oldest = if single { family.gauss(count) } else { rule(alpha, 0.0) };
        Self { family, cells, per_cell, inner: rule(0.0, 0.0), oldest, newest: rule(0.0, beta) }
    }

    fn visit(&self, cell: usize, mut body: impl FnMut(Point)) {
        let Jacobi { alpha, beta } = self.family;
        let count = self.cells * self.per_cell;
        let total = count as f64;
        let ln_norm = ln_beta(alpha + 1.0, beta + 1.0);
        for piece in 0..self.per_cell {
            let index = cell * self.per_cell + piece;
            let (first, last) = (index == 0, index + 1 == count);
            let rule = if first {
                &self.oldest
            } else if last {
                &self.newest
            } else {
                &self.inner
            };
            for &(x, weight) in rule {
                let (s, rest) = ((index as f64 + x) / total, ((count - index) as f64 - x) / total);
                // The integral of `s^alpha` over the first piece is `total^-(alpha + 1) / (alpha + 1)`.
                let ln_piece = |exponent: f64| -(exponent + 1.0) * total.ln() - (exponent + 1.0).ln();
                let ln_mass = match (first, last) {
                    (true, true) => 0.0,
                    (true, false) => ln_piece(alpha) + ln_power(rest, beta) - ln_norm,
                    (false, true) => ln_piece(beta) + ln_power(s, alpha) - ln_norm,
                    (false, false) => ln_power(s, alpha) + ln_power(rest, beta) - ln_norm - total.ln(),
                };
                body(Point { s, place: (piece as f64 + x) / self.per_cell as f64, mass: weight * ln_mass.exp() });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;

    #[test]
    fn cells_and_hats_share_out_the_whole_integral() {
        // The functionals of p_0 = 1 sum to the mass of the density, those of p_1 to 0.
        for (alpha, beta) in [(0.0, 0.0), (-0.9, 0.3), (2.0, -0.5), (400.0, 30.0), (9000.0, 9000.0)] {
            for window_length in [2_usize, 3, 10, 501] {
                for rule in [Rule::Cell, Rule::Hat] {
                    let family = Jacobi { alpha, beta };
                    let columns =
                        functionals(rule, family, 1, window_length, &(0..window_length), &Unattended).expect("finite");
                    let sums: Vec<f64> = columns.iter().map(|column| column.iter().sum()).collect();
                    assert!((sums[0] - 1.0).abs() < 1e-11, "{alpha} {beta} {window_length} {rule:?} {sums:?}");
                    assert!(sums[1].abs() < 1e-11, "{alpha} {beta} {window_length} {rule:?} {sums:?}");
                }
            }
        }
    }
}
