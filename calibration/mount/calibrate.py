"""The whole job of `groundstation calibrate mount`: sightings in, a better rig out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from calibration.mount.fit import MountFit, MountFitError, require_enough, solve_mount
from calibration.mount.parameters import (
    POSITION,
    UNKNOWN_DISTANCE_M,
    choose_mount,
    mount_words,
    solved_station,
)
from calibration.mount.pointing import USABLE_DEG, pointing_sigma
from calibration.mount.problem import Mark, MarkKind, MountProblem, MountSightings
from calibration.mount.start import mount_starts
from calibration.sightings import Landmark, LandmarkSighting, read_landmarks, read_sightings
from groundstation.arrays import FloatArray
from groundstation.errors import InputError, RigError, os_words
from groundstation.files.toml_table import quoted
from groundstation.files.whole_file import write_whole
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station
from groundstation.rig.rig_toml import rig_to_toml

# residuals of so many sigmas are no noise, whatever their number
_WORST_NOISE_FACTOR = 30.0
# readings this close are one standstill, unless specified
_SAME_RAD = 1e-9
_WRONG_SENSE_SIGMAS = 6.0
# a direction known no better is not written down: 8 m along the runway at 400 m
_WORST_DEG = 0.03
# error of a camera mounted by eye: less information than this makes a rig worse as often as better
_WORST_UNTIED_DEG = 0.1
# more is no job for a morning, where other marks do with a tenth
_MOST_SIGHTINGS = 3_000
# a rig with a known orientation is closer than this
_FARTHEST_RAD = float(np.radians(30.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationMount:
    """One station's result: before, after, and the fit."""

    before: Station
    after: Station
    fit: MountFit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountCalibration:
    """All stations with sightings, and the rig with the estimates."""

    stations: tuple[StationMount, ...]
    rig: Rig


def marks_of(landmarks: Mapping[str, Landmark], names: Sequence[str]) -> tuple[Mark, ...]:
    """Return the marks of names; one without a description is a point of unknown place."""
    marks = []
    for name in names:
        known = landmarks.get(name)
        kind = MarkKind.UNKNOWN_POINT
        if known is not None and known.kind == "direction":
            kind = MarkKind.UNKNOWN_DIRECTION if known.place is None else MarkKind.DIRECTION
        elif known is not None and known.place is not None:
            kind = MarkKind.POINT
        unknown = np.array([0.0, UNKNOWN_DISTANCE_M if kind is MarkKind.UNKNOWN_POINT else 1.0, 0.0])
        place = unknown if known is None or known.place is None else known.place
        sigma = np.zeros(3) if known is None else known.sigma
        marks.append(Mark(name=name, kind=kind, place_m=place, sigma=sigma, runway_from_board=np.eye(3)))
    return tuple(marks)


def mount_sightings(rows: Sequence[LandmarkSighting], names: Sequence[str], path: str) -> MountSightings:
    """Return one station's rows of sightings.csv; rows in turn at the same angles and time are one reading."""
    readings = np.array([(row.pan_rad, row.tilt_rad) for row in rows])
    moved = np.zeros(len(rows), dtype=np.bool_)
    moved[1:] = np.abs(np.diff(readings, axis=0)).max(axis=1) > _SAME_RAD
    moved[1:] |= np.array([a.t_s != b.t_s for a, b in pairwise(rows)], dtype=np.bool_)
    return MountSightings(
        reading_rad=readings,
        sense=np.array([(row.pan_from, row.tilt_from) for row in rows], dtype=np.float64),
        pixel_px=np.array([row.pixel_px for row in rows]),
        sigma_px=np.array([row.sigma_px for row in rows]),
        pointing=np.cumsum(moved).astype(np.int64),
        mark=np.array([names.index(row.landmark) for row in rows], dtype=np.int64),
        body_m=np.zeros((len(rows), 3)),
        label=tuple(f"{path}, line {row.line}: {row.landmark}" for row in rows),
    )


def calibrate_station(
    station: Station, known: ParameterCovariance, seen: MountSightings, marks: Sequence[Mark], words: Sequence[str]
) -> StationMount:
    """Find how one camera sits on its head; ``known`` is its `Rig.station_covariance`.

    Raises `MountFitError` where the sightings do not determine it.
    """
    _require_ready(station, marks)
    used = sorted(set(seen.mark.tolist()))
    number = {old: new for new, old in enumerate(used)}
    seen = replace(seen, mark=np.array([number[k] for k in seen.mark.tolist()], dtype=np.int64))
    marks = tuple(marks[k] for k in used)
    chosen = choose_mount(station, known, marks, words)
    names, prior = tuple(chosen), np.array(list(chosen.values()))
    best: MountFit | None = None
    fault: MountFitError | None = None
    require_enough(MountProblem(station=station, sightings=seen, marks=marks, names=names, prior_sigma=prior))
    for start in mount_starts(station, seen, marks):
        problem = MountProblem(
            station=start.station,
            sightings=seen,
            marks=start.marks,
            names=names,
            # the prior is that of the rig's own values
            prior_sigma=_about(prior, station, start.station, names),
        )
        try:
            fit = solve_mount(problem, np.zeros(len(names)))
        except MountFitError as error:
            fault = fault or error
            continue
        if best is None or _cost(fit) < _cost(best):
            best = fit
    if best is None:
        raise fault or MountFitError(f"station {station.name}: got sightings that no camera on a head would have")
    if best.noise_factor > _WORST_NOISE_FACTOR:
        got = f"sightings that fit to {best.rms_px:.1f} px only"
        wanted = "marks that stand still, the lens of this camera, and angles with the signs of docs/conventions.md"
        raise MountFitError(f"station {station.name}: got {got}; wanted {wanted}")
    _require_signs(station, best)
    _require_senses(best)
    _require_determined(best, words)
    return StationMount(before=station, after=solved_station(station, known, best), fit=best)


def _require_signs(station: Station, fit: MountFit) -> None:
    """Raise `MountFitError` where a camera's orientation is not plausible.

    An axis with the wrong sign gives a camera that points backwards, or is upside down.
    """
    if "orientation" not in station.known:
        return
    found = fit.problem.station_at(fit.change)
    for name in ("head_from_camera_wxyz", "runway_from_base_wxyz"):
        turned = 2.0 * np.arccos(min(1.0, abs(float(getattr(found, name) @ getattr(station, name)))))
        if turned > _FARTHEST_RAD:
            got = f"a {name.removesuffix('_wxyz')} {np.degrees(turned):.0f} deg off the rig's"
            wanted = "angles with the signs of docs/conventions.md, or a rig without orientation in `known`"
            raise MountFitError(f"station {station.name}: got {got}; wanted {wanted}")


def _require_senses(fit: MountFit) -> None:
    """Raise `MountFitError` where a backlash is clearly negative: the senses are inverted."""
    axes = fit.problem.axes(fit.change)
    for name, value in (("pan", axes.pan_backlash_rad), ("tilt", axes.tilt_backlash_rad)):
        if value < -_WRONG_SENSE_SIGMAS * fit.sigma(f"{name}_backlash") and f"{name}_backlash" in fit.problem.names:
            got = f"a {name} backlash of {np.degrees(value):.4f} deg"
            wanted = f"{name}_from +1 where the reading grew last, -1 where it shrank"
            raise MountFitError(f"station {fit.problem.station.name}: got {got}; wanted {wanted}")


def _require_determined(fit: MountFit, words: Sequence[str]) -> None:
    """Raise `MountFitError` where too few sightings determine the camera's orientation, with the number needed.

    A standstill gives two angles: with fewer standstills than unknowns of the mount hardly any redundancy would be left
    to detect a wrong sighting.
    """
    if "boresight" not in words:
        return
    seen = fit.problem.sightings
    count, standing = len(seen), len(np.unique(fit.problem.stand[fit.kept]))
    unknowns = sum(not name.startswith(("mark ", *POSITION)) for name in fit.problem.names)
    determined_deg = pointing_sigma(fit, sightings_only=True).worst_deg
    # one board at an unknown position cannot determine it better, but is useful for the rest
    tied = any(mark.kind.known for mark in fit.problem.marks)
    if not tied:
        _require_aimed(fit, determined_deg)
    if standing >= unknowns and (determined_deg <= _WORST_DEG or not tied):
        return
    got = f"{count} sightings at {standing} pairs of angles for {unknowns} unknowns, the camera's orientation known to"
    got += f" {determined_deg:.2g} deg"
    needed = max(2 * unknowns, int(np.ceil(count * (determined_deg / USABLE_DEG) ** 2)))
    # no patience makes up for marks in a line
    many = f"some {needed} sightings of" if needed <= _MOST_SIGHTINGS else "other"
    wanted = f"{USABLE_DEG:g} deg: {many} marks of known place, far apart in pan and 20 deg or more in"
    wanted += " tilt, each brought near the corners of the picture"
    raise MountFitError(f"station {fit.problem.station.name}: got {got}; wanted {wanted}")


def _require_aimed(fit: MountFit, determined_deg: float) -> None:
    """Raise `MountFitError` where marks of unknown position give the boresight's pan and tilt worse than the prior.

    A point's own direction absorbs an error of pan and tilt; only the rotation and spread of its pixels with the
    angles remain, which are nearly zero near the horizon. A board's corners have directions to each other.
    """
    marks = fit.problem.marks
    if determined_deg <= _WORST_UNTIED_DEG or any(mark.kind is MarkKind.BOARD for mark in marks):
        return
    count, what = len(marks), "one mark" if len(marks) == 1 else f"{len(marks)} marks"
    got = f"{len(fit.problem.sightings)} sightings of {what} of unknown place: the camera's orientation is undetermined"
    got += f" by {determined_deg:.2g} deg"
    place, other = ("its place", "a second mark") if count == 1 else ("their places", "another mark")
    wanted = f"{place} (--landmarks), {other} 40 deg or more above the horizon, or a board (--board)"
    raise MountFitError(f"station {fit.problem.station.name}: got {got}; wanted {wanted}")


def _cost(fit: MountFit) -> float:
    return fit.noise_factor + 10.0 * float(np.mean(~fit.kept))


def _about(prior: FloatArray, rig: Station, start: Station, names: Sequence[str]) -> FloatArray:
    """Return sigmas before, of a rotation that does not start at the rig's own opened."""
    moved = {
        "runway_from_base": not np.allclose(rig.runway_from_base_wxyz, start.runway_from_base_wxyz),
        "head_from_camera": not np.allclose(rig.head_from_camera_wxyz, start.head_from_camera_wxyz),
    }
    return np.array([np.inf if moved.get(n.partition(".")[0]) else s for n, s in zip(names, prior, strict=True)])


def _require_ready(station: Station, marks: Sequence[Mark]) -> None:
    where = f"station {station.name}"
    if station.fixed:
        raise RigError(where, got="a station without PTU", wanted="one that turns")
    if "lens" not in station.known:
        raise RigError(where, got="no lens", wanted="a calibrated lens (`groundstation calibrate intrinsics`)")
    if "position" not in station.known and any(mark.kind is MarkKind.POINT for mark in marks):
        wanted = "its ptu_position_m (`groundstation calibrate survey`), or landmarks without coordinates"
        raise RigError(where, got="landmarks with coordinates, but no position", wanted=wanted)


def calibrate_mounts(
    rig: Rig, seen: Mapping[str, MountSightings], marks: Sequence[Mark], free: str = ""
) -> MountCalibration:
    """Calibrate every station that has sightings, each separately."""
    words = mount_words(free)
    found = [
        calibrate_station(rig[name], rig.station_covariance(name), sightings, marks, words)
        for name, sightings in seen.items()
    ]
    after = {one.after.name: one.after for one in found}
    # correlations with other stations were those of the previous values
    fitted = {f"{one.after.name}.{name}" for one in found for name in one.fit.problem.names}
    shared = rig.shared_covariance
    keep = [k for k, name in enumerate(shared.names) if name not in fitted or name.split(".")[1] == "ptu_position"]
    shared = ParameterCovariance(names=tuple(shared.names[k] for k in keep), matrix=shared.matrix[np.ix_(keep, keep)])
    stations = tuple(after.get(s.name, s) for s in rig.stations)
    return MountCalibration(stations=tuple(found), rig=replace(rig, stations=stations, shared_covariance=shared))


def write_rig(path: Path, found: MountCalibration) -> None:
    """Write the rig file; raises `InputError` where it cannot be written."""
    notes = [f"# mount of {one.before.name}: {len(one.fit.kept)} sightings" for one in found.stations]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, "\n".join([*notes, ""]) + rig_to_toml(found.rig))
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error


def read_mount_tables(
    sightings: Path, landmarks: Path | None, rig: Rig
) -> tuple[dict[str, MountSightings], tuple[Mark, ...]]:
    """Read sightings.csv and landmarks.csv: each station's sightings, and the marks; raises `InputError`."""
    rows = read_sightings(sightings)
    known = {} if landmarks is None else read_landmarks(landmarks)
    for row in rows:
        if row.station not in rig.names:
            wanted = "a station of the rig: " + ", ".join(rig.names)
            raise InputError(f"{sightings.name}: line {row.line}", got=f"station {quoted(row.station)}", wanted=wanted)
    names = list(dict.fromkeys(row.landmark for row in rows))
    stations = dict.fromkeys(row.station for row in rows)
    seen = {name: mount_sightings([r for r in rows if r.station == name], names, sightings.name) for name in stations}
    return seen, marks_of(known, names)
