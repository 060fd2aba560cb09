"""Quantities of pint and astropy: refused wherever they are given, with a recipe that is right."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

import algdiff

N = 60
T = 0.02 * np.arange(N)
X = np.sin(3 * T)
DESIGN = algdiff.Differentiator(11, delta=0.02)


class Package(NamedTuple):
    """A package for quantities: how it makes them, its units, and how it converts."""

    name: str
    quantity: Callable[[Any, str], Any]
    value: Callable[[Any, str], Any]


@pytest.fixture(params=["pint", "astropy"], scope="module")
def package(request: pytest.FixtureRequest) -> Package:
    if request.param == "pint":
        registry = pytest.importorskip("pint").UnitRegistry()
        return Package("pint", registry.Quantity, lambda given, unit: given.to(unit).magnitude)
    units = pytest.importorskip("astropy.units")
    return Package("astropy", units.Quantity, lambda given, unit: given.to_value(unit))


def recipe(call: Callable[[], Any], name: str) -> list[str]:
    """Return the pieces of code in the refusal of an argument."""
    with pytest.raises(TypeError) as error:
        call()
    said = str(error.value)
    assert said.startswith(f"{name} carries units, which would be lost: pass "), said
    assert "\n" not in said
    found = said.partition("pass ")[2]
    return re.split(
        r", with delta=|, and multiply the derivative by |, and divide the derivative by |, (?:x|dt) the ", found
    )


ARRAYS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "differentiate x": ("m", lambda q: algdiff.differentiate(q, 11)),
    "differentiate x chosen": ("m", lambda q: algdiff.differentiate(q)),
    "differentiate t": ("s", lambda q: algdiff.differentiate(X, 11, t=q)),
    "differentiate t duration": ("s", lambda q: algdiff.differentiate(X, t=q, window_duration=0.3)),
    "differentiate at": ("s", lambda q: algdiff.differentiate(X, 11, at=q)),
    "differentiate at uneven": ("s", lambda q: algdiff.differentiate(X, 11, t=T**1.1, at=q)),
    "differentiate weights": ("m-2", lambda q: algdiff.differentiate(X, 11, weights=abs(q))),
    "differentiate sigma": ("m", lambda q: algdiff.differentiate(X, 11, sigma=abs(q), return_std=True)),
    "differentiate autocovariance": ("m2", lambda q: algdiff.differentiate(X, 11, autocovariance=q, return_std=True)),
    "Differentiator x": ("m", DESIGN),
    "Differentiator x fitted": ("m", lambda q: DESIGN(q, return_std=True)),
    "Differentiator t": ("s", lambda q: DESIGN(X, t=q)),
    "Differentiator weights": ("m-2", lambda q: DESIGN(X, weights=abs(q))),
    "gradient f": ("m", lambda q: algdiff.gradient(q, 0.02, window_length=11)),
    "gradient coordinates": ("s", lambda q: algdiff.gradient(X, q, window_length=11)),
    "savgol_filter x": ("m", lambda q: algdiff.savgol_filter(q, 11, 3)),
    "suggest x": ("m", lambda q: algdiff.suggest(q, delta=0.02)),
    "suggest t": ("s", lambda q: algdiff.suggest(X, t=q)),
    "noise_level x": ("m", lambda q: algdiff.noise_level(q)),
    "noise_level t": ("s", lambda q: algdiff.noise_level(X, t=q)),
    "noise_level weights": ("m-2", lambda q: algdiff.noise_level(X, weights=abs(q))),
    "laplacian f": ("m", lambda q: algdiff.laplacian(q.reshape(6, 10), 5)),
    "push x": ("m", lambda q: DESIGN.stream().push(q)),
    "push t": ("s", lambda q: DESIGN.stream().push(X, q)),
}
SCALARS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "differentiate delta": ("s", lambda q: algdiff.differentiate(X, 11, delta=q)),
    "differentiate fs": ("Hz", lambda q: algdiff.differentiate(X, 11, fs=q)),
    "differentiate delay": ("s", lambda q: algdiff.differentiate(X, 11, delay=q)),
    "differentiate window_duration": ("s", lambda q: algdiff.differentiate(X, window_duration=q)),
    "differentiate sigma": ("m", lambda q: algdiff.differentiate(X, 11, sigma=q, return_std=True)),
    "differentiate period": ("m", lambda q: algdiff.differentiate(X, 11, period=q)),
    "differentiate cval": ("m", lambda q: algdiff.differentiate(X, 11, mode="constant", cval=q)),
    "Differentiator delta": ("s", lambda q: algdiff.Differentiator(11, delta=q)),
    "Differentiator sigma": ("m", lambda q: DESIGN(X, sigma=q, return_std=True)),
    "Differentiator window_duration": ("s", lambda q: DESIGN(X, t=T**1.1, window_duration=q)),
    "from_cutoff cutoff": ("Hz", lambda q: algdiff.Differentiator.from_cutoff(q)),
    "from_duration duration": ("s", lambda q: algdiff.Differentiator.from_duration(q)),
    "from_delay delay": ("s", lambda q: algdiff.Differentiator.from_delay(q)),
    "gradient spacing": ("s", lambda q: algdiff.gradient(X, q, window_length=11)),
    "savgol_filter delta": ("s", lambda q: algdiff.savgol_filter(X, 11, 3, deriv=1, delta=q)),
    "suggest delta": ("s", lambda q: algdiff.suggest(X, delta=q)),
    "suggest fs": ("Hz", lambda q: algdiff.suggest(X, fs=q)),
    "suggest sigma": ("m", lambda q: algdiff.suggest(X, sigma=q)),
    "suggest bandwidth": ("Hz", lambda q: algdiff.suggest(X, bandwidth=q)),
    "suggest max_delay": ("s", lambda q: algdiff.suggest(X, max_delay=q)),
    "Stream sigma": ("m", lambda q: DESIGN.stream(sigma=q)),
    "Stream delay": ("s", lambda q: DESIGN.stream(delay=q)),
    "push x": ("m", lambda q: DESIGN.stream().push(q)),
    "push t": ("s", lambda q: DESIGN.stream().push(1.0, q)),
}
UNITS = {"m-2": "1 / m**2", "m2": "m**2"}


def argument(label: str) -> str:
    return label.split()[1]


@pytest.mark.parametrize("label", ARRAYS)
def test_arrays_are_refused(package: Package, label: str) -> None:
    unit, call = ARRAYS[label]
    quantity = package.quantity(T if unit == "s" else X, UNITS.get(unit, unit))
    found = recipe(lambda: call(quantity), argument(label))
    assert found[0].startswith(f"{argument(label)}.")


@pytest.mark.parametrize("label", SCALARS)
def test_numbers_are_refused(package: Package, label: str) -> None:
    unit, call = SCALARS[label]
    found = recipe(lambda: call(package.quantity(0.5, unit)), argument(label))
    assert found[0].startswith(f"{argument(label)}.")


def test_other_numbers_ask_for_plain_ones(package: Package) -> None:
    for name in ("kappa", "mu", "trim"):
        words = {name: package.quantity(0.5, "s")}
        assert recipe(lambda words=words: algdiff.Differentiator(11, **words), name) == ["a plain number"]
    with pytest.raises(TypeError, match=r"^window_length carries units, which would be lost: pass a plain number"):
        algdiff.differentiate(X, package.quantity(11, "s"))


@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_the_recipe_of_samples(package: Package, deriv: int) -> None:
    x, dt = package.quantity(X, "cm"), package.quantity(20.0, "ms")
    plain, delta, units = recipe(lambda: algdiff.differentiate(x, 11, deriv), "x")
    given = {"x": x, "dt": dt, "deriv": deriv}
    found = algdiff.differentiate(eval(plain, given), 11, deriv, delta=eval(delta, given)) * eval(units, given)  # noqa: S307
    expected = algdiff.differentiate(X / 100, 11, deriv, delta=0.02)
    np.testing.assert_allclose(package.value(found, f"m / s**{deriv}"), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["delta", "fs", "t"])
def test_the_recipe_of_steps(package: Package, name: str) -> None:
    values, unit = {"delta": (20.0, "ms"), "fs": (0.05, "kHz"), "t": (1e3 * T, "ms")}[name]
    quantity = package.quantity(values, unit)
    plain, units = recipe(lambda: algdiff.differentiate(X, 11, 2, **{name: quantity}), name)
    given = {name: quantity, "deriv": 2}
    found = algdiff.differentiate(X, 11, 2, **{name: eval(plain, given)})  # noqa: S307
    found = found * eval(units, given) if name == "fs" else found / eval(units, given)  # noqa: S307
    expected = algdiff.differentiate(X, 11, 2, delta=0.02)
    np.testing.assert_allclose(package.value(found, "1 / s**2"), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "unit", "expected"),
    [
        ("window_duration", 0.22, "s", 220.0),
        ("delay", 0.1, "s", 100.0),
        ("sigma", 0.03, "m", 3.0),
        ("period", 3.6, "m", 360.0),
        ("weights", 4.0, "1 / m**2", 4e-4),
        ("autocovariance", 4.0, "m**2", 4e4),
    ],
)
def test_the_recipes_of_other_arguments(package: Package, name: str, value: float, unit: str, expected: float) -> None:
    number = np.full(N, value) if name in ("weights", "autocovariance") else value
    quantity = package.quantity(number, unit)
    words: dict[str, Any] = {name: quantity} if name == "window_duration" else {"window_length": 11, name: quantity}
    plain, _ = recipe(lambda: algdiff.differentiate(X, return_std=True, **words), name)
    given = {name: quantity, "x": package.quantity(X, "cm"), "dt": package.quantity(20.0, "ms")}
    np.testing.assert_allclose(eval(plain, given), expected)  # noqa: S307


def test_bandwidths_are_rates(package: Package) -> None:
    bandwidth = package.quantity(5.0, "Hz")
    plain, _ = recipe(lambda: algdiff.suggest(X, bandwidth=bandwidth), "bandwidth")
    given = {"bandwidth": bandwidth, "dt": package.quantity(20.0, "ms")}
    assert eval(plain, given) == pytest.approx(0.005)  # noqa: S307


def test_columns_called_unit_are_no_units() -> None:
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({"unit": X, "value": X, "magnitude": X})
    np.testing.assert_array_equal(
        algdiff.differentiate(frame, 11, axis=0), algdiff.differentiate(frame.to_numpy(), 11, axis=0)
    )
    kind = type("Quantity", (), {"unit": None, "value": None})
    with pytest.raises(TypeError, match=r"^x carries units"):
        algdiff.differentiate(kind(), 11)  # type: ignore[arg-type]
