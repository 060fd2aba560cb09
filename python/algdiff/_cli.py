"""Command line: ``algdiff run`` and ``info`` for files, ``stream`` for pipes, ``design`` for windows, ``demo``."""

from __future__ import annotations

import argparse
import os
import re
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from algdiff import _units as units
from algdiff._refusals import printed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from algdiff import Differentiator

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")
RULES = ("exact", "trapezoid", "midpoint", "simpson", "cell", "hat")
TAUS = ("center", "root", "newest")
POLICIES = ("propagate", "omit", "raise")
WORDS = ("degree", "kappa", "mu", "tau", "delay", "delta", "fs", "rule", "trim", "engine")
"""Options that become arguments of a design."""
READING = ("axis", "mode", "cval", "columns", "time", "key", "dtype", "channels", "offset", "memory", "threads")
"""Options that become arguments of a run."""
SIGNED = (
    *("--window", "--delay", "--tau", "--kappa", "--mu", "--cval"),
    *("--sigma", "--max-delay", "--bandwidth", "--min-window", "--max-window"),
)
NEGATIVE = re.compile(r"-\.?\d")
# Not the delay, which --for-delay says, too.
NAMED = "|".join(word for word in ("deriv", *WORDS, *READING) if word != "delay")
SAID = (
    (rf"^({NAMED})(?= must | is for )", r"--\1"),
    (r"^window_length(?= must )", "--window: window_length"),
    (r"^src(?=:| must )|(?<=another file than )src\b", "IN"),
    (r"^dst(?=:| must )", "OUT"),
    (r"\b(overwrite|resume)=True\b", r"--\1"),
)
"""What the library says, as patterns, and what the command line calls it."""


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
    except KeyboardInterrupt as stop:
        return _complain(f"interrupted; {_said(stop)}" if stop.args else "interrupted", 130)
    except UsageError as error:
        return _complain(f"error: {_said(error)}", 2)
    except BrokenPipeError:
        raise
    except MemoryError as error:
        return _complain(f"error: not enough memory: {_said(error)}", 1)
    except (OSError, ValueError, OverflowError, ImportError, Warning) as error:
        return _complain(f"error: {_said(error)}", 1)
    return 0


def _complain(text: str, code: int) -> int:
    print(f"algdiff: {text}", file=sys.stderr)
    return code


def _said(error: BaseException | str) -> str:
    """Return what is said, in one line, with the command line's names for what the library calls otherwise."""
    if isinstance(error, OSError) and error.strerror:
        error = error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    line = printed(" ".join(str(error).split())) or type(error).__name__
    for pattern, names in SAID:
        line = re.sub(pattern, names, line)
    return line


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print("algdiff: warning:", _said(str(message)), file=sys.stderr)


def _silence() -> None:
    """Point the closed streams elsewhere, so that the interpreter's last flush stays quiet."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def design_by(
    make: Callable[..., Differentiator], target: float, options: argparse.Namespace, step: float | None = None
) -> Differentiator:
    """Return what `make` designs for `target` from the options, or raise UsageError; `step` is that of a file."""
    unit = getattr(target, "unit", None) or getattr(options.delay, "unit", None)
    given = {word: getattr(options, word) for word in WORDS if getattr(options, word) is not None}
    if not given.keys() & {"delta", "fs"}:
        if step is not None:
            given["delta"] = step
        elif unit is not None:
            raise UsageError(
                f"--fs or --delta must be given for numbers in {unit}, got neither: the step is 1, with no unit"
            )
    try:
        return make(target, options.deriv, **given)
    except (ValueError, TypeError, OverflowError) as error:
        raise UsageError(error) from None


def _demo(options: argparse.Namespace) -> None:
    from algdiff import _demo, _paper_figures, _pendulum_figure

    demo = _paper_figures if options.paper else _pendulum_figure if options.pendulum else _demo
    demo.run(options.output, options.threads)


def _parser() -> argparse.ArgumentParser:
    from algdiff import _cli_design, _cli_designer, _cli_doctor, _cli_info, _cli_report, _cli_run, _cli_stream

    parser = argparse.ArgumentParser(
        prog="algdiff",
        description="Derivatives of sampled, noisy data.",
        epilog="Exit codes: 0 done, 1 the data or the run failed, 2 the arguments are wrong, 130 stopped by Ctrl-C.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.set_defaults(verb=None)
    verbs = parser.add_subparsers(title="verbs", metavar="VERB")
    run = verbs.add_parser("run", help="differentiate a file", allow_abbrev=False)
    _cli_run.add(run)
    _cli_info.add(verbs.add_parser("info", help="say what a file holds", allow_abbrev=False))
    _cli_design.add(verbs.add_parser("design", help="choose a window and say what it does", allow_abbrev=False))
    _cli_designer.add(verbs.add_parser("designer", help="choose a design on a live page", allow_abbrev=False))
    _cli_report.add(verbs.add_parser("report", help="write a page about a recording or a design", allow_abbrev=False))
    _cli_doctor.add(verbs.add_parser("doctor", help="say whether this installation works", allow_abbrev=False))
    _cli_stream.add(verbs.add_parser("stream", help="differentiate lines as they come", allow_abbrev=False))
    demo = verbs.add_parser("demo", help="differentiate the shipped pendulum recording", allow_abbrev=False)
    demo.set_defaults(verb=_demo)
    demo.add_argument("--output", type=Path, default=Path("algdiff-demo"), metavar="DIR", help="default: %(default)s")
    shown = demo.add_mutually_exclusive_group()
    shown.add_argument("--paper", action="store_true", help="instead: Figures 1 to 4 of Mboup, Join and Fliess (2007)")
    shown.add_argument("--pendulum", action="store_true", help="instead: Figure 5, a pendulum in a closed loop")
    for verb in (run, demo):
        verb.add_argument("--threads", type=count, metavar="N", help="default: chosen from the machine and the data")
    return parser


def add_nan_policy(verb: argparse.ArgumentParser) -> None:
    """Add the option that says what missing samples do."""
    what = "what missing samples do; default: %(default)s"
    verb.add_argument("--nan-policy", choices=POLICIES, default=POLICIES[0], help=what)


def add_design(
    verb: argparse.ArgumentParser,
    deriv: Callable[[str], object] = int,
    metavar: str = "N",
    unstated: str = "1, with no unit",
) -> None:
    """Add the options of a design but for its window; `deriv` reads the order, `unstated` is the default step."""
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
    step.add_argument("--delta", type=units.time, metavar="S", help=f"sampling step: 0.001, 1ms; default: {unstated}")
    step.add_argument("--fs", type=units.rate, metavar="HZ", help="sampling rate, instead of delta: 1000, 1kHz")


def _tau(text: str) -> str | float:
    if text in TAUS:
        return text
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be {', '.join(TAUS)} or a number, got {text!r}") from None


def count(text: str) -> int:
    """Read a number of things."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be an integer of at least 1, got {text!r}")
    return int(text)


def orders(text: str) -> int | tuple[int, ...]:
    """Read one order, or several with commas between them."""
    try:
        found = tuple(map(int, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be an order like 1 or several like 0,1,2, got {text!r}") from None
    return found if len(found) > 1 else found[0]
