"""Every link and every anchor of the documentation leads somewhere, and its pictures are small."""

import re
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, anchors, links, text_of


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    wrong = []
    for link in links(page):
        if link.startswith("https://"):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (anchor and (target.suffix != ".md" or anchor not in anchors(target))):
            wrong.append(link)
    assert wrong == []


def test_the_checker_finds_faults(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One `two.md` (3)\n\n## Twice\n\n## Twice\n\n[a](b.md#c) `[no](link)` ![p](d.png)\n")
    assert list(links(page)) == ["b.md#c", "d.png"]
    assert anchors(page) == {"one-twomd-3", "twice", "twice-1"}


def test_every_page_is_in_the_site() -> None:
    docs, listed = ROOT / "docs", {"index.md"}
    for index in (docs / "index.md", docs / "notes" / "index.md"):
        for name in re.findall(r"^([a-z-]+(?:/index)?)$", text_of(index), re.MULTILINE):
            listed.add(str((index.parent / f"{name}.md").relative_to(docs)))
    assert listed == {str(p.relative_to(docs)) for p in docs.rglob("*.md")}
    assert {docs / name for name in listed} <= set(PAGES)


def test_pictures_are_small_and_used() -> None:
    shown = {Path(link).name for page in PAGES for link in links(page)}
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.stat().st_size <= (3_000_000 if picture.suffix == ".gif" else 300_000), picture.name
        assert picture.name in shown


def test_modules_and_functions_that_pages_name_exist() -> None:
    """Expected: each `module.py`, and each `module.py:function`, of a page is a file of the repository."""
    folders = ("groundstation", "calibration", "ptu_drivers", "tests", "benchmarks", "docs")
    modules = [path.relative_to(ROOT) for folder in folders for path in (ROOT / folder).rglob("*.py")]
    wrong = []
    for page in PAGES:
        for name, function in re.findall(r"`((?:\w+/)*\w+\.py)(?::(\w+))?`", text_of(page)):
            named = [path for path in modules if f"/{path}".endswith(f"/{name}")]
            defined = rf"(?:def |^){function}\b"
            if not any(not function or re.search(defined, text_of(ROOT / path), re.MULTILINE) for path in named):
                wrong.append(f"{page.name}: {name}:{function}")
    assert wrong == []
