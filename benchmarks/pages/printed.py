"""Blocks of the pages that show what a command prints, compared with what it prints and written from it.

A fenced `text` block has comments before it:

    <!-- printed by: COMMAND -->      the block is a contiguous part of what this command prints. COMMAND may be the
                                      beginning of a command that the page shows
    <!-- run in: FOLDER -->           in this folder of the prepared inputs
    <!-- ends with: 1 -->             its exit status where that is not 0
    <!-- wrapped -->                  the page breaks the printed lines elsewhere
    <!-- figures vary: WHY -->        from run to run: a table, of which the heading is compared, and that each row that
                                      is printed reads as one of the block's; rows and figures are those of one run

A command whose words name a path that a command on the page writes (`--out PATH`) is run after that one.
"""

import re
import shlex
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from pages.passages import ROOT, decimals, number
from pages.workshop import Ran, Workshop, written

_BLOCK = re.compile(r"((?:^<!--[^\n]*-->\n)+)^```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"<!-- (printed by|run in|ends with|wrapped|figures vary)(?:: (.+?))? -->")
_SHELL = re.compile(r"^```(?:console|sh|bash)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])[+−-]?\d+(?:,\d{3})*(?:\.\d+)?(?![\w])")
_WIDTH = 117


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A block with what a command prints; ``start`` and ``end`` are those of its lines in the page's text."""

    page: Path
    command: str
    where: str
    status: int
    wrapped: bool
    vary: bool
    text: str
    start: int
    end: int

    @property
    def lines(self) -> list[str]:
        """Return what the command has to print: the block's lines, a wrapped block as one."""
        return [" ".join(self.text.split())] if self.wrapped else self.text.splitlines()


def outputs(page: Path) -> Iterator[Output]:
    """Yield the blocks of a page that show what a command prints.

    Raises
    ------
    ValueError
        If a comment before a block is not understood.
    """
    text = page.read_text(encoding="utf-8")
    for match in _BLOCK.finditer(text):
        known = dict(_COMMENT.findall(match[1]))
        if len(known) != match[1].count("<!--") or "printed by" not in known:
            raise ValueError(f"{page.name}: a comment that is not understood: {match[1]}")
        yield Output(
            page=page,
            command=_whole(known["printed by"], text),
            where=known.get("run in", "."),
            status=int(known.get("ends with", "0")),
            wrapped="wrapped" in known,
            vary="figures vary" in known,
            text=match[2],
            start=match.start(2),
            end=match.end(2),
        )


def commands(text: str) -> list[str]:
    """Return the commands that a page shows, each on one line."""
    found = [body.replace("\\\n", " ") for body in _SHELL.findall(text)]
    lines = [" ".join(line.split()) for body in found for line in body.splitlines()]
    return [line for line in lines if line.startswith("groundstation ")]


def _whole(beginning: str, text: str) -> str:
    """Return the page's command that begins so, or these words if there is none."""
    fitting = [command for command in commands(text) if command.startswith(beginning)]
    return fitting[0] if len(fitting) == 1 else beginning


def needed_before(command: str, text: str) -> list[str]:
    """Return the commands of a page that write what a command reads, in the order in which they have to run."""
    words, found = shlex.split(command), list[str]()
    own = written(words)
    for other in commands(text):
        made = written(shlex.split(other))
        reads = made is not None and made != own and any(w == made or w.startswith(f"{made}/") for w in words)
        if reads and other != command:
            found += [*needed_before(other, text), other]
    return list(dict.fromkeys(found))


def printed(output: Output, shop: Workshop) -> Ran:
    """Run a block's command, after those that it needs, and return what it prints."""
    for before in needed_before(output.command, output.page.read_text(encoding="utf-8")):
        shop.run(before)
    return shop.run(output.command, output.where, output.status)


def differs(output: Output, ran: Ran) -> list[str]:
    """Return what of a block is not what the command prints: words that differ, figures by more than their last digit.

    Of a table whose figures vary, the words of each printed row are compared with those of the rows shown.
    """
    name = output.page.name
    try:
        found = table(output.lines[0], ran) if output.vary else matching(output.lines, ran)
    except ValueError as error:
        return [f"{name}: {error}"]
    if output.vary:
        known = [words_of(line) for line in output.lines]
        faults = [f"{name}: shows no row as {line!r}" for line in found if words_of(line) not in known]
        return faults if len(found) > 1 else [*faults, f"{name}: no row is printed below {found[0]!r}"]
    faults = [
        f"{name}: shows {shown!r}, printed is {actual!r}"
        for shown, actual in zip(output.lines, found, strict=False)
        if words_of(shown) != words_of(actual) or figures_differ(shown, actual)
    ]
    if len(found) != len(output.lines):
        faults.append(f"{name}: shows {len(output.lines)} lines, printed are {len(found)}")
    return faults


def table(heading: str, ran: Ran) -> list[str]:
    """Return the printed line that reads as a heading, and the rows below it.

    Raises
    ------
    ValueError
        If no line has these words.
    """
    lines = ran.out.splitlines()
    for start, line in enumerate(lines):
        if words_of(line) == words_of(heading):
            return [line, *takewhile(re.compile(r"\s*\d").match, lines[start + 1 :])]
    raise ValueError(f"no printed line reads {heading!r}")


def matching(lines: Sequence[str], ran: Ran) -> list[str]:
    """Return the part of what a command printed from the words of a block's first line to those of its last.

    Raises
    ------
    ValueError
        If no line has these words.
    """
    for stream in (ran.out, ran.err):
        actual = stream.splitlines()
        starts = [k for k, line in enumerate(actual) if words_of(line) == words_of(lines[0])]
        for start in starts:
            wanted = start + len(lines) - 1
            ends = [k for k in range(start, len(actual)) if words_of(actual[k]) == words_of(lines[-1])]
            if ends:
                return actual[start : min(ends, key=lambda k: abs(k - wanted)) + 1]
    raise ValueError(f"nothing that is printed begins as {lines[0]!r} and ends as {lines[-1]!r}")


def words_of(line: str) -> list[str]:
    """Return a line's words, with a sign for each figure."""
    return _NUMBER.sub("#", line).split()


def figures_differ(shown: str, actual: str) -> bool:
    """Return whether two lines of the same words have figures that differ by more than one in the last digit."""
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(actual), strict=True)
    return any(
        decimals(a) != decimals(b) or abs(number(a) - number(b)) > 10.0 ** -decimals(a) * (1.0 + 1e-6) for a, b in pairs
    )


def rewritten(output: Output, ran: Ran) -> str:
    """Return a block's text as the command prints it now; a table whose figures vary stays while its words are right.

    Raises
    ------
    ValueError
        If nothing that is printed begins and ends with the words of the block.
    """
    if output.vary and not differs(output, ran):
        return output.text
    found = "\n".join(table(output.lines[0], ran) if output.vary else matching(output.lines, ran))
    return (textwrap.fill(found, _WIDTH, break_long_words=False) if output.wrapped else found) + "\n"


def pages_with_outputs() -> list[Path]:
    """Return the pages that show what a command prints."""
    pages = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    return [page for page in pages if "<!-- printed by: " in page.read_text(encoding="utf-8")]
