//! The boundary of [`algdiff_core::stream`].

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

use algdiff_core::bank::Bank as CoreBank;
use algdiff_core::control::Control;
use algdiff_core::engine::Sample;
use algdiff_core::error::Error;
use algdiff_core::stream::{Fitted, Missing, Point, Results, Wanted};
use numpy::{
    Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray1, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyFloat, PyInt, PyType};

use crate::{Bank, InternalError, enter, raised, unknown};

const FAILED: &str = "the stream failed inside; please report what you called";

/// How long a thread sleeps that waits for another one's block.
const PAUSE: Duration = Duration::from_micros(50);

/// How often it hears whether to go on.
const INTERVAL: Duration = Duration::from_millis(40);

/// Estimates sample by sample.
#[pyclass(frozen, subclass, module = "algdiff._core")]
pub struct Stream {
    inner: Mutex<Inner>,
    /// The thread that is pushing a block, which may run handlers of signals meanwhile.
    pushing: Mutex<Option<ThreadId>>,
    /// Numbers in a sample; none if a sample is a number.
    channels: Option<usize>,
    /// Whether results have a leading axis over the orders.
    leading: bool,
    single: bool,
    /// Orders of all designs.
    orders: usize,
    /// Whether the designs may be fitted to samples at times of their own.
    stamps: bool,
    /// For blocks.
    threads: usize,
}

/// Estimates, standard deviations and support.
type Newest = (Vec<f64>, Vec<f64>, Vec<i64>);

enum Inner {
    Double(Fitted<f64>),
    Single(Fitted<f32>),
}

/// The types of samples.
trait Number: Sample + Element {
    fn of(inner: &mut Inner) -> Result<&mut Fitted<Self>, Error>;
}

impl Number for f64 {
    fn of(inner: &mut Inner) -> Result<&mut Fitted<Self>, Error> {
        if let Inner::Double(stream) = inner { Ok(stream) } else { Err(Error::argument("x", "float64", "float32")) }
    }
}

impl Number for f32 {
    fn of(inner: &mut Inner) -> Result<&mut Fitted<Self>, Error> {
        if let Inner::Single(stream) = inner { Ok(stream) } else { Err(Error::argument("x", "float32", "float64")) }
    }
}

/// The same expression for either type of samples.
macro_rules! each {
    ($inner:expr, $stream:ident => $value:expr) => {
        match $inner {
            Inner::Double($stream) => $value,
            Inner::Single($stream) => $value,
        }
    };
}

impl Stream {
    /// Runs `call` alone: at once if no other thread is pushing, and without the interpreter otherwise.
    fn alone<R: Send>(&self, py: Python<'_>, call: impl FnOnce(&mut Inner) -> Result<R, Error> + Send) -> PyResult<R> {
        let inner = match self.inner.try_lock() {
            Ok(inner) => inner,
            Err(TryLockError::WouldBlock) if self.is_mine() => {
                return Err(PyRuntimeError::new_err("the stream is used by a signal handler while it takes a block"));
            }
            // Another thread is taking a block.
            Err(TryLockError::WouldBlock) => return enter(py, None, |control| call(&mut *self.wait(control)?)),
            // The error holds the lock: who waited here would wait for ever.
            Err(TryLockError::Poisoned(_)) => return Err(raised(failed())),
        };
        // What fails inside poisons the lock.
        let outcome = catch_unwind(AssertUnwindSafe(move || {
            let mut inner = inner;
            call(&mut inner)
        }));
        outcome.map_or_else(|_| Err(InternalError::new_err(FAILED)), |result| result.map_err(raised))
    }

    /// Waits, without the interpreter, until no other thread is pushing, or the caller has heard that it should stop.
    fn wait(&self, control: &impl Control) -> Result<MutexGuard<'_, Inner>, Error> {
        let mut heard = Instant::now();
        loop {
            match self.inner.try_lock() {
                Ok(inner) => return Ok(inner),
                Err(TryLockError::WouldBlock) => thread::sleep(PAUSE),
                Err(TryLockError::Poisoned(_)) => return Err(failed()),
            }
            if heard.elapsed() > INTERVAL {
                control.check(0.0)?;
                heard = Instant::now();
            }
        }
    }

    fn is_mine(&self) -> bool {
        self.pushing.lock().is_ok_and(|pushing| *pushing == Some(thread::current().id()))
    }

    /// The estimates of one sample.
    fn sample<'py, T: Number>(&self, py: Python<'py>, sample: &[T], time: Option<f64>) -> PyResult<Bound<'py, PyAny>> {
        if !self.leading && self.channels.is_none() {
            let mut estimate = [T::default()];
            self.alone(py, |inner| T::of(inner)?.push(sample, time, &mut estimate))?;
            return Ok(PyFloat::new(py, estimate[0].to_f64()).into_any());
        }
        let estimate = self.alone(py, |inner| {
            let stream = T::of(inner)?;
            let mut estimate = vec![T::default(); stream.stream().orders() * sample.len()];
            stream.push(sample, time, &mut estimate).map(|()| estimate)
        })?;
        let orders = estimate.len() / sample.len();
        let estimate = PyArray1::from_vec(py, estimate);
        if self.leading && self.channels.is_some() {
            return Ok(estimate.reshape([orders, sample.len()])?.into_any());
        }
        Ok(estimate.into_any())
    }

    /// The estimates of one sample or a block that needs no conversion; none if `x` is neither.
    fn array<'py, T: Number>(&self, x: &Bound<'py, PyAny>, time: Option<f64>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Ok(x) = x.cast_exact::<PyArrayDyn<T>>() else { return Ok(None) };
        let (shape, own) = (x.shape(), self.channels.as_slice());
        let Some(axes) = shape.len().checked_sub(own.len()) else { return Ok(None) };
        if axes > 1 || (axes == 1 && time.is_some()) || !shape.ends_with(own) || !x.is_c_contiguous() {
            return Ok(None);
        }
        let (py, held) = (x.py(), x.try_readonly()?);
        // What is not aligned is copied.
        let Ok(samples) = held.as_slice() else { return Ok(None) };
        if axes == 0 {
            return self.sample(py, samples, time).map(Some);
        }
        let leading = self.leading.then_some(self.orders);
        let sizes: Vec<usize> = leading.into_iter().chain(shape.iter().copied()).collect();
        let found = PyArrayDyn::<T>::zeros(py, sizes, false);
        let mut estimate = found.try_readwrite()?;
        let results = Results { estimate: estimate.as_slice_mut()?, std: None, support: None };
        self.take(py, samples, None, results, None)?;
        Ok(Some(found.clone().into_any()))
    }

    fn block<T: Number>(&self, py: Python<'_>, call: Block<'_, '_>) -> PyResult<()> {
        let x: PyReadonlyArray1<'_, T> = call.x.extract()?;
        let mut estimate: PyReadwriteArray1<'_, T> = call.estimate.extract()?;
        let mut std: Option<PyReadwriteArray1<'_, T>> = call.std.map(PyAnyMethods::extract).transpose()?;
        let mut support = call.support;
        let results = Results {
            estimate: estimate.as_slice_mut()?,
            std: std.as_mut().map(|out| out.as_slice_mut()).transpose()?,
            support: support.as_mut().map(|out| out.as_slice_mut()).transpose()?,
        };
        let (x, t) = (x.as_slice()?, call.t.as_ref().map(|t| t.as_slice()).transpose()?);
        self.take(py, x, t, results, call.progress)
    }

    /// Takes a block without the interpreter.
    fn take<T: Number>(
        &self,
        py: Python<'_>,
        x: &[T],
        t: Option<&[f64]>,
        results: Results<'_, T>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        if self.is_mine() {
            return self.alone(py, |_| Ok(()));
        }
        enter(py, progress, |control| {
            let mut inner = self.wait(control)?;
            let own = |own| self.pushing.lock().map_or((), |mut pushing| *pushing = own);
            own(Some(thread::current().id()));
            let done = T::of(&mut inner).and_then(|stream| stream.push_block(x, t, results, self.threads, control));
            own(None);
            done
        })
    }
}

/// A block whose type of samples is not known yet.
struct Block<'a, 'py> {
    x: &'a Bound<'py, PyAny>,
    t: Option<PyReadonlyArray1<'py, f64>>,
    estimate: &'a Bound<'py, PyAny>,
    std: Option<&'a Bound<'py, PyAny>>,
    support: Option<PyReadwriteArray1<'py, i64>>,
    progress: Option<Py<PyAny>>,
}

#[pymethods]
impl Stream {
    /// For `banks`; windows that are not their own are estimated at `points`, each a share of the window or else a delay.
    #[new]
    #[pyo3(signature = (banks, points, channels, *, leading, single, grow, missing, support, gain, stamps, threads))]
    #[expect(
        clippy::too_many_arguments,
        clippy::fn_params_excessive_bools,
        reason = "the stream's own parameters, by their own names"
    )]
    #[expect(clippy::needless_pass_by_value, reason = "a Python list becomes a vector")]
    fn new(
        py: Python<'_>,
        banks: Vec<PyRef<'_, Bank>>,
        points: Vec<(Option<f64>, f64)>,
        channels: Option<usize>,
        leading: bool,
        single: bool,
        grow: bool,
        missing: &str,
        support: usize,
        gain: Option<f64>,
        stamps: bool,
        threads: usize,
    ) -> PyResult<Self> {
        let missing = match missing {
            "propagate" => Missing::Propagate,
            "omit" => Missing::Omit,
            "raise" => Missing::Raise,
            _ => return Err(unknown("nan_policy", missing, "'propagate', 'omit' or 'raise'")),
        };
        let point = |(tau, delay): &(Option<f64>, f64)| tau.map_or(Point::Delay(*delay), Point::Tau);
        let banks: Vec<(Arc<CoreBank>, Point)> =
            banks.iter().zip(&points).map(|(bank, given)| (Arc::clone(&bank.0), point(given))).collect();
        let (numbers, wanted) = (channels.unwrap_or(1), Wanted { grow, missing, support, gain });
        let inner = enter(py, None, |_| {
            Ok(if single {
                Inner::Single(Fitted::new(&banks, numbers, wanted)?)
            } else {
                Inner::Double(Fitted::new(&banks, numbers, wanted)?)
            })
        })?;
        let orders = each!(&inner, stream => stream.stream().orders());
        let (inner, pushing) = (Mutex::new(inner), Mutex::new(None));
        Ok(Self { inner, pushing, channels, leading, single, orders, stamps, threads })
    }

    /// Take one sample or a block of samples, and return the estimates that belong to them.
    ///
    /// Parameters
    /// ----------
    /// x : float, or array_like of shape (channels,), (n,) or (n, channels)
    ///     One sample, or a block of them, the oldest first. What is not of the stream's dtype is converted to it.
    /// t : float or array_like of shape (n,), optional
    ///     When the samples were taken, if the clock is not even: finite and strictly ascending, for every sample of the
    ///     stream or for none. Every estimate is then a fit on the last `window_length` samples at their own times, with T
    ///     their range and one mean step more.
    /// return_std, return_support : bool
    ///     Return `Estimates`, with the standard deviation of every estimate for noise of the level `sigma`, or the number
    ///     of samples in its window that are not missing.
    ///
    /// Returns
    /// -------
    /// float, ndarray or Estimates
    ///     For every sample the estimate from the window that ends with it, in the shape of `x`; of several orders, along a
    ///     leading axis. NaN where there is none.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     `x` or `t` has the wrong shape, times do not go on, or samples are missing under ``nan_policy="raise"``. The
    ///     stream is as it was before.
    /// TypeError
    ///     `x` does not hold real numbers, or carries units.
    #[pyo3(signature = (x, t=None, *, return_std=false, return_support=false))]
    #[expect(clippy::doc_markdown, reason = "a docstring of Python")]
    fn push<'py>(
        slf: &Bound<'py, Self>,
        x: &Bound<'py, PyAny>,
        t: Option<&Bound<'py, PyAny>>,
        return_std: bool,
        return_support: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (py, this) = (slf.py(), slf.get());
        let time = t.and_then(number);
        if time.is_some() == t.is_some() && (t.is_none() || this.stamps) && !return_std && !return_support {
            if this.channels.is_none()
                && let Some(value) = number(x)
            {
                return if this.single {
                    this.sample(py, &[value as f32], time)
                } else {
                    this.sample(py, &[value], time)
                };
            }
            let done = if this.single { this.array::<f32>(x, time)? } else { this.array::<f64>(x, time)? };
            if let Some(done) = done {
                return Ok(done);
            }
        }
        slf.call_method1(intern!(py, "_push"), (x, t, return_std, return_support))
    }

    /// The results of a block: flat arrays of the stream's dtype.
    #[pyo3(signature = (x, t, estimate, std=None, support=None, *, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "the call's own parameters, by their own names")]
    fn _block(
        &self,
        py: Python<'_>,
        x: &Bound<'_, PyAny>,
        t: Option<PyReadonlyArray1<'_, f64>>,
        estimate: &Bound<'_, PyAny>,
        std: Option<&Bound<'_, PyAny>>,
        support: Option<PyReadwriteArray1<'_, i64>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let call = Block { x, t, estimate, std, support, progress };
        if self.single { self.block::<f32>(py, call) } else { self.block::<f64>(py, call) }
    }

    /// Estimates, standard deviations and support of the newest windows once more, as lists.
    fn _last(&self, py: Python<'_>) -> PyResult<Newest> {
        self.alone(py, |inner| each!(inner, stream => last(stream)))
    }

    /// All that the windows hold: the newest samples, flat, and their times; and how many came before and with them.
    fn _held(&self, py: Python<'_>) -> PyResult<(Vec<f64>, Vec<f64>, u64)> {
        self.alone(py, |inner| Ok(each!(inner, stream => held(stream))))
    }

    /// Goes on from what `_held` gave.
    #[expect(clippy::needless_pass_by_value, reason = "a Python list becomes a vector")]
    fn _restore(&self, py: Python<'_>, samples: Vec<f64>, times: Vec<f64>, count: u64) -> PyResult<()> {
        self.alone(py, |inner| each!(inner, stream => restore(stream, &samples, &times, count)))
    }

    /// Stops inside, as a defect would: how tests see what becomes of it.
    #[expect(clippy::panic, reason = "this is what it is for")]
    fn _fail_inside(&self, py: Python<'_>) -> PyResult<()> {
        self.alone(py, |_| panic!("asked to fail inside"))
    }

    /// Forget all samples.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.alone(py, |inner| {
            each!(inner, stream => stream.reset());
            Ok(())
        })
    }

    /// Samples pushed since the start or the last `reset`.
    #[getter]
    fn count(&self, py: Python<'_>) -> PyResult<u64> {
        self.alone(py, |inner| Ok(each!(inner, stream => stream.stream().count())))
    }

    /// Whether the longest window is full.
    #[getter]
    fn ready(&self, py: Python<'_>) -> PyResult<bool> {
        self.alone(py, |inner| Ok(each!(inner, stream => stream.stream().count() >= stream.stream().length() as u64)))
    }

    /// From the last estimate to the newest sample, and when that was taken if times were given; NaN if there is none.
    fn _placed(&self, py: Python<'_>) -> PyResult<(f64, Option<f64>)> {
        self.alone(py, |inner| Ok(each!(inner, stream => (stream.delay(), stream.times().last().copied()))))
    }
}

/// What becomes of a stream that panicked: what it holds may be half of a sample.
fn failed() -> Error {
    Error::argument("stream", "one that failed inside", "another one")
}

/// The types of NumPy's real numbers, once they are needed.
static TYPES: [PyOnceLock<Py<PyType>>; 2] = [PyOnceLock::new(), PyOnceLock::new()];

/// A plain real number of Python's or NumPy's.
fn number(value: &Bound<'_, PyAny>) -> Option<f64> {
    if let Ok(value) = value.cast::<PyFloat>() {
        return Some(value.value());
    }
    let known = value.cast_exact::<PyInt>().is_ok()
        || ["floating", "integer"].iter().zip(&TYPES).any(|(name, cell)| {
            let kind = cell.import(value.py(), "numpy", name);
            kind.and_then(|kind| value.is_instance(kind)).unwrap_or(false)
        });
    if known { value.extract().ok() } else { None }
}

fn last<T: Sample>(stream: &mut Fitted<T>) -> Result<Newest, Error> {
    let (channels, orders) = (stream.stream().channels(), stream.stream().orders());
    let mut estimate = vec![T::default(); orders * channels];
    let mut std = estimate.clone();
    let mut support = vec![0; stream.stream().designs() * channels];
    let results = Results { estimate: &mut estimate, std: Some(&mut std), support: Some(&mut support) };
    stream.last(results)?;
    let wide = |values: Vec<T>| values.into_iter().map(Sample::to_f64).collect();
    Ok((wide(estimate), wide(std), support))
}

fn held<T: Sample>(stream: &Fitted<T>) -> (Vec<f64>, Vec<f64>, u64) {
    let (inner, count) = (stream.stream(), stream.stream().count());
    let kept = usize::try_from(count).map_or(inner.length(), |count| count.min(inner.length()));
    let mut samples = vec![T::default(); kept * inner.channels()];
    inner.copy_newest(kept, &mut samples);
    (samples.into_iter().map(Sample::to_f64).collect(), stream.times().to_vec(), count)
}

fn restore<T: Sample>(stream: &mut Fitted<T>, samples: &[f64], times: &[f64], count: u64) -> Result<(), Error> {
    let samples: Vec<T> = samples.iter().map(|value| T::from_f64(*value)).collect();
    stream.restore(&samples, times, count)
}
