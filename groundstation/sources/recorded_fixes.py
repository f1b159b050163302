"""Reference positions among the events of a recording, and the same by another antenna and clock.

A recording has positions of the nose at session time, as clock and antenna of the recorded rig correct what the
receiver said. Another rig corrects what the receiver said, which its own one gives back.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import RecordingError
from groundstation.evaluation.position_series import ReferenceSeries, nose_from_antenna
from groundstation.files.read_budget import ReadBudget
from groundstation.messages import ReferenceFix
from groundstation.recording.event_codec import NumberedEvent, parse_line
from groundstation.recording.mcap_metadata import EVENTS_TOPIC
from groundstation.recording.mcap_reader import McapReader
from groundstation.session.folder import RecordingInfo


def recorded_fixes(recorded: RecordingInfo) -> list[ReferenceFix]:
    """Return the reference positions of a recording, in its order; of a file at fault those before the fault."""
    sizes = {s.name: s.lens.image_size_px for s in recorded.rig.stations}
    budget = ReadBudget(recorded.path.name, recorded.path.stat().st_size)
    fixes: list[ReferenceFix] = []
    try:
        with McapReader(recorded.path) as reader:
            for message in reader.messages():
                if message.topic != EVENTS_TOPIC or b'"kind":"reference"' not in message.data:
                    continue
                budget.line(len(message.data))
                parsed = parse_line(message.data, sizes, recorded.path.name)
                if isinstance(parsed, NumberedEvent) and isinstance(parsed.event, ReferenceFix):
                    fixes.append(parsed.event)
    except RecordingError:
        # raised again, where the events are read
        pass
    return fixes


def recorrected_fixes(
    fixes: Sequence[ReferenceFix], antenna_moved_m: FloatArray, clock_later_s: float
) -> list[ReferenceFix]:
    """Return positions of the nose, in time order, by an antenna and a clock other than they were made with.

    ``antenna_moved_m`` (3,) is the other antenna less the first, from the nose: x forward, y right, z down, along the
    direction of flight as in `nose_from_antenna`. ``clock_later_s`` is by how much more the log's clock is ahead.
    """
    ordered, moved_m = _moved(fixes, antenna_moved_m)
    return [
        replace(fix, t_s=fix.t_s - clock_later_s, position_runway_m=fix.position_runway_m + by_m)
        for fix, by_m in zip(ordered, moved_m, strict=True)
    ]


def recorrected_in_place(
    fixes: Sequence[ReferenceFix], antenna_moved_m: FloatArray, clock_later_s: float
) -> Callable[[ReferenceFix], ReferenceFix]:
    """Return what corrects each of ``fixes`` where it occurs among the events, as `recorrected_fixes` does."""
    ordered, moved_m = _moved(fixes, antenna_moved_m)
    at = {fix.t_s: by_m for fix, by_m in zip(ordered, moved_m, strict=True)}

    def corrected(fix: ReferenceFix) -> ReferenceFix:
        position_m = fix.position_runway_m + at.get(fix.t_s, 0.0)
        return replace(fix, t_s=fix.t_s - clock_later_s, position_runway_m=position_m)

    return corrected


def _moved(fixes: Sequence[ReferenceFix], antenna_moved_m: FloatArray) -> tuple[list[ReferenceFix], FloatArray]:
    """Return the fixes in time order, one of each stamp, and by how much (n, 3) m another antenna moves their noses."""
    ordered = sorted({fix.t_s: fix for fix in fixes}.values(), key=lambda fix: fix.t_s)
    series = ReferenceSeries(
        t_s=np.array([fix.t_s for fix in ordered], dtype=np.float64),
        position_m=np.array([fix.position_runway_m for fix in ordered], dtype=np.float64).reshape(-1, 3),
        sigma_m=np.array([fix.sigma_m for fix in ordered], dtype=np.float64).reshape(-1, 3),
    )
    # n = p - R a with R along the flight, of antenna and nose alike: n' = n - R (a' - a)
    return ordered, nose_from_antenna(series, antenna_moved_m).position_m - series.position_m
