"""True rigs and assumed ones, drawn by the stated sigmas, and errors after a calibration."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.flight.fit import FlightFit
from calibration.flight.parameters import (
    KNOWN_ANTENNA_M,
    KNOWN_DISTORTION,
    KNOWN_DRIFT,
    KNOWN_READOUT_S,
)
from calibration.flight.problem import ANTENNA, DGPS_OFFSET
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import ClockModel, Rig, Station
from groundstation.simulation.trajectory import SampledTrajectory

AXES = ("x", "y", "z")
MOUNT_RAD = float(np.radians(0.05))
CLOCK_S = 0.02
DGPS_CLOCK_S = 0.2
# a rolling shutter that stays one whatever is drawn
READOUT_S = 0.1
# prior sigmas of `all` other than mounts: metres, rad, px, 1
_ADMITTED = {
    "ptu_position": 0.05,
    "head_from_camera": MOUNT_RAD,
    "focal": 5.0,
    "principal_point": 3.0,
    "distortion": KNOWN_DISTORTION,
}
_FREED = ("k1", "k2")
# an informative flight: a wide circle, climbing and descending (m), and the craft all over the picture (rad); each
# axis a middle, an amplitude, a period in s and a share of it by which it is ahead
LOOPS_S = 30.0
_STEP_S = 0.02
_LOOPS = ((0.0, 60.0, 26.0, 0.0), (130.0, 60.0, 26.0, 0.25), (32.0, 12.0, 17.0, 0.0))
_BESIDE_RAD = ((0.0, 0.06, 7.0, 0.0), (0.0, 0.045, 5.3, 0.0), (0.0, 0.0, 1.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigRealisation:
    """A rig as ``true`` and as ``stated``, the antenna's position (3,) m from the nose and the log's clock, s."""

    true: Rig
    stated: Rig
    antenna_m: np.ndarray
    late_s: float


def loops() -> SampledTrajectory:
    """Return the flight of `all`, m."""
    return waves(_LOOPS, 0.0)


def pointing_deviation() -> SampledTrajectory:
    """Return the heads' errors of direction to the craft, pan and tilt in the first two columns, rad."""
    return waves(_BESIDE_RAD, 2.0)


def waves(axes: tuple[tuple[float, float, float, float], ...], longer_s: float) -> SampledTrajectory:
    """Return swings, each axis a middle, an amplitude, a period in s and a share of it by which it is ahead."""
    t = np.arange(-longer_s, LOOPS_S + longer_s + _STEP_S, _STEP_S)
    middle, size, period, ahead = np.array(axes).T
    phase = 2.0 * np.pi * (t[:, None] / period + ahead)
    return SampledTrajectory(
        t_s=t,
        position_m=middle + size * np.sin(phase),
        velocity_m_s=2.0 * np.pi * size / period * np.cos(phase),
    )


def draw(rig: Rig, case: str, generator: np.random.Generator) -> RigRealisation:
    """Draw a true rig about an assumed one, whose files state that spread; both have the case's stations."""
    clocks_s = 0.0 if case in ("mounts", "gnss") else CLOCK_S
    stated = tuple(_admitting(s, case, clocks_s) for s in rig.stations)
    true = tuple(_drawn(s, case, clocks_s, generator) for s in stated)
    return RigRealisation(
        true=replace(rig, stations=true),
        stated=replace(rig, stations=stated),
        antenna_m=KNOWN_ANTENNA_M * generator.normal(size=3) if case == "all" else np.zeros(3),
        late_s=DGPS_CLOCK_S * float(generator.normal()) if case in ("mounts", "gnss") else 0.0,
    )


def _admitting(station: Station, case: str, clock_s: float) -> Station:
    """Return the station with its stated sigmas."""
    spread = {f"runway_from_base.{axis}": MOUNT_RAD for axis in AXES}
    if case == "all":
        for name in CALIBRATION_PARAMETERS:
            group, _, part = name.partition(".")
            if group in _ADMITTED and (group != "distortion" or part in _FREED):
                spread[name] = _ADMITTED[group]
    return replace(
        station,
        readout_s=READOUT_S if case == "all" else 0.0,
        ptu_clock=ClockModel(sigma_s=clock_s),
        ptu_clock_given=clock_s > 0.0,
        covariance_parameters=tuple(spread),
        covariance=np.diag(np.square(list(spread.values()))),
    )


def _drawn(station: Station, case: str, clock_s: float, generator: np.random.Generator) -> Station:
    change = np.zeros(len(CALIBRATION_PARAMETERS))
    places = [CALIBRATION_PARAMETERS.index(name) for name in station.covariance_parameters]
    change[places] = np.sqrt(np.diag(station.covariance)) * generator.normal(size=len(places))
    true = replace(station.changed(change), ptu_clock=ClockModel(offset_s=clock_s * float(generator.normal())))
    drift, readout_s = generator.normal(size=2) * (KNOWN_DRIFT, KNOWN_READOUT_S) * (case == "all")
    clock = ClockModel(offset_s=clock_s * float(generator.normal()), drift_ppm=1e6 * float(drift))
    return replace(true, camera_clock=clock if clock_s else None, readout_s=station.readout_s + float(readout_s))


def errors(fit: FlightFit, found: Rig, drawn: RigRealisation) -> np.ndarray:
    """Return the remaining error of each of the fit's parameters (p,): the truth less the estimate."""
    off = []
    for name, change in zip(fit.problem.names, fit.change, strict=True):
        station, _, short = name.partition(".")
        if name == DGPS_OFFSET:
            off.append(drawn.late_s - change)
        elif name in ANTENNA:
            off.append(float(drawn.antenna_m[ANTENNA.index(name)]) - change)
        elif short in CALIBRATION_PARAMETERS:
            off.append(_of_geometry(found[station], drawn.true[station], short))
        else:
            off.append(_of_times(fit, drawn, station, short) - change)
    return np.array(off)


def _of_geometry(found: Station, true: Station, short: str) -> float:
    group, _, part = short.partition(".")
    if group in ("runway_from_base", "head_from_camera"):
        turn = matrix_from_wxyz(getattr(true, f"{group}_wxyz")) @ matrix_from_wxyz(getattr(found, f"{group}_wxyz")).T
        vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return float(vector[AXES.index(part)])
    values = []
    for station in (true, found):
        of_group = {
            "ptu_position": station.ptu_position_m,
            "focal": station.lens.focal_px,
            "principal_point": station.lens.principal_point_px,
            "distortion": station.lens.distortion,
        }[group]
        values.append(float(of_group[("k1", "k2").index(part) if group == "distortion" else AXES.index(part)]))
    return values[0] - values[1]


def _of_times(fit: FlightFit, drawn: RigRealisation, name: str, short: str) -> float:
    """Return the difference of a time of the true station from the assumed one, a clock at the flight's middle."""
    true, stated = drawn.true[name], drawn.stated[name]
    camera = true.camera_clock or ClockModel()
    at_middle = camera.offset_s + 1e-6 * camera.drift_ppm * fit.problem.middle_s(name)
    return {
        "camera_clock.offset": at_middle,
        "camera_clock.drift": 1e-6 * camera.drift_ppm,
        "ptu_clock.offset": true.ptu_clock.offset_s,
        "readout": true.readout_s - stated.readout_s,
    }[short]


def unit_of(name: str) -> tuple[str, float]:
    """Return the unit in which a parameter is shown, and its value in SI."""
    units = {
        "runway_from_base": ("deg", float(np.degrees(1.0))),
        "head_from_camera": ("deg", float(np.degrees(1.0))),
        "ptu_position": ("m", 1.0),
        "dgps_antenna": ("m", 1.0),
        "focal": ("px", 1.0),
        "principal_point": ("px", 1.0),
        "distortion": ("", 1.0),
        "drift": ("ppm", 1e6),
    }
    return next((unit for part, unit in units.items() if part in name), ("ms", 1e3))
