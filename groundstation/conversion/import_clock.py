"""The clock of an imported session: its epoch, and the start of each video in it."""

import math
from dataclasses import dataclass

from groundstation.conversion.import_request import ImportRequest
from groundstation.errors import UsageError
from groundstation.session.logs.gps_time import gps_from_text, utc_text
from groundstation.session.logs.read import GnssLog

_WANTED = "UTC such as 2026-05-17T09:30:00.2Z, or seconds since the epoch"
_MAX_S = 1e8


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportClock:
    """``epoch_gps_s`` is the GPS time of zero, None if unknown; ``starts_s`` by station."""

    epoch_gps_s: float | None
    starts_s: dict[str, float]
    ptu_start_s: float

    def epoch_text(self) -> str:
        """Return the time of zero as UTC."""
        return "unknown" if self.epoch_gps_s is None else utc_text(self.epoch_gps_s)


def import_clock(request: ImportRequest, log: GnssLog | None) -> ImportClock:
    """Return the clock: the epoch asked for, else the whole second before the first video, else before the log.

    Raises `UsageError` if a start is missing or no time, or if a UTC time has no epoch to refer to.
    """
    moments = {name: _moment(f"--{name}-start", text) for name, text in request.starts.items()}
    ptu = None if request.ptu_start is None else _moment("--ptu-start", request.ptu_start)
    if request.frames is not None and request.starts:
        wanted = "one of them: --frames has the times of all; --epoch is what zero of them is"
        raise UsageError(f"--{next(iter(request.starts))}-start", got="a start next to --frames", wanted=wanted)
    if request.frames is None:
        for name in request.videos:
            if name not in moments:
                got = f"no start of {name}'s video"
                raise UsageError(f"--{name}-start", got=got, wanted=f"{_WANTED}; or --frames with the times of all")
    epoch = None if request.epoch is None else gps_from_text(request.epoch)
    if request.epoch is not None and epoch is None:
        raise UsageError("--epoch", got=repr(request.epoch), wanted="UTC such as 2026-05-17T09:30:00Z")
    utc = [value for value, absolute in moments.values() if absolute]
    if epoch is None and utc:
        epoch = float(math.floor(min(utc)))
    if epoch is None and log is not None and request.frames is not None:
        wanted = "what zero of the frames' times is, in UTC"
        raise UsageError("--epoch", got="a table of frames with a log in UTC", wanted=wanted)
    if epoch is None and log is not None:
        epoch = float(math.floor(log.gps_s[0]))
    starts = {name: _since(epoch, *moment, f"--{name}-start") for name, moment in moments.items()}
    return ImportClock(
        epoch_gps_s=epoch,
        starts_s=starts,
        ptu_start_s=0.0 if ptu is None else _since(epoch, *ptu, "--ptu-start"),
    )


def _moment(option: str, text: str) -> tuple[float, bool]:
    """Return a time and whether it is absolute (GPS seconds) or since the epoch."""
    gps_s = gps_from_text(text)
    if gps_s is not None:
        return gps_s, True
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= _MAX_S:
        raise UsageError(option, got=repr(text), wanted=_WANTED)
    return value, False


def _since(epoch: float | None, value: float, absolute: bool, option: str) -> float:
    if not absolute:
        return value
    if epoch is None:
        raise UsageError(option, got="UTC without an epoch", wanted="--epoch, or the videos' starts in UTC")
    return value - epoch
