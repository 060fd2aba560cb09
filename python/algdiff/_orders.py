"""Designs of several orders: what they say is what each of their orders says, in the order of `deriv`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np

from algdiff import _arguments as arguments
from algdiff._refusals import shown

Response = TypeVar("Response", bound=Callable[..., Any])


def checked(deriv: object) -> int | tuple[int, ...]:
    """Return one order as an integer and several as a tuple."""
    several = isinstance(deriv, Sequence) and not isinstance(deriv, (str, bytes))
    if not several and not (isinstance(deriv, np.ndarray) and deriv.ndim > 0):
        return arguments.integer("deriv", deriv, 0)
    orders = tuple(arguments.integer("deriv", order, 0) for order in deriv)  # type: ignore[attr-defined]
    if not orders or len(set(orders)) < len(orders):
        raise ValueError(f"deriv must name at least one order, and every order once, got {shown(deriv)}")
    return orders


def highest(orders: Any) -> int:
    """Return the highest of several orders, or the one."""
    return max(orders) if isinstance(orders, tuple) else int(orders)


def each(analysis: Callable[..., Any]) -> Callable[..., Any]:
    """Make what is said of one order a tuple for several."""

    @wraps(analysis)
    def said(design: Any, *words: Any, **named: Any) -> Any:
        if isinstance(design.deriv, tuple):
            return tuple(analysis(one, *words, **named) for one in design.orders)
        return analysis(design, *words, **named)

    return said


def stacked(response: Response) -> Response:
    """Give the response of several orders, or every part of it, a leading axis over them."""

    @wraps(response)
    def responses(design: Any, *words: Any, **named: Any) -> Any:
        if not isinstance(design.deriv, tuple):
            return response(design, *words, **named)
        results = [response(one, *words, **named) for one in design.orders]
        if isinstance(results[0], tuple):
            return type(results[0])(*(np.stack(parts) for parts in zip(*results, strict=True)))
        return np.stack(results)

    return cast("Response", responses)


def single(what: str, design: Any) -> None:
    """Refuse several orders where there is no sense in them."""
    if isinstance(design.deriv, tuple):
        raise ValueError(f"{what} must be of one order, got deriv = {design.deriv}: take one of its .orders")
