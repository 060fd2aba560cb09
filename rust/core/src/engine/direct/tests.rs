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
    direct.apply(x, 0, &mut [&mut out], &mut Scratch::default()).expect("small");
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
