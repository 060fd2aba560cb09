"""What a call returns when more than the estimates is asked for."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from algdiff._arguments import Samples


class Estimates(NamedTuple):
    """Estimates and what is known of them; what was not asked for is None.

    Attributes
    ----------
    estimate : ndarray
        The estimates, as the call returns them alone.
    std : ndarray or None
        Their standard deviations from noise, in the shape of `estimate`.
    support : ndarray of int64 or None
        How many samples each was made of; of several orders, once for all.
    bias : ndarray or None
        By how much each differs from a fit of the next degree that counts: an indicator of the error that no noise
        explains, and as noisy as that fit.
    """

    estimate: Samples
    std: Samples | None = None
    support: NDArray[Any] | None = None
    bias: Samples | None = None
