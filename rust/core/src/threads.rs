//! Tasks are worked off, on one thread or several, and the caller is asked whether to go on.
//!
//! Threads are scoped and end with the run: a pool of threads would hang in a forked child.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};

use crate::columns::Gather;
use crate::control::Control;
use crate::engine::Sample;
use crate::error::Error;
use crate::frame::Frame;
use crate::rows::{Row, Worker};
use crate::tasks::{Task, Tasks, work as work_of_one};

/// Work that makes a thread worth starting, in multiplications: several times as long as starting it takes.
const THREAD: usize = 1 << 21;

/// Work beside which asking the system for the number of processors does not show.
const LARGE: usize = 1 << 26;

/// How often the thread that was called asks whether to go on.
const INTERVAL: Duration = Duration::from_millis(40);

/// The number of processors when it was last asked for; 0 if never.
static PROCESSORS: AtomicUsize = AtomicUsize::new(0);

/// How far a run is, and whether it should stop.
#[derive(Debug, Default)]
struct Progress {
    stop: AtomicBool,
    done: AtomicUsize,
    total: usize,
}

impl Progress {
    /// Asks the caller whether to go on, not more often than it is worth.
    fn ask(&self, control: &impl Control, last: &mut Option<Instant>) {
        let now = Instant::now();
        if now.duration_since(*last.get_or_insert(now)) >= INTERVAL {
            let fraction = self.done.load(Ordering::Relaxed) as f64 / self.total as f64;
            if !control.proceed(fraction) {
                self.stop.store(true, Ordering::Relaxed);
            }
            *last = Some(Instant::now());
        }
    }
}

/// Works off `tasks` on as many threads as are useful, `threads` at most if that is not 0.
pub fn work<T: Sample>(
    frame: &Frame<'_, T>,
    x: &[T],
    mut tasks: Tasks<'_, '_, T>,
    threads: usize,
    control: &impl Control,
) -> Result<(), Error> {
    let outputs = frame.outputs() * frame.layout.outer * frame.layout.inner;
    let threads = useful(outputs.saturating_mul(work_of_one(frame)), threads).min(tasks.left());
    let progress = Progress { total: outputs, ..Progress::default() };
    let mut last = None;
    if threads <= 1 {
        return work_alone(frame, x, || tasks.next(), &progress, &mut || progress.ask(control, &mut last));
    }
    let tasks = Mutex::new(tasks);
    let next = || tasks.lock().unwrap_or_else(PoisonError::into_inner).next();
    let running = AtomicUsize::new(0);
    let caller = thread::current();
    thread::scope(|scope| {
        let help = || {
            let _leaving = Leaving { running: &running, caller: &caller };
            work_alone(frame, x, next, &progress, &mut || ())
        };
        let start = |_| {
            running.fetch_add(1, Ordering::Relaxed);
            // Where the system refuses another thread, the ones that are there do the work.
            let helper = thread::Builder::new().spawn_scoped(scope, help);
            if helper.is_err() {
                running.fetch_sub(1, Ordering::Relaxed);
            }
            helper.ok()
        };
        let helpers: Vec<_> = (1..threads).map_while(start).collect();
        let mut result = work_alone(frame, x, next, &progress, &mut || progress.ask(control, &mut last));
        while running.load(Ordering::Acquire) > 0 {
            thread::park_timeout(INTERVAL);
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

/// Wakes the caller when a helper leaves, however it does.
struct Leaving<'a> {
    running: &'a AtomicUsize,
    caller: &'a Thread,
}

impl Drop for Leaving<'_> {
    fn drop(&mut self) {
        self.running.fetch_sub(1, Ordering::Release);
        self.caller.unpark();
    }
}

/// How many threads to start for so much work.
fn useful(work: usize, threads: usize) -> usize {
    let useful = work / THREAD;
    if useful <= 1 || threads == 1 {
        return 1;
    }
    let mut processors = PROCESSORS.load(Ordering::Relaxed);
    // It may change, but asking takes longer than a short call.
    if processors == 0 || work >= LARGE {
        processors = thread::available_parallelism().map_or(1, usize::from);
        PROCESSORS.store(processors, Ordering::Relaxed);
    }
    // Many more than there are processors gain nothing, and starting them may exhaust memory where libc aborts.
    if threads == 0 { processors.min(useful) } else { threads.min(4 * processors).min(useful) }
}

/// Works off tasks until there are none; `between` is called between slices of work.
fn work_alone<'o, T: Sample + 'o>(
    frame: &Frame<'_, T>,
    x: &[T],
    mut next: impl FnMut() -> Option<Task<'o, T>>,
    progress: &Progress,
    between: &mut impl FnMut(),
) -> Result<(), Error> {
    let mut worker = Worker::new(frame, &progress.stop);
    let matrix = frame.layout.samples * frame.layout.inner;
    while let Some(task) = next() {
        let done = match task {
            Task::Panel { outer, column, outputs, mut lines } => {
                worker.panel(&x[outer * matrix..][..matrix], column, &outputs, &mut lines, between)?;
                outputs.len() * lines.first().map_or(0, |line| line.len())
            }
            Task::Rows { outer, outputs, outs } => {
                let done = outs.first().map_or(0, |out| out.len());
                let bundled = frame.gather == Gather::Bundles;
                let per_call = outputs.len() * if bundled { T::LANES } else { 1 };
                let mut pieces: Vec<_> = outs.into_iter().map(|out| out.chunks_mut(per_call)).collect();
                let mut number = outer;
                loop {
                    let mut outs: Vec<&mut [T]> = pieces.iter_mut().filter_map(Iterator::next).collect();
                    let rows = outs.first().map_or(0, |out| out.len() / outputs.len());
                    if rows == 0 {
                        break;
                    }
                    let x = &x[number * matrix..(number + rows) * matrix];
                    if bundled {
                        worker.bundle(x, &outputs, &mut outs)?;
                    } else {
                        let row = Row { x, start: frame.start.cast_signed(), number, extended: false };
                        worker.row(row, outputs.clone(), &mut outs, between)?;
                    }
                    number += rows;
                }
                done
            }
        };
        progress.done.fetch_add(done, Ordering::Relaxed);
        worker.proceed(between)?;
    }
    Ok(())
}
