//! A control loop without Python: the velocity of a mass on a spring, from noisy positions, damps it.
//!
//! `cargo run --release --example control_loop`. Designing takes memory and may fail; the loop does neither:
//! optimised, this program links only if the compiler has found no way to panic in [`step`], and [`main`] stops it if the loop asks
//! for memory.

use std::process::ExitCode;
use std::sync::Arc;

use algdiff_core::bank::Bank;
use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, Place};
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::rule::Rule;
use algdiff_core::stream::Stream;
use assert_no_alloc::{AllocDisabler, assert_no_alloc};

#[global_allocator]
static WATCHED: AllocDisabler = AllocDisabler;

/// Sampling step, in s.
const DELTA: f64 = 1e-3;

/// Angular frequency of the spring, in rad/s.
const OMEGA: f64 = 10.0;

/// A position and a velocity.
struct Mass {
    position: f64,
    velocity: f64,
}

impl Mass {
    /// One step under a force that is held (symplectic Euler).
    fn advance(&mut self, force: f64) {
        self.velocity += DELTA * (force - OMEGA * OMEGA * self.position);
        self.position += DELTA * self.velocity;
    }
}

/// What the controller does with a measurement: nothing until the window is full, then it brakes.
#[cfg_attr(not(debug_assertions), no_panic::no_panic)]
fn step(stream: &mut Stream<f64>, measured: f64) -> f64 {
    let mut velocity = [0.0];
    stream.push(&[measured], &mut velocity);
    let [velocity] = velocity;
    if velocity.is_nan() { 0.0 } else { -4.0 * velocity }
}

fn main() -> Result<ExitCode, Error> {
    let design = Design {
        window_length: 41,
        deriv: 1,
        degree: 2,
        kappa: 0.0,
        mu: 0.0,
        place: Place::Tau(Tau::Newest),
        delta: DELTA,
        rule: Rule::Exact,
        trim: 0.0,
    };
    let bank = Bank::new(vec![Arc::new(Plan::new(&design, &Unattended)?)], None)?;
    let mut stream = Stream::new(&[Arc::new(bank)], 1)?;
    let mut mass = Mass { position: 1.0, velocity: 0.0 };
    let mut seed = 1_u64;
    assert_no_alloc(|| {
        for _ in 0..3000 {
            // A linear congruential generator: noise of 1e-4, evenly distributed.
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = 1e-4 * ((seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0);
            let force = step(&mut stream, mass.position + noise);
            mass.advance(force);
        }
    });
    let energy = 0.5 * (mass.velocity.powi(2) + (OMEGA * mass.position).powi(2));
    println!("energy after 3 s: {energy:.1e} of {:.0} at the start", 0.5 * OMEGA * OMEGA);
    // Without the brake it would be what it was; with it, it decays by exp(-4 t).
    Ok(if energy < 1e-2 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
