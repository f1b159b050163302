"""The table at the top of the results says nothing that does not stand below it."""

import re

from tests.docs.pages import ROOT, anchors, text_of

RESULTS = ROOT / "docs" / "results.md"
_ROW = re.compile(r"^\| \[[^\]]+\]\(#([^)]+)\) \|[^|]*\|([^|]*)\|$", re.MULTILINE)
_NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")


def sections(text: str) -> dict[str, str]:
    """Return each second-level section by its anchor."""
    found = {}
    for part in re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]:
        title = re.sub(r"[^\w\- ]", "", part.splitlines()[0][3:].lower()).replace(" ", "-")
        found[title] = part
    return found


def test_what_the_table_says_was_seen_stands_in_its_section() -> None:
    text = text_of(RESULTS)
    below = sections(text)
    assert set(below) <= anchors(RESULTS)
    rows = _ROW.findall(below["at-a-glance"])
    assert len(rows) >= 20
    missing = []
    for anchor, seen in rows:
        there = set(_NUMBER.findall(below[anchor]))
        missing += [(anchor, number) for number in _NUMBER.findall(seen) if number not in there]
    assert missing == []
