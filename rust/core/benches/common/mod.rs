//! What the benches of the engines share: designs, a check against the naive sum, and the shortest of many runs.
//!
//! Plain timing in 100 lines instead of a bench crate: what is wanted is one number for each window, in units of copying
//! the same samples in the same run, and criterion or divan would bring dozens of crates and statistics of their own.

#![expect(clippy::indexing_slicing, reason = "a bench may stop where it is wrong")]

mod basics;

use std::time::{Duration, Instant};

use algdiff_core::bank::Bank;
use algdiff_core::engine::{ENGINES, Engine, Sample, Scratch, Windows};
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
pub use basics::Failure;
use basics::{compare, noise, plan};

/// Outputs of one run: beyond the caches.
const OUTPUTS: usize = 1 << 22;

const WINDOWS: [usize; 7] = [11, 61, 111, 501, 1001, 4001, 100_001];

/// How long the runs of one window may take.
const BUDGET: Duration = Duration::from_secs(2);

/// Prints the cost of `name` for every window, both types of samples, and one or three orders.
pub fn bench(name: &'static str) -> Result<(), Failure> {
    let Some(&(_, engine)) = ENGINES.iter().find(|(word, _)| *word == name) else {
        return Err(Failure::Unknown(format!("engine '{name}'")));
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
    let plans =
        orders.iter().map(|deriv| plan(window_length, *deriv, Tau::Center)).collect::<Result<Vec<_>, Error>>()?;
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

/// Some outputs against the naive sum; a transform errs by eps log2(N) sqrt(N), which for its 16,384 points is below 2,000 eps.
fn check<T: Sample>(plan: &Plan, x: &[T], out: &[T]) -> Result<(), Failure> {
    for start in (0..out.len()).step_by(out.len() / 64 + 1).chain([out.len() - 1]) {
        compare(plan, &x[start..], out[start], 2000.0, format_args!("output {start}"))?;
    }
    Ok(())
}
