"""Pictures: what their lines hold, what their axes say, and what they leave alone."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import algdiff
from support import design

figures = pytest.importorskip("matplotlib.figure")

DESIGNS = [
    design(51, fs=1000),
    design(41, 2, degree=4, tau="root", kappa=0, mu=2, delta=0.1),
    design(40, 0, kappa=2.5, mu=2.5),
    design(60, 1, rule="hat", trim=0.02, kappa=3, mu=3, fs=200),
    design(51, 3, rule="simpson", tau="newest"),
    design(30, 1, kappa=-0.7, mu=-0.2, tau=1.4, delta=1e-4),
    design(1000, 1, kappa=10, mu=10, fs=1e6),
    design(1, 0, degree=0),
    design(51, 1, delta=1e-120),
    design(101, 1, kappa=1e4, mu=1e4),
]
KERNELS = [algdiff.Kernel(1), algdiff.Kernel(2, 4, 0, 2, "root"), algdiff.Kernel(1, 1, -0.5, -0.5, "newest")]


def with_label(ax: Any, start: str) -> Any:
    (line,) = [line for line in ax.lines if line.get_label().startswith(start)]
    return line


def check_labels(ax: Any) -> None:
    for label in (ax.get_xlabel(), ax.get_ylabel()):
        assert label.strip()
    assert ax.get_legend() is not None


@pytest.mark.parametrize("each", DESIGNS, ids=repr)
def test_weights_are_drawn_at_the_times_of_their_samples(each: algdiff.Differentiator) -> None:
    ax = figures.Figure().subplots()
    assert algdiff.plot_kernel(each, ax) is ax
    times, values = with_label(ax, "weights").get_data()
    np.testing.assert_array_equal(values, each.weights)
    np.testing.assert_allclose(times, each.delta * (np.arange(each.weights.size) - each.weights.size + 1), atol=1e-15)
    assert with_label(ax, "delay").get_xdata() == [-each.delay, -each.delay]
    check_labels(ax)


@pytest.mark.parametrize("each", DESIGNS[:4], ids=repr)
def test_the_kernel_runs_through_the_weights(each: algdiff.Differentiator) -> None:
    ax = algdiff.plot_kernel(each, figures.Figure().subplots())
    times, kernel = with_label(ax, "kernel").get_data()
    stamps, weights = with_label(ax, "weights").get_data()
    assert times[-1] - times[0] == pytest.approx(each.duration)
    # The distance is that of the rule from the kernel: of second order in 1/L, with room for degree 4.
    inner = slice(2, -2)
    miss = np.abs(np.interp(stamps, times, kernel) - weights)[inner].max()
    assert miss < 30 / weights.size**2 * np.abs(weights).max() + 0.03 * np.abs(weights).max() * (each.kappa == 0)


@pytest.mark.parametrize("each", KERNELS, ids=repr)
def test_a_kernel_is_drawn_over_its_window(each: algdiff.Kernel) -> None:
    ax = algdiff.plot_kernel(each, figures.Figure().subplots())
    points, values = with_label(ax, "kernel").get_data()
    assert (points[0], points[-1]) == (0, 1)
    finite = np.isfinite(values)
    assert finite[1:-1].all()
    np.testing.assert_array_equal(values[finite], each(points[finite]))
    assert with_label(ax, "tau").get_xdata() == [each.tau, each.tau]
    check_labels(ax)


@pytest.mark.parametrize("each", DESIGNS, ids=repr)
def test_the_response_is_that_of_the_weights(each: algdiff.Differentiator) -> None:
    ax = figures.Figure().subplots()
    assert algdiff.plot_response(each, ax) is ax
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    check_labels(ax)
    frequency, amplitude = with_label(ax, "weights").get_data()
    nyquist = 0.5 * each.fs
    assert frequency[-1] == pytest.approx(nyquist)
    assert np.all(np.diff(frequency) > 0)
    np.testing.assert_array_equal(amplitude, np.abs(each.frequency_response(frequency)))
    ideal = with_label(ax, "ideal derivative").get_ydata()
    np.testing.assert_allclose(ideal, (2 * np.pi * frequency) ** each.deriv, rtol=1e-14)
    np.testing.assert_allclose(
        with_label(ax, "kernel").get_ydata(),
        np.abs(each.kernel.frequency_response(2 * np.pi * each.duration * frequency)) / each.duration**each.deriv,
        rtol=1e-13,
    )
    bounds = each.asymptotes(frequency)
    beyond, upper = with_label(ax, "upper asymptote").get_data()
    np.testing.assert_array_equal(upper, bounds.upper[np.isin(frequency, beyond)])
    assert beyond.min() > each.cutoff if each.cutoff is not None and beyond.size else True
    for name, value in (("cutoff", each.cutoff), ("-3 dB", each.half_power), ("Nyquist", nyquist)):
        if value is not None and value <= nyquist:
            assert with_label(ax, name).get_xdata() == [value, value]
            assert f"{value:.4g}" in with_label(ax, name).get_label()
        else:
            assert not [line for line in ax.lines if line.get_label().startswith(name)]
    left, right = ax.get_xlim()
    assert left < frequency[-1] < right
    bottom, top = ax.get_ylim()
    assert 0 < bottom < amplitude.max() < top


def test_what_a_kernel_without_a_cutoff_lacks_is_not_drawn() -> None:
    # At this tau the kernel of degree 1 vanishes at its newest end.
    each = design(51, 0, degree=1, kappa=1, mu=0, tau=0.5)
    assert each.cutoff is None
    ax = algdiff.plot_response(each, figures.Figure().subplots())
    labels = [line.get_label() for line in ax.lines]
    assert "weights" in labels
    assert "low-pass model" not in labels
    assert not any(label.startswith("cutoff") for label in labels)


def test_the_response_is_drawn_from_far_below_the_cutoff_and_densely() -> None:
    for each in (design(51, fs=1000), design(400, 2, fs=50), design(2001, 1, delta=0.1)):
        ax = algdiff.plot_response(each, figures.Figure().subplots())
        frequency = with_label(ax, "weights").get_xdata()
        assert ax.get_xlim()[0] == frequency[0] == pytest.approx(0.05 / each.duration)
        assert frequency[-1] == pytest.approx(0.5 * each.fs)
        assert np.diff(frequency).max() <= 0.25 / each.duration  # a lobe is 1 / T wide


def test_a_step_response_holds_its_value_until_the_next_sample() -> None:
    each = design(21, fs=100)
    step = algdiff.plot_design(each, figures.Figure())[1]
    assert with_label(step, "response").get_drawstyle() == "steps-post"


@pytest.mark.parametrize(("count", "dotted"), [(400, True), (401, False)])
def test_very_many_weights_are_a_line(count: int, dotted: bool) -> None:
    ax = algdiff.plot_kernel(design(count), figures.Figure().subplots())
    line = with_label(ax, "weights")
    assert (line.get_marker() == ".", line.get_linestyle() == "None") == (dotted, dotted)


def test_weights_that_are_all_zero_can_be_drawn() -> None:
    each = design(2, 0, degree=0, rule="trapezoid")
    assert not each.weights.any()
    ax = algdiff.plot_response(each, figures.Figure().subplots())
    assert not with_label(ax, "weights").get_ydata().any()


@pytest.mark.parametrize("each", DESIGNS, ids=repr)
def test_the_page_holds_the_three_pictures_and_the_whole_table(each: algdiff.Differentiator) -> None:
    figure = figures.Figure(figsize=(8.27, 11.69), layout="constrained")
    axes = algdiff.plot_design(each, figure)
    assert isinstance(axes, np.ndarray)
    assert axes.shape == (4,)
    assert list(axes) == figure.axes
    weights, step, response, table = axes
    for ax in (weights, step, response):
        check_labels(ax)
        assert ax.get_title()
    np.testing.assert_array_equal(with_label(weights, "weights").get_ydata(), each.weights)
    times, values = with_label(step, "response").get_data()
    np.testing.assert_array_equal(values, each.step_response(times))
    np.testing.assert_allclose(values[2:-2], np.cumsum(each.weights[::-1]), rtol=1e-12, atol=1e-12 * each.norm1)
    assert with_label(step, "delay").get_xdata() == [each.delay, each.delay]
    shown = "\n".join(text.get_text() for text in table.texts)
    assert [line.split()[0] for line in shown.splitlines()] == list(each.summary())
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in table.texts]
    assert boxes[0].x1 < boxes[1].x0, "the columns overlap"
    for box in boxes:
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0
        assert box.y1 <= response.get_window_extent().y0, "the table runs into the response"


def test_units_are_those_of_the_step() -> None:
    figure = figures.Figure()
    weights, _, response, _ = algdiff.plot_design(design(21, 2, fs=100), figure)
    assert (weights.get_xlabel(), weights.get_ylabel()) == ("time from the newest sample, s", "weight, s$^{-2}$")
    assert response.get_xlabel() == "frequency, Hz"
    weights, step, response, _ = algdiff.plot_design(design(21), figures.Figure())
    assert step.get_xlabel() == "time since the step, samples"
    assert response.get_xlabel() == "frequency, cycles/sample"
    assert response.get_ylabel() == "amplitude, 1/sample"


def test_a_subfigure_will_do() -> None:
    left, right = figures.Figure(figsize=(16, 11)).subfigures(1, 2)
    for half in (left, right):
        assert len(algdiff.plot_design(DESIGNS[0], half)) == 4
        assert len(half.axes) == 4


@pytest.mark.parametrize("wrong", [None, 5, "design", [1.0]])
def test_what_is_no_design_is_refused(wrong: Any) -> None:
    for draw in (algdiff.plot_response, algdiff.plot_design):
        with pytest.raises(TypeError, match="design must be a Differentiator, got"):
            draw(wrong)
    with pytest.raises(TypeError, match="design_or_kernel must be a Differentiator or a Kernel, got"):
        algdiff.plot_kernel(wrong)
    with pytest.raises(TypeError, match="design must be a Differentiator, got"):
        algdiff.plot_response(KERNELS[0])  # type: ignore[arg-type]


def test_what_is_no_axes_is_refused() -> None:
    for draw in (algdiff.plot_kernel, algdiff.plot_response):
        with pytest.raises(TypeError, match="ax must be a matplotlib Axes, got"):
            draw(DESIGNS[0], figures.Figure())
    with pytest.raises(TypeError, match="figure must be a matplotlib Figure, got"):
        algdiff.plot_design(DESIGNS[0], figures.Figure().subplots())


@pytest.mark.parametrize("draw", [algdiff.plot_kernel, algdiff.plot_response, algdiff.plot_design])
def test_by_default_pyplot_gets_a_new_figure(draw: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    before = pyplot.get_fignums()
    figure = np.ravel(draw(DESIGNS[0]))[0].figure
    try:
        assert [pyplot.figure(number) for number in pyplot.get_fignums() if number not in before] == [figure]
    finally:
        pyplot.close(figure)


@pytest.mark.parametrize("draw", [algdiff.plot_kernel, algdiff.plot_response, algdiff.plot_design])
def test_without_matplotlib_the_error_names_the_extra(draw: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("matplotlib", "matplotlib.pyplot", "matplotlib.axes", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r"pictures need matplotlib: pip install 'algdiff-rs\[plot\]'"):
        draw(DESIGNS[0])


def test_with_axes_given_pyplot_stays_out_and_no_display_is_needed() -> None:
    code = """
import sys, io, algdiff
assert not [name for name in sys.modules if name.startswith("matplotlib")]
from matplotlib.figure import Figure
d = algdiff.Differentiator(51, fs=1000)
figure = Figure()
algdiff.plot_kernel(d, figure.subplots())
algdiff.plot_response(d, figure.subplots())
algdiff.plot_design(d, Figure()).item(0).figure.savefig(io.BytesIO(), format="png")
assert "matplotlib.pyplot" not in sys.modules
algdiff.plot_kernel(d).figure.savefig(io.BytesIO(), format="svg")
"""
    bare = {
        name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=bare, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
