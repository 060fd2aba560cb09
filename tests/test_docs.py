"""The documentation: its code, links and completeness, and the built site if ALGDIFF_DOCS names its folder."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import posixpath
import re
import shlex
import zlib
from functools import cache
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

import pytest

import algdiff
from algdiff import _cli, paper

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")] + sorted(
    path for path in DOCS.rglob("*.md") if "auto_examples" not in path.parts
)
RUN_BY = {"recipes.md": "test_recipes.py"}
"""Pages whose blocks are programs, and the test that runs them."""
MODULES = ("paper", "pandas", "xarray", "dask", "compat")
FENCE = re.compile(r"^(?P<indent> *)```(?P<language>[^\n`]*)\n(?P<code>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL)


def named(paths: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("page", paths, ids=lambda path: str(path.relative_to(ROOT)))


def blocks(page: Path, language: str) -> list[re.Match[str]]:
    return [found for found in FENCE.finditer(page.read_text(encoding="utf-8")) if found["language"] == language]


# Code


@named([page for page in PAGES if blocks(page, "python")])
def test_python_runs_as_a_doctest_or_says_why_not(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for block in blocks(page, "python"):
        if ">>> " in block["code"]:
            continue
        if page.name in RUN_BY:
            assert page.name in (ROOT / "tests" / RUN_BY[page.name]).read_text(encoding="utf-8")
            continue
        compile(block["code"], page.name, "exec")
        before = text[: block.start()].rstrip().rpartition("\n")[2]
        assert re.fullmatch(r"<!-- no doctest: .{10,} -->", before), block["code"]


def commands(page: Path) -> list[tuple[list[str], bool]]:
    """Return the commands of this library in blocks for the shell, and, named only, in code between backticks."""
    text = page.read_text(encoding="utf-8")
    scripts = [re.sub(r"(^|\s)#.*", r"\1", block["code"].replace("\\\n", " ")) for block in blocks(page, "sh")]
    found = [(command, False) for script in scripts for command in parsed(script)]
    inline = re.findall(r"(?<!`)`(algdiff [a-z][^`\[]*)`(?!`)", FENCE.sub("", text))
    return found + [(command, True) for code in inline for command in parsed(code.replace("\\|", "|"))]


def parsed(script: str) -> Iterator[list[str]]:
    """Yield the commands of this library in a script."""
    lexer = shlex.shlex(script, posix=True, punctuation_chars="();<>|&\n")
    lexer.commenters, lexer.whitespace, lexer.whitespace_split = "", " \t", True
    command: list[str] = []
    for word in [*lexer, "\n"]:
        if not set(word) <= set("();<>|&\n"):
            command.append(word)
            continue
        if command[:1] == ["algdiff"]:
            yield command
        command = []


def test_commands_are_found() -> None:
    assert sum(len(commands(page)) for page in PAGES) > 20


@named([page for page in PAGES if commands(page)])
def test_commands_parse(page: Path) -> None:
    parser = _cli._parser()
    for command, named_only in commands(page):
        said, code = io.StringIO(), 0
        try:
            with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
                parser.parse_args(_cli._joined(command[1:]))
        except SystemExit as stop:
            code = stop.code
        incomplete = named_only and re.search("(are|is) required", said.getvalue())
        assert not code or incomplete, (command, said.getvalue())


# Links


@cache
def anchors(page: Path) -> set[str]:
    """Return the anchors that code hosts give the headings of a page."""
    found: set[str] = set()
    for title in re.findall(r"^#+ +(.*?) *$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).replace("`", "").replace("*", "")
        slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        again = sum(1 for one in found if re.fullmatch(rf"{re.escape(slug)}(-\d+)?", one))
        found.add(f"{slug}-{again}" if slug in found else slug)
    return found


@named(PAGES)
def test_links_of_markdown_lead_somewhere(page: Path) -> None:
    text = re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text(encoding="utf-8")))
    for target in re.findall(r"\]\(([^()\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), target
        assert file.is_relative_to(ROOT), target
        if anchor:
            assert anchor in anchors(file), target


# Completeness


def public() -> set[str]:
    """Return the full names of everything public that can be imported here."""
    names = {f"algdiff.{name}" for name in algdiff.__all__}
    compat = (ROOT / "python" / "algdiff" / "compat").glob("[a-z]*.py")
    for module in [*(f"algdiff.{name}" for name in MODULES), *(f"algdiff.compat.{path.stem}" for path in compat)]:
        with contextlib.suppress(ImportError):
            names |= {f"{module}.{name}" for name in importlib.import_module(module).__all__}
    return names - {"algdiff.compat.toolbox.AlgebraicDifferentiator"}  # algdiff.compat.AlgebraicDifferentiator


def test_the_reference_lists_every_public_name() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.rst"))
    listed = {f"algdiff.{name}" for name in re.findall(r"^   ([\w.]+)$", text, re.MULTILINE)}
    listed |= {f"algdiff.{name}" for name in re.findall(r"^\.\. py:data:: (\w+)$", text, re.MULTILINE)}
    listed |= set(re.findall(r"^\.\. automodule:: ([\w.]+)$", text, re.MULTILINE))
    assert public() <= listed


def test_the_reference_has_the_help_of_every_verb() -> None:
    text = (DOCS / "api" / "command-line.rst").read_text(encoding="utf-8")
    verbs = next(action.choices for action in _cli._parser()._actions if isinstance(action.choices, dict))
    assert set(verbs) == set(re.findall(r"^\.\. command-help:: (\w+)$", text, re.MULTILINE))


def test_every_numbered_equation_of_the_source_can_be_found() -> None:
    page = DOCS / "theory.md"
    text = page.read_text(encoding="utf-8")
    for number in range(1, 18):
        section = text.partition(f"\n### Equation ({number})\n")[2].partition("\n### ")[0]
        assert re.findall(r"\\tag\{(\d+)\}", section) == [str(number)]
        assert f"(#equation-{number})" in text
    assert len(re.findall(r"\\tag\{\d+\}", text)) == 17
    rows = text.partition("| equation | section | functions |")[2].partition("\n\n")[0]
    assert set(re.findall(r"`paper\.(\w+)", rows)) == set(paper.__all__)


def test_formulas_of_the_theory_are_balanced() -> None:
    for block in blocks(DOCS / "theory.md", "math"):
        code = block["code"].replace("\\{", "").replace("\\}", "")
        assert code.count("{") == code.count("}"), code
        assert code.count("\\left") == code.count("\\right"), code
        assert "\\\\" not in code, "Sphinx wraps what has lines in an environment without tags"


RESULTS = sorted((DOCS / "benchmarks").glob("*.json"))


@named(RESULTS)
def test_recorded_results_say_where_when_and_how(page: Path) -> None:
    content = json.loads(page.read_text(encoding="utf-8"))
    header = content.get("machine", content)
    assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", header["date"])
    assert header["processor"]
    assert re.fullmatch(rf"python benches/\S+\.py .*--json docs/benchmarks/{page.name}", header["command"])
    assert f"```{{benchmark}} {page.stem}\n" in (DOCS / "benchmarks.md").read_text(encoding="utf-8")


# The built site

SITE = Path(os.environ.get("ALGDIFF_DOCS", ""))
built = pytest.mark.skipif("ALGDIFF_DOCS" not in os.environ, reason="ALGDIFF_DOCS does not name a built site")
TAG = re.compile(r"<(\w+)\b([^>]*)>")
ATTRIBUTE = re.compile(r"([\w-]+)=(?:\"([^\"]*)\"|'([^']*)')")


@cache
def tags(page: Path) -> list[tuple[str, dict[str, str]]]:
    """Return the tags of a page with their attributes; scripts and comments are left out."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"<!--.*?-->|(<script\b[^>]*>).*?</script>", r"\1", text, flags=re.DOTALL)
    return [
        (name.lower(), {key: unescape(double or single) for key, double, single in ATTRIBUTE.findall(rest)})
        for name, rest in TAG.findall(text)
    ]


@cache
def ids(page: Path) -> set[str]:
    return {attributes[key] for _, attributes in tags(page) for key in ("id", "name") if key in attributes}


def pages() -> list[Path]:
    found = [path for path in sorted(SITE.resolve().rglob("*.html")) if "_static" not in path.parts]
    assert len(found) > 100
    return found


@built
def test_every_link_of_the_site_resolves() -> None:
    broken = []
    for page in pages():
        for name, attributes in tags(page):
            target = attributes.get("href" if name in ("a", "link") else "src", "#")
            if re.match(r"[a-z]+:|//", target) or target == "#":
                continue
            path, _, anchor = target.partition("?")[0].partition("#")
            file = Path(posixpath.normpath(page.parent / unquote(path))) if path else page
            if file.is_dir():
                file /= "index.html"
            if not file.is_file() or (anchor and file.suffix == ".html" and unquote(anchor) not in ids(file)):
                broken.append((str(page.relative_to(SITE.resolve())), target))
    assert broken == []


@built
def test_the_site_loads_nothing_from_other_hosts() -> None:
    loads = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src", "object": "data"}
    remote = [
        (page.name, name, attributes)
        for page in pages()
        for name, attributes in tags(page)
        if re.match(r"https?:|//", attributes.get(loads.get(name, ""), "")) and attributes.get("rel") != "canonical"
    ]
    for sheet in SITE.rglob("*.css"):
        found = re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//[^)\"']+", sheet.read_text(encoding="utf-8"))
        remote += [(sheet.name, "css", {"url": url}) for url in found]
    assert remote == []


@built
def test_the_inventory_has_every_public_name() -> None:
    content = (SITE / "objects.inv").read_bytes().split(b"\n", 4)[4]
    lines = zlib.decompress(content).decode().splitlines()
    assert public() <= {line.split(" ")[0] for line in lines}


@built
def test_the_gallery_has_pictures_of_its_examples() -> None:
    examples = [path.stem for path in (ROOT / "examples").glob("plot_*.py")]
    assert len(examples) >= 12
    shown = (SITE / "auto_examples" / "index.html").read_text(encoding="utf-8")
    for name in examples:
        assert (SITE / "auto_examples" / f"{name}.html").exists()
        assert f"sphx_glr_{name}_thumb.png" in shown


@built
def test_formulas_are_rendered_by_a_copy_in_the_site() -> None:
    scripts = [
        attributes.get("src", "") for name, attributes in tags((SITE / "theory.html").resolve()) if name == "script"
    ]
    assert any(source.startswith("_static/mathjax/") for source in scripts)
    text = (SITE / "theory.html").read_text(encoding="utf-8")
    assert all(f"\\tag{{{number}}}" in text for number in range(1, 18))
