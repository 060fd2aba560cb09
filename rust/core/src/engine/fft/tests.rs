use super::super::{Engine, Runner};
use super::loudness::{QUIET_DOUBLE, loud, quiet};
use super::*;

/// A linear congruential generator: seeded, and rough enough to show any shift.
fn signal(length: usize) -> Vec<f64> {
    let mut state = 12_345_u64;
    let mut step = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..length).map(|_| step()).collect()
}

/// Weights that sum to `sum`, and their taps on differences.
fn weights(length: usize, sum: f64) -> Vec<f64> {
    let mut weights = signal(length);
    let excess = (weights.iter().sum::<f64>() - sum) / length as f64;
    weights.iter_mut().for_each(|w| *w -= excess);
    weights
}

fn derivative(length: usize) -> Taps {
    Taps::on_differences(&weights(length, 0.0), None).expect("small")
}

fn fft<T: Sample>(orders: &[&Taps]) -> Runner<T> {
    Runner::new(Engine::Fft, orders).expect("small")
}

/// Outputs `from..` of the row `x`, whose first sample is `origin`.
fn part<T: Sample>(runner: &Runner<T>, x: &[T], from: usize, count: usize, origin: isize) -> Vec<T> {
    let mut out = vec![T::from_f64(777.0); count];
    runner.apply(Windows { x, first: from, origin, outs: &mut [&mut out] }, &mut Scratch::default()).expect("small");
    out
}

fn whole<T: Sample>(taps: &Taps, x: &[T]) -> Vec<T> {
    part(&fft(&[taps]), x, 0, x.len() + 1 - taps.span(), 0)
}

fn same<T: Sample>(a: &[T], b: &[T]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_f64().to_bits() == b.to_f64().to_bits())
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|value| value * value).sum::<f64>().sqrt()
}

/// Holds every output to the bound of the module, in which the block's samples are those up to `1 / quiet` times the
/// largest of the window, and to what the plain sum itself may lose.
fn check<T: Sample>(taps: &Taps, x: &[f64], eps: f64) {
    let x: Vec<T> = x.iter().map(|x| T::from_f64(*x)).collect();
    let out = whole(taps, &x);
    let samples: Vec<f64> = if taps.on_differences {
        x.windows(2).map(|pair| (pair[1] - pair[0]).to_f64()).collect()
    } else {
        x.iter().map(|x| x.to_f64()).collect()
    };
    let (runner, length) = (fft::<T>(&[taps]), taps.double.len());
    let hop = runner.grid();
    let octaves = ((hop + length) as f64).log2().ceil();
    let norm_taps = norm(taps.double.iter().copied()) * taps.scale;
    let step = (out.len() / 3000).max(1);
    for i in (0..out.len()).step_by(step) {
        let window = &samples[i..i + length];
        let value = out[i].to_f64();
        if window.iter().any(|sample| !sample.is_finite()) {
            assert!(!value.is_finite(), "{i} {value}");
            continue;
        }
        let anchor = taps.anchor.map_or(0.0, |anchor| x[i + anchor].to_f64());
        let sum: f64 = window.iter().zip(&taps.double).map(|(sample, tap)| sample * tap * taps.scale).sum();
        let naive = window.iter().zip(&taps.double).map(|(sample, tap)| (sample * tap * taps.scale).abs()).sum::<f64>();
        let loudest = window.iter().fold(0.0, |most: f64, sample| most.max(sample.abs()));
        let start = i / hop * hop;
        let end = samples.len().min(start + hop + length - 1);
        let counted = samples[start..end].iter().filter(|s| s.abs() <= loudest / quiet::<T>().to_f64());
        let spread = 8.0 * eps * octaves * norm_taps * norm(counted.copied());
        let rounding = eps * anchor.abs() + f64::EPSILON * (length as f64 * naive + anchor.abs());
        let expected = sum + anchor;
        assert!((value - expected).abs() <= spread + rounding, "{length} {i}: {value} {expected} {spread}");
        assert!(loudest > 0.0 || value == anchor, "{length} {i}: a quiet window gave {value}");
    }
}

fn check_both(taps: &Taps, x: &[f64]) {
    check::<f64>(taps, x, f64::EPSILON);
    check::<f32>(taps, x, f32::EPSILON.into());
}

#[test]
fn agrees_with_the_plain_sum() {
    for length in [1, 2, 5, 15, 61, 500, 1001] {
        let plain = Taps::plain(&signal(length)).expect("small");
        let hop = fft::<f64>(&[&plain]).grid();
        for outputs in [1, 7, hop - 1, hop, hop + 1, 3 * hop + 5] {
            check_both(&plain, &signal(length + outputs - 1));
        }
        if length > 1 {
            check_both(&derivative(length), &signal(3 * hop));
        }
        let smoother = Taps::on_differences(&weights(length, 1.0), Some(length / 3)).expect("small");
        check_both(&smoother, &signal(3 * hop));
    }
}

#[test]
fn no_signal_leaves_the_bound() {
    let noise = signal(9000);
    let place = |i: usize| i as f64;
    let shapes: [&dyn Fn(usize) -> f64; 7] = [
        &|i| 3.0 * place(i) - 7.0,
        &|i| if i < 4321 { 0.0 } else { 1.0 },
        &|i| if i == 4321 { 1.0 } else { 0.0 },
        &|i| noise[i] * if (4000..4100).contains(&i) { 1e12 } else { 1.0 },
        &|i| noise[i] * (-place(i) / 100.0).exp(),
        &|i| noise[i] + 1e6,
        &|i| (place(i) / 300.0).sin().powi(9),
    ];
    for shape in shapes {
        let x: Vec<f64> = (0..9000).map(shape).collect();
        for length in [5, 61, 1001] {
            check_both(&derivative(length), &x);
            check_both(&Taps::on_differences(&weights(length, 1.0), Some(length / 2)).expect("small"), &x);
        }
    }
}

#[test]
fn constants_are_kept_to_the_bit() {
    for value in [0.0, 1.1, -1e300, 5e-324] {
        let x = vec![value; 3000];
        assert!(whole(&derivative(61), &x).iter().all(|out| *out == 0.0));
        let smoother = Taps::on_differences(&weights(61, 1.0), Some(30)).expect("small");
        assert!(whole(&smoother, &x).iter().all(|out| *out == value));
    }
    // Between steps as well.
    let x: Vec<f64> = (0..3000).map(|i| f64::from(i / 500) * 0.1).collect();
    for (i, out) in whole(&derivative(61), &x).iter().enumerate() {
        assert!(x[i] != x[i + 60] || *out == 0.0, "{i}");
    }
}

#[test]
fn what_is_not_a_number_spoils_its_own_windows_only() {
    for length in [5, 61, 500] {
        let mut x = signal(6000);
        (x[0], x[1500], x[3100], x[5999]) = (f64::INFINITY, f64::NAN, f64::NEG_INFINITY, f64::NAN);
        // Their difference overflows.
        (x[4000], x[4001]) = (1.7e308, -1.7e308);
        check::<f64>(&derivative(length), &x, f64::EPSILON);
        x.iter_mut().for_each(|x| *x = x.clamp(-3e38, 3e38));
        check::<f32>(&derivative(length), &x, f32::EPSILON.into());
        // So that no sum overflows on its way.
        x.iter_mut().for_each(|x| *x = x.clamp(-1e37, 1e37));
        let single = Taps::on_differences(&weights(length, 1.0), Some(length - 1)).expect("small");
        check::<f32>(&single, &x, f32::EPSILON.into());
    }
    let x = [1.0, f64::NAN, f64::INFINITY, -0.5];
    let out = whole(&Taps::on_differences(&[1.0], Some(0)).expect("small"), &x);
    assert!(out[0] == 1.0 && out[1].is_nan() && out[2] == f64::INFINITY && out[3] == -0.5);
}

#[test]
fn sizes_at_the_ends_of_the_range_neither_overflow_nor_vanish() {
    let taps = derivative(61);
    let x = signal(3000);
    let out = whole(&taps, &x);
    for exponent in [-1000, -200, 900, 1020] {
        let scaled: Vec<f64> = x.iter().map(|x| libm::ldexp(*x, exponent)).collect();
        let expected: Vec<f64> = out.iter().map(|out| libm::ldexp(*out, exponent)).collect();
        assert!(same(&whole(&taps, &scaled), &expected), "{exponent}");
    }
    let huge: Vec<f64> = weights(61, 0.0).iter().map(|w| w * 1e300).collect();
    let tiny: Vec<f64> = x.iter().map(|x| x * 1e-300).collect();
    check::<f64>(&Taps::on_differences(&huge, None).expect("small"), &tiny, f64::EPSILON);
}

#[test]
fn cuts_change_no_bit() {
    let mut x = signal(40_000);
    x[20_000] = 1e9;
    (x[30_000], x[10_000]) = (f64::NAN, f64::INFINITY);
    for length in [2, 61, 1001] {
        let taps = derivative(length);
        let runner = fft::<f64>(&[&taps]);
        let (hop, outputs) = (runner.grid(), x.len() + 1 - length);
        let all = part(&runner, &x, 0, outputs, 0);
        for (from, count) in [(0, 1), (hop, hop), (2 * hop, outputs - 2 * hop), (hop / 2, 3), (outputs - 1, 1)] {
            // On the whole row any part of the outputs.
            assert!(same(&part(&runner, &x, from, count, 0), &all[from..from + count]), "{length} {from}");
            // With only the samples of its blocks.
            let (start, end) = (from / hop * hop, ((from + count).div_ceil(hop) * hop + length - 1).min(x.len()));
            let cut = part(&runner, &x[start..end], from - start, count, start.cast_signed());
            assert!(same(&cut, &all[from..from + count]), "{length} {from}");
        }
    }
}

#[test]
fn the_grid_lies_on_the_row() {
    let taps = derivative(61);
    let runner = fft::<f64>(&[&taps]);
    let hop = runner.grid();
    let x = signal(5 * hop);
    let all = part(&runner, &x, 0, x.len() - 60, 0);
    // Whole blocks further, or before the row's first sample: the same; between: the same up to rounding only.
    for blocks in [-3, -1, 2] {
        assert!(same(&part(&runner, &x, 0, all.len(), blocks * hop.cast_signed()), &all));
    }
    let between = part(&runner, &x, 0, all.len(), -7);
    assert!(!same(&between, &all));
    assert!(same(&part(&runner, &x[7..], 0, 2 * hop, 0), &between[7..][..2 * hop]));
    assert!(between.iter().zip(&all).all(|(a, b)| (a - b).abs() <= 1e-12));
}

#[test]
fn several_orders_equal_each_alone() {
    let mut x = signal(9000);
    (x[5000], x[1234]) = (1e12, f64::NAN);
    let orders = [derivative(201), derivative(201), Taps::on_differences(&weights(201, 1.0), Some(7)).expect("small")];
    let outputs = x.len() - 200;
    let mut outs = vec![vec![0.0; outputs]; 3];
    let runner = fft::<f64>(&orders.each_ref());
    let mut each: Vec<&mut [f64]> = outs.iter_mut().map(Vec::as_mut_slice).collect();
    runner.apply(Windows { x: &x, first: 0, origin: 0, outs: &mut each }, &mut Scratch::default()).expect("small");
    for (taps, out) in orders.iter().zip(&outs) {
        assert!(same(&whole(taps, &x), out));
    }
}

#[test]
fn the_short_way_finds_what_the_windows_hold() {
    for window in [15, 16, 60, 1000] {
        for length in [window, window + 1, 2 * window + 3, 5000] {
            let mut samples = signal(length.max(window));
            let exact = |samples: &[f64]| {
                let sizes = |part: &[f64]| part.iter().fold(0.0, |most: f64, s| most.max(s.abs()));
                let least = samples.windows(window).map(sizes).fold(f64::INFINITY, f64::min);
                let most = sizes(samples);
                (least >= most * QUIET_DOUBLE).then_some(most)
            };
            // Where a lane sees a single sample it may overlook that this one is loud.
            let found = loud(&samples, window);
            assert!(found == exact(&samples) || found.is_none() && window < 60, "{window} {length}");
            let middle = samples.len() / 2;
            samples[middle] = 600.0;
            assert!(loud(&samples, window).is_none() || exact(&samples).is_some());
            samples[middle] = f64::NAN;
            assert_eq!(loud(&samples, window), None);
        }
    }
}

#[test]
fn blocks_are_longer_than_the_taps() {
    for taps in [0, 1, 2, 255, 256, 257, 4000, (1 << 20) - 1, 1 << 20, 10_000_000, (1 << 23) - 1, 100_000_000] {
        let points = points(taps);
        assert!(points > taps + taps / 20 && points <= (1 << 20).max(2 * taps), "{taps} {points}");
        assert!(taps > 100_000 || points <= 64 * taps.max(8), "{taps} {points}");
    }
}
