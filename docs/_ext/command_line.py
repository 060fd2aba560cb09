"""The directive ``command-help``: what ``algdiff VERB --help`` prints."""

from __future__ import annotations

import os
from unittest import mock

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from algdiff import _cli


class CommandHelp(SphinxDirective):
    """Put the help of a verb, or without one that of the command, into the page."""

    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return what goes into the page."""
        parser = _cli._parser()
        verbs = next(action.choices for action in parser._actions if isinstance(action.choices, dict))
        with mock.patch.dict(os.environ, COLUMNS="92", NO_COLOR="1"):
            said = (verbs[self.arguments[0]] if self.arguments else parser).format_help()
        return [nodes.literal_block(said, said, language="text")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
