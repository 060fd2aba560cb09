//! Engines against the plain sum, within their bounds; and parts, lanes and cuts against the whole, to the bit where that is
//! promised.

#![no_main]

use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::engine::{ENGINES, Engine, Runner, Sample, Scratch, Windows};
use algdiff_core::error::Error;
use algdiff_core::run::{Job, Layout, Mode, Part};
use algdiff_fuzz::refused;
use algdiff_fuzz::signals::{same, signal};
use algdiff_fuzz::sums::Sums;
use algdiff_fuzz::wishes::{plans, sound};
use arbitrary::{Result, Unstructured};
use libfuzzer_sys::{Corpus, fuzz_target};

/// Outputs that are compared with the plain sum.
const PLACES: usize = 8;

fuzz_target!(|data: &[u8]| -> Corpus {
    let mut u = Unstructured::new(data);
    let run = |u: &mut Unstructured<'_>| match u.int_in_range(0..=7)? {
        0 | 1 => parts::<f64>(u),
        2 => parts::<f32>(u),
        3 | 4 => sums::<f32>(u),
        _ => sums::<f64>(u),
    };
    if run(&mut u).is_ok() { Corpus::Keep } else { Corpus::Reject }
});

/// One engine of one design on one signal.
fn sums<T: Sample>(u: &mut Unstructured<'_>) -> Result<()> {
    // A spectrum has 16384 points, however short a window is.
    let engine = if u.ratio(1, 48)? { Engine::Fft } else { u.choose(&ENGINES[..2])?.1 };
    let design = sound(u, 200)?;
    let plans = match plans(&design, u.int_in_range(1..=2)?) {
        Ok(plans) => plans,
        Err(error) => return Ok(refused(&error)),
    };
    if plans.iter().any(|plan| plan.span() != plans[0].span()) {
        return Ok(());
    }
    let taps: Vec<_> = plans.iter().map(|plan| plan.taps()).collect();
    let runner = match Runner::<T>::new(engine, &taps) {
        Ok(runner) => runner,
        Err(error) => {
            assert!(engine == Engine::Moments);
            return Ok(refused(&error));
        }
    };
    let span = runner.span();
    let length = span + u.int_in_range(0..=2 * span.min(100))?;
    let x: Vec<T> = signal(u, length)?;
    let outputs = x.len() + 1 - span;
    let whole = apply(&runner, &x, (0, 0), outputs, plans.len());
    let (first, count) = cut(u, outputs)?;
    let start = first / runner.grid() * runner.grid();
    let (own, origin) = (&x[first..first + count + span - 1], u.int_in_range(-5000..=5000)?);
    let again = *u.choose(&[Again::Part, Again::Moved, Again::Lanes])?;
    let part = match again {
        Again::Part => apply(&runner, &x[start..], (first - start, start.cast_signed()), count, plans.len()),
        Again::Moved => apply(&runner, own, (0, origin), count, plans.len()),
        Again::Lanes => lanes(&runner, own, u.int_in_range(0..=T::LANES - 1)?, origin, (count, plans.len())),
    };
    for (order, plan) in plans.iter().enumerate() {
        if again == Again::Part || engine == Engine::Direct {
            let alike = same(&whole[order][first..first + count], &part[order]);
            assert!(alike, "{engine:?} {design:?}: {again:?} from {start} on");
        }
        let sums = Sums::new(plan, engine, &x);
        for place in (0..outputs).step_by(outputs.div_ceil(PLACES)) {
            sums.check(place, whole[order][place]);
            if (first..first + count).contains(&place) {
                sums.check(place, part[order][place - first]);
            }
        }
    }
    Ok(())
}

/// How a stretch is computed once more: on the grid of the whole, from another origin, or in a lane among others.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Again {
    Part,
    Moved,
    Lanes,
}

/// A stretch of the outputs.
fn cut(u: &mut Unstructured<'_>, outputs: usize) -> Result<(usize, usize)> {
    let first = u.int_in_range(0..=outputs - 1)?;
    Ok((first, u.int_in_range(1..=outputs - first)?))
}

fn apply<T: Sample>(
    runner: &Runner<T>,
    x: &[T],
    (first, origin): (usize, isize),
    outputs: usize,
    orders: usize,
) -> Vec<Vec<T>> {
    let mut results = vec![vec![T::from_f64(777.0); outputs]; orders];
    let mut outs: Vec<&mut [T]> = results.iter_mut().map(Vec::as_mut_slice).collect();
    runner.apply(Windows { x, first, origin, outs: &mut outs }, &mut Scratch::default()).expect("runs");
    results
}

/// The same in one lane, beside rows of zeros, which stay zeros.
fn lanes<T: Sample>(
    runner: &Runner<T>,
    x: &[T],
    lane: usize,
    origin: isize,
    (outputs, orders): (usize, usize),
) -> Vec<Vec<T>> {
    let mut matrix = vec![T::default(); x.len() * T::LANES];
    matrix[lane..].iter_mut().step_by(T::LANES).zip(x).for_each(|(place, value)| *place = *value);
    let mut results = vec![vec![T::from_f64(777.0); outputs * T::LANES]; orders];
    let mut outs: Vec<&mut [T]> = results.iter_mut().map(Vec::as_mut_slice).collect();
    let windows = Windows { x: &matrix, first: 0, origin, outs: &mut outs };
    runner.apply_lanes(windows, &mut Scratch::default()).expect("runs");
    for out in &results {
        let others = out.iter().enumerate().filter(|(index, _)| index % T::LANES != lane);
        assert!(others.into_iter().all(|(_, value)| *value == T::default()), "rows of zeros");
    }
    results.iter().map(|out| out[lane..].iter().step_by(T::LANES).copied().collect()).collect()
}

/// A part of an array, by any engine and in any mode, has the bits of the whole or is refused.
fn parts<T: Sample>(u: &mut Unstructured<'_>) -> Result<()> {
    let modes = [Mode::Fit, Mode::Valid, Mode::Nan, Mode::Nearest, Mode::Mirror, Mode::Wrap, Mode::Constant(0.5)];
    let (mode, engine) = (*u.choose(&modes)?, [None, Some(Engine::Direct)][usize::from(u.ratio(1, 2)?)]);
    let design = sound(u, 60)?;
    let made = plans(&design, u.int_in_range(1..=2)?).and_then(|plans| Bank::new(plans, engine));
    let bank = match made {
        Ok(bank) => bank,
        Err(error) => return Ok(refused(&error)),
    };
    let (outer, inner) = *u.choose(&[(1, 1), (1, 1), (3, 1), (1, 3), (9, 1), (1, 17), (2, 2)])?;
    let samples = u.int_in_range(1..=3 * bank.first().span())?;
    let x: Vec<T> = signal(u, outer * samples * inner)?;
    let job = Job { aligned: u.arbitrary()?, threads: 1, ..Job::new(&bank, mode, Layout { outer, samples, inner }) };
    let (outputs, orders) = (job.outputs(), bank.plans().len());
    let mut whole = vec![T::default(); orders * outer * outputs * inner];
    if let Err(error) = job.run(&x, &mut whole, &Unattended) {
        return Ok(refused(&error));
    }
    if outputs == 0 {
        return Ok(());
    }
    let (first, wanted) = cut(u, outputs)?;
    let (start, held) = cut(u, samples)?;
    let part = Part { start, samples, first, outputs: wanted };
    let layout = Layout { outer, samples: held, inner };
    let rows = |from: usize, count: usize, length: usize, values: &[T]| -> Vec<T> {
        values.chunks(length * inner).flat_map(|rows| &rows[from * inner..(from + count) * inner]).copied().collect()
    };
    let mut out = vec![T::default(); orders * outer * wanted * inner];
    match (Job { part: Some(part), layout, ..job }).run(&rows(start, held, samples, &x), &mut out, &Unattended) {
        Ok(()) => assert!(same(&rows(first, wanted, outputs, &whole), &out), "{mode:?} {part:?} {design:?}"),
        Err(error @ Error::Argument { name: "part", .. }) => refused(&error),
        Err(other) => panic!("{other} {mode:?} {part:?} {design:?}"),
    }
    Ok(())
}
