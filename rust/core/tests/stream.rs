//! Streams have the bits of whole rows, however samples come, and lose nothing on an error.

#![expect(clippy::indexing_slicing, reason = "a test may stop where it is wrong")]

use std::sync::Arc;

use algdiff_core::bank::Bank;
use algdiff_core::control::{Control, Unattended};
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::{Engine, Sample};
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::rule::Rule;
use algdiff_core::run::{Job, Layout, Mode};
use algdiff_core::stream::{Fitted, Missing, Point, Results, Stream, Wanted};

fn bank(window_length: usize, orders: &[usize], rule: Rule) -> Result<Arc<Bank>, Error> {
    let place = Place::Tau(Tau::At(0.8));
    let plan = |deriv: &usize| {
        let (deriv, kappa, mu, degree, delta) = (*deriv, 1.0, 0.0, 3, 0.1);
        let design = Design { window_length, deriv, degree, kappa, mu, place, delta, rule, trim: 0.0 };
        Plan::new(&design, &Unattended).map(Arc::new)
    };
    Bank::new(orders.iter().map(plan).collect::<Result<_, _>>()?, Some(Engine::Direct)).map(Arc::new)
}

/// Seeded numbers below a bound.
fn below(state: &mut u64, bound: usize) -> usize {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as usize % bound
}

fn signal<T: Sample>(state: &mut u64, length: usize) -> Vec<T> {
    (0..length).map(|_| T::from_f64(below(state, 1 << 20) as f64 / 1e3)).collect()
}

fn bits<T: Sample>(values: &[T]) -> Vec<Option<u64>> {
    values.iter().map(|value| value.to_f64()).map(|value| (!value.is_nan()).then(|| value.to_bits())).collect()
}

/// What a stream should give: for every order one output for every sample, NaN at first.
fn expected<T: Sample>(bank: &Bank, x: &[T], channels: usize) -> Result<Vec<T>, Error> {
    let (samples, warmup) = (x.len() / channels, bank.first().span() - 1);
    let job = Job::new(bank, Mode::Valid, Layout { outer: 1, samples, inner: channels });
    let mut out = vec![T::default(); bank.plans().len() * job.outputs() * channels];
    job.run(x, &mut out, &Unattended)?;
    let order = |valid: &[T]| [vec![T::from_f64(f64::NAN); warmup * channels], valid.to_vec()].concat();
    Ok(out.chunks(job.outputs() * channels).flat_map(order).collect())
}

fn chunks_have_the_bits_of_the_whole<T: Sample>(seed: u64) -> Result<(), Error> {
    let mut state = seed;
    for trial in 0..120 {
        let channels = [1, 1, 2, 3, 4, 7, 16, 21, 40][trial % 9];
        let rule = [Rule::Exact, Rule::Trapezoid][trial % 2];
        let (short, long) = (5 + below(&mut state, 30), 5 + below(&mut state, 120));
        let banks = [bank(short, &[0, 2], rule)?, bank(long, &[1], rule)?];
        let samples = short.max(long) + below(&mut state, 300);
        let x: Vec<T> = signal(&mut state, samples * channels);
        let mut wanted = expected(&banks[0], &x, channels)?;
        wanted.extend(expected(&banks[1], &x, channels)?);

        let mut stream = Stream::new(&banks, channels)?;
        let mut out = vec![T::default(); 3 * samples * channels];
        let mut first = 0;
        while first < samples {
            let many = 1 + below(&mut state, [1, 3, 200][trial % 3]).min(samples - first - 1);
            let block = &x[first * channels..][..many * channels];
            let mut part = vec![T::default(); 3 * block.len()];
            if many == 1 {
                stream.push(block, &mut part);
            } else {
                stream.push_block(block, &mut part, 1, &Unattended)?;
            }
            for (order, values) in part.chunks(block.len()).enumerate() {
                out[(order * samples + first) * channels..][..block.len()].copy_from_slice(values);
            }
            if below(&mut state, 5) == 0 {
                let held = stream.length().min(first + many);
                let mut kept = vec![T::default(); held * channels];
                stream.copy_newest(held, &mut kept);
                let count = stream.count();
                stream = Stream::new(&banks, channels)?;
                stream.restore(&kept, count)?;
            }
            first += many;
        }
        assert!(bits(&out) == bits(&wanted), "{short} {long} {channels} {rule:?}");
        assert_eq!(stream.count(), samples as u64);
    }
    Ok(())
}

#[test]
fn doubles_have_the_bits_of_the_whole() -> Result<(), Error> {
    chunks_have_the_bits_of_the_whole::<f64>(1)
}

#[test]
fn singles_have_the_bits_of_the_whole() -> Result<(), Error> {
    chunks_have_the_bits_of_the_whole::<f32>(2)
}

/// Stops when so much is done.
struct Impatient(f64);

impl Control for Impatient {
    fn proceed(&self, fraction: f64) -> bool {
        fraction < self.0
    }
}

#[test]
fn a_block_that_is_stopped_has_not_been_pushed() -> Result<(), Error> {
    let wanted = Wanted { grow: true, missing: Missing::Omit, support: 0, gain: None };
    let mut stream = Fitted::<f64>::new(&[(bank(21, &[1], Rule::Exact)?, Point::Tau(0.8))], 1, wanted)?;
    let mut state = 3;
    let x: Vec<f64> = signal(&mut state, 100_000);
    let mut out = vec![0.0; x.len()];
    stream.push_block(
        &x[..50],
        None,
        Results { estimate: &mut out[..50], std: None, support: None },
        1,
        &Unattended,
    )?;
    let mut other = stream.clone();
    let results = Results { estimate: &mut out[50..], std: None, support: None };
    assert_eq!(stream.push_block(&x[50..], None, results, 1, &Impatient(0.5)), Err(Error::Interrupted));
    assert_eq!(stream.stream().count(), 50);
    let (mut one, mut two) = ([0.0], [0.0]);
    stream.push(&[1.5], None, &mut one)?;
    other.push(&[1.5], None, &mut two)?;
    assert!(one == two && one[0].is_finite());
    Ok(())
}

#[test]
fn what_is_too_short_is_padded_and_what_is_too_long_is_cut() -> Result<(), Error> {
    let banks = [bank(5, &[0, 1], Rule::Exact)?];
    let mut stream = Stream::<f64>::new(&banks, 2)?;
    let mut out = [7.0; 3];
    for _ in 0..5 {
        stream.push(&[1.0, 2.0, 3.0], &mut out);
    }
    assert_eq!(out, [1.0, 2.0, 0.0]);
    stream.push(&[1.0], &mut out);
    assert!(out[0] == 1.0 && out[1].is_nan() && out[2] == 0.0);
    stream.push(&[], &mut []);
    assert_eq!(stream.count(), 7);
    assert!(stream.push_block(&[1.0; 3], &mut [0.0; 6], 1, &Unattended).is_err());
    assert!(stream.push_block(&[1.0; 4], &mut [0.0; 6], 1, &Unattended).is_err());
    assert!(stream.restore(&[1.0; 4], 7).is_err());
    Ok(())
}
