"""Details of pages.

In Markdown, names of the library link to the reference; blocks end with their last line; and attributes of classes are
described as the class describes them, of which numpydoc would keep the first line of a property's own docstring.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from docutils import nodes
from numpydoc.docscrape_sphinx import SphinxDocString
from sphinx.addnodes import pending_xref

import algdiff
from algdiff import paper

if TYPE_CHECKING:
    from sphinx.application import Sphinx

NAME = re.compile(r"(?:algdiff\.)?(?P<name>[A-Za-z_]\w*(?:\.\w+)*)(?:\(.*\))?", re.DOTALL)
PUBLIC = {*algdiff.__all__, "pandas", "xarray", "dask", "compat"}


def named(code: str, page: str) -> str | None:
    """Return the full name of what code between backticks names or calls, if it may be the library's."""
    found = NAME.fullmatch(code)
    if found is None:
        return None
    if page == "paper" and found["name"] in paper.__all__:
        return f"algdiff.paper.{found['name']}"
    first, *rest = found["name"].split(".")
    if first not in PUBLIC or (first == "paper" and rest and rest[0] not in paper.__all__):
        return None
    return f"algdiff.{found['name']}" if rest or first in algdiff.__all__ or code.startswith("algdiff.") else None


def _finish(app: Sphinx, doctree: nodes.document) -> None:
    for block in doctree.findall(nodes.literal_block):
        if block.astext() != block.astext().rstrip():
            block.replace_self(_shortened(block))
    if app.env.doc2path(app.env.docname, base=False).suffix != ".md":
        return
    for code in list(doctree.findall(nodes.literal)):
        inside = isinstance(code.parent, (nodes.reference, pending_xref, nodes.title))
        name = None if inside else named(code.astext(), app.env.docname)
        if name is not None:
            link = pending_xref(refdomain="py", reftype="obj", reftarget=name, refexplicit=True, refwarn=False)
            code.replace_self(link)
            link += code


def _shortened(block: nodes.literal_block) -> nodes.literal_block:
    text = block.astext().rstrip()
    return nodes.literal_block(text, text, **block.attributes)


_process_param = SphinxDocString._process_param


def _described(self: SphinxDocString, param: str, desc: list[str], fake_autosummary: bool) -> tuple[str, list[str]]:
    shown, other = _process_param(self, param, desc, fake_autosummary)
    return shown, desc or other


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to pages that have been read."""
    SphinxDocString._process_param = _described
    app.connect("doctree-read", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
