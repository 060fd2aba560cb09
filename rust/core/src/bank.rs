//! One or several orders at one point of one window, and the engine that runs them.

#![expect(clippy::indexing_slicing, reason = "a bank is never without a plan")]

use std::sync::{Arc, OnceLock};

use crate::control::Control;
use crate::engine::{Engine, Runner, Sample, Taps};
use crate::error::Error;
use crate::plan::Plan;

/// Plans that share window and point of estimation, so that they run in one pass and with one delay.
#[derive(Debug)]
pub struct Bank {
    plans: Vec<Arc<Plan>>,
    wanted: Option<Engine>,
    at_tau: Runners,
    aligned: Runners,
}

/// The prepared engine, for every type of samples that it was asked for.
#[derive(Debug, Default)]
pub struct Runners {
    pub(crate) double: OnceLock<Runner<f64>>,
    pub(crate) single: OnceLock<Runner<f32>>,
}

impl Bank {
    /// A bank of `plans`, run by `engine` or else by the one that is likely to be the fastest.
    pub fn new(plans: Vec<Arc<Plan>>, engine: Option<Engine>) -> Result<Self, Error> {
        let Some(first) = plans.first() else {
            return Err(Error::argument("deriv", "none", "one order or several"));
        };
        let same = |plan: &Arc<Plan>| plan.span() == first.span() && plan.position() == first.position();
        if !plans.iter().all(same) {
            return Err(Error::argument("tau", first.kernel().tau(), "the same point for all orders"));
        }
        let bank = Self { plans, wanted: engine, at_tau: Runners::default(), aligned: Runners::default() };
        if engine == Some(Engine::Moments) {
            // The one engine that may refuse: now rather than at the first call.
            bank.at_tau::<f64>()?;
        }
        Ok(bank)
    }

    /// The plans, one for every order.
    #[must_use]
    pub fn plans(&self) -> &[Arc<Plan>] {
        &self.plans
    }

    /// The plan of the first order: what it says of the window and of its point holds for all.
    #[must_use]
    pub fn first(&self) -> &Plan {
        &self.plans[0]
    }

    /// The engine for this type of samples.
    pub fn engine<T: Sample>(&self) -> Result<Engine, Error> {
        self.wanted.map_or_else(|| self.at_tau::<T>().map(Runner::engine), Ok)
    }

    /// Cuts between windows that start at multiples of this change no bit of the outputs.
    #[must_use]
    pub fn grid<T: Sample>(&self) -> usize {
        self.at_tau::<T>().map_or(1, Runner::grid)
    }

    /// The prepared engine of the estimates at `tau`.
    pub fn at_tau<T: Sample>(&self) -> Result<&Runner<T>, Error> {
        self.prepared(&self.at_tau, |plan| Ok(plan.taps()))
    }

    /// The prepared engine of the estimates on the sample [`Plan::aligned_position`].
    pub fn aligned<T: Sample>(&self, control: &impl Control) -> Result<&Runner<T>, Error> {
        let first = self.first();
        if std::ptr::eq(first.aligned_taps(control)?, first.taps()) {
            return self.at_tau();
        }
        self.prepared(&self.aligned, |plan| plan.aligned_taps(control))
    }

    fn prepared<'a, T: Sample>(
        &'a self,
        runners: &'a Runners,
        taps: impl Fn(&'a Plan) -> Result<&'a Taps, Error>,
    ) -> Result<&'a Runner<T>, Error> {
        let slot = T::runner(runners);
        if let Some(runner) = slot.get() {
            return Ok(runner);
        }
        let orders: Vec<&Taps> = self.plans.iter().map(|plan| taps(plan)).collect::<Result<_, Error>>()?;
        let runner = match self.wanted {
            Some(engine) => Runner::new(engine, &orders)?,
            None => Runner::fastest(&orders)?,
        };
        Ok(slot.get_or_init(|| runner))
    }
}
