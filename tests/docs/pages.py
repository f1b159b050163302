"""The content of the documentation: its pages, the commands in their fenced blocks and sentences, links and anchors.

A fenced block with commands may have comments right before it, which readers do not get:

    <!-- parsed only: WHY -->           the parser has to accept them; they are not run
    <!-- run with: replay --to 3 -->    these options are added to the commands with these words (or to all of them)
    <!-- run in: FOLDER -->             in this folder of the prepared inputs

Without `parsed only` the block is run, from top to bottom, after the blocks before it on the page. Other programs
in it are on a list in the tests, with a reason for each line. Blocks that show what a command prints have comments of
their own (benchmarks/pages/printed.py).
"""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
PAGES = (
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "notes").glob("*.md")),
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "recordings" / "README.md",
)

_FENCE = re.compile(r"((?:^<!--[^\n]*-->\n)*)^(```+)([^\n]*)\n(.*?)^\2$", re.MULTILINE | re.DOTALL)
_SHELLS = ("console", "sh", "bash")
_SCRIPT = re.compile(r"<<'EOF'\n(.*?)^EOF$\n?", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"<!-- (parsed only|run with|run in): (.+?) -->")


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A fenced block with commands: its page and line, its lines, the comments before it, programs in it."""

    page: Path
    line: int
    commands: tuple[str, ...]
    parsed_only: bool
    extra: tuple[str, ...]
    folder: str
    scripts: tuple[str, ...]


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page that show a command of a shell."""
    text = text_of(page)
    for match in _FENCE.finditer(text):
        comments, _, language, body = match.groups()
        if language.strip() not in ("", *_SHELLS):
            continue
        text_alone = _SCRIPT.sub("<<'EOF'\n", body).replace("\\\n", " ")
        lines = tuple(line for line in text_alone.splitlines() if line.strip())
        ours = any(line.startswith(("groundstation ", "make ", "python benchmarks")) for line in lines)
        if not ours and language.strip() not in _SHELLS:
            continue
        reported = dict(_COMMENT.findall(comments))
        assert len(reported) == comments.count("<!--"), f"{page.name}: a comment that is not understood: {comments}"
        yield Block(
            page=page,
            line=text.count("\n", 0, match.start(2)) + 1,
            commands=lines,
            parsed_only="parsed only" in reported,
            extra=tuple(part.strip() for part in reported.get("run with", "").split(";") if part.strip()),
            folder=reported.get("run in", "."),
            scripts=tuple(_SCRIPT.findall(body)),
        )


def arguments(command: str, extra: tuple[str, ...] = ()) -> list[str]:
    """Return a command's arguments, with those of ``extra`` whose words occur in it, or that have no words."""
    words = shlex.split(command, comments=True)[1:]
    added: list[str] = []
    for part in extra:
        more = shlex.split(part)
        names = list(more[: next(i for i, w in enumerate(more) if w.startswith("--"))])
        if all(name in words for name in names):
            added += more[len(names) :]
    return [w for w in words if w != "&"] + added


def spoken_commands(page: Path) -> Iterator[str]:
    """Yield what sentences call a command: `groundstation …` between back-ticks."""
    text = _FENCE.sub("", text_of(page))
    for span in re.findall(r"(?<!`)`([^`]+)`(?!`)", text):
        words = " ".join(span.split())
        if words.startswith("groundstation "):
            yield words


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and the site make them."""
    found: dict[str, int] = {}
    for heading in re.findall(r"^#{1,6} +(.+?) *$", _FENCE.sub("", text_of(page)), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", plain.strip().lower()).replace(" ", "-")
        found[slug] = found.get(slug, -1) + 1
    return {slug if not k else f"{slug}-{k}" for slug, count in found.items() for k in range(count + 1)}


def links(page: Path) -> Iterator[str]:
    """Yield the targets of a page's links and pictures."""
    text = re.sub(r"`[^`\n]+`", "", _FENCE.sub("", text_of(page)))
    yield from re.findall(r"\]\(([^)\s]+)\)", text)
