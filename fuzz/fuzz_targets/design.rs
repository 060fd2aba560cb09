//! Designs of any parameters are refused in one line, or have weights that are finite and differentiate polynomials.

#![no_main]

use std::sync::Arc;

use algdiff_core::analysis::Conditions;
use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::Engine;
use algdiff_core::kernel::{Kernel, Tau};
use algdiff_core::paper::{Simultaneous, lambdas};
use algdiff_core::plan::Plan;
use algdiff_core::run::{Job, Layout, Mode};
use algdiff_fuzz::numbers::{Real, dot};
use algdiff_fuzz::refused;
use algdiff_fuzz::wishes::Wish;
use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;

/// Windows of which everything is asked: some of it takes time as their square.
const SHORT: usize = 48;

#[derive(Debug, Arbitrary)]
enum Question {
    Weights,
    Again,
    Analysis([Real; 3]),
    Kernel([Real; 3]),
    Paper(u8, u8, Real, [Real; 2]),
}

fuzz_target!(|input: (Wish, Question)| {
    let (Wish(design), question) = input;
    match question {
        Question::Kernel(points) => kernel(&design, points.map(|real| real.0)),
        Question::Paper(degree, nu, duration, points) => {
            paper(&design, (degree.into(), nu.into()), duration.0, points.map(|real| real.0));
        }
        Question::Weights | Question::Again | Question::Analysis(_) => match Plan::new(&design, &Unattended) {
            Err(error) => refused(&error),
            Ok(plan) => {
                weights(&plan);
                match question {
                    Question::Analysis(numbers) => analysis(&plan, numbers.map(|real| real.0)),
                    Question::Again => again(plan),
                    _ => {}
                }
            }
        },
    }
});

/// Weights are finite, and differentiate Chebyshev's polynomials of the degrees that the plan names.
///
/// The plan meets its moments to 1e-10 of the largest, in the basis orthonormal for its weight, in which a polynomial that is
/// at most 1 on the window has coefficients whose squares sum to at most 1: those of degree m miss by `sqrt(m + 1)` times that.
fn weights(plan: &Plan) {
    let (weights, unit, deriv) = (plan.weights(), plan.unit(), plan.design().deriv);
    assert!(weights.iter().all(|w| w.is_finite()) && unit.is_finite() && unit > 0.0, "{:?}", plan.design());
    assert!(weights.len() == plan.span() && plan.span() > 0 && plan.kept().end <= plan.design().window_length);
    assert!(
        plan.position().is_finite()
            && plan.delay_samples().is_finite()
            && plan.duration() > 0.0
            && plan.duration().is_finite(),
        "{plan:?}"
    );
    let (kernel, count) = (plan.kernel(), weights.len() as f64);
    let exactness = plan.exactness().unwrap_or(0);
    let largest =
        kernel.moments(plan.fit_degree().max(kernel.exactness())).iter().fold(0.0, |m: f64, d| m.max(d.abs()));
    let size: f64 = weights.iter().map(|w| w.abs() / unit).sum();
    if plan.exactness().is_none() || !size.is_finite() {
        return;
    }
    let point = 2.0 * kernel.tau() - 1.0;
    let columns: Vec<Vec<f64>> =
        (0..weights.len()).map(|j| chebyshev(2.0 * plan.tau_at(j as f64) - 1.0, exactness, 0)).collect();
    let (wanted, peaks) = (chebyshev(point, exactness, deriv), chebyshev(point.abs().max(1.0), exactness, deriv));
    for degree in 0..=exactness {
        let power = 2.0_f64.powi(deriv as i32);
        let got = dot(weights.iter().zip(&columns).map(|(w, column)| (w / unit, column[degree])));
        let (expected, peak) = (power * wanted[degree], power * peaks[degree]);
        let steps = (degree as f64 + 2.0).powi(2);
        let rounding = 4.0 * f64::EPSILON * (steps * peak + (steps + count) * size) + count * (5e-324 / unit);
        let allowed = 1e-10 * (degree as f64 + 1.0).sqrt() * largest + rounding;
        assert!(
            (got - expected).abs() <= allowed || !allowed.is_finite(),
            "{degree}: {got} {expected} {allowed} {:?}",
            plan.design()
        );
    }
}

/// Derivatives of order `deriv` at `u` of Chebyshev's polynomials, which are at most 1 on [-1, 1].
fn chebyshev(u: f64, degree: usize, deriv: usize) -> Vec<f64> {
    let mut orders = vec![vec![0.0; degree + 1]; deriv + 1];
    for m in 0..=degree {
        for k in 0..=deriv.min(m) {
            orders[k][m] = match (m, k) {
                (0, 0) | (1, 1) => 1.0,
                (1, 0) => u,
                _ => {
                    let lower = if k > 0 { 2.0 * k as f64 * orders[k - 1][m - 1] } else { 0.0 };
                    2.0 * u * orders[k][m - 1] + lower - orders[k][m - 2]
                }
            };
        }
    }
    orders.swap_remove(deriv)
}

/// The ends, the taps on a sample, and constants, which differentiate to 0 and stay themselves.
fn again(plan: Plan) {
    if let Err(error) = plan.end(&Unattended) {
        refused(&error);
    }
    if let Err(error) = plan.aligned_taps(&Unattended) {
        refused(&error);
    }
    let (deriv, keeps) = (plan.design().deriv, plan.keeps_constants());
    let x = vec![1e9; plan.span() + 2];
    let mut out = [1.0; 3];
    match Bank::new(vec![Arc::new(plan)], Some(Engine::Direct)) {
        Err(error) => refused(&error),
        Ok(bank) => match Job::new(&bank, Mode::Valid, Layout::row(x.len())).run(&x, &mut out, &Unattended) {
            Err(error) => refused(&error),
            Ok(()) if keeps => assert_eq!(out, [if deriv > 0 { 0.0 } else { 1e9 }; 3]),
            Ok(()) => {}
        },
    }
}

/// What a plan says of itself.
fn analysis(plan: &Plan, numbers: [f64; 3]) {
    let mut out = [Default::default(); 3];
    if let Err(error) = plan.frequency_response(&numbers, &mut out, &Unattended) {
        refused(&error);
    }
    assert!(!plan.bias_bound().is_nan(), "{:?}", plan.design());
    let _ = plan.moment_delay();
    if let Err(error) = plan.bias_constant(&Unattended) {
        refused(&error);
    }
    if plan.span() <= SHORT
        && let Err(error) = plan.half_power(&Unattended)
    {
        refused(&error);
    }
}

/// A kernel, by itself and about noise and bias.
fn kernel(design: &Design, points: [f64; 3]) {
    let tau = match design.place {
        Place::Tau(tau) => tau,
        Place::Delay(point) | Place::Position(point) => Tau::At(point),
    };
    let kernel = match Kernel::new(design.deriv, design.degree, design.kappa, design.mu, tau, 1.0) {
        Err(error) => return refused(&error),
        Ok(kernel) => kernel,
    };
    let roots = kernel.roots();
    assert!(roots.windows(2).all(|pair| pair[0] < pair[1]) && roots.iter().all(|root| (0.0..=1.0).contains(root)));
    assert!(kernel.moments(kernel.degree()).iter().all(|d| d.is_finite()));
    let mut out = [0.0; 3];
    kernel.values(&points, &mut out, &Unattended).expect("as many");
    kernel.step_response(&points, &mut out, &Unattended).expect("as many");
    assert!(kernel.norm2() >= 0.0 && kernel.norm1() >= 0.0 && kernel.bias_bound() >= 0.0, "{kernel:?}");
    assert!(kernel.cutoff().is_none_or(f64::is_normal) && !kernel.bias().1.is_nan());
    let [noise_level, derivative_bound, delta] = points;
    let conditions = Conditions { noise_level, derivative_bound, delta };
    for found in [
        kernel.optimal_duration(&conditions),
        kernel.optimal_duration_bounded(&conditions),
        kernel.rmse(design.delta, &conditions),
    ] {
        if let Err(error) = found {
            refused(&error);
        }
    }
    let mut response = [Default::default(); 3];
    if let Err(error) = kernel.frequency_response(&points, design.trim, &mut response, &Unattended) {
        refused(&error);
    }
}

/// The systems of the 2007 paper.
fn paper(design: &Design, (degree, nu): (usize, usize), duration: f64, points: [f64; 2]) {
    match Simultaneous::new(degree % 24, nu, duration) {
        Err(error) => refused(&error),
        Ok(system) => {
            let mut out = vec![0.0; 2 * (degree % 24 + 1)];
            if let Err(error) = system.right_side(&points, &mut out, &Unattended) {
                refused(&error);
            }
            if let Err(error) = system.condition_number() {
                refused(&error);
            }
        }
    }
    let count = (design.degree % 41 + 1).saturating_sub(design.deriv);
    let mut out = vec![0.0; 2 * count];
    match lambdas(design.deriv, design.degree % 41, (design.kappa, design.mu), &points, &mut out) {
        Err(error) => refused(&error),
        Ok(()) => assert!(out.iter().all(|lambda| lambda.is_finite())),
    }
}
