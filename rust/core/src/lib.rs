//! Kernels and sliding windows of algebraic (Jacobi) differentiators.
//!
//! The estimator of order `deriv` and degree `degree` is the `deriv`-th derivative, at the point `tau` of the window, of
//! the least-squares polynomial of that degree fitted with the weight `tau^kappa (1 - tau)^mu`. One object carries
//! everything, a local weighted polynomial fit:
//!
//! * [`jacobi`]: the orthonormal polynomials of that weight, their roots and Gauss rules;
//! * [`kernel`]: the continuous estimator, its exactness, bias and gain;
//! * [`fit`]: the same fit on the samples of one window;
//! * [`analysis`], [`response`]: its behaviour in time and frequency, by the rules of [`quadrature`];
//! * [`rule`]: the classical ways from a kernel to weights;
//! * [`design`]: what the user asks for;
//! * [`plan`]: everything decided before the first sample;
//! * [`filter`]: what the weights of a plan do to signals;
//! * [`engine`]: how the weights of a plan meet the data;
//! * [`ends`]: what happens where the window does not lie inside the data;
//! * [`run`]: arrays, threads and stopping on request;
//! * [`stream`]: the same estimates sample by sample, without taking memory or panicking;
//! * [`local`], [`gaps`], [`irregular`], [`fits`]: the fit on whatever samples there are, one for every estimate: missing samples,
//!   uneven times, weights, errors;
//! * [`paper`]: the source paper's own systems, on which nothing is built.
//!
//! ```
//! use std::sync::Arc;
//! use algdiff_core::{bank::Bank, kernel::Tau, design::{Design, Place}, plan::Plan, rule::Rule, control::Unattended, run::{Job, Layout, Mode}};
//!
//! let design = Design { window_length: 5, deriv: 1, degree: 2, kappa: 0.0, mu: 0.0, place: Place::Tau(Tau::Center), delta: 0.1, rule: Rule::Exact, trim: 0.0 };
//! let plan = Plan::new(&design, &Unattended)?;
//! let x: Vec<f64> = (0..20).map(|i| (0.1 * f64::from(i)).powi(2)).collect();
//! let mut slope = vec![0.0; 20];
//! let bank = Bank::new(vec![Arc::new(plan)], None)?;
//! Job::new(&bank, Mode::Fit, Layout::row(20)).run(&x, &mut slope, &Unattended)?;
//! assert!((slope[7] - 2.0 * 0.7).abs() < 1e-12);
//! # Ok::<(), algdiff_core::error::Error>(())
//! ```

pub mod analysis;
pub mod bank;
mod columns;
pub mod control;
pub mod design;
pub mod ends;
pub mod engine;
pub mod error;
pub mod filter;
pub mod fit;
pub mod fits;
mod frame;
pub mod gaps;
pub mod irregular;
pub mod jacobi;
pub mod kernel;
pub mod local;
mod moves;
pub mod paper;
pub mod plan;
pub mod quadrature;
pub mod response;
mod rows;
pub mod rule;
pub mod run;
pub mod stream;
mod tasks;
mod threads;
