//! Signals made of bytes.

use algdiff_core::engine::Sample;
use arbitrary::{Result, Unstructured};

use crate::numbers::{Real, noise};

/// Sizes of signals: of float32 as of float64, sums of 400 products neither overflow, nor is every one of them lost.
const SIZES: [f64; 8] = [1.0, 1.0, 1.0, 1e-3, 1e9, 1e25, 1e-25, 1e-40];

/// Noise, a ramp, steps and constants, far from 0 or not, with some samples that are anything.
pub fn signal<T: Sample>(u: &mut Unstructured<'_>, length: usize) -> Result<Vec<T>> {
    let (mut state, size) = (u64::from(u.arbitrary::<u16>()?), *u.choose(&SIZES)?);
    let offset = *u.choose(&[0.0, 0.0, 1.0, -1e6])?;
    let shape = u.int_in_range(0..=4)?;
    let place = u.int_in_range(0..=length.max(1))?;
    let mut x: Vec<T> = (0..length)
        .map(|index| match shape {
            0 => 1.0,
            1 => index as f64 - place as f64,
            2 => f64::from(index < place) + 1e-6 * noise(&mut state),
            3 if index < place => 1e8 * noise(&mut state),
            _ => noise(&mut state),
        })
        .map(|value| T::from_f64(size * (value + offset)))
        .collect();
    for _ in 0..u.int_in_range(0..=3)? {
        let at = u.int_in_range(0..=length.saturating_sub(1))?;
        let value = T::from_f64(u.arbitrary::<Real>()?.0);
        // Sums that overflow are for no bound to tell.
        let value = if value.to_f64().abs() > 1e28 { T::from_f64(1e28) } else { value };
        let any = [value, T::from_f64(f64::NAN), T::from_f64(f64::INFINITY), T::from_f64(f64::NEG_INFINITY)];
        if let Some(sample) = x.get_mut(at) {
            *sample = *u.choose(&any)?;
        }
    }
    Ok(x)
}

/// Whether values have the same bits, whatever bits a NaN has.
pub fn same<T: Sample>(a: &[T], b: &[T]) -> bool {
    let bits = |value: f64| (!value.is_nan()).then(|| value.to_bits());
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| bits(a.to_f64()) == bits(b.to_f64()))
}
