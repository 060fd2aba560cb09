//! What a continuous kernel does in time: its integral, its gains, its bias, and the window that balances them.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use nalgebra::Complex;

use crate::control::Control;
use crate::design::MAX_WINDOW;
use crate::error::Error;
use crate::kernel::{Kernel, Tau};
use crate::quadrature::{cumulative_density, nodes};
use crate::response::{Response, bisect};

/// White or bounded noise, and what is known of the signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// Standard deviation of white noise, or the bound of a disturbance of any shape.
    pub noise_level: f64,
    /// The largest size of the derivative of order `deriv + p` of the signal, `p` being the kernel's order of bias.
    pub derivative_bound: f64,
    /// Sampling step.
    pub delta: f64,
}

impl Conditions {
    fn check(&self) -> Result<(), Error> {
        for (name, value) in
            [("noise_level", self.noise_level), ("derivative_bound", self.derivative_bound), ("delta", self.delta)]
        {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::argument(name, value, "finite and positive"));
            }
        }
        Ok(())
    }
}

impl Kernel {
    /// The integral of the kernel from 0 to `s`.
    ///
    /// A kernel of order n >= 1 is the derivative of minus the one of order n - 1 with both exponents raised by one. For
    /// n = 0 the first term of `rho sum p_m(tau) p_m` is the integral of the density, and the others follow from
    /// `integral of rho p_m = -rho^+ p^+_(m-1) / c_m`, `+` being the raised family and `p_m' = c_m p^+_(m-1)`.
    #[must_use]
    pub fn integral(&self, s: f64) -> f64 {
        if s.is_nan() {
            return s;
        }
        if s <= 0.0 || s >= 1.0 {
            return f64::from(s >= 1.0 && self.deriv() == 0);
        }
        if self.deriv() > 0 {
            return -self.integrated().value(s);
        }
        let (family, raised, degree) = (self.family(), self.family().raised(1), self.degree());
        let body = cumulative_density(family, s);
        if degree == 0 {
            return body;
        }
        let factors: Vec<f64> = family
            .recurrence(degree)
            .values(self.tau())
            .iter()
            .enumerate()
            .skip(1)
            .map(|(m, p)| p / family.derivative_factor(m))
            .collect();
        body - raised.ln_density(s, 1.0 - s).exp() * raised.recurrence(degree - 1).sum(&factors, s)
    }

    /// The response to a unit step that arrived `times` window lengths ago at a causal window, into `out`: the integral of
    /// the kernel from `1 - t` to 1.
    pub fn step_response(&self, times: &[f64], out: &mut [f64], control: &impl Control) -> Result<(), Error> {
        let whole = self.integral(1.0);
        for (index, (value, &t)) in out.iter_mut().zip(times).enumerate() {
            if index % 256 == 255 {
                control.check(index as f64 / times.len() as f64)?;
            }
            *value = if t <= 0.0 { 0.0 } else { whole - self.integral(1.0 - t) };
        }
        Ok(())
    }

    /// The integral of the kernel's absolute value: a disturbance of size 1 and any shape moves the estimate by at most this.
    #[must_use]
    pub fn norm1(&self) -> f64 {
        let (recurrence, moments) = (self.family().recurrence(self.degree()), self.moments(self.degree()));
        let sum = |s: f64| recurrence.sum(&moments, s);
        // All zeros of the polynomial are real and simple, and the nodes resolve it at least fourfold.
        let grid: Vec<f64> = nodes(self.family(), 4 * self.degree(), 0.0).iter().map(|node| node.s).collect();
        let mut norm = 0.0;
        let mut before = 0.0;
        for (&left, &right) in grid.iter().zip(grid.iter().skip(1)) {
            let sign = sum(left) > 0.0;
            if right > left && (sum(right) > 0.0) != sign {
                let here = self.integral(bisect(left, right, |s| (sum(s) > 0.0) != sign));
                norm += f64::abs(here - before);
                before = here;
            }
        }
        norm + (self.integral(1.0) - before).abs()
    }

    /// `B` in `|error| <= B T^p sup |x^(deriv + p)|`, with `p` as in [`Kernel::bias`]: the estimate is the derivative of a
    /// polynomial that meets that of the signal at p points of the window, so that the error is `x^(deriv + p) / p!` times
    /// p distances, none larger than that to the farther end.
    #[must_use]
    pub fn bias_bound(&self) -> f64 {
        let farther = self.tau().abs().max((1.0 - self.tau()).abs());
        (1..=self.bias().0).map(|k| farther / k as f64).product()
    }

    /// The delay at low frequencies in window lengths, from the first moment beyond those that define the estimate. It
    /// differs from `1 - tau` only if the degree is the order of the derivative: then the kernel does not depend on `tau`,
    /// and estimates at the mean of its raised density.
    #[must_use]
    pub fn moment_delay(&self) -> f64 {
        if self.degree() > self.deriv() {
            return 1.0 - self.tau();
        }
        let (kappa, mu) = self.exponents();
        let n = self.deriv() as f64;
        (mu + n + 1.0) / (kappa + mu + 2.0 * n + 2.0)
    }

    /// The window length T at which bias and noise together are least: `[(2n + 1) V / (2p B)]^(1 / (2p + 2n + 1))` with
    /// the variance `V / T^(2n + 1)` of white noise and the squared bias `B T^(2p)`.
    pub fn optimal_duration(&self, conditions: &Conditions) -> Result<f64, Error> {
        conditions.check()?;
        let (p, bias, n) = self.error_law(conditions);
        let variance = conditions.noise_level.powi(2) * conditions.delta * self.finite_norm2()?;
        Ok(((2.0 * n + 1.0) * variance / (2.0 * p * bias * bias)).powf((2.0 * p + 2.0 * n + 1.0).recip()))
    }

    /// The same for a disturbance that is bounded by the noise level: `[n d |k|_1 / (p |C| M)]^(1 / (n + p))`.
    pub fn optimal_duration_bounded(&self, conditions: &Conditions) -> Result<f64, Error> {
        conditions.check()?;
        if self.deriv() == 0 {
            return Err(Error::argument(
                "deriv",
                0_usize,
                "at least 1 for bounded noise, which no window of a smoother reduces",
            ));
        }
        let (p, bias, n) = self.error_law(conditions);
        Ok((n * conditions.noise_level * self.norm1() / (p * bias)).powf((n + p).recip()))
    }

    /// Root of bias squared plus variance of white noise, for a window of length `duration`.
    pub fn rmse(&self, duration: f64, conditions: &Conditions) -> Result<f64, Error> {
        conditions.check()?;
        if !(duration.is_finite() && duration > 0.0) {
            return Err(Error::argument("duration", duration, "finite and positive"));
        }
        let (p, bias, n) = self.error_law(conditions);
        let deviation = conditions.noise_level * (conditions.delta * self.finite_norm2()?).sqrt();
        Ok((bias * duration.powf(p)).hypot(deviation * duration.powf(-n - 0.5)))
    }

    /// `p`, `|C| M` and `n`.
    fn error_law(&self, conditions: &Conditions) -> (f64, f64, f64) {
        let (order, constant) = self.bias();
        (order as f64, constant.abs() * conditions.derivative_bound, self.deriv() as f64)
    }

    fn finite_norm2(&self) -> Result<f64, Error> {
        let norm = self.norm2();
        if norm.is_finite() {
            return Ok(norm);
        }
        let (kappa, mu) = self.exponents();
        let (name, value) = if kappa <= mu { ("kappa", kappa) } else { ("mu", mu) };
        Err(Error::argument(name, value, "greater than -1/2, or the noise gain is infinite"))
    }
}

/// A sinusoid in white noise, and the estimator whose window is free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tradeoff {
    /// Order of the derivative.
    pub deriv: usize,
    /// Degree of the local polynomial.
    pub degree: usize,
    /// Exponents of the weight at the oldest and at the newest end.
    pub exponents: (f64, f64),
    /// Standard deviation of the noise.
    pub noise_level: f64,
    /// Amplitude of the sinusoid.
    pub amplitude: f64,
    /// Its frequency, in cycles per unit of time.
    pub frequency: f64,
    /// Sampling step.
    pub delta: f64,
}

impl Tradeoff {
    /// The least root-mean-square error that any window reaches with the estimate `delay` before its newest end, and the
    /// length of that window.
    pub fn best(&self, delay: f64) -> Result<(f64, f64), Error> {
        let (shortest, longest) = ((self.degree + 1) as f64 * self.delta, MAX_WINDOW as f64 * self.delta);
        if delay.is_nan() || delay.abs() > longest {
            return Err(Error::argument("delays", delay, format!("at most {MAX_WINDOW} sampling steps")));
        }
        let low = shortest.max(delay).ln();
        let high = (20.0 / self.frequency + 4.0 * delay.abs()).max(8.0 * shortest).min(longest).ln();
        let point = |i: u32| low + (high - low) * f64::from(i) / 96.0;
        let mut best = (f64::INFINITY, 0);
        for i in 0..=96 {
            let error = self.error(point(i).exp(), delay)?;
            if error < best.0 {
                best = (error, i);
            }
        }
        let (mut left, mut right) = (point(best.1.saturating_sub(1)), point((best.1 + 1).min(96)));
        while right - left > 1e-6 {
            let (first, second) = (left + 0.382 * (right - left), right - 0.382 * (right - left));
            if self.error(first.exp(), delay)? < self.error(second.exp(), delay)? {
                right = second;
            } else {
                left = first;
            }
        }
        let duration = (0.5 * (left + right)).exp();
        Ok((self.error(duration, delay)?, duration))
    }

    fn error(&self, duration: f64, delay: f64) -> Result<f64, Error> {
        let (kappa, mu) = self.exponents;
        let tau = 1.0 - delay / duration;
        let kernel = Kernel::new(self.deriv, self.degree, kappa, mu, Tau::At(tau), 1.0)?;
        let omega = TAU * self.frequency * duration;
        let n = self.deriv as i32;
        let ideal = Complex::new(0.0, omega).powi(n);
        let distance = (Response::new(&kernel, omega).at(omega, kernel.tau()) - ideal).norm();
        let bias = self.amplitude * FRAC_1_SQRT_2 * distance;
        let deviation = self.noise_level * (self.delta / duration * kernel.finite_norm2()?).sqrt();
        Ok(bias.hypot(deviation) / duration.powi(n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kernel(deriv: usize, degree: usize, kappa: f64, mu: f64, tau: f64) -> Kernel {
        Kernel::new(deriv, degree, kappa, mu, Tau::At(tau), 1.0).expect("valid")
    }

    #[test]
    fn integrals_add_up() {
        // Simpson's rule on a fine grid, away from singular ends.
        for (deriv, degree, kappa, mu, tau) in [
            (0, 0, 0.0, 0.0, 0.5),
            (0, 3, 1.0, 0.5, 0.9),
            (1, 2, 0.0, 0.0, 1.0),
            (2, 4, 2.0, 1.0, 0.3),
            (3, 3, 1.5, 4.0, 0.5),
        ] {
            let kernel = kernel(deriv, degree, kappa, mu, tau);
            let (low, high, steps) = (0.1, 0.83, 4000);
            let h = (high - low) / f64::from(steps);
            let sum: f64 = (0..=steps)
                .map(|i| {
                    let share = if i == 0 || i == steps {
                        1.0
                    } else if i % 2 == 1 {
                        4.0
                    } else {
                        2.0
                    };
                    share * kernel.value(low + f64::from(i) * h)
                })
                .sum();
            let expected = kernel.integral(high) - kernel.integral(low);
            assert!((sum * h / 3.0 - expected).abs() < 1e-9 * kernel.norm1(), "{deriv} {degree}");
        }
    }

    #[test]
    fn known_norms() {
        for (kernel, expected) in [
            (kernel(1, 1, 0.0, 0.0, 0.5), 3.0),
            (kernel(1, 1, 2.0, 2.0, 0.5), 4.375),
            (kernel(0, 0, 0.0, 0.0, 0.5), 1.0),
        ] {
            assert!((kernel.norm1() / expected - 1.0).abs() < 1e-14, "{} {expected}", kernel.norm1());
        }
    }
}
