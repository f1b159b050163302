"""Results of every log reader: fixes, omitted entries, and the options for information missing from a log."""

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from groundstation.errors import LogError
from groundstation.session.logs.gps_time import TimeScale

MAX_FIXES = 2_000_000
MAX_HEIGHT_M = 100_000.0
MAX_SIGMA_M = 1e6


class FixQuality(StrEnum):
    """How a position was found; the word is the fix's status."""

    FIX = "fix"
    FLOAT = "float"
    PPP = "ppp"
    DGPS = "dgps"
    SBAS = "sbas"
    SINGLE = "single"
    PPS = "pps"
    UNKNOWN = "unknown"
    SIMULATED = "simulated"


# east, north, up in m, one sigma: accuracy of each fix type under open sky, where the log does not state it
DEFAULT_SIGMA_M: dict[FixQuality, tuple[float, float, float]] = {
    FixQuality.FIX: (0.02, 0.02, 0.04),
    FixQuality.FLOAT: (0.4, 0.4, 0.8),
    FixQuality.PPP: (0.1, 0.1, 0.2),
    FixQuality.DGPS: (1.0, 1.0, 2.0),
    FixQuality.SBAS: (1.5, 1.5, 3.0),
    FixQuality.SINGLE: (3.0, 3.0, 6.0),
    FixQuality.PPS: (3.0, 3.0, 6.0),
    FixQuality.UNKNOWN: (3.0, 3.0, 6.0),
    FixQuality.SIMULATED: (0.02, 0.02, 0.04),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """Information that a log may lack.

    Attributes
    ----------
    date : UTC date of the first fix, for a log without dates, or one whose receiver has the wrong 1024 weeks.
    height : "ellipsoid" or "sea level", for a log that does not state the datum of its heights.
    geoid_separation_m : ellipsoid height of sea level, for a log that has heights above sea level only.
    base_deg_m : latitude, longitude, ellipsoid height of the base, for a log of baselines.
    instance : the receiver, where an autopilot logs several; None for the first that has fixes.
    """

    date: datetime.date | None = None
    height: str | None = None
    geoid_separation_m: float | None = None
    base_deg_m: tuple[float, float, float] | None = None
    instance: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFix:
    """One position as decoded by a reader.

    ``day`` and ``second`` are civil time of ``scale``; height is above the ellipsoid; ``sigma_enu_m`` east, north, up
    and ``covariance_en_m2`` that of east with north, None and 0 where the log does not state it.
    """

    day: int
    second: float
    scale: TimeScale
    lat_deg: float
    lon_deg: float
    height_m: float
    quality: FixQuality
    sigma_enu_m: tuple[float, float, float] | None = None
    covariance_en_m2: float = 0.0


# by field of `LogOptions` that only some logs need: what it is called in [dgps] and as an option, and of which logs
_OF_SOME_LOGS = {
    "date": ("date", "--date", "a log of places on Earth"),
    "height": ("height", "--height", "a table with an altitude of which its header does not say what it is above"),
    "base_deg_m": ("base", "--base", "a log of baselines that does not state its base"),
    "instance": ("instance", "--instance", "an autopilot's log"),
}


@dataclass(slots=True)
class ReadingNotes:
    """Omissions and assumptions of a reader: counted by reason, with the place of the first.

    ``used`` has the fields of `LogOptions` that were taken instead of what the log lacks.
    """

    name: str
    counts: dict[str, tuple[int, str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    used: set[str] = field(default_factory=set)

    def count(self, reason: str, where: str = "", number: int = 1) -> None:
        """Count one more omission."""
        before, first = self.counts.get(reason, (0, where))
        self.counts[reason] = (before + number, first)

    def note(self, text: str) -> None:
        """Add a sentence, once."""
        if text not in self.notes:
            self.notes.append(text)

    def lines(self) -> tuple[str, ...]:
        """Return one line for each reason."""
        counted = [
            f"{self.name}: left out {number} × {reason}" + (f" (first: {where})" if where else "")
            for reason, (number, where) in self.counts.items()
        ]
        return (*counted, *(f"{self.name}: {note}" for note in self.notes))

    def note_unused(self, options: LogOptions) -> None:
        """Add a sentence on each option that was given and that this log has no use for."""
        for name, (key, option, logs) in _OF_SOME_LOGS.items():
            if getattr(options, name) is not None and name not in self.used:
                self.note(f"{key} in [dgps], or {option}, is not used: it is for {logs}")

    def short(self) -> str:
        """Return the counts in a few words."""
        return ", ".join(f"{number} × {reason}" for reason, (number, _) in self.counts.items()) or "nothing in it"


class Heights:
    """Ellipsoid heights of a log; one above sea level needs the geoid's separation, from the log or the user."""

    def __init__(self, path: Path, options: LogOptions) -> None:
        self._path = path
        self._given = options.geoid_separation_m

    def ellipsoid(self, sea_level_m: float, separation_m: float | None, hint: str = "") -> float:
        """Return the ellipsoid height; raises `LogError` where the separation is not given."""
        separation = separation_m
        # a writer without a geoid model omits the separation, or writes 0
        if self._given is not None and separation_m in (None, 0.0):
            separation = self._given
        if separation is None:
            got = "heights above sea level, and no geoid separation" + hint
            wanted = "geoid_separation_m in [dgps] of session.toml, or --geoid-separation"
            raise LogError(self._path.name, got=got, wanted=wanted)
        return sea_level_m + separation


def plausible(fix: LogFix) -> bool:
    """Return whether the numbers of a fix can be a place on Earth and a time; comparisons are false for NaN."""
    return (
        abs(fix.lat_deg) <= 90.0
        and abs(fix.lon_deg) <= 360.0
        and abs(fix.height_m) <= MAX_HEIGHT_M
        and not (fix.lat_deg == 0.0 and fix.lon_deg == 0.0)
        and 0.0 <= fix.second < 86_401.0
        and abs(fix.day) < 100_000
    )


def usable_sigma(east_m: float, north_m: float, up_m: float) -> tuple[float, float, float] | None:
    """Return three sigmas, None if one of them is missing."""
    sigmas = (east_m, north_m, up_m)
    return sigmas if all(0.0 < s <= MAX_SIGMA_M for s in sigmas) else None


def check_count(path: Path, fixes: Sequence[object]) -> None:
    """Raise `LogError` where there are more fixes than a flight can have."""
    if len(fixes) > MAX_FIXES:
        raise LogError(path.name, got="more fixes", wanted=f"at most {MAX_FIXES}")
