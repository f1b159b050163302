"""An estimate with its advice and deviations as a JSON object: what other programs get over UDP."""

from typing import Any

from groundstation.approach.approach_state import ApproachState
from groundstation.arrays import FloatArray
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.integrity.approach_advice import ApproachAdvice
from groundstation.landing.glide_path import ApproachDeviations
from groundstation.landing.threshold_state import LinearValue
from groundstation.landing.touchdown import TouchdownForecast
from groundstation.messages import Kinematics, TrackStatus

ESTIMATE_FORMAT = "groundstation-estimate/1"


def estimate_record(
    t_s: float,
    status: TrackStatus,
    kinematics: Kinematics | None,
    seen_by: frozenset[str],
    state: ApproachState,
    *,
    unix_s: float,
    frame: LocalFrame | None,
) -> dict[str, Any]:
    """Return the object of an estimate at session time ``t_s``; ``unix_s`` is what is added for Unix time.

    Where nothing is known, the value is null. Frames and units as in track.csv; latitude and longitude in degrees and
    height above the ellipsoid where the runway frame's place on Earth is known.
    """
    record: dict[str, Any] = {
        "format": ESTIMATE_FORMAT,
        "t_s": t_s,
        "unix_s": t_s + unix_s,
        "status": str(status),
        "seen_by": sorted(seen_by),
        "position_runway_m": None if kinematics is None else _rounded(kinematics.position_runway_m),
        "velocity_runway_m_s": None if kinematics is None else _rounded(kinematics.velocity_runway_m_s),
        "covariance": None if kinematics is None else _rounded(kinematics.covariance.ravel(), 9),
    }
    if frame is not None:
        record |= _place(kinematics, frame)
    record["advice"] = None if state.advice is None else _advice(state.advice)
    record["deviations"] = None if state.deviations is None else _deviations(state.deviations)
    record["touchdown"] = None if state.touchdown is None else _touchdown(state.touchdown)
    return record


def _place(kinematics: Kinematics | None, frame: LocalFrame) -> dict[str, float | None]:
    if kinematics is None:
        return dict.fromkeys(("lat_deg", "lon_deg", "height_ellipsoid_m"))
    place = frame.geodetic(frame.ned_from_runway @ kinematics.position_runway_m)
    return {
        "lat_deg": round(place.lat_deg, 9),
        "lon_deg": round(place.lon_deg, 9),
        "height_ellipsoid_m": round(place.height_ellipsoid_m, 4),
    }


def _advice(advice: ApproachAdvice) -> dict[str, Any]:
    levels = advice.levels
    return {
        "level": str(advice.level),
        "reason": advice.reason,
        "valid_until_s": advice.valid_until_s,
        "protection_m": None
        if levels is None
        else {"along": levels.along_m, "lateral": levels.lateral_m, "vertical": levels.vertical_m},
    }


def _deviations(found: ApproachDeviations) -> dict[str, Any]:
    path = found.glide_path
    return {
        "to_threshold_m": _value(found.to_threshold),
        "height_m": _value(found.height),
        "right_m": _value(found.right),
        "sink_rate_m_s": _value(found.sink_rate),
        "ground_speed_m_s": _value(found.ground_speed),
        "centre_line_needle": round(found.centre_line_needle, 4),
        "above_glide_path_m": None if path is None else _value(path.above),
        "glide_path_needle": None if path is None else round(path.needle, 4),
    }


def _touchdown(found: TouchdownForecast) -> dict[str, Any]:
    return {
        "t_s": round(found.t_s, 3),
        "sigma_t_s": round(found.sigma_t_s, 3),
        "past_threshold_m": round(float(found.point_m[0]), 3),
        "right_m": round(float(found.point_m[1]), 3),
        "covariance_m2": _rounded(found.covariance_m2.ravel()),
        "radius": round(found.radius, 3),
        "on_runway": round(found.on_runway, 4),
    }


def _value(found: LinearValue) -> list[float]:
    return [round(found.value, 4), round(found.sigma, 4)]


def _rounded(values: FloatArray, digits: int = 5) -> list[float]:
    return [round(float(v), digits) for v in values]
