//! What can go wrong, in the caller's words: the argument, what it was and what it may be.

use std::fmt;

/// Every way in which a design or a run is refused.
#[derive(Debug, Clone, PartialEq)]
pub enum Error {
    /// An argument is outside of what it may be.
    Argument {
        /// The argument's public name.
        name: &'static str,
        /// The value that was given.
        got: String,
        /// What would have been accepted.
        allowed: String,
    },
    /// The weights cannot meet their moments, or cannot be known, to 1e-10.
    Moments {
        /// Degree of the fit.
        degree: usize,
        /// Number of samples in the window.
        window_length: usize,
        /// By how much, relative to the largest.
        error: f64,
    },
    /// Memory that could not be had.
    Memory {
        /// Bytes asked for.
        bytes: usize,
    },
    /// The caller asked to stop.
    Interrupted,
}

impl Error {
    /// An argument outside of what it may be.
    pub fn argument(name: &'static str, got: impl fmt::Debug, allowed: impl Into<String>) -> Self {
        // As for debugging, 1e-300 is not 300 zeros.
        Self::Argument { name, got: as_python(format!("{got:?}")), allowed: allowed.into() }
    }
}

/// A value as Python writes it: strings in single quotes, and nan.
fn as_python(value: String) -> String {
    match value.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) {
        Some(inner) => format!("'{inner}'"),
        None if value == "NaN" => "nan".to_owned(),
        None => value,
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Argument { name, got, allowed } => write!(f, "{name} must be {allowed}, got {got}"),
            Self::Moments { degree, window_length, error } => write!(
                f,
                "degree {degree} is too high for window_length {window_length}: the weights would be wrong by \
                 {error:.1e} (allowed 1e-10); use a longer window or a lower degree"
            ),
            Self::Memory { bytes } => write!(f, "could not allocate {bytes} bytes: give the data in smaller parts"),
            Self::Interrupted => write!(f, "interrupted"),
        }
    }
}

impl std::error::Error for Error {}

/// A vector of `len` copies of `value`, or [`Error::Memory`] where `vec!` would abort the process.
pub fn try_vec<T: Clone>(len: usize, value: T) -> Result<Vec<T>, Error> {
    let mut vec = Vec::new();
    vec.try_reserve_exact(len).map_err(|_| Error::Memory { bytes: len.saturating_mul(size_of::<T>()) })?;
    vec.resize(len, value);
    Ok(vec)
}

/// Makes `buffer` hold `len` default values, in the memory that it has if that is enough.
pub fn resize<T: Clone + Default>(buffer: &mut Vec<T>, len: usize) -> Result<(), Error> {
    buffer.clear();
    at_least(buffer, len)
}

/// Makes `buffer` hold `len` values or more, whatever they are.
pub fn at_least<T: Clone + Default>(buffer: &mut Vec<T>, len: usize) -> Result<(), Error> {
    if buffer.len() < len {
        let more = len - buffer.len();
        buffer.try_reserve_exact(more).map_err(|_| Error::Memory { bytes: len.saturating_mul(size_of::<T>()) })?;
        buffer.resize(len, T::default());
    }
    Ok(())
}
