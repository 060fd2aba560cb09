//! Tasks are worked off, on one thread or several, and the caller is asked whether to go on.
//!
//! Threads are scoped and end with the run: a pool of threads would hang in a forked child.

#![expect(clippy::indexing_slicing, reason = "parts are cut to the rows that there are")]

use std::ops::Range;
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
pub struct Progress {
    stop: AtomicBool,
    done: AtomicUsize,
    total: usize,
}

impl Progress {
    /// Counts outputs, and hears whether to go on.
    pub fn proceed(&self, outputs: usize, between: &mut dyn FnMut()) -> Result<(), Error> {
        self.done.fetch_add(outputs, Ordering::Relaxed);
        between();
        if self.stop.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }

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

/// Work in tasks: how much it is, and on how many threads it may be done.
#[derive(Debug, Clone, Copy)]
pub struct Load {
    /// Outputs of all tasks, by which progress is counted.
    pub outputs: usize,
    /// What one output costs, in multiplications.
    pub work: usize,
    /// Tasks, roughly.
    pub tasks: usize,
    /// Threads at most; 0 for as many as the process may use.
    pub threads: usize,
}

/// What one thread works off.
pub type Next<'n, Task> = &'n mut dyn FnMut() -> Option<Task>;

/// Works off `tasks` on as many threads as are useful: each takes them, one after the other, from what `alone` is given, which
/// is to call its last argument between slices of work.
pub fn share<Task: Send>(
    mut tasks: impl Iterator<Item = Task> + Send,
    load: Load,
    control: &impl Control,
    alone: impl Fn(Next<'_, Task>, &Progress, &mut dyn FnMut()) -> Result<(), Error> + Sync,
) -> Result<(), Error> {
    let threads = useful(load.outputs.saturating_mul(load.work), load.threads).min(load.tasks);
    let progress = Progress { total: load.outputs, ..Progress::default() };
    let mut last = None;
    if threads <= 1 {
        return alone(&mut || tasks.next(), &progress, &mut || progress.ask(control, &mut last));
    }
    let tasks = Mutex::new(tasks);
    let next = || tasks.lock().unwrap_or_else(PoisonError::into_inner).next();
    let running = AtomicUsize::new(0);
    let caller = thread::current();
    thread::scope(|scope| {
        let help = || {
            let _leaving = Leaving { running: &running, caller: &caller };
            alone(&mut || next(), &progress, &mut || ())
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
        let mut result = alone(&mut || next(), &progress, &mut || progress.ask(control, &mut last));
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
        // What was heard when all was done is heard all the same: it must not be lost.
        result.and_then(|()| progress.proceed(0, &mut || ()))
    })
}

/// Works off the tasks of a run.
pub fn work<T: Sample>(
    frame: &Frame<'_, T>,
    x: &[T],
    tasks: Tasks<'_, '_, T>,
    threads: usize,
    control: &impl Control,
) -> Result<(), Error> {
    let outputs = frame.outputs() * frame.layout.outer * frame.layout.inner;
    let load = Load { outputs, work: work_of_one(frame), tasks: tasks.left(), threads };
    share(tasks, load, control, |next, progress, between| work_alone(frame, x, next, progress, between))
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
    next: Next<'_, Task<'o, T>>,
    progress: &Progress,
    between: &mut dyn FnMut(),
) -> Result<(), Error> {
    let mut worker = Worker::new(frame, progress);
    let matrix = frame.layout.samples * frame.layout.inner;
    while let Some(task) = next() {
        let done = match task {
            Task::Panel { outer, column, outputs, mut lines } => {
                worker.panel(&x[outer * matrix..][..matrix], column, &outputs, &mut lines, between)?;
                outputs.len() * lines.first().map_or(0, |line| line.len())
            }
            Task::Rows { outer, outputs, outs } => {
                let done = outs.first().map_or(0, |out| out.len());
                rows(&mut worker, x, outer, &outputs, outs, between)?;
                done
            }
        };
        progress.proceed(done, between)?;
    }
    Ok(())
}

/// `outputs` of the rows from `outer` on, as many as there is place for in every one of `outs`.
fn rows<T: Sample>(
    worker: &mut Worker<'_, T>,
    x: &[T],
    outer: usize,
    outputs: &Range<usize>,
    outs: Vec<&mut [T]>,
    between: &mut dyn FnMut(),
) -> Result<(), Error> {
    let (held, start) = (worker.frame.layout.samples, worker.frame.start.cast_signed());
    let bundled = worker.frame.gather == Gather::Bundles;
    let per_call = outputs.len() * if bundled { T::LANES } else { 1 };
    let mut pieces: Vec<_> = outs.into_iter().map(|out| out.chunks_mut(per_call)).collect();
    let mut number = outer;
    loop {
        let mut outs: Vec<&mut [T]> = pieces.iter_mut().filter_map(Iterator::next).collect();
        let rows = outs.first().map_or(0, |out| out.len() / outputs.len());
        if rows == 0 {
            return Ok(());
        }
        let x = &x[number * held..(number + rows) * held];
        if bundled {
            worker.bundle(x, outputs, &mut outs)?;
        } else {
            worker.row(Row { x, start, number, extended: false }, outputs.clone(), &mut outs, between)?;
        }
        number += rows;
    }
}
