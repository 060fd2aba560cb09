"""What a suggestion says of itself: numbers, words and a picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import algdiff

Array = npt.NDArray[np.float64]
DELTA = 0.01
K = np.arange(2000)


def swing(seed: int, level: float | Array = 0.05) -> Array:
    return np.asarray(np.sin(1.5 * DELTA * K) + level * np.random.default_rng(seed).standard_normal(2000))


@pytest.mark.parametrize("deriv", [0, 1, 2, (0, 1)])
@pytest.mark.parametrize("delta", [1.0, 1e-3])
def test_parts_of_the_error(deriv: int | tuple[int, ...], delta: float) -> None:
    suggestion = algdiff.suggest(swing(0), deriv, delta=delta)
    assert suggestion.rmse**2 == pytest.approx(suggestion.noise**2 + suggestion.bias**2, rel=1e-12)
    curve = suggestion.curve
    np.testing.assert_allclose(curve.rmse**2, curve.noise**2 + curve.bias**2, rtol=1e-12)
    design = suggestion.differentiator
    here = (curve.window_length == design.window_length) & (curve.degree == design.degree)
    assert here.sum() == 1
    order = max(deriv) if isinstance(deriv, tuple) else deriv
    # The gain of a design is in its own unit; that of a window of means of three samples is all but the same.
    gain = design.replace(deriv=order).noise_gain
    assert curve.noise[here][0] == pytest.approx(suggestion.noise_level * np.sqrt(gain), rel=2e-3)
    # At the ends noise does more.
    assert suggestion.noise >= 0.99 * curve.noise[here][0]
    low, high = suggestion.noise_range
    assert low <= suggestion.noise_level * 1.02
    assert high >= suggestion.noise_level * 0.98
    assert (curve.degree >= order).all()
    assert not suggestion.local


def test_the_curve_of_averages_is_in_the_unit_of_the_samples() -> None:
    x = np.sin(K / 700) + 0.05 * np.random.default_rng(1).standard_normal(2000)
    long, short = algdiff.suggest(x), algdiff.suggest(x, max_window=401)
    assert long.differentiator.window_length > 740
    for one in (long, short):
        design, curve = one.differentiator, one.curve
        near = int(
            np.argmin(np.abs(curve.window_length - design.window_length) + 1e3 * (curve.degree != design.degree))
        )
        scale = (curve.window_length[near] / design.window_length) ** 1.5
        assert curve.noise[near] * scale == pytest.approx(0.05 * np.sqrt(design.noise_gain), rel=0.1)


@pytest.mark.parametrize("factor", [2.0, 5.0])
def test_a_level_that_rises(factor: float) -> None:
    suggestion = algdiff.suggest(swing(2, 0.05 * np.where(K < 1000, 1.0, factor)), delta=DELTA)
    low, high = suggestion.noise_range
    # Sixteenths of 2000 samples: standard errors of 10 percent each, the largest and the least of eight.
    assert low == pytest.approx(0.05, rel=0.3)
    assert high == pytest.approx(0.05 * factor, rel=0.3)
    said = f"Its level changes from {low:.3g} to {high:.3g} along the samples"
    assert (said in suggestion.explain()) == (high > 2 * low)
    assert factor == 2.0 or high > 2 * low


def test_the_first_words() -> None:
    suggestion = algdiff.suggest(swing(3), delta=DELTA)
    design, lines = suggestion.differentiator, suggestion.explain().splitlines()
    assert lines[:3] == [
        f"A window of {design.window_length} samples ({design.duration:.4g}) and degree {design.degree}, for the "
        "derivative of order 1, centered on the sample.",
        f"It is expected to err by {suggestion.rmse:.3g} (root mean square): noise {suggestion.noise:.3g}, "
        f"bias {suggestion.bias:.3g}.",
        f"The noise in the samples is {suggestion.noise_level:.3g}.",
    ]
    assert not any("multiples" in line or "shortest" in line or "asked" in line or "changes" in line for line in lines)


def test_words_of_several_orders() -> None:
    assert "for the derivative of order 2, centered" in algdiff.suggest(swing(3), (0, 2)).explain()


def test_words_of_a_delay() -> None:
    suggestion = algdiff.suggest(swing(4), delta=DELTA, max_delay=0.25, max_window=301)
    words = suggestion.explain()
    assert ", 0.25 behind the newest sample." in words
    assert "centered" not in words
    assert words.endswith("What was asked for: max_window = 301, max_delay = 0.25.")


def test_words_of_rounded_samples() -> None:
    rounded = np.rint(swing(5, 0.01) / 0.02) * 0.02
    suggestion = algdiff.suggest(rounded, delta=DELTA)
    assert suggestion.quantum == pytest.approx(0.02, rel=1e-9)
    assert "The samples are multiples of 0.02: rounding alone is a noise of 0.00577" in suggestion.explain()
    assert algdiff.suggest(swing(5)).quantum == 0
    # The unit of the samples is kept, whatever rows are divided by.
    rows = np.stack([rounded, 1e3 * rounded])
    assert algdiff.suggest(rows).quantum == pytest.approx(0.02, rel=1e-9)


def test_words_of_other_windows() -> None:
    suggestion = algdiff.suggest(swing(6), delta=DELTA)
    design, curve = suggestion.differentiator, suggestion.curve
    good = curve.window_length[(curve.rmse <= 1.1 * curve.rmse.min()) & (curve.degree == design.degree)]
    said = f"At this degree, windows from {good.min()} to {good.max()} samples would do within 10 percent"
    assert (said in suggestion.explain()) == (good.size > 1)


def test_words_of_the_shortest_window() -> None:
    said = "It is the shortest one that was compared: the samples may be too far apart for the signal."
    assert said in algdiff.suggest(np.random.default_rng(7).standard_normal(200), sigma=1e-6, degree=2).explain()
    assert said in algdiff.suggest(swing(7), max_window=3).explain()
    assert said not in algdiff.suggest(swing(7)).explain()


def test_words_of_coloured_noise() -> None:
    noise = np.convolve(np.random.default_rng(8).standard_normal(2200), np.ones(40) / 40, "valid")[:2000]
    white = 0.02 * np.random.default_rng(9).standard_normal(2000)
    suggestion = algdiff.suggest(np.sin(K / 300) + 0.1 * noise + white)
    said = f", at the scale of the window {suggestion.colour:.2g} times what it is from sample to sample."
    assert suggestion.colour >= 1
    assert (said in suggestion.explain()) == (suggestion.colour > 1)
    steps = np.random.default_rng(10).standard_normal(4000)
    correlated = np.empty(4000)
    correlated[0] = steps[0]
    for k in range(1, 4000):
        correlated[k] = 0.5 * correlated[k - 1] + steps[k]
    found = algdiff.suggest(correlated, 0, noise="ar1", degree=0, min_window=151)
    assert found.correlation == pytest.approx(0.5, abs=0.1)
    assert f", and coloured: neighbours correlate by {found.correlation:.2f}." in found.explain()


def test_repr() -> None:
    suggestion = algdiff.suggest(swing(11), delta=DELTA)
    assert repr(suggestion) == (
        f"Suggestion({suggestion.differentiator!r}, rmse={suggestion.rmse:.4g}, "
        f"noise_level={suggestion.noise_level:.4g})"
    )


@pytest.mark.parametrize("deriv", [1, (0, 2)])
def test_plot(deriv: int | tuple[int, ...]) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    figure = pytest.importorskip("matplotlib.figure").Figure()
    ax = figure.subplots()
    suggestion = algdiff.suggest(swing(12), deriv, delta=DELTA)
    assert suggestion.plot(ax) is ax
    labels = [line.get_label() for line in ax.get_lines()]
    degrees = np.unique(suggestion.curve.degree)
    assert labels == [*(f"degree {one}" for one in degrees), "its noise", "its bias", "chosen, ends included"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == labels
    lines = dict(zip(labels, ax.get_lines(), strict=True))
    curve, design = suggestion.curve, suggestion.differentiator
    for degree in degrees:
        mine = curve.degree == degree
        np.testing.assert_array_equal(lines[f"degree {degree}"].get_xdata(), curve.window_length[mine])
        np.testing.assert_array_equal(lines[f"degree {degree}"].get_ydata(), curve.rmse[mine])
    mine = curve.degree == design.degree
    np.testing.assert_array_equal(lines["its noise"].get_ydata(), curve.noise[mine])
    assert (np.asarray(lines["its bias"].get_ydata()) > 0).all()
    star = lines["chosen, ends included"]
    assert (star.get_xdata()[0], star.get_ydata()[0]) == (design.window_length, suggestion.rmse)
    assert ax.get_xscale() == ax.get_yscale() == "log"
    low, high = ax.get_ylim()
    assert low < star.get_ydata()[0] < high
    assert ax.get_ylabel().endswith(f"of order {max(deriv) if isinstance(deriv, tuple) else deriv}")
    figure.canvas.draw()


def test_plot_makes_its_own_axes() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    ax = algdiff.suggest(np.zeros(100)).plot()
    assert ax.get_lines()
    pyplot.close(ax.figure)
