//! The Python boundary: borrow, detach from the interpreter, call, map errors. No idea lives here.

mod fits;
mod stream;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};

use algdiff_core::analysis::{Conditions, Tradeoff};
use algdiff_core::bank::Bank as CoreBank;
use algdiff_core::control::Control;
use algdiff_core::design::{Design, Place};
use algdiff_core::engine::{ENGINES, Sample, choice};
use algdiff_core::error::Error;
use algdiff_core::kernel::{Kernel as CoreKernel, Tau};
use algdiff_core::paper;
use algdiff_core::plan::Plan as CorePlan;
use algdiff_core::rule::RULES;
use algdiff_core::run::{Alignment, Job, Layout, Mode, Part};
use numpy::{Complex64, Element, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray1};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;

pyo3::create_exception!(algdiff._core, InternalError, PyRuntimeError, "A defect of algdiff itself: please report it.");

/// Listens for Ctrl-C, and hands on how far a run is.
struct Attended {
    progress: Option<Py<PyAny>>,
    raised: Mutex<Option<PyErr>>,
}

impl Attended {
    fn new(progress: Option<Py<PyAny>>) -> Self {
        Self { progress, raised: Mutex::new(None) }
    }
}

impl Control for Attended {
    fn proceed(&self, fraction: f64) -> bool {
        let heard = Python::attach(|py| {
            py.check_signals()?;
            self.progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (fraction,)).map(drop))
        });
        let Err(error) = heard else { return true };
        if let Ok(mut raised) = self.raised.lock() {
            *raised = Some(error);
        }
        false
    }
}

/// The one way into the core: without the interpreter, every failure an exception.
fn enter<T: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    call: impl FnOnce(&Attended) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let attended = Attended::new(progress);
    let outcome = py.detach(|| catch_unwind(AssertUnwindSafe(|| call(&attended))));
    match outcome {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(Error::Interrupted)) => {
            let raised = attended.raised.into_inner().ok().flatten();
            Err(raised.unwrap_or_else(|| PyRuntimeError::new_err("interrupted")))
        }
        Ok(Err(error)) => Err(raised(error)),
        Err(_) => Err(InternalError::new_err("algdiff failed inside; please report what you called")),
    }
}

/// The exception of an error.
#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn raised(error: Error) -> PyErr {
    match error {
        Error::Memory { .. } => PyMemoryError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// A one-dimensional array of Python's.
type Array<'a, T = f64> = Bound<'a, PyArray1<T>>;

/// The way in for a function of points that fills an array.
fn enter_with<T: Element + Send>(
    points: &Array<'_>,
    out: &Array<'_, T>,
    call: impl FnOnce(&[f64], &mut [T], &Attended) -> Result<(), Error> + Send,
) -> PyResult<()> {
    let py = points.py();
    let (points, mut out) = (points.try_readonly()?, out.try_readwrite()?);
    let (points, out) = (points.as_slice()?, out.as_slice_mut()?);
    enter(py, None, |control| call(points, out, control))
}

/// `tau` as a word or a number.
#[derive(FromPyObject)]
enum Point {
    Number(f64),
    Word(String),
}

impl Point {
    fn tau(self) -> PyResult<Tau> {
        match self {
            Self::Number(number) => Ok(Tau::At(number)),
            Self::Word(word) => match word.as_str() {
                "center" => Ok(Tau::Center),
                "root" => Ok(Tau::Root),
                "newest" => Ok(Tau::Newest),
                _ => Err(unknown("tau", &word, "'center', 'root', 'newest' or a number")),
            },
        }
    }
}

fn unknown(name: &'static str, got: &str, allowed: &str) -> PyErr {
    PyValueError::new_err(format!("{name} must be {allowed}, got '{got}'"))
}

/// A continuous kernel.
#[pyclass(frozen, module = "algdiff._core")]
struct Kernel(CoreKernel);

#[pymethods]
impl Kernel {
    #[new]
    fn new(deriv: usize, degree: usize, kappa: f64, mu: f64, tau: Point, py: Python<'_>) -> PyResult<Self> {
        let tau = tau.tau()?;
        enter(py, None, |_| CoreKernel::new(deriv, degree, kappa, mu, tau, 1.0)).map(Self)
    }

    #[getter]
    fn tau(&self) -> f64 {
        self.0.tau()
    }

    #[getter]
    fn exactness(&self) -> usize {
        self.0.exactness()
    }

    #[getter]
    fn bias(&self) -> (usize, f64) {
        self.0.bias()
    }

    #[getter]
    fn norm2(&self) -> f64 {
        self.0.norm2()
    }

    fn roots<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.0.roots())
    }

    fn values(&self, points: &Array<'_>, out: &Array<'_>) -> PyResult<()> {
        enter_with(points, out, |points, out, control| self.0.values(points, out, control))
    }

    fn frequency_response(&self, omega: &Array<'_>, reference: f64, out: &Array<'_, Complex64>) -> PyResult<()> {
        enter_with(omega, out, |omega, out, control| self.0.frequency_response(omega, reference, out, control))
    }

    fn step_response(&self, times: &Array<'_>, out: &Array<'_>) -> PyResult<()> {
        enter_with(times, out, |times, out, control| self.0.step_response(times, out, control))
    }

    #[getter]
    fn ln_asymptotes(&self) -> (f64, f64) {
        self.0.ln_asymptotes()
    }

    #[getter]
    fn roll_off(&self) -> f64 {
        self.0.roll_off()
    }

    #[getter]
    fn cutoff(&self) -> Option<f64> {
        self.0.cutoff()
    }

    fn half_power(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        enter(py, None, |control| self.0.half_power(control))
    }

    fn norm1(&self, py: Python<'_>) -> PyResult<f64> {
        enter(py, None, |_| Ok(self.0.norm1()))
    }

    #[getter]
    fn bias_bound(&self) -> f64 {
        self.0.bias_bound()
    }

    #[getter]
    fn moment_delay(&self) -> f64 {
        self.0.moment_delay()
    }

    fn optimal_duration(
        &self,
        py: Python<'_>,
        noise_level: f64,
        derivative_bound: f64,
        delta: f64,
        bounded: bool,
    ) -> PyResult<f64> {
        let conditions = Conditions { noise_level, derivative_bound, delta };
        enter(py, None, |_| {
            if bounded { self.0.optimal_duration_bounded(&conditions) } else { self.0.optimal_duration(&conditions) }
        })
    }

    fn rmse(
        &self,
        py: Python<'_>,
        duration: f64,
        noise_level: f64,
        derivative_bound: f64,
        delta: f64,
    ) -> PyResult<f64> {
        enter(py, None, |_| self.0.rmse(duration, &Conditions { noise_level, derivative_bound, delta }))
    }
}

/// The least error and its window, for every delay.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the estimator's and the signal's own parameters, by their own names")]
#[expect(clippy::needless_pass_by_value, reason = "a Python list becomes a vector")]
fn delay_tradeoff(
    py: Python<'_>,
    delays: Vec<f64>,
    deriv: usize,
    degree: usize,
    kappa: f64,
    mu: f64,
    noise_level: f64,
    amplitude: f64,
    bandwidth: f64,
    delta: f64,
) -> PyResult<Vec<(f64, f64)>> {
    let exponents = (kappa, mu);
    let tradeoff = Tradeoff { deriv, degree, exponents, noise_level, amplitude, frequency: bandwidth, delta };
    enter(py, None, |control| {
        let best = |delay: &f64| if control.proceed(0.0) { tradeoff.best(*delay) } else { Err(Error::Interrupted) };
        delays.iter().map(best).collect()
    })
}

/// A frozen design.
#[pyclass(frozen, module = "algdiff._core")]
struct Plan(Arc<CorePlan>);

#[pymethods]
impl Plan {
    #[new]
    #[pyo3(signature = (window_length, deriv, degree, kappa, mu, delta, rule, trim=0.0, *, tau=None, delay=None, position=None))]
    #[expect(clippy::too_many_arguments, reason = "the design's own parameters, by their own names")]
    fn new(
        py: Python<'_>,
        window_length: usize,
        deriv: usize,
        degree: usize,
        kappa: f64,
        mu: f64,
        delta: f64,
        rule: &str,
        trim: f64,
        tau: Option<Point>,
        delay: Option<f64>,
        position: Option<f64>,
    ) -> PyResult<Self> {
        let place = match (tau, delay, position) {
            (Some(point), None, None) => Place::Tau(point.tau()?),
            (None, Some(delay), None) => Place::Delay(delay),
            (None, None, Some(position)) => Place::Position(position),
            _ => return Err(PyTypeError::new_err("give one of tau, delay and position")),
        };
        let Some(&(_, rule)) = RULES.iter().find(|(word, _)| *word == rule) else {
            return Err(unknown("rule", rule, "'exact', 'trapezoid', 'midpoint', 'simpson', 'cell' or 'hat'"));
        };
        let design = Design { window_length, deriv, degree, kappa, mu, place, delta, rule, trim };
        enter(py, None, |control| CorePlan::new(&design, control)).map(|plan| Self(Arc::new(plan)))
    }

    #[getter]
    fn tau(&self) -> f64 {
        self.0.kernel().tau()
    }

    #[getter]
    fn delay_samples(&self) -> f64 {
        self.0.delay_samples()
    }

    #[getter]
    fn aligned_position(&self) -> isize {
        self.0.aligned_position()
    }

    #[getter]
    fn exactness(&self) -> Option<usize> {
        self.0.exactness()
    }

    #[getter]
    fn keeps_constants(&self) -> bool {
        self.0.keeps_constants()
    }

    #[getter]
    fn span(&self) -> usize {
        self.0.span()
    }

    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    fn frequency_response(&self, frequency: &Array<'_>, out: &Array<'_, Complex64>) -> PyResult<()> {
        enter_with(frequency, out, |frequency, out, control| self.0.frequency_response(frequency, out, control))
    }

    fn half_power(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        enter(py, None, |control| self.0.half_power(control))
    }

    fn discretisation_error(&self, py: Python<'_>, frequency: f64) -> PyResult<f64> {
        enter(py, None, |control| self.0.discretisation_error(frequency, control))
    }

    fn bias_constant(&self, py: Python<'_>) -> PyResult<f64> {
        enter(py, None, |control| self.0.bias_constant(control))
    }

    #[getter]
    fn bias_bound(&self) -> f64 {
        self.0.bias_bound()
    }

    #[getter]
    fn moment_delay(&self) -> f64 {
        self.0.moment_delay()
    }

    /// What the engines apply: taps, their scale, whether they are on first differences, and the sample that is added.
    fn taps<'py>(&self, py: Python<'py>, single: bool) -> (Bound<'py, PyAny>, f64, bool, Option<usize>) {
        let taps = self.0.taps();
        let values = if single {
            PyArray1::from_slice(py, f32::taps(taps)).into_any()
        } else {
            PyArray1::from_slice(py, f64::taps(taps)).into_any()
        };
        (values, taps.scale(), taps.meet_differences(), taps.anchor())
    }

    fn weights(&self, out: &Bound<'_, PyArray1<f64>>) -> PyResult<()> {
        let mut out = out.try_readwrite()?;
        let (weights, out) = (self.0.weights(), out.as_slice_mut()?);
        if weights.len() != out.len() {
            return Err(PyValueError::new_err("out must have as many elements as there are weights"));
        }
        out.copy_from_slice(weights);
        Ok(())
    }
}

/// Orders that run in one pass.
#[pyclass(frozen, module = "algdiff._core")]
struct Bank(Arc<CoreBank>);

#[pymethods]
impl Bank {
    #[new]
    #[pyo3(signature = (plans, engine="auto"))]
    #[expect(clippy::needless_pass_by_value, reason = "a Python list becomes a vector")]
    fn new(py: Python<'_>, plans: Vec<PyRef<'_, Plan>>, engine: &str) -> PyResult<Self> {
        let known = ENGINES.iter().find(|(word, _)| *word == engine).map(|&(_, engine)| engine);
        if known.is_none() && engine != "auto" {
            return Err(unknown("engine", engine, "'auto', 'direct', 'moments' or 'fft'"));
        }
        let plans = plans.iter().map(|plan| Arc::clone(&plan.0)).collect();
        enter(py, None, |_| CoreBank::new(plans, known)).map(|bank| Self(Arc::new(bank)))
    }

    /// The name of the engine, for single or double precision.
    fn engine(&self, py: Python<'_>, single: bool) -> PyResult<&'static str> {
        let engine = enter(py, None, |_| if single { self.0.engine::<f32>() } else { self.0.engine::<f64>() })?;
        Ok(ENGINES.iter().find(|(_, known)| *known == engine).map_or("", |(word, _)| word))
    }

    /// Cuts between windows that start at multiples of this change no bit of the outputs.
    fn grid(&self, single: bool) -> usize {
        if single { self.0.grid::<f32>() } else { self.0.grid::<f64>() }
    }

    #[pyo3(signature = (x, out, layout, mode, cval=0.0, *, half_sample=false, aligned=false, part=None, threads=0, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "the call's own parameters, by their own names")]
    fn run(
        &self,
        py: Python<'_>,
        x: &Bound<'_, PyAny>,
        out: &Bound<'_, PyAny>,
        layout: (usize, usize, usize),
        mode: &str,
        cval: f64,
        half_sample: bool,
        aligned: bool,
        part: Option<(usize, usize, usize)>,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let mode = mode_of(mode, cval)?;
        let alignment = if half_sample { Alignment::HalfSample } else { Alignment::Sample };
        let (outer, samples, inner) = layout;
        // How many outputs are wanted follows from the size of out.
        let part = part.map(|(start, samples, first)| Part { start, samples, first, outputs: 0 });
        let layout = Layout { outer, samples, inner };
        let job = Job { bank: &self.0, mode, alignment, aligned, layout, part, threads };
        if x.is_instance_of::<PyArray1<f64>>() {
            run::<f64>(py, job, x, out, progress)
        } else {
            run::<f32>(py, job, x, out, progress)
        }
    }
}

/// The mode by its public name.
fn mode_of(mode: &str, cval: f64) -> PyResult<Mode> {
    Ok(match mode {
        "fit" => Mode::Fit,
        "valid" => Mode::Valid,
        "nan" => Mode::Nan,
        "nearest" => Mode::Nearest,
        "mirror" => Mode::Mirror,
        "wrap" => Mode::Wrap,
        "constant" => Mode::Constant(cval),
        _ => return Err(unknown("mode", mode, "'fit', 'valid', 'nan', 'nearest', 'mirror', 'wrap' or 'constant'")),
    })
}

fn run<T: Sample + Element>(
    py: Python<'_>,
    mut job: Job<'_>,
    x: &Bound<'_, PyAny>,
    out: &Bound<'_, PyAny>,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let x: PyReadonlyArray1<'_, T> = x.extract()?;
    let mut out: PyReadwriteArray1<'_, T> = out.extract()?;
    let (x, out) = (x.as_slice()?, out.as_slice_mut()?);
    if let Some(part) = &mut job.part {
        let rows = job.layout.outer.saturating_mul(job.layout.inner).saturating_mul(job.bank.plans().len());
        part.outputs = out.len() / rows.max(1);
    }
    enter(py, progress, |control| job.run(x, out, control))
}

/// The system of the simultaneous estimators.
#[pyclass(frozen, module = "algdiff._core")]
struct Simultaneous(paper::Simultaneous);

#[pymethods]
impl Simultaneous {
    #[new]
    fn new(degree: usize, nu: usize, duration: f64, py: Python<'_>) -> PyResult<Self> {
        enter(py, None, |_| paper::Simultaneous::new(degree, nu, duration)).map(Self)
    }

    fn matrix<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let matrix = self.0.matrix();
        PyArray1::from_iter(py, matrix.row_iter().flat_map(|row| row.iter().copied()))
    }

    fn right_side(&self, points: &Array<'_>, out: &Array<'_>) -> PyResult<()> {
        enter_with(points, out, |points, out, control| self.0.right_side(points, out, control))
    }

    fn condition_number(&self, py: Python<'_>) -> PyResult<f64> {
        enter(py, None, |_| self.0.condition_number())
    }
}

#[pyfunction]
fn lambdas(deriv: usize, degree: usize, exponents: (f64, f64), points: &Array<'_>, out: &Array<'_>) -> PyResult<()> {
    enter_with(points, out, |points, out, _| paper::lambdas(deriv, degree, exponents, points, out))
}

/// Stops inside, as a defect would: how tests see what becomes of it.
#[pyfunction]
#[expect(clippy::panic, reason = "this is what it is for")]
fn fail_inside(py: Python<'_>) -> PyResult<()> {
    enter(py, None, |_| panic!("asked to fail inside"))
}

#[pyfunction]
fn registers() -> (usize, bool) {
    choice::registers()
}

/// The module `algdiff._core`.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::fits::Fits;
    #[pymodule_export]
    use super::stream::Stream;
    #[pymodule_export]
    use super::{Bank, InternalError, Kernel, Plan, Simultaneous, delay_tradeoff, fail_inside, lambdas, registers};
}
