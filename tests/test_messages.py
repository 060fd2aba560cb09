"""One style for every message: what the source holds, and what calls with wrong arguments raise."""

from __future__ import annotations

import ast
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import algdiff
from algdiff import Differentiator, Kernel, Stream
from algdiff._cli import main
from algdiff._refusals import FEW, LONGEST, MANY, listed, named, shown

PACKAGE = Path(algdiff.__file__).parent
X = np.sin(0.1 * np.arange(50))
D = Differentiator(11)
BIG = np.arange(1e6)
LIST = list(range(100_000))
MOST = 400
"""Characters of a message, at most: two values, and what is said of them."""

# --- the source -------------------------------------------------------------------------------------------------------


class Message(NamedTuple):
    """A message as the source holds it, with what is put in between braces."""

    place: str
    kind: str
    text: str


def _text(node: ast.expr) -> str | None:
    """Return the text of a literal, None if it is none."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) or f"{{{ast.unparse(getattr(part, 'value', part))}}}" for part in node.values)
    return None


def _messages() -> Iterator[Message]:
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            call = node.exc if isinstance(node, ast.Raise) else node
            if not isinstance(call, ast.Call) or not call.args:
                continue
            name = ast.unparse(call.func)
            if isinstance(node, ast.Raise) or name == "warnings.warn":
                text = _text(call.args[0])
                if text is not None:
                    yield Message(f"{path.relative_to(PACKAGE)}:{node.lineno}", name, text)


TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}
MESSAGES = list(_messages())
PARAMETERS = {node.arg for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, ast.arg)}
ABOUT = {
    *(
        "a",
        "an",
        "and",
        "array",
        "at",
        "coordinates",
        "csv",
        "either",
        "for",
        "in",
        "index",
        "of",
        "or",
        "OUT",
        "parquet",
    ),
    *("OUT", "parquet", "rate", "sampling", "smooth", "suffix", "the", "to", "variables", "wav", "ALGDIFF_NUM_THREADS"),
}
"""What else may come before "must"."""

ALLOWED = r"must|at most|as in|is for"
ADVICE = r"give|use|pass|take|see|write|save|make|wait|sample|compute|run again|beginning again|pip install"
REMEDY = rf"\b({ALLOWED}|{ADVICE})\b"
START = re.compile(r"[a-z{]|--[a-z{]|[A-Z]\w* (must|is|\+) |ALGDIFF_NUM_THREADS ")
FILE = re.compile(r"\{[\w.]*(path|where|partial|final|folder|source|given|port)[\w.]*\}(:\{\w+\})?[: ]|stdin: |--port ")
"""Messages about a file: they say what is wrong with it, which is what was got."""
DAMAGED = re.compile(r"not (a whole|UTF-8)|ends before|holds no design|weights are not those|is longer than")
"""Files that cannot be mended by another argument: where they came from is to be asked."""

EXCEPTIONS = {
    "mixed": "is caught where it is raised",
    "format {version[0]}": "becomes the middle of a message about a file",
    "a header of": "becomes the middle of a message about a file",
    " must have {self.columns}": "becomes the end of a message about a line",
    " must hold a time": "becomes the end of a message about a line",
    ", column": "becomes the end of a message about a line",
    "module 'algdiff": "is in Python's own words",
    "gradient got unexpected": "is in Python's own words",
    "{caller} got unexpected": "is in Python's own words",
    "a Differentiator does not change": "of an attribute, whose new value does not matter",
    "a Kernel does not change": "of an attribute, whose new value does not matter",
    "{name} is lazy": "ends with what to do, by what it is",
    "{name} would be loaded whole": "got is its size",
    "a .flac OUT would hold": "of a format, whatever is written",
    "min(alpha, beta) must": "of two arguments of the toolbox",
    "a {suffix} OUT must have {shape}": "shape says what was got",
    "{what} of {path}": "what says what is allowed",
    "{path}: {held}": "held says what is allowed",
    "--{error}": "is a message of the library, with an option's name",
    "--{str(error)": "is a message of the library, with an option's name",
    "--{word.replace": "of options that exclude each other",
    "{message}{nearest}": "is said by a method of the toolbox",
    "{name} is no parameter": "of a page's own words",
    "state must be of a stream": "got are parts of both",
}
"""Messages that need not have all of the style, by how they begin, and why."""


def _faults(message: Message) -> Iterator[str]:
    """Yield what is wrong with a message."""
    text = message.text
    if "\n" in text or text.endswith((".", "!", " ")):
        yield "is one line with no full stop at its end"
    if any(text.startswith(start) for start in EXCEPTIONS):
        return
    if not START.match(text):
        yield "starts with the name of an argument or a file, or in lower case"
    about_file = FILE.match(text)
    if not (about_file or "pip install" in text or message.kind == "warnings.warn" or re.search(r"\bgot\b", text)):
        yield "says what it got"
    # What is put in last may say what is wrong with a file.
    at_the_end = re.fullmatch(r"(\{[^{}]*\}[: ()]*)+", text) or (about_file and text.endswith(("}", "})")))
    if not (at_the_end or re.search(REMEDY, text) or (about_file and DAMAGED.search(text))):
        yield "says what is allowed or what to do"
    subject, must, _ = text.partition(" must ")
    names = set(re.findall(r"\w+", re.sub(r"\{.*?\}|--[\w-]*|'\w+'", "", subject.rpartition(": ")[2])))
    if must and not about_file and not names <= PARAMETERS | ABOUT:
        yield f"names an argument, not {names - PARAMETERS - ABOUT}"


def test_the_source() -> None:
    assert len(MESSAGES) > 300
    assert {message.kind for message in MESSAGES} >= {"ValueError", "TypeError", "ImportError", "warnings.warn"}
    wrong = [f"{message.place}: {fault}: {message.text}" for message in MESSAGES for fault in _faults(message)]
    assert not wrong, "\n".join(wrong)


def test_exceptions_are_still_needed() -> None:
    for start in EXCEPTIONS:
        assert any(message.text.startswith(start) for message in MESSAGES), start


def test_faults_are_found() -> None:
    for text in (
        "x must be positive, got 1.",
        "x must be\npositive, got 1",
        "Bad: x must be positive, got 1",
        "x must be positive",
        "x is bad, got 1",
        "the thing must be positive, got 1",
        "{path}: is bad",
    ):
        assert len([*_faults(Message("", "ValueError", text))]) == 1, text
    assert not [*_faults(Message("", "ValueError", "x must be positive, got {x}"))]


# --- values -----------------------------------------------------------------------------------------------------------


class _Rude:
    def __repr__(self) -> str:
        raise RuntimeError("no")


class _Chatty:
    def __repr__(self) -> str:
        return "line\n" * 1000


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.5, "1.5"),
        ("a", "'a'"),
        (None, "None"),
        (LIST, "[0, 1, 2, 3, 4, 5, ...]"),
        (tuple(LIST), "(0, 1, 2, 3, 4, 5, ...)"),
        (BIG, "ndarray of shape (1000000,) and dtype float64"),
        (np.zeros((2, 2)), "array([[0., 0.], [0., 0.]])"),
        (np.ma.zeros(9), "MaskedArray of shape (9,) and dtype float64"),
        (np.float64(2), "np.float64(2.0)"),
        (np.ndarray, "<class 'numpy.ndarray'>"),
        (10**30, str(10**30)),
    ],
)
def test_values_in_short(value: Any, text: str) -> None:
    assert shown(value) == text


@pytest.mark.parametrize("value", ["x" * 10**6, _Rude(), _Chatty(), dict.fromkeys(LIST), {"a": LIST}, [[LIST] * 9] * 9])
def test_no_value_is_long(value: Any) -> None:
    text = shown(value)
    assert len(text) <= 2 * LONGEST
    assert "\n" not in text


def test_huge_integers_are_counted() -> None:
    assert shown(10**6000) == "an integer of 19932 bits"
    assert shown([-(10**6000)]) == "[an integer of 19932 bits]"


def test_lists_of_names() -> None:
    assert listed("abc") == "a, b, c"
    assert listed(range(MANY)).endswith(f", {MANY - 1}")
    assert listed(range(MANY + 5)) == f"{listed(range(MANY))}, and 5 more"
    assert named(a=1, b="x") == "a = 1 and b = 'x'"
    assert str(FEW - 1) in shown(LIST)


# --- calls ------------------------------------------------------------------------------------------------------------

Call = Callable[..., Any]
KINDS = ("object", "list", "array", "word", "complex", "huge")
INTEGERS = ("window_length", "deriv", "axis", "degree", "min_support", "threads")
NUMBERS = ("kappa", "mu", "delay", "delta", "fs", "max_gain", "period", "sigma", "trim", "cval")
WORDS = {"mode": "fit", "edge_window": "full", "nan_policy": "omit", "rule": "exact", "engine": "auto", "tau": "center"}
ARRAYS = ("t", "at", "weights", "autocovariance")


def _refused(call: Call, **words: Any) -> str:
    """Return the message of a refusal, which must be one short line."""
    with pytest.raises((TypeError, ValueError)) as error:
        call(**words)
    said = str(error.value)
    assert len(said) <= MOST, said
    assert "\n" not in said
    assert not said.endswith(".")
    return said


def _differentiate(**words: Any) -> Any:
    return algdiff.differentiate(X, **{"window_length": 11, **words})


@pytest.mark.parametrize("name", [*INTEGERS, *NUMBERS, *WORDS, *ARRAYS, "out"])
@pytest.mark.parametrize("value", [object(), LIST, BIG, "zz", 1j, 10**5000], ids=KINDS)
def test_every_argument_of_differentiate(name: str, value: Any) -> None:
    if name in ("at", "autocovariance") and isinstance(value, (list, np.ndarray)):
        pytest.skip("allowed")
    if name == "deriv" and isinstance(value, list):
        assert "window_length must be at least degree + 1" in _refused(_differentiate, deriv=value)
        return
    said = _refused(_differentiate, **{name: value})
    assert said.startswith(f"{name} must "), said
    if name in INTEGERS:
        assert re.search("an integer|at most|from -1 to 0", said)
    elif name in NUMBERS:
        assert re.search("a real number|shape", said)
    elif name in WORDS:
        assert WORDS[name] in said
    assert "got " in said


TABLE: list[tuple[Call, type[Exception], str]] = [
    (
        lambda: algdiff.differentiate([[1], [2, 3]], 11),
        ValueError,
        "x must be an array of numbers, got [[1], [2, 3]]",
    ),
    (lambda: algdiff.differentiate("x", 11), TypeError, "x must be an array of numbers, got 'x': pass the values"),
    (lambda: algdiff.differentiate(None, 11), TypeError, "x must hold real or complex numbers, got dtype object"),
    (lambda: algdiff.differentiate(5.0, 11), ValueError, "x must have at least one dimension, got a scalar"),
    (lambda: algdiff.differentiate(X, 101), ValueError, "window_length must be at most the 50 samples of x"),
    (lambda: _differentiate(t="time"), TypeError, "t must be an array of numbers, got 'time': pass the values"),
    (lambda: _differentiate(t=np.r_[X, 1]), ValueError, "t must have one time for each of the 50 samples"),
    (
        lambda: _differentiate(t=np.where(X == 0, np.nan, 1)),
        ValueError,
        "t must be finite, and not too far apart, got",
    ),
    (
        lambda: _differentiate(at=np.where(BIG == 7, np.nan, BIG)),
        ValueError,
        "at must be a one-dimensional array of finite times",
    ),
    (lambda: _differentiate(tau="root", delay=LIST), ValueError, "give tau or delay, not both: got tau = 'root' and "),
    (lambda: _differentiate(fs=1, delta=LIST), ValueError, "give delta or fs, not both: got delta = [0, 1, "),
    (lambda: _differentiate(t=X, fs=1), ValueError, "give t, delta or fs, one of them: got t and fs"),
    (lambda: _differentiate(local=True), ValueError, "local must be left out with a given window, got True"),
    (lambda: _differentiate(window_duration=BIG), ValueError, "give window_length or window_duration, not both: got "),
    (lambda: _differentiate(sigma=1, autocovariance=BIG), ValueError, "give sigma or autocovariance, not both: got "),
    (lambda: algdiff.differentiate(X, tau=LIST), ValueError, "window_length must be given with tau, got tau = [0, 1, "),
    (lambda: D.engine_for(LIST), TypeError, "dtype must be a type of numbers like 'float32', got [0, 1, "),
    (lambda: D.to_c(name=LIST), TypeError, "name must be a string, got [0, 1, "),
    (lambda: Differentiator(11, (1, 2), tau="root"), ValueError, "tau must not be 'root' for several orders, got "),
    (lambda: Differentiator(11, (1, 2), trim=0.1), ValueError, "trim must be 0 for several orders, got trim = 0.1"),
    (lambda: Differentiator(11, (1, 1)), ValueError, "deriv must name at least one order, and every order once, got "),
    (lambda: Differentiator.from_cutoff(0.1, window_length=9), TypeError, "window_length must be left out, got 9"),
    (lambda: Differentiator.from_cutoff(LIST), TypeError, "cutoff must be a real number, got [0, 1, "),
    (lambda: Differentiator.from_cutoff(9), ValueError, "cutoff must be at most "),
    (lambda: Differentiator.from_duration(1), ValueError, "duration must be at least 4, that of 4 samples, got 1"),
    (lambda: Differentiator.from_delay(1, tau=2), ValueError, "tau must be less than 1 for a delay, got 2"),
    (lambda: Differentiator.from_notch(0.4, tau="root"), ValueError, "tau must be 'center' for a notch, got tau = "),
    (lambda: Differentiator.from_notch(0.4, delay=1), ValueError, "tau must be 'center' for a notch, got delay = 1"),
    (lambda: algdiff.optimal_window(0.1), ValueError, "give derivative_bound, or bandwidth and amplitude: got "),
    (lambda: algdiff.delay_tradeoff([[1]], 1, bandwidth=1, amplitude=1), ValueError, "delays must be a one-dim"),
    (lambda: Kernel(1).optimal_duration(1, 1, bounded=LIST), TypeError, "bounded must be True or False, got [0, 1, "),
    (lambda: Kernel(1, tau=LIST), TypeError, "tau must be a word such as 'center' or a real number, got [0, 1, "),
    (lambda: algdiff.noise_level(X, t="t"), TypeError, "t must be an array of numbers, got 't'"),
    (lambda: algdiff.noise_level(X, order=99), ValueError, "order must be an integer from 1 to 20, got 99"),
    (lambda: algdiff.suggest(X, noise=LIST), TypeError, "noise must be a word, one of 'auto', 'white', 'ar1', got ["),
    (lambda: algdiff.suggest(X[:5]), ValueError, "x must have at least 6 samples to choose a window, got 5"),
    (lambda: algdiff.suggest(X, t=BIG[:50] ** 2), ValueError, "t must be evenly spaced to choose a window by, got "),
    (lambda: algdiff.suggest(X[:1], t=[3.0]), ValueError, "x must have at least 6 samples to choose a window, got 1"),
    (lambda: algdiff.suggest(X, max_delay=3, local=True), ValueError, "give local or max_delay, not both: got "),
    (lambda: algdiff.savgol_filter(X, 11, 2, mode=LIST), ValueError, "mode must be 'mirror', 'constant', 'nearest', "),
    (lambda: algdiff.savgol_filter(X, 11, 11), ValueError, "polyorder must be less than window_length = 11, got 11"),
    (lambda: algdiff.savgol_coeffs(9, 2, use=BIG), ValueError, "use must be 'conv' or 'dot', got ndarray of shape "),
    (lambda: algdiff.gradient(X, kapa=3), TypeError, "gradient got unexpected keywords: kapa: use cval, degree, "),
    (lambda: algdiff.gradient(X, BIG, window_length=11), ValueError, "coordinates must have shape (50,), got (1000000"),
    (lambda: algdiff.gradient(X, window_length=11, smooth=LIST), TypeError, "smooth must be True or False, got [0, "),
    (lambda: algdiff.laplacian(X, 11, foo=1), TypeError, "laplacian got unexpected keywords: foo: use cval, "),
    (lambda: algdiff.partial(np.outer(X, X), LIST, 11), ValueError, "deriv must be one for all or one for each of 2"),
    (lambda: Stream(LIST), TypeError, "design must be a Differentiator or a sequence of them, got [0, 1, "),
    (lambda: Stream(D, warmup=BIG), ValueError, "warmup must be 'nan' or 'grow', got ndarray of shape (1000000,)"),
    (lambda: Stream.from_state({"samples": LIST}), ValueError, "state must be a dict with version, design, options, "),
    (lambda: D.stream().push(1j), TypeError, "x must be real numbers, got complex ones: push real and imaginary "),
    (lambda: D.stream().push(1.0, "t"), TypeError, "t must be an array of numbers, got 't'"),
    (lambda: algdiff.plot_design(LIST), TypeError, "design must be a Differentiator, got [0, 1, "),
    (lambda: algdiff.plot_response(D, LIST), TypeError, "ax must be a matplotlib Axes, got [0, 1, "),
    (lambda: algdiff.differentiate_file(LIST, "y.npy", 11), TypeError, "src must be a path, got [0, 1, "),
    (lambda: algdiff.differentiate_file("x.foo", "y.npy", 11), ValueError, "src: the suffix of x.foo must be .npy, "),
]


@pytest.mark.parametrize(("call", "error", "start"), TABLE)
def test_calls(call: Call, error: type[Exception], start: str) -> None:
    with pytest.raises(error) as raised:
        call()
    said = str(raised.value)
    assert said.startswith(start), said
    assert len(said) <= MOST
    assert "\n" not in said
    assert not said.endswith(".")


def test_states_of_other_streams_say_what_differs() -> None:
    stream = D.stream()
    with pytest.raises(ValueError, match=r"same options, \{'channels': None\}, got \{'channels': 2\}$"):
        stream.state = D.stream(channels=2).state
    with pytest.raises(ValueError, match=r"^state must be of version 1, got \[0, 1, 2, 3, 4, 5, \.\.\.\]$"):
        stream.state = {**stream.state, "version": LIST}


def test_steep_noise_gains_say_what_to_do() -> None:
    with pytest.warns(algdiff.DesignWarning, match=r"it is [\d.]+: use a lower degree or a longer window$"):
        Differentiator(11, degree=10)


# --- labels, lazy arrays, the command line ----------------------------------------------------------------------------


def test_lazy_arguments_beside_samples_in_memory() -> None:
    lazy = pytest.importorskip("dask.array").ones(50)
    for name in ("t", "weights", "sigma", "at"):
        said = _refused(_differentiate, **{name: lazy}, return_std=True)
        how = f"pass {name}.compute(), or give lazy samples, too"
        assert said == f"{name} is lazy and would be computed whole: {how}"


def test_clients_that_are_none() -> None:
    pytest.importorskip("dask")
    import algdiff.dask

    for client in (5, None, "tcp://127.0.0.1:1"):
        with pytest.raises(TypeError, match=r"^client must be a distributed\.Client, got "):
            algdiff.dask.differentiate_paths(client, "x.npy", "y.npy", 11)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^design must be a Differentiator, got 5$"):
        algdiff.dask.overlap_depth(5)  # type: ignore[arg-type]


def test_labels() -> None:
    pd = pytest.importorskip("pandas")
    xr = pytest.importorskip("xarray")
    import algdiff.pandas
    import algdiff.xarray

    frame = pd.DataFrame({"x": X, "time": np.arange(50.0)})
    array = xr.DataArray(X, {"time": np.arange(50.0)}, ["time"])
    for call in (
        lambda: algdiff.pandas.differentiate(frame, 11, t="time"),
        lambda: algdiff.xarray.differentiate(array, "time", 11, t="time"),
    ):
        with pytest.raises(TypeError, match=r"^t must be an array of times, got 'time': pass the values, not a name$"):
            call()
    words = pd.DataFrame({f"c{k}": ["a"] for k in range(1000)})
    with pytest.raises(TypeError, match=r"c9' .*, and 990 more: select the columns to differentiate$") as error:
        algdiff.pandas.differentiate(words, 11)
    assert len(str(error.value)) <= MOST
    with pytest.raises(ValueError, match=r"^window_duration must be a duration like '2s' or 0\.5, got 'long' \("):
        algdiff.pandas.differentiate(frame, window_duration="long")


def test_a_single_sample_with_a_date() -> None:
    pd = pytest.importorskip("pandas")
    import algdiff.pandas

    one = pd.Series([1.0], pd.to_datetime(["2026-01-01"]))
    with pytest.raises(ValueError, match=r"^t must hold two times or more with window_duration, got 1$"):
        algdiff.pandas.differentiate(one, window_duration="2s")
    with pytest.raises(ValueError, match=r"^x must have at least 6 samples to choose a window, got 1$"):
        algdiff.pandas.differentiate(one)
    with pytest.raises(ValueError, match=r"with a single sample at a t, which has no step, got 'mirror'$"):
        algdiff.pandas.differentiate(one, 1, deriv=0, degree=0, mode="mirror")


@pytest.mark.parametrize(
    ("samples", "times", "units"),
    [("", "s", "s-1"), (" ", "s", "s-1"), ("1", "s", "s-1"), ("m", "", "m"), ("m", "1", "m"), ("m", " s ", "m s-1")],
)
def test_units_that_are_empty(samples: str, times: str, units: str) -> None:
    xr = pytest.importorskip("xarray")
    import algdiff.xarray

    time = xr.DataArray(np.arange(50.0), dims="time", attrs={"units": times})
    array = xr.DataArray(X, {"time": time}, ["time"], attrs={"units": samples})
    assert algdiff.xarray.differentiate(array, "time", 11).attrs == {"units": units}


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--min-support", "2"), "--min-support must be an integer of at least 4, got 2"),
        (("--min-support", "12"), "--min-support must be at most the 11 samples of a window, got 12"),
        (("--max-gain", "0.5"), "--max-gain must be at least 1, got 0.5"),
    ],
)
def test_limits_of_gaps_are_arguments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: tuple[str, str], said: str
) -> None:
    np.save(tmp_path / "x.npy", X)
    run = ["run", str(tmp_path / "x.npy"), str(tmp_path / "y.npy"), "--window", "11", "--nan-policy", "omit"]
    assert main([*run, *flags]) == 2
    assert capsys.readouterr().err == f"algdiff: error: {said}\n"
    assert not (tmp_path / "y.npy").exists()


def test_internal_errors_can_be_pickled() -> None:
    error = pickle.loads(pickle.dumps(algdiff.InternalError("said")))  # noqa: S301
    assert (type(error), error.args) == (algdiff.InternalError, ("said",))


@pytest.mark.parametrize("word", ["a\nb", "a" * 5000, "\ud800", "\x1b[31m"])
@pytest.mark.parametrize("name", ["tau", "rule", "engine", "mode", "nan_policy", "edge_window"])
def test_words_that_cannot_be_printed_are_shown_as_python_writes_them(name: str, word: str) -> None:
    with pytest.raises(ValueError, match=rf"^{name} must be") as caught:
        algdiff.differentiate(np.arange(9.0), 5, **{name: word})
    said = str(caught.value)
    assert said.isprintable()
    assert len(said) < 300


def test_what_states_and_dtypes_hold_is_shown_in_one_line() -> None:
    design = algdiff.Differentiator(5)
    with pytest.raises(TypeError, match=r"dtype must be float64 or float32, got '.ud800'"):
        design.stream(dtype="\ud800")
    state = design.stream().state
    with pytest.raises(ValueError, match="state must hold") as caught:
        algdiff.Stream.from_state({**state, "design": {**state["design"], "a\nb": 1}})
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("word", ["f4,(", "(2,", "\ud800", "no type"])
def test_types_that_numpy_cannot_read(word: str) -> None:
    design = algdiff.Differentiator(5)
    for call in (lambda: design.stream(dtype=word), lambda: design.engine_for(word)):
        with pytest.raises(TypeError, match=r"^dtype must be") as caught:
            call()
        assert str(caught.value).isprintable()
    with pytest.raises(TypeError, match=r"^dtype must be"):
        algdiff.differentiate_file("x.raw", "y.raw", window_length=5, dtype=word)
