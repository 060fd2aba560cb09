"""The directive ``benchmark``: tables and a picture of results that the programs in ``benches/`` have recorded.

The results are ``docs/benchmarks/*.json``, as the programs write them with ``--json``. What turns figures into tables
and pictures is the programs' own.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from collections.abc import Callable

    from sphinx.application import Sphinx

ROOT = Path(__file__).parent.parent.parent
RESULTS = ROOT / "docs" / "benchmarks"
sys.path[:0] = [str(ROOT / "benches"), str(ROOT / "benches" / "accuracy")]

Content = dict[str, Any]


def _by_number(found: dict[str, Any]) -> dict[int, Any]:
    """Return what is recorded by window: names in JSON are text."""
    return {int(name): value for name, value in found.items()}


def _peers(content: Content) -> str:
    import peers
    import targets
    from common import table

    windows = _by_number(content["windows"])
    head = ["window", "engine", "ns per sample", "copies", "at most", "moonshot", "met"]
    lines = [targets.Line(*line.values()) for line in content["lines"]]
    parts = [
        table(head, peers.against_targets(windows)),
        "Cost in copies; in brackets, how many times that of `algdiff`:",
        table(*peers.against_peers(windows)),
        "\n".join(peers.notes(windows, content["samples"])),
    ]
    if lines:
        parts.append(table(["target", "measured", "limit", "met"], [line.cells() for line in lines]))
    return "\n\n".join(parts)


def _engines(content: Content) -> str:
    from common import ENGINES, figure, table
    from engines import ALLOWED

    rows = []
    for point in content["points"]:
        design, found = point["design"], point["ns"]
        times = [figure(found.get(name)) for name in ENGINES]
        words = [point["window_length"], point["deriv"], design["degree"], f"{design['kappa']:g}, {design['mu']:g}"]
        rows.append([*words, point["dtype"], *times, point["choice"], point["best"], figure(point["ratio"], 3)])
    head = ["window", "deriv", "degree", "kappa, mu", "dtype", *ENGINES, "choice", "best", "ratio"]
    worst = f"The worst choice costs {content['worst']:.2f} times the best; allowed {ALLOWED}."
    return f"{worst}\n\n{table(head, rows)}"


def _choosing(content: Content) -> str:
    from common import figure, table

    rows = [
        [f"{one['count']:,}", one["window"], *(figure(1e3 * one[name]) for name in ("pass", "choice"))]
        + [figure(one[name] / one["pass"]) for name in ("choice", "adapting")]
        for one in content["costs"]
    ]
    return table(["samples", "window", "a pass, ms", "choice, ms", "choice, passes", "`local=True`, passes"], rows)


def _streaming(content: Content) -> str:
    import streaming

    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        streaming.report(_by_number(content["windows"]), content["others"], _by_number(content["blocks"]))
    return said.getvalue()


def _scaling(content: Content) -> str:
    import scaling
    from common import table

    head = ["samples", "window", "dtype", "in", "engine", "ns per sample", "copies", "two threads", "memory beyond"]
    return table(head, [scaling.cells(row) for row in content["rows"]])


def _illustration(content: Content) -> str:
    import illustration

    from common import table

    left_out = "\n".join(f"- {line}" for line in content["left_out"])
    rows = table(illustration.HEAD, [illustration.cells(row) for row in content["rows"]])
    return f"{rows}\n\nNot in the table:\n\n{left_out}"


def _choice(content: Content) -> str:
    from choice import HONEST, TARGETS

    from common import table

    found = content["summary"]
    rows = [[name, f"{target:g}", f"{found[name]:.2f}"] for name, target in TARGETS.items()]
    rows.append([f"expected error within a factor of {HONEST} of the true one", "", f"{100 * found['honest']:.0f} %"])
    return f"{len(content['cases'])} cases.\n\n{table(['', 'target', 'measured'], rows)}"


def _draw_peers(content: Content, file: Path) -> None:
    import picture

    picture.draw(_by_number(content["windows"]), content, file)


def _draw_streaming(content: Content, file: Path) -> None:
    import streaming
    import streaming_picture

    windows = _by_number(content["windows"])
    over = windows[111][streaming.EMPTY]["median"] + streaming.OVER_EMPTY
    streaming_picture.draw(windows, {111: over, 1001: streaming.LONGEST}, content, file)


def _draw_illustration(content: Content, file: Path) -> None:
    import scatter

    scatter.draw(content["rows"], content, file)


REPORTS: dict[str, Callable[[Content], str]] = {
    "peers": _peers,
    "engines": _engines,
    "choosing": _choosing,
    "streaming": _streaming,
    "scaling": _scaling,
    "illustration": _illustration,
    "choice": _choice,
}
PICTURES: dict[str, tuple[str, Callable[[Content, Path], None]]] = {
    "peers": ("Cost against the window, for every engine and peer", _draw_peers),
    "streaming": ("Latency of one sample against the window", _draw_streaming),
    "illustration": ("Error against time, for every method", _draw_illustration),
}


def report(name: str) -> str:
    """Return the results of one program as Markdown: the machine, the command, tables."""
    content: Content = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    header = content.get("machine", content)
    known = ("processor", "date", "command", "samples", "repeat", "windows", "lines", "points", "worst")
    versions = [f"{key} {value}" for key, value in header.items() if isinstance(value, str) and key not in known]
    said = f"{header['processor']}, {header['date']}, `{header['command']}`; {', '.join(versions)}."
    return f"{said}\n\n{REPORTS[name](content)}\n"


def drawn(name: str, folder: Path) -> Path | None:
    """Draw the picture of one program's results, if there is one for them; return its file."""
    if name not in PICTURES:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.svg"
    content: Content = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # examples of the gallery, which run before, set a style
        PICTURES[name][1](content, file)
    return file


class Benchmark(SphinxDirective):
    """Put the results of one program into the page: their machine, date and command, a picture, tables."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return what goes into the page."""
        (name,) = self.arguments
        self.env.note_dependency(str(RESULTS / f"{name}.json"))
        parent = nodes.container(classes=["benchmark"])
        self.state.nested_parse(StringList(report(name).splitlines(), str(RESULTS)), 0, parent)
        file = drawn(name, Path(self.env.srcdir) / "auto_benchmarks")
        if file is not None:
            picture = nodes.image(uri=f"/auto_benchmarks/{file.name}", alt=PICTURES[name][0])
            parent.insert(1, picture)
        return [parent]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("benchmark", Benchmark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
