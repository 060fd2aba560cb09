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

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import differentiate
    >>> x = np.arange(100.0) ** 2
    >>> x[40:43] = np.nan
    >>> found = differentiate(x, 11, nan_policy="omit", return_std=True, return_support=True, sigma=0.1)
    >>> bool(np.allclose(found.estimate, 2 * np.arange(100))), found.support[[0, 36, 41]].tolist()
    (True, [11, 9, 8])
    >>> bool(found.std[41] > found.std[20]), bool(found.std[0] > found.std[41])
    (True, True)
    """

    estimate: Samples
    std: Samples | None = None
    support: NDArray[Any] | None = None
    bias: Samples | None = None
