//! What is decided before the first sample: the degree, the blocks, and the tables.

use super::super::{Sample, Taps};
use super::polynomial::{Legendre, Polynomial, Smooth, polynomials};
use crate::error::{Error, try_vec};

/// Outputs that are computed together, whose windows end up to three samples beyond that of the first.
pub const TILE: usize = 4;

/// Samples that a tile reads beyond the end of its group.
pub const SPILL: usize = TILE;

/// The largest error bound, in units of eps, with which the engine is still offered.
const ALLOWED_BOUND: f64 = 1e5;

/// Blocks and groups of a window of `taps` taps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Taps of a window.
    pub taps: usize,
    /// Samples of a block.
    pub block: usize,
    /// Blocks of a group.
    pub group: usize,
    /// Moments of a block.
    pub moments: usize,
    /// Whole blocks after the first that every window of a block holds.
    pub whole: usize,
    /// Samples that the first window of a block holds beyond them: from 1 to `block`.
    pub reach: usize,
    /// Whole groups that every window of a group holds, where groups are used.
    pub groups: Option<usize>,
}

impl Shape {
    fn new(taps: usize, block: usize, group: usize, moments: usize, grouped: bool) -> Option<Self> {
        let whole = ((taps - 1) / block).checked_sub(1).filter(|whole| *whole > 0)?;
        let reach = taps - (whole + 1) * block;
        let groups =
            if grouped { Some((whole + 1).checked_sub(group)? / group).filter(|groups| *groups > 0) } else { None };
        (groups.is_some() == grouped).then_some(Self { taps, block, group, moments, whole, reach, groups })
    }

    /// The cheapest blocks and groups for these orders; none if their taps are no polynomials of a low degree, or too few.
    pub fn of(orders: &[&Taps]) -> Result<Option<Self>, Error> {
        Ok(polynomials(orders)?.and_then(|polynomials| Self::for_polynomials(&polynomials)))
    }

    fn for_polynomials(polynomials: &[(Smooth, Polynomial)]) -> Option<Self> {
        let moments = polynomials.iter().map(|(_, polynomial)| polynomial.coefficients.len()).max()?;
        Self::cheapest(polynomials.first()?.0.taps.len(), moments)
    }

    /// The cheapest blocks and groups.
    fn cheapest(taps: usize, moments: usize) -> Option<Self> {
        let sizes = |block: usize| [4, 8, 16, 32, 64, 128].into_iter().map(move |group| (block, group));
        let fits = |&(block, group): &(usize, usize)| {
            // A strip holds whole windows: long groups for long windows, short ones so that short rows fill the lanes.
            let length = block * group;
            (64..=8192).contains(&length) && (length <= 128 || length <= taps / 32) && taps / length <= 1250
        };
        [8, 16, 32, 64]
            .into_iter()
            .flat_map(sizes)
            .filter(fits)
            .flat_map(|(block, group)| [false, true].map(|grouped| Self::new(taps, block, group, moments, grouped)))
            .flatten()
            .min_by(|one, other| one.cost(1).total_cmp(&other.cost(1)))
    }

    /// Multiplications for one sample and `orders` orders, about.
    #[must_use]
    pub fn cost(&self, orders: usize) -> f64 {
        let (block, group, moments) = (self.block as f64, self.group as f64, self.moments as f64);
        let triangle = 0.5 * moments * (moments + 1.0) / block;
        let blocks = match self.groups {
            Some(groups) => group + 1.0 + groups as f64 / group,
            None => self.whole as f64 + self.reach as f64 / block,
        };
        let shared = moments + if self.groups.is_some() { triangle } else { 0.0 };
        shared + orders as f64 * (block + 4.0 + moments + triangle * blocks)
    }

    /// Samples of a group.
    #[must_use]
    pub fn group_length(&self) -> usize {
        self.block * self.group
    }

    /// Groups that the windows of one group reach beyond it.
    #[must_use]
    pub fn halo(&self) -> usize {
        (self.group + self.whole + 1) / self.group
    }

    /// How many blocks on every `C_l` is needed for, from block 1: near ones, and those around the far end.
    #[must_use]
    pub fn near(&self) -> usize {
        if self.groups.is_some() { self.group - 1 } else { self.whole + 1 }
    }

    /// The first of the far blocks, and how many.
    #[must_use]
    pub fn far(&self) -> (usize, usize) {
        if self.groups.is_some() { (self.whole + 2 - self.group, self.group) } else { (self.whole + 2, 0) }
    }
}

/// One order's taps and matrices.
#[derive(Debug)]
pub struct Order<T> {
    pub taps: Vec<T>,
    pub scale: f64,
    pub anchor: Option<usize>,
    /// `C_l` of the near blocks, then of the far ones; row d of a matrix is what moment d adds to the coefficients.
    pub blocks: Vec<T>,
    /// The same for groups.
    pub groups: Vec<T>,
}

/// What all orders share.
#[derive(Debug)]
pub struct Tables<T> {
    pub shape: Shape,
    pub orders: Vec<Order<T>>,
    /// `p_d` at the samples of a block: a row for every sample.
    pub basis: Vec<T>,
    /// The same, by tiles of outputs: `p_d` at the outputs of the tile, d after d.
    pub places: Vec<T>,
    /// For every block of a group: what its moment d' adds to the group's moment d, a row for every d'.
    pub lift: Vec<T>,
    /// For every block of a group: what the group's coefficient e adds to the block's e', a row for every e.
    pub restrict: Vec<T>,
    pub error_bound: f64,
}

impl<T: Sample> Tables<T> {
    /// None where the taps are no polynomials, or where their error could not be bounded well.
    pub fn new(orders: &[&Taps]) -> Result<Option<Self>, Error> {
        let Some(polynomials) = polynomials(orders)? else { return Ok(None) };
        let Some(shape) = Shape::for_polynomials(&polynomials) else { return Ok(None) };
        let moments = shape.moments;
        let legendre = Legendre::new(moments);
        let mut error_bound: f64 = 0.0;
        let mut built = Vec::new();
        for (order, (smooth, polynomial)) in orders.iter().zip(&polynomials) {
            let Smooth { taps, anchor } = smooth;
            let (far, count) = shape.far();
            let distances = (1..=shape.near()).chain(far..far + count);
            let blocks = legendre.matrices(polynomial, shape.block, distances)?;
            let groups =
                legendre.matrices(polynomial, shape.group_length(), 1..=shape.groups.map_or(0, |groups| groups + 1))?;
            error_bound = error_bound.max(bound(&shape, taps, polynomial.residual, &blocks, &groups));
            let (taps, blocks, groups) = (narrow(taps)?, narrow(&blocks)?, narrow(&groups)?);
            built.push(Order { taps, scale: order.scale, anchor: *anchor, blocks, groups });
        }
        if error_bound > ALLOWED_BOUND {
            return Ok(None);
        }
        let values: Vec<Vec<f64>> =
            (0..shape.block).map(|j| legendre.at((j as f64 + 0.5) / shape.block as f64)).collect();
        let tile = |tile: &[Vec<f64>]| -> Vec<f64> {
            (0..moments).flat_map(|d| tile.iter().map(move |p| p[d]).collect::<Vec<_>>()).collect()
        };
        let lift: Vec<f64> = (0..shape.group).flat_map(|block| legendre.lift(block, shape.group)).collect();
        let turned: Vec<f64> = lift
            .chunks(moments * moments)
            .flat_map(|matrix| (0..moments * moments).map(|at| matrix[at % moments * moments + at / moments]))
            .collect();
        Ok(Some(Self {
            shape,
            orders: built,
            basis: narrow(&values.concat())?,
            places: narrow(&values.chunks(TILE).flat_map(tile).collect::<Vec<_>>())?,
            lift: narrow(&lift)?,
            restrict: narrow(&turned)?,
            error_bound,
        }))
    }
}

fn narrow<T: Sample>(values: &[f64]) -> Result<Vec<T>, Error> {
    let mut narrow = try_vec(values.len(), T::default())?;
    narrow.iter_mut().zip(values).for_each(|(narrow, value)| *narrow = T::from_f64(*value));
    Ok(narrow)
}

/// The error of an output in units of eps, relative to `sum |W| max |s|`: every product at the two ends passes at most
/// `3 B` additions; what comes by moments passes the sums over a block, over a group, and over the blocks and groups of a
/// window, and is as large as the matrices say, because their polynomials are at most `sqrt(2 d + 1)`.
fn bound(shape: &Shape, taps: &[f64], residual: f64, blocks: &[f64], groups: &[f64]) -> f64 {
    let (block, group, moments) = (shape.block as f64, shape.group as f64, shape.moments as f64);
    let sum: f64 = taps.iter().map(|tap| tap.abs()).sum();
    let size = |matrices: &[f64], length: f64| {
        let norm = |at: usize| ((2 * at + 1) as f64).sqrt();
        let square = shape.moments * shape.moments;
        let entry =
            |(at, value): (usize, &f64)| value.abs() * norm(at % square / shape.moments) * norm(at % shape.moments);
        length * matrices.iter().enumerate().map(entry).sum::<f64>()
    };
    let terms =
        block + group + 4.0 * moments + shape.near() as f64 * moments + shape.groups.unwrap_or(0) as f64 * moments;
    let missed = residual * shape.taps as f64 / f64::EPSILON;
    3.0 * block + (missed + terms * (size(blocks, block) + size(groups, block * group))) / sum
}
