//! The plain sums of weights and samples, and how far rounding may take an engine from them: the bounds of `tests/engines.py`,
//! which says where they come from.

use algdiff_core::engine::{Engine, Sample};
use algdiff_core::plan::Plan;

use crate::numbers::{dot, two_sum};

/// The sizes of the sums of the first weights, of one more each time.
fn running<'a>(weights: impl Iterator<Item = &'a f64>) -> impl Iterator<Item = f64> {
    weights.scan(0.0, |sum: &mut f64, w| {
        *sum += w;
        Some(sum.abs())
    })
}

/// One order on one signal.
pub struct Sums<'a> {
    plan: &'a Plan,
    engine: Engine,
    x: Vec<f64>,
    /// Of the type of the samples: its rounding, and its smallest number.
    eps: f64,
    tiny: f64,
    /// The sample from which differences count.
    middle: usize,
    sum: f64,
    largest: f64,
    norm: f64,
}

impl<'a> Sums<'a> {
    /// Prepares the plain sums of `x`.
    pub fn new<T: Sample>(plan: &'a Plan, engine: Engine, x: &[T]) -> Self {
        let single = size_of::<T>() == 4;
        let (eps, tiny) = if single { (f64::from(f32::EPSILON), 1.5e-45) } else { (f64::EPSILON, 5e-324) };
        let (taps, weights) = (plan.taps(), plan.weights());
        let middle = taps.anchor().unwrap_or(weights.len() / 2);
        // Moments sum smoothers from the newest sample.
        let from = if engine == Engine::Moments && taps.anchor().is_some() { weights.len() - 1 } else { middle };
        let sizes: Vec<f64> = if taps.meet_differences() {
            running(weights[..from].iter()).chain(running(weights[from + 1..].iter().rev())).collect()
        } else {
            weights.iter().map(|w| w.abs()).collect()
        };
        Self {
            plan,
            engine,
            x: x.iter().map(|value| value.to_f64()).collect(),
            eps,
            tiny,
            middle,
            sum: sizes.iter().sum(),
            largest: sizes.iter().fold(0.0, |most: f64, w| most.max(*w)),
            norm: sizes.iter().map(|w| w * w).sum::<f64>().sqrt(),
        }
    }

    /// Holds the output of the window that starts at `place` to its bound; to not being finite, where a sample is not.
    pub fn check<T: Sample>(&self, place: usize, got: T) {
        let (window, got) = (&self.x[place..place + self.plan.span()], got.to_f64());
        let about = || format!("{:?} {place}: {got} {:?}", self.engine, self.plan.design());
        if !window.iter().all(|value| value.is_finite()) {
            assert!(!got.is_finite(), "{}", about());
            return;
        }
        let (expected, allowed) = (self.expected(window), self.allowed(window));
        let largest = if size_of::<T>() == 4 { f64::from(f32::MAX) } else { f64::MAX };
        if expected.abs() + allowed < 0.5 * largest {
            assert!((got - expected).abs() <= allowed, "{}: {expected} {allowed}", about());
        }
    }

    fn expected(&self, window: &[f64]) -> f64 {
        let weights = self.plan.weights();
        if !self.plan.taps().meet_differences() {
            return dot(weights.iter().copied().zip(window.iter().copied()));
        }
        let origin = window[self.middle];
        let differences = weights.iter().zip(window).flat_map(|(w, value)| {
            let (difference, rest) = two_sum(*value, -origin);
            [(*w, difference), (*w, rest)]
        });
        dot(differences) + if self.plan.taps().anchor().is_some() { origin } else { 0.0 }
    }

    fn allowed(&self, window: &[f64]) -> f64 {
        let (length, design) = (window.len() as f64, self.plan.design());
        let most = |values: &[f64]| -> f64 {
            let sizes = |m: f64, v: f64| if v.is_finite() { m.max(v.abs()) } else { m };
            if self.plan.taps().meet_differences() {
                values.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, sizes)
            } else {
                values.iter().copied().fold(0.0, sizes)
            }
        };
        let top = most(window);
        let mut bound = (length + 8.0) * self.eps * self.sum * top;
        let mut lost = (length + 8.0) * self.tiny * (2.0 * self.largest).max(1.0);
        match self.engine {
            Engine::Direct => {}
            Engine::Moments => {
                let terms = 192.0 + 16.0 * (design.degree as f64 + design.kappa + design.mu + 2.0).powi(2);
                bound = (self.eps * terms * self.sum + 1e-14 * length * self.largest) * top;
                lost *= 64.0;
            }
            Engine::Fft => {
                let points = (16.0 * length).log2().ceil().exp2().max(16384.0);
                let counted = if self.tiny == 5e-324 { 1024.0 } else { 32.0 };
                let near = (counted * top).min(most(&self.x));
                bound += 8.0 * self.eps * points.log2() * points.sqrt() * self.norm * near;
                lost *= points;
            }
        }
        if self.plan.taps().anchor().is_some() {
            bound += 4.0 * self.eps * window.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        }
        bound + lost
    }
}
