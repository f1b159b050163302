"""A calibration by airliners against the truth of a drawn day: errors of directions, NEES of parameters."""

from dataclasses import dataclass

import numpy as np

from calibration.combination.text_report import direction_covariance
from calibration.sky.calibrate import SkyCalibration
from calibration.sky.simulated.day_draw import DrawnDay
from calibration.stars.operating_range import work_readings
from calibration.stars.simulated.night_score import direction_errors_deg, parameter_error
from groundstation.arrays import FloatArray
from groundstation.rig.rig import Rig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DayScore:
    """Errors of one day.

    Attributes
    ----------
    relative_deg : (n, 2) errors of pan and tilt of the first station less the second, at each pair of angles of
        operation; ``common_deg`` those of their mean.
    nees : eᵀC⁻¹e of both stations' parameters, of ``degrees`` of freedom.
    written_nees : eᵀC⁻¹e of the relative direction in the middle of operation by what the rig states, of 2 degrees.
    """

    relative_deg: FloatArray
    common_deg: FloatArray
    nees: float
    degrees: int
    written_nees: float


def score_day(found: SkyCalibration, day: DrawnDay) -> DayScore:
    """Compare a calibration of two stations with the truth."""
    joint = found.night.joint
    errors = [direction_errors_deg(found.night.rig[s.name], s) for s in day.true_rig.stations]
    error: list[float] = []
    places: list[int] = []
    for night, change, columns in zip(joint.nights, joint.change, joint.columns, strict=True):
        station, true = night.fit.problem.station_at(change), day.true_rig[night.before.name]
        for name, column in zip(night.fit.problem.names, columns, strict=True):
            if not name.startswith("mark "):
                error.append(parameter_error(name, station, true))
                places.append(column)
    own = joint.covariance[np.ix_(places, places)]
    return DayScore(
        relative_deg=errors[0] - errors[1],
        common_deg=0.5 * (errors[0] + errors[1]),
        nees=float(np.array(error) @ np.linalg.solve(own, np.array(error))),
        degrees=len(error),
        written_nees=_written_nees(found.night.rig, errors[0] - errors[1], day.true_rig.names),
    )


def _written_nees(rig: Rig, relative_deg: FloatArray, names: tuple[str, ...]) -> float:
    stated = direction_covariance(rig, {names[0]: 1.0, names[1]: -1.0})
    if stated is None:
        raise ValueError("a rig without a covariance of its bases")
    middle = len(relative_deg) // 2
    error = np.radians(relative_deg[middle]) * [np.cos(work_readings(rig[names[0]])[middle, 1]), 1.0]
    return float(error @ np.linalg.solve(stated[middle], error))
