//! What the targets share: numbers and designs made of bytes, memory that is bounded, and exact sums.

mod memory;
pub mod numbers;
pub mod signals;
pub mod sums;
pub mod wishes;

use algdiff_core::error::Error;

/// Holds what is refused to the style of messages: one line, with something in it.
pub fn refused(error: &Error) {
    let said = error.to_string();
    assert!(!said.trim().is_empty() && said.lines().count() == 1, "{said:?}");
    assert!(!matches!(error, Error::Memory { .. } | Error::Interrupted), "{said}");
}
