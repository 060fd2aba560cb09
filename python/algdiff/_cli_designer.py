"""``algdiff designer``: a live page on this machine, on which a design is chosen by hand and eye."""

from __future__ import annotations

import os
import sys
import threading
from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

from algdiff import _formats as formats
from algdiff import _units as units
from algdiff._cli import UsageError
from algdiff._cli_run import add_reading, reading
from algdiff._places import MEMORY

if TYPE_CHECKING:
    import argparse

    from algdiff._designer.recording import Recording
    from algdiff._designer.server import Server

STOPPED = 130
"""The code of a command that Ctrl-C has ended."""
OF_FILES = ("axis", "key", "columns", "time", "dtype", "channels", "offset")
"""Options that say how a file is to be read."""
PATIENCE = 0.5
"""Seconds that a computation which is under way gets to end by itself."""
DESIGNER = """Show a page on which window, degree, weight and delay are moved, and see at once what the design does to
signal and noise, and to the recording in FILE; without one, to the pendulum that ships with the package. The page is
served on this machine only, under an address that nobody can guess. Ctrl-C ends it."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff designer``."""
    verb.description = DESIGNER
    verb.set_defaults(verb=run)
    option = verb.add_argument
    option("source", metavar="FILE", nargs="?", help="a recording that algdiff run reads")
    add_reading(verb)
    step = verb.add_mutually_exclusive_group()
    unstated = "default: what FILE states, or 1, with no unit"
    step.add_argument("--delta", type=units.time, metavar="S", help=f"sampling step: 0.001, 1ms; {unstated}")
    step.add_argument("--fs", type=units.rate, metavar="HZ", help="sampling rate, instead of delta: 1000, 1kHz")
    option("--port", type=_port, default=0, metavar="N", help="where to serve the page; default: any free port")
    option("--no-browser", action="store_true", help="print the address, and leave it to you to open it")


def _port(text: str) -> int:
    if not text.isdecimal() or len(text) > 5 or not 0 <= int(text) <= 65535:
        raise ArgumentTypeError(f"must be a port from 0 to 65535, got {text!r}")
    return int(text)


def run(options: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C."""
    from algdiff._designer.server import Server

    recording = _recording(options)
    try:
        server = Server(recording, options.port)
    except OSError as error:
        raise OSError(f"--port {options.port}: {error.strerror or error}; use another") from None
    with server:
        try:
            print(server.url, flush=True)
            print("Ctrl-C ends it.", file=sys.stderr, flush=True)
            if not options.no_browser:
                # In a thread: a browser that runs in the terminal would keep the page from being served.
                threading.Thread(target=_open, args=(server.url,), daemon=True).start()
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            _stop(server)


def _open(url: str) -> None:
    import webbrowser

    webbrowser.open(url)


def _stop(server: Server) -> None:
    """End the process."""
    server.server_close()
    print("stopped", file=sys.stderr, flush=True)
    if not server.idle(PATIENCE):
        # A thread that comes back from the core while the interpreter is taken down would bring down the process.
        sys.stdout.flush()
        os._exit(STOPPED)
    raise SystemExit(STOPPED)


def _recording(options: argparse.Namespace) -> Recording:
    """Return what the page differentiates."""
    from dataclasses import replace

    from algdiff import _arguments as arguments
    from algdiff._designer import recording as recordings

    try:
        given = (options.delta, options.fs) != (None, None)
        step = arguments.sampling_step(options.delta, options.fs) if given else None
        if given and options.time is not None:
            raise ValueError("give --time, --delta or --fs: got --time and another")
        if options.source is None:
            for name in OF_FILES:
                if getattr(options, name):
                    raise ValueError(f"--{name} is for a FILE, got none")
            return recordings.pendulum() if step is None else replace(recordings.pendulum(), delta=step)
        place = formats.located("FILE", options.source)
    except ValueError as error:
        raise UsageError(error) from None
    with formats.open_source(place, replace(reading(options), memory=MEMORY)) as source:
        name = place.path.name + (f":{place.inner}" if place.inner else "")
        return recordings.read(source, name, options.axis, step)
