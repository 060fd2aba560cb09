//! How the weights of one or several orders meet the data.
//!
//! Engines run on contiguous samples and know nothing of ends, axes or threads. [`direct`] adds the taps of every output in
//! one fixed order, so that blocks, streams and threads give the same bits. [`fft`] multiplies spectra of blocks that lie on a
//! fixed grid of the row: the same bits for every run that is cut on the grid.

/// The numbers of registers that hold the lanes of a place, known when compiled.
macro_rules! with_registers {
    ($simd:ident, $t:ty, $s:ty, $call:ident ( $($argument:expr),* )) => {
        // A place has 64 bytes.
        match 8 / <$s>::F64_LANES {
            1 => $call::<$t, $s, 1>($simd, $($argument),*),
            2 => $call::<$t, $s, 2>($simd, $($argument),*),
            4 => $call::<$t, $s, 4>($simd, $($argument),*),
            _ if <$t>::LANES == 8 => $call::<$t, $s, 8>($simd, $($argument),*),
            _ => $call::<$t, $s, 16>($simd, $($argument),*),
        }
    };
}

pub mod choice;
pub mod direct;
pub mod fft;
pub mod moments;
mod negacyclic;
mod transpose;

use std::f64::consts::TAU;
use std::sync::OnceLock;

use nalgebra::Complex;
use pulp::Simd;

use self::negacyclic::Transforms;
use crate::bank::Runners;
use crate::error::{Error, try_vec};

/// The closed set of engines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// Every tap of every output.
    Direct,
    /// Polynomial weights by the moments of blocks.
    Moments,
    /// Spectra of blocks.
    Fft,
}

/// Public names.
pub const ENGINES: [(&str, Engine); 3] =
    [("direct", Engine::Direct), ("moments", Engine::Moments), ("fft", Engine::Fft)];

/// An engine prepared for the taps of one or several orders, which share the samples that they read: shareable between
/// threads, never changed.
#[derive(Debug)]
pub enum Runner<T: Sample> {
    /// Every tap of every output.
    Direct(direct::Direct<T>),
    /// Polynomial weights by the moments of blocks.
    Moments(moments::Moments<T>),
    /// Spectra of blocks.
    Fft(fft::Fft<T>),
}

/// A thread's own memory.
#[derive(Debug, Default)]
pub struct Scratch<T: Sample> {
    differences: Vec<T>,
    moments: moments::Room<T>,
    fft: fft::Buffers<T>,
}

impl<T: Sample> Runner<T> {
    /// Prepares `engine` for `orders`, which have the same span.
    pub fn new(engine: Engine, orders: &[&Taps]) -> Result<Self, Error> {
        match engine {
            Engine::Direct => direct::Direct::new(orders).map(Self::Direct),
            Engine::Moments => moments::Moments::new(orders)?.map(Self::Moments).ok_or_else(|| {
                let allowed =
                    "'auto', 'direct' or 'fft' for these weights: they are no polynomial of a low degree, or too few";
                Error::argument("engine", "moments", allowed)
            }),
            Engine::Fft => fft::Fft::new(orders).map(Self::Fft),
        }
    }

    /// Prepares the engine that is likely to be the fastest.
    pub fn fastest(orders: &[&Taps]) -> Result<Self, Error> {
        for engine in choice::ranked(orders, size_of::<T>() == 4) {
            match engine {
                // Its error may turn out to be too large.
                Engine::Moments => {
                    if let Some(moments) = moments::Moments::new(orders)? {
                        return Ok(Self::Moments(moments));
                    }
                }
                engine => return Self::new(engine, orders),
            }
        }
        Self::new(Engine::Direct, orders)
    }

    /// Which engine it is.
    #[must_use]
    pub fn engine(&self) -> Engine {
        match self {
            Self::Direct(_) => Engine::Direct,
            Self::Moments(_) => Engine::Moments,
            Self::Fft(_) => Engine::Fft,
        }
    }

    /// Samples that one output reads.
    #[must_use]
    pub fn span(&self) -> usize {
        match self {
            Self::Direct(direct) => direct.span(),
            Self::Moments(moments) => moments.span(),
            Self::Fft(fft) => fft.span(),
        }
    }

    /// The step of the grid on which the outputs of a row may be cut into calls without a change of their bits: a call should
    /// hold the windows that start at the row's samples from one multiple of it to another, or to the end of the row, and all
    /// samples that they read. 1 where any cut will do.
    #[must_use]
    pub fn grid(&self) -> usize {
        match self {
            Self::Direct(_) | Self::Moments(_) => 1,
            Self::Fft(fft) => fft.grid(),
        }
    }

    /// What one output of every order costs, in multiplications of the direct engine, roughly.
    #[must_use]
    pub fn work(&self) -> usize {
        match self {
            Self::Direct(direct) => direct.work(),
            Self::Moments(moments) => moments.work(),
            Self::Fft(fft) => fft.work(),
        }
    }

    /// Outputs of a row from which on what a call costs at its start does not show.
    #[must_use]
    pub fn stretch(&self) -> usize {
        match self {
            Self::Direct(_) => 1,
            Self::Moments(moments) => 16 * moments.span(),
            Self::Fft(fft) => fft.grid(),
        }
    }

    /// Whether [`Runner::apply`] on single rows is faster than [`Runner::apply_lanes`], gathering included.
    #[must_use]
    pub fn prefers_rows(&self) -> bool {
        matches!(self, Self::Fft(_))
    }

    /// For every order the outputs whose windows start at `x[first]`, `x[first + 1]` and on, as many as each of `outs` holds.
    ///
    /// `x[0]` is the sample `origin` of its row. Engines whose sums depend on a grid lay it on the row, not on `x`; they may
    /// read any sample of `x`, but the outputs depend on those outside of their windows by rounding only.
    pub fn apply(
        &self,
        x: &[T],
        first: usize,
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        match self {
            Self::Direct(direct) => direct.apply(x, first, outs, scratch),
            Self::Moments(moments) => moments.apply(x, first, origin, outs, scratch),
            Self::Fft(fft) => fft.apply(x, first, origin, outs, scratch),
        }
    }

    /// The same for [`Sample::LANES`] neighbouring rows at once: `x` is the matrix `(samples, LANES)`, and so are `outs`.
    pub fn apply_lanes(
        &self,
        x: &[T],
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        match self {
            Self::Direct(direct) => direct.apply_lanes(x, outs, scratch),
            Self::Moments(moments) => moments.apply_lanes(x, origin, outs, scratch),
            Self::Fft(_) => self.apply_each(x, origin, outs, scratch),
        }
    }

    /// One lane after the other.
    fn apply_each(&self, x: &[T], origin: isize, outs: &mut [&mut [T]], scratch: &mut Scratch<T>) -> Result<(), Error> {
        let lanes = T::LANES;
        let outputs = (x.len() / lanes + 1).saturating_sub(self.span());
        let mut row = try_vec(x.len() / lanes, T::default())?;
        let mut results = try_vec(outputs * outs.len(), T::default())?;
        for lane in 0..lanes {
            row.iter_mut().zip(x[lane..].iter().step_by(lanes)).for_each(|(value, sample)| *value = *sample);
            let mut each: Vec<&mut [T]> = results.chunks_mut(outputs.max(1)).collect();
            self.apply(&row, 0, origin, &mut each, scratch)?;
            for (out, result) in outs.iter_mut().zip(each) {
                out[lane..].iter_mut().step_by(lanes).zip(result).for_each(|(value, result)| *value = *result);
            }
        }
        Ok(())
    }
}

/// The weights of a design in the form that engines apply: `out[i] = scale * sum of taps[k] s[i + k]`, where `s` is the
/// data or their first differences; with an anchor `a`, plus `x[i + a]`.
///
/// The weights of a derivative sum to zero, so by summation by parts `sum w_k x_k = sum W_k (x_{k+1} - x_k)` with
/// `W_k = -(w_0 + ... + w_k)`. On differences a constant gives exactly 0, an offset costs nothing, and W is the better
/// conditioned kernel. The weights of a smoother sum to one: they are the anchor's sample plus weights that sum to zero.
/// `scale` is a power of two that brings the largest tap to [1/2, 1): float32 taps neither overflow nor underflow.
#[derive(Debug)]
pub struct Taps {
    double: Vec<f64>,
    single: Vec<f32>,
    scale: f64,
    on_differences: bool,
    anchor: Option<usize>,
}

impl Taps {
    /// Taps on the data themselves.
    pub fn plain(weights: &[f64]) -> Result<Self, Error> {
        let mut taps = try_vec(weights.len(), 0.0)?;
        taps.copy_from_slice(weights);
        Self::scaled(taps, false)
    }

    /// Taps on first differences of weights that sum to zero up to rounding, or to one with an anchor.
    ///
    /// Each side of the anchor, by default each half, is summed from its own end: `W_k = w_{k+1} + ... + w_{L-1}` as
    /// well, so that symmetry and the small values at both ends are kept.
    pub fn on_differences(weights: &[f64], anchor: Option<usize>) -> Result<Self, Error> {
        let mut taps = try_vec(weights.len().saturating_sub(1), 0.0)?;
        let middle = anchor.unwrap_or(taps.len().div_ceil(2));
        let (old, new) = taps.split_at_mut(middle);
        accumulate(old.iter_mut().zip(weights), -1.0);
        accumulate(new.iter_mut().rev().zip(weights.iter().rev()), 1.0);
        Ok(Self { anchor, ..Self::scaled(taps, true)? })
    }

    fn scaled(mut double: Vec<f64>, on_differences: bool) -> Result<Self, Error> {
        let peak = double.iter().fold(0.0, |peak: f64, tap| peak.max(tap.abs()));
        let (_, exponent) = libm::frexp(peak);
        // 2^1024 is not a number; and a subnormal scale would cost the result its digits.
        let exponent = exponent.clamp(-1022, 1023);
        double.iter_mut().for_each(|tap| *tap = libm::ldexp(*tap, -exponent));
        let mut single = try_vec(double.len(), 0.0)?;
        single.iter_mut().zip(&double).for_each(|(single, double)| *single = *double as f32);
        Ok(Self { double, single, scale: libm::ldexp(1.0, exponent), on_differences, anchor: None })
    }

    /// The frequency response of what the engines compute, with the phase reference at `position`, in samples from the oldest;
    /// `turns` is the frequency in cycles per sample.
    ///
    /// On differences it carries the factor `z - 1` explicitly, and so keeps its digits at low frequencies.
    #[must_use]
    pub fn response(&self, turns: f64, position: f64) -> Complex<f64> {
        let power = |k: f64| Complex::from_polar(1.0, TAU * (turns * (k - position)).fract());
        // exp(2 pi i turns k) by blocks: one product for every tap, and the errors of 64 of them.
        let step: Vec<Complex<f64>> = (0..self.double.len().clamp(1, 64))
            .map(|k| Complex::from_polar(1.0, TAU * (turns * k as f64).fract()))
            .collect();
        let sum: Complex<f64> = self
            .double
            .chunks(step.len())
            .enumerate()
            .map(|(block, taps)| {
                let inner: Complex<f64> = taps.iter().zip(&step).map(|(tap, z)| z * tap).sum();
                inner * power((block * step.len()) as f64)
            })
            .sum();
        let scaled = sum * self.scale;
        if !self.on_differences {
            return scaled;
        }
        let half = 0.5 * TAU * turns.fract();
        let difference = Complex::new(0.0, 2.0 * half.sin()) * Complex::from_polar(1.0, half);
        scaled * difference + self.anchor.map_or(Complex::new(0.0, 0.0), |anchor| power(anchor as f64))
    }

    /// Samples that one output reads.
    #[must_use]
    pub fn span(&self) -> usize {
        self.double.len() + usize::from(self.on_differences)
    }
}

/// The stream that engines run on, from its element `start` on: first differences of x, or x; zero where x has no samples.
#[inline(always)]
fn stream<T: Sample>(x: &[T], on_differences: bool, start: isize, out: &mut [T]) {
    let held = x.len().saturating_sub(usize::from(on_differences)).cast_signed();
    let inside = |place: isize| (place - start).clamp(0, out.len().cast_signed()).cast_unsigned();
    let (from, until) = (inside(0), inside(held).max(inside(0)));
    let (before, rest) = out.split_at_mut(from);
    let (known, after) = rest.split_at_mut(until - from);
    before.fill(T::default());
    after.fill(T::default());
    let Some(x) = x.get((start + from.cast_signed()).max(0).cast_unsigned()..) else { return };
    if on_differences {
        for ((value, older), newer) in known.iter_mut().zip(x).zip(x.iter().skip(1)) {
            *value = *newer - *older;
        }
    } else {
        known.copy_from_slice(&x[..until - from]);
    }
}

/// Sums into outputs: scaled, and with the anchor's samples added.
#[inline(always)]
fn bring_home<T: Sample>(sums: &[T], scale: f64, anchored: Option<&[T]>, out: &mut [T]) {
    out.copy_from_slice(sums);
    rescale(out, scale);
    if let Some(x) = anchored {
        out.iter_mut().zip(x).for_each(|(out, sample)| *out = *out + *sample);
    }
}

/// Multiplies by a power of two, rounding once.
#[inline(always)]
fn rescale<T: Sample>(values: &mut [T], scale: f64) {
    let own = T::from_f64(scale);
    if own.to_f64() == scale {
        values.iter_mut().for_each(|value| *value = *value * own);
    } else {
        values.iter_mut().for_each(|value| *value = T::from_f64(value.to_f64() * scale));
    }
}

/// Running sums `sign * (w_0 + ... + w_k)` with the rounding errors carried along (Neumaier).
fn accumulate<'a>(pairs: impl Iterator<Item = (&'a mut f64, &'a f64)>, sign: f64) {
    let (mut sum, mut lost) = (0.0_f64, 0.0);
    for (tap, &weight) in pairs {
        let total = sum + weight;
        lost += if sum.abs() >= weight.abs() { (sum - total) + weight } else { (weight - total) + sum };
        sum = total;
        *tap = sign * (sum + lost);
    }
}

/// The element types that engines run in.
pub trait Sample:
    Copy
    + Default
    + Send
    + Sync
    + std::fmt::Debug
    + PartialOrd
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
{
    /// Rows that run side by side: as many as fit into 64 bytes.
    const LANES: usize = 64 / size_of::<Self>();
    /// Where the runners of this type are kept.
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>>;
    /// The taps in this type.
    fn taps(taps: &Taps) -> &[Self];
    /// A register of the CPU.
    type Register<S: Simd>: Copy + std::fmt::Debug;
    /// The same value in every lane.
    fn splat<S: Simd>(simd: S, value: Self) -> Self::Register<S>;
    /// `a + b` in every lane.
    fn plus<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// `a b` in every lane.
    fn times<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// `a b + c`, rounded once where the CPU can do so.
    fn fused<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>, c: Self::Register<S>) -> Self::Register<S>;
    /// The whole registers of a slice.
    fn registers<S: Simd>(values: &[Self]) -> &[Self::Register<S>];
    /// The whole registers of a slice.
    fn registers_mut<S: Simd>(values: &mut [Self]) -> &mut [Self::Register<S>];
    /// Four rows of four as four columns.
    fn turn<S: Simd>(simd: S, tile: [[Self; 4]; 4]) -> [[Self; 4]; 4];
    /// The complex transforms of so many points.
    fn transforms(points: usize) -> Transforms<Self>;
    /// The nearest value of this type.
    fn from_f64(value: f64) -> Self;
    /// The same value as f64.
    fn to_f64(self) -> f64;
}

impl Sample for f64 {
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>> {
        &runners.double
    }
    fn taps(taps: &Taps) -> &[Self] {
        &taps.double
    }
    type Register<S: Simd> = S::f64s;
    #[inline(always)]
    fn splat<S: Simd>(simd: S, value: Self) -> S::f64s {
        simd.splat_f64s(value)
    }
    #[inline(always)]
    fn plus<S: Simd>(simd: S, a: S::f64s, b: S::f64s) -> S::f64s {
        simd.add_f64s(a, b)
    }
    #[inline(always)]
    fn times<S: Simd>(simd: S, a: S::f64s, b: S::f64s) -> S::f64s {
        simd.mul_f64s(a, b)
    }
    #[inline(always)]
    fn fused<S: Simd>(simd: S, a: S::f64s, b: S::f64s, c: S::f64s) -> S::f64s {
        simd.mul_add_e_f64s(a, b, c)
    }
    #[inline(always)]
    fn registers<S: Simd>(values: &[Self]) -> &[S::f64s] {
        S::as_simd_f64s(values).0
    }
    #[inline(always)]
    fn registers_mut<S: Simd>(values: &mut [Self]) -> &mut [S::f64s] {
        S::as_mut_simd_f64s(values).0
    }
    #[inline(always)]
    fn turn<S: Simd>(simd: S, tile: [[Self; 4]; 4]) -> [[Self; 4]; 4] {
        if S::F64_LANES != 4 {
            return transpose::turn(tile);
        }
        let [a, b, c, d] = tile;
        let row = |values: &[Self; 4]| S::as_simd_f64s(values).0[0];
        let columns = simd.deinterleave_shfl_f64s([row(&a), row(&b), row(&c), row(&d)]);
        let mut turned = tile;
        for (line, column) in turned.iter_mut().zip(columns) {
            S::as_mut_simd_f64s(line).0[0] = column;
        }
        turned
    }
    fn transforms(points: usize) -> Transforms<Self> {
        Transforms::new(points)
    }
    fn from_f64(value: f64) -> Self {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
}

impl Sample for f32 {
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>> {
        &runners.single
    }
    fn taps(taps: &Taps) -> &[Self] {
        &taps.single
    }
    type Register<S: Simd> = S::f32s;
    #[inline(always)]
    fn splat<S: Simd>(simd: S, value: Self) -> S::f32s {
        simd.splat_f32s(value)
    }
    #[inline(always)]
    fn plus<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> S::f32s {
        simd.add_f32s(a, b)
    }
    #[inline(always)]
    fn times<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> S::f32s {
        simd.mul_f32s(a, b)
    }
    #[inline(always)]
    fn fused<S: Simd>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
        simd.mul_add_e_f32s(a, b, c)
    }
    #[inline(always)]
    fn registers<S: Simd>(values: &[Self]) -> &[S::f32s] {
        S::as_simd_f32s(values).0
    }
    #[inline(always)]
    fn registers_mut<S: Simd>(values: &mut [Self]) -> &mut [S::f32s] {
        S::as_mut_simd_f32s(values).0
    }
    #[inline(always)]
    fn turn<S: Simd>(_simd: S, tile: [[Self; 4]; 4]) -> [[Self; 4]; 4] {
        transpose::turn(tile)
    }
    fn transforms(points: usize) -> Transforms<Self> {
        Transforms::new(points)
    }
    fn from_f64(value: f64) -> Self {
        value as Self
    }
    fn to_f64(self) -> f64 {
        self.into()
    }
}
