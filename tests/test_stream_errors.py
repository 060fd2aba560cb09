"""What streams refuse: by name, with what they got, and left as they were."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from algdiff import Differentiator, Stream

ONE = Differentiator(5, degree=2)
TRIMMED = Differentiator(25, trim=0.03)


@pytest.mark.parametrize(
    ("error", "message", "of", "options"),
    [
        (TypeError, r"^design must be a Differentiator or a sequence of them, got 3", 3, {}),
        (TypeError, r"^design must be a Differentiator or a sequence of them, got \[", [ONE, 3], {}),
        (ValueError, r"^design must be .*, got an empty one", [], {}),
        (ValueError, r"^designs must have the same delta, got \[1.0, 2.0\]", [ONE, ONE.replace(delta=2.0)], {}),
        (ValueError, r"^designs must have the same delay, got \[2.0, 0.0\]", [ONE, ONE.replace(tau="newest")], {}),
        (ValueError, r"^channels must be .* at least 1, got 0", ONE, {"channels": 0}),
        (TypeError, r"^channels must be an integer, got 2.0", ONE, {"channels": 2.0}),
        (TypeError, r"^channels must be an integer, got True", ONE, {"channels": True}),
        (TypeError, r"^dtype must be float64 or float32, got <class 'numpy.int64'>", ONE, {"dtype": np.int64}),
        (TypeError, r"^dtype must be float64 or float32, got <class 'complex'>", ONE, {"dtype": complex}),
        (TypeError, r"^dtype must be float64 or float32, got 'number'", ONE, {"dtype": "number"}),
        (ValueError, r"^delay must be finite, got", ONE, {"delay": np.nan}),
        (TypeError, r"^delay must be a real number, got 'none'", ONE, {"delay": "none"}),
        (ValueError, r"delay.*trim", TRIMMED, {"delay": 0.0}),
        (ValueError, r"^warmup must be 'nan' or 'grow', got 'zero'", ONE, {"warmup": "zero"}),
        (ValueError, r"^warmup must be 'nan' or 'grow', got None", ONE, {"warmup": None}),
        (ValueError, r"^nan_policy must be 'propagate', 'omit' or 'raise', got 'drop'", ONE, {"nan_policy": "drop"}),
        (ValueError, r"^min_support must be .* at least 3, got 2", ONE, {"min_support": 2}),
        (ValueError, r"^min_support must be at most the 5 samples of a window, got 6", ONE, {"min_support": 6}),
        (ValueError, r"^max_gain must be at least 1, got 0.5", ONE, {"max_gain": 0.5}),
        (ValueError, r"^max_gain must be at least 1, got nan", ONE, {"max_gain": np.nan}),
        (ValueError, r"^sigma must be finite and not negative, got -1.0", ONE, {"sigma": -1}),
        (ValueError, r"^sigma must be finite and not negative, got inf", ONE, {"sigma": np.inf}),
        (TypeError, r"^sigma must be a real number, got '1'", ONE, {"sigma": "1"}),
        (ValueError, r"^threads must be .* at least 1, got 0", ONE, {"threads": 0}),
        (ValueError, r"^rule must be 'exact' with nan_policy", ONE.replace(rule="hat"), {"nan_policy": "omit"}),
        (ValueError, r"^rule must be 'exact' with warmup", ONE.replace(rule="hat"), {"warmup": "grow"}),
        (ValueError, r"^trim must be 0 with warmup", TRIMMED, {"warmup": "grow"}),
    ],
)
def test_what_a_stream_must_not_be(error: Any, message: str, of: Any, options: dict[str, Any]) -> None:
    with pytest.raises(error, match=message):
        Stream(of, **options)


@pytest.mark.parametrize("channels", [None, 2])
def test_what_samples_must_not_be(channels: int | None) -> None:
    many = () if channels is None else (channels,)
    stream = ONE.stream(channels=channels)
    stream.push(np.ones((6, *many)))
    before = stream.state
    sample = r"an array of shape \(2,\)" if channels else "a number"
    wrong: list[Any] = [np.ones((2, 3)), np.ones((1, 1, 2)), [[[]]], *([1.0, [1.0], [1.0] * 3] if channels else [])]
    for x in wrong:
        with pytest.raises(ValueError, match=rf"^x must be {sample}, or a block of them along a first axis, got shape"):
            stream.push(x)
    for x in (None, "1", b"1", object(), {"a": 1}, np.datetime64("2024-01-01"), [None, None], 1j, np.ones(2) * 1j):
        for more in ({}, {"return_std": True}):
            with pytest.raises(TypeError, match=r"^x must .*(real|numbers)"):
                stream.push(x, **more)
    with pytest.raises(ValueError, match=r"^x must be an array of numbers"):
        stream.push([1.0, [2.0]])
    assert stream.state == before
    np.testing.assert_allclose(stream.push(np.ones((3, *many))), np.zeros((3, *many)), atol=1e-15)


STATE = Differentiator(5).stream(channels=2).state
OPTIONS, WORDS = STATE["options"], STATE["design"]
STATES: dict[str, Any] = {
    "a number": 3,
    "nothing": None,
    "an empty dict": {},
    "no times": {name: value for name, value in STATE.items() if name != "times"},
    "another version": {**STATE, "version": 99},
    "a number as design": {**STATE, "design": 3},
    "no designs": {**STATE, "design": []},
    "a wrong degree": {**STATE, "design": {**WORDS, "degree": "two"}},
    "an unknown word": {**STATE, "design": {**WORDS, "window": 5}},
    "a list of options": {**STATE, "options": [3]},
    "an unknown option": {**STATE, "options": {**OPTIONS, "channel": 2}},
    "wrong channels": {**STATE, "options": {**OPTIONS, "channels": "two"}},
    "a wrong dtype": {**STATE, "options": {**OPTIONS, "dtype": "number"}},
    "a count without samples": {**STATE, "count": 3},
    "a negative count": {**STATE, "count": -1},
    "a count of 1.0": {**STATE, "count": 1.0, "samples": [1.0, 2.0]},
    "a count beyond all": {**STATE, "count": 2**64},
    "no count": {**STATE, "count": None},
    "samples without a count": {**STATE, "samples": [1.0]},
    "half a sample": {**STATE, "count": 1, "samples": [1.0]},
    "a word as sample": {**STATE, "count": 1, "samples": [1.0, "two"]},
    "samples that are a number": {**STATE, "count": 1, "samples": 3.0},
    "too many times": {**STATE, "count": 1, "samples": [1.0, 2.0], "times": [1.0, 2.0]},
    "a time twice": {**STATE, "count": 2, "samples": [1.0] * 4, "times": [1.0, 1.0]},
    "a time of NaN": {**STATE, "count": 1, "samples": [1.0] * 2, "times": [float("nan")]},
    "a word as time": {**STATE, "count": 1, "samples": [1.0] * 2, "times": ["noon"]},
}


@pytest.mark.parametrize("case", STATES)
def test_what_a_state_must_not_be(case: str) -> None:
    named = r"^(state|samples|times|t|count|design|options|channels|dtype) must"
    with pytest.raises(ValueError, match=named):
        Stream.from_state(STATES[case])
    stream = Differentiator(5).stream(channels=2)
    stream.push(np.arange(12.0).reshape(6, 2))
    before = stream.state
    with pytest.raises(ValueError, match=named):
        stream.state = STATES[case]
    assert stream.state == before
