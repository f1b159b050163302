"""An argument parser that names what may have been meant by a misspelt command, option or choice."""

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from groundstation.files.nearest_word import nearest_word

_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")


class SuggestingParser(argparse.ArgumentParser):
    """Adds a suggestion to the error of a word that it does not know; the parsers of its commands are of this class."""

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Return the options; exits with 2 for words that are none.

        It prints the usage of the command that they were given to, and names what may have been meant.
        """
        found, rest = self.parse_known_args(args, namespace)
        if rest:
            hints = getattr(found, "suggestions", [])
            meant = f"; did you mean {', '.join(hints)}?" if hints else ""
            found.parser.error(f"unrecognized arguments: {' '.join(rest)}{meant}")
        del found.parser
        return found

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Return what is known and the rest.

        The namespace keeps ``suggestions`` for the rest, also a command's, and as ``parser`` that of the command.
        """
        self._words = list(sys.argv[1:] if args is None else args)
        found, rest = super().parse_known_args(args, namespace)
        options = [name for action in self._actions for name in action.option_strings]
        hints = [nearest_word(word.split("=")[0], options) for word in rest if word.startswith("-")]
        # a command has parsed its words before
        found.parser = getattr(found, "parser", self)
        found.suggestions = [*getattr(found, "suggestions", []), *filter(None, hints)]
        return found, rest

    def error(self, message: str) -> NoReturn:
        """Print usage and message, with a suggestion for a wrong choice where there is one, and exit with 2."""
        choice = _CHOICE.search(message)
        if choice is not None:
            hint = nearest_word(choice[1], [name.strip(" '") for name in choice[2].split(",")])
            message += f"; did you mean {hint}?" if hint else ""
        if message.startswith("the following arguments are required"):
            message += "".join(self._unknown())
        super().error(message)

    def _unknown(self) -> Iterator[str]:
        """Yield words on each option that was given and is none: it may be the required one, misspelt."""
        options = [name for action in self._actions for name in action.option_strings]
        for word in (word.split("=")[0] for word in self._words):
            if word.startswith("--") and len(word) > 2 and not any(name.startswith(word) for name in options):
                hint = nearest_word(word, options)
                yield f"; got {word}, which is none" + (f": did you mean {hint}?" if hint else "")
