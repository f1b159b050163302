"""The directive `command-help`: every command with the help that the program itself prints; it cannot be stale."""

import argparse
import os
from collections.abc import Iterator

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from groundstation.cli.main import build_parser

_COLUMNS = "86"


def leaf_parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield the parsers of all commands that do something, in the order of the help."""
    kinds = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for kind in kinds:
        for child in kind.choices.values():
            yield from leaf_parsers(child)
    if not kinds:
        yield parser


class CommandHelp(Directive):
    """A section for each command."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        os.environ["COLUMNS"], os.environ["NO_COLOR"] = _COLUMNS, "1"
        sections: list[nodes.Node] = []
        for parser in leaf_parsers(build_parser()):
            section = nodes.section(ids=[nodes.make_id(parser.prog)])
            section += nodes.title(text=parser.prog)
            text = parser.format_help()
            section += nodes.literal_block(text, text, language="none")
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
