use super::*;

fn signal(length: usize) -> Vec<f64> {
    // A linear congruential generator: seeded, and rough enough to show any shift.
    let mut state = 12_345_u64;
    let step = |state: &mut u64| {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..length).map(|_| step(&mut state)).collect()
}

fn run(taps: &Taps, x: &[f64]) -> Vec<f64> {
    let mut out = vec![f64::NAN; x.len() + 1 - taps.span()];
    let direct = Direct::new(&[taps]).expect("small");
    direct.apply(Windows { x, first: 0, origin: 0, outs: &mut [&mut out] }, &mut Scratch::default()).expect("small");
    out
}

#[test]
fn agrees_with_the_plain_sum() {
    for (length, outputs) in [(1, 1), (2, 7), (5, 33), (61, 4096), (61, 4097), (200, 5000)] {
        let weights = signal(length);
        let x = signal(length + outputs - 1);
        let out = run(&Taps::plain(&weights).expect("small"), &x);
        for (i, value) in out.iter().enumerate() {
            let expected: f64 = weights.iter().zip(&x[i..]).map(|(w, x)| w * x).sum();
            assert!((value - expected).abs() <= 1e-16 * (length * length) as f64, "{length} {outputs} {i}");
        }
    }
}

#[test]
fn differences_agree_with_the_plain_sum_and_forget_the_offset() {
    for length in [2, 3, 8, 61] {
        let mut weights = signal(length);
        let mean = weights.iter().sum::<f64>() / length as f64;
        weights.iter_mut().for_each(|w| *w -= mean);
        let taps = Taps::on_differences(&weights, None).expect("small");
        assert_eq!(taps.span(), length);
        let x = signal(300);
        let out = run(&taps, &x);
        for (i, value) in out.iter().enumerate() {
            let expected: f64 = weights.iter().zip(&x[i..]).map(|(w, x)| w * x).sum();
            assert!((value - expected).abs() <= 1e-16 * (length * length) as f64);
        }
        assert!(run(&taps, &vec![1e300; 300]).iter().all(|value| *value == 0.0));
    }
}

#[test]
fn an_anchored_smoother_agrees_and_keeps_constants() {
    for (length, anchor) in [(1, 0), (2, 1), (5, 0), (5, 4), (37, 20)] {
        let mut weights = signal(length);
        let excess = (weights.iter().sum::<f64>() - 1.0) / length as f64;
        weights.iter_mut().for_each(|w| *w -= excess);
        let taps = Taps::on_differences(&weights, Some(anchor)).expect("small");
        assert_eq!(taps.span(), length);
        let x = signal(300);
        for (i, value) in run(&taps, &x).iter().enumerate() {
            let expected: f64 = weights.iter().zip(&x[i..]).map(|(w, x)| w * x).sum();
            assert!((value - expected).abs() <= 1e-16 * (length * length + 4) as f64, "{length} {anchor}");
        }
        assert!(run(&taps, &vec![1.1; 300]).iter().all(|value| *value == 1.1));
    }
}

#[test]
fn any_cut_gives_the_same_bits() {
    let weights = signal(37);
    let x = signal(9000);
    for taps in [Taps::plain(&weights).expect("small"), Taps::on_differences(&weights, None).expect("small")] {
        let whole = run(&taps, &x);
        for cut in [1, 7, 31, 32, 33, 4000, 4096, 4100] {
            let (left, right) = (run(&taps, &x[..cut + 36]), run(&taps, &x[cut..]));
            assert!(left.iter().chain(&right).map(|v| v.to_bits()).eq(whole.iter().map(|v| v.to_bits())));
        }
    }
}

/// The rows side by side as [`Direct::apply_lanes`] wants them.
fn side_by_side<T: Sample>(rows: &[Vec<T>]) -> Vec<T> {
    (0..rows[0].len()).flat_map(|at| rows.iter().map(move |row| row[at])).collect()
}

fn by_row<T: Sample, S: Simd>(simd: S, direct: &Direct<T>, x: &[T]) -> Vec<T> {
    let mut out = vec![T::from_f64(f64::NAN); x.len() + 1 - direct.span()];
    let mut scratch = Scratch::default();
    let outs = &mut [&mut out[..]];
    Simd::vectorize(simd, direct.rows(x, outs, &mut scratch).expect("small"));
    out
}

fn by_lanes<T: Sample, S: Simd>(simd: S, direct: &Direct<T>, rows: &[Vec<T>]) -> Vec<T> {
    let x = side_by_side(rows);
    let mut out = vec![T::from_f64(f64::NAN); x.len() + T::LANES - direct.span() * T::LANES];
    let mut scratch = Scratch::default();
    let outs = &mut [&mut out[..]];
    Simd::vectorize(simd, direct.lanes(&x, outs, &mut scratch).expect("small"));
    out
}

/// Window after window, as streams compute them.
fn windows_alone<T: Sample>(direct: &Direct<T>, x: &[T], channels: usize) -> Vec<T> {
    let span = direct.span();
    let output = |start: usize| {
        let mut out = vec![T::default(); channels];
        direct.latest(0, &x[start * channels..(start + span) * channels], channels, &mut out);
        out
    };
    (0..=x.len() / channels - span).flat_map(output).collect()
}

/// The sums as the order of the taps says, with nothing that is fast.
fn plainly<T: Sample>(taps: &Taps, x: &[T]) -> Vec<T> {
    let weights = T::taps(taps);
    let width = if weights.len() <= 16 { T::LANES / 2 } else { T::LANES };
    let stream: Vec<T> =
        if taps.on_differences { x.windows(2).map(|pair| pair[1] - pair[0]).collect() } else { x.to_vec() };
    let output = |start: usize| {
        let mut sum = T::default();
        for group in (0..weights.len()).step_by(4 * width) {
            for place in 0..width {
                for tap in (group + place..weights.len().min(group + 4 * width)).step_by(width) {
                    sum = sum + weights[tap] * stream[start + tap];
                }
            }
        }
        let own = T::from_f64(taps.scale);
        let scaled = if own.to_f64() == taps.scale { sum * own } else { T::from_f64(sum.to_f64() * taps.scale) };
        taps.anchor.map_or(scaled, |anchor| scaled + x[start + anchor])
    };
    (0..x.len() + 1 - taps.span()).map(output).collect()
}

/// On every width of registers, for rows and for neighbouring rows.
fn every_width_agrees<T: Sample>(taps: &Taps, outputs: usize) {
    let bits = |values: &[T]| values.iter().map(|value| value.to_f64().to_bits()).collect::<Vec<_>>();
    let noise = signal((outputs + taps.span() - 1) * T::LANES);
    let rows: Vec<Vec<T>> = noise
        .chunks(outputs + taps.span() - 1)
        .map(|row| row.iter().map(|value| T::from_f64(*value)).collect())
        .collect();
    let direct = Direct::<T>::new(&[taps]).expect("small");
    let expected: Vec<Vec<T>> = rows.iter().map(|row| plainly(taps, row)).collect();
    let (row, lanes) = (bits(&expected[0]), bits(&side_by_side(&expected)));
    let what = format!("{} taps, {outputs} outputs, {} lanes", T::taps(taps).len(), T::LANES);
    let check = |register: &str, by_row: Vec<T>, by_lanes: Vec<T>| {
        assert!(bits(&by_row) == row, "{register}: {what}, row");
        assert!(bits(&by_lanes) == lanes, "{register}: {what}, lanes");
    };
    macro_rules! on {
        ($name:literal, $simd:expr) => {
            check($name, by_row($simd, &direct, &rows[0]), by_lanes($simd, &direct, &rows))
        };
    }
    on!("scalar", pulp::Scalar);
    #[cfg(feature = "emulated-registers")]
    {
        on!("16 bytes", pulp::Scalar128b);
        on!("32 bytes", pulp::Scalar256b);
        on!("64 bytes", pulp::Scalar512b);
    }
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(simd) = pulp::x86::V3::try_new() {
            on!("AVX2", simd);
        }
        if let Some(simd) = pulp::x86::V4::try_new() {
            on!("AVX-512", simd);
        }
    }
    check("one window", windows_alone(&direct, &rows[0], 1), windows_alone(&direct, &side_by_side(&rows), T::LANES));
    let mut out = vec![T::default(); outputs];
    let windows = Windows { x: &rows[0], first: 0, origin: 0, outs: &mut [&mut out] };
    direct.apply(windows, &mut Scratch::default()).expect("small");
    assert!(bits(&out) == row, "dispatched: {what}");
}

#[test]
fn every_width_of_registers_gives_the_same_bits() {
    let lengths = [1, 2, 3, 5, 8, 9, 11, 16, 17, 18, 24, 31, 33, 37, 60, 61, 64, 65, 66, 97, 130];
    for length in lengths {
        let weights = signal(length);
        let smoother = Taps::on_differences(&weights, Some(length / 2)).expect("small");
        let derivative = Taps::on_differences(&weights, None).expect("small");
        for taps in [&Taps::plain(&weights).expect("small"), &smoother, &derivative] {
            for outputs in [1, 7, 8, 15, 16, 17, 33, 63, 64, 65, 129, 200] {
                every_width_agrees::<f64>(taps, outputs);
                every_width_agrees::<f32>(taps, outputs);
            }
        }
    }
}

#[test]
fn every_width_of_registers_gives_the_same_bits_at_the_edges_of_blocks() {
    let weights = signal(61);
    let taps = Taps::on_differences(&weights, None).expect("small");
    for outputs in [255, 256, 257, 287, 288, 289, 319, 320, 321, 1023, 1025, 1031, 1032, 1033, 2047, 2063, 2065, 3000] {
        every_width_agrees::<f64>(&taps, outputs);
        every_width_agrees::<f32>(&taps, outputs);
    }
}

#[test]
fn a_scale_beyond_float32_is_applied_in_double() {
    let weights: Vec<f64> = signal(37).iter().map(|weight| weight * 1e-44).collect();
    let taps = Taps::on_differences(&weights, None).expect("small");
    assert!(f64::from(taps.scale as f32) != taps.scale || taps.scale < f64::from(f32::MIN_POSITIVE));
    every_width_agrees::<f32>(&taps, 100);
    let weights: Vec<f64> = signal(37).iter().map(|weight| weight * 1e-60).collect();
    every_width_agrees::<f32>(&Taps::on_differences(&weights, Some(3)).expect("small"), 100);
}
