//! What the benches of the engines share: designs, a check against the naive sum, and the shortest of many runs.
//!
//! Plain timing in 100 lines instead of a bench crate: what is wanted is one number for each window, in units of copying
//! the same samples in the same run, and criterion or divan would bring dozens of crates and statistics of their own.

use std::error::Error as _;
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::{ENGINES, Engine, Sample, Scratch, Windows};
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::rule::Rule;

/// Outputs of one run: beyond the caches.
const OUTPUTS: usize = 1 << 22;

const WINDOWS: [usize; 7] = [11, 61, 111, 501, 1001, 4001, 100_001];

/// How long the runs of one window may take.
const BUDGET: Duration = Duration::from_secs(2);

/// Why a bench cannot go on.
pub enum Failure {
    /// This build has no engine of this name.
    Unknown(&'static str),
    /// The engine or the design was refused.
    Refused(Error),
    /// An output is not the naive sum.
    Wrong(String),
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(name) => write!(f, "this build has no engine '{name}'"),
            Self::Refused(error) => write!(f, "{error} {:?}", error.source()),
            Self::Wrong(what) => f.write_str(what),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

/// Prints the cost of `name` for every window, both types of samples, and one or three orders.
pub fn bench(name: &'static str) -> Result<(), Failure> {
    let Some(&(_, engine)) = ENGINES.iter().find(|(word, _)| *word == name) else {
        return Err(Failure::Unknown(name));
    };
    println!("engine {name}: degree 3, kappa = mu = 0, one thread; ns per output, and in copies of the same samples");
    println!("{:>8} {:>8} {:>8} {:>10} {:>8} {:>8}", "window", "type", "orders", "outputs", "ns", "copies");
    for window_length in WINDOWS {
        for orders in [vec![1], vec![0, 1, 2]] {
            said(run::<f64>(engine, window_length, &orders, "f64"), window_length)?;
            said(run::<f32>(engine, window_length, &orders, "f32"), window_length)?;
        }
    }
    Ok(())
}

/// An engine may refuse a design, which is said and not an end.
fn said(outcome: Result<(), Failure>, window_length: usize) -> Result<(), Failure> {
    if let Err(Failure::Refused(error)) = outcome {
        println!("{window_length:>8} refused: {error}");
        return Ok(());
    }
    outcome
}

fn run<T: Sample>(engine: Engine, window_length: usize, orders: &[usize], word: &str) -> Result<(), Failure> {
    let plans = orders.iter().map(|deriv| plan(window_length, *deriv)).collect::<Result<Vec<_>, Error>>()?;
    let bank = Bank::new(plans, Some(engine))?;
    let runner = bank.at_tau::<T>()?;
    let mut scratch = Scratch::default();
    let mut apply = |x: &[T], results: &mut [Vec<T>]| {
        let mut outs: Vec<&mut [T]> = results.iter_mut().map(Vec::as_mut_slice).collect();
        runner.apply(Windows { x, first: 0, origin: 0, outs: &mut outs }, &mut scratch)
    };
    let short = 4096;
    let mut results = vec![vec![T::default(); short]; orders.len()];
    let x = noise::<T>(short + window_length - 1);
    let started = Instant::now();
    apply(&x, &mut results)?;
    let outputs = affordable(short, started.elapsed());
    for (plan, out) in bank.plans().iter().zip(&results) {
        check(plan, &x, out)?;
    }
    let x = noise::<T>(outputs + window_length - 1);
    let mut results = vec![vec![T::default(); outputs]; orders.len()];
    let (mut best, mut copy) = (Duration::MAX, Duration::MAX);
    let until = Instant::now() + BUDGET;
    while best == Duration::MAX || Instant::now() < until {
        copy = copy.min(timed(|| results[0].copy_from_slice(&x[..outputs])).0);
        let (elapsed, outcome) = timed(|| apply(&x, &mut results));
        outcome?;
        best = best.min(elapsed);
    }
    let per_output = |time: Duration| 1e9 * time.as_secs_f64() / outputs as f64;
    let (ns, copies) = (per_output(best), best.as_secs_f64() / copy.as_secs_f64());
    println!("{window_length:>8} {word:>8} {:>8} {outputs:>10} {ns:>8.2} {copies:>8.1}", orders.len());
    Ok(())
}

fn plan(window_length: usize, deriv: usize) -> Result<Arc<Plan>, Error> {
    let place = Place::Tau(Tau::Center);
    let (degree, kappa, mu, delta, rule, trim) = (3, 0.0, 0.0, 1.0, Rule::Exact, 0.0);
    let design = Design { window_length, deriv, degree, kappa, mu, place, delta, rule, trim };
    Plan::new(&design, &Unattended).map(Arc::new)
}

/// As many outputs as take about a tenth of the budget.
fn affordable(short: usize, elapsed: Duration) -> usize {
    let ratio = BUDGET.as_secs_f64() / 10.0 / elapsed.as_secs_f64().max(1e-9);
    ((short as f64 * ratio) as usize).clamp(short, OUTPUTS)
}

fn timed<R>(work: impl FnOnce() -> R) -> (Duration, R) {
    let started = Instant::now();
    let result = work();
    (started.elapsed(), result)
}

/// Seeded samples between -1 and 1: a linear congruential generator.
fn noise<T: Sample>(length: usize) -> Vec<T> {
    let mut state = 12_345_u64;
    let step = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        T::from_f64((state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
    };
    (0..length).map(step).collect()
}

/// Some outputs against the naive sum. Samples and differences are at most 2; a sum of L terms errs by L eps times the sum
/// of their sizes, and a transform by eps log2(N) sqrt(N), which for its 16,384 points is below 2,000 eps.
fn check<T: Sample>(plan: &Plan, x: &[T], out: &[T]) -> Result<(), Failure> {
    let weights = plan.weights();
    let eps = if size_of::<T>() == 8 { f64::EPSILON } else { f64::from(f32::EPSILON) };
    let (mut sum, mut cumulative) = (0.0_f64, 0.0);
    for weight in weights {
        sum += weight;
        cumulative += sum.abs().min((sum - 1.0).abs()) + weight.abs();
    }
    let bound = (weights.len() as f64 + 2000.0) * eps * 2.0 * cumulative + 4.0 * eps;
    for start in (0..out.len()).step_by(out.len() / 64 + 1).chain([out.len() - 1]) {
        let naive: f64 = weights.iter().zip(&x[start..]).map(|(weight, sample)| weight * sample.to_f64()).sum();
        let off = (naive - out[start].to_f64()).abs();
        if off > bound || off.is_nan() {
            return Err(Failure::Wrong(format!("window {}, output {start}: off by {off:e}", weights.len())));
        }
    }
    Ok(())
}
