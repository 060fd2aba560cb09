//! Parts of rows have the bits of whole rows, in every mode and layout.

use std::sync::Arc;

use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, Place};
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::rule::Rule;
use algdiff_core::run::{Job, Layout, Mode, Part};

const MODES: [Mode; 7] =
    [Mode::Fit, Mode::Valid, Mode::Nan, Mode::Nearest, Mode::Mirror, Mode::Wrap, Mode::Constant(0.5)];

fn bank(window_length: usize) -> Result<Bank, Error> {
    let place = Place::Tau(Tau::At(0.7));
    let plan = |deriv| {
        let (kappa, mu, degree, delta) = (1.0, 1.0, 3, 0.1);
        let design = Design { window_length, deriv, degree, kappa, mu, place, delta, rule: Rule::Exact, trim: 0.0 };
        Plan::new(&design, &Unattended).map(Arc::new)
    };
    Bank::new(vec![plan(1)?, plan(2)?], None)
}

/// Seeded numbers below a bound.
fn below(state: &mut u64, bound: usize) -> usize {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as usize % bound
}

#[test]
fn parts_have_the_bits_of_the_whole_or_are_refused() -> Result<(), Error> {
    let mut state = 7;
    let (mut fitted, mut refused) = (0, 0);
    for trial in 0..400 {
        let (mode, window_length) = (MODES[trial % 7], 5 + below(&mut state, 9));
        let (outer, inner) = [(1, 1), (9, 1), (1, 10), (2, 3)][trial % 4];
        let samples = window_length + below(&mut state, 50);
        let bank = bank(window_length)?;
        let x: Vec<f64> = (0..outer * samples * inner).map(|_| below(&mut state, 1000) as f64).collect();
        let job = Job::new(&bank, mode, Layout { outer, samples, inner });
        let outputs = job.outputs();
        let mut whole = vec![0.0; 2 * outer * outputs * inner];
        job.run(&x, &mut whole, &Unattended)?;

        let first = below(&mut state, outputs);
        let wanted = 1 + below(&mut state, outputs - first);
        let start = below(&mut state, first + 1);
        let held = samples - start - below(&mut state, samples - start);
        let part = Part { start, samples, first, outputs: wanted };
        let layout = Layout { outer, samples: held, inner };
        let cut: Vec<f64> = x
            .chunks(samples * inner)
            .flat_map(|matrix| &matrix[start * inner..(start + held) * inner])
            .copied()
            .collect();
        let mut out = vec![0.0; 2 * outer * wanted * inner];
        match (Job { part: Some(part), layout, ..job }).run(&cut, &mut out, &Unattended) {
            Ok(()) => {
                fitted += 1;
                let expected =
                    whole.chunks(outputs * inner).flat_map(|matrix| &matrix[first * inner..(first + wanted) * inner]);
                assert!(out.iter().map(|v| v.to_bits()).eq(expected.map(|v| v.to_bits())), "{part:?} {mode:?}");
            }
            Err(Error::Argument { name: "part", .. }) => refused += 1,
            Err(other) => return Err(other),
        }
    }
    assert!(fitted > 50 && refused > 50, "{fitted} {refused}");
    Ok(())
}
