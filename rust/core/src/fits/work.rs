//! One thread's part of the fits: window by window, or windows side by side.

#![expect(clippy::indexing_slicing, reason = "windows lie in their rows, and lanes are fewer than a panel has")]

use pulp::Arch;

use super::panel::Panel;
use super::{Fits, Noise, PerSample, Piece};
use crate::ends::Mode;
use crate::engine::Sample;
use crate::error::{Error, at_least};
use crate::gaps::{Aim, Refit};
use crate::irregular::{Times, Window};
use crate::local::{Block, SIDE, Sheet, dots};

/// A row of the array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Row {
    pub outer: usize,
    pub inner: usize,
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// The samples of the window less the reference, 0 where one is missing; how many there are.
    z: Vec<Block>,
    reference: f64,
    missing: Vec<usize>,
    left_out: Vec<usize>,
    samples: usize,
    /// Whether the window is whole, where it should be, and its samples weigh the same.
    ideal: bool,
    /// The row and the start of the window whose small system is at hand.
    solved: Option<(Row, isize)>,
    sheet: Sheet,
    values: Vec<f64>,
    aim: Aim,
    refit: Refit,
    /// Of every order, the weights of the estimate and those of what the higher degree adds to it.
    weights: Vec<Block>,
    more: Vec<Block>,
    times: Vec<f64>,
    /// The window that the weights are of, if none of its samples was missing; and whether they reach the higher degree.
    fitted: Option<Window>,
    reaches: bool,
    panel: Panel,
    arch: Arch,
}

/// An estimate, in the unit of `u`.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    value: f64,
    variance: f64,
    /// What the fit of the higher degree would add.
    more: f64,
}

const NOTHING: Estimate = Estimate { value: f64::NAN, variance: f64::NAN, more: f64::NAN };

pub(super) struct Work<'a, 'o, T> {
    pub fits: &'a Fits<'a>,
    pub x: &'a [T],
    pub memory: &'a mut Memory,
    pub piece: Piece<'o, T>,
    /// Whether neighbouring windows may be fitted side by side.
    pub panelled: bool,
}

impl<T: Sample> Work<'_, '_, T> {
    /// Everything that is wanted of a piece.
    pub fn run(mut self) -> Result<(), Error> {
        let length = self.piece.estimate.first().map_or(0, |part| part.len());
        let group = SIDE * self.fits.layout.outer * self.fits.layout.inner;
        let mut k = 0;
        while k < length {
            let (output, row) = self.fits.place(self.piece.first + k);
            if row == (Row { outer: 0, inner: 0 }) && k + group <= length && self.side_by_side(k, output)? {
                k += group;
            } else {
                self.one(k, output, row)?;
                k += 1;
            }
        }
        Ok(())
    }

    /// The windows of neighbouring estimates, of all rows, as far as they are alike; false if they are not.
    fn side_by_side(&mut self, k: usize, output: usize) -> Result<bool, Error> {
        let fits = self.fits;
        let Some((first, lanes)) = self.panelled.then(|| fits.neighbours(output)).flatten() else { return Ok(false) };
        let Times::Stamps { t, .. } = fits.windows.times else { return Ok(false) };
        let (count, held) = (fits.whole.span(), fits.whole.span() + SIDE - 1);
        if !self.memory.panel.weigh(fits.model, &t[first..][..held], count, lanes)? {
            return Ok(false);
        }
        let unit = lanes.factor.map(|factor| 2.0 * factor);
        // The sample at the estimate, or the nearest to it in the window.
        let center = fits.windows.center.clamp(0, count.cast_signed() - 1).cast_unsigned();
        let rows = fits.layout.outer * fits.layout.inner;
        for number in 0..rows {
            let row = Row { outer: number / fits.layout.inner, inner: number % fits.layout.inner };
            at_least(&mut self.memory.times, held)?;
            let start = (row.outer * fits.layout.samples + first) * fits.layout.inner + row.inner;
            let samples = self.x[start..].iter().step_by(fits.layout.inner);
            self.memory.times.iter_mut().zip(samples).take(held).for_each(|(value, x)| *value = x.to_f64());
            if !self.memory.times[..held].iter().fold(true, |finite, x| finite & x.is_finite()) {
                for lane in 0..SIDE {
                    self.one(k + lane * rows + number, output + lane, row)?;
                }
                continue;
            }
            let mut reference = [0.0; SIDE];
            reference.copy_from_slice(&self.memory.times[center..][..SIDE]);
            for index in 0..fits.model.orders.len() {
                let levels =
                    if let Noise::Level(PerSample::Shared(levels)) = fits.noise { levels.get(first..) } else { None };
                let memory = &*self.memory;
                let (values, variances) = memory.panel.apply(index, &memory.times[..held], levels, &reference);
                for lane in 0..SIDE {
                    let (value, variance) = (values[lane], variances[lane]);
                    self.memory.reference = reference[lane];
                    let estimate = Estimate { value, variance, more: 0.0 };
                    self.put(k + lane * rows + number, index, estimate, unit[lane]);
                }
            }
            (0..SIDE).for_each(|lane| self.count(k + lane * rows + number, count));
        }
        self.memory.fitted = None;
        self.memory.solved = None;
        Ok(true)
    }

    /// Everything that is wanted of one window.
    fn one(&mut self, k: usize, output: usize, row: Row) -> Result<(), Error> {
        let Some(window) = self.fits.windows.window(self.fits.whole, output) else {
            (0..self.fits.model.orders.len()).for_each(|index| self.put(k, index, NOTHING, 1.0));
            self.count(k, 0);
            return Ok(());
        };
        let (fits, orders) = (self.fits, self.fits.model.orders.len());
        let even = matches!(fits.windows.times, Times::Even { .. });
        let tabled = even && fits.weights.is_none() && window.count == fits.whole.span() && fits.whole.refits();
        let again = tabled && self.memory.solved == Some((row, window.start));
        if !again {
            self.memory.solved = None;
            self.memory.samples = self.gather(row, &window)?;
        }
        self.count(k, self.memory.samples);
        let whole = self.memory.missing.is_empty();
        let possible = self.memory.samples >= fits.allowed.support && (fits.allowed.missing || whole);
        self.memory.ideal = window.ideal && whole && fits.weights.is_none();
        let unit = fits.windows.unit(&window);
        if possible && tabled && fits.whole.reaches(fits.model.top()) {
            fits.whole.aim(fits.model, 2.0 * window.place - 1.0, &mut self.memory.aim)?;
            let memory = &mut *self.memory;
            if again || fits.whole.without(&memory.missing, &memory.z, &mut memory.refit) {
                memory.solved = Some((row, window.start));
                for index in 0..orders {
                    let estimate = self.refitted(index, row, &window)?;
                    self.put(k, index, estimate, unit);
                }
                return Ok(());
            }
        }
        let fitted = possible && self.fit(row, &window)?;
        for index in 0..orders {
            let estimate = if fitted { self.weighed(index, row, &window) } else { NOTHING };
            self.put(k, index, estimate, unit);
        }
        Ok(())
    }

    fn count(&mut self, k: usize, samples: usize) {
        if let Some(support) = self.piece.support.get_mut(k) {
            *support = samples as i64;
        }
    }

    /// Writes one estimate in the units of the data.
    fn put(&mut self, k: usize, index: usize, estimate: Estimate, unit: f64) {
        let order = self.fits.model.orders[index];
        let unit = unit.powi(order as i32);
        let origin = if order == 0 { self.memory.reference } else { 0.0 };
        let value = estimate.value * unit + origin;
        let value = if value.is_finite() { value } else { f64::NAN };
        self.piece.estimate[index][k] = T::from_f64(value);
        if let Some(std) = self.piece.std.get_mut(index) {
            // What rounding leaves of a variance of nothing may be negative.
            std[k] = T::from_f64(if value.is_nan() { value } else { estimate.variance.max(0.0).sqrt() * unit });
        }
        if let Some(bias) = self.piece.bias.get_mut(index) {
            bias[k] = T::from_f64(if value.is_nan() { value } else { -estimate.more * unit });
        }
    }

    /// Copies the samples of a window, and returns how many there are.
    fn gather(&mut self, row: Row, window: &Window) -> Result<usize, Error> {
        let (fits, memory) = (self.fits, &mut *self.memory);
        let (samples, inner) = (fits.layout.samples, fits.layout.inner);
        at_least(&mut memory.z, window.count.div_ceil(SIDE))?;
        let z = memory.z[..window.count.div_ceil(SIDE)].as_flattened_mut();
        z[window.count..].fill(0.0);
        let z = &mut z[..window.count];
        if fits.windows.inside(window) {
            let first = (row.outer * samples + window.start.cast_unsigned()) * inner + row.inner;
            if inner == 1 {
                z.iter_mut().zip(&self.x[first..][..window.count]).for_each(|(z, x)| *z = x.to_f64());
            } else {
                z.iter_mut().zip(self.x[first..].iter().step_by(inner)).for_each(|(z, x)| *z = x.to_f64());
            }
        } else {
            for (z, place) in z.iter_mut().zip(window.start..) {
                let constant = if let Mode::Constant(value) = fits.windows.mode { value } else { 0.0 };
                let source = fits.windows.mode.source(place, samples);
                *z = source.map_or(constant, |j| self.x[(row.outer * samples + j) * inner + row.inner].to_f64());
            }
        }
        memory.missing.clear();
        memory.left_out.clear();
        if let Some(weights) = fits.weights {
            for (j, (z, place)) in z.iter_mut().zip(window.start..).enumerate() {
                if fits.of_sample(weights, row, place) == 0.0 {
                    *z = f64::NAN;
                    memory.left_out.push(j);
                }
            }
        }
        memory.reference = z.iter().copied().find(|z| !z.is_nan()).unwrap_or(f64::NAN);
        // Before it is taken off: what an infinite reference leaves is NaN, but not missing.
        if z.iter().fold(false, |holes, z| holes | z.is_nan()) {
            let left_out = &memory.left_out;
            let holes = z.iter().enumerate().filter(|(_, z)| z.is_nan()).map(|(j, _)| j);
            memory.missing.extend(holes.filter(|j| left_out.binary_search(j).is_err()));
        }
        z.iter_mut().for_each(|z| *z -= memory.reference);
        memory.left_out.iter().chain(&memory.missing).for_each(|&j| z[j] = 0.0);
        Ok(window.count - memory.missing.len() - memory.left_out.len())
    }

    /// Whether a noise gain is allowed.
    fn bounded(&self, index: usize, gain: f64) -> bool {
        let missing = !self.memory.missing.is_empty();
        let limit = self.fits.allowed.gain[usize::from(missing)];
        limit == f64::INFINITY || self.memory.ideal || gain <= limit * self.memory.aim.gain(index) * (1.0 + 1e-9)
    }

    /// One estimate by the whole window's fit without the missing samples.
    fn refitted(&mut self, index: usize, row: Row, window: &Window) -> Result<Estimate, Error> {
        let degree = self.fits.model.degree_of(index, self.memory.ideal);
        let (fits, memory) = (self.fits, &mut *self.memory);
        let value = fits.whole.estimate(&memory.aim, index, degree + 1, &mut memory.refit);
        let gain = fits.whole.refitted_gain(&memory.missing, &memory.refit);
        let mut variance = gain;
        let plain = matches!(fits.noise, Noise::Unit) && fits.windows.inside(window);
        if !self.piece.std.is_empty() && !plain {
            let blocks = window.count.div_ceil(SIDE);
            at_least(&mut memory.weights, blocks)?;
            fits.whole.refitted_weights(&memory.missing, &memory.refit, &mut memory.weights[..blocks]);
            memory.fitted = None;
            variance = self.variance(0, row, window);
        }
        let memory = &mut *self.memory;
        let mut more = 0.0;
        if !self.piece.bias.is_empty() {
            more = fits.whole.estimate(&memory.aim, index, fits.model.beyond + 1, &mut memory.refit) - value;
        }
        Ok(if self.bounded(index, gain) { Estimate { value, variance, more } } else { NOTHING })
    }

    /// Fits the samples of a window; false if there are too few.
    fn fit(&mut self, row: Row, window: &Window) -> Result<bool, Error> {
        let fits = self.fits;
        if fits.allowed.gain[usize::from(!self.memory.missing.is_empty())] < f64::INFINITY {
            fits.whole.aim(fits.model, 2.0 * window.place - 1.0, &mut self.memory.aim)?;
        }
        let alike = self.memory.missing.is_empty() && !matches!(fits.weights, Some(PerSample::Each(_)));
        if alike && self.memory.fitted == Some(*window) {
            return Ok(true);
        }
        self.memory.fitted = None;
        self.lay(row, window)?;
        let (model, memory) = (fits.model, &mut *self.memory);
        memory.reaches = memory.sheet.orthonormalise();
        if !memory.reaches {
            let needed = if memory.ideal { model.widest() } else { model.degree };
            if model.top() == needed {
                return Ok(false);
            }
            memory.sheet.prepare(window.count, needed)?;
            if !memory.sheet.orthonormalise() {
                return Ok(false);
            }
        }
        memory.sheet.derive(2.0 * window.place - 1.0, model.highest(), &mut memory.values)?;
        let (blocks, size) = (memory.sheet.blocks(), memory.sheet.size());
        let parts = blocks * model.orders.len();
        at_least(&mut memory.weights, parts)?;
        at_least(&mut memory.more, if self.piece.bias.is_empty() { 0 } else { parts })?;
        for (index, order) in model.orders.iter().enumerate() {
            let moments = &memory.values[order * size..][..size];
            let degree = model.degree_of(index, memory.ideal);
            memory.sheet.weigh(0, &moments[..=degree], &mut memory.weights[index * blocks..][..blocks]);
            if !self.piece.bias.is_empty() {
                let more = moments.get(degree + 1..=model.beyond).unwrap_or_default();
                memory.sheet.weigh(degree + 1, more, &mut memory.more[index * blocks..][..blocks]);
            }
        }
        if alike {
            memory.fitted = Some(*window);
        }
        Ok(true)
    }

    /// The places and the weights of the samples of a window onto the sheet.
    fn lay(&mut self, row: Row, window: &Window) -> Result<(), Error> {
        let (fits, memory) = (self.fits, &mut *self.memory);
        at_least(&mut memory.times, window.count)?;
        let times = fits.windows.times(window, &mut memory.times[..window.count]);
        let (factor, half) = (window.length.recip(), fits.windows.half(window));
        memory.sheet.lay(fits.model, times, window.origin, factor, half)?;
        let weights = &mut memory.sheet.weights.as_flattened_mut()[..window.count];
        memory.missing.iter().for_each(|&j| weights[j] = 0.0);
        if let Some(own) = fits.weights {
            for (weight, place) in weights.iter_mut().zip(window.start..) {
                *weight *= fits.of_sample(own, row, place);
            }
        }
        Ok(())
    }

    /// One estimate by its own weights.
    fn weighed(&self, index: usize, row: Row, window: &Window) -> Estimate {
        let memory = &*self.memory;
        let blocks = window.count.div_ceil(SIDE);
        let (z, weights) = (&memory.z[..blocks], &memory.weights[index * blocks..][..blocks]);
        let [value, gain] = dots(memory.arch, weights, [z, weights]);
        let mut more = 0.0;
        if !self.piece.bias.is_empty() {
            let [sum] = dots(memory.arch, &memory.more[index * blocks..][..blocks], [z]);
            more = if memory.reaches { sum } else { f64::NAN };
        }
        if !self.bounded(index, gain) {
            return NOTHING;
        }
        let variance = if self.piece.std.is_empty() { 0.0 } else { self.variance(index, row, window) };
        Estimate { value, variance, more }
    }

    /// The variance of the estimate with the weights number `index`.
    fn variance(&self, index: usize, row: Row, window: &Window) -> f64 {
        let blocks = window.count.div_ceil(SIDE);
        let weights = &self.memory.weights[index * blocks..][..blocks];
        if !self.fits.windows.inside(window) {
            return self.folded_variance(&weights.as_flattened()[..window.count], row, window);
        }
        match self.fits.noise {
            Noise::Unit => dots(self.memory.arch, weights, [weights])[0],
            Noise::Level(level) => {
                let flat = weights.as_flattened()[..window.count].iter().zip(window.start..);
                // A missing sample may have no level.
                let shares = flat.filter(|(weight, _)| **weight != 0.0);
                shares.map(|(weight, place)| (weight * self.fits.of_sample(level, row, place)).powi(2)).sum()
            }
            Noise::Autocovariance(covariance) => {
                let flat = &weights.as_flattened()[..window.count];
                let lagged = |lag: usize| flat.iter().zip(&flat[lag..]).map(|(a, b)| a * b).sum::<f64>();
                let lags = covariance.iter().enumerate().take(window.count);
                lags.map(|(lag, covariance)| lagged(lag) * covariance * if lag == 0 { 1.0 } else { 2.0 }).sum()
            }
        }
    }

    /// The variance where the data are extended: a sample that stands at several places is one sample, and a constant is none.
    fn folded_variance(&self, weights: &[f64], row: Row, window: &Window) -> f64 {
        let (mode, samples) = (self.fits.windows.mode, self.fits.layout.samples);
        let places = weights.iter().zip(window.start..);
        let sources = places.filter_map(|(weight, place)| mode.source(place, samples).map(|source| (source, *weight)));
        let mut sources: Vec<(usize, f64)> = sources.collect();
        sources.sort_by_key(|(source, _)| *source);
        let together = sources.chunk_by(|a, b| a.0 == b.0).map(|same| {
            let level = match self.fits.noise {
                Noise::Level(level) => self.fits.of_sample(level, row, same[0].0.cast_signed()),
                Noise::Unit | Noise::Autocovariance(_) => 1.0,
            };
            (same.iter().map(|(_, weight)| weight).sum::<f64>() * level).powi(2)
        });
        together.sum()
    }
}
