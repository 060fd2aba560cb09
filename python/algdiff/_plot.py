"""Pictures of kernels and designs. Matplotlib is imported on use."""

from __future__ import annotations

import math
import re
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from algdiff import _report as report
from algdiff._differentiator import Differentiator
from algdiff._kernel import Kernel
from algdiff._orders import single
from algdiff._refusals import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

A4 = (8.27, 11.69)
DOTTED = 400
"""More weights than this are drawn as a line without a dot for each."""
FLOOR = 1e-7
"""Amplitudes below this share of the largest are left out of the picture."""


def plot_kernel(design_or_kernel: Differentiator | Kernel, ax: Axes | None = None) -> Axes:
    """Draw a kernel, or the weights of a design over its kernel.

    Parameters
    ----------
    design_or_kernel : Differentiator or Kernel
        Weights are drawn at the times of their samples, 0 being that of the newest; a kernel over its window, [0, 1].
    ax : matplotlib Axes, optional
        Where to draw; by default a new figure of pyplot.

    Returns
    -------
    Axes
        With the lines "kernel" (of a design: scaled to a sample's share) and "weights", and an upright one at the point
        of the estimate.

    Raises
    ------
    ImportError
        Matplotlib is not installed.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> import algdiff
    >>> from matplotlib.figure import Figure
    >>> d = algdiff.Differentiator(51, tau="root", fs=1000)
    >>> ax = algdiff.plot_kernel(d, Figure().subplots())
    >>> [line.get_label() for line in ax.lines[:3]], ax.get_xlabel()
    (['kernel', 'weights', 'delay 0.01028 s'], 'time from the newest sample, s')
    """
    if not isinstance(design_or_kernel, (Differentiator, Kernel)):
        raise TypeError(f"design_or_kernel must be a Differentiator or a Kernel, got {shown(design_or_kernel)}")
    if isinstance(design_or_kernel, Differentiator):
        single("a picture", design_or_kernel)
    ax = _axes(ax)
    points = np.concatenate(([0.0], (np.arange(1000) + 0.5) / 1000, [1.0]))
    if isinstance(design_or_kernel, Kernel):
        _draw_kernel(ax, points, design_or_kernel)
    else:
        _draw_weights(ax, points, design_or_kernel)
    _finish_linear(ax)
    return ax


def plot_response(design: Differentiator, ax: Axes | None = None) -> Axes:
    """Draw how strongly a design passes each frequency, up to half the sampling rate.

    Parameters
    ----------
    design : Differentiator
        The design.
    ax : matplotlib Axes, optional
        Where to draw; by default a new figure of pyplot.

    Returns
    -------
    Axes
        Logarithmic in both directions, with the lines "weights" and "kernel" (amplitudes of the responses), "ideal
        derivative", "low-pass model" and "upper asymptote" (`Differentiator.asymptotes`), and upright ones at the
        cutoff, the -3 dB point and the Nyquist frequency.

    Raises
    ------
    ImportError
        Matplotlib is not installed.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> import algdiff
    >>> from matplotlib.figure import Figure
    >>> ax = algdiff.plot_response(algdiff.Differentiator(51, fs=1000), Figure().subplots())
    >>> [line.get_label() for line in ax.lines if line.get_label().startswith(("cutoff", "-3 dB"))]
    ['cutoff 18.55 Hz', '-3 dB 27.6 Hz']
    """
    _check(design)
    ax = _axes(ax)
    nyquist = 0.5 * design.fs
    lowest = min(0.05 / design.duration, 0.1 * nyquist)
    lobes = np.linspace(lowest, nyquist, min(16 * design.weights.size, 8192))
    _draw_amplitudes(ax, design, np.union1d(np.geomspace(lowest, nyquist, 512), lobes))
    _mark_frequencies(ax, design, nyquist)
    ax.set_xlim(lowest, 1.15 * nyquist)
    ax.set(xlabel=f"frequency, {report.time_units(design)[1]}", ylabel=_with_unit("amplitude", design))
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")
    return ax


def plot_design(design: Differentiator, figure: Figure | None = None) -> NDArray[np.object_]:
    """Draw a design on one page: weights, step response, frequency response and the table of its summary.

    Parameters
    ----------
    design : Differentiator
        The design.
    figure : matplotlib Figure, optional
        An empty figure or subfigure to draw in; by default a new A4 page of pyplot.

    Returns
    -------
    ndarray of Axes, shape (4,)
        Weights, step response, frequency response, table.

    Raises
    ------
    ImportError
        Matplotlib is not installed.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> import algdiff
    >>> from matplotlib.figure import Figure
    >>> axes = algdiff.plot_design(algdiff.Differentiator(51, fs=1000), Figure())
    >>> [ax.get_title() for ax in axes]
    ['Weights', 'Response to a unit step', 'Frequency response', '']
    """
    _check(design)
    if figure is None:
        figure = _matplotlib("matplotlib.pyplot").figure(figsize=A4, layout="constrained")
    elif not isinstance(figure, _matplotlib("matplotlib.figure").FigureBase):
        raise TypeError(f"figure must be a matplotlib Figure, got {shown(figure)}")
    what = f"{design.window_length} samples, degree {design.degree}, rule {design.rule}"
    figure.suptitle(f"Derivative of order {design.deriv}: {what}")
    grid = figure.add_gridspec(3, 2, height_ratios=(3, 4.6, 2.1))
    spaces = (grid[0, 0], grid[0, 1], grid[1, :], grid[2, :])
    weights, step, response, numbers = (figure.add_subplot(space) for space in spaces)
    plot_kernel(design, weights).set_title("Weights")
    _draw_step(step, design)
    plot_response(design, response).set_title("Frequency response")
    _draw_table(numbers, design)
    axes = np.empty(4, object)
    axes[:] = weights, step, response, numbers
    return axes


def _matplotlib(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(f"pictures need matplotlib: pip install 'algdiff-rs[plot]' ({error})") from error


def _axes(ax: Axes | None) -> Axes:
    if ax is None:
        made: Axes = _matplotlib("matplotlib.pyplot").subplots(layout="constrained")[1]
        return made
    kind: type[Axes] = _matplotlib("matplotlib.axes").Axes
    if not isinstance(ax, kind):
        raise TypeError(f"ax must be a matplotlib Axes, got {shown(ax)}")
    return ax


def _check(design: object) -> None:
    if not isinstance(design, Differentiator):
        raise TypeError(f"design must be a Differentiator, got {shown(design)}")
    single("a picture", design)


def _draw_kernel(ax: Axes, points: NDArray[np.float64], kernel: Kernel) -> None:
    ax.plot(points, _finite(kernel(points)), color="C1", label="kernel")
    ax.axvline(kernel.tau, color="C3", linestyle="--", linewidth=1, label=f"tau {kernel.tau:.4g}")
    ax.set(xlabel="point of the window, from its oldest to its newest end", ylabel="kernel of a window of length 1")


def _draw_weights(ax: Axes, points: NDArray[np.float64], design: Differentiator) -> None:
    share = design.delta / design.duration / design.duration**design.deriv
    times = (points - design.tau) * design.duration - design.delay
    ax.plot(times, _finite(share * design.kernel(points)), color="C1", linewidth=1, label="kernel")
    count = design.weights.size
    dots: dict[str, Any] = {"marker": ".", "linestyle": "", "markersize": 5 if count <= 100 else 3}
    stamps = design.delta * np.arange(1 - count, 1)
    ax.plot(stamps, design.weights, color="C0", label="weights", **(dots if count <= DOTTED else {}))
    unit = report.time_units(design)[0]
    ax.axvline(-design.delay, color="C3", linestyle="--", linewidth=1, label=f"delay {design.delay:.4g} {unit}")
    ax.set(xlabel=f"time from the newest sample, {unit}", ylabel=_with_unit("weight", design))


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isfinite(values), values, np.nan)


def _draw_amplitudes(ax: Axes, design: Differentiator, frequency: NDArray[np.float64]) -> None:
    """Draw the responses and their asymptotes, and choose amplitudes that show them."""
    bounds = design.asymptotes(frequency)
    amplitude = np.abs(design.frequency_response(frequency))
    kernel = np.abs(design.kernel.frequency_response(2 * math.pi * design.duration * frequency))
    ideal = (2 * math.pi * frequency) ** design.deriv
    ax.loglog(frequency, amplitude, color="C0", label="weights", zorder=3)
    ax.loglog(frequency, kernel / design.duration**design.deriv, color="C1", linewidth=0.8, label="kernel")
    ax.loglog(frequency, ideal, color="0.4", linestyle="--", linewidth=1, label="ideal derivative")
    cutoff = design.cutoff
    if cutoff is not None:
        ax.loglog(frequency, bounds.low_pass, color="C2", linewidth=1.2, label="low-pass model")
    beyond = frequency > (0 if cutoff is None else cutoff)
    ax.loglog(
        frequency[beyond], bounds.upper[beyond], color="C2", linestyle=":", linewidth=1.2, label="upper asymptote"
    )
    top = float(amplitude.max() or ideal.max())
    floor = min(0.3 * ideal[0], 0.3 * amplitude[0], 0.01 * np.nan_to_num(bounds.upper[-1], posinf=top))
    ax.set_ylim(max(FLOOR * top, float(floor)), 4 * top)


def _mark_frequencies(ax: Axes, design: Differentiator, nyquist: float) -> None:
    unit = report.time_units(design)[1]
    marks = (("cutoff", design.cutoff, "C3", "-."), ("-3 dB", design.half_power, "C4", "--"))
    for name, frequency, color, style in (*marks, ("Nyquist", nyquist, "0.2", "-")):
        if frequency is not None and frequency <= nyquist:
            ax.axvline(frequency, color=color, linestyle=style, linewidth=1, label=f"{name} {frequency:.4g} {unit}")


def _draw_step(ax: Axes, design: Differentiator) -> None:
    index = np.arange(-2, design.weights.size + 2)
    times = design.delta * index
    ax.plot(times, design.step_response(times), color="C0", drawstyle="steps-post", label="response")
    unit = report.time_units(design)[0]
    ax.axvline(design.delay, color="C3", linestyle="--", linewidth=1, label=f"delay {design.delay:.4g} {unit}")
    ax.set(xlabel=f"time since the step, {unit}", ylabel=_with_unit("estimate", design))
    ax.set_title("Response to a unit step")
    _finish_linear(ax)


def _draw_table(ax: Axes, design: Differentiator) -> None:
    ax.set_axis_off()
    lines = report.table(design).splitlines()
    half = -(-len(lines) // 2)
    style: dict[str, Any] = {"family": "monospace", "fontsize": 8.5, "va": "top", "transform": ax.transAxes}
    for place, column in ((0.0, lines[:half]), (0.51, lines[half:])):
        ax.text(place, 1.0, "\n".join(column), linespacing=1.35, **style)


def _with_unit(name: str, design: Differentiator) -> str:
    """Return a label with the unit of the estimate per unit of the signal, powers of it raised."""
    unit = re.sub(r"\^(-?\d+)", r"$^{\1}$", report.power(design, -design.deriv))
    return f"{name}, {unit}" if unit else name


def _finish_linear(ax: Axes) -> None:
    """Add a zero line, a grid, and a legend with room for it."""
    ax.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    ax.grid(alpha=0.3)
    bottom, top = ax.get_ylim()
    ax.set_ylim(bottom, top + 0.16 * (top - bottom))
    ax.legend(loc="upper center", ncols=3, fontsize="x-small", handlelength=1.5, columnspacing=1.2)
