"""A DGPS log as events: positions of the target point among the session's own events, for the filter to learn from."""

from collections.abc import Iterable, Iterator, Sequence

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import nose_from_antenna, reference_from_fixes
from groundstation.messages import DgpsFix, Event, ReferenceFix


def reference_fixes(
    fixes: Sequence[DgpsFix], antenna_in_body_m: FloatArray | None, until_s: float, offset_s: float = 0.0
) -> list[ReferenceFix]:
    """Return the log up to ``until_s`` of its own clock as positions of the nose, in time order.

    Their stamps are the session's, with the known offset ``offset_s`` of the log subtracted. Repeated rows are left
    out, and missing sigmas are estimated, as for the comparison.
    """
    series = reference_from_fixes(fixes)
    if antenna_in_body_m is not None:
        series = nose_from_antenna(series, antenna_in_body_m)
    return [
        ReferenceFix(t_s=float(t) - offset_s, position_runway_m=position, sigma_m=sigma)
        for t, position, sigma in zip(series.t_s, series.position_m, series.sigma_m, strict=True)
        if t <= until_s
    ]


def with_reference(events: Iterable[Event], fixes: Sequence[ReferenceFix]) -> Iterator[Event]:
    """Yield the events, which come in order of time, and each fix before the first event that is later."""
    waiting = iter(fixes)
    fix = next(waiting, None)
    for event in events:
        while fix is not None and fix.t_s <= event.t_s:
            yield fix
            fix = next(waiting, None)
        yield event
