//! Streams have the bits of whole rows, and streams that fit have the bits of single pushes, however samples come: in blocks,
//! with gaps and times, after resets, copies and restored states; and what is refused changes nothing.

#![no_main]

use std::sync::Arc;

use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::engine::{Engine, Sample};
use algdiff_core::error::Error;
use algdiff_core::rule::Rule;
use algdiff_core::run::{Job, Layout, Mode};
use algdiff_core::stream::{Fitted, Missing, Point, Results, Stream, Wanted};
use algdiff_fuzz::refused;
use algdiff_fuzz::signals::{same, signal};
use algdiff_fuzz::wishes::{plans, sound};
use arbitrary::{Result, Unstructured};
use libfuzzer_sys::{Corpus, fuzz_target};

/// Samples of a channel, at most.
const SAMPLES: usize = 64;

fuzz_target!(|data: &[u8]| -> Corpus {
    let mut u = Unstructured::new(data);
    let run = |u: &mut Unstructured<'_>| match u.int_in_range(0..=3)? {
        0 => sliding::<f64>(u),
        1 => sliding::<f32>(u),
        2 => fitting::<f64>(u),
        _ => fitting::<f32>(u),
    };
    if run(&mut u).is_ok() { Corpus::Keep } else { Corpus::Reject }
});

/// One or two designs of one or two orders, by the engine that gives the same bits; none if they are refused.
fn banks(u: &mut Unstructured<'_>, fitted: bool) -> Result<Option<Vec<Arc<Bank>>>> {
    let mut banks = Vec::new();
    for _ in 0..u.int_in_range(1..=2)? {
        let mut design = sound(u, if fitted { 16 } else { 40 })?;
        if fitted {
            (design.rule, design.trim) = (Rule::Exact, 0.0);
        }
        match plans(&design, u.int_in_range(1..=2)?).and_then(|plans| Bank::new(plans, Some(Engine::Direct))) {
            Ok(bank) => banks.push(Arc::new(bank)),
            Err(error) => {
                refused(&error);
                return Ok(None);
            }
        }
    }
    Ok(Some(banks))
}

/// What a stream should give of samples since its start: for every order one output for every sample, NaN at first.
fn expected<T: Sample>(bank: &Bank, x: &[T], channels: usize) -> Vec<Vec<T>> {
    let samples = x.len() / channels;
    let warmup = (bank.first().span() - 1).min(samples);
    let job = Job { threads: 1, ..Job::new(bank, Mode::Valid, Layout { outer: 1, samples, inner: channels }) };
    let size = job.outputs() * channels;
    let mut out = vec![T::default(); bank.plans().len() * size];
    if size > 0 {
        job.run(x, &mut out, &Unattended).expect("as long as the window");
    }
    let nan = vec![T::from_f64(f64::NAN); warmup * channels];
    (0..bank.plans().len()).map(|order| [nan.as_slice(), &out[order * size..][..size]].concat()).collect()
}

/// Sliding windows alone.
fn sliding<T: Sample>(u: &mut Unstructured<'_>) -> Result<()> {
    let channels = *u.choose(&[1, 1, 1, 2, 3, 17])?;
    let Some(banks) = banks(u, false)? else { return Ok(()) };
    let samples = u.int_in_range(1..=SAMPLES)?;
    let x: Vec<T> = signal(u, samples * channels)?;
    let mut stream = Stream::new(&banks, channels).expect("small");
    let mut out: Vec<Vec<T>> = vec![Vec::new(); stream.orders()];
    let mut start = 0;
    let hold = |out: &[Vec<T>], range: std::ops::Range<usize>| {
        let wanted =
            banks.iter().flat_map(|bank| expected(bank, &x[range.start * channels..range.end * channels], channels));
        for (order, (got, wanted)) in out.iter().zip(wanted).enumerate() {
            assert!(same(got, &wanted), "order {order} of {} channels", channels);
        }
    };
    let mut next = 0;
    while next < samples {
        // Of bytes that are used up the first is chosen, which goes on.
        match u.int_in_range(0..=9)? {
            4 => {
                hold(&out, start..next);
                stream.reset();
                out.iter_mut().for_each(Vec::clear);
                start = next;
            }
            5 => {
                let mut kept = vec![T::default(); stream.length().min(next - start) * channels];
                stream.copy_newest(kept.len() / channels, &mut kept);
                let count = stream.count();
                assert!(count == (next - start) as u64);
                stream = if u.arbitrary()? { Stream::new(&banks, channels).expect("small") } else { stream.clone() };
                stream.restore(&kept, count).expect("as many as it had");
            }
            6 => {
                let wrong = vec![T::default(); channels];
                let mut short = vec![T::default(); channels * stream.orders() - 1];
                refused(&stream.push_block(&wrong, &mut short, 1, &Unattended).expect_err("too short"));
            }
            7..=9 => {
                let mut part = vec![T::default(); channels * stream.orders()];
                stream.push(&x[next * channels..][..channels], &mut part);
                out.iter_mut().zip(part.chunks(channels)).for_each(|(out, part)| out.extend_from_slice(part));
                next += 1;
            }
            _ => {
                let many = if u.is_empty() { samples - next } else { u.int_in_range(0..=samples - next)? };
                let block = &x[next * channels..][..many * channels];
                let mut part = vec![T::default(); block.len() * stream.orders()];
                stream.push_block(block, &mut part, 1, &Unattended).expect("fits");
                if many > 0 {
                    out.iter_mut().zip(part.chunks(block.len())).for_each(|(out, part)| out.extend_from_slice(part));
                }
                next += many;
            }
        }
        assert!(stream.count() == (next - start) as u64 && stream.channels() == channels);
    }
    hold(&out, start..next);
    Ok(())
}

/// What was given for one sample: estimates and their standard deviations, and the support.
#[derive(Debug)]
struct Given<T> {
    estimate: Vec<T>,
    std: Option<Vec<T>>,
    support: Option<Vec<i64>>,
}

/// A stream that fits, and what it has taken since its start.
struct Taken<T: Sample> {
    banks: Vec<(Arc<Bank>, Point)>,
    channels: usize,
    wanted: Wanted,
    stream: Fitted<T>,
    timed: bool,
    samples: Vec<(Vec<T>, Option<f64>)>,
    given: Vec<Given<T>>,
}

/// Windows that grow, miss samples or have times.
fn fitting<T: Sample>(u: &mut Unstructured<'_>) -> Result<()> {
    let channels = *u.choose(&[1, 1, 1, 3])?;
    let Some(banks) = banks(u, true)? else { return Ok(()) };
    let point = if u.ratio(1, 3)? { Some(f64::from(u.int_in_range(-2_i8..=20)?) / 4.0) } else { None };
    let place = |bank: &Arc<Bank>| point.map_or(Point::Tau(bank.first().kernel().tau()), Point::Delay);
    let wanted = Wanted {
        grow: u.arbitrary()?,
        missing: *u.choose(&[Missing::Omit, Missing::Omit, Missing::Propagate, Missing::Raise])?,
        support: if u.arbitrary()? { 0 } else { u.int_in_range(0..=30)? },
        gain: if u.ratio(1, 4)? { Some(f64::from(u.int_in_range(0_u8..=200)?) / 20.0) } else { None },
    };
    let banks: Vec<_> = banks.into_iter().map(|bank| (Arc::clone(&bank), place(&bank))).collect();
    let stream = match Fitted::new(&banks, channels, wanted) {
        Ok(stream) => stream,
        Err(error) => return Ok(refused(&error)),
    };
    let timed = u.ratio(1, 3)?;
    let mut taken = Taken { banks, channels, wanted, stream, timed, samples: Vec::new(), given: Vec::new() };
    let count = u.int_in_range(1..=SAMPLES / 3)?;
    let x: Vec<T> = signal(u, count * channels)?;
    let missing = u.int_in_range(0..=255)?;
    let (mut next, mut time) = (0, 0.0);
    while next < count {
        let many = u.int_in_range(1..=count - next)?.min(if u.arbitrary()? { 1 } else { 20 });
        let mut block = x[next * channels..][..many * channels].to_vec();
        for (index, value) in block.iter_mut().enumerate() {
            if (next * channels + index) * 37 % 256 < missing / 4 {
                *value = T::from_f64(f64::NAN);
            }
        }
        let mut times = Vec::new();
        for _ in 0..many {
            // Now and then time stands still, which is refused.
            time += f64::from(u.int_in_range(0_u8..=64)?) / 32.0;
            times.push(time);
        }
        taken.take(u, &block, &times)?;
        next += many;
    }
    taken.hold();
    Ok(())
}

impl<T: Sample> Taken<T> {
    /// Does something with the stream, and pushes a block or its only sample.
    fn take(&mut self, u: &mut Unstructured<'_>, block: &[T], times: &[f64]) -> Result<()> {
        match u.int_in_range(0..=11)? {
            0 => {
                self.hold();
                self.stream.reset();
                self.samples.clear();
                self.given.clear();
            }
            1 | 2 => self.restore(),
            3 => self.stream = self.stream.clone(),
            _ => {}
        }
        let times = self.timed.then_some(times);
        let (before, channels) = (self.stream.stream().count(), self.channels);
        let (orders, rows, parts) = (self.stream.stream().orders(), block.len() / channels, self.banks.len());
        let mut estimate = vec![T::default(); orders * block.len()];
        let (mut std, mut support) = (vec![T::default(); orders * block.len()], vec![0; parts * block.len()]);
        let all: bool = u.arbitrary()?;
        let done = if rows == 1 && !all {
            self.stream.push(block, times.map(|times| times[0]), &mut estimate)
        } else {
            let (std, support) = (all.then_some(&mut std[..]), all.then_some(&mut support[..]));
            self.stream.push_block(block, times, Results { estimate: &mut estimate, std, support }, 1, &Unattended)
        };
        if let Err(error) = done {
            refused(&error);
            assert!(matches!(error, Error::Argument { name: "t" | "x", .. }), "{error}");
            assert!(self.stream.stream().count() == before);
            return Ok(());
        }
        assert!(self.stream.stream().count() == before + rows as u64);
        for row in 0..rows {
            let cut = |values: &[T]| -> Vec<T> {
                values.chunks(block.len()).flat_map(|part| &part[row * channels..][..channels]).copied().collect()
            };
            let counts = support.chunks(block.len()).flat_map(|part| &part[row * channels..][..channels]).copied();
            let (std, support) = (all.then(|| cut(&std)), all.then(|| counts.collect()));
            self.given.push(Given { estimate: cut(&estimate), std, support });
            self.samples.push((block[row * channels..][..channels].to_vec(), times.map(|times| times[row])));
        }
        assert!(!self.stream.delay().is_infinite());
        Ok(())
    }

    /// Replaces the stream by one that is made from its state.
    fn restore(&mut self) {
        let (old, count) = (self.stream.stream(), self.stream.stream().count());
        let mut kept = vec![T::default(); old.length().min(self.samples.len()) * self.channels];
        old.copy_newest(kept.len() / self.channels, &mut kept);
        let times = self.stream.times().to_vec();
        self.stream = Fitted::new(&self.banks, self.channels, self.wanted).expect("as before");
        self.stream.restore(&kept, &times, count).expect("a state of its own");
    }

    /// Holds what was given to single pushes, and of full windows that miss nothing to whole rows.
    fn hold(&self) {
        let mut single = Fitted::new(&self.banks, self.channels, self.wanted).expect("as before");
        let size = single.stream().orders() * self.channels;
        for (index, ((sample, time), given)) in self.samples.iter().zip(&self.given).enumerate() {
            let mut estimate = vec![T::default(); size];
            single.push(sample, *time, &mut estimate).expect("as before");
            assert!(same(&estimate, &given.estimate), "sample {index}: {estimate:?} {given:?}");
            let (mut again, mut std) = (vec![T::default(); size], vec![T::default(); size]);
            let mut support = vec![0; self.banks.len() * self.channels];
            let results = Results { estimate: &mut again, std: Some(&mut std), support: Some(&mut support) };
            single.last(results).expect("as before");
            assert!(same(&again, &estimate), "sample {index}: {estimate:?}, once more {again:?}");
            assert!(given.std.as_ref().is_none_or(|given| same(given, &std)), "sample {index}: {std:?} {given:?}");
            assert!(
                given.support.as_ref().is_none_or(|given| *given == support),
                "sample {index}: {support:?} {given:?}"
            );
        }
        if !self.timed {
            self.hold_rows();
        }
    }

    fn hold_rows(&self) {
        let x: Vec<T> = self.samples.iter().flat_map(|(sample, _)| sample).copied().collect();
        let mut first = 0;
        for (bank, _) in &self.banks {
            let span = bank.first().span();
            for (order, row) in expected(bank, &x, self.channels).iter().enumerate() {
                for (index, wanted) in row.iter().enumerate().skip((span - 1) * self.channels) {
                    let (sample, channel) = (index / self.channels, index % self.channels);
                    let mut window = x[channel..].iter().step_by(self.channels).skip(sample + 1 - span).take(span);
                    let got = self.given[sample].estimate[(first + order) * self.channels + channel];
                    let whole = !window.any(|value| value.to_f64().is_nan()) || self.wanted.missing != Missing::Omit;
                    assert!(!whole || same(&[got], &[*wanted]), "sample {sample}: {got:?} {wanted:?}");
                }
            }
            first += bank.plans().len();
        }
    }
}
