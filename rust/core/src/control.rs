//! How a long computation hears that it should stop, and says how far it is.

/// Asked now and then from the thread that started the computation.
pub trait Control {
    /// Whether to go on; `fraction` of the work is done.
    fn proceed(&self, fraction: f64) -> bool;
}

/// Always goes on.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unattended;

impl Control for Unattended {
    fn proceed(&self, _fraction: f64) -> bool {
        true
    }
}
