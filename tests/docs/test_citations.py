"""What the code cites of the documentation exists: the page, and the section by its number, title or anchor.

Forms: `docs/PAGE.md`, `docs/PAGE.md, section 5`, `docs/PAGE.md, "Title"` and `docs/PAGE.md#anchor`.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, anchors, text_of

FOLDERS = ("groundstation", "calibration", "ptu_drivers", "benchmarks", "tests")
_PAGE = re.compile(r"\bdocs/[a-z/-]+\.md")
_ANCHOR = re.compile(r"#([\w-]+)")
_NUMBER = re.compile(r",? sections? (\d+)")
_TITLE = re.compile(r'(?:, section \d+)?, \\?"([^"\\]+)\\?"')
# in brackets a page is followed by its section and nothing else; what has no such form is not checked
_LOOSE = re.compile(r", (?!sections? \d)[\w &]+\)")


def titles(page: Path) -> set[str]:
    """Return the titles of a page's sections, without their numbers, and the bold words that begin a paragraph."""
    text = text_of(page)
    headings = re.findall(r"^#{1,6} +(?:\d+\. )?(.+?) *$", text, re.MULTILINE)
    return {*headings, *(words.rstrip(".") for words in re.findall(r"^\*\*([^*]+)\*\*", text, re.MULTILINE))}


def numbers(page: Path) -> set[str]:
    """Return the numbers of a page's numbered sections."""
    return set(re.findall(r"^#{1,6} +(\d+)\. ", text_of(page), re.MULTILINE))


def wrong_citations(text: str) -> Iterator[str]:
    """Yield a module's citations that do not exist; a citation may continue in the next line, of a comment, too."""
    text = re.sub(r"\n\s*(?:# )?", " ", text)
    for match in _PAGE.finditer(text):
        page, rest = ROOT / match[0], text[match.end() : match.end() + 120]
        if not page.is_file():
            yield match[0]
            continue
        if (anchor := _ANCHOR.match(rest)) and anchor[1] not in anchors(page):
            yield match[0] + anchor[0]
        if (number := _NUMBER.match(rest)) and number[1] not in numbers(page):
            yield match[0] + number[0]
        if (title := _TITLE.match(rest)) and title[1] not in titles(page):
            yield match[0] + title[0]
        if loose := _LOOSE.match(rest):
            yield match[0] + loose[0]


@pytest.mark.parametrize("folder", FOLDERS)
def test_cited_pages_and_sections_exist(folder: str) -> None:
    own = Path(__file__)
    wrong = {
        str(path.relative_to(ROOT)): found
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path != own and (found := list(wrong_citations(text_of(path))))
    }
    assert wrong == {}


def test_the_checker_finds_faults() -> None:
    text = """(docs/derivation.md, section 5) docs/derivation.md, section 99 (docs/derivation.md, filter) docs/gone.md.
    (docs/derivation.md,
    # "Departures from the paper") docs/derivation.md, "Nowhere"; docs/results.md#at-a-glance docs/results.md#gone
    """
    assert list(wrong_citations(text)) == [
        "docs/derivation.md, section 99",
        "docs/derivation.md, filter)",
        "docs/gone.md",
        'docs/derivation.md, "Nowhere"',
        "docs/results.md#gone",
    ]
