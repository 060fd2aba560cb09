//! Small fixed workloads, one a run, whose instructions are counted: `python tools/instructions.py`.
//!
//! `workloads` lists their names; `workloads NAME` runs one, and `workloads nothing` what all have in common.

use std::env;
use std::error::Error as AnyError;
use std::hint::black_box;
use std::sync::Arc;

use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::{Engine, Sample};
use algdiff_core::error::Error;
use algdiff_core::kernel::{Kernel, Tau};
use algdiff_core::plan::Plan;
use algdiff_core::response::Response;
use algdiff_core::rule::Rule;
use algdiff_core::run::{Job, Layout, Mode};
use algdiff_core::stream::Stream;

type Workload = fn() -> Result<f64, Error>;

const WORKLOADS: [(&str, Workload); 13] = [
    ("nothing", || Ok(0.0)),
    ("weights, exact, 1001", || Ok(design(1001, 0.0, Rule::Exact)?.weights().iter().sum())),
    ("weights, cell, 301", || Ok(design(301, 0.5, Rule::Cell)?.weights().iter().sum())),
    ("direct, 25", || row::<f64>(Engine::Direct, 25, 100_000)),
    ("direct, 25, single precision", || row::<f32>(Engine::Direct, 25, 100_000)),
    ("direct, 401", || row::<f64>(Engine::Direct, 401, 20_000)),
    ("moments, 101", || row::<f64>(Engine::Moments, 101, 100_000)),
    ("moments, 101, single precision", || row::<f32>(Engine::Moments, 101, 100_000)),
    ("fft, 1001", || row::<f64>(Engine::Fft, 1001, 50_000)),
    ("columns, 64 of 2000", || job::<f64>(Engine::Direct, 25, Layout { outer: 1, samples: 2000, inner: 64 })),
    ("stream, 101, 20000 pushes", pushes),
    ("kernel at 10000 points", points),
    ("response at 2000 frequencies", frequencies),
];

fn design(window_length: usize, kappa: f64, rule: Rule) -> Result<Plan, Error> {
    let (deriv, degree, mu, place, delta, trim) = (1, 3, kappa, Place::Tau(Tau::Center), 1.0, 0.0);
    Plan::new(&Design { window_length, deriv, degree, kappa, mu, place, delta, rule, trim }, &Unattended)
}

fn bank(engine: Engine, window_length: usize) -> Result<Bank, Error> {
    Bank::new(vec![Arc::new(design(window_length, 0.0, Rule::Exact)?)], Some(engine))
}

fn signal<T: Sample>(count: usize) -> Vec<T> {
    (0..count).map(|i| T::from_f64((i * 7919 % 1009) as f64)).collect()
}

fn row<T: Sample>(engine: Engine, window_length: usize, samples: usize) -> Result<f64, Error> {
    job::<T>(engine, window_length, Layout { outer: 1, samples, inner: 1 })
}

fn job<T: Sample>(engine: Engine, window_length: usize, layout: Layout) -> Result<f64, Error> {
    let bank = bank(engine, window_length)?;
    let x = signal::<T>(layout.samples * layout.inner);
    let mut out = vec![T::default(); x.len()];
    Job { threads: 1, ..Job::new(&bank, Mode::Fit, layout) }.run(&x, &mut out, &Unattended)?;
    Ok(out.last().map_or(0.0, |value| value.to_f64()))
}

fn pushes() -> Result<f64, Error> {
    let mut stream = Stream::new(&[Arc::new(bank(Engine::Direct, 101)?)], 1)?;
    let mut out = [0.0];
    for sample in signal::<f64>(20_000) {
        stream.push(&[sample], &mut out);
    }
    Ok(out.iter().sum())
}

fn points() -> Result<f64, Error> {
    let points: Vec<f64> = (0..10_000).map(|i| f64::from(i) / 1e4).collect();
    let mut out = vec![0.0; points.len()];
    Kernel::new(1, 5, 2.0, 1.5, Tau::Center, 1.0)?.values(&points, &mut out, &Unattended)?;
    Ok(out.iter().sum())
}

fn frequencies() -> Result<f64, Error> {
    let kernel = Kernel::new(1, 3, 1.5, 2.0, Tau::Center, 1.0)?;
    let response = Response::new(&kernel, 200.0);
    Ok((0..2000).map(|i| response.at(f64::from(i) / 10.0, kernel.tau()).norm()).sum())
}

fn main() -> Result<(), Box<dyn AnyError>> {
    let Some(wanted) = env::args().nth(1) else {
        WORKLOADS.iter().for_each(|(name, _)| println!("{name}"));
        return Ok(());
    };
    let (_, workload) = WORKLOADS.iter().find(|(name, _)| *name == wanted).ok_or("no such workload")?;
    black_box(workload()?);
    Ok(())
}
