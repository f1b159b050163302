"""Figures of sessions on the pages are the kept ones, to their last digit."""

import math

import pytest
from pages import kept_figures
from pages.page_figures import PAGES, PLACES, QUOTED, Quoted, differences, of_page, quoted_at, rewritten
from pages.passages import decimals, figures_at, number, printed_as

from tests.docs.pages import ROOT, text_of

VALUES = kept_figures.quotable(kept_figures.kept())


def test_every_session_of_the_pages_is_kept() -> None:
    assert set(kept_figures.kept()) == set(kept_figures.SESSIONS)
    assert {source.session for place in QUOTED for source in place.sources} <= set(VALUES)


@pytest.mark.parametrize("page", PAGES)
def test_the_figures_of_a_page_are_the_kept_ones(page: str) -> None:
    """Expected: `make pages` would write nothing; each template fits one place, with a source for each figure."""
    text = text_of(ROOT / page)
    for place in of_page(page):
        found = [(figure.printed, new) for figure, new in differences(text, place, VALUES)]
        assert found == [], f"{page}: {place.template}"
    assert rewritten(page, text, VALUES) == text


@pytest.mark.parametrize("place", QUOTED, ids=lambda place: f"{place.page}: {place.template[:40]}")
def test_a_changed_figure_is_found_and_written_back(place: Quoted) -> None:
    """Expected: each figure by itself, once its last digit is another: the one away from the value, which may be half
    way to the next.
    """
    text = text_of(ROOT / place.page)
    for figure, source in zip(quoted_at(text, place), place.sources, strict=True):
        value = source.factor * VALUES[source.session][source.name]
        step = math.copysign(10.0 ** -decimals(figure.printed), number(figure.printed) - value)
        other = printed_as(figure.printed, number(figure.printed) + step)
        changed = text[: figure.start] + other + text[figure.end :]
        assert [new for _, new in differences(changed, place, VALUES)] == [figure.printed]
        assert rewritten(place.page, changed, VALUES) == text


def test_no_two_sources_share_a_figure() -> None:
    """Expected: no figure of a page is written from two places."""
    for page in PAGES:
        text = text_of(ROOT / page)
        starts = [figure.start for place in of_page(page) for figure in quoted_at(text, place)]
        assert len(starts) == len(set(starts))


def test_a_session_that_is_not_here_leaves_its_figures() -> None:
    text = text_of(ROOT / "README.md").replace("1.41", "9.99")
    without = {session: found for session, found in VALUES.items() if session != "landing-clutter"}
    assert rewritten("README.md", text, without) == text
    assert rewritten("README.md", text, VALUES) == text_of(ROOT / "README.md")


def test_a_sentence_that_is_gone_is_reported() -> None:
    with pytest.raises(ValueError, match=r"README\.md: 0 places read"):
        quoted_at("no figure", next(place for place in PLACES if place.page == "README.md"))


@pytest.mark.parametrize(
    ("template", "text", "wanted"),
    [
        ("ANEES #, NIS #.", "ANEES **0.14**,\nNIS 0.36.", ["0.14", "0.36"]),
        ("| a | # % | _ | #/# |", "| a | **84 %** | x y | −2/**3** |", ["84", "−2", "3"]),
        ("clock + # … or # s", "clock + 1.5 and\nmore or 2 s", ["1.5", "2"]),
        ("a # … b #", "a 1\n\nb 2", []),
    ],
)
def test_figures_are_found_through_bold_and_line_breaks(template: str, text: str, wanted: list[str]) -> None:
    found = figures_at(template, text)
    assert [figure.printed for place in found for figure in place] == wanted
    assert all(text[f.start : f.end] == f.printed for place in found for f in place)


@pytest.mark.parametrize(
    ("printed", "value", "wanted"), [("0.30", 0.2951, "0.30"), ("−2", -2.6, "−3"), ("+0.15", 0.1, "+0.10")]
)
def test_a_figure_is_printed_with_its_digits_and_its_sign(printed: str, value: float, wanted: str) -> None:
    assert printed_as(printed, value) == wanted
