"""Links of Markdown pages, written as code hosts read them, become links of the site.

Pages link each other, and what lies outside ``docs/``, by paths relative to themselves. Of the files outside, some are
included in a page; those of code become downloads (which MyST makes of any existing file); of folders, and of Markdown
that has no page, the text of the link stays.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).parent.parent.parent
PAGES = {
    "README.md": "docs/index.md",
    "CHANGELOG.md": "docs/changelog.md",
    "CONTRIBUTING.md": "docs/contributing.md",
    "RELEASE.md": "docs/releasing.md",
    "SECURITY.md": "docs/security.md",
    "docs/decisions": "docs/decisions/README.md",
}
"""Where the site has what the repository has at another path."""
FENCE = re.compile(r"^ *(```|~~~).*?^ *\1", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(?P<mark>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<target>[^()\s]+)\)")
SCHEME = re.compile(r"[a-z]+:|#|/")


def moved(text: str, source: str, page: str) -> str:
    """Return Markdown with the links of the file `source` as the page has to say them; both count from the root."""

    def link(found: re.Match[str]) -> str:
        target, _, anchor = found["target"].partition("#")
        if SCHEME.match(found["target"]):
            return found[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        path = PAGES.get(path, path)
        inside = path.startswith("docs/")
        if not inside and (path.endswith(".md") or not (ROOT / path).is_file()):
            return found["text"]
        path = posixpath.relpath(path, posixpath.dirname(page))
        return f"{found['mark']}[{found['text']}]({path}{'#' * bool(anchor)}{anchor})"

    parts, last = [], 0
    for fence in FENCE.finditer(text):
        parts += [LINK.sub(link, text[last : fence.start()]), fence[0]]
        last = fence.end()
    return "".join([*parts, LINK.sub(link, text[last:])])


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to what Sphinx reads."""

    def read(_: Sphinx, docname: str, content: list[str]) -> None:
        if app.env.doc2path(docname, base=False).suffix == ".md":
            content[0] = moved(content[0], f"docs/{docname}.md", f"docs/{docname}.md")

    def included(_: Sphinx, path: Path, docname: str, content: list[str]) -> None:
        if path.suffix == ".md":
            content[0] = moved(content[0], posixpath.normpath(f"docs/{path.as_posix()}"), f"docs/{docname}.md")

    app.connect("source-read", read)
    app.connect("include-read", included)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
