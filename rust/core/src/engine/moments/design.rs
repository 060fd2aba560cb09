//! What is decided before the first sample: the degree, the blocks, and the tables.

#![expect(clippy::indexing_slicing, reason = "matrices have the sizes that the shape gives all of them")]

use super::super::buffer::Buffer;
use super::super::{Sample, Taps};
use super::polynomial::{Legendre, Polynomial, Smooth, polynomials};
use super::run::{FEW, STEP};
use crate::error::{Error, try_vec};

/// Samples of a block: as many outputs as are computed together in registers.
pub const BLOCKS: [usize; 2] = [16, 32];

/// The largest error bound, in units of eps, with which the engine is still offered.
const ALLOWED_BOUND: f64 = 1e5;

/// How far a polynomial of the taps' degree may grow, relative to the window, where a group reaches beyond it: what the sums
/// over parts of a group lose.
const GROWTH: f64 = 200.0;

/// What a product with a matrix of a group's tables costs for each of its multiplications, which wait for two loads: with
/// tables of up to so many bytes in the nearest cache beside the samples, and in the next one; and beyond.
const CACHES: [(usize, f64); 2] = [(32 << 10, 2.5), (512 << 10, 3.0)];
const BEYOND: f64 = 6.0;

/// What comes with every block, in multiplications.
const OVERHEAD: f64 = 28.0;

/// Blocks and groups of a window of `taps` taps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Taps of a window.
    pub taps: usize,
    /// Samples of a block.
    pub block: usize,
    /// Moments of a block.
    pub moments: usize,
    /// Whole blocks after the first that every window of a block holds.
    pub whole: usize,
    /// Samples that every window of a block holds beyond them: up to `block`, and one at least where the last tap stands alone.
    pub reach: usize,
    /// Blocks of a group, where groups are used.
    pub group: Option<usize>,
    /// Whole groups between the group of an output's block and that in which its whole blocks end, at most; ...
    pub between: usize,
    /// ... for blocks from this number on, and one less before.
    pub more: usize,
    /// Multiplications of registers of 64 bytes for one output: for all orders together, and for each.
    pub cost: (f64, f64),
}

/// How long windows are, and whether the last tap stands alone.
#[derive(Clone, Copy)]
struct Length {
    taps: usize,
    alone: bool,
}

impl Shape {
    fn new(length: Length, block: usize, moments: usize, group: Option<usize>, lanes: usize) -> Option<Self> {
        let Length { taps, alone } = length;
        let whole = ((taps - usize::from(alone)) / block).checked_sub(1)?;
        let reach = taps - (whole + 1) * block;
        let mut new = Self { taps, block, moments, whole, reach, group, between: 0, more: 0, cost: (0.0, 0.0) };
        if let Some(group) = group {
            if group > whole || growth(moments - 1, group, whole) > GROWTH {
                return None;
            }
            new.between = between(group, whole, group - 1);
            new.more = (0..group).find(|index| between(group, whole, *index) == new.between)?;
        }
        Some(Self { cost: new.cost(lanes), ..new })
    }

    /// The cheapest blocks and groups for these orders, in registers of `lanes` samples; none if their taps are no
    /// polynomials of a low degree, or too few.
    pub fn of(orders: &[&Taps], lanes: usize) -> Result<Option<Self>, Error> {
        Ok(polynomials(orders)?.and_then(|polynomials| Self::for_polynomials(&polynomials, lanes)))
    }

    fn for_polynomials(polynomials: &[(Smooth, Polynomial)], lanes: usize) -> Option<Self> {
        let moments = polynomials.iter().map(|(_, polynomial)| polynomial.coefficients.len()).max()?;
        let alone = !polynomials.iter().all(|(_, polynomial)| polynomial.to_the_end);
        let length = Length { taps: polynomials.first()?.0.taps.len(), alone };
        let groups = [None].into_iter().chain((STEP.trailing_zeros()..=11).map(|octave| Some(1 << octave)));
        groups
            .flat_map(|group| BLOCKS.map(|block| Self::new(length, block, moments, group, lanes)))
            .flatten()
            .min_by(|one, other| one.total().total_cmp(&other.total()))
    }

    fn total(&self) -> f64 {
        self.cost.0 + self.cost.1
    }

    fn cost(&self, lanes: usize) -> (f64, f64) {
        let lanes_of_line = lanes;
        let [block, moments, whole, lanes] = [self.block, self.moments, self.whole, lanes].map(|size| size as f64);
        let registers = (moments / lanes).ceil();
        let product = moments * registers / block;
        let overhead = OVERHEAD / block;
        let triangle = (block + self.reach as f64) / lanes;
        if self.whole == 0 {
            return (overhead, triangle);
        }
        let (shared, each) = match self.group {
            None => (0.0, product * whole),
            Some(group) => {
                let bytes = 64 * 4 * group * self.moments * self.moments.div_ceil(lanes_of_line);
                let far = CACHES.iter().find(|(size, _)| bytes <= *size).map_or(BEYOND, |(_, cost)| *cost);
                let groups = if self.between > 0 { 1.0 } else { 0.0 };
                (
                    far * product + 2.0 * registers / block,
                    far * product * (2.0 + groups + whole / (group * group) as f64),
                )
            }
        };
        (overhead + registers + shared, triangle + moments / lanes + each)
    }

    /// Elements of a block's moments where they fill registers.
    #[must_use]
    pub fn stride<T: Sample>(&self) -> usize {
        self.moments.next_multiple_of(T::LANES)
    }
}

/// Whole groups between the group of an output's block, its block `index`, and that in which its `whole` blocks end.
fn between(group: usize, whole: usize, index: usize) -> usize {
    (whole + 1 + index - group) / group
}

/// The largest value of a polynomial of degree `degree`, at most 1 on the window, where a group reaches beyond it.
fn growth(degree: usize, group: usize, whole: usize) -> f64 {
    (degree as f64 * (1.0 + 2.0 * group as f64 / whole as f64).acosh()).cosh()
}

/// One order's taps and matrices.
#[derive(Debug)]
pub struct Order<T> {
    pub taps: Buffer<T>,
    /// Taps of the outputs of a block, side by side: for the samples after the whole blocks that all windows hold, ...
    pub rest: Buffer<T>,
    /// ... and for sample k of the first block or, where the window starts after it, sample k after those.
    pub ring: Buffer<T>,
    pub scale: f64,
    pub anchor: Option<usize>,
    /// What the moments of blocks add to the coefficients of the outputs, a row for every moment. Without groups: the matrices
    /// of the blocks after the first. With groups: of those to the end of the group, for every block of it, a few together, ...
    pub near: Buffer<T>,
    /// ... of those from the start of the group in which the whole blocks end, likewise, ...
    pub far: Buffer<T>,
    /// ... and the matrices of the whole groups between, for outputs of a whole group.
    pub groups: Buffer<T>,
}

/// What all orders share.
#[derive(Debug)]
pub struct Tables<T> {
    pub shape: Shape,
    pub orders: Vec<Order<T>>,
    /// Elements of a row of a matrix.
    pub stride: usize,
    /// `p_d` at the samples of a block: a row for every sample.
    pub basis: Buffer<T>,
    /// The same, a row for every d.
    pub places: Buffer<T>,
    /// For every block of a group: what its moment d' adds to the group's moment d, a row for every d'; a few
    /// together, as the whole blocks end in them.
    pub lift: Buffer<T>,
    /// For every block of a group: what the group's coefficient e adds to the block's e', a row for every e; a few together.
    pub restrict: Buffer<T>,
    pub error_bound: f64,
}

impl<T: Sample> Tables<T> {
    /// None where the taps are no polynomials, or where their error could not be bounded well.
    pub fn new(orders: &[&Taps]) -> Result<Option<Self>, Error> {
        let Some(polynomials) = polynomials(orders)? else { return Ok(None) };
        let Some(shape) = Shape::for_polynomials(&polynomials, T::LANES) else { return Ok(None) };
        let (moments, stride, block) = (shape.moments, shape.stride::<T>(), shape.block);
        let legendre = Legendre::new(moments);
        let mut error_bound: f64 = 0.0;
        let mut built = Vec::new();
        for (order, (smooth, polynomial)) in orders.iter().zip(&polynomials) {
            let matrices = Matrices::new(&shape, &legendre, polynomial, stride)?;
            let sum: f64 = smooth.taps.iter().map(|tap| tap.abs()).sum();
            let missed = polynomial.residual * shape.taps as f64 / f64::EPSILON;
            error_bound = error_bound.max(3.0 * block as f64 + (missed + matrices.bound) / sum);
            built.push(matrices.order(&shape, order, smooth)?);
        }
        if error_bound > ALLOWED_BOUND {
            return Ok(None);
        }
        let values: Vec<Vec<f64>> = (0..block).map(|j| legendre.at((j as f64 + 0.5) / block as f64)).collect();
        let places: Vec<f64> = (0..moments).flat_map(|d| values.iter().map(move |p| p[d])).collect();
        let group = shape.group.unwrap_or(0);
        let lift: Vec<Vec<f64>> = (0..group).map(|index| legendre.lift(index, group)).collect();
        let turned = |matrix: &Vec<f64>| -> Vec<f64> {
            (0..moments * moments).map(|at| matrix[at % moments * moments + at / moments]).collect()
        };
        let restrict: Vec<Vec<f64>> = lift.iter().map(turned).collect();
        Ok(Some(Self {
            shape,
            orders: built,
            stride,
            basis: narrow(&padded(&values.concat(), moments, stride))?,
            places: narrow(&places)?,
            lift: narrow(&by_few(&padded(&lift.concat(), moments, stride), moments, stride, shape.whole % FEW))?,
            restrict: narrow(&by_few(&padded(&restrict.concat(), moments, stride), moments, stride, 0))?,
            error_bound,
        }))
    }
}

/// The matrices of one order, and the part of the error that comes by moments, in units of eps and of the largest sample:
/// it passes the sums over a block, over a group, and over the blocks and groups of a window, and is as large as the
/// matrices say, because their polynomials are at most `sqrt(2 d + 1)`.
#[derive(Default)]
struct Matrices {
    near: Vec<f64>,
    far: Vec<f64>,
    groups: Vec<f64>,
    bound: f64,
}

impl Matrices {
    fn new(shape: &Shape, legendre: &Legendre, polynomial: &Polynomial, stride: usize) -> Result<Self, Error> {
        let mut new = Self::default();
        let (block, moments, whole) = (shape.block as f64, shape.moments, shape.whole);
        let square = moments * stride;
        let held = |count: usize| {
            try_vec(count * square, 0.0).map(|mut room| {
                room.clear();
                room
            })
        };
        let size = |matrix: &[f64]| {
            let norm = |at: usize| ((2 * at + 1) as f64).sqrt();
            matrix
                .iter()
                .enumerate()
                .map(|(at, value)| value.abs() * norm(at / stride) * norm(at % stride))
                .sum::<f64>()
        };
        let last = |matrices: &[f64]| size(&matrices[matrices.len() - square..]);
        let Some(group) = shape.group else {
            new.near = held(whole)?;
            for distance in 1..=whole {
                legendre.matrix(polynomial, distance as f64 * block, [block; 2], stride, &mut new.near);
            }
            new.bound = (block + (whole + 4) as f64 * moments as f64) * block * size(&new.near);
            return Ok(new);
        };
        let length = group as f64 * block;
        (new.near, new.far) = (held(group)?, held(group)?);
        let mut ends: f64 = 0.0;
        for index in 0..group {
            let (before, between) = (index as f64 * block, between(group, shape.whole, index));
            legendre.matrix(polynomial, -before, [length, block], stride, &mut new.near);
            let after = (between + 1) as f64 * length - before;
            legendre.matrix(polynomial, after, [length, block], stride, &mut new.far);
            let rest = shape.whole + 1 + index - group - between * group;
            let blocks = (group - 1 - index) as f64 * last(&new.near) + rest as f64 * last(&new.far);
            ends = ends.max(block * blocks);
        }
        let between = shape.between;
        new.groups = held(between)?;
        for distance in 1..=between {
            legendre.matrix(polynomial, distance as f64 * length, [length; 2], stride, &mut new.groups);
        }
        let terms = block + group as f64 + (between + 6) as f64 * moments as f64;
        new.bound = terms * (ends + length * size(&new.groups));
        Ok(new)
    }

    fn order<T: Sample>(self, shape: &Shape, order: &Taps, smooth: &Smooth) -> Result<Order<T>, Error> {
        let Smooth { taps, anchor } = smooth;
        let stride = shape.stride::<T>();
        let few = |matrices: &[f64]| narrow(&by_few(matrices, shape.moments, stride, 0));
        let (block, after) = (shape.block, shape.taps - shape.reach);
        let lines =
            |start: usize, count: usize| (start..start + count).flat_map(move |k| (0..block).map(move |i| (k, i)));
        let rest: Vec<f64> = lines(after, shape.reach).map(|(k, i)| taps[k - i]).collect();
        let ring: Vec<f64> =
            lines(0, block).map(|(k, i)| if k < i { taps[taps.len() + k - i] } else { taps[k - i] }).collect();
        Ok(Order {
            taps: narrow(taps)?,
            rest: narrow(&rest)?,
            ring: narrow(&ring)?,
            scale: order.scale,
            anchor: *anchor,
            near: if shape.group.is_some() { few(&self.near) } else { narrow(&self.near) }?,
            far: few(&self.far)?,
            groups: narrow(&self.groups)?,
        })
    }
}

fn narrow<T: Sample>(values: &[f64]) -> Result<Buffer<T>, Error> {
    let mut narrow = Buffer::new(values.len())?;
    narrow.iter_mut().zip(values).for_each(|(narrow, value)| *narrow = T::from_f64(*value));
    Ok(narrow)
}

/// Rows of `width` values, `stride` apart.
fn padded(values: &[f64], width: usize, stride: usize) -> Vec<f64> {
    let row = |row: &[f64]| row.iter().copied().chain(std::iter::repeat_n(0.0, stride - width)).collect::<Vec<_>>();
    values.chunks(width).flat_map(row).collect()
}

/// Matrices of the blocks of a group as they are taken: first the first rows of a few blocks, then their second rows, and so
/// on; the first few start with block `first`.
fn by_few(matrices: &[f64], moments: usize, stride: usize, first: usize) -> Vec<f64> {
    let group = matrices.len() / (moments * stride);
    let mut taken = Vec::with_capacity(matrices.len());
    for few in (0..group).step_by(FEW) {
        for d in 0..moments {
            for block in few..few + FEW {
                let row = (first + block) % group * moments + d;
                taken.extend_from_slice(&matrices[row * stride..][..stride]);
            }
        }
    }
    taken
}
