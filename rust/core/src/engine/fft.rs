//! Spectra of blocks: overlap-save, one forward transform for all orders.
//!
//! **Grid.** Block g holds the windows that start at the samples `g H .. (g + 1) H` of the row, `H = N - taps + 1`, and
//! is transformed whole whatever part of it is wanted, so that an output's bits depend on the samples of its block alone.
//! Nor does N depend on the data: a short row costs a block.
//!
//! **Error.** A transform errs by a part of all that went into it, not of the window that an output reads. With exact
//! taps w, and s the samples (or differences) of the block, the computed sums err by at most
//! `8 eps log2(N) norm2(w) norm2(s)`: each of the `log2(M)` stages, `M = N / 2`, of the transforms of s and of w is
//! a unitary matrix, up to a factor, applied with a relative error of `5 eps / 2` in the 2-norm, which
//! `sum |W_k| |dS_k| / M <= norm2(w) norm2(ds)` carries over to every single output; and in the inverse transform a
//! tree of as many stages leads to each output, which errs by `log2(M) 5 eps / 2` of `sum |W_k S_k| / M <= norm2(w) norm2(s)`.
//!
//! **Quiet windows.** Next to a loud sample this would be nothing worth for a window that does not hold it. So windows
//! whose largest sample is smaller than [`QUIET_DOUBLE`] or [`QUIET_SINGLE`] of the block's are computed from a second
//! transform, of the block without the samples that are larger than any of theirs, and so on. For every output, s in
//! the bound may be read as the samples up to 2^10 (single precision: 2^5) times the largest in its own window. Windows of zeros give 0.
//!
//! **NaN and inf** are louder than everything, by the same rule: they spoil the windows that hold them, and no others.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::ops::Range;

use nalgebra::Complex;
use pulp::{Arch, Simd, WithSimd};

use super::negacyclic::{Negacyclic, multiply};
use super::{Sample, Scratch, Taps};
use crate::error::{Error, resize, try_vec};

/// A window is quiet if its largest sample is smaller than this part of the largest in its block.
const QUIET_DOUBLE: f64 = 1.0 / 1024.0;
const QUIET_SINGLE: f64 = 1.0 / 32.0;

/// Samples that are compared side by side.
const LANES: usize = 8;

/// The spectra of the taps of every order.
#[derive(Debug)]
pub struct Fft<T> {
    orders: Vec<Order<T>>,
    span: usize,
    taps: usize,
    on_differences: bool,
    transform: Negacyclic<T>,
}

#[derive(Debug)]
struct Order<T> {
    spectrum: Vec<Complex<T>>,
    /// The taps' scale is 2 to this power.
    exponent: i32,
    anchor: Option<usize>,
}

/// A thread's own memory for one block.
#[derive(Debug, Default)]
pub struct Buffers<T> {
    /// The samples, or their differences; 0 where there are none.
    samples: Vec<T>,
    /// What the inverse transform gives.
    values: Vec<T>,
    /// The size of the largest sample of every window.
    peaks: Vec<T>,
    spectrum: Vec<Complex<T>>,
    product: Vec<Complex<T>>,
    work: Vec<Complex<T>>,
}

impl<T: Sample> Buffers<T> {
    fn prepare(&mut self, half: usize, work: usize) -> Result<(), Error> {
        if self.spectrum.len() != half || self.work.len() != work {
            for real in [&mut self.samples, &mut self.values, &mut self.peaks] {
                resize(real, 2 * half)?;
            }
            for (complex, len) in [(&mut self.spectrum, half), (&mut self.product, half), (&mut self.work, work)] {
                *complex = try_vec(len, Complex::new(T::default(), T::default()))?;
            }
        }
        Ok(())
    }
}

impl<T: Sample> Fft<T> {
    pub(super) fn new(orders: &[&Taps]) -> Result<Self, Error> {
        let taps = orders.first().map_or(0, |taps| taps.double.len());
        let half = points(taps) / 2;
        let double = Negacyclic::<f64>::new(half)?;
        Ok(Self {
            orders: orders.iter().map(|taps| Order::new(taps, &double)).collect::<Result<_, Error>>()?,
            span: orders.first().map_or(0, |taps| taps.span()),
            taps,
            on_differences: orders.iter().all(|taps| taps.on_differences),
            transform: Negacyclic::new(half)?,
        })
    }

    pub(super) fn span(&self) -> usize {
        self.span
    }

    /// Outputs of a block.
    pub(super) fn grid(&self) -> usize {
        2 * self.transform.half() + 1 - self.taps.max(1)
    }

    pub(super) fn apply(
        &self,
        x: &[T],
        first: usize,
        origin: isize,
        outs: &mut [&mut [T]],
        scratch: &mut Scratch<T>,
    ) -> Result<(), Error> {
        scratch.fft.prepare(self.transform.half(), self.transform.work())?;
        Arch::new().dispatch(Apply { fft: self, x, first, origin, outs, buffers: &mut scratch.fft });
        Ok(())
    }
}

/// The length of the blocks for so many taps: the least cost per output.
///
/// A sample costs `log2(N)` and a bit for the loops around the transforms, more where the block leaves the caches.
fn points(taps: usize) -> usize {
    let cost = |points: &usize| {
        let octaves = (*points as f64).log2();
        let outputs = (points + 1).saturating_sub(taps.max(1)) as f64;
        (octaves - 4.0 + 1.5 * (octaves - 18.0).max(0.0)) * *points as f64 / outputs
    };
    let sizes = (8..usize::BITS - 4).flat_map(|octave| [1 << octave, 3 << (octave - 1)]);
    let useful = sizes.skip_while(|points| *points <= taps).take_while(|points| points / 16 <= taps.max(64));
    useful.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or(256)
}

impl<T: Sample> Order<T> {
    /// The taps meet the samples in reverse order, and what wraps around comes negated: tap k stands at N - k.
    fn new(taps: &Taps, transform: &Negacyclic<f64>) -> Result<Self, Error> {
        let half = transform.half();
        let mut sequence = try_vec(2 * half, 0.0)?;
        let share = 1.0 / half as f64;
        for (k, tap) in taps.double.iter().enumerate() {
            match k {
                0 => sequence[0] = tap * share,
                _ => sequence[2 * half - k] = -tap * share,
            }
        }
        let mut double = try_vec(half, Complex::new(0.0, 0.0))?;
        let mut work = try_vec(transform.work(), Complex::new(0.0, 0.0))?;
        transform.forward(&sequence, (1.0, 1.0), &mut double, &mut work);
        let mut spectrum = try_vec(half, Complex::new(T::default(), T::default()))?;
        for (point, double) in spectrum.iter_mut().zip(double) {
            *point = Complex::new(T::from_f64(double.re), T::from_f64(double.im));
        }
        Ok(Self { spectrum, exponent: exponent(taps.scale) - 1, anchor: taps.anchor })
    }

    /// What stands for the sum of a window that holds nothing but zeros, and what is added to that of any.
    fn anchors<'x>(&self, windows: &'x [T]) -> impl Iterator<Item = T> + use<'x, T> {
        let anchored = self.anchor.map(|anchor| &windows[anchor..]);
        (0..).map(move |index| anchored.map_or(T::default(), |samples| samples[index]))
    }
}

/// The part of a block that a call wants.
struct Part {
    /// Where the block's first sample lies in `x`.
    start: isize,
    /// The wanted windows, counted from the block's start.
    wanted: Range<usize>,
    /// Where their outputs lie in `outs`.
    outputs: Range<usize>,
}

struct Apply<'a, 'o, T: Sample> {
    fft: &'a Fft<T>,
    x: &'a [T],
    first: usize,
    origin: isize,
    outs: &'a mut [&'o mut [T]],
    buffers: &'a mut Buffers<T>,
}

impl<T: Sample> WithSimd for Apply<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _simd: S) {
        let outputs = self.outs.first().map_or(0, |out| out.len());
        let hop = self.fft.grid();
        let mut done = 0;
        while done < outputs {
            let first = (self.first + done).cast_signed();
            let offset = (self.origin + first).rem_euclid(hop.cast_signed());
            let skipped = offset.cast_unsigned();
            let end = outputs.min(done + hop - skipped);
            let wanted = skipped..skipped + end - done;
            self.block(&Part { start: first - offset, wanted, outputs: done..end });
            done = end;
        }
    }
}

impl<T: Sample> Apply<'_, '_, T> {
    #[inline(always)]
    fn block(&mut self, part: &Part) {
        let there = self.load(part.start);
        if let Some(peak) = loud(&self.buffers.samples[there.clone()], self.fft.taps) {
            self.level(part, peak, |_| true);
            return;
        }
        let Buffers { samples, values, peaks, .. } = &mut *self.buffers;
        window_peaks(samples, self.fft.taps, peaks, values);
        self.settle(part);
        if self.fft.taps == 0 {
            return;
        }
        let mut below = T::from_f64(f64::INFINITY);
        loop {
            // All windows that are there, wanted or not, decide on the levels.
            let windows = there.start..(there.end + 1).saturating_sub(self.fft.taps);
            let left = self.buffers.peaks[windows].iter().filter(|peak| **peak < below);
            let peak = left.fold(T::default(), |most, peak| if *peak > most { *peak } else { most });
            if peak <= T::default() {
                return;
            }
            let floor = peak * quiet();
            let served = move |size: T| size <= peak && size >= floor && size > T::default();
            if self.buffers.peaks[part.wanted.clone()].iter().any(|size| served(*size)) {
                self.level(part, peak, served);
            }
            below = floor;
        }
    }

    /// Fills `samples` with those of the block that are there, and says which.
    #[inline(always)]
    fn load(&mut self, start: isize) -> Range<usize> {
        let lag = usize::from(self.fft.on_differences);
        let samples = &mut self.buffers.samples;
        let place = |index: usize| (index.cast_signed() - start).clamp(0, samples.len().cast_signed()).cast_unsigned();
        let there = place(0)..place(self.x.len() - lag);
        let x = &self.x[(there.start.cast_signed() + start).cast_unsigned()..][..there.len() + lag];
        samples[..there.start].fill(T::default());
        samples[there.end..].fill(T::default());
        let samples = &mut samples[there.clone()];
        if self.fft.on_differences {
            for ((difference, older), newer) in samples.iter_mut().zip(x).zip(&x[1..]) {
                *difference = *newer - *older;
            }
        } else {
            samples.copy_from_slice(x);
        }
        there
    }

    /// Outputs of windows that hold nothing but zeros, or anything but numbers; the others follow.
    #[inline(always)]
    fn settle(&mut self, part: &Part) {
        let infinity = T::from_f64(f64::INFINITY);
        let windows = &self.x[(part.start + part.wanted.start.cast_signed()).cast_unsigned()..];
        for (order, out) in self.fft.orders.iter().zip(self.outs.iter_mut()) {
            let sizes = &self.buffers.peaks[part.wanted.clone()];
            for ((value, size), anchor) in out[part.outputs.clone()].iter_mut().zip(sizes).zip(order.anchors(windows)) {
                *value = if *size < infinity { anchor } else { T::from_f64(f64::NAN) };
            }
        }
    }

    /// Outputs of the windows whose largest sample is `served`, from the samples that are not larger than `peak`.
    #[inline(always)]
    fn level(&mut self, part: &Part, peak: T, served: impl Fn(T) -> bool) {
        let Fft { orders, transform, .. } = self.fft;
        let Buffers { samples, values, peaks, spectrum, product, work } = &mut *self.buffers;
        // Neither sums nor products of samples near 1 leave the range of numbers.
        let exponent = exponent(peak.to_f64()).clamp(-most::<T>(), most::<T>());
        transform.forward(samples, (peak, power(-exponent)), spectrum, work);
        let windows = &self.x[(part.start + part.wanted.start.cast_signed()).cast_unsigned()..];
        for (order, out) in orders.iter().zip(self.outs.iter_mut()) {
            multiply(spectrum, &order.spectrum, product);
            transform.inverse(product, work, values);
            let (half, rest) = halves(exponent + order.exponent);
            let sums = values[part.wanted.clone()].iter().zip(&peaks[part.wanted.clone()]);
            for ((value, (sum, size)), anchor) in
                out[part.outputs.clone()].iter_mut().zip(sums).zip(order.anchors(windows))
            {
                if served(*size) {
                    *value = *sum * half * rest + anchor;
                }
            }
        }
    }
}

/// The size of the largest sample, if it is a number and every window of so many holds one that is not quiet next to it.
///
/// It may overlook that: a window holds a whole piece, in which every lane is asked for a loud sample.
#[inline(always)]
fn loud<T: Sample>(samples: &[T], window: usize) -> Option<T> {
    let piece = window.div_ceil(2) / LANES * LANES;
    if piece == 0 {
        return None;
    }
    let larger = |a: T, b: T| if a > b { a } else { b };
    let smaller = |a: T, b: T| if a < b { a } else { b };
    let (mut most, mut least) = ([T::default(); LANES], [T::from_f64(f64::INFINITY); LANES]);
    // Remains 0 unless there is a NaN or inf.
    let mut lost = [T::default(); LANES];
    let mut pieces = samples.chunks_exact(piece);
    for piece in &mut pieces {
        let mut sizes = [T::default(); LANES];
        for row in piece.as_chunks::<LANES>().0 {
            for lane in 0..LANES {
                sizes[lane] = larger(size(row[lane]), sizes[lane]);
                lost[lane] = lost[lane] + (row[lane] - row[lane]);
            }
        }
        for lane in 0..LANES {
            most[lane] = larger(sizes[lane], most[lane]);
            least[lane] = smaller(sizes[lane], least[lane]);
        }
    }
    let mut peak = most.into_iter().fold(T::default(), larger);
    let mut lost = lost.into_iter().fold(T::default(), |sum, lost| sum + lost);
    for sample in pieces.remainder() {
        peak = larger(size(*sample), peak);
        lost = lost + (*sample - *sample);
    }
    let least = least.into_iter().fold(peak, smaller);
    (lost == T::default() && least >= peak * quiet() && least > T::default()).then_some(peak)
}

/// The size of the largest of the `window` samples from each on; infinite if one is not a number.
///
/// The reach of the maxima is doubled until the last step closes the window.
#[inline(always)]
fn window_peaks<T: Sample>(samples: &[T], window: usize, peaks: &mut Vec<T>, other: &mut Vec<T>) {
    let infinity = T::from_f64(f64::INFINITY);
    for (peak, sample) in peaks.iter_mut().zip(samples) {
        let size = size(*sample);
        *peak = if size < infinity { size } else { infinity };
    }
    if window == 0 {
        peaks.fill(T::default());
    }
    let (mut reach, mut len) = (1, samples.len());
    while reach < window {
        let step = reach.min(window - reach);
        len -= step;
        for ((to, near), far) in other[..len].iter_mut().zip(&peaks[..]).zip(&peaks[step..]) {
            *to = if far > near { *far } else { *near };
        }
        std::mem::swap(peaks, other);
        reach += step;
    }
}

#[inline(always)]
fn size<T: Sample>(sample: T) -> T {
    if sample < T::default() { T::default() - sample } else { sample }
}

fn quiet<T: Sample>() -> T {
    T::from_f64(if size_of::<T>() == 4 { QUIET_SINGLE } else { QUIET_DOUBLE })
}

/// The largest exponent whose powers of 2, up and down, are numbers with all their digits.
fn most<T>() -> i32 {
    if size_of::<T>() == 4 { 126 } else { 1022 }
}

/// The exponent e of `2^(e - 1) <= value < 2^e`.
fn exponent(value: f64) -> i32 {
    libm::frexp(value).1
}

fn power<T: Sample>(exponent: i32) -> T {
    T::from_f64(libm::ldexp(1.0, exponent))
}

/// Two factors whose product is `2^exponent`, which may be out of range itself.
fn halves<T: Sample>(exponent: i32) -> (T, T) {
    let half = (exponent / 2).clamp(-most::<T>(), most::<T>());
    (power(half), power((exponent - half).clamp(-most::<T>(), most::<T>())))
}

#[cfg(test)]
mod tests;
