"""A design in numbers: the summary, and the table that people read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator

Summary = dict[str, str | int | float | None]

UNITS = {
    "window_length": "samples",
    "delta": "s",
    "fs": "Hz",
    "duration": "s",
    "delay": "s",
    "delay_samples": "samples",
    "moment_delay": "s",
    "cutoff": "Hz",
    "half_power": "Hz",
    "roll_off": "dB per decade",
    "nyquist_attenuation": "dB",
}
"""Of the quantities whose unit does not depend on `deriv`; those without a unit are left out."""


def summary(design: Differentiator) -> Summary:
    """Return the dictionary of `Differentiator.summary`."""
    values: dict[str, str | float | None] = {
        "window_length": design.window_length,
        "weight_count": design.weights.size,
        "deriv": design.deriv,
        "degree": design.degree,
        "kappa": design.kappa,
        "mu": design.mu,
        "tau": design.tau,
        "rule": design.rule,
        "trim": design.trim,
        "delta": design.delta,
        "fs": design.fs,
        "duration": design.duration,
        "delay": design.delay,
        "delay_samples": design.delay_samples,
        "moment_delay": design.moment_delay,
        "exactness": design.exactness,
        "noise_gain": design.noise_gain,
        "norm1": design.norm1,
        "bias_order": design.bias_order,
        "bias_constant": design.bias_constant,
        "bias_bound": design.bias_bound,
        "cutoff": design.cutoff,
        "half_power": design.half_power,
        "roll_off": 20 * design.kernel.roll_off,
        "nyquist_attenuation": design.nyquist_attenuation,
        "discretisation_error": design.discretisation_error(),
    }
    return {name: plain(value) for name, value in values.items()}


def plain(value: str | float | None) -> str | int | float | None:
    """Return what JSON can hold: None for what is not a finite number."""
    if value is None or isinstance(value, (str, int)):
        return value
    return float(value) if math.isfinite(value) else None


def unit(name: str, design: Differentiator) -> str:
    """Return the unit of a quantity of the summary, with `delta` in seconds; a step of 1 is a sample."""
    powers = {"noise_gain": -2 * design.deriv, "norm1": -design.deriv}
    powers["bias_constant"] = powers["bias_bound"] = design.bias_order
    if name in powers:
        return power(design, powers[name])
    time, frequency = time_units(design)
    asked = UNITS.get(name, "")
    return {"s": time, "Hz": "" if name == "fs" and design.delta == 1 else frequency}.get(asked, asked)


def time_units(design: Differentiator) -> tuple[str, str]:
    """Return the units of time and of frequency."""
    return ("samples", "cycles/sample") if design.delta == 1 else ("s", "Hz")


def power(design: Differentiator, exponent: int) -> str:
    """Return a power of the unit of time."""
    time = "sample" if design.delta == 1 else "s"
    return {0: "", 1: time, -1: f"1/{time}"}.get(exponent, f"{time}^{exponent}")


def table(design: Differentiator) -> str:
    """Return the summary as lines of name, value to six digits and unit."""
    return "\n".join(
        f"{name:<22}{shown(value):<14}{unit(name, design)}".rstrip() for name, value in summary(design).items()
    )


def shown(value: str | float | None) -> str:
    return "none" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
