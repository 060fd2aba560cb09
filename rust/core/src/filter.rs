//! What the weights of a plan do to signals: their frequency response, their bias, and how far they are from the kernel
//! that they discretise.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use nalgebra::Complex;

use crate::control::Control;
use crate::error::Error;
use crate::plan::Plan;
use crate::response::{Response, bisect};
use crate::rule::Rule;

/// Lobes of the response of which an integral over frequencies sees every detail.
const LOBES: f64 = 128.0;

/// Beyond this many times the sampling rate, where the weights' response only repeats itself, it is compared with nothing.
const MAX_RATES: f64 = 1000.0;

impl Plan {
    /// The frequency response at every `frequency`, in cycles per unit of time, into `out`; the phase reference is the estimate.
    pub fn frequency_response(
        &self,
        frequency: &[f64],
        out: &mut [Complex<f64>],
        control: &impl Control,
    ) -> Result<(), Error> {
        for (value, &frequency) in out.iter_mut().zip(frequency) {
            if !frequency.is_finite() {
                return Err(Error::argument("frequency", frequency, "finite"));
            }
            control.check(0.0)?;
            *value = self.response(frequency);
        }
        Ok(())
    }

    fn response(&self, frequency: f64) -> Complex<f64> {
        self.taps().response(frequency * self.design().delta, self.position())
    }

    /// The smallest frequency at which the response, relative to that of the derivative, falls through `1 / sqrt(2)`.
    pub fn half_power(&self, control: &impl Control) -> Result<Option<f64>, Error> {
        let power = self.design().deriv as i32;
        let beyond = |frequency: f64| self.response(frequency).norm() < FRAC_1_SQRT_2 * (TAU * frequency).powi(power);
        let (step, nyquist) = (self.kernel().detail() / TAU / self.duration(), 0.5 / self.design().delta);
        let mut low = 0.0;
        while low < nyquist {
            control.check(0.0)?;
            let high = nyquist.min(low + step);
            if beyond(high) {
                return Ok(Some(bisect(low, high, beyond)));
            }
            low = high;
        }
        Ok(None)
    }

    /// The relative root-mean-square difference between the response and that of the continuous kernel, over frequencies
    /// from 0 to `largest`.
    pub fn discretisation_error(&self, largest: f64, control: &impl Control) -> Result<f64, Error> {
        if !(largest > 0.0 && largest <= MAX_RATES / self.design().delta) {
            let allowed = format!("positive and at most {MAX_RATES} sampling rates");
            return Err(Error::argument("frequency", largest, allowed));
        }
        let kernel = Response::new(self.kernel(), TAU * largest * self.duration());
        let (mut different, mut whole) = (0.0, 0.0);
        let mut before: Option<(f64, f64, f64)> = None;
        for frequency in self.frequencies(largest) {
            control.check(0.0)?;
            let wanted = kernel.at(TAU * frequency * self.duration(), self.kernel().tau()) * self.unit();
            let (distance, size) = ((self.response(frequency) - wanted).norm_sqr(), wanted.norm_sqr());
            if let Some((lower, last_distance, last_size)) = before {
                let step = frequency - lower;
                different += step * (distance + last_distance);
                whole += step * (size + last_size);
            }
            before = Some((frequency, distance, size));
        }
        Ok((different / whole).sqrt())
    }

    /// Frequencies for an integral from 0 to `largest`: sixteen to a lobe of the response for the first 128 lobes, and from
    /// there on as many for every octave as for the one before, fewer for windows of very many samples.
    fn frequencies(&self, largest: f64) -> impl Iterator<Item = f64> + use<> {
        let first = largest.min(LOBES / self.duration());
        // In this order: steps may be so small that sixteen frequencies are infinite.
        let dense = (16.0 * (first * self.duration())).ceil().max(256.0);
        let octaves = (largest / first).log2();
        let per_octave = (2e8 / self.span() as f64).clamp(64.0, 16.0 * LOBES);
        let sparse = (octaves * per_octave).ceil();
        let uniform = (0..=dense as usize).map(move |index| first * (index as f64 / dense));
        uniform.chain((1..=sparse as usize).map(move |index| first * (octaves * (index as f64 / sparse)).exp2()))
    }

    /// The first degree that is not reproduced.
    fn first_missed(&self) -> usize {
        self.exactness().map_or(0, |exactness| exactness + 1)
    }

    /// `c` of the leading error `c x^(m)` of the estimate, with `m` the first degree that is not reproduced.
    ///
    /// With the monic `pi_m = p_m B_1 ... B_m` the error on `pi_m` is the one on `t^m`, since lower degrees are reproduced,
    /// and `pi_m^(m) = m!`.
    pub fn bias_constant(&self, control: &impl Control) -> Result<f64, Error> {
        let order = self.first_missed();
        let deriv = self.design().deriv;
        let family = self.kernel().family();
        let recurrence = family.recurrence(order);
        let mut sum = 0.0;
        for (j, weight) in self.weights().iter().enumerate() {
            if j % 4096 == 4095 {
                control.check(0.0)?;
            }
            sum += weight * recurrence.values(self.tau_at(j as f64)).last().copied().unwrap_or(1.0);
        }
        let wanted = family.derivatives(order, deriv, self.kernel().tau()).last().copied().unwrap_or(0.0) * self.unit();
        let monic_over_factorial: f64 =
            recurrence.off_diagonal().iter().enumerate().map(|(k, b)| b / (k + 1) as f64 * self.duration()).product();
        Ok((sum - wanted) * monic_over_factorial)
    }

    /// `B` in `|error| <= B sup |x^(m)|` with `m` as in [`Plan::bias_constant`], the supremum taken over the window and the estimate.
    ///
    /// By Taylor's theorem at the estimate B is at most `sum |w_j| |t_j - t|^m / m!`. The derivative of a fitted polynomial of
    /// degree m - 1 moreover meets that of the signal at p = m - deriv points of the window, so that the error is
    /// `x^(m) / p!` times p distances. Infinite where a derivative below `deriv` leaks.
    pub fn bias_bound(&self) -> f64 {
        let order = self.first_missed();
        let deriv = self.design().deriv;
        if order < deriv {
            return f64::INFINITY;
        }
        let (position, delta) = (self.position(), self.design().delta);
        let over_factorial = |distance: f64, power: usize| (1..=power).map(|k| distance / k as f64).product::<f64>();
        let taylor = self
            .weights()
            .iter()
            .enumerate()
            // A sample without a weight counts for nothing, however large its power is.
            .filter(|(_, w)| **w != 0.0)
            .map(|(j, w)| w.abs() * over_factorial((j as f64 - position).abs() * delta, order))
            .sum::<f64>();
        if order == deriv {
            // The mean of the derivative itself is wrong, and the bound has to cover both.
            return taylor + 1.0;
        }
        if self.design().rule != Rule::Exact || self.fit_degree() + 1 != order {
            return taylor;
        }
        let farther = position.abs().max(((self.span() - 1) as f64 - position).abs());
        taylor.min(over_factorial(farther * delta, order - deriv))
    }

    /// The delay at low frequencies in samples, from the first moment beyond those that define the estimate.
    #[must_use]
    pub fn moment_delay(&self) -> f64 {
        let (deriv, span) = (self.design().deriv, self.span() as f64);
        let moment = |power: usize| -> f64 {
            let place = |j: usize| (j as f64 - self.position()) / span;
            self.weights().iter().enumerate().map(|(j, w)| w * place(j).powi(power as i32)).sum()
        };
        // Of the pulse whose derivative of order `deriv` the weights are: its mass and its first moment about the estimate.
        let (mass, first) = (moment(deriv), moment(deriv + 1) / (deriv + 1) as f64);
        span - 1.0 - self.position() - span * first / mass
    }
}
