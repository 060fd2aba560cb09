//! Laws that hold for every design and every signal, on random ones; a failure is shrunk to its smallest case.

#![expect(clippy::indexing_slicing, reason = "a test may stop where it is wrong")]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use algdiff_core::bank::Bank;
use algdiff_core::control::{Control, Unattended};
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::{ENGINES, Engine, Runner, Sample, Scratch, Windows};
use algdiff_core::error::Error;
use algdiff_core::jacobi::Jacobi;
use algdiff_core::kernel::{Kernel, Tau};
use algdiff_core::plan::Plan;
use algdiff_core::response::Response;
use algdiff_core::rule::{RULES, Rule};
use algdiff_core::run::{Job, Layout, Mode};
use algdiff_core::stream::Stream;
use proptest::collection::vec;
use proptest::num::f64::ANY;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::RngSeed;

const MODES: [Mode; 7] =
    [Mode::Fit, Mode::Valid, Mode::Nan, Mode::Nearest, Mode::Mirror, Mode::Wrap, Mode::Constant(0.5)];

/// 1024 cases, the same every time; with `PROPTEST_CASES` four times as many, which are new every time.
fn config() -> ProptestConfig {
    let asked = std::env::var_os("PROPTEST_CASES").is_some();
    let (rng_seed, usual) = (if asked { RngSeed::Random } else { RngSeed::Fixed(2007) }, ProptestConfig::default());
    ProptestConfig { cases: 4 * usual.cases, rng_seed, failure_persistence: None, ..usual }
}

/// Designs of moderate size: at least two samples for every coefficient.
fn designs() -> impl Strategy<Value = Design> {
    let exponents = || select(vec![0.0, 0.5, 1.0, 2.0, 3.7]);
    let sizes = (0_usize..4, 0_usize..4, 0_usize..70, exponents(), exponents());
    (sizes, 0.0..=1.0, 0_usize..6, -6..6_i32).prop_map(|((deriv, more, longer, kappa, mu), tau, rule, exponent)| {
        let (degree, rule) = (deriv + more, RULES[rule % RULES.len()].1);
        let even_refused = usize::from(rule == Rule::Simpson);
        Design {
            window_length: (2 * (degree + 2) + longer) | even_refused,
            deriv,
            degree,
            kappa,
            mu,
            place: Place::Tau(Tau::At(tau)),
            delta: 2_f64.powi(exponent),
            rule,
            trim: 0.0,
        }
    })
}

/// The point of estimation of such a design.
fn point(design: &Design) -> f64 {
    if let Place::Tau(Tau::At(tau)) = design.place { tau } else { f64::NAN }
}

/// Designs that any engine runs: polynomial weights on enough samples.
fn polynomial_designs() -> impl Strategy<Value = Design> {
    (designs(), 31_usize..120, 0..3_i32, 0..3_i32).prop_map(|(design, window_length, kappa, mu)| Design {
        window_length,
        kappa: kappa.into(),
        mu: mu.into(),
        rule: Rule::Exact,
        ..design
    })
}

fn plan(design: &Design) -> Result<Plan, Error> {
    Plan::new(design, &Unattended)
}

fn bank(designs: &[Design], engine: Option<Engine>) -> Result<Bank, Error> {
    Bank::new(designs.iter().map(|design| plan(design).map(Arc::new)).collect::<Result<_, _>>()?, engine)
}

/// Samples between -1 and 1.
fn signal(length: std::ops::Range<usize>) -> impl Strategy<Value = Vec<f64>> {
    vec(-1.0..1.0, length)
}

/// All windows of `x` by `engine`, or nothing where the engine does not take these weights.
fn run<T: Sample>(engine: Engine, plan: &Plan, x: &[T], origin: isize) -> Option<Vec<T>> {
    let runner = Runner::<T>::new(engine, &[plan.taps()]).ok()?;
    let mut out = vec![T::default(); (x.len() + 1).saturating_sub(runner.span())];
    let windows = Windows { x, first: 0, origin, outs: &mut [&mut out] };
    runner.apply(windows, &mut Scratch::default()).ok()?;
    Some(out)
}

/// The sum over the weights of every window, and that of the sizes of its terms.
fn naive(plan: &Plan, x: &[f64]) -> Vec<(f64, f64)> {
    let terms = |window: &[f64]| -> Vec<f64> { plan.weights().iter().zip(window).map(|(w, x)| w * x).collect() };
    let sums = |terms: Vec<f64>| (terms.iter().sum(), terms.iter().map(|term| term.abs()).sum());
    x.windows(plan.span()).map(|window| sums(terms(window))).collect()
}

/// What rounding may do to the sum of a window of `count` samples of at most 1, by any engine: the taps on differences are
/// sums of weights, of which each may be as large as half the sum of all sizes.
fn allowed(plan: &Plan) -> f64 {
    let size: f64 = plan.weights().iter().map(|weight| weight.abs()).sum();
    16.0 * plan.span() as f64 * f64::EPSILON * size
}

fn bits<T: Sample>(values: &[T]) -> Vec<u64> {
    values.iter().map(|value| value.to_f64().to_bits()).collect()
}

/// The whole run of a job on one row.
fn whole(bank: &Bank, mode: Mode, x: &[f64]) -> Result<Vec<f64>, Error> {
    let job = Job::new(bank, mode, Layout { outer: 1, samples: x.len(), inner: 1 });
    let mut out = vec![0.0; job.outputs() * bank.plans().len()];
    job.run(x, &mut out, &Unattended)?;
    Ok(out)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn weights_have_the_moments_of_a_derivative(design in designs()) {
        // Rules other than the exact one sample the kernel: they meet the moments in the limit only.
        let design = Design { rule: Rule::Exact, ..design };
        let plan = plan(&design)?;
        let half = 0.5 * plan.span() as f64;
        for power in 0..=design.degree {
            let at = |position: f64| ((position - plan.position()) / half).powi(power as i32);
            let terms = plan.weights().iter().enumerate().map(|(k, weight)| weight * at(k as f64));
            let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
            let factorial: f64 = (1..=power).map(|i| i as f64).product();
            let truth = if power == design.deriv { factorial / (half * design.delta).powi(power as i32) } else { 0.0 };
            prop_assert!((sum - truth).abs() <= 1e-12 * size, "power {power}: {sum:e} for {truth:e} of {size:e}");
        }
    }

    #[test]
    fn time_backwards_exchanges_the_exponents(design in designs()) {
        let place = Place::Tau(Tau::At(1.0 - point(&design)));
        let turned = Design { kappa: design.mu, mu: design.kappa, place, ..design };
        let (one, other) = (plan(&design)?, plan(&turned)?);
        let sign = if design.deriv % 2 == 0 { 1.0 } else { -1.0 };
        let size = one.weights().iter().fold(0.0, |size: f64, weight| size.max(weight.abs()));
        for (weight, mirrored) in one.weights().iter().zip(other.weights().iter().rev()) {
            // 1 - tau is rounded, and a polynomial of this degree turns an error of the point into (degree + 1)^2 of it.
            prop_assert!((weight - sign * mirrored).abs() <= 1e-12 * size, "{weight:e} {mirrored:e}");
        }
    }

    #[test]
    fn steps_of_powers_of_two_scale_every_bit(design in designs(), exponent in -9..9_i32) {
        let factor = 2_f64.powi(exponent);
        let (one, other) = (plan(&design)?, plan(&Design { delta: design.delta * factor, ..design })?);
        let scaled: Vec<f64> = other.weights().iter().map(|weight| weight * factor.powi(design.deriv as i32)).collect();
        prop_assert_eq!(bits(one.weights()), bits(&scaled));
    }

    #[test]
    fn every_engine_is_the_sum_over_its_weights(design in polynomial_designs(), x in signal(130..600)) {
        let plan = plan(&design)?;
        let single: Vec<f32> = x.iter().map(|value| *value as f32).collect();
        let exact: Vec<f64> = single.iter().map(|value| f64::from(*value)).collect();
        let (sums, of_singles) = (naive(&plan, &x), naive(&plan, &exact));
        for (name, engine) in ENGINES {
            let Some(found) = run(engine, &plan, &x, 0) else { continue };
            for (value, (sum, _)) in found.iter().zip(&sums) {
                prop_assert!((value - sum).abs() <= allowed(&plan), "{name}: {value:e} for {sum:e}");
            }
            let Some(found) = run(engine, &plan, &single, 0) else { continue };
            let rounding = f64::from(f32::EPSILON) / f64::EPSILON;
            for (value, (sum, _)) in found.iter().zip(&of_singles) {
                let error = (f64::from(*value) - sum).abs();
                prop_assert!(error <= rounding * allowed(&plan), "{name} in single precision: {value:e} for {sum:e}");
            }
        }
    }

    #[test]
    fn a_constant_is_flat(design in polynomial_designs(), value in -1e9..1e9, length in 130_usize..300) {
        let plan = plan(&design)?;
        let flat = if design.deriv == 0 { value } else { 0.0 };
        for (name, engine) in ENGINES {
            let found = run(engine, &plan, &vec![value; length], 0).unwrap_or_default();
            prop_assert!(found.iter().all(|found| *found == flat), "{name}");
        }
    }

    #[test]
    fn what_is_not_finite_stays_in_its_windows(
        design in polynomial_designs(),
        x in signal(130..600),
        places in vec(0_usize..600, 1..4),
        bad in select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
    ) {
        let plan = plan(&design)?;
        let mut damaged = x.clone();
        places.iter().for_each(|place| damaged[place % x.len()] = bad);
        for (name, engine) in ENGINES {
            let Some(found) = run(engine, &plan, &damaged, 0) else { continue };
            let clean = run(engine, &plan, &x, 0).unwrap_or_default();
            for ((window, value), clean) in damaged.windows(plan.span()).zip(&found).zip(&clean) {
                // Weights of a derivative at an end may be zero, and zero times infinity is not finite either.
                let whole = window.iter().all(|sample| sample.is_finite());
                prop_assert_eq!(value.is_finite(), whole, "{}", name);
                prop_assert!(!whole || (value - clean).abs() <= 2.0 * allowed(&plan), "{name}: {value:e} {clean:e}");
            }
        }
    }

    #[test]
    fn cuts_change_no_bit(design in polynomial_designs(), x in signal(130..600), cut in 0.0..1.0) {
        let plan = plan(&design)?;
        for (name, engine) in ENGINES {
            let Some(found) = run(engine, &plan, &x, 0) else { continue };
            // Other engines sum over blocks of the row: a part of it must hold the blocks that its windows lie in.
            if engine != Engine::Direct {
                continue;
            }
            let start = (cut * found.len() as f64) as usize;
            let later = run(engine, &plan, &x[start..], start.cast_signed()).unwrap_or_default();
            prop_assert_eq!(bits(&found[start..]), bits(&later), "{}", name);
        }
    }

    #[test]
    fn several_orders_are_each_alone(design in designs(), x in signal(200..300), mode in select(&MODES[..])) {
        let designs: Vec<Design> = (0..=design.degree).map(|deriv| Design { deriv, ..design }).collect();
        // Roots of one order are not those of another, and orders that are at one are not at the same point.
        let Ok(together) = bank(&designs, Some(Engine::Direct)) else { return Ok(()) };
        let found = whole(&together, mode, &x)?;
        for (index, one) in designs.iter().enumerate() {
            let alone = whole(&bank(&[*one], Some(Engine::Direct))?, mode, &x)?;
            prop_assert_eq!(bits(&alone), bits(&found[index * alone.len()..][..alone.len()]));
        }
    }

    #[test]
    fn columns_are_rows(design in designs(), x in signal(2000..2001), mode in select(&MODES[..]), width in 1_usize..9) {
        let bank = bank(&[design], Some(Engine::Direct))?;
        let samples = x.len() / width;
        let job = Job::new(&bank, mode, Layout { outer: 1, samples, inner: width });
        let mut found = vec![0.0; job.outputs() * width];
        job.run(&x[..samples * width], &mut found, &Unattended)?;
        for column in 0..width {
            let row: Vec<f64> = x[..samples * width].iter().skip(column).step_by(width).copied().collect();
            let of_column: Vec<f64> = found.iter().skip(column).step_by(width).copied().collect();
            prop_assert_eq!(bits(&whole(&bank, mode, &row)?), bits(&of_column));
        }
    }

    #[test]
    fn polynomials_come_back_to_both_ends(design in designs(), roots in vec(-1.0..2.0, 0..4), length in 0_usize..100) {
        let design = Design { rule: Rule::Exact, ..design };
        let roots = &roots[..roots.len().min(design.degree)];
        let samples = design.window_length + length;
        let time = |i: usize| i as f64 / samples as f64;
        let x: Vec<f64> = (0..samples).map(|i| roots.iter().map(|root| time(i) - root).product()).collect();
        let found = whole(&bank(&[design], None)?, Mode::Fit, &x)?;
        // In Newton's form, differentiated factor by factor.
        let step = 1.0 / (samples as f64 * design.delta);
        let size = 64.0 * f64::EPSILON * plan(&design)?.weights().iter().map(|weight| weight.abs()).sum::<f64>();
        let peak = x.iter().fold(0.0, |peak: f64, value| peak.max(value.abs()));
        for (i, value) in found.iter().enumerate() {
            let mut derivatives = [1.0, 0.0, 0.0, 0.0];
            for root in roots {
                for k in (0..4).rev() {
                    let lower = if k > 0 { k as f64 * derivatives[k - 1] } else { 0.0 };
                    derivatives[k] = derivatives[k] * (time(i) - root) + lower;
                }
            }
            let truth = derivatives[design.deriv] * step.powi(design.deriv as i32);
            // The fits at the ends are worse conditioned than the one at the point of the design, by the growth of a
            // polynomial of this degree on its window.
            let growth = ((design.degree + 1) as f64).powi(2 * design.deriv as i32 + 2) * 100.0;
            prop_assert!((value - truth).abs() <= growth * size * peak, "{i}: {value:e} for {truth:e}");
        }
    }

    #[test]
    fn streams_have_the_bits_of_rows(design in designs(), x in signal(200..400), sizes in vec(1_usize..40, 1..9)) {
        let bank = Arc::new(bank(&[design], Some(Engine::Direct))?);
        let (mut stream, mut found, mut rest) = (Stream::new(&[Arc::clone(&bank)], 1)?, Vec::new(), &x[..]);
        for size in sizes.iter().cycle() {
            let (block, later) = rest.split_at((*size).min(rest.len()));
            let mut out = vec![0.0; block.len()];
            match block {
                [] => break,
                [sample] => stream.push(&[*sample], &mut out),
                _ => stream.push_block(block, &mut out, 1, &Unattended)?,
            }
            found.extend(out);
            rest = later;
        }
        let warmup = bank.first().span() - 1;
        prop_assert!(found[..warmup].iter().all(|value| value.is_nan()));
        prop_assert_eq!(bits(&found[warmup..]), bits(&whole(&bank, Mode::Valid, &x)?));
    }

    #[test]
    fn gauss_rules_integrate_what_they_should(alpha in -0.9..8.0, beta in -0.9..8.0, count in 1_usize..12) {
        let family = Jacobi { alpha, beta };
        let rule = family.gauss(count);
        // The moments of the density: E s^k = prod (alpha + 1 + i) / (alpha + beta + 2 + i).
        let mut truth = 1.0;
        for power in 0..2 * count {
            let found: f64 = rule.iter().map(|(node, weight)| weight * node.powi(power as i32)).sum();
            prop_assert!((found - truth).abs() <= 1e-12 * truth, "power {power}: {found:e} for {truth:e}");
            truth *= (alpha + 1.0 + power as f64) / (alpha + beta + 2.0 + power as f64);
        }
    }

    #[test]
    fn roots_lie_inside_and_separate_each_other(alpha in -0.9..8.0, beta in -0.9..8.0, degree in 1_usize..12) {
        let family = Jacobi { alpha, beta };
        let (roots, next) = (family.roots(degree), family.roots(degree + 1));
        prop_assert!(next.iter().all(|root| 0.0 < *root && *root < 1.0));
        for (root, pair) in roots.iter().zip(next.windows(2)) {
            prop_assert!(pair[0] < *root && *root < pair[1], "{root} in {pair:?}");
        }
    }

    #[test]
    fn responses_of_real_kernels_are_conjugate(design in designs(), omega in 0.0..300.0) {
        let tau = Tau::At(point(&design));
        let kernel = Kernel::new(design.deriv, design.degree, design.kappa, design.mu, tau, 1.0)?;
        let response = Response::new(&kernel, omega);
        let (one, other) = (response.at(omega, kernel.tau()), response.at(-omega, kernel.tau()));
        let size = kernel.norm1() + f64::MIN_POSITIVE;
        prop_assert!((one - other.conj()).norm() <= 1e-12 * size, "{one} {other}");
        // No frequency passes better than all samples at their best signs would.
        prop_assert!(one.norm() <= size * (1.0 + 1e-9), "{one} {size}");
    }

    #[test]
    fn the_response_of_taps_is_that_of_their_weights(design in designs(), turns in -0.5..0.5) {
        let plan = plan(&design)?;
        let found = plan.taps().response(turns, plan.position());
        let term = |(k, weight): (usize, &f64)| {
            let phase = std::f64::consts::TAU * turns * (k as f64 - plan.position());
            (weight * phase.cos(), weight * phase.sin())
        };
        let (re, im) = plan.weights().iter().enumerate().map(term).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        prop_assert!((found.re - re).hypot(found.im - im) <= 8.0 * allowed(&plan), "{found} for {re} {im}");
    }

    #[test]
    fn any_numbers_make_a_design_or_an_error(
        sizes in (0_usize..300, 0_usize..12, 0_usize..40),
        numbers in (ANY, ANY, ANY, ANY, ANY),
        place in 0..3,
        rule in 0_usize..6,
    ) {
        let ((window_length, deriv, degree), (kappa, mu, point, delta, trim)) = (sizes, numbers);
        let place = match place { 0 => Place::Tau(Tau::At(point)), 1 => Place::Delay(point), _ => Place::Position(point) };
        let rule = RULES[rule % RULES.len()].1;
        // Near what is allowed, so that not all are refused.
        let (kappa, mu, delta) = (kappa % 3.0, mu % 3.0, delta.abs());
        match plan(&Design { window_length, deriv, degree, kappa, mu, place, delta, rule, trim: trim % 0.6 }) {
            Ok(plan) => prop_assert!(plan.weights().iter().all(|weight| weight.is_finite())),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn a_run_that_panics_ends_as_a_panic(design in designs(), threads in 1_usize..4) {
        struct Failing;
        impl Control for Failing {
            fn proceed(&self, _fraction: f64) -> bool {
                std::panic::resume_unwind(Box::new("on purpose"))
            }
        }
        let bank = bank(&[design], Some(Engine::Direct))?;
        let x = vec![0.0; 200_000];
        let layout = Layout { outer: 1, samples: x.len(), inner: 1 };
        let mut out = vec![0.0; x.len()];
        let job = Job { threads, ..Job::new(&bank, Mode::Nearest, layout) };
        // Whether it is asked at all depends on how long the run takes; but nothing hangs and nothing aborts.
        drop(catch_unwind(AssertUnwindSafe(|| job.run(&x, &mut out, &Failing))));
        prop_assert!(whole(&bank, Mode::Nearest, &x[..1000])?.iter().all(|value| *value == 0.0));
    }
}
