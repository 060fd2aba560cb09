//! The element types that engines run in, and what the registers of the CPU do with them.

#![expect(clippy::indexing_slicing, reason = "eight lanes fill one register or more")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use std::fmt;
use std::ops::{Add, Mul, Sub};
use std::sync::OnceLock;

use algdiff_fft::Transforms;
use pulp::Simd;

use super::{Runner, Scratch, Taps, Windows};
use crate::bank::Runners;
use crate::error::Error;

/// The element types that engines run in.
pub trait Sample:
    Copy + Default + Send + Sync + fmt::Debug + PartialOrd + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    /// Rows that run side by side: as many as fit into 64 bytes.
    const LANES: usize = 64 / size_of::<Self>();
    /// Where the runners of this type are kept.
    fn runner(runners: &Runners) -> &OnceLock<Runner<Self>>;
    /// The taps in this type.
    fn taps(taps: &Taps) -> &[Self];
    /// A register of the CPU.
    type Register<S: Simd>: Copy + fmt::Debug;
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
    /// Lanes of a register that a condition holds for.
    type Mask<S: Simd>: Copy + fmt::Debug;
    /// The lanes up to number `lane`, and that one.
    fn up_to<S: Simd>(simd: S, lane: usize) -> Self::Mask<S>;
    /// `a` in the lanes of the mask, `b` in the others.
    fn choose<S: Simd>(simd: S, mask: Self::Mask<S>, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// The complex transforms of so many points.
    fn transforms(points: usize) -> Transforms<Self>;
    /// What [`Runner::apply`] does: for each type a function of its own, so that the engines are compiled here once, and not in
    /// every crate that calls them.
    fn apply(runner: &Runner<Self>, windows: Windows<'_, '_, Self>, scratch: &mut Scratch<Self>) -> Result<(), Error>;
    /// What [`Runner::apply_lanes`] does.
    fn apply_lanes(
        runner: &Runner<Self>,
        windows: Windows<'_, '_, Self>,
        scratch: &mut Scratch<Self>,
    ) -> Result<(), Error>;
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
    type Mask<S: Simd> = S::m64s;
    #[inline(always)]
    fn up_to<S: Simd>(simd: S, lane: usize) -> S::m64s {
        let numbers: [Self; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        simd.less_than_or_equal_f64s(S::as_simd_f64s(&numbers).0[0], simd.splat_f64s(lane as Self))
    }
    #[inline(always)]
    fn choose<S: Simd>(simd: S, mask: S::m64s, a: S::f64s, b: S::f64s) -> S::f64s {
        simd.select_f64s(mask, a, b)
    }
    fn transforms(points: usize) -> Transforms<Self> {
        Transforms::double(points)
    }
    fn apply(runner: &Runner<Self>, windows: Windows<'_, '_, Self>, scratch: &mut Scratch<Self>) -> Result<(), Error> {
        runner.run(windows, scratch)
    }
    fn apply_lanes(
        runner: &Runner<Self>,
        windows: Windows<'_, '_, Self>,
        scratch: &mut Scratch<Self>,
    ) -> Result<(), Error> {
        runner.run_lanes(windows, scratch)
    }
    #[inline]
    fn from_f64(value: f64) -> Self {
        value
    }
    #[inline]
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
    type Mask<S: Simd> = S::m32s;
    #[inline(always)]
    fn up_to<S: Simd>(simd: S, lane: usize) -> S::m32s {
        let numbers: [Self; 16] =
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
        simd.less_than_or_equal_f32s(S::as_simd_f32s(&numbers).0[0], simd.splat_f32s(lane as Self))
    }
    #[inline(always)]
    fn choose<S: Simd>(simd: S, mask: S::m32s, a: S::f32s, b: S::f32s) -> S::f32s {
        simd.select_f32s(mask, a, b)
    }
    fn transforms(points: usize) -> Transforms<Self> {
        Transforms::single(points)
    }
    fn apply(runner: &Runner<Self>, windows: Windows<'_, '_, Self>, scratch: &mut Scratch<Self>) -> Result<(), Error> {
        runner.run(windows, scratch)
    }
    fn apply_lanes(
        runner: &Runner<Self>,
        windows: Windows<'_, '_, Self>,
        scratch: &mut Scratch<Self>,
    ) -> Result<(), Error> {
        runner.run_lanes(windows, scratch)
    }
    #[inline]
    fn from_f64(value: f64) -> Self {
        value as Self
    }
    #[inline]
    fn to_f64(self) -> f64 {
        self.into()
    }
}
