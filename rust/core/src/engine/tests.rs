use super::{ENGINES, Runner, Sample, Scratch, Taps, Windows};

/// A parabola without its mean, as all engines take it.
fn taps() -> Taps {
    let weights: Vec<f64> = (0..61).map(|k| f64::from(k * k)).collect();
    let mean = weights.iter().sum::<f64>() / 61.0;
    Taps::on_differences(&weights.iter().map(|weight| weight - mean).collect::<Vec<_>>(), None).expect("small")
}

fn windows_start_where_they_are_asked_to<T: Sample>() {
    let rows: Vec<Vec<T>> = (0..T::LANES)
        .map(|lane| (0..900).map(|i| T::from_f64((f64::from(i) * 0.37 + lane as f64).sin())).collect())
        .collect();
    let side_by_side: Vec<T> = (0..900).flat_map(|i| rows.iter().map(move |row| row[i])).collect();
    for (name, engine) in ENGINES {
        let runner = Runner::<T>::new(engine, &[&taps()]).expect("polynomial");
        for first in [0, 1, 67, 500] {
            let (outputs, mut scratch) = (900 - 60 - first, Scratch::default());
            let mut lanes = vec![T::default(); outputs * T::LANES];
            let windows = Windows { x: &side_by_side, first, origin: -70, outs: &mut [&mut lanes] };
            runner.apply_lanes(windows, &mut scratch).expect("small");
            for (lane, x) in rows.iter().enumerate() {
                let mut row = vec![T::default(); outputs];
                let windows = Windows { x, first, origin: -70, outs: &mut [&mut row] };
                runner.apply(windows, &mut scratch).expect("small");
                assert!(row.iter().eq(lanes.iter().skip(lane).step_by(T::LANES)), "{name} {first} {lane}");
                assert!(row.iter().any(|value| *value != T::default()), "{name} {first} {lane}");
            }
        }
    }
}

#[test]
fn windows_of_neighbouring_rows_are_those_of_each_alone() {
    windows_start_where_they_are_asked_to::<f64>();
    windows_start_where_they_are_asked_to::<f32>();
}
