use pulp::Simd;

use super::super::{Engine, Runner, Scratch, Taps};
use super::*;

/// A linear congruential generator: seeded, and rough enough to show any shift.
fn noise(length: usize) -> Vec<f64> {
    let mut state = 12_345_u64;
    let step = |state: &mut u64| {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..length).map(|_| step(&mut state)).collect()
}

/// Weights that are a polynomial of degree `degree` and sum to zero, or to one.
fn weights(length: usize, degree: usize, sum: f64) -> Vec<f64> {
    let place = |k: usize| 2.0 * (k as f64 + 0.5) / length as f64 - 1.0;
    let mut weights: Vec<f64> =
        (0..length).map(|k| (1..=degree).map(|d| (0.3 + d as f64) * place(k).powi(d as i32)).sum::<f64>()).collect();
    let excess = (weights.iter().sum::<f64>() - sum) / length as f64;
    weights.iter_mut().for_each(|w| *w -= excess);
    weights
}

fn naive(weights: &[f64], x: &[f64]) -> Vec<f64> {
    let origin = |window: &[f64]| window[0];
    let sum = |window: &[f64]| {
        let terms = weights.iter().zip(window).map(|(w, x)| w * (x - origin(window)));
        terms.sum::<f64>() + origin(window) * weights.iter().sum::<f64>().round()
    };
    x.windows(weights.len()).map(sum).collect()
}

fn run<T: Sample>(runner: &Runner<T>, x: &[T], first: usize, origin: isize, outputs: usize) -> Vec<T> {
    let mut out = vec![T::from_f64(f64::NAN); outputs];
    runner.apply(Windows { x, first, origin, outs: &mut [&mut out] }, &mut Scratch::default()).expect("small");
    out
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn designs() -> impl Iterator<Item = (Vec<f64>, Taps)> {
    // The last is longer than what is kept in one piece.
    let sizes = [25, 26, 33, 61, 100, 111, 128, 129, 300, 501, 1001, 2500, 9001];
    sizes.into_iter().flat_map(|length| {
        [(2, 0.0), (5, 0.0), (3, 1.0)].into_iter().map(move |(degree, sum)| {
            let weights = weights(length, degree, sum);
            let anchor = (sum > 0.0).then_some(length / 3);
            let taps = Taps::on_differences(&weights, anchor).expect("small");
            (weights, taps)
        })
    })
}

#[test]
fn agrees_with_the_plain_sum_within_its_bound() {
    for (weights, taps) in designs() {
        let runner = Runner::<f64>::new(Engine::Moments, &[&taps]).expect("polynomial");
        let Runner::Moments(moments) = &runner else { panic!("another engine") };
        let x = noise(weights.len() + 1499);
        // Differences of values below 1/2 are below 1; the plain sum errs as well.
        let size: f64 = taps.double.iter().map(|tap| tap.abs()).sum::<f64>() * taps.scale + 1.0;
        let bound = (moments.error_bound() + 4.0 * weights.len() as f64) * f64::EPSILON * size;
        let (got, expected) = (run(&runner, &x, 0, 0, 1500), naive(&weights, &x));
        for (i, (got, expected)) in got.iter().zip(expected).enumerate() {
            assert!((got - expected).abs() <= bound, "{} {i} {:?}", weights.len(), moments.tables.shape);
        }
    }
}

#[test]
fn no_cut_and_no_lane_changes_a_bit() {
    for (weights, taps) in designs() {
        let runner = Runner::<f64>::new(Engine::Moments, &[&taps]).expect("polynomial");
        let x = noise(weights.len() + 1499);
        let whole = run(&runner, &x, 0, -70, 1500);
        for cut in [1, 7, 63, 64, 511, 700, 1499] {
            let left = run(&runner, &x[..cut + weights.len() - 1], 0, -70, cut);
            let right = run(&runner, &x[cut..], 0, cut.cast_signed() - 70, 1500 - cut);
            let inside = run(&runner, &x, cut, -70, 1500 - cut);
            assert_eq!(bits(&left), bits(&whole[..cut]), "{} {cut}", weights.len());
            assert_eq!(bits(&right), bits(&whole[cut..]), "{} {cut}", weights.len());
            assert_eq!(bits(&inside), bits(&whole[cut..]), "{} {cut}", weights.len());
        }
        let side_by_side: Vec<f64> = x.iter().flat_map(|x| [*x, 0.0, f64::NAN, -*x, 1.0, 2.0 * *x, *x, 1e9]).collect();
        let mut out = vec![0.0; 8 * 1500];
        let windows = Windows { x: &side_by_side, first: 0, origin: -70, outs: &mut [&mut out] };
        runner.apply_lanes(windows, &mut Scratch::default()).expect("small");
        let lane = |lane: usize| bits(&out.iter().skip(lane).step_by(8).copied().collect::<Vec<_>>());
        assert_eq!(lane(0), bits(&whole));
        assert_eq!(lane(6), bits(&whole));
        assert!(out.iter().skip(2).step_by(8).all(|value| value.is_nan()));
    }
}

#[test]
fn what_is_not_finite_stays_in_the_windows_that_hold_it() {
    for (weights, taps) in designs() {
        let runner = Runner::<f64>::new(Engine::Moments, &[&taps]).expect("polynomial");
        let mut x = noise(weights.len() + 899);
        let clean = run(&runner, &x, 0, 0, 900);
        let bad = weights.len() / 2 + 400;
        x[bad] = f64::NAN;
        for (i, (got, clean)) in run(&runner, &x, 0, 0, 900).iter().zip(clean).enumerate() {
            let held = i <= bad && bad < i + weights.len();
            assert!(if held { got.is_nan() } else { got.to_bits() == clean.to_bits() }, "{} {i}", weights.len());
        }
    }
}

#[test]
fn constants_are_exact_and_single_precision_is_close() {
    for (weights, taps) in designs() {
        let runner = Runner::<f64>::new(Engine::Moments, &[&taps]).expect("polynomial");
        let expected = if taps.anchor.is_some() { 1.1 } else { 0.0 };
        assert!(run(&runner, &vec![1.1; weights.len() + 99], 0, 0, 100).iter().all(|value| *value == expected));
        let single = Runner::<f32>::new(Engine::Moments, &[&taps]).expect("polynomial");
        let Runner::Moments(moments) = &single else { panic!("another engine") };
        let x = noise(weights.len() + 99);
        let narrow: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        let size: f64 = taps.double.iter().map(|tap| tap.abs()).sum::<f64>() * taps.scale + 1.0;
        let bound = (moments.error_bound() + 4.0 * weights.len() as f64) * f64::from(f32::EPSILON) * size;
        for (got, expected) in run(&single, &narrow, 0, 0, 100).iter().zip(naive(&weights, &x)) {
            assert!((f64::from(*got) - expected).abs() <= bound);
        }
    }
}

#[test]
fn what_is_no_polynomial_is_refused() {
    let bent: Vec<f64> = (0..101).map(|k| (f64::from(k) - 50.0).signum()).collect();
    let root: Vec<f64> = (0..101).map(|k| (f64::from(k) + 0.5).sqrt() - 6.7).collect();
    for weights in [bent, root, weights(20, 3, 0.0)] {
        let taps = Taps::plain(&weights).expect("small");
        assert!(Runner::<f64>::new(Engine::Moments, &[&taps]).is_err());
    }
}

#[test]
fn the_first_and_the_last_tap_are_free() {
    let mut weights = weights(200, 4, 0.0);
    weights[0] = 3.0;
    weights[199] = -7.0;
    let taps = Taps::plain(&weights).expect("small");
    let runner = Runner::<f64>::new(Engine::Moments, &[&taps]).expect("polynomial");
    let x = noise(700);
    let sums = x.windows(200).map(|window| weights.iter().zip(window).map(|(w, x)| w * x).sum::<f64>());
    for (got, expected) in run(&runner, &x, 0, 0, 501).iter().zip(sums) {
        assert!((got - expected).abs() <= 1e-12);
    }
}

/// The outputs of a row, and of the same row in every lane, by one kind of registers.
fn by_registers<T: Sample, S: Simd>(simd: S, moments: &Moments<T>, x: &[T], outputs: usize) -> [Vec<T>; 2] {
    let (origin, tables) = (-70, &moments.tables);
    let mut row = vec![T::from_f64(f64::NAN); outputs];
    let mut room = Room::default();
    room.prepare(tables, 1, tables.stride).expect("small");
    Simd::vectorize(
        simd,
        Run { moments, windows: Windows { x, first: 0, origin, outs: &mut [&mut row] }, room: &mut room },
    );
    let mut lanes = vec![T::from_f64(f64::NAN); outputs * T::LANES];
    let x: Vec<T> = x.iter().flat_map(|value| std::iter::repeat_n(*value, T::LANES)).collect();
    room.prepare(tables, T::LANES, tables.shape.moments * T::LANES).expect("small");
    Simd::vectorize(
        simd,
        Rows(Run { moments, windows: Windows { x: &x, first: 0, origin, outs: &mut [&mut lanes] }, room: &mut room }),
    );
    [row, lanes]
}

/// On every width of registers, for rows and for neighbouring rows, whatever this CPU takes.
fn every_width_agrees<T: Sample>(eps: f64) {
    for (weights, taps) in designs() {
        let Some(moments) = Moments::<T>::new(&[&taps]).expect("small") else { panic!("no polynomial") };
        let x: Vec<T> = noise(weights.len() + 699).into_iter().map(T::from_f64).collect();
        let exact: Vec<f64> = x.iter().map(|value| value.to_f64()).collect();
        let expected = naive(&weights, &exact);
        let size: f64 = taps.double.iter().map(|tap| tap.abs()).sum::<f64>() * taps.scale + 1.0;
        let bound = ((moments.error_bound() + 2.0) * eps + 4.0 * weights.len() as f64 * f64::EPSILON) * size;
        let check = |register: &str, [row, lanes]: [Vec<T>; 2]| {
            for (i, (got, expected)) in row.iter().zip(&expected).enumerate() {
                let error = (got.to_f64() - expected).abs();
                assert!(error <= bound, "{register}: {} {i} {error:e} {:?}", weights.len(), moments.tables.shape);
            }
            let same = lanes.iter().enumerate().all(|(at, value)| *value == row[at / T::LANES]);
            assert!(same, "{register}: {} lanes {:?}", weights.len(), moments.tables.shape);
        };
        macro_rules! on {
            ($name:literal, $simd:expr) => {
                check($name, by_registers($simd, &moments, &x, 700))
            };
        }
        on!("scalar", pulp::Scalar);
        #[cfg(feature = "emulated-registers")]
        on!("16 bytes", pulp::Scalar128b);
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(simd) = pulp::x86::V3::try_new() {
                on!("AVX2", simd);
            }
            if let Some(simd) = pulp::x86::V4::try_new() {
                on!("AVX-512", simd);
            }
        }
    }
}

#[test]
fn every_width_of_registers_keeps_the_bound() {
    every_width_agrees::<f64>(f64::EPSILON);
    every_width_agrees::<f32>(f64::from(f32::EPSILON));
}
