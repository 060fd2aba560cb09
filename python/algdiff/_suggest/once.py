"""Differentiation for once, by a window that is chosen on the way."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff import _dask as dask
from algdiff._results import Estimates
from algdiff._suggest.choice import chosen
from algdiff._suggest.suggestion import apply
from algdiff._suggest.wanted import descending, sampled, wanted


def differentiated(
    x: ArrayLike,
    deriv: Any,
    axis: Any,
    asked: dict[str, Any],
    refused: dict[str, Any],
    engine: str,
    call: dict[str, Any],
) -> Any:
    """Return the estimates of `differentiate` without a window.

    Parameters
    ----------
    x : array_like
        The samples.
    deriv, axis
        As there.
    asked : dict
        What `suggest` takes of its arguments.
    refused : dict
        Arguments that need a window, which must be None.
    engine : str
        How weights are applied.
    call : dict
        The arguments of the call of a design.
    """
    for name, value in refused.items():
        if value is not None:
            raise ValueError(
                f"window_length must be given with {name}, got {name} = {value!r} alone; algdiff.suggest chooses a "
                "window and takes max_delay"
            )
    if dask.is_dask(x):
        raise ValueError(
            "window_length must be given for a Dask array: algdiff.suggest chooses it from a part in memory"
        )
    samples = arguments.unmasked("x", x)
    along = arguments.axis_index(axis, samples.ndim)
    t = asked.pop("t")
    delta = sampled(samples.shape[along], asked.pop("delta"), asked.pop("fs"), t)
    level = None if call["sigma"] is None or np.ndim(call["sigma"]) else arguments.level("sigma", call["sigma"])
    want = wanted(deriv, samples.shape[along], delta, sigma=level, **asked)
    found = chosen(samples, along, want)
    design = found.design if engine == "auto" else found.design.replace(engine=engine)
    sigma = found.noise_level
    backwards = t is not None and descending(t)
    if not backwards:
        return apply(design, x, axis, call.pop("mode"), sigma, want.local, call)
    result = apply(design, np.flip(samples, along), axis, call.pop("mode"), sigma, want.local, call)
    if not isinstance(result, Estimates):
        return np.flip(result, along - samples.ndim)
    return Estimates(*(None if part is None else np.flip(part, along - samples.ndim) for part in result))  # type: ignore[arg-type]
