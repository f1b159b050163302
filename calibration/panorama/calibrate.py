"""The whole job of `groundstation calibrate panorama`: a session's frames in, each turning head's panorama out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.flight.observations import read_angles
from calibration.panorama.mosaic import Mosaic, PanoramaFrame, frame_of, make_mosaic
from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.rig.rig import Station
from groundstation.session import Session
from groundstation.sources.frame_table import FrameTable, read_frames
from groundstation.sources.picture_reader import PictureReader

LEAST_FRAMES = 6
_AROUND_S = 0.5
# chosen: a step of 0.01° over twice that is 0.05°/s, of which a shutter of 30 ms makes 0.0008° from the middle row to
# the last, and heads hold a rate for longer
_RATE_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class PanoramaChoice:
    """Which frames: from and to, session time, s (None: all); every how many; up to which height, degrees."""

    from_s: float | None = None
    to_s: float | None = None
    every: int = 8
    highest_deg: float = 3.0


def make_panoramas(
    session: Session, choice: PanoramaChoice, progress: Callable[[int], None] = lambda done: None
) -> dict[str, Mosaic]:
    """Return the mosaic of each turning station; raises `SessionError` where the session has too few frames."""
    turning = [s for s in session.rig.stations if not s.fixed]
    if session.detections_only or not turning:
        got = "no pictures" if session.detections_only else "fixed stations only"
        raise SessionError(str(session.folder), got=got, wanted="pictures of a station with a PTU")
    table = read_frames(session)
    if table.fault is not None:
        raise table.fault
    found, done = {}, 0
    for station in turning:
        frames = []
        for frame in _frames(session, table, station, choice):
            frames.append(frame)
            done += 1
            progress(done)
        mosaic = make_mosaic(station, frames, float(np.radians(choice.highest_deg)))
        if mosaic.registered < LEAST_FRAMES:
            got = f"{mosaic.registered} frames that fit each other"
            wanted = f"{LEAST_FRAMES} or more that show ground or buildings below {choice.highest_deg:g} deg"
            raise SessionError(f"station {station.name}", got=got, wanted=wanted)
        found[station.name] = mosaic
    return found


def _frames(session: Session, table: FrameTable, station: Station, choice: PanoramaChoice) -> list[PanoramaFrame]:
    stamps = table.stamps_s[station.name]
    first = -np.inf if choice.from_s is None else choice.from_s
    last = np.inf if choice.to_s is None else choice.to_s
    chosen = np.flatnonzero(np.isfinite(stamps) & (stamps >= first) & (stamps <= last))[:: choice.every]
    if len(chosen) < LEAST_FRAMES:
        got = f"{len(chosen)} frames of {station.name}"
        raise SessionError(session.name, got=got, wanted=f"{LEAST_FRAMES} or more: a longer time, or --every 1")
    t = stamps[chosen]
    readings = read_angles(session, float(t[0]) - _AROUND_S, float(t[-1]) + _AROUND_S)[station.name]
    if len(readings) < 2:
        raise SessionError(f"station {station.name}", got="no readings of its PTU", wanted="some around the frames")
    angles, rates = _angles_at(t, readings), _rates_at(t, readings)
    size, frames = station.lens.image_size_px, []
    numbers = table.numbers[station.name]
    with PictureReader(session.media[station.name], numbers[chosen], table.line[chosen], size, whole=False) as reader:
        for row, (pan_rate, tilt_rate) in zip(angles, rates.tolist(), strict=True):
            picture = reader.next()
            if picture is None:
                break
            frames.append(frame_of(picture.image, row, (pan_rate, tilt_rate)))
    return frames


def _angles_at(t_s: FloatArray, readings: FloatArray) -> FloatArray:
    """Return pan and tilt (n, 2), rad, at times (n,) by readings (m, 3) of time, pan and tilt."""
    return np.column_stack([np.interp(t_s, readings[:, 0], np.unwrap(readings[:, k])) for k in (1, 2)])


def _rates_at(t_s: FloatArray, readings: FloatArray) -> FloatArray:
    """Return the rates of pan and tilt (n, 2), rad/s: of the readings around each time, or as far as they reach."""
    before, after = (np.clip(t_s + side, readings[0, 0], readings[-1, 0]) for side in (-_RATE_S, _RATE_S))
    span_s = np.maximum(after - before, _RATE_S)
    return (_angles_at(after, readings) - _angles_at(before, readings)) / span_s[:, None]
