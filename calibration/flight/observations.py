"""Gathering a flight's observations from a session folder: pixels, angles, and valid DGPS fixes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline

from calibration.flight.problem import SLOW_S, AngleCurve, StationObservations
from calibration.flight.reference_track import ReferenceTrack
from calibration.flight.smoothing_spline import smoothing_spline
from groundstation.arrays import FloatArray
from groundstation.errors import RigError, SessionError
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.position_series import reference_from_fixes
from groundstation.evaluation.reference_exclusion import covers, find_frozen, find_gaps, find_glitches
from groundstation.files.csv_table import CsvTable
from groundstation.files.toml_table import quoted
from groundstation.rig.rig import Station
from groundstation.session import Session
from groundstation.session.references import load_dgps
from groundstation.sources.external_detections import read_detections
from groundstation.sources.ptu_readings import PtuReadings
from groundstation.tracking.synchronise import SynchroniseConfig

# a filter's gates depend on the rig that is to be corrected: pixels refused by them are tested again here
_SEEN = ("ok", "late", "gated", "excluded")
# more pixels of one station add no information
MOST_LOOKS = 2500
_ASSUMED_SIGMA_PX = 1.0
_AROUND_S = 5.0
_LEAST_STRETCH = 12
# readings closer than this share of the usual step are one
_AT_ONCE = 0.05
# a reading so close to an exposure is its own
_OWN_S = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightData:
    """Data of a session for the calibration.

    ``observations`` by station; ``track`` the antenna's path in the DGPS clock; ``excluded`` the omissions, in words.
    """

    observations: dict[str, StationObservations]
    track: ReferenceTrack
    excluded: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pixels:
    """One station's rows (n, 3) of session time, u, v; sigmas (n, 2)."""

    rows: FloatArray
    sigma_px: FloatArray
    sigma_given: bool


def gather_flight(session: Session, detections: Path | None, from_s: float | None, to_s: float | None) -> FlightData:
    """Read pixels between two session times, the PTUs' readings around them, and the valid part of DGPS.

    Raises `SessionError` or `RigError` for missing data.
    """
    for station in session.rig.stations:
        if "lens" not in station.known:
            wanted = "a calibrated lens (focal_px, principal_point_px, image_size_px): a flight does not find it"
            raise RigError(f"{session.rig.path}: station {station.name}", got="no lens", wanted=wanted)
    if session.media and detections is None:
        wanted = "--detections FILE, the detections.csv that a replay of it wrote"
        raise SessionError(str(session.folder), got="videos", wanted=wanted)
    pixels = _replayed(session, detections) if detections is not None else _labelled(session)
    first, last = (-np.inf if from_s is None else from_s), (np.inf if to_s is None else to_s)
    excluded: list[str] = []
    pixels = {name: _thinned(_between(found, first, last), name, excluded) for name, found in pixels.items()}
    track = _track(session, excluded)
    stamps = np.concatenate([found.rows[:, 0] for found in pixels.values()])
    _require_overlap(session, stamps, track)
    readings = read_angles(session, float(stamps.min()), float(stamps.max()))
    observations = {
        s.name: _station_observations(s, pixels[s.name], readings.get(s.name)) for s in session.rig.stations
    }
    return FlightData(observations=observations, track=track, excluded=tuple(excluded))


def _labelled(session: Session) -> dict[str, _Pixels]:
    """Return the session's own pixels."""
    labels, fault = read_detections(session)
    if fault is not None:
        raise fault
    found = {}
    for name, rows in labels.items():
        given = np.isfinite(rows[:, 3:])
        sigma = np.where(given, rows[:, 3:], _ASSUMED_SIGMA_PX)
        found[name] = _Pixels(rows=rows[:, :3], sigma_px=sigma, sigma_given=bool(len(rows) and given.all()))
    return found


def _replayed(session: Session, path: Path) -> dict[str, _Pixels]:
    """Return the pixels that a replay found; their times are the session's already."""
    table = CsvTable(path, ["t_s", "station", "u_px", "v_px"])
    with_sigma = {"sigma_u_px", "sigma_v_px"} <= set(table.columns)
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in session.rig.names}
    for row in table:
        name = row.text["station"].strip()
        if name in session.left_out:
            continue
        if name not in found:
            raise table.fault(row.line, got=f"station {quoted(name)}", wanted="one of " + ", ".join(found))
        if row.text.get("status", "ok").strip() not in _SEEN:
            continue
        values = [table.optional_number(row, c) for c in ("t_s", "u_px", "v_px")]
        sigmas = [table.optional_number(row, c) if with_sigma else None for c in ("sigma_u_px", "sigma_v_px")]
        known = [v for v in values if v is not None]
        if len(known) == len(values):
            found[name].append((*known, *(s if s else _ASSUMED_SIGMA_PX for s in sigmas)))
    result = {}
    for name, rows in found.items():
        array = np.array(rows, dtype=np.float64).reshape(-1, 5)
        array = array[np.argsort(array[:, 0], kind="stable")]
        result[name] = _Pixels(rows=array[:, :3], sigma_px=array[:, 3:], sigma_given=with_sigma)
    return result


def _between(found: _Pixels, from_s: float, to_s: float) -> _Pixels:
    inside = (found.rows[:, 0] >= from_s) & (found.rows[:, 0] <= to_s)
    return _Pixels(rows=found.rows[inside], sigma_px=found.sigma_px[inside], sigma_given=found.sigma_given)


def _thinned(found: _Pixels, name: str, excluded: list[str]) -> _Pixels:
    """Return evenly chosen pixels of a station, at most `MOST_LOOKS`, and report the omission."""
    step = max(1, -(-len(found.rows) // MOST_LOOKS))
    if step > 1:
        left = len(found.rows) - len(found.rows[::step])
        excluded.append(f"{left} of {len(found.rows)} pixels of {name}: one in {step} is used, more add no information")
    return _Pixels(rows=found.rows[::step], sigma_px=found.sigma_px[::step], sigma_given=found.sigma_given)


def _track(session: Session, excluded: list[str]) -> ReferenceTrack:
    """Return the path through the valid fixes, and report the omissions."""
    fixes = load_dgps(session, on_note=excluded.append)
    if not fixes:
        raise SessionError(session.name, got="no DGPS", wanted="dgps.csv, the aircraft's own track")
    config = EvaluationConfig()
    reference = reference_from_fixes(fixes)
    broken = [*find_frozen(reference, None, 0.0, config), *find_glitches(reference, config)]
    gaps = find_gaps(reference, config.max_interpolation_gap_s)
    for span in sorted([*broken, *gaps], key=lambda s: s.from_s):
        excluded.append(f"DGPS {span.from_s:.2f} to {span.to_s:.2f} s: {span.reason}, {span.detail}")
    good = reference.keep(~covers(broken, reference.t_s))
    return ReferenceTrack(good, config.max_interpolation_gap_s)


def _require_overlap(session: Session, stamps_s: FloatArray, track: ReferenceTrack) -> None:
    """Raise `SessionError` where pixels and fixes have no time in common."""
    if not len(stamps_s):
        wanted = "pixels of the aircraft in flight (a replay finds none with a rig that is further off than it states)"
        raise SessionError(session.name, got="no pixel in that time", wanted=wanted)
    first, last = track.span_s
    start, end = float(stamps_s.min()), float(stamps_s.max())
    if last < start or first > end:
        got = f"DGPS from {first:.10g} to {last:.10g} s, pixels from {start:.10g} to {end:.10g} s"
        raise SessionError(session.name, got=got, wanted="a DGPS log of the same flight ([clocks] in session.toml)")


def read_angles(session: Session, from_s: float, to_s: float) -> dict[str, FloatArray]:
    """Return each turning station's readings (m, 3): session time, pan, tilt."""
    if all(s.fixed for s in session.rig.stations):
        return {}
    source = PtuReadings(session)
    source.start(from_s - _AROUND_S, to_s + _AROUND_S)
    rows: dict[str, list[tuple[float, float, float]]] = {s.name: [] for s in session.rig.stations if not s.fixed}
    for sample in source.until(to_s + _AROUND_S):
        rows[sample.station].append((sample.t_s, sample.pan_rad, sample.tilt_rad))
    if source.fault is not None:
        raise source.fault
    return {name: np.array(values, dtype=np.float64).reshape(-1, 3) for name, values in rows.items()}


def _station_observations(station: Station, found: _Pixels, readings: FloatArray | None) -> StationObservations:
    if readings is None:
        readings = np.zeros((0, 3))
    elif len(readings) < 2:
        got = f"{len(readings)} readings of its PTU"
        raise SessionError(f"station {station.name}", got=got, wanted="readings around the frames")
    times, first = np.unique(readings[:, 0], return_index=True)
    angles = readings[first, 1:]
    if len(angles):
        angles = np.unwrap(angles, axis=0)
    return StationObservations(
        t_s=found.rows[:, 0],
        pixel_px=found.rows[:, 1:],
        sigma_px=found.sigma_px,
        sigma_given=found.sigma_given,
        row_share=(found.rows[:, 2] + 0.5) / station.lens.image_size_px[1] - 0.5,
        readings_s=times,
        readings_rad=angles,
        max_gap_s=SynchroniseConfig().max_gap_s,
        curves=_curves(times, angles),
        own_readings=_own_readings(found.rows[:, 0], times),
    )


def _own_readings(exposed_s: FloatArray, readings_s: FloatArray) -> bool:
    """Return whether readings are slow and there is one at each exposure."""
    if len(readings_s) < 2 or np.median(np.diff(readings_s)) < SLOW_S:
        return False
    right = np.clip(np.searchsorted(readings_s, exposed_s), 1, len(readings_s) - 1)
    away = np.minimum(np.abs(readings_s[right] - exposed_s), np.abs(readings_s[right - 1] - exposed_s))
    return bool(np.all(away < _OWN_S))


def _curves(t_s: FloatArray, angles_rad: FloatArray) -> tuple[AngleCurve, ...]:
    """Return smooth curves through readings (n, 2), from gap to gap, by generalised cross-validation.

    Straight lines between noisy readings have the least noise half-way between them, and cut the corners of a head that
    accelerates: an offset of the PTU's clock would be biased. And where a head follows the aircraft, its residual
    turning must not be the readings' noise. Between distant readings the motion of the head is
    unknown, and treated as such (`calibration.flight.paths`).
    """
    if len(t_s) < _LEAST_STRETCH:
        return ()
    step = np.diff(t_s)
    stretches = np.split(np.arange(len(t_s)), np.flatnonzero(step > SynchroniseConfig().max_gap_s) + 1)
    # a device that sends two readings at once holds no information on the time between them
    apart = np.concatenate([[True], step > _AT_ONCE * np.median(step)])
    stretches = [k[apart[k]] for k in stretches]
    return tuple(
        AngleCurve(
            from_s=float(t_s[k[0]]),
            to_s=float(t_s[k[-1]]),
            axes=(_curve(t_s[k], angles_rad[k, 0]), _curve(t_s[k], angles_rad[k, 1])),
        )
        for k in stretches
        if len(k) >= _LEAST_STRETCH
    )


def _curve(t_s: FloatArray, angle_rad: FloatArray) -> BSpline:
    # about zero and in milliradians: the choice of smoothness is no matter of digits
    middle = float(angle_rad.mean())
    spline = smoothing_spline(t_s, 1e3 * (angle_rad - middle))
    return BSpline(spline.t, 1e-3 * spline.c + middle, spline.k)
