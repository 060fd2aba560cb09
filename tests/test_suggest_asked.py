"""What a choice is asked with: containers, axes, gaps, the words of a call, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import algdiff

Array = npt.NDArray[np.float64]
DELTA = 0.01


def swing(seed: int = 0, count: int = 600) -> Array:
    """Return a sine in white noise."""
    noise = np.random.default_rng(seed).standard_normal(count)
    return np.asarray(np.sin(2 * DELTA * np.arange(count)) + 0.02 * noise)


def design_of(*args: Any, **options: Any) -> tuple[int, int]:
    design = algdiff.suggest(*args, **options).differentiator
    return design.window_length, design.degree


def read_only(x: Array) -> Array:
    x = x.copy()
    x.flags.writeable = False
    return x


CONTAINERS: dict[str, Any] = {
    "list": lambda x: x.tolist(),
    "tuple": lambda x: tuple(x.tolist()),
    "float32": lambda x: x.astype(np.float32),
    "big-endian": lambda x: x.astype(">f8"),
    "big-endian float32": lambda x: x.astype(">f4"),
    "float16": lambda x: x.astype(np.float16),
    "int64": lambda x: np.rint(1000 * x).astype(np.int64),
    "int16": lambda x: np.rint(1000 * x).astype(np.int16),
    "uint8": lambda x: np.rint(100 * x + 120).astype(np.uint8),
    "bool": lambda x: x > 0,
    "complex128": lambda x: x + 1j * x[::-1],
    "complex64": lambda x: (x + 1j * x[::-1]).astype(np.complex64),
    "strided": lambda x: np.repeat(x, 3)[::3],
    "reversed": lambda x: x[::-1],
    "read-only": read_only,
    "longdouble": lambda x: x.astype(np.longdouble),
    "not masked": np.ma.MaskedArray,
    "masked": lambda x: np.ma.MaskedArray(x, np.arange(x.size) == 100),
}


@pytest.mark.parametrize("name", CONTAINERS)
def test_containers(name: str) -> None:
    x = CONTAINERS[name](swing())
    plain = np.array(x)
    suggestion = algdiff.suggest(x, delta=DELTA)
    found = suggestion(x)
    expected = {"float32": np.float32, "big-endian float32": np.float32, "complex64": np.complex64}
    default = np.complex128 if name == "complex128" else np.float64
    assert found.dtype == expected.get(name, default)
    assert isinstance(found, np.ma.MaskedArray) == ("masked" in name)
    assert isinstance(found, np.ndarray)
    np.testing.assert_array_equal(algdiff.differentiate(x, delta=DELTA), found)
    np.testing.assert_array_equal(np.array(x), plain)
    if "masked" not in name:
        # Whatever it is in, the numbers are the same.
        working = plain.astype(found.dtype)
        assert design_of(working, delta=DELTA) == design_of(x, delta=DELTA)
        np.testing.assert_array_equal(algdiff.suggest(working, delta=DELTA)(working), found)


def test_complex_is_two_rows() -> None:
    x, y = swing(1), swing(2)
    suggestion = algdiff.suggest(x + 1j * y, delta=DELTA)
    assert design_of(x + 1j * y) == design_of(np.stack([x, y]))
    both = suggestion(x + 1j * y)
    for part, row in ((both.real, x), (both.imag, y)):
        np.testing.assert_allclose(part, 2 * np.cos(2 * DELTA * np.arange(600)), rtol=0, atol=0.3)
        half = suggestion.differentiator.window_length // 2 * 6 // 5
        alone = suggestion.differentiator(row)
        np.testing.assert_allclose(part[half:-half], alone[half:-half], rtol=0, atol=1e-12)


@pytest.mark.parametrize("deriv", [1, (0, 2)])
def test_axes(deriv: Any) -> None:
    rows = np.stack([swing(seed) for seed in range(6)]).reshape(2, 3, 600)
    expected = algdiff.differentiate(rows, deriv=deriv, delta=DELTA)
    assert expected.shape == rows.shape if isinstance(deriv, int) else (2, *rows.shape)
    for axis in (-3, -2, -1, 0, 1, 2):
        turned = np.moveaxis(rows, -1, axis)
        found = algdiff.differentiate(turned, deriv=deriv, delta=DELTA, axis=axis)
        np.testing.assert_array_equal(found, algdiff.suggest(turned, deriv, delta=DELTA, axis=axis)(turned, axis))
        np.testing.assert_allclose(np.moveaxis(found, axis % 3 - 3, -1), expected, rtol=0, atol=1e-9)


def test_rows_of_different_scales() -> None:
    rows = np.stack([swing(seed, 800) for seed in range(3)])
    scale = np.array([1.0, 1e6, 1e-6])
    even, uneven = algdiff.suggest(rows), algdiff.suggest(rows * scale[:, None])
    assert even.differentiator == uneven.differentiator
    found = uneven(rows * scale[:, None])
    # Ends go by the noise of each row, found to rounding.
    np.testing.assert_allclose(found / scale[:, None], even(rows), rtol=0, atol=1e-9)
    assert uneven.noise_level == pytest.approx(np.sqrt(np.mean(scale**2)) * 0.02, rel=0.1)


def test_rows_that_rest() -> None:
    rows = np.stack([swing(), np.full(600, 2.0)])
    found = algdiff.differentiate(rows, delta=DELTA)
    np.testing.assert_allclose(found[1], 0, atol=1e-10)
    assert np.abs(found[0] - 2 * np.cos(2 * DELTA * np.arange(600))).max() < 0.3


@pytest.mark.parametrize("missing", [[300], [10], [0, 599], list(range(400, 450))])
def test_missing_samples(missing: list[int]) -> None:
    x = swing(3)
    x[missing] = np.nan
    suggestion = algdiff.suggest(x, delta=DELTA)
    there = np.isfinite(x)
    runs = np.split(np.arange(600), np.flatnonzero(np.diff(there.astype(int))) + 1)
    longest = max((run for run in runs if there[run[0]]), key=len)
    alone = algdiff.suggest(x[longest], delta=DELTA)
    assert suggestion.differentiator == alone.differentiator
    assert suggestion.noise_level == alone.noise_level
    found, plain = suggestion(x), suggestion.differentiator(x)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(plain))
    np.testing.assert_array_equal(algdiff.differentiate(x, delta=DELTA), found)
    omitted = algdiff.differentiate(x, delta=DELTA, nan_policy="omit")
    np.testing.assert_array_equal(omitted, suggestion.differentiator(x, nan_policy="omit"))
    with pytest.raises(ValueError, match="nan_policy = 'raise'"):
        algdiff.differentiate(x, delta=DELTA, nan_policy="raise")


@pytest.mark.parametrize("place", [0, 100, 599])
def test_infinite_samples(place: int) -> None:
    x, missing = swing(3), swing(3)
    x[place], missing[place] = np.inf, np.nan
    suggestion = algdiff.suggest(x, delta=DELTA)
    assert suggestion.differentiator == algdiff.suggest(missing, delta=DELTA).differentiator
    np.testing.assert_array_equal(np.isfinite(suggestion(x)), np.isfinite(suggestion.differentiator(x)))


def test_masked_samples_are_missing() -> None:
    x = swing(4)
    hidden = np.arange(600) == 100
    masked = np.ma.MaskedArray(np.where(hidden, 1e6, x), hidden)
    missing = np.where(hidden, np.nan, x)
    assert design_of(masked) == design_of(missing)
    found = algdiff.differentiate(masked, nan_policy="omit")
    np.testing.assert_array_equal(found.filled(np.nan), algdiff.differentiate(missing, nan_policy="omit"))


@pytest.mark.parametrize("mode", ["valid", "nan", "nearest", "mirror", "wrap", "constant"])
def test_other_modes_are_the_designs(mode: str) -> None:
    x = swing(5)
    suggestion = algdiff.suggest(x, delta=DELTA)
    expected = suggestion.differentiator(x, mode=mode, cval=2.0)
    np.testing.assert_array_equal(suggestion(x, mode=mode, cval=2.0), expected)
    np.testing.assert_array_equal(algdiff.differentiate(x, delta=DELTA, mode=mode, cval=2.0), expected)


CALLS: dict[str, dict[str, Any]] = {
    "std": {"return_std": True},
    "support": {"return_support": True, "nan_policy": "omit"},
    "bias": {"return_bias": True},
    "weights": {"weights": np.linspace(1, 2, 600)},
    "shrink": {"edge_window": "shrink"},
    "period": {"period": 2 * np.pi},
    "sigma": {"sigma": np.linspace(0.01, 0.02, 600), "return_std": True},
}


@pytest.mark.parametrize("name", CALLS)
def test_what_needs_fits_is_the_designs(name: str) -> None:
    x, words = swing(6), CALLS[name]
    suggestion = algdiff.suggest(x, delta=DELTA)
    expected, found = suggestion.differentiator(x, **words), suggestion(x, **words)
    once = algdiff.differentiate(x, delta=DELTA, **words)
    pairs = (
        [(expected, found, once)] if isinstance(expected, np.ndarray) else list(zip(expected, found, once, strict=True))
    )
    for one, other, third in pairs:
        assert (one is None) == (other is None) == (third is None)
        if one is not None:
            np.testing.assert_array_equal(other, one)
            np.testing.assert_array_equal(third, one)


@pytest.mark.parametrize("deriv", [1, (0, 1)])
def test_out(deriv: Any) -> None:
    x = swing(7)
    expected = algdiff.differentiate(x, deriv=deriv, delta=DELTA)
    out = np.empty_like(expected)
    assert algdiff.differentiate(x, deriv=deriv, delta=DELTA, out=out, threads=1) is out
    np.testing.assert_array_equal(out, expected)
    out[:] = 0
    assert algdiff.suggest(x, deriv, delta=DELTA)(x, out=out) is out
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("engine", ["direct", "moments", "fft"])
def test_engines(engine: str) -> None:
    x = swing(8)
    expected = algdiff.differentiate(x, delta=DELTA)
    np.testing.assert_allclose(algdiff.differentiate(x, delta=DELTA, engine=engine), expected, rtol=0, atol=1e-8)


def test_descending_times() -> None:
    x, t = swing(9), DELTA * np.arange(600)
    for words in ({"return_std": True}, {"return_bias": True}, {"mode": "valid"}, {"mode": "nearest"}):
        expected = algdiff.differentiate(x, t=t, **words)
        found = algdiff.differentiate(x[::-1], t=t[::-1], **words)
        pairs = [(expected, found)] if isinstance(expected, np.ndarray) else list(zip(expected, found, strict=True))
        for one, other in pairs:
            if one is not None:
                np.testing.assert_array_equal(other[::-1], one)


def test_descending_times_and_out() -> None:
    x, t = swing(10), DELTA * np.arange(600)
    expected = algdiff.differentiate(x[::-1], t=t[::-1])
    out = np.empty(600)
    assert algdiff.differentiate(x[::-1], t=t[::-1], out=out) is out
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("word", ["weights", "sigma"])
def test_descending_times_and_words_of_samples(word: str) -> None:
    x, t, values = swing(11), DELTA * np.arange(600), np.linspace(1, 3, 600)
    expected = algdiff.differentiate(x, t=t, return_std=True, **{word: values})
    found = algdiff.differentiate(x[::-1], t=t[::-1], return_std=True, **{word: values[::-1]})
    np.testing.assert_allclose(found.std[::-1], expected.std, rtol=1e-9)


def test_descending_times_and_masks() -> None:
    x, t = np.ma.MaskedArray(swing(12), np.arange(600) == 100), DELTA * np.arange(600)
    expected = algdiff.differentiate(x, t=t)
    found = algdiff.differentiate(x[::-1], t=t[::-1])
    assert isinstance(found, np.ma.MaskedArray)
    np.testing.assert_array_equal(found.mask[::-1], expected.mask)


def test_no_rows() -> None:
    for refuse in (algdiff.suggest, algdiff.differentiate):
        with pytest.raises(ValueError, match="x must"):
            refuse(np.zeros((0, 600)))
