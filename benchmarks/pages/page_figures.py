"""Where README and docs quote figures of the sessions: page, sentence or row, and the kept figures in their order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from pages.glance import linked_sections
from pages.kept_figures import LANDING, RULE, SIMULATED, Figures
from pages.passages import (
    KEPT_TO,
    Figure,
    captured,
    figures_at,
    off_by,
    passages,
    printed_as,
    replaced,
    rounded_as,
    same,
)

TAKE_OFF, CLUTTER, AWAY = "takeoff-1", "landing-clutter", "takeoff-away"
_README, _FIRST, _RESULTS, _POSITION = "README.md", "docs/first-flight.md", "docs/results.md", "docs/notes/position.md"
_ANEES, _NIS = "truth.all.ekf.anees", "nis.all.mean"
_BAND = ("nis.all.low_95", "nis.all.high_95")
_SHARE = "truth.all.ekf.coverage"


@dataclass(frozen=True, slots=True)
class Source:
    """A kept figure and the factor to the unit in which pages print it."""

    session: str
    name: str
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Quoted:
    """A place on a page: a template (pages/passages.py) that fits once, and the sources of its figures in order."""

    page: str
    template: str
    sources: tuple[Source, ...]


@dataclass(frozen=True, slots=True)
class Noted:
    """A place on a page whose figures are of a study: for each figure its place in a section of the notes."""

    page: str
    template: str
    link: str
    places: tuple[str, ...]


def _of(session: str, *names: str) -> tuple[Source, ...]:
    return tuple(Source(session, name) for name in names)


def _xyz(session: str, start: str, end: str = "_m", factor: float = 1.0) -> tuple[Source, ...]:
    return tuple(Source(session, f"{start}_{axis}{end}", factor) for axis in "xyz")


def _rmse(session: str, span: str, method: str = "ekf") -> tuple[Source, ...]:
    """Return errors on the pairs that both methods have."""
    return _xyz(session, f"truth.{span}.common.{method}.rmse")


def _both(session: str, span: str) -> tuple[Source, ...]:
    return _rmse(session, span) + _rmse(session, span, "triangulation")


def _readme() -> Iterator[Quoted]:
    yield Quoted(
        _README,
        "not trained on ANEES is # and # (NIS # and #: pixels",
        _of(CLUTTER, _ANEES) + _of(AWAY, _ANEES) + _of(CLUTTER, _NIS) + _of(AWAY, _NIS),
    )
    yield Quoted(
        _README, "on the bundled landing ANEES is #, but NIS # (95 % band #–#)", _of(LANDING, _ANEES, _NIS, *_BAND)
    )
    yield Quoted(_README, "| landing, y 400–485 m | #/#/# | #/#/# |", _both(LANDING, "y400-700"))
    yield Quoted(_README, "| landing, y 100–250 m | #/#/# | #/#/# |", _both(LANDING, "y100-250"))
    yield Quoted(_README, "| take-off, y 100–204 m | #/#/# | #/#/# |", _both(TAKE_OFF, "y100-250"))
    for words, session in (
        ("landing before trees and hills", CLUTTER),
        ("take-off away from the stations, pale wings", AWAY),
    ):
        total = _xyz(session, "truth.all.ekf.rmse")
        sources = (Source(session, _SHARE, 100.0), *total, *_of(session, _ANEES, _NIS))
        yield Quoted(_README, f"| {words} | # % | #/#/# | # | # |", sources)
    yield Quoted(_README, "0.01° of relative pan is # m along the runway at 400 m", _of(RULE, "y_m"))
    yield Quoted("docs/airstrip.md", "0.01° of relative pan is # m along the runway at 400 m", _of(RULE, "y_m"))
    yield Quoted("docs/airstrip.md", "a pedestal that tips by 0.01° is # m at 400 m", _of(RULE, "y_m"))


def _results() -> Iterator[Quoted]:
    for session in (CLUTTER, AWAY, LANDING, TAKE_OFF):
        total, near = _xyz(session, "truth.all.ekf.rmse"), _xyz(session, "truth.y150-250.ekf.rmse")
        sources = (Source(session, _SHARE, 100.0), *total, *near, *_of(session, _ANEES, _NIS, *_BAND))
        yield Quoted(_RESULTS, f"| {session} | # % | #/#/# | #/#/# | # | # (#–#) |", sources)


def _position() -> Iterator[Quoted]:
    rows = (
        (LANDING, "| landing-1 | 400–485", "y400-700"),
        (LANDING, "| | 250–400", "y250-400"),
        (LANDING, "| | 150–250", "y150-250"),
        (LANDING, "| | 100–150 (flare, touchdown)", "y100-150"),
        (LANDING, "| | 97–100 (rolling)", "y60-100"),
        (TAKE_OFF, "| takeoff-1 | 150–204", "y150-250"),
        (TAKE_OFF, "| | 100–150", "y100-150"),
        (TAKE_OFF, "| | 60–100, both in view", "y60-100"),
        (TAKE_OFF, "| | below 60, both in view", "y0-60"),
    )
    for session, begin, span in rows:
        better = _xyz(session, f"truth.{span}.common.better", "_percent")
        sources = (*_of(session, f"truth.{span}.common.epochs"), *_both(session, span), *better)
        yield Quoted(_POSITION, begin + " | # | #/#/# | #/#/# | #/#/# |", sources)
    yield Quoted(
        _POSITION,
        "these pairs: landing-1 #/#/# (triangulation #/#/#), ANEES #; takeoff-1 #/#/# (#/#/#), ANEES #: its",
        tuple(
            source
            for session in (LANDING, TAKE_OFF)
            for source in (*_both(session, "y100-250"), *_of(session, "truth.y100-250.ekf.anees"))
        ),
    )
    yield Quoted(
        _POSITION,
        "Coverage: landing-1 # % of all pairs … takeoff-1 # % with an estimate",
        (Source(LANDING, _SHARE, 100.0), Source(TAKE_OFF, _SHARE, 100.0)),
    )
    yield Quoted(
        _POSITION,
        "(1 is ideal): landing-1 # of # pixels (95 % band #–#), takeoff-1 # of # (#–#)",
        tuple(s for session in (LANDING, TAKE_OFF) for s in _of(session, _NIS, "nis.all.count", *_BAND)),
    )
    both = _of(LANDING, _ANEES) + _of(TAKE_OFF, _ANEES)
    yield Quoted(_POSITION, "ANEES (1 is ideal): landing-1 #, takeoff-1 # in all", both)
    bounds = _xyz(LANDING, "truth.all.ekf.over_bound", "") + _xyz(TAKE_OFF, "truth.all.ekf.over_bound", "")
    yield Quoted(_POSITION, "RMSE over the track's bound (x/y/z): #/#/# and #/#/#.", bounds)
    clocks = tuple(
        s for session in (LANDING, TAKE_OFF) for s in _of(session, "dgps_clock.offset_s", "dgps_clock.sigma_s")
    )
    yield Quoted(_POSITION, "landing-1 # ± # s (made with 0.300), takeoff-1 # ± # s (made with 0.150)", clocks)
    sigmas = _of(LANDING, "dgps_clock.sigmas_off") + _of(TAKE_OFF, "dgps_clock.sigmas_off")
    yield Quoted(_POSITION, "(made with 0.150): # and # σ off", sigmas)


def _first_flight() -> Iterator[Quoted]:
    x, y, z = _xyz(SIMULATED, "truth.y150-250.common.ekf.rmse", factor=100.0)
    yield Quoted(_FIRST, "the track is off by # cm across, # cm in height and # cm along the runway", (x, z, y))


QUOTED = (*_readme(), *_results(), *_position(), *_first_flight())
_LEARNED = "notes/detection.md#the-learned-channel"
_REBUILT = "notes/detection.md#two-recordings-rebuilt-as-worlds"
NOTED = (
    Noted(
        _RESULTS,
        "hits #/# against #/#, and #/# against #/#",
        _REBUILT,
        (
            "| landing-clutter | _ | #/# |",
            "| landing-clutter | #/# |",
            "| takeoff-away | _ | #/# |",
            "| takeoff-away | #/# |",
        ),
    ),
    Noted(
        _RESULTS,
        "hits #/# and #/# on the first two, ANEES #, #, NIS",
        _LEARNED,
        (
            "| landing-clutter | #/# |",
            "| takeoff-away | #/# |",
            "| landing-clutter | _ | _ | _ | _ | _ | # |",
            "| takeoff-away | _ | _ | _ | _ | _ | # |",
        ),
    ),
    Noted(
        _RESULTS, "hits are #/# on landing-clutter and on takeoff-away", _LEARNED, ("| landing-clutter | _ | #/# |",)
    ),
    Noted(
        _RESULTS,
        "hits a median of # % (validate, # sequences)",
        "notes/detection.md#drawn-aircraft-over-real-clips",
        ("| all | _ | _ | # |", "| all | # |"),
    ),
    Noted(
        _RESULTS,
        "worlds its median is #, and that of NIS #.",
        "notes/bank.md#validate-set",
        ("| ANEES while tracking | ~ | ~ | # | ~ |", "| NIS per degree of freedom | ~ | ~ | # | ~ |"),
    ),
)
PLACES: tuple[Quoted | Noted, ...] = (*QUOTED, *NOTED)
PAGES = tuple(dict.fromkeys(place.page for place in PLACES))


def quoted_at(text: str, place: Quoted | Noted) -> list[Figure]:
    """Return the figures of a place in its page's text.

    Raises
    ------
    ValueError
        If the template fits no place of the page, or several.
    """
    match figures_at(place.template, text):
        case [only]:
            return only
        case others:
            raise ValueError(f"{place.page}: {len(others)} places read {place.template!r}; wanted one")


def differences(text: str, place: Quoted | Noted, values: Mapping[str, Figures]) -> list[tuple[Figure, str]]:
    """Return the figures at a place that are not their sources', each with what it should read.

    ``values`` are those of `kept_figures.quotable`; of a session that is not among them nothing is compared.
    """
    figures = quoted_at(text, place)
    if isinstance(place, Noted):
        pairs = zip(figures, _noted(place), strict=True)
        return [(f, rounded_as(f.printed, other)) for f, other in pairs if not same(f.printed, other)]
    found = []
    for figure, source in zip(figures, place.sources, strict=True):
        if source.session in values:
            value = source.factor * values[source.session][source.name]
            if off_by(figure.printed, value, KEPT_TO * source.factor):
                found.append((figure, printed_as(figure.printed, value)))
    return found


def _noted(place: Noted) -> list[str]:
    lines, found = passages(linked_sections()[place.link]), list[str]()
    for template in place.places:
        match captured(template, lines):
            case [only]:
                found += only
            case others:
                raise ValueError(f"{place.page}: {len(others)} passages of {place.link} read {template!r}; wanted one")
    return found


def rewritten(page: str, text: str, values: Mapping[str, Figures]) -> str:
    """Return a page's text with each quoted figure as its source has it, to the digits that it is printed with."""
    return replaced(text, [change for place in of_page(page) for change in differences(text, place, values)])


def of_page(page: str) -> Sequence[Quoted | Noted]:
    """Return the places of one page, by its path from the root."""
    return [place for place in PLACES if place.page == page]
