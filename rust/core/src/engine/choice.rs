//! Which engine is likely to be the fastest: a model of what one output costs.
//!
//! The constants are nanoseconds of one core, fitted to `benches/engines.py`; only their ratios matter, and those depend on how
//! long the CPU's registers are. The length of the data is not among the arguments, so that a part of a row is computed as
//! the whole row is.

use pulp::{Arch, Simd, WithSimd};

use super::moments::Shape;
use super::{Engine, Taps, fft};

/// What the engines cost on a kind of CPU, in double and in single precision.
struct Costs {
    /// A tap, and an output.
    direct: ([f64; 2], f64),
    /// A multiplication of 64 bytes, and an order.
    moments: ([f64; 2], f64),
    /// A point of a transform.
    fft: [f64; 2],
}

/// Registers of 64 bytes, worked on whole: AMD Zen 5.
const LONG: Costs = Costs { direct: ([0.019, 0.0095], 0.3), moments: ([0.165, 0.165], 0.1), fft: [2.6, 1.3] };

/// Registers of 64 bytes, worked on in halves: AMD Zen 4.
const HALVES: Costs = Costs { direct: ([0.042, 0.021], 0.3), moments: ([0.30, 0.30], 0.1), fft: [2.6, 1.45] };

/// Registers of 32 bytes or fewer: AMD Zen 3.
const SHORT: Costs = Costs { direct: ([0.048, 0.024], 0.4), moments: ([0.30, 0.30], 0.1), fft: [3.6, 1.9] };

/// The costs on this kind of CPU.
fn costs() -> &'static Costs {
    match registers() {
        (64, true) => &LONG,
        (64, false) => &HALVES,
        _ => &SHORT,
    }
}

/// The bytes of the registers in use on this CPU, and whether it works on them whole.
#[must_use]
pub fn registers() -> (usize, bool) {
    struct Size;
    impl WithSimd for Size {
        type Output = usize;
        fn with_simd<S: Simd>(self, _simd: S) -> usize {
            size_of::<S::f64s>()
        }
    }
    let bytes = Arch::new().dispatch(Size);
    (bytes, bytes < 64 || !in_halves())
}

/// Whether this is a CPU that works on registers of 64 bytes in halves, which it does not say: the instructions that it has,
/// and one that later ones have, tell.
fn in_halves() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx512bf16") && !std::arch::is_x86_feature_detected!("avxvnni");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// The engines for these orders, cheapest first.
#[must_use]
pub fn ranked(orders: &[&Taps], single: bool) -> Vec<Engine> {
    let taps = orders.first().map_or(0, |order| order.double.len());
    let costs = costs();
    let of = |[double, float]: [f64; 2]| if single { float } else { double };
    let count = orders.len() as f64;
    let direct = costs.direct.1 + count * of(costs.direct.0) * taps as f64;
    let mut found = vec![(direct, Engine::Direct)];
    // Below this nothing else has a chance, and looking for a polynomial would take longer than short calls do.
    if taps >= 30 {
        found.push((of(costs.fft) * fourier(taps, orders.len()), Engine::Fft));
        if let Ok(Some(shape)) = Shape::of(orders, if single { 16 } else { 8 }) {
            let (shared, each) = shape.cost;
            let moments = count * costs.moments.1 + of(costs.moments.0) * (shared + each * count);
            found.push((moments, Engine::Moments));
        }
    }
    found.sort_by(|one, other| one.0.total_cmp(&other.0));
    found.into_iter().map(|(_, engine)| engine).collect()
}

/// One transform forth, and one back for every order, in points of a short one.
fn fourier(taps: usize, orders: usize) -> f64 {
    let points = fft::points(taps) as f64;
    let octaves = points.log2();
    // Long blocks leave the caches.
    let per_point = 1.0 + 0.12 * (octaves - 9.0) + 0.4 * (octaves - 16.0).max(0.0);
    0.5 * (1 + orders) as f64 * per_point * points / (points - taps as f64 + 1.0)
}
