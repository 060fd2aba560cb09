//! Cost of one sample: the latency of single pushes, and what one of many costs back to back.
//!
//! `cargo bench -p algdiff-core --bench stream` prints a table. With `-- --json` it prints a line of JSON for every case, which
//! `benches/streaming.py` reads; with `-- NAME` only the case of that name. The samples come from a generator that is easily written
//! elsewhere, and the first estimates are summed up in a hash, so that other programs can tell whether they get the same bits.

#![expect(clippy::indexing_slicing, reason = "a bench may stop where it is wrong")]

#[path = "common/basics.rs"]
mod basics;

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use algdiff_core::bank::Bank;
use algdiff_core::engine::Sample;
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::stream::Stream;
use basics::{Failure, compare, noise, plan};

/// Pushes of a case, each timed.
const PUSHES: usize = 200_000;

/// Pushes whose estimates are hashed, and some of them checked.
const HASHED: usize = 20_000;

/// Rounds of as many pushes that are timed together; the shortest counts.
const ROUNDS: usize = 5;

struct Case {
    name: &'static str,
    /// Of every design.
    windows: &'static [usize],
    orders: &'static [usize],
    channels: usize,
    single: bool,
}

const PLAIN: Case = Case { name: "111", windows: &[111], orders: &[1], channels: 1, single: false };

const CASES: [Case; 10] = [
    Case { name: "21", windows: &[21], ..PLAIN },
    Case { name: "61", windows: &[61], ..PLAIN },
    PLAIN,
    Case { name: "501", windows: &[501], ..PLAIN },
    Case { name: "1001", windows: &[1001], ..PLAIN },
    Case { name: "float32", single: true, ..PLAIN },
    Case { name: "orders", orders: &[0, 1, 2], ..PLAIN },
    Case { name: "windows", windows: &[21, 61, 111], ..PLAIN },
    Case { name: "channels16", channels: 16, ..PLAIN },
    Case { name: "channels64", channels: 64, ..PLAIN },
];

/// Nanoseconds.
struct Found {
    /// Median between two readings of the clock.
    clock: u64,
    /// Median, and what 1 in 100 and 1 in 1000 exceed, with those readings.
    quantiles: [u64; 3],
    back_to_back: f64,
    /// Of the first estimates from full windows.
    hash: u64,
}

fn main() -> Result<(), Failure> {
    // Cargo adds `--bench`.
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let json = words.iter().any(|word| word == "--json");
    let names: Vec<&String> = words.iter().filter(|word| *word != "--json").collect();
    if let Some(name) = names.iter().find(|name| CASES.iter().all(|case| case.name != name.as_str())) {
        return Err(Failure::Unknown(format!("case '{name}'")));
    }
    if !json {
        println!("one sample: first derivative, degree 3, kappa = mu = 0, no delay; ns, {PUSHES} pushes of each case");
        println!("{:>12} {:>8} {:>8} {:>8} {:>14}", "case", "median", "99 %", "99.9 %", "back to back");
    }
    for case in CASES.iter().filter(|case| names.is_empty() || names.iter().any(|name| *name == case.name)) {
        let Found { clock, quantiles: [median, most, nearly_all], back_to_back, hash } =
            if case.single { run::<f32>(case)? } else { run::<f64>(case)? };
        let name = case.name;
        if json {
            println!(
                r#"{{"case": "{name}", "clock": {clock}, "median": {median}, "p99": {most}, "p999": {nearly_all}, "back_to_back": {back_to_back:.2}, "hash": {hash}}}"#
            );
        } else {
            let [median, most, nearly_all] = [median, most, nearly_all].map(|spent| spent.saturating_sub(clock));
            println!("{name:>12} {median:>8} {most:>8} {nearly_all:>8} {back_to_back:>14.1}");
        }
    }
    Ok(())
}

fn run<T: Sample>(case: &Case) -> Result<Found, Failure> {
    let bank = |window: &usize| {
        let plans =
            case.orders.iter().map(|deriv| plan(*window, *deriv, Tau::Newest)).collect::<Result<Vec<_>, Error>>()?;
        Bank::new(plans, None).map(Arc::new)
    };
    let banks = case.windows.iter().map(bank).collect::<Result<Vec<_>, Error>>()?;
    let mut stream = Stream::<T>::new(&banks, case.channels)?;
    // Channel c of sample i is number i + c.
    let x = noise::<T>(PUSHES + case.channels - 1);
    let samples = || x.windows(case.channels);
    let mut out = vec![T::default(); stream.orders() * case.channels];

    let plans: Vec<&Arc<Plan>> = banks.iter().flat_map(|bank| bank.plans()).collect();
    let mut hash = 14_695_981_039_346_656_037_u64;
    for (i, sample) in samples().enumerate().take(HASHED) {
        stream.push(sample, &mut out);
        if i + 1 < stream.length() {
            continue;
        }
        for value in &out {
            hash = (hash ^ value.to_f64().to_bits()).wrapping_mul(1_099_511_628_211);
        }
        if i % 97 == 0 {
            for (plan, out) in plans.iter().zip(out.chunks_exact(case.channels)) {
                let oldest = i + 1 - plan.weights().len();
                for (channel, value) in out.iter().enumerate() {
                    compare(plan, &x[oldest + channel..], *value, 8.0, format_args!("sample {i}"))?;
                }
            }
        }
    }

    let mut clocks: Vec<Duration> = (0..PUSHES).map(|_| Instant::now().elapsed()).collect();
    clocks.sort_unstable();
    let clock = clocks[PUSHES / 2];
    let mut spent = vec![Duration::ZERO; PUSHES];
    for (sample, spent) in samples().zip(&mut spent) {
        let started = Instant::now();
        stream.push(black_box(sample), &mut out);
        black_box(&mut out);
        *spent = started.elapsed();
    }
    spent.sort_unstable();
    // The sample that so many of a thousand do not exceed.
    let quantile = |of_1000: usize| spent[(PUSHES * of_1000).div_ceil(1000) - 1].as_nanos() as u64;

    let mut best = Duration::MAX;
    for _ in 0..ROUNDS {
        let started = Instant::now();
        for sample in samples() {
            stream.push(black_box(sample), &mut out);
            black_box(&mut out);
        }
        best = best.min(started.elapsed());
    }
    Ok(Found {
        clock: clock.as_nanos() as u64,
        quantiles: [quantile(500), quantile(990), quantile(999)],
        back_to_back: 1e9 * best.as_secs_f64() / PUSHES as f64,
        hash,
    })
}
