//! How a long computation hears that it should stop, and says how far it is.

use crate::error::Error;

/// Asked now and then from the thread that started the computation.
pub trait Control {
    /// Whether to go on; `fraction` of the work is done.
    fn proceed(&self, fraction: f64) -> bool;

    /// The same as an error to leave by.
    fn check(&self, fraction: f64) -> Result<(), Error> {
        if self.proceed(fraction) { Ok(()) } else { Err(Error::Interrupted) }
    }
}

/// Always goes on.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unattended;

impl Control for Unattended {
    fn proceed(&self, _fraction: f64) -> bool {
        true
    }
}
