"""One cell of the ladder: refused in the words that are documented, or every output within the bounds."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

import algdiff
from covering import Cell
from ladder import KEPT, kept, span_of
from ladder_calls import CVAL, ENTRIES, Given, by_rows, degree_of, given, length, single, tau, words
from ladder_naive import Window, expected, window_maximum
from ladder_refusals import reasons
from reference_fits import Twin, density
from support import EPS, design

Array = npt.NDArray[Any]
FITTED = 6
"""Estimates of a call that are compared with fits of their own."""


def held(cell: Cell, rng: np.random.Generator, folder: Path) -> str:
    """Make one call and compare what comes with what should; return "ran", or the reason for which it was refused."""
    one, why = given(cell, rng), reasons(cell)
    before = np.asarray(one.x).tobytes()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", algdiff.DesignWarning)
        try:
            result = ENTRIES[cell["entry"]](cell, one, rng, folder)
        except (ValueError, TypeError) as error:
            return refused(cell, error)
    assert not any(reason.sure for reason in why.values()), f"not refused, {list(why)}: {cell}"
    assert np.asarray(one.x).tobytes() == before, f"x was changed: {cell}"
    try:
        compare(cell, one, by_rows(cell, one, result), rng)
    except AssertionError as error:
        raise AssertionError(f"{cell}\n{error}") from error
    return "ran"


def refused(cell: Cell, error: Exception) -> str:
    """Return for which documented reason a cell was refused; fail if for none."""
    import re

    for name, reason in reasons(cell).items():
        if isinstance(error, reason.error) and re.search(reason.says, str(error)):
            assert "\n" not in str(error)
            return name
    raise AssertionError(f"refused for no documented reason: {cell}\n{error!r}") from error


def windows(cell: Cell) -> list[Window]:
    """Return the orders of a design."""
    first, span, _ = kept(*(cell[name] for name in KEPT))
    orders = cell["deriv"] if isinstance(cell["deriv"], tuple) else (cell["deriv"],)
    rest = (degree_of(cell["deriv"], cell["extra"]), cell["kappa"], cell["mu"], tau(cell), cell["rule"], cell["delta"])
    halves = cell["entry"] == "savgol_filter"
    return [Window(length(cell), order, *rest, first, span, cell["trim"], halves) for order in orders]


def engine_of(cell: Cell) -> str:
    """Return the engine whose bounds hold; none if it is not known."""
    if cell["entry"] == "stream":
        return "direct" if cell["engine"] == "auto" else str(cell["engine"])
    if cell["entry"] == "savgol_filter":
        return "" if cell["engine"] == "auto" else str(cell["engine"])
    return design(length(cell), **words(cell)).engine_for("f4" if single(cell) else "f8")


def compare(cell: Cell, one: Given, got: Array, rng: np.random.Generator) -> None:
    """Compare all outputs with the naive sums where weights slide, and some of the others with fits of their own."""
    backwards = cell["times"] == "descending" and cell["entry"] != "gradient"
    rows, gone = (part[:, ::-1] if backwards else part for part in (one.rows, one.gone))
    got = got[..., ::-1] if backwards else got
    if cell["times"] == "descending" and cell["entry"] == "gradient":
        got = -got  # its windows lie as the samples do, whatever their coordinates
    if rows.shape[1] < span_of(cell) and cell["entry"] == "stream":
        assert got.shape[2] == 0  # NaN all of them, which the entry has seen
        return
    stamped = one.t is not None and (cell["times"] == "uneven" or cell["entry"] == "stream")
    alone = stamped or one.weights is not None
    if not alone:
        slide(cell, rows, got)
    if alone or (cell["policy"] == "omit" and gone.any()):
        by_fits(cell, one, rows, gone, got, rng)


def slide(cell: Cell, rows: Array, got: Array) -> None:
    """Compare the outputs of all windows without missing samples."""
    engine, parts = engine_of(cell), [(rows.real, got.real, CVAL)]
    if np.iscomplexobj(rows):
        parts.append((rows.imag, got.imag, 0.0))
    for order, window in enumerate(windows(cell)):
        for x, found, cval in parts:
            wanted, allowed = expected(window, x, cell["mode"], cval, engine, single(cell))
            assert found[order].shape == wanted.shape, (found[order].shape, wanted.shape)
            none = np.isnan(wanted)
            if cell["policy"] != "omit" or cell["mode"] == "nan":
                inside = slice(None) if cell["policy"] != "omit" else ~np.isfinite(x).any(axis=1)
                np.testing.assert_array_equal(np.isnan(found[order])[inside], none[inside])
            error = np.abs(np.where(none, 0, found[order].astype(np.longdouble) - np.where(none, 0, wanted)))
            wrong = ~(error <= allowed)
            assert not wrong.any(), (
                f"{wrong.sum()} outputs by up to {np.max(error / np.maximum(allowed, 5e-324)):.3g} bounds"
            )


def by_fits(cell: Cell, one: Given, rows: Array, gone: Array, got: Array, rng: np.random.Generator) -> None:
    """Compare some estimates with fits of their own, half of them of windows that miss samples if any do."""
    n, outputs = rows.shape[1], got.shape[2]
    if not outputs:
        return
    row = int(rng.integers(len(rows)))
    twin = twin_of(cell, one, row, n)
    shift = 0 if cell["mode"] == "valid" else twin.aligned(twin.length)
    near = window_maximum(gone[row : row + 1], min(length(cell), n))[0]
    hit = np.clip(np.flatnonzero(near) + shift, 0, outputs - 1)
    places = rng.integers(0, outputs, FITTED)
    if len(hit):
        places[::2] = rng.choice(hit, FITTED // 2)
    for i in {int(place) for place in places}:
        window = (
            twin.counted(n, i, twin.kept.stop - twin.kept.start, twin.length, None)
            if cell["mode"] == "valid"
            else twin.of_sample(n, i)
        )
        if window is None:
            assert np.isnan(got[:, row, i]).all()
            continue
        if cell["entry"] == "stream" and one.t is not None and cell["tau"] == "delay":
            count = len(window.index)
            window = window._replace(at=1 - (0.5 + 1.5 * cell["delta"] / window.duration * count) / count)
        missing = gone[row, window.index[window.index >= 0]].any()
        if window.sliding and not missing:
            continue  # by weights that slide, and an engine, as `slide` has seen
        parts = [(rows.real, got.real)] + ([(rows.imag, got.imag)] if np.iscomplexobj(rows) else [])
        for x, found in parts:
            if cell["policy"] != "omit" and missing:
                assert np.isnan(found[:, row, i]).all()
                continue
            same_fit(cell, twin, x[row], window, found[:, row, i])
            twin = twin if len(parts) == 1 else Twin(**{**twin.__dict__, "cval": 0.0})
        twin = twin if len(parts) == 1 else Twin(**{**twin.__dict__, "cval": CVAL})


def twin_of(cell: Cell, one: Given, row: int, n: int) -> Twin:
    """Return the readable twin of a call for one of its rows."""
    backwards = cell["times"] == "descending" and cell["entry"] != "gradient"
    weights, t = one.weights, one.t
    if weights is not None and weights.ndim > 1:
        weights = np.moveaxis(weights, one.axis, -1).reshape(-1, n)[row]
    elif weights is not None:
        weights = weights.reshape(-1)
    orders = cell["deriv"] if isinstance(cell["deriv"], tuple) else (cell["deriv"],)
    return Twin(
        length(cell),
        orders,
        degree_of(cell["deriv"], cell["extra"]),
        cell["kappa"],
        cell["mu"],
        tau(cell),
        cell["delta"],
        cell["mode"],
        CVAL,
        cell["trim"],
        t=t if cell["times"] == "uneven" or cell["entry"] == "stream" else None,
        weights=weights if weights is None or not backwards else weights[::-1],
    )


def same_fit(cell: Cell, twin: Twin, x: Array, window: Any, found: Array) -> None:
    """Compare the estimates of one window with those of a fit of its own, and what is refused.

    A sum errs by as many eps as it has terms, and both fits by as many as their matrix has condition, or as samples
    that are taken out of a whole window leave, see `taken`. Uneven times are known to some eps of the row's length,
    which is that many of the window's, and the slope of a polynomial on [0, 1] is up to twice the square of its degree.
    Sums for many windows with gaps are of distances from one sample of the row.
    """
    wanted, span = twin.output(x, window), len(window.index)
    eps = float(np.finfo(np.float32).eps) if single(cell) else EPS
    moved = 0.0 if twin.t is None else 16 * (twin.degree + 1) ** 2 * float(np.ptp(twin.t)) / window.duration
    lost = EPS * (64 + 64 * wanted.condition + taken(twin, x, window) + moved) + eps * (span + 8)
    own, row = (float(np.nanmax(np.abs(part), initial=0.0)) for part in (wanted.samples, x))
    allowed = np.abs(wanted.weights).sum(axis=1) * (lost * own + (span + 8) * eps * row)
    decided = np.abs(wanted.gain - 1) >= 1e-6 if np.isfinite(wanted.gain).all() else np.ones(len(found), bool)
    good = (np.abs(found - wanted.estimate) <= allowed) | (np.isnan(found) & np.isnan(wanted.estimate))
    assert good[decided].all(), (found, wanted.estimate, allowed, window)


def taken(twin: Twin, x: Array, window: Any) -> float:
    """Return by what a fit loses if it is that of the whole even window with samples taken out: see `Twin.loss`.

    The library fits anew where a pivot of the system falls below 1e-3, of which the norm of the inverse may be the
    square and more.
    """
    used = ~np.isnan(np.append(x, [twin.cval] * 2)[window.index])
    if twin.t is not None or twin.weights is not None or used.all() or used.sum() <= twin.degree:
        return 1.0
    weight = density(window.s, window.half, twin.kappa) * density(1 - window.s, window.half, twin.mu)
    q = np.linalg.qr(legendre.legvander(2 * window.s - 1, twin.degree) * np.sqrt(weight)[:, None])[0]
    return float(min(np.linalg.norm(q[used], -2) ** -2, 1e6))
