//! Which engine is likely to be the fastest: a model of what one output costs.
//!
//! The constants are nanoseconds of one core with 32-byte registers, fitted to `benches/engines.py`; only their ratios
//! matter. The length of the data is not among the arguments, so that a part of a row is computed as the whole row is.

use super::moments::Shape;
use super::{Engine, Taps, fft};

/// The engines for these orders, cheapest first.
#[must_use]
pub fn ranked(orders: &[&Taps], single: bool) -> Vec<Engine> {
    let taps = orders.first().map_or(0, |order| order.double.len());
    let mut costs = vec![(direct(taps, orders.len(), single), Engine::Direct)];
    // Below this nothing else has a chance, and looking for a polynomial would take longer than short calls do.
    if taps >= 40 {
        costs.push((fourier(taps, orders.len(), single), Engine::Fft));
        if let Ok(Some(shape)) = Shape::of(orders, if single { 16 } else { 8 }) {
            costs.push((moments(&shape, orders.len(), single), Engine::Moments));
        }
    }
    costs.sort_by(|one, other| one.0.total_cmp(&other.0));
    costs.into_iter().map(|(_, engine)| engine).collect()
}

/// Bound by the loads and multiplications of every tap.
fn direct(taps: usize, orders: usize, single: bool) -> f64 {
    let per_tap = if single { 0.024 } else { 0.048 };
    0.4 + orders as f64 * per_tap * taps as f64
}

/// Bound by multiplications.
fn moments(shape: &Shape, orders: usize, single: bool) -> f64 {
    let (shared, each) = shape.cost;
    let per_product = if single { 0.14 } else { 0.14 };
    0.3 + per_product * (shared + each * orders as f64)
}

/// One transform forth, and one back for every order.
fn fourier(taps: usize, orders: usize, single: bool) -> f64 {
    let points = fft::points(taps) as f64;
    let octaves = points.log2();
    // Long blocks leave the caches.
    let per_point = 3.6 + 0.42 * (octaves - 9.0) + 1.5 * (octaves - 16.0).max(0.0);
    let precision = if single { 0.52 } else { 1.0 };
    precision * 0.5 * (1 + orders) as f64 * per_point * points / (points - taps as f64 + 1.0)
}
