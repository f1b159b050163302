"""Figures in the text of the pages: passages, and templates that tell where a figure stands in one.

    #   a figure
    ~   any other number
    _   what stands in a table's cell, whatever it is
    …   any text within the passage

Bold and line breaks do not count.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")
_ANY = r"[+−-]?\d+(?:,\d{3})*(?:\.\d+)?"
_WILD = {"#": rf"[+−-]?({NUMBER.pattern})", "~": _ANY, "_": r"[^|]*", "…": r".*?"}
# in a page as it is written: bold, lines broken between words, the sign with its figure
_RAW = {
    "#": rf"\*{{0,2}}({_ANY})\*{{0,2}}",
    "~": rf"\*{{0,2}}{_ANY}\*{{0,2}}",
    "_": r"[^|\n]*",
    "…": r"(?:(?!\n[^\S\n]*\n)(?!(?<=\n)\n).)*?",
    "%": r"%\*{0,2}",
    " ": r"(?:[^\S\n]+(?:\n[^\S\n]*)?|(?<!\n)\n[^\S\n]*)",
}
_BEGINS = re.compile(r"^(?:\||#|<!--|\s*[-*] |\s*\d+\. )")
# figures are kept with five decimals
KEPT_TO = 0.5e-5


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure in a page: where it stands in the text, and how it is printed."""

    start: int
    end: int
    printed: str


def sections(text: str) -> dict[str, str]:
    """Return each second-level section by its anchor."""
    found = {}
    for part in re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]:
        title = re.sub(r"[^\w\- ]", "", part.splitlines()[0][3:].lower()).replace(" ", "-")
        found[title] = part
    return found


def passages(section: str) -> list[str]:
    """Return a section's paragraphs, items of lists and rows of tables, each as one line without bold."""
    found: list[list[str]] = [[]]
    for line in section.splitlines():
        if not line.strip() or _BEGINS.match(line) or (found[-1] and found[-1][-1].startswith(("|", "#"))):
            found.append([])
        if line.strip():
            found[-1].append(line.strip())
    return [re.sub(r"\s+", " ", " ".join(lines).replace("*", "")) for lines in found if lines]


def captured(template: str, lines: list[str]) -> list[tuple[str, ...]]:
    """Return the figures in each passage that a template fits, from a table's row on its beginning."""
    pattern = "".join(_WILD.get(sign, re.escape(sign)) for sign in template.replace(" _ ", "_"))
    if template.endswith(("#", "~")):
        pattern += r"(?![\d,.]*\d)"
    find = re.compile(pattern)
    found = (find.match(line) if template.startswith("|") else find.search(line) for line in lines)
    return [match.groups() for match in found if match]


def figures_at(template: str, text: str) -> list[list[Figure]]:
    """Return the figures of each place of a page's text that a template fits, in their order."""
    pattern = "".join(_RAW.get(sign, re.escape(sign)) for sign in template.replace(" _ ", "_"))
    if template.startswith("|"):
        pattern = r"^\s*" + pattern
    if template.endswith(("#", "~")):
        pattern += r"(?![\d,.]*\d)"
    found = re.finditer(pattern, text, re.MULTILINE | re.DOTALL)
    return [
        [Figure(match.start(k), match.end(k), match[k]) for k in range(1, len(match.groups()) + 1)] for match in found
    ]


def same(seen: str, below: str) -> bool:
    """Return whether a figure is one that stands below, as it is or rounded to fewer digits."""
    apart = abs(number(seen) - number(below))
    return seen == below or (decimals(seen) < decimals(below) and apart <= 0.5 * 10.0 ** -decimals(seen) + 1e-9)


def number(printed: str) -> float:
    """Return what a printed figure is worth."""
    return float(printed.replace(",", "").replace("−", "-"))


def decimals(printed: str) -> int:
    """Return how many digits it has after the point."""
    return len(printed.partition(".")[2])


def off_by(printed: str, value: float, kept_to: float = KEPT_TO) -> bool:
    """Return whether a printed figure is not its value, rounded to the figure's last digit."""
    return abs(number(printed) - value) > 0.5 * 10.0 ** -decimals(printed) + kept_to


def printed_as(printed: str, value: float) -> str:
    """Return a value with as many decimals as a figure has now, and a plus where it has one."""
    sign = "+" if printed.startswith("+") and value >= 0.0 else ""
    return sign + f"{value:.{decimals(printed)}f}".replace("-", "−")


def rounded_as(printed: str, figure: str) -> str:
    """Return a figure of the notes with at most as many decimals as another has."""
    fewer = decimals(printed)
    return figure if fewer >= decimals(figure) else f"{number(figure):.{fewer}f}"


def replaced(text: str, changes: Sequence[tuple[Figure, str]]) -> str:
    """Return a text with figures replaced."""
    for figure, new in sorted(changes, key=lambda change: change[0].start, reverse=True):
        text = text[: figure.start] + new + text[figure.end :]
    return text
