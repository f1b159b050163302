"""How often faults of a head's readings are named from the motion of the pictures, and right ones are doubted.

    python benchmarks/input_checks.py [SESSION …]

Each session's pictures and readings are read once. The readings of each station that turns are then stored with one
fault after another, and the monitor's verdict is counted: `named` as what it is, `other` as something else, `unnamed`,
or `silent`. Stations with fewer than 12 pairs of pictures that show a texture are left out.
"""

import dataclasses
import math
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from groundstation.geometry.station import StationGeometry
from groundstation.integrity.head_motion import HeadMotionMonitor
from groundstation.integrity.reading_hypothesis import GRADIAN_DEG, ReadingHypothesis
from groundstation.messages import Frame, PtuSample
from groundstation.rig.rig import Station
from groundstation.session import load_session
from groundstation.sources.session_source import session_source

LANDING = Path(__file__).resolve().parent.parent / "recordings" / "landing-1"
MIN_PAIRS = 12
LATE_S = 1.0
TENTH = 0.1
RADIANS = math.pi / 180.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault: the reading that is stored instead of time, pan and tilt, what focal lengths are multiplied by, and
    whether a hypothesis names it."""

    stored: Callable[[float, float, float], tuple[float, float, float]]
    named: Callable[[ReadingHypothesis], bool]
    focal_factor: float = 1.0


def only(**values: object) -> Callable[[ReadingHypothesis], bool]:
    """Return whether a hypothesis is this and nothing else."""
    return lambda hypothesis: hypothesis == dataclasses.replace(ReadingHypothesis(), **values)  # type: ignore[arg-type]


FAULTS = {
    "none": Fault(stored=lambda t, p, q: (t, p, q), named=lambda h: False),
    "pan and tilt exchanged": Fault(stored=lambda t, p, q: (t, q, p), named=only(exchanged=True)),
    "pan reversed": Fault(stored=lambda t, p, q: (t, -p, q), named=only(pan_sign=-1)),
    "tilt reversed": Fault(stored=lambda t, p, q: (t, p, -q), named=only(tilt_sign=-1)),
    "radians": Fault(stored=lambda t, p, q: (t, p * RADIANS, q * RADIANS), named=only(unit=1.0 / RADIANS)),
    "late by 1 s": Fault(
        stored=lambda t, p, q: (t + LATE_S, p, q), named=lambda h: abs(h.lag_s + LATE_S) <= 0.1 and not h.exchanged
    ),
    "stations exchanged": Fault(
        stored=lambda t, p, q: (t, p, q), named=lambda h: h.source is not None and not h.exchanged and h.pan_sign == 1
    ),
    "a tenth of the focal length": Fault(
        stored=lambda t, p, q: (t, p, q), named=lambda h: abs(h.focal_factor * TENTH - 1.0) <= 0.1, focal_factor=TENTH
    ),
    "1.3 times the focal length": Fault(
        stored=lambda t, p, q: (t, p, q), named=lambda h: abs(h.focal_factor * 1.3 - 1.0) <= 0.05, focal_factor=1.3
    ),
    "gradians": Fault(
        stored=lambda t, p, q: (t, p / GRADIAN_DEG, q / GRADIAN_DEG),
        named=lambda h: abs(h.focal_factor / GRADIAN_DEG - 1.0) <= 0.04,
    ),
}


def monitor_of(stations: list[Station], focal_factor: float = 1.0) -> HeadMotionMonitor:
    """Return a monitor of the stations, with focal lengths wrong by a factor."""
    geometries: dict[str, StationGeometry] = {}
    for station in stations:
        lens = dataclasses.replace(station.lens, focal_px=station.lens.focal_px * focal_factor)
        geometries[station.name] = dataclasses.replace(station, lens=lens).geometry()
    return HeadMotionMonitor(geometries, {s.name: s.angle_sigma_rad for s in stations})


def watched(path: Path, stations: list[Station]) -> tuple[HeadMotionMonitor, list[PtuSample]]:
    """Return a monitor that has seen a session's pictures, and the readings."""
    session = load_session(path)
    monitor, readings = monitor_of(stations), []
    with session_source(session) as source:
        for event in source:
            if isinstance(event, PtuSample):
                readings.append(event)
            elif isinstance(event, Frame):
                monitor.add_frame(event)
    return monitor, readings


def verdicts(seen: HeadMotionMonitor, readings: list[PtuSample], stations: list[Station], name: str) -> Counter[str]:
    """Return the verdicts on all stations under one fault."""
    fault = FAULTS[name]
    monitor = monitor_of(stations, fault.focal_factor)
    monitor.take_pictures_of(seen)
    names = [station.name for station in stations]
    exchanged = dict(zip(names[:2], names[1::-1], strict=True)) if name == "stations exchanged" else {}
    for sample in readings:
        t_s, pan, tilt = fault.stored(sample.t_s, sample.pan_rad, sample.tilt_rad)
        station = exchanged.get(sample.station, sample.station)
        monitor.add_reading(PtuSample(t_s=t_s, station=station, pan_rad=pan, tilt_rad=tilt))
    found = {f.station: f for f in monitor.faults()}
    count: Counter[str] = Counter()
    for station in exchanged or names:
        if seen.pair_count(station) >= MIN_PAIRS:
            one = found.get(station)
            if one is None:
                count["silent"] += 1
            elif one.hypothesis is None:
                count["unnamed"] += 1
            else:
                count["named" if fault.named(one.hypothesis) else "other"] += 1
    return count


def main(paths: list[Path]) -> None:
    """Print the table."""
    table = {name: Counter[str]() for name in FAULTS}
    for path in paths:
        stations = [station for station in load_session(path).rig.stations if not station.fixed]
        if not stations:
            continue
        seen, readings = watched(path, stations)
        for name, count in table.items():
            if name != "stations exchanged" or len(stations) > 1:
                count.update(verdicts(seen, readings, stations, name))
    words = ("named", "other", "unnamed", "silent")
    print(f"{'fault':<30}" + "".join(f"{word:>9}" for word in words))
    for name, count in table.items():
        print(f"{name:<30}" + "".join(f"{count[word]:>9}" for word in words))


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]] or [LANDING])
