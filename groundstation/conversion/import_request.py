"""Request and result of `groundstation import`."""

from dataclasses import dataclass, field
from pathlib import Path

from groundstation.session.logs.fixes import LogOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportRequest:
    """Inputs of an import.

    Attributes
    ----------
    videos : by the name of their station, in the rig's order.
    rig, out : the rig file, and the folder to make.
    dgps, ptu, frames : a log of positions, a table of angles, a table of frame times; None if absent.
    origin_deg_m, azimuth_deg : latitude, longitude, ellipsoid height of the session's origin; where +y points.
    starts : by station, the time of its first frame: UTC as text, or s since the epoch.
    ptu_start : zero of the table's t_s, likewise; None for the epoch.
    epoch : zero of the session's clock, UTC as text; None to choose it.
    reading : options for the log.
    link : make links to the videos instead of copies.
    span_m, antenna_in_body_m : of the aircraft, where known.
    """

    videos: dict[str, Path]
    rig: Path
    out: Path
    dgps: Path | None = None
    ptu: Path | None = None
    frames: Path | None = None
    origin_deg_m: tuple[float, float, float] | None = None
    azimuth_deg: float | None = None
    starts: dict[str, str] = field(default_factory=dict)
    ptu_start: str | None = None
    epoch: str | None = None
    reading: LogOptions = field(default_factory=LogOptions)
    link: bool = False
    name: str = ""
    span_m: float | None = None
    antenna_in_body_m: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportResult:
    """The files written, and notes on their contents and on omitted data."""

    folder: Path
    files: tuple[Path, ...]
    summary: tuple[str, ...]
    remarks: tuple[str, ...]
