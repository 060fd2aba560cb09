//! The fit of one window of a stream: of samples that are still few, miss some, or have times of their own.

#![expect(clippy::indexing_slicing, reason = "the ring holds the window, and places are taken modulo its length")]

use std::ops::Range;

use pulp::Arch;

use crate::engine::Sample;
use crate::error::{Error, at_least};
use crate::jacobi::Jacobi;
use crate::local::{Block, Model, SIDE, Sheet, dots};
use crate::plan::Plan;

/// By how much missing samples may raise the noise gain of a full window, unless something else is asked for.
const MAX_GAIN: f64 = 100.0;

/// Where the estimate lies in a window that is not the design's own.
#[derive(Debug, Clone, Copy)]
pub enum Point {
    /// At the same share of the window.
    Tau(f64),
    /// So much time before the newest sample; while a window grows, not before its oldest one.
    Delay(f64),
}

/// The samples of a window, oldest first, and when they were taken, unless at even steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a, T> {
    pub x: &'a [T],
    pub stride: usize,
    pub times: Option<&'a [f64]>,
}

impl<'a, T: Sample> Seen<'a, T> {
    pub fn samples(&self) -> usize {
        self.x.len() / self.stride
    }

    /// The samples of a channel.
    pub fn channel(&self, channel: usize) -> impl Iterator<Item = f64> + use<'a, T> {
        self.x.get(channel..).unwrap_or_default().iter().step_by(self.stride).map(|value| value.to_f64())
    }
}

/// Which windows give an estimate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Allowed {
    pub missing: bool,
    pub support: usize,
    pub gain: Option<f64>,
}

/// What it takes to fit the windows of one design.
#[derive(Debug, Clone)]
pub(super) struct Local {
    model: Model,
    window_length: usize,
    kept: Range<usize>,
    delta: f64,
    tau: f64,
    point: Point,
    /// Norms of the weights of the whole window, of every order.
    norms: Vec<f64>,
    /// Of the fit of the plain degree at the same point, their squares for T = 2; none if nothing is compared with them.
    gains: Vec<f64>,
}

/// A window on [0, 1].
#[derive(Debug, Clone, Copy)]
struct Placed {
    /// When it begins, and how long it lasts; for even steps in samples.
    origin: f64,
    length: f64,
    /// Where the estimate lies.
    place: f64,
    /// From derivatives for `u = 2 s - 1` to derivatives in time.
    unit: f64,
}

/// What was found of a window: memory that is used again and again.
#[derive(Debug, Default)]
pub(super) struct Memory {
    sheet: Sheet,
    values: Vec<f64>,
    times: Vec<f64>,
    /// The samples of a channel less the reference, 0 where one is missing.
    z: Vec<Block>,
    missing: Vec<usize>,
    /// Of every order, the weights and the square of their norm; and the missing samples that they are for.
    weights: Vec<Block>,
    gains: Vec<f64>,
    solved: Option<bool>,
    left_out: Vec<usize>,
    arch: Arch,
}

impl Clone for Memory {
    /// Another stream finds its own.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Memory {
    /// A new window.
    pub fn begin(&mut self) {
        self.solved = None;
    }
}

impl Local {
    /// For the windows of `plans`, which share one window; whether noise gains are compared says `compared`.
    pub fn new<'a>(plans: impl Iterator<Item = &'a Plan> + Clone, point: Point, compared: bool) -> Result<Self, Error> {
        let Some(first) = plans.clone().next() else {
            return Err(Error::argument("deriv", "none", "one order or several"));
        };
        let design = first.design();
        let orders: Vec<usize> = plans.clone().map(|plan| plan.design().deriv).collect();
        let whole = plans.clone().map(Plan::fit_degree).collect();
        let norms = plans.map(|plan| norm(plan.weights())).collect();
        let family = Jacobi { alpha: design.kappa, beta: design.mu };
        let model = Model { family, degree: design.degree, whole, beyond: design.degree, orders };
        let tau = first.kernel().tau();
        let (window_length, kept, delta) = (design.window_length, first.kept(), design.delta);
        let mut local = Self { model, window_length, kept, delta, tau, point, norms, gains: Vec::new() };
        if compared {
            let (mut memory, span) = (Memory::default(), local.kept.len());
            local.solve(&local.placed(span, None), span, None, false, &mut memory)?;
            local.gains = memory.gains;
        }
        Ok(local)
    }

    /// How many orders there are.
    pub fn orders(&self) -> usize {
        self.norms.len()
    }

    /// Samples without which nothing is fitted.
    pub fn least(&self) -> usize {
        self.model.degree + 1
    }

    /// The standard deviation of the estimate number `index` of a whole window, for noise with a standard deviation of 1.
    pub fn norm(&self, index: usize) -> f64 {
        self.norms[index]
    }

    /// From the estimate to the newest of `samples` samples, in time.
    pub fn delay(&self, samples: usize, times: Option<&[f64]>) -> f64 {
        let placed = self.placed(samples, times);
        let time = placed.origin + placed.place * placed.length;
        match times {
            Some(times) => times.last().map_or(f64::NAN, |newest| newest - time),
            None => (samples as f64 - 1.0 - time) * self.delta,
        }
    }

    fn placed(&self, samples: usize, times: Option<&[f64]>) -> Placed {
        let full = samples >= self.kept.len();
        let last = samples as f64 - 1.0;
        let Some(times) = times else {
            if full {
                let (origin, length) = (-(self.kept.start as f64 + 0.5), self.window_length as f64);
                return Placed { origin, length, place: self.tau, unit: 2.0 / (length * self.delta) };
            }
            let length = samples as f64;
            let place = match self.point {
                Point::Tau(tau) => tau,
                Point::Delay(delay) => ((last - delay / self.delta).max(0.0) + 0.5) / length,
            };
            return Placed { origin: -0.5, length, place, unit: 2.0 / (length * self.delta) };
        };
        let (begin, end) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
        let step = if samples > 1 { (end - begin) / last } else { self.delta };
        let (origin, length) = (begin - 0.5 * step, step * samples as f64);
        let place = match self.point {
            Point::Tau(tau) => tau,
            Point::Delay(delay) if full => (end - delay - origin) / length,
            Point::Delay(delay) => ((end - delay).max(begin) - origin) / length,
        };
        Placed { origin, length, place, unit: 2.0 / length }
    }

    /// Fits one channel of a window, and hands on the value and the variance, for noise of variance 1, of every order: NaN where
    /// there is no estimate.
    pub fn fit<T: Sample>(
        &self,
        seen: &Seen<'_, T>,
        channel: usize,
        allowed: Allowed,
        memory: &mut Memory,
        mut put: impl FnMut(usize, f64, f64),
    ) -> Result<(), Error> {
        let samples = seen.samples();
        let reference = gather(seen, channel, memory)?;
        let whole = memory.missing.is_empty();
        let placed = self.placed(samples, seen.times);
        let mut fitted = samples - memory.missing.len() >= allowed.support && (whole || allowed.missing);
        if fitted {
            if memory.solved.is_none() || memory.missing != memory.left_out {
                memory.left_out.clone_from(&memory.missing);
                memory.solved = None;
                // At a root, and there only, the fit has one degree more.
                let ideal = whole && seen.times.is_none() && matches!(self.point, Point::Tau(_));
                let solved = self.solve(&placed, samples, seen.times, ideal, memory)?;
                memory.solved = Some(solved);
            }
            fitted = memory.solved == Some(true);
        }
        let usual = if whole || samples < self.kept.len() { f64::INFINITY } else { MAX_GAIN };
        let limit = allowed.gain.unwrap_or(usual) * (1.0 + 1e-9);
        let blocks = samples.div_ceil(SIDE);
        for (index, order) in self.model.orders.iter().enumerate() {
            let bounded = |gain: f64| self.gains.get(index).is_none_or(|whole| gain <= limit * whole);
            if !fitted || !bounded(memory.gains[index]) {
                put(index, f64::NAN, f64::NAN);
                continue;
            }
            let unit = placed.unit.powi(*order as i32);
            let [sum] = dots(memory.arch, &memory.weights[index * blocks..][..blocks], [&memory.z[..blocks]]);
            let value = sum * unit + if *order == 0 { reference } else { 0.0 };
            // What rounding leaves of a variance of nothing may be negative.
            let variance = memory.gains[index].max(0.0) * unit * unit;
            if value.is_finite() { put(index, value, variance) } else { put(index, f64::NAN, f64::NAN) }
        }
        Ok(())
    }

    /// Finds the weights of a window without the samples that are left out; false if there are too few.
    fn solve(
        &self,
        placed: &Placed,
        samples: usize,
        times: Option<&[f64]>,
        ideal: bool,
        memory: &mut Memory,
    ) -> Result<bool, Error> {
        let model = &self.model;
        let degree_of = |index| model.degree_of(index, ideal).min(samples - 1).max(model.degree);
        let highest = (0..model.orders.len()).map(degree_of).max().unwrap_or(model.degree);
        let half = 0.5 / if times.is_none() { placed.length } else { samples as f64 };
        let even = if times.is_some() { 0 } else { samples };
        at_least(&mut memory.times, even)?;
        memory.times.iter_mut().take(even).enumerate().for_each(|(j, time)| *time = j as f64);
        let times = times.unwrap_or(&memory.times[..even]);
        memory.sheet.lay(model, times, placed.origin, placed.length.recip(), half)?;
        let weights = memory.sheet.weights.as_flattened_mut();
        memory.left_out.iter().for_each(|&j| weights[j] = 0.0);
        memory.sheet.prepare(samples, highest)?;
        if !memory.sheet.orthonormalise() {
            return Ok(false);
        }
        memory.sheet.derive(2.0 * placed.place - 1.0, model.highest(), &mut memory.values)?;
        let (blocks, size) = (memory.sheet.blocks(), memory.sheet.size());
        at_least(&mut memory.weights, blocks * model.orders.len())?;
        memory.gains.clear();
        for (index, order) in model.orders.iter().enumerate() {
            let moments = &memory.values[order * size..][..=degree_of(index)];
            let weights = &mut memory.weights[index * blocks..][..blocks];
            memory.sheet.weigh(0, moments, weights);
            memory.gains.extend(dots(memory.arch, weights, [weights]));
        }
        Ok(true)
    }
}

/// The root of the sum of squares, which may not be a number themselves.
fn norm(weights: &[f64]) -> f64 {
    let peak = weights.iter().fold(0.0, |peak: f64, weight| peak.max(weight.abs()));
    let sum = |peak: f64| weights.iter().map(|weight| (weight / peak).powi(2)).sum::<f64>();
    if peak == 0.0 { 0.0 } else { sum(peak).sqrt() * peak }
}

/// Copies the samples of a channel less one of them, which is returned.
fn gather<T: Sample>(seen: &Seen<'_, T>, channel: usize, memory: &mut Memory) -> Result<f64, Error> {
    let samples = seen.samples();
    at_least(&mut memory.z, samples.div_ceil(SIDE))?;
    let z = memory.z[..samples.div_ceil(SIDE)].as_flattened_mut();
    z[samples..].fill(0.0);
    z.iter_mut().zip(seen.channel(channel)).for_each(|(z, value)| *z = value);
    let z = &mut z[..samples];
    let reference = z.iter().copied().find(|z| !z.is_nan()).unwrap_or(f64::NAN);
    memory.missing.clear();
    for (j, z) in z.iter_mut().enumerate() {
        if z.is_nan() {
            memory.missing.push(j);
            *z = 0.0;
        } else {
            *z -= reference;
        }
    }
    Ok(reference)
}
