//! What happens where the window does not lie inside the data.

/// The closed set of ways to treat the ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// The first or last whole window, its fit evaluated at the sample: full length, polynomials reproduced to both ends.
    Fit,
    /// Only outputs whose window lies inside the data: shorter output, at `tau` exactly.
    Valid,
    /// NaN where the window does not lie inside the data.
    Nan,
    /// The data go on with their last value: `a a a | a b c | c c c`.
    Nearest,
    /// The data are mirrored at the last sample: `c b | a b c | b a`.
    Mirror,
    /// The data are one period: `b c | a b c | a b`.
    Wrap,
    /// The data go on with this value.
    Constant(f64),
}

impl Mode {
    /// Whether the data are extended, so that they may be shorter than the window.
    #[must_use]
    pub fn extends(self) -> bool {
        !matches!(self, Self::Fit | Self::Valid | Self::Nan)
    }

    /// Public name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fit => "fit",
            Self::Valid => "valid",
            Self::Nan => "nan",
            Self::Nearest => "nearest",
            Self::Mirror => "mirror",
            Self::Wrap => "wrap",
            Self::Constant(_) => "constant",
        }
    }

    /// The sample of `0..samples` that stands at `index` of the extended data; none where a constant stands.
    #[must_use]
    pub fn source(self, index: isize, samples: usize) -> Option<usize> {
        let last = samples.cast_signed() - 1;
        let inside = match self {
            _ if (0..=last).contains(&index) => index,
            Self::Nearest => index.clamp(0, last),
            Self::Wrap => index.rem_euclid(last + 1),
            Self::Mirror if last == 0 => 0,
            Self::Mirror => {
                let folded = index.rem_euclid(2 * last);
                folded.min(2 * last - folded)
            }
            Self::Fit | Self::Valid | Self::Nan | Self::Constant(_) => return None,
        };
        Some(inside.cast_unsigned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions() {
        let extended = |mode: Mode| -> Vec<Option<usize>> { (-4..7).map(|index| mode.source(index, 3)).collect() };
        let known = |indices: [usize; 11]| indices.map(Some).to_vec();
        assert_eq!(extended(Mode::Nearest), known([0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2]));
        assert_eq!(extended(Mode::Mirror), known([0, 1, 2, 1, 0, 1, 2, 1, 0, 1, 2]));
        assert_eq!(extended(Mode::Wrap), known([2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0]));
        assert_eq!(Mode::Mirror.source(-5, 1), Some(0));
        assert_eq!(Mode::Constant(0.0).source(3, 3), None);
    }
}
