"""Properties of estimates, for any design and any samples: what must not matter, and what must come out."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from ladder_calls import laid_out
from properties import INSIDE, PADS, RULES, Array, Made, close, designs, examples, off, same, samples, window
from support import EPS, design

ENGINES = ("direct", "fft", "auto")
modes = st.sampled_from([*INSIDE, *PADS])
signs = st.sampled_from([1.0, -1.0])


def long_enough(mode: str, made: Made) -> int:
    """Return how many samples a call needs."""
    return made.d.window_length if mode in INSIDE else 1


@examples(30)
@given(designs(), st.data())
def test_polynomials_come_back_at_every_sample(made: Made, data: st.DataObject) -> None:
    d, rng = made.d, np.random.default_rng(data.draw(st.integers(0, 2**32)))
    n = d.window_length + data.draw(st.integers(0, 30))
    polynomial = np.polynomial.Legendre(rng.standard_normal(d.degree + 1), domain=[0, max(n - 1, 1)])
    x = polynomial(np.arange(n))
    wanted = (polynomial.deriv(d.deriv) if d.deriv else polynomial)(np.arange(n)) / d.delta**d.deriv
    # Legendre values err by about degree^2 eps of the coefficients, here and in the derivatives, which are larger.
    size = np.abs(polynomial.coef).sum() * 8 * (d.degree + 1) ** 2 * EPS
    rounding = size * (np.abs(window(made).weights("fit")[1]).sum() + (2 * d.degree**2 / (n * d.delta)) ** d.deriv)
    tilt = np.abs(made.again(tau=1 - 0.5 / d.window_length).weights).sum() + d.norm1
    tilt += np.abs(made.again(tau=0.5 / d.window_length).weights).sum()
    close(d(x), wanted, off(made, x, "fit") + rounding + size * tilt)


@examples(30)
@given(designs(), st.data())
def test_valid_estimates_are_exact_at_tau_to_the_stated_degree(made: Made, data: st.DataObject) -> None:
    d, rng = made.d, np.random.default_rng(data.draw(st.integers(0, 2**32)))
    assume(d.exactness < d.window_length)
    n, middle = d.window_length + 5, (d.window_length + 4) / 2
    power = data.draw(st.integers(0, d.exactness))
    half, at = max(middle, abs(d.window_length - 0.5 - d.delay_samples) + 6), np.arange(n) - middle
    polynomial = np.polynomial.Polynomial.basis(power)(np.polynomial.Polynomial([rng.uniform(-1, 1), 1]))
    x = polynomial(at / half)
    late = (at[d.window_length - 1 :] - d.delay_samples) / half
    wanted = polynomial.deriv(d.deriv)(late) / (half * d.delta) ** d.deriv if d.deriv else polynomial(late)
    # Powers of at most 3 in size, to some eps each; tau itself is known to some eps.
    slope = 3.0**power * (power + 1.0) ** (d.deriv + 1) / (half * d.delta) ** d.deriv
    close(d(x, mode="valid"), wanted, off(made, x) + 64 * EPS * (3.0**power * d.norm1 + slope))


@examples(30)
@given(designs(rules=RULES), modes, st.floats(-8, 8), st.data())
def test_linearity(made: Made, mode: str, factor: float, data: st.DataObject) -> None:
    x = data.draw(samples(long_enough(mode, made), dtype=np.float64))
    y = np.random.default_rng(len(x)).standard_normal(len(x))
    both = made.d(x + factor * y, mode=mode)
    # What is added is rounded before it is differentiated, which counts as the rounding of one sample more.
    allowed = sum(off(made, z, mode) for z in (x + factor * y, x, y * factor)) + 4 * abs(factor) * off(made, y, mode)
    plain = EPS * np.abs(window(made).weights(mode)[1]).sum() * (np.abs(x).max() + abs(factor) * np.abs(y).max())
    ends = plain + sum(np.abs(made.again(tau=tau, rule=made.d.rule).weights).sum() for tau in (0.0, 1.0)) * plain
    close(both, made.d(x, mode=mode) + factor * made.d(y, mode=mode), allowed + plain + ends)


@examples(30)
@given(designs(), st.data())
def test_time_reversed_exchanges_the_exponents(made: Made, data: st.DataObject) -> None:
    d, x = made.d, data.draw(samples(made.d.window_length))
    mirrored = made.again(tau=1 - d.tau, kappa=d.mu, mu=d.kappa)
    wanted = (-1) ** d.deriv * d(x[::-1], mode="valid")[::-1]
    # 1 - tau is rounded, by which the estimate moves along the fit.
    moved = 8 * EPS * d.norm1 * 4 * (d.degree + 1) ** 2 * float(np.abs(x).max()) * d.window_length
    close(mirrored(x, mode="valid"), wanted, 2 * off(made, x[::-1])[::-1] + moved)


@examples(30)
@given(designs(rules=RULES), st.data())
def test_direct_knows_neither_the_place_nor_the_neighbours(made: Made, data: st.DataObject) -> None:
    x = data.draw(samples(2 * made.d.window_length))
    start = data.draw(st.integers(0, len(x) - made.d.window_length))
    stop = data.draw(st.integers(start + made.d.window_length, len(x)))
    same(made.d(x[start:stop], mode="valid"), made.d(x, mode="valid")[start : stop - made.d.window_length + 1])


@examples(30)
@given(designs(rules=RULES), st.sampled_from(ENGINES), st.data())
def test_any_cut_gives_the_whole(made: Made, engine: str, data: st.DataObject) -> None:
    d = made.again(engine=engine)
    x, span = data.draw(samples(d.window_length, more=200)), d.window_length
    outputs = len(x) - span + 1
    cuts = sorted({0, outputs, *data.draw(st.lists(st.integers(0, outputs), max_size=5))})
    parts = [d(x[a : b + span - 1], mode="valid") for a, b in pairwise(cuts)]
    close(np.concatenate(parts), d(x, mode="valid"), 0 if engine == "direct" else 2 * off(Made(d, made.words), x))


@examples(30)
@given(designs(rules=RULES), st.sampled_from(ENGINES), modes, st.integers(-30, 30), signs, st.data())
def test_powers_of_two_scale_every_bit(
    made: Made, engine: str, mode: str, exponent: int, sign: float, data: st.DataObject
) -> None:
    d, x = made.again(engine=engine), data.draw(samples(long_enough(mode, made)))
    factor = x.dtype.type(sign * 2.0**exponent)
    same(d(factor * x, mode=mode, cval=3.0 * float(factor)), factor * d(x, mode=mode, cval=3.0))


@examples(30)
@given(designs(rules=RULES), modes, st.integers(-20, 20), st.floats(0.01, 100), st.data())
def test_a_step_is_a_unit(made: Made, mode: str, exponent: int, ratio: float, data: st.DataObject) -> None:
    d, x = made.d, data.draw(samples(long_enough(mode, made)))
    scaled = made.again(delta=d.delta * 2.0**exponent)
    same(scaled(x, mode=mode), d(x, mode=mode) * x.dtype.type(2.0 ** (-exponent * d.deriv)))
    wanted, own = d(x, mode=mode).astype(float) * ratio**-d.deriv, 2 * off(made, x, mode) * ratio**-d.deriv
    powers = 8 * (d.deriv + 1) * float(np.finfo(x.dtype).eps) * np.abs(np.nan_to_num(wanted))
    close(made.again(delta=d.delta * ratio)(x, mode=mode), wanted, own + powers)


@examples(30)
@given(designs(rules=RULES), modes, st.sampled_from([np.complex64, np.complex128]), st.data())
def test_complex_samples_are_two_real_ones(made: Made, mode: str, dtype: Any, data: st.DataObject) -> None:
    x, y = data.draw(samples(long_enough(mode, made), shape=(2,)))
    z, real = (x + 1j * y).astype(dtype), np.float32 if dtype is np.complex64 else np.float64
    found = made.d(z, mode=mode, cval=2 - 1j)
    same(found.real, made.d(z.real.astype(real), mode=mode, cval=2.0))
    same(found.imag, made.d(z.imag.astype(real), mode=mode, cval=-1.0))


@examples(30)
@given(designs(rules=RULES), modes, st.integers(1, 20), st.integers(0, 2), st.data())
def test_columns_and_layouts_do_not_matter(made: Made, mode: str, rows: int, axis: int, data: st.DataObject) -> None:
    x = data.draw(samples(long_enough(mode, made), shape=(2, rows)))
    wanted = np.stack([[made.d(row, mode=mode) for row in part] for part in x])
    layout = data.draw(st.sampled_from(["C", "F", "strided", "reversed", "field", "misaligned", "readonly"]))
    turned = laid_out(np.moveaxis(x, -1, axis), layout)
    order = data.draw(st.sampled_from("<>"))
    for given_ in (turned, turned.astype(turned.dtype.newbyteorder(order))):
        same(np.moveaxis(made.d(given_, axis, mode=mode), axis, -1), wanted)


@examples(30)
@given(designs(deriv=(0, 2, 1)), modes, st.data())
def test_several_orders_are_each_alone(made: Made, mode: str, data: st.DataObject) -> None:
    x = data.draw(samples(long_enough(mode, made)))
    found = made.d(x, mode=mode)
    for order, part, one in zip(made.words["deriv"], found, made.d.orders, strict=True):
        alone = made.again(deriv=order)
        same(part, alone(x, mode=mode))
        assert one == alone
        assert hash(one) == hash(alone)


@examples(30)
@given(designs(rules=("exact", "cell", "hat")), modes, st.sampled_from(ENGINES), st.floats(-1e30, 1e30), st.data())
def test_a_constant_is_exactly_zero_or_itself(
    made: Made, mode: str, engine: str, value: float, data: st.DataObject
) -> None:
    assume(mode not in ("fit", "nan", "constant") or made.d.deriv)
    assume(made.d.deriv or made.d.window_length > 1 or engine == "direct")  # one sample alone has no differences
    dtype = data.draw(st.sampled_from([np.float64, np.float32, np.int64, np.complex128]))
    x = np.full(made.d.window_length + 9, int(value) % 1000 if dtype is np.int64 else value).astype(dtype)
    found = made.again(engine=engine)(x, mode=mode, cval=x[0].item())
    assert (found[~np.isnan(found)] == (0 if made.d.deriv else x[0])).all()


@examples(40)
@given(designs(rules=RULES), st.sampled_from(ENGINES), modes, st.data())
def test_a_nan_touches_the_windows_that_hold_it(made: Made, engine: str, mode: str, data: st.DataObject) -> None:
    x = data.draw(samples(long_enough(mode, made), more=120))
    n, span = len(x), made.d.window_length
    gone = data.draw(st.lists(st.integers(0, n - 1), min_size=1, max_size=3))
    x[gone] = data.draw(st.sampled_from([np.nan, np.nan, np.inf, -np.inf]))
    found = made.again(engine=engine)(x, mode=mode, cval=1.0)
    center = window(made).point(mode)[0]
    indices = np.arange(n)
    if mode in PADS:
        around = (max(0, center), max(0, span - 1 - center))
        name = {"nearest": "edge", "mirror": "reflect", "wrap": "wrap", "constant": "constant"}[mode]
        more: dict[str, Any] = {"constant_values": -1} if mode == "constant" else {}
        indices, center = np.pad(indices, around, name, **more), min(center, 0)  # type: ignore[call-overload]
    for i, value in enumerate(found):
        start = i - center if mode not in PADS else i + max(0, -center)
        outside = mode == "nan" and not 0 <= start <= n - span
        start = min(max(start, 0), n - span) if mode in INSIDE else start
        touched = outside or bool(set(indices[start : start + span].tolist()) & set(gone))
        assert np.isfinite(value) != touched, (i, gone)


@examples(30)
@given(designs(rules=RULES), modes, st.data())
def test_out_and_threads_change_no_bit(made: Made, mode: str, data: st.DataObject) -> None:
    x = data.draw(samples(long_enough(mode, made), shape=(3,)))
    engine = data.draw(st.sampled_from(ENGINES))
    d = made.again(engine=engine)
    wanted: Array = d(x, mode=mode)
    layout = data.draw(st.sampled_from(["C", "F", "strided", "misaligned"]))
    out = laid_out(np.full(wanted.shape, 7, x.dtype), layout)
    found = d(x, mode=mode, out=out, threads=data.draw(st.integers(1, 3)))
    assert found is out
    # Spectra are of blocks, which begin elsewhere where tau lies before the window and the result goes block by block.
    close(found, wanted, 0 if layout == "C" or engine == "direct" else 2 * off(Made(d, made.words), x, mode))


@examples(30)
@given(designs(rules=RULES), st.data())
def test_modes_are_the_whole_windows_of_padded_samples(made: Made, data: st.DataObject) -> None:
    mode = data.draw(st.sampled_from(PADS))
    x, d = data.draw(samples(1)), made.d
    center, on_sample, _ = window(made).point(mode)
    assume(on_sample == window(made).point("valid")[1])  # or these modes move tau
    around = (max(0, center), max(0, d.window_length - 1 - center))
    name = {"nearest": "edge", "mirror": "reflect", "wrap": "wrap", "constant": "constant"}[mode]
    more: dict[str, Any] = {"constant_values": 2.0} if mode == "constant" else {}
    padded = np.pad(x, around, name, **more)  # type: ignore[call-overload]
    start = max(0, -center)
    same(d(x, mode=mode, cval=2.0), d(padded, mode="valid")[start : start + len(x)])
    whole = np.pad(x, d.window_length)
    fitted, gone = d(whole), d(whole, mode="nan")
    same(gone[~np.isnan(gone)], fitted[~np.isnan(gone)])


def test_properties_tell_apart() -> None:
    """The bounds are small: the weights of a neighbouring design break them."""
    made = Made(design(21), {"window_length": 21, "deriv": 1, "degree": 3, "kappa": 1.0, "mu": 1.0, "tau": "center"})
    made.words.update(rule="exact", delta=1.0, engine="direct")
    x = np.random.default_rng(0).standard_normal(60)
    assert (np.abs(made.d(x, mode="valid") - made.d.replace(mu=1.0001)(x, mode="valid")) > off(made, x)).mean() > 0.9
