//! The boundary of [`algdiff_core::fits`].

use algdiff_core::engine::Sample;
use algdiff_core::fits::{Allowed, Fits as CoreFits, Noise, PerSample, Results};
use algdiff_core::gaps::Whole;
use algdiff_core::gaps::bulk::{Bulk, Found, Outputs, Wanted as BulkWanted};
use algdiff_core::irregular::{Span, Times, Wanted, Windows};
use algdiff_core::jacobi::Jacobi;
use algdiff_core::local::Model;
use algdiff_core::run::Layout;
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::{Array, Plan, enter, mode_of, unknown};

type Numbers<'py> = Option<PyReadonlyArray1<'py, f64>>;

/// Fits of their own for every estimate of a design.
#[pyclass(frozen, module = "algdiff._core")]
pub struct Fits {
    model: Model,
    whole: Whole,
    tau: f64,
    center: isize,
    delta: f64,
}

#[pymethods]
impl Fits {
    /// For `plans`, which share one window; the bias is judged by a fit of the degree `beyond`.
    #[new]
    #[expect(clippy::needless_pass_by_value, reason = "a Python list becomes a vector")]
    fn new(py: Python<'_>, plans: Vec<PyRef<'_, Plan>>, beyond: usize) -> PyResult<Self> {
        let Some(first) = plans.first().map(|plan| plan.0.as_ref()) else {
            return Err(unknown("plans", "none", "one or several"));
        };
        let design = *first.design();
        let orders = plans.iter().map(|plan| plan.0.design().deriv).collect();
        let whole = plans.iter().map(|plan| plan.0.fit_degree()).collect();
        let family = Jacobi { alpha: design.kappa, beta: design.mu };
        let model = Model { family, degree: design.degree, whole, beyond, orders };
        let (tau, center, kept) = (first.kernel().tau(), first.aligned_position(), first.kept());
        let whole = enter(py, None, |_| Whole::new(&model, design.window_length, kept))?;
        Ok(Self { model, whole, tau, center, delta: design.delta })
    }

    /// Runs the fits of the array `x` of the shape `layout`.
    #[pyo3(signature = (x, layout, estimate, std=None, bias=None, support=None, *, mode="fit", cval=0.0, least=None, t=None,
        duration=None, beyond=0.0, at=None, valid=false, listed=None, weights=None, level=None, autocovariance=None,
        omit=false, min_support=0, max_gain=(f64::INFINITY, f64::INFINITY), threads=0, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "the call's own parameters, by their own names")]
    #[expect(clippy::needless_pass_by_value, reason = "arrays of Python's are borrowed for the call")]
    fn run(
        &self,
        py: Python<'_>,
        x: &Bound<'_, PyAny>,
        layout: (usize, usize, usize),
        estimate: &Bound<'_, PyAny>,
        std: Option<&Bound<'_, PyAny>>,
        bias: Option<&Bound<'_, PyAny>>,
        support: Option<PyReadwriteArray1<'_, i64>>,
        mode: &str,
        cval: f64,
        least: Option<usize>,
        t: Numbers<'_>,
        duration: Option<f64>,
        beyond: f64,
        at: Numbers<'_>,
        valid: bool,
        listed: Option<PyReadonlyArray1<'_, i64>>,
        weights: Numbers<'_>,
        level: Numbers<'_>,
        autocovariance: Numbers<'_>,
        omit: bool,
        min_support: usize,
        max_gain: (f64, f64),
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let mode = mode_of(mode, cval)?;
        let layout = Layout { outer: layout.0, samples: layout.1, inner: layout.2 };
        let times = match &t {
            Some(t) => Times::Stamps { t: t.as_slice()?, duration: duration.map(|duration| Span { duration, beyond }) },
            None => Times::Even { delta: self.delta },
        };
        let wanted = match &at {
            Some(at) => Wanted::At(at.as_slice()?),
            None if valid => Wanted::Windows,
            None => Wanted::Samples,
        };
        let weights = weights.as_ref().map(|values| values.as_slice()).transpose()?;
        let level = level.as_ref().map(|values| values.as_slice()).transpose()?;
        let covariance = autocovariance.as_ref().map(|values| values.as_slice()).transpose()?;
        let each = |values: &'_ [f64]| values.len() != layout.samples;
        let noise = match (level, covariance) {
            (Some(level), _) if each(level) => Noise::Level(PerSample::Each(level)),
            (Some(level), _) => Noise::Level(PerSample::Shared(level)),
            (None, Some(covariance)) => Noise::Autocovariance(covariance),
            (None, None) => Noise::Unit,
        };
        let weights = weights.map(|own| if each(own) { PerSample::Each(own) } else { PerSample::Shared(own) });
        let samples = layout.samples;
        let (tau, center) = (self.tau, self.center);
        let windows = Windows { times, wanted, mode, least, samples, tau, center };
        let allowed = Allowed { missing: omit, support: min_support, gain: [max_gain.0, max_gain.1] };
        let listed = listed.as_ref().map(|listed| listed.as_slice()).transpose()?;
        let (model, whole) = (&self.model, &self.whole);
        let fits = CoreFits { model, whole, windows, listed, weights, noise, allowed, layout, threads };
        let call = Call { fits, estimate, std, bias, support, progress };
        if x.is_instance_of::<PyArray1<f64>>() { call.run::<f64>(py, x) } else { call.run::<f32>(py, x) }
    }

    /// Squares of the norms of the weights at positions in the whole window, where that should be or not.
    fn gains(&self, py: Python<'_>, positions: &Array<'_>, ideal: bool, out: &Array<'_>) -> PyResult<()> {
        let unit = 1.0 / (self.whole.window_length() as f64 * self.delta);
        let (positions, mut out) = (positions.try_readonly()?, out.try_readwrite()?);
        let (positions, out) = (positions.as_slice()?, out.as_slice_mut()?);
        enter(py, None, |_| {
            self.whole.gains(&self.model, positions, ideal, out)?;
            for (order, out) in self.model.orders.iter().zip(out.chunks_mut(positions.len().max(1))) {
                out.iter_mut().for_each(|gain| *gain *= unit.powi(2 * *order as i32));
            }
            Ok(())
        })
    }

    /// Replaces estimates that are NaN because of missing samples, as far as this can be done for many at once.
    #[pyo3(signature = (x, layout, estimate, std=None, support=None, *, valid=false, max_gain=f64::INFINITY, min_support=0, threads=0, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "the call's own parameters, by their own names")]
    fn refill(
        &self,
        py: Python<'_>,
        x: &Bound<'_, PyAny>,
        layout: (usize, usize, usize),
        estimate: &Bound<'_, PyAny>,
        std: Option<&Bound<'_, PyAny>>,
        support: Option<PyReadwriteArray1<'_, i64>>,
        valid: bool,
        max_gain: f64,
        min_support: usize,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let layout = Layout { outer: layout.0, samples: layout.1, inner: layout.2 };
        let (place, center) = if valid { (self.tau, 0) } else { (self.whole.place(self.center as f64), self.center) };
        let wanted = BulkWanted { limit: max_gain, support: min_support, std: std.is_some() };
        let bulk = enter(py, None, |_| Bulk::new(&self.model, &self.whole, place, center, self.delta, wanted))?;
        let Some(bulk) = bulk else { return Ok(()) };
        let count = if valid { (layout.samples + 1).saturating_sub(self.whole.span()) } else { layout.samples };
        let outputs = Outputs { layout, count, threads };
        let call = Refill { bulk, estimate, std, support, outputs, progress };
        if x.is_instance_of::<PyArray1<f64>>() { call.run::<f64>(py, x) } else { call.run::<f32>(py, x) }
    }
}

/// A call whose type of samples is not known yet.
struct Refill<'a, 'py> {
    bulk: Bulk<'a>,
    estimate: &'a Bound<'py, PyAny>,
    std: Option<&'a Bound<'py, PyAny>>,
    support: Option<PyReadwriteArray1<'py, i64>>,
    outputs: Outputs,
    progress: Option<Py<PyAny>>,
}

impl Refill<'_, '_> {
    fn run<T: Sample + Element>(mut self, py: Python<'_>, x: &Bound<'_, PyAny>) -> PyResult<()> {
        let x: PyReadonlyArray1<'_, T> = x.extract()?;
        let mut estimate: PyReadwriteArray1<'_, T> = self.estimate.extract()?;
        let mut std: Option<PyReadwriteArray1<'_, T>> = self.std.map(PyAnyMethods::extract).transpose()?;
        let found = Found {
            estimate: estimate.as_slice_mut()?,
            std: std.as_mut().map(|out| out.as_slice_mut()).transpose()?,
            support: self.support.as_mut().map(|out| out.as_slice_mut()).transpose()?,
        };
        let (x, bulk, outputs) = (x.as_slice()?, &self.bulk, self.outputs);
        enter(py, self.progress, |control| bulk.run(x, found, outputs, control))
    }
}

/// A call whose type of samples is not known yet.
struct Call<'a, 'py> {
    fits: CoreFits<'a>,
    estimate: &'a Bound<'py, PyAny>,
    std: Option<&'a Bound<'py, PyAny>>,
    bias: Option<&'a Bound<'py, PyAny>>,
    support: Option<PyReadwriteArray1<'py, i64>>,
    progress: Option<Py<PyAny>>,
}

impl Call<'_, '_> {
    fn run<T: Sample + Element>(self, py: Python<'_>, x: &Bound<'_, PyAny>) -> PyResult<()> {
        let x: PyReadonlyArray1<'_, T> = x.extract()?;
        let mut estimate: PyReadwriteArray1<'_, T> = self.estimate.extract()?;
        let mut std: Option<PyReadwriteArray1<'_, T>> = self.std.map(PyAnyMethods::extract).transpose()?;
        let mut bias: Option<PyReadwriteArray1<'_, T>> = self.bias.map(PyAnyMethods::extract).transpose()?;
        let mut support = self.support;
        let results = Results {
            estimate: estimate.as_slice_mut()?,
            std: std.as_mut().map(|out| out.as_slice_mut()).transpose()?,
            bias: bias.as_mut().map(|out| out.as_slice_mut()).transpose()?,
            support: support.as_mut().map(|out| out.as_slice_mut()).transpose()?,
        };
        let (x, fits) = (x.as_slice()?, self.fits);
        enter(py, self.progress, |control| fits.run(x, results, control))
    }
}
