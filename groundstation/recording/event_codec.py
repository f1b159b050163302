"""Input events of the pipeline as lines of JSON, bit-exact, and their parser.

Other lines are notes: which parts of a frame's pixels were recorded (known only after the detection), which frames'
pixels were dropped, and which events were lost.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from groundstation.box import box_of_size, clip
from groundstation.errors import RecordingError
from groundstation.files.image_header import MAX_PICTURE_PX
from groundstation.files.toml_table import quoted, shown
from groundstation.messages import (
    Epoch,
    Event,
    FilterReset,
    Frame,
    FrameAngles,
    Heartbeat,
    PixelMeasurement,
    PtuSample,
    ReferenceFix,
)
from groundstation.picture import BayerPattern
from groundstation.rig.rig_limits import LONGEST_READOUT_S

_MOST = 1e12
_MAX_WHOLE = 2**53
_MAX_PARTS = 64
_MAX_STATIONS = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameHeader:
    """A frame without its pixels: its ``size_px`` (w, h), and the order of its colours where they are raw."""

    t_s: float
    station: str
    epoch: int
    size_px: tuple[int, int]
    pattern: BayerPattern | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PartNote:
    """One kept part of a frame: the end of its topic, its corner and its size in px."""

    topic: str
    x: int
    y: int
    w: int
    h: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelsNote:
    """The recorded parts of frame number ``of``, whose pictures follow in this order; none if no window was read."""

    of: int
    parts: tuple[PartNote, ...]
    colour: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class DroppedNote:
    """The pixels of frame number ``of`` were not recorded, and why."""

    of: int
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LostNote:
    """Events number ``first`` to ``last`` were not recorded."""

    first: int
    last: int


Note = PixelsNote | DroppedNote | LostNote


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberedEvent:
    """Event number ``n`` of the run, counted from 0; a frame is only its head."""

    n: int
    event: Event | FrameHeader


def line(values: Mapping[str, Any]) -> bytes:
    """Return one line of JSON; floats are written with all digits, so that they read back bit for bit."""
    return json.dumps(values, separators=(",", ":"), ensure_ascii=False).encode()


def event_values(n: int, event: Event) -> dict[str, Any]:
    """Return an event as plain values; of a frame only the head."""
    values: dict[str, Any] = {"n": n, "kind": _KINDS[type(event)], "t_s": float(event.t_s)}
    if isinstance(event, PtuSample):
        values |= {"station": event.station, "pan_rad": float(event.pan_rad), "tilt_rad": float(event.tilt_rad)}
    elif isinstance(event, FrameAngles):
        values |= {"station": event.station, "pan_rad": float(event.pan_rad), "tilt_rad": float(event.tilt_rad)}
        values |= {"sigma_rad": float(event.sigma_rad)}
        if event.delay_s != 0.0:
            values |= {"delay_s": float(event.delay_s)}
    elif isinstance(event, Frame):
        pattern = event.image.pattern
        values |= {
            "station": event.station,
            "epoch": int(event.epoch),
            "size_px": [int(v) for v in event.image.size_px],
        }
        values |= {"pattern": None if pattern is None else pattern.value}
    elif isinstance(event, PixelMeasurement):
        values |= {"station": event.station, "epoch": int(event.epoch)}
        values |= {"u_px": float(event.u_px), "v_px": float(event.v_px)}
        if event.sigma_px is not None:
            values |= {"sigma_px": [float(v) for v in event.sigma_px]}
    elif isinstance(event, Epoch):
        values |= {"epoch": int(event.epoch), "stations": list(event.stations)}
    elif isinstance(event, FilterReset):
        values |= {"why": event.why, "in_vain": event.in_vain}
    elif isinstance(event, ReferenceFix):
        values |= {"position_runway_m": event.position_runway_m.tolist(), "sigma_m": event.sigma_m.tolist()}
    return values


def note_values(note: Note) -> dict[str, Any]:
    """Return a note as plain values."""
    if isinstance(note, PixelsNote):
        parts = [{"topic": p.topic, "x": p.x, "y": p.y, "w": p.w, "h": p.h} for p in note.parts]
        return {"kind": "pixels", "of": note.of, "colour": note.colour, "parts": parts}
    if isinstance(note, DroppedNote):
        return {"kind": "dropped", "of": note.of, "why": note.why}
    return {"kind": "lost", "first": note.first, "last": note.last}


def parse_line(data: bytes, sizes_px: Mapping[str, tuple[int, int]], where: str) -> NumberedEvent | Note:
    """Return the event or note of a line; ``sizes_px`` (w, h) by station are the rig's.

    Raises `RecordingError` for anything that this module does not write.
    """
    try:
        values = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise RecordingError(where, got=f"no JSON ({shown(str(error))})", wanted="an event") from error
    if not isinstance(values, dict):
        raise RecordingError(where, got=quoted(values), wanted="an event")
    return _EventFields(values, sizes_px, where).parsed()


_KINDS: Mapping[type, str] = {
    PtuSample: "ptu",
    FrameAngles: "frame angles",
    Frame: "frame",
    PixelMeasurement: "pixel",
    Epoch: "epoch",
    ReferenceFix: "reference",
    Heartbeat: "heartbeat",
    FilterReset: "begun anew",
}


class _EventFields:
    """The values of one line, each checked on access."""

    def __init__(self, values: Mapping[str, Any], sizes_px: Mapping[str, tuple[int, int]], where: str) -> None:
        self._values = values
        self._sizes = sizes_px
        self._where = where

    def parsed(self) -> NumberedEvent | Note:
        """Return the event or note of the line."""
        kind = self._values.get("kind")
        if kind == "pixels":
            return self._pixels()
        if kind == "dropped":
            return DroppedNote(of=self._whole("of"), why=self._text("why"))
        if kind == "lost":
            return LostNote(first=self._whole("first"), last=self._whole("last"))
        return NumberedEvent(n=self._whole("n"), event=self._event(kind))

    def _event(self, kind: object) -> Event | FrameHeader:
        t_s = self._number("t_s", self._values.get("t_s"))
        if kind == "ptu":
            pan, tilt = (self._number(key, self._values.get(key)) for key in ("pan_rad", "tilt_rad"))
            return PtuSample(t_s=t_s, station=self._station(), pan_rad=pan, tilt_rad=tilt)
        if kind == "frame angles":
            return self._frame_angles(t_s)
        if kind == "frame":
            return self._frame(t_s)
        if kind == "pixel":
            return self._pixel(t_s)
        if kind == "epoch":
            return Epoch(t_s=t_s, epoch=self._whole("epoch"), stations=self._stations())
        if kind == "reference":
            position, sigma = self._vector("position_runway_m"), self._vector("sigma_m")
            return ReferenceFix(t_s=t_s, position_runway_m=np.array(position), sigma_m=np.array(sigma))
        if kind == "heartbeat":
            return Heartbeat(t_s=t_s)
        if kind == "begun anew":
            return FilterReset(t_s=t_s, why=self._text("why"), in_vain=self._flag("in_vain"))
        raise self._fault("kind", kind, ", ".join([*_KINDS.values(), "pixels", "dropped"]) + " or lost")

    def _frame_angles(self, t_s: float) -> FrameAngles:
        pan, tilt, sigma = (self._number(k, self._values.get(k)) for k in ("pan_rad", "tilt_rad", "sigma_rad"))
        if sigma <= 0.0:
            raise self._fault("sigma_rad", sigma, "a number > 0")
        delay = self._number("delay_s", self._values.get("delay_s", 0.0))
        if abs(delay) > LONGEST_READOUT_S:
            raise self._fault("delay_s", delay, f"seconds, at most {LONGEST_READOUT_S:g} either way")
        return FrameAngles(t_s=t_s, station=self._station(), pan_rad=pan, tilt_rad=tilt, sigma_rad=sigma, delay_s=delay)

    def _pixel(self, t_s: float) -> PixelMeasurement:
        u, v = (self._number(key, self._values.get(key)) for key in ("u_px", "v_px"))
        given, sigma = self._values.get("sigma_px"), None
        if given is not None:
            if not isinstance(given, list) or len(given) != 2:
                raise self._fault("sigma_px", given, "two numbers > 0, or none")
            sigma = (self._number("sigma_px", given[0]), self._number("sigma_px", given[1]))
            if min(sigma) <= 0.0:
                raise self._fault("sigma_px", given, "two numbers > 0, or none")
        return PixelMeasurement(
            t_s=t_s, station=self._station(), epoch=self._whole("epoch"), u_px=u, v_px=v, sigma_px=sigma
        )

    def _frame(self, t_s: float) -> FrameHeader:
        station, given, pattern = self._station(), self._values.get("size_px"), self._values.get("pattern")
        size_px = _size(given)
        if size_px is None:
            wanted = f"{list(self._sizes[station])} as in the rig, or another size of at most {MAX_PICTURE_PX} pixels"
            raise self._fault("size_px", given, wanted)
        if pattern is not None and pattern not in [p.value for p in BayerPattern]:
            raise self._fault("pattern", pattern, "a Bayer pattern or null")
        return FrameHeader(
            t_s=t_s,
            station=station,
            epoch=self._whole("epoch"),
            size_px=size_px,
            pattern=None if pattern is None else BayerPattern(pattern),
        )

    def _pixels(self) -> PixelsNote:
        rows = self._values.get("parts")
        if not isinstance(rows, list) or len(rows) > _MAX_PARTS or not all(isinstance(r, dict) for r in rows):
            raise self._fault("parts", rows, f"at most {_MAX_PARTS} parts")
        colour = self._flag("colour")
        parts = []
        for row in rows:
            part = _EventFields(row, self._sizes, self._where)
            x, y, w, h = (part._whole(key) for key in "xywh")
            parts.append(PartNote(topic=part._text("topic"), x=x, y=y, w=w, h=h))
        return PixelsNote(of=self._whole("of"), parts=tuple(parts), colour=colour)

    def _station(self, name: object = None) -> str:
        name = self._values.get("station") if name is None else name
        if not isinstance(name, str) or name not in self._sizes:
            raise self._fault("station", name, "one of " + ", ".join(self._sizes))
        return name

    def _stations(self) -> tuple[str, ...]:
        names = self._values.get("stations")
        if not isinstance(names, list) or len(names) > _MAX_STATIONS:
            raise self._fault("stations", names, "a list of stations")
        return tuple(self._station(name) for name in names)

    def _vector(self, key: str) -> Sequence[float]:
        values = self._values.get(key)
        if not isinstance(values, list) or len(values) != 3:
            raise self._fault(key, values, "three numbers")
        return [self._number(key, value) for value in values]

    def _number(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _MOST:
            raise self._fault(key, value, f"a finite number of at most {_MOST:g}")
        return float(value)

    def _whole(self, key: str) -> int:
        value = self._values.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _MAX_WHOLE:
            raise self._fault(key, value, "a whole number from 0")
        return value

    def _text(self, key: str) -> str:
        value = self._values.get(key)
        if not isinstance(value, str):
            raise self._fault(key, value, "text")
        return value

    def _flag(self, key: str) -> bool:
        value = self._values.get(key)
        if not isinstance(value, bool):
            raise self._fault(key, value, "true or false")
        return value

    def _fault(self, key: str, got: object, wanted: str) -> RecordingError:
        return RecordingError(f"{self._where}: {key}", got=quoted(got), wanted=wanted)


def _size(given: object) -> tuple[int, int] | None:
    """Return a picture's width and height, which a camera in operation may change; None for what is none."""
    if not isinstance(given, list) or len(given) != 2 or not all(type(v) is int and v > 0 for v in given):
        return None
    w, h = given
    return (w, h) if w * h <= MAX_PICTURE_PX else None


def part_inside(part: PartNote, size_px: tuple[int, int]) -> bool:
    """Return whether a part is not empty and inside the picture (w, h)."""
    window = box_of_size(part.x, part.y, part.w, part.h)
    return part.w > 0 and part.h > 0 and clip(window, size_px) == window


def stamp_ns(t_s: float) -> int:
    """Return a time as an MCAP time stamp in whole ns; the JSON lines hold the exact times."""
    return min(max(round(t_s * 1e9), 0), 2**62) if math.isfinite(t_s) else 0
