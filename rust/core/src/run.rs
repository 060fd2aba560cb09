//! A plan meets an array: which outputs are interior, how the work is cut, threads, and stopping on request.
//!
//! The array is contiguous and seen as `(outer, samples, inner)`; the middle axis is differentiated. Work is cut into
//! tasks that own contiguous pieces of the output. The cuts change no bit, because every output is computed alone.
//! Threads are scoped and end with the run: a pool of threads would hang in a forked child.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::bank::Bank;
use crate::control::Control;
pub use crate::ends::Mode;
use crate::engine::Sample;
use crate::error::Error;
pub use crate::rows::Layout;
use crate::rows::{PIECE, Rows, Worker};

/// Multiplications that make a task worth handing out, and a thread worth starting: a few milliseconds.
const TASK: usize = 1 << 22;

/// How often the thread that was called asks whether to go on.
const INTERVAL: Duration = Duration::from_millis(40);

/// Where the outputs of the full-length modes lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alignment {
    /// On the samples: `tau` is moved to the nearest one if need be.
    Sample,
    /// Half a sample later for even windows: `SciPy`'s convention, `tau` stays in the middle.
    HalfSample,
}

/// One run of a plan.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// What to run.
    pub bank: &'a Bank,
    /// What happens at the ends of the data.
    pub mode: Mode,
    /// Where full-length outputs lie.
    pub alignment: Alignment,
    /// The array.
    pub layout: Layout,
    /// Threads at most; 0 for as many as the process may use.
    pub threads: usize,
}

/// How far a run is, and whether it should stop.
#[derive(Debug, Default)]
pub struct Progress {
    stop: AtomicBool,
    done: AtomicUsize,
    total: usize,
}

impl Job<'_> {
    /// Outputs of one row.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.layout.outputs(self.mode, self.bank.first().span())
    }

    /// Estimates into `out`, which has the shape of `x` but for [`Job::outputs`] along the differentiated axis.
    pub fn run<T: Sample>(&self, x: &[T], out: &mut [T], control: &impl Control) -> Result<(), Error> {
        let (samples, window_length) = (self.layout.samples, self.bank.first().span());
        if window_length > samples && !self.mode.extends() {
            let allowed = format!("at most the {samples} samples of x in mode '{}'", self.mode.name());
            return Err(Error::argument("window_length", window_length, allowed));
        }
        let outputs = self.outputs();
        if self.layout.size(samples) != Some(x.len()) || self.layout.size(outputs) != Some(out.len()) {
            return Err(Error::argument("out", out.len(), "as long as layout and mode say"));
        }
        if out.is_empty() {
            return Ok(());
        }
        let rows = self.rows(control)?;
        let progress = Progress { total: out.len(), ..Progress::default() };
        let work_load = out.len().saturating_mul(window_length);
        let tasks = Tasks::new(out, outputs, self.layout.inner, window_length);
        let threads = self.threads_for(work_load).min(tasks.left());
        work(rows, x, &Mutex::new(tasks), &progress, threads, control)
    }

    /// Decides what every thread needs to know.
    fn rows<T: Sample>(&self, control: &impl Control) -> Result<Rows<'_, T>, Error> {
        let (plan, mode, outputs) = (self.bank.first(), self.mode, self.outputs());
        let window_length = plan.span();
        let half_sample = self.alignment == Alignment::HalfSample && window_length.is_multiple_of(2);
        let (runner, center) = match mode {
            Mode::Valid => (self.bank.at_tau()?, 0),
            _ if half_sample => (self.bank.at_tau()?, (window_length / 2).cast_signed() - 1),
            _ => (self.bank.aligned(control)?, plan.aligned_position()),
        };
        let windows = (self.layout.samples + 1).saturating_sub(window_length).cast_signed();
        let clamp = |output: isize| output.clamp(0, outputs.cast_signed()).cast_unsigned();
        let mut interior = (clamp(center), clamp(windows + center));
        if half_sample && mode == Mode::Fit {
            interior = (window_length / 2, outputs - window_length / 2);
        }
        let fit = if mode == Mode::Fit && interior != (0, outputs) { Some(plan.fit_for_ends(control)?) } else { None };
        let mut rows = Rows { plan, runner, fit, mode, center, interior, layout: self.layout };
        if rows.gathers_ends() {
            rows.interior = (0, outputs);
        }
        Ok(rows)
    }

    fn threads_for(&self, work: usize) -> usize {
        let useful = (work / TASK).max(1);
        // Asking the system takes longer than a short call.
        if useful == 1 || self.threads == 1 {
            return 1;
        }
        let processors = thread::available_parallelism().map_or(1, usize::from);
        match self.threads {
            0 => processors.min(useful),
            // Many more than there are processors gain nothing, and starting them may exhaust memory where libc aborts.
            threads => threads.min(4 * processors).min(useful),
        }
    }
}

/// Whole rows, or a piece of one: the outputs from `start` of the row `outer`, as many as `out` holds.
struct Task<'a, T> {
    outer: usize,
    start: usize,
    out: &'a mut [T],
}

/// Hands out the output in tasks, in order.
struct Tasks<'a, T> {
    rest: &'a mut [T],
    outer: usize,
    start: usize,
    outputs: usize,
    inner: usize,
    rows: usize,
    piece: usize,
}

impl<'a, T> Tasks<'a, T> {
    fn new(out: &'a mut [T], outputs: usize, inner: usize, window_length: usize) -> Self {
        let row = outputs.saturating_mul(inner).saturating_mul(window_length);
        let rows = (TASK / row).max(1);
        // Columns are gathered with the windows' overlap, which should stay a small part of what is gathered.
        let columns = (8 * TASK / inner.saturating_mul(window_length)).max(window_length.saturating_mul(4)).max(64);
        let piece = if inner == 1 { PIECE } else { PIECE.min(columns) };
        Self { rest: out, outer: 0, start: 0, outputs, inner, rows, piece }
    }

    /// How many tasks there are, at least.
    fn left(&self) -> usize {
        let per_task = if self.rows > 1 { self.rows * self.outputs } else { self.piece.min(self.outputs) };
        self.rest.len().div_ceil(per_task.saturating_mul(self.inner).max(1))
    }
}

impl<'a, T> Iterator for Tasks<'a, T> {
    type Item = Task<'a, T>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let (outer, start) = (self.outer, self.start);
        let length = if self.rows > 1 { self.rows * self.outputs } else { self.piece.min(self.outputs - start) };
        let end = self.rest.len().min(length.saturating_mul(self.inner));
        let (out, rest) = std::mem::take(&mut self.rest).split_at_mut(end);
        self.rest = rest;
        let after = start + length;
        (self.outer, self.start) = (outer + after / self.outputs, after % self.outputs);
        Some(Task { outer, start, out })
    }
}

/// Works off all tasks, on this thread and `threads - 1` more.
fn work<T: Sample>(
    rows: Rows<'_, T>,
    x: &[T],
    tasks: &Mutex<Tasks<'_, T>>,
    progress: &Progress,
    threads: usize,
    control: &impl Control,
) -> Result<(), Error> {
    thread::scope(|scope| {
        // Where the system refuses another thread, the ones that are there do the work.
        let start = |_| thread::Builder::new().spawn_scoped(scope, || work_alone(rows, x, tasks, progress, &mut || ()));
        let helpers: Vec<_> = (1..threads).map_while(|index| start(index).ok()).collect();
        let mut last = Instant::now();
        let mut result = work_alone(rows, x, tasks, progress, &mut || progress.ask(control, &mut last));
        let mut nap = Duration::from_micros(10);
        while helpers.iter().any(|helper| !helper.is_finished()) {
            thread::sleep(nap);
            nap = (nap * 2).min(INTERVAL / 8);
            progress.ask(control, &mut last);
        }
        for helper in helpers {
            match helper.join() {
                Ok(outcome) => result = result.and(outcome),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        result
    })
}

/// Works off tasks until there are none; `between` is called between slices of work.
fn work_alone<T: Sample>(
    rows: Rows<'_, T>,
    x: &[T],
    tasks: &Mutex<Tasks<'_, T>>,
    progress: &Progress,
    between: &mut impl FnMut(),
) -> Result<(), Error> {
    let mut worker = Worker::new(rows, &progress.stop);
    let next = || tasks.lock().unwrap_or_else(PoisonError::into_inner).next();
    while let Some(Task { outer, start, out }) = next() {
        let (length, matrix) = (out.len(), rows.layout.samples * rows.layout.inner);
        let (per_row, inner) = (rows.outputs(), rows.layout.inner);
        for (piece, outer) in out.chunks_mut(per_row * inner).zip(outer..) {
            worker.run(&x[outer * matrix..(outer + 1) * matrix], start, piece, between)?;
        }
        progress.done.fetch_add(length, Ordering::Relaxed);
        between();
        if progress.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
    }
    Ok(())
}

impl Progress {
    /// Asks the caller whether to go on, not more often than it is worth.
    fn ask(&self, control: &impl Control, last: &mut Instant) {
        if last.elapsed() >= INTERVAL {
            let fraction = self.done.load(Ordering::Relaxed) as f64 / self.total as f64;
            if !control.proceed(fraction) {
                self.stop.store(true, Ordering::Relaxed);
            }
            *last = Instant::now();
        }
    }
}
