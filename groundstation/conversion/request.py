"""What `groundstation import` is asked for."""

from dataclasses import dataclass, field
from pathlib import Path

from groundstation.session.logs.fixes import LogOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportRequest:
    """What to make a session of.

    Attributes
    ----------
    videos : by the name of their station, in the rig's order.
    rig, out : the rig file, and the folder to make.
    dgps, ptu, frames : a log of positions, a table of angles, a table of frame times; None where there is none.
    origin_deg_m, azimuth_deg : latitude, longitude, ellipsoid height of the session's origin; where +y points.
    starts : by station, when its first frame was taken: UTC as text, or s since the epoch.
    ptu_start : what zero of the table's t_s is, likewise; None for the epoch.
    epoch : zero of the session's clock, UTC as text; None to choose it.
    reading : what the log leaves open.
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
class Imported:
    """What was made: the folder's files, and lines that say what is in them and what was left out."""

    folder: Path
    files: tuple[Path, ...]
    summary: tuple[str, ...]
    remarks: tuple[str, ...]
