"""Import of videos, a log and tables as a session folder; on invalid input nothing is written."""

import errno
import itertools
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.conversion.angle_table import AngleTable, read_angle_table
from groundstation.conversion.import_clock import ImportClock, import_clock
from groundstation.conversion.import_request import ImportRequest, ImportResult
from groundstation.conversion.unused_options import unused_options
from groundstation.conversion.video_frame_pairing import frames_csv, paired
from groundstation.conversion.video_stamps import VideoStamps, read_video_stamps
from groundstation.errors import InputError, SessionError, os_words
from groundstation.files.csv_table import CsvTable
from groundstation.files.output_names import below
from groundstation.files.toml_table import TomlTable
from groundstation.messages import DgpsFix
from groundstation.rig.rig import Rig, load_rig
from groundstation.session import load_session
from groundstation.session.folder import read_target
from groundstation.session.logs.gps_time import utc_text
from groundstation.session.logs.placement import place_log
from groundstation.session.logs.positions_table import has_positions
from groundstation.session.logs.read import GnssLog, read_log
from groundstation.sources.frame_table import read_frames
from groundstation.tracking.config import config_to_toml

_MAX_TABLE_BYTES = 2_000_000_000


@dataclass(slots=True)
class _Parts:
    """Contents of the folder, checked but not yet written."""

    texts: dict[str, str]
    copies: dict[str, Path]
    summary: list[str]
    remarks: list[str]


def import_session(request: ImportRequest, progress: Callable[[int], None] = lambda _: None) -> ImportResult:
    """Make the folder.

    Raises `InputError` (one line: where, got, wanted) for anything that cannot be right; then no folder is made.
    """
    _check_paths(request)
    _check_target(request)
    rig = load_rig(request.rig)
    _check_rig(request, rig)
    log = _log(request)
    clock = import_clock(request, log)
    parts = _Parts(texts={}, copies={}, summary=[], remarks=[] if log is None else list(log.remarks))
    # before the videos are read, which takes long
    fixes = _placed(request, log, clock)
    angles = _angles(request, rig, clock)
    parts.remarks += _exchanged(request) + unused_options(request, rig, log)
    span = _frames(request, rig, clock, parts, progress)
    if angles is not None:
        angles.require_overlap(*span)
        parts.texts["ptu.csv"] = angles.text
        parts.summary.append(f"{angles.name}: {angles.rows} readings")
    if request.dgps is not None:
        _positions(request, rig, fixes, clock, span, parts)
    parts.texts["session.toml"] = config_to_toml(_session(request, clock)) + "\n"
    parts.copies["rig.toml"] = request.rig
    files = _write(request, parts)
    return ImportResult(folder=request.out, files=files, summary=tuple(parts.summary), remarks=tuple(parts.remarks))


def _angles(request: ImportRequest, rig: Rig, clock: ImportClock) -> AngleTable | None:
    """Read the table of angles; None where no station turns."""
    if all(station.fixed for station in rig.stations):
        return None
    if request.ptu is None:
        raise InputError("--ptu", got="nothing", wanted="the table of angles of the stations that turn")
    return read_angle_table(request.ptu, rig, clock)


def _check_paths(request: ImportRequest) -> None:
    if request.out.exists() and (not request.out.is_dir() or any(request.out.iterdir())):
        raise InputError(str(request.out), got="something that is there already", wanted="a new or an empty folder")


def _check_target(request: ImportRequest) -> None:
    target = TomlTable(_target(request), "--span, --antenna", InputError)
    read_target(target)


def _check_rig(request: ImportRequest, rig: Rig) -> None:
    if set(request.videos) != set(rig.names):
        got = f"videos of {', '.join(request.videos) or 'nothing'}"
        raise InputError(request.rig.name, got=got, wanted=f"one for each station: {', '.join(rig.names)}")
    for (first, one), (second, other) in itertools.combinations(request.videos.items(), 2):
        if os.path.realpath(one) == os.path.realpath(other):
            raise InputError(str(other), got=f"one video for {first} and {second}", wanted="each station's own")
    for name in request.starts:
        if name not in rig.names:
            raise InputError("--start", got=f"station {name!r}", wanted=f"one of {', '.join(rig.names)}")


def _exchanged(request: ImportRequest) -> list[str]:
    """Return a note for each video that is called as another station is."""
    names = {name.casefold(): name for name in request.videos}
    called = {station: names.get(path.stem.casefold(), station) for station, path in request.videos.items()}
    return [
        f"{request.videos[station].name} is given as the video of {station}: is it that of {name}?"
        for station, name in called.items()
        if name != station
    ]


def _log(request: ImportRequest) -> GnssLog | None:
    """Read a log of places on Earth; None for none, or for a table in the session's frame."""
    path = request.dgps
    if path is None:
        return None
    if path.suffix.lower() == ".csv" and path.is_file() and not has_positions(CsvTable(path, []).columns):
        return None
    if request.origin_deg_m is None or request.azimuth_deg is None:
        got = "no --origin" if request.origin_deg_m is None else "no --azimuth"
        wanted = "where the session's frame lies on Earth, and where its +y points"
        raise InputError(path.name, got=got, wanted=wanted)
    return read_log(path, request.reading)


def _placed(request: ImportRequest, log: GnssLog | None, clock: ImportClock) -> list[DgpsFix] | None:
    """Return a log's positions in the session's frame; None for none, or for a table in that frame."""
    if log is None or clock.epoch_gps_s is None or request.origin_deg_m is None or request.azimuth_deg is None:
        return None
    return place_log(log, request.origin_deg_m, request.azimuth_deg, clock.epoch_gps_s)


def _frames(
    request: ImportRequest, rig: Rig, clock: ImportClock, parts: _Parts, progress: Callable[[int], None]
) -> tuple[float, float]:
    """Add frames.csv and the videos; returns first and last time."""
    for name in rig.names:
        path = request.videos[name]
        parts.copies[f"{name}{path.suffix.lower()}"] = path
    if request.frames is not None:
        return _given_frames(request, rig, parts)
    stamps: dict[str, FloatArray] = {}
    done = 0
    for name in rig.names:
        video = read_video_stamps(request.videos[name], partial(_after, progress, done))
        done += len(video.t_s)
        _check_size(video, rig, name)
        stamps[name] = video.t_s + clock.starts_s[name]
        parts.summary.append(f"{name}: {video.summary()}")
        parts.remarks.extend(video.remarks)
    # of three cameras one may end before another one starts
    if any(not any(_overlap(t, u) for m, u in stamps.items() if m != n) for n, t in stamps.items()):
        got = ", ".join(f"{n} from {t[0]:.2f} to {t[-1]:.2f} s" for n, t in stamps.items())
        raise InputError("the videos", got=got, wanted="videos that ran at the same time; look at their starts")
    parts.texts["frames.csv"] = frames_csv(stamps)
    total = max(len(t) for t in stamps.values())
    parts.summary.append(f"{paired(stamps)} pairs of frames, of {total}")
    return min(float(t[0]) for t in stamps.values()), max(float(t[-1]) for t in stamps.values())


def _after(progress: Callable[[int], None], done: int, count: int) -> None:
    """Report frames on top of those of the videos before."""
    progress(done + count)


def _check_size(video: VideoStamps, rig: Rig, name: str) -> None:
    wanted = rig[name].lens.image_size_px
    if video.size_px != wanted:
        got = f"{video.size_px[0]}×{video.size_px[1]} px"
        raise InputError(
            video.path.name, got=got, wanted=f"{wanted[0]}×{wanted[1]} px, as station {name} has in the rig"
        )


def _overlap(one_s: FloatArray, other_s: FloatArray) -> bool:
    """Return whether two cameras, by their stamps (n,), ran at the same time."""
    return float(max(one_s[0], other_s[0])) < float(min(one_s[-1], other_s[-1]))


def _given_frames(request: ImportRequest, rig: Rig, parts: _Parts) -> tuple[float, float]:
    """Copy the user's table unchanged; loading the session checks whether it fits the videos."""
    path = request.frames
    if path is None or not path.is_file() or path.stat().st_size > _MAX_TABLE_BYTES:
        raise InputError(str(path), got="no such file, or a huge one", wanted="a table such as frames.csv")
    table = CsvTable(path, ["index", *(f"{n}_t_s" for n in rig.names)])
    times = [t for row in table for n in rig.names if (t := table.optional_number(row, f"{n}_t_s")) is not None]
    if len(times) < 2:
        raise InputError(path.name, got=f"{len(times)} times", wanted="two or more")
    parts.copies["frames.csv"] = path
    parts.summary.append(f"{path.name}: times {min(times):.2f} to {max(times):.2f} s")
    return min(times), max(times)


def _positions(
    request: ImportRequest,
    rig: Rig,
    fixes: list[DgpsFix] | None,
    clock: ImportClock,
    span: tuple[float, float],
    parts: _Parts,
) -> None:
    """Add dgps.csv; a log that has no time in common with the videos is refused."""
    path = request.dgps
    if path is None:
        return
    if fixes is None or clock.epoch_gps_s is None or request.azimuth_deg is None:
        parts.copies["dgps.csv"] = path
        parts.summary.append(f"{path.name}: taken as it is, in the session's frame and clock")
        return
    inside = [fix for fix in fixes if span[0] <= fix.t_s <= span[1]]
    if not inside:
        first, last = (utc_text(clock.epoch_gps_s + fix.t_s) for fix in (fixes[0], fixes[-1]))
        ran = " to ".join(utc_text(clock.epoch_gps_s + t) for t in span)
        raise InputError(
            path.name, got=f"positions from {first} to {last}", wanted=f"some while the cameras ran, {ran}"
        )
    kinds = {word: sum(fix.status == word for fix in inside) for word in sorted({fix.status for fix in inside})}
    words = ", ".join(f"{count} {word}" for word, count in kinds.items())
    distance = np.linalg.norm([fix.position_runway_m for fix in inside], axis=1)
    ranges = f"{distance.min():.0f} to {distance.max():.0f} m from the origin"
    parts.summary.append(
        f"{path.name}: {len(fixes)} positions, {len(inside)} while the cameras ran ({words}), {ranges}"
    )
    parts.remarks += _behind(inside, rig, request.azimuth_deg, path.name)
    parts.texts["dgps.csv"] = _dgps_csv(fixes)


def _behind(fixes: list[DgpsFix], rig: Rig, azimuth_deg: float, name: str) -> list[str]:
    """Return a note if most positions lie behind the stations (+y is ahead), with the azimuth that corrects it."""
    stations_m = min(float(s.ptu_position_m[1]) for s in rig.stations)
    behind = _behind_count(fixes, stations_m, 0.0)
    if 2 * behind <= len(fixes):
        return []
    text = f"{name}: {behind} of {len(fixes)} positions lie behind the stations at --azimuth {azimuth_deg:g}; "
    in_degrees = math.degrees(azimuth_deg)
    if 0.0 < abs(azimuth_deg) <= 2.0 * math.pi and 2 * _behind_count(
        fixes, stations_m, in_degrees - azimuth_deg
    ) <= len(fixes):
        return [f"{text}if that is in radians, it is --azimuth {in_degrees:.6g}"]
    other = (azimuth_deg + 180.0) % 360.0
    return [f"{text}if the runway is the other way round, it is --azimuth {other:g}"]


def _behind_count(fixes: list[DgpsFix], stations_m: float, turned_deg: float) -> int:
    """Return how many positions lie behind the stations if +y points so much further clockwise."""
    sine, cosine = math.sin(math.radians(turned_deg)), math.cos(math.radians(turned_deg))
    ahead_m = [fix.position_runway_m[0] * sine + fix.position_runway_m[1] * cosine for fix in fixes]
    return sum(float(y_m) < stations_m for y_m in ahead_m)


def _dgps_csv(fixes: list[DgpsFix]) -> str:
    lines = ["t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,status"]
    for fix in fixes:
        sigma = np.zeros(3) if fix.sigma_m is None else fix.sigma_m
        numbers = [f"{fix.t_s:.6f}", *(f"{v:.4f}" for v in (*fix.position_runway_m, *sigma))]
        lines.append(",".join([*numbers, fix.status]))
    return "\n".join(lines) + "\n"


def _session(request: ImportRequest, clock: ImportClock) -> dict[str, Any]:
    """Return session.toml as tables of plain values."""
    tables: dict[str, Any] = {"name": request.name or Path(os.path.realpath(request.out)).name}
    if request.origin_deg_m is not None and request.azimuth_deg is not None:
        keys = ("lat_deg", "lon_deg", "height_m", "y_axis_azimuth_deg")
        tables["origin"] = dict(zip(keys, (*request.origin_deg_m, request.azimuth_deg), strict=True))
    if target := _target(request):
        tables["target"] = target
    dgps: dict[str, Any] = {}
    if clock.epoch_gps_s is not None:
        dgps["epoch_utc"] = clock.epoch_text()
    if request.reading.geoid_separation_m is not None:
        # dgps.csv no longer needs it, but a map of the track does
        dgps["geoid_separation_m"] = request.reading.geoid_separation_m
    if dgps:
        tables["dgps"] = dgps
    return tables


def _target(request: ImportRequest) -> dict[str, Any]:
    """Return the table [target] of session.toml."""
    target: dict[str, Any] = {}
    if request.span_m is not None:
        target["span_m"] = request.span_m
    if request.antenna_in_body_m is not None:
        target["antenna_in_body_m"] = list(request.antenna_in_body_m)
    return target


def _write(request: ImportRequest, parts: _Parts) -> tuple[Path, ...]:
    """Write to a temporary folder, load it as a replay does, then rename it."""
    draft = request.out.with_name(request.out.name + ".partial")
    if draft.exists():
        raise InputError(str(draft), got="what an interrupted import has left", wanted="it removed")
    try:
        draft.mkdir(parents=True)
        for name, text in parts.texts.items():
            below(draft, name).write_text(text, encoding="utf-8", newline="\n")
        for name, source in parts.copies.items():
            if request.link and name.rpartition(".")[0] in request.videos:
                below(draft, name).symlink_to(Path(os.path.realpath(source)))
            else:
                shutil.copyfile(source, below(draft, name))
        session = load_session(draft)
        table = read_frames(session)
        if table.fault is not None:
            raise table.fault
        if request.out.is_dir():
            request.out.rmdir()
        draft.rename(request.out)
    except OSError as fault:
        wanted = "room on the disk" if fault.errno in (errno.ENOSPC, errno.EDQUOT) else "a folder that can be written"
        raise SessionError(str(request.out), got=os_words(fault), wanted=wanted) from fault
    finally:
        if draft.exists():
            shutil.rmtree(draft)
    return tuple(request.out / name for name in (*parts.texts, *parts.copies))
