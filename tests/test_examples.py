"""The gallery's examples: their format, and that what they use of algdiff exists. The build of the site runs them."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import algdiff

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("plot_*.py"))
INTERNAL = {"plot_closed_loop.py": {"_pendulum"}, "plot_paper_figures.py": {"_paper_figures"}}
"""Which examples show what is no part of the public interface."""
ADAPTERS = {"compat", "dask", "pandas", "paper", "xarray"}
"""Modules of the package that users import."""
OUTSIDE = {"requests", "socket", "urllib", "scipy.datasets", "sklearn.datasets"}
"""What gets data from elsewhere."""
FIGURES = ("plt.figure", "plt.subplots", "plt.subplot_mosaic")

each = pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def dotted(node: ast.expr) -> str:
    """Return ``a.b.c`` of an expression that is such a name, else nothing."""
    if isinstance(node, ast.Attribute):
        before = dotted(node.value)
        return f"{before}.{node.attr}" if before else ""
    return node.id if isinstance(node, ast.Name) else ""


def imports(tree: ast.Module) -> Iterator[tuple[str, str, str]]:
    """Yield name, module and attribute of what is imported; the attribute is empty where it is a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for one in node.names:
                yield one.asname or one.name.split(".")[0], one.name if one.asname else one.name.split(".")[0], ""
        elif isinstance(node, ast.ImportFrom):
            for one in node.names:
                yield one.asname or one.name, node.module or "", one.name


def known(path: Path, tree: ast.Module) -> dict[str, Any]:
    """Return what names of an example come from algdiff, after a look whether they may."""
    found = {}
    for name, module, attribute in imports(tree):
        if module.split(".")[0] != "algdiff":
            continue
        parts = [*module.split(".")[1:], *([attribute] if attribute else [])]
        allowed = {*algdiff.__all__, *ADAPTERS, *INTERNAL.get(path.name, ())}
        assert not parts or parts[0] in allowed, f"{'.'.join(parts)} is not public"
        value = importlib.import_module(module)
        found[name] = reach(value, [attribute]) if attribute else value
    return found


def reach(value: Any, names: list[str]) -> Any:
    """Return the attribute at the end of a chain of public ones; a submodule of a package is imported."""
    for name in names:
        if isinstance(value, ModuleType) and not hasattr(value, name):
            value = importlib.import_module(f"{value.__name__}.{name}")
        else:
            value = getattr(value, name)
    return value


def uses(path: Path) -> Iterator[tuple[ast.Call | None, Any]]:
    """Yield everything of algdiff that an example names, with the call if it is called."""
    tree = parsed(path)
    names = known(path, tree)
    calls = {id(node.func): node for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        first, *rest = dotted(node).split(".") if isinstance(node, (ast.Attribute, ast.Name)) else [""]
        if first in names:
            if isinstance(names[first], ModuleType) and rest and names[first].__name__ == "algdiff":
                assert rest[0] in {*algdiff.__all__, *ADAPTERS}, f"algdiff.{rest[0]} is not public"
            yield calls.get(id(node)), reach(names[first], rest)


def test_there_are_enough():
    assert len(EXAMPLES) >= 12


@each
def test_the_docstring_is_a_title_and_a_paragraph(path):
    title, line, *rest = (ast.get_docstring(parsed(path)) or "\n").splitlines()
    assert title
    assert line == "=" * len(title)
    assert rest[0] == ""
    assert all(rest[1:]), "one paragraph"
    assert len(" ".join(rest)) > 80


@each
def test_cells_say_why(path):
    _, *cells = re.split(r"^# %%.*\n", path.read_text(), flags=re.MULTILINE)
    assert len(cells) >= 2
    for cell in cells:
        text, code = re.fullmatch(r"((?:#.*\n)*)((?s:.*))", cell).groups()
        assert len(text) > 40, "a cell begins with its reason"
        assert code.startswith("\n"), "an empty line ends the text"
        assert code.strip(), "a cell has code"
        # A single backtick is no literal in reStructuredText.
        assert not re.search(r"(?<![`:\w])`[^`]+`(?![`_])", text)


@each
def test_figures_are_constrained_and_labelled(path):
    tree = parsed(path)
    made = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and dotted(node.func) in FIGURES]
    assert made
    for node in made:
        layout = [word.value.value for word in node.keywords if word.arg == "layout"]
        assert layout == ["constrained"]
    source = path.read_text()
    assert "xlabel" in source
    assert "ylabel" in source
    assert "savefig" not in source


@each
def test_data_are_at_hand_and_the_same_every_time(path):
    tree = parsed(path)
    for _, module, attribute in imports(tree):
        assert not {module, f"{module}.{attribute}", module.split(".")[0]} & OUTSIDE
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ".random." in dotted(node.func):
            assert dotted(node.func).endswith(".default_rng")
            assert node.args or node.keywords, "a seed"


@each
def test_what_is_used_is_public_and_takes_these_keywords(path):
    count = 0
    for call, value in uses(path):
        count += 1
        if call is None or isinstance(value, ModuleType):
            continue
        takes = inspect.signature(value).parameters
        if not any(one.kind is one.VAR_KEYWORD for one in takes.values()):
            assert {word.arg for word in call.keywords} - {None} <= set(takes)
    assert count


def test_private_names_and_wrong_keywords_are_found(tmp_path):
    path = tmp_path / "plot_wrong.py"
    for text in (
        "from algdiff import _pendulum",
        "import algdiff\nalgdiff._savgol.savgol_filter(1)",
        "import algdiff\nalgdiff.differentiated(1)",
        "from algdiff.compat import nothing",
        "import algdiff\nalgdiff.differentiate([1], 3, windows=2)",
    ):
        path.write_text(text)
        with pytest.raises((AssertionError, AttributeError, ImportError)):
            test_what_is_used_is_public_and_takes_these_keywords(path)
