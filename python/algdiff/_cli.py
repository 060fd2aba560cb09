"""Command line: ``algdiff run`` for files, ``stream`` for pipes, ``design`` for windows, ``demo`` for a first look."""

from __future__ import annotations

import argparse
import os
import re
import sys
import time
import warnings
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from algdiff import _units as units

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from algdiff import Differentiator
    from algdiff._files import Table

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")
RULES = ("exact", "trapezoid", "midpoint", "simpson", "cell", "hat")
TAUS = ("center", "root", "newest")
WORDS = ("degree", "kappa", "mu", "tau", "delay", "delta", "fs", "rule", "trim", "engine")
"""Options that become arguments of a design."""
BAR = 30
SIGNED = ("--delay", "--tau", "--kappa", "--mu", "--cval")
NEGATIVE = re.compile(r"-\.?\d")


class UsageError(Exception):
    """Arguments that cannot be meant, whatever the files hold."""


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        print("algdiff", version("algdiff-rs"))
        parser.exit()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments after the command's name; those of the process by default.

    Returns
    -------
    code : int
        0 done, 1 the data or the run failed, 2 the arguments are wrong, 130 stopped by Ctrl-C.
    """
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            code = _dispatch(_joined(sys.argv[1:] if argv is None else argv))
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        _silence()
        return 1


def _joined(argv: Sequence[str]) -> list[str]:
    """Return the arguments with negative values joined to their options: argparse takes -2ms for an option."""
    joined: list[str] = []
    for word in argv:
        if joined and joined[-1] in SIGNED and NEGATIVE.match(word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _dispatch(argv: Sequence[str]) -> int:
    try:
        parser = _parser()
        options = parser.parse_args(argv)
        if options.verb is None:
            parser.print_help(sys.stderr)
            return 2
        options.verb(options)
    except SystemExit as stop:
        return int(stop.code or 0)
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except UsageError as error:
        return _complain(f"error: {error}", 2)
    except BrokenPipeError:
        raise
    except MemoryError as error:
        return _complain(f"error: not enough memory: {error}", 1)
    except (OSError, ValueError, OverflowError, ImportError, Warning) as error:
        return _complain(f"error: {_one_line(error)}", 1)
    return 0


def _complain(text: str, code: int) -> int:
    print(f"algdiff: {text}", file=sys.stderr)
    return code


def _one_line(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print("algdiff: warning:", " ".join(str(message).split()), file=sys.stderr)


def _silence() -> None:
    """Point the closed streams elsewhere, so that the interpreter's last flush stays quiet."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _run(options: argparse.Namespace) -> None:
    from algdiff import _files

    form = _check_arguments(options)
    _files.check_output(options.target, options.overwrite)
    started = time.perf_counter()
    design = _design(options)
    source = _files.read(options.source, options.key, options.columns)
    axis = options.axis if options.axis is not None else 0 if options.source.suffix.lower() == ".csv" else -1
    if form == ".csv":
        _files.for_csv(source.array, axis)
    with _bar(not options.quiet and sys.stderr.isatty()) as progress:
        words: dict[str, Any] = {} if options.cval is None else {"cval": options.cval}
        words.update(axis=axis, mode=options.mode, threads=options.threads, progress=progress)
        array = design(source.array, **words)
    with _files.replacing(options.target, options.overwrite) as file:
        labelled = replace(source, array=_files.for_csv(array, axis) if form == ".csv" else array)
        _files.write(file, form, replace(labelled, key=options.key or source.key))
    if not options.quiet:
        print(_summary(options, design, source, time.perf_counter() - started), file=sys.stderr)


def _check_arguments(options: argparse.Namespace) -> str:
    """Return the format of OUT; raise UsageError for arguments that exclude each other."""
    from algdiff import _files

    try:
        read, write = _files.suffix(options.source), _files.suffix(options.target)
    except ValueError as error:
        raise UsageError(error) from None
    if os.path.realpath(options.source) == os.path.realpath(options.target) or (
        options.source.exists() and options.target.exists() and options.source.samefile(options.target)
    ):
        raise UsageError(f"OUT must be another file than IN, got {options.target}")
    if options.columns is not None and read != ".csv":
        raise UsageError(f"--columns is for a .csv IN, got {options.source}")
    if options.key is not None and ".npz" not in (read, write):
        raise UsageError(f"--key is for a .npz IN or OUT, got {options.source} and {options.target}")
    if options.axis not in (None, 0) and read == ".csv":
        raise UsageError(f"--axis must be 0 for a .csv IN, which has time along the rows, got {options.axis}")
    if options.cval is not None and options.mode != "constant":
        raise UsageError(f"--cval is for --mode constant, got --mode {options.mode}")
    return write


def _design(options: argparse.Namespace) -> Differentiator:
    import algdiff

    return design_by(algdiff.Differentiator, options.window_length, options)


def design_by(make: Callable[..., Differentiator], target: float, options: argparse.Namespace) -> Differentiator:
    """Return what `make` designs for `target` from the options, or raise UsageError."""
    unit = getattr(target, "unit", None) or getattr(options.delay, "unit", None)
    if unit is not None and options.delta is None and options.fs is None:
        raise UsageError(
            f"--fs or --delta must be given for numbers in {unit}, got neither: the step is 1, with no unit"
        )
    given = {word: getattr(options, word) for word in WORDS if getattr(options, word) is not None}
    try:
        return make(target, options.deriv, **given)
    except (ValueError, TypeError, OverflowError) as error:
        raise UsageError(_one_line(error)) from None


@contextmanager
def _bar(wanted: bool) -> Iterator[Callable[[float], None] | None]:
    """Yield a callable that draws the fraction done on stderr, or None; erase the drawing at the end."""
    if not wanted:
        yield None
        return
    shown = -1

    def draw(fraction: float) -> None:
        nonlocal shown
        percent = int(100 * fraction)
        if percent != shown:
            shown = percent
            print(f"\r[{'#' * (BAR * percent // 100):<{BAR}}] {percent:3d} %", end="", file=sys.stderr, flush=True)

    try:
        yield draw
    finally:
        if shown >= 0:
            print("\r" + " " * (BAR + 8) + "\r", end="", file=sys.stderr, flush=True)


def _summary(options: argparse.Namespace, design: Differentiator, source: Table, seconds: float) -> str:
    unit = "" if options.delta is None and options.fs is None else " s"
    step = "delta 1, no unit" if not unit else f"delta {design.delta:g} s"
    names = "" if source.header is None else f" ({', '.join(source.header)})"
    return "\n".join(
        (
            f"{options.source} -> {options.target}",
            f"window      {design.window_length} samples, {design.window_length * design.delta:g}{unit} ({step})",
            f"delay       {design.delay_samples:g} samples, {design.delay:g}{unit}",
            f"noise gain  {design.noise_gain:.4g}",
            f"samples     {' x '.join(map(str, source.array.shape))}{names}",
            f"time        {seconds:.3g} s",
        )
    )


def _demo(options: argparse.Namespace) -> None:
    from algdiff import _demo, _paper_figures, _pendulum_figure

    demo = _paper_figures if options.paper else _pendulum_figure if options.pendulum else _demo
    demo.run(options.output, options.threads)


def _parser() -> argparse.ArgumentParser:
    from algdiff import _cli_design, _cli_stream

    parser = argparse.ArgumentParser(
        prog="algdiff",
        description="Derivatives of sampled, noisy data.",
        epilog="Exit codes: 0 done, 1 the data or the run failed, 2 the arguments are wrong, 130 stopped by Ctrl-C.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.set_defaults(verb=None)
    verbs = parser.add_subparsers(title="verbs", metavar="VERB")
    run = verbs.add_parser("run", help="differentiate a file", description=RUN, allow_abbrev=False)
    run.set_defaults(verb=_run)
    _add_files(run)
    add_design(run)
    _cli_design.add(verbs.add_parser("design", help="choose a window and say what it does", allow_abbrev=False))
    _cli_stream.add(verbs.add_parser("stream", help="differentiate lines as they come", allow_abbrev=False))
    demo = verbs.add_parser("demo", help="differentiate the shipped pendulum recording", allow_abbrev=False)
    demo.set_defaults(verb=_demo)
    demo.add_argument("--output", type=Path, default=Path("algdiff-demo"), metavar="DIR", help="default: %(default)s")
    shown = demo.add_mutually_exclusive_group()
    shown.add_argument("--paper", action="store_true", help="instead: Figures 1 to 4 of Mboup, Join and Fliess (2007)")
    shown.add_argument("--pendulum", action="store_true", help="instead: Figure 5, a pendulum in a closed loop")
    for verb in (run, demo):
        verb.add_argument("--threads", type=_count, metavar="N", help="default: chosen from the machine and the data")
    return parser


RUN = """Differentiate an array in a .npy, .npz or .csv file. A .csv file has time along the rows and an optional header
row; comma, semicolon and tab are recognised as delimiters; the header and the delimiter are kept."""


def _add_files(run: argparse.ArgumentParser) -> None:
    add = run.add_argument
    add("source", type=Path, metavar="IN", help=".npy, .npz or .csv")
    add("target", type=Path, metavar="OUT", help=".npy, .npz or .csv; appears whole or not at all")
    add("--overwrite", action="store_true", help="replace OUT if it exists")
    add("--key", metavar="NAME", help="array in a .npz IN (needed when it holds several), and its name in a .npz OUT")
    add("--columns", type=_names, metavar="A,B", help="columns of a .csv IN: header names, or positions from 0")
    add("--axis", type=int, help="axis of time; default: -1, for a .csv IN 0")
    add("-q", "--quiet", action="store_true", help="no progress bar and no summary on stderr")
    add("--window", type=int, required=True, dest="window_length", metavar="N", help="window in samples")
    add("--mode", choices=MODES, default="fit", help="what happens at the ends of the data; default: %(default)s")
    add("--cval", type=float, metavar="X", help="value beyond the ends for --mode constant; default: 0")


def add_design(verb: argparse.ArgumentParser, deriv: Callable[[str], object] = int, metavar: str = "N") -> None:
    """Add the options of a design but for its window; `deriv` reads the order."""
    add = verb.add_argument
    add("--deriv", type=deriv, default=1, metavar=metavar, help="derivative order; default: %(default)s")
    add("--degree", type=int, metavar="N", help="degree of the local polynomial; default: deriv + 2")
    add("--kappa", type=float, metavar="X", help="weight exponent of the oldest end; default: 1")
    add("--mu", type=float, metavar="X", help="weight exponent of the newest end; default: 1")
    add("--rule", choices=RULES, help="discretisation; default: exact")
    add("--trim", type=float, metavar="X", help="share of the weights to leave out at either end; default: 0")
    add("--engine", metavar="NAME", help="how the weights are applied: auto, direct, moments, fft; default: auto")
    point = verb.add_mutually_exclusive_group()
    point.add_argument("--tau", type=_tau, metavar="X", help=f"{', '.join(TAUS)} or a number; default: center")
    point.add_argument(
        "--delay", type=units.time, metavar="S", help="delay of the estimate, instead of tau: 0.02, 20ms"
    )
    step = verb.add_mutually_exclusive_group()
    step.add_argument(
        "--delta", type=units.time, metavar="S", help="sampling step: 0.001, 1ms; default: 1, with no unit"
    )
    step.add_argument("--fs", type=units.rate, metavar="HZ", help="sampling rate, instead of delta: 1000, 1kHz")


def _tau(text: str) -> str | float:
    if text in TAUS:
        return text
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be {', '.join(TAUS)} or a number, got {text!r}") from None


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be an integer of at least 1, got {text!r}")
    return int(text)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]
