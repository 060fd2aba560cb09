"""Differentiation for once, by a window that is chosen on the way."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff import _dask as dask
from algdiff._differentiator import Differentiator
from algdiff._refusals import shown
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
                f"window_length must be given with {name}, got {name} = {shown(value)} alone; algdiff.suggest chooses "
                "a window and takes max_delay"
            )
    if dask.is_dask(x):
        raise ValueError(
            "window_length must be given for a Dask array, got none: algdiff.suggest chooses it from a part in memory"
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
    return _backwards(design, x, along, axis, sigma, want.local, call)


def _backwards(
    design: Differentiator, x: ArrayLike, along: int, axis: Any, sigma: float, local: bool, call: dict[str, Any]
) -> Any:
    """Differentiate samples whose times descend: what ascends, and turned around."""
    turned = np.flip(x if isinstance(x, np.ma.MaskedArray) else np.asarray(x), along)
    out, mode = call.pop("out"), call.pop("mode")
    for name in ("weights", "sigma"):
        if np.ndim(call[name]):
            call[name] = np.flip(call[name], 0 if np.ndim(call[name]) == 1 else along)
    result = apply(design, turned, axis, mode, sigma, local, call)
    if isinstance(result, Estimates):
        parts = (None if part is None else np.flip(part, along - turned.ndim) for part in result)
        return Estimates(*parts)  # type: ignore[arg-type]
    result = np.flip(result, along - turned.ndim)
    if out is None:
        return result
    arguments.check_output(out, result.shape, result.dtype, np.asarray(x))[...] = result
    return out
