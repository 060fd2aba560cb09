"""The windows and degrees that are compared, and what white or coloured noise does to them and to their differences."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._differentiator import Differentiator, rebuild

Floats = NDArray[np.float64]

LARGEST = 740
"""The longest window that is compared; where more is needed, samples are averaged first."""

RATIO = 1.2
"""From one window to the next; half of it would gain 1 percent."""

CROWDED = 2.3
"""At most this many degrees per root of the window length: beyond, the noise of a fit grows steeply."""

DEGREES = 4
"""Even degrees that are compared: at the center a fit of odd degree is that of the even one next to it."""


def odd(length: float) -> int:
    """Return the odd window length nearest to some length."""
    return 2 * round(0.5 * (length - 1)) + 1


def holds(window_length: int, degree: int) -> bool:
    """Return whether a window has enough samples for a fit of some degree, and noise that does not get out of hand."""
    return degree < window_length and degree <= CROWDED * math.sqrt(window_length)


def windows(least: int, most: int) -> list[int]:
    """Return odd window lengths within bounds: the same whatever they are, and the longest that there is."""
    lengths: list[int] = []
    wanted = 3.0
    while wanted <= most:
        length = odd(wanted)
        if least <= length <= most and (not lengths or length > lengths[-1]):
            lengths.append(length)
        wanted = max(wanted * RATIO, wanted + 2)
    last = most - 1 + most % 2
    if last >= max(least, 3) and last not in lengths[-1:]:
        lengths.append(last)
    return lengths


def even_degrees(deriv: int) -> list[int]:
    """Return the degrees of the fits that are compared."""
    least = deriv + deriv % 2
    return [least + 2 * k for k in range(DEGREES)]


def reproduced(degree: int, deriv: int) -> int:
    """Return the degree of the polynomials that a central fit of even degree differentiates as one more does."""
    return degree + 1 if deriv % 2 == degree % 2 else degree


class Family(NamedTuple):
    """Candidates, sorted by window, then degree, and what unit noise makes of them.

    Attributes
    ----------
    designs : tuple of Differentiator
        Of a sampling step of 1, estimating at their centers.
    window, degree, half : ndarray of int
        Of each; `half` is the number of samples on either side of the center.
    gain : ndarray
        Variance of the estimates.
    difference : ndarray of shape (K, K)
        Variance of the differences between two of them at the same place.
    memory : ndarray of shape (K, K)
        Over how many samples the noise of these differences is the same, as far as its square goes.
    """

    designs: tuple[Differentiator, ...]
    window: NDArray[np.intp]
    degree: NDArray[np.intp]
    half: NDArray[np.intp]
    gain: Floats
    difference: Floats
    memory: Floats

    def apart(self, sigma: Floats) -> Floats:
        """Return the variance of the difference of two candidates for noise of a level for each, the higher one's."""
        variance: Floats = np.maximum(sigma, sigma[:, None]) ** 2 * self.difference
        return variance


def family(
    deriv: int, lengths: tuple[tuple[int, tuple[int, ...]], ...], kappa: float, mu: float, correlation: float = 0.0
) -> Family:
    """Return the candidates of some windows for each degree; `correlation` is that of neighbours in AR(1) noise."""
    return _families(deriv, lengths, kappa, mu, correlation)


def _family(
    deriv: int, lengths: tuple[tuple[int, tuple[int, ...]], ...], kappa: float, mu: float, correlation: float
) -> Family:
    pairs = sorted((w, d) for d, some in lengths for w in some if holds(w, d))
    if not pairs:
        raise ValueError(
            "min_window, max_window, bandwidth and degree must leave a window that fits into x, got none that holds "
            f"a fit of degree {' or '.join(str(d) for d, _ in lengths)}"
        )
    designs = tuple(design(deriv, w, d, kappa, mu) for w, d in pairs)
    window, degree = (np.array(values, np.intp) for values in zip(*pairs, strict=True))
    rows = np.zeros((len(pairs), window[-1]))
    for row, one in zip(rows, designs, strict=True):
        start = (window[-1] - one.window_length) // 2
        row[start : start + one.window_length] = one.weights
    seen = rows @ _covariance(window[-1], correlation) if correlation else rows
    products = seen @ rows.T
    gain = products.diagonal().copy()
    difference = np.maximum(gain[:, None] + gain[None, :] - 2 * products, 0.0)
    return Family(designs, window, degree, (window - 1) // 2, gain, difference, _memory(rows))


_families = lru_cache(maxsize=16)(_family)


def design(
    deriv: int | tuple[int, ...],
    window_length: int,
    degree: int,
    kappa: float,
    mu: float,
    delta: float = 1.0,
    delay: float | None = None,
) -> Differentiator:
    """Return a design with its estimate at the center, or `delay` back, without a warning: who chose it weighed it."""
    words = {"window_length": window_length, "deriv": deriv, "degree": degree, "kappa": kappa, "mu": mu}
    plain = {"tau": None, "delay": delay, "delta": delta, "rule": "exact", "trim": 0.0, "engine": "auto"}
    return rebuild({**words, **plain})


def _covariance(size: int, correlation: float) -> Floats:
    """Return the covariance of AR(1) noise of unit variance."""
    lags = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    covariance: Floats = np.power(correlation, lags)
    return covariance


def _memory(rows: Floats) -> Floats:
    """Return the sums of the squared correlations of the noise of neighbouring differences."""
    size = 2 * rows.shape[1]
    spectra = np.fft.rfft(rows, size)
    shares = np.full(spectra.shape[1], 2.0)
    shares[0] = shares[-1] = 1.0
    memory = np.ones((len(rows), len(rows)))
    for k, spectrum in enumerate(spectra[:-1]):
        apart = spectra[k + 1 :] - spectrum
        power = apart.real**2 + apart.imag**2
        total = power @ shares
        memory[k, k + 1 :] = memory[k + 1 :, k] = size * (power**2 @ shares) / np.maximum(total, 1e-300) ** 2
    return memory
