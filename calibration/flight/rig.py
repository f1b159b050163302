"""The rig resulting from a flight: every station with its estimates, and their separate and joint covariance."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.flight.fit import FlightFit
from calibration.flight.parameters import FLOOR_CLOCK_S, FLOOR_POSITION_M, FLOOR_ROTATION_RAD
from calibration.flight.problem import ANTENNA, DGPS_OFFSET
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import CLOCK_NAMES, READOUT, REFERENCE_NAMES, ParameterCovariance, joined
from groundstation.rig.dgps import RigReference
from groundstation.rig.rig import PARTS, ClockModel, Rig, Station

_FLOORS = {
    "ptu_position": FLOOR_POSITION_M,
    "runway_from_base": FLOOR_ROTATION_RAD,
    "head_from_camera": FLOOR_ROTATION_RAD,
}
_SHARED_NAMES = frozenset((*CALIBRATION_PARAMETERS, *CLOCK_NAMES, READOUT))


def solved_rig(rig: Rig, fit: FlightFit, session: str) -> Rig:
    """Return the rig with everything that was found, and how well: each station, all together, and the DGPS.

    ``session`` is the identity of the one flown, for the DGPS clock.
    """
    stations = tuple(_solved(s, fit) for s in rig.stations)
    return replace(
        rig,
        stations=stations,
        shared_covariance=_shared(rig, stations, fit),
        reference=_reference(rig.reference, fit, session),
    )


def estimated_clocks(fit: FlightFit) -> frozenset[str]:
    """Return the clocks that a flight has estimated, ``station.camera_clock`` or ``station.ptu_clock``."""
    names = (*CLOCK_NAMES, "camera_clock.drift")
    return frozenset(name.rpartition(".")[0] for name in fit.problem.names if name.partition(".")[2] in names)


def _reference(before: RigReference | None, fit: FlightFit, session: str) -> RigReference | None:
    """Return the estimated DGPS clock and antenna, and the prior values of the rest."""
    problem, found = fit.problem, before or RigReference()
    if DGPS_OFFSET in problem.names:
        place = problem.names.index(DGPS_OFFSET)
        sigma_s = max(float(fit.sigma[place]), FLOOR_CLOCK_S)
        found = replace(found, session=session, offset_s=float(fit.change[place]), offset_sigma_s=sigma_s)
    if ANTENNA[0] in problem.names:
        places = [problem.names.index(name) for name in ANTENNA]
        found = replace(found, antenna_in_body_m=problem.antenna_m(fit.change), antenna_sigma_m=fit.sigma[places])
    return found if found.offset_s is not None or found.antenna_in_body_m is not None else None


def _shared(rig: Rig, stations: Sequence[Station], fit: FlightFit) -> ParameterCovariance:
    """Return the covariance of all that was found, over stations, clocks, shutters and DGPS.

    Its variances are those that the stations state themselves.
    """
    names = fit.problem.names
    chosen = [k for k, n in enumerate(names) if n in REFERENCE_NAMES or n.partition(".")[2] in _SHARED_NAMES]
    matrix = 0.5 * (fit.covariance + fit.covariance.T)[np.ix_(chosen, chosen)]
    floors = np.array([_floor(names[k]) for k in chosen])
    least = np.array([names[k].partition(".")[2] in CLOCK_NAMES or names[k] == DGPS_OFFSET for k in chosen])
    variance = np.diag(matrix)
    np.fill_diagonal(matrix, np.where(least, np.maximum(variance, floors**2), variance + floors**2))
    for place, k in enumerate(chosen):
        station, _, short = names[k].partition(".")
        if short == "camera_clock.offset":
            matrix[place, place] += _drifted_s(fit, station) ** 2
    found = ParameterCovariance(names=tuple(names[k] for k in chosen), matrix=matrix)
    if len({name.partition(".")[0] for name in found.names}) < 2:
        found = ParameterCovariance.nothing()
    before = rig.shared_covariance
    # the misfit of an earlier calibration does not outlive it, see `_covariance`
    stale = {f"{s.name}.head_from_camera.{axis}" for s in stations if s.fixed for axis in "xyz"}
    keep = [k for k, name in enumerate(before.names) if name not in names and name not in stale]
    rest = ParameterCovariance(names=tuple(before.names[k] for k in keep), matrix=before.matrix[np.ix_(keep, keep)])
    return joined(rest, found)


def _floor(name: str) -> float:
    """Return the least sigma of a parameter by its full name."""
    if name in REFERENCE_NAMES:
        return FLOOR_CLOCK_S if name == DGPS_OFFSET else 0.0
    short = name.partition(".")[2]
    return FLOOR_CLOCK_S if short in CLOCK_NAMES else _FLOORS.get(short.partition(".")[0], 0.0)


def _solved(before: Station, fit: FlightFit) -> Station:
    """Return one station with its estimates. ``before`` is the rig's own, the fit may have started elsewhere."""
    problem, name = fit.problem, before.name
    own = {short: place for place, short in problem.own(name)}
    station = problem.stations[name].changed(problem.station_change(fit.change, name))
    sigma = fit.sigma
    camera, ptu = station.camera_clock, station.ptu_clock
    if "camera_clock.offset" in own or "camera_clock.drift" in own:
        drift = problem.value(fit.change, f"{name}.camera_clock.drift")
        offset = problem.value(fit.change, f"{name}.camera_clock.offset")
        camera = camera or ClockModel()
        # the drift was found about the middle of the flight, a clock's stands for zero of the device's time
        device_s = (problem.middle_s(name) - camera.offset_s) / (1.0 + camera.drift_ppm * 1e-6)
        uncertain = float(sigma[own["camera_clock.offset"]]) if "camera_clock.offset" in own else camera.sigma_s
        camera = ClockModel(
            offset_s=camera.offset_s + offset - drift * device_s,
            drift_ppm=camera.drift_ppm + drift * 1e6,
            sigma_s=math.hypot(max(uncertain, FLOOR_CLOCK_S), _drifted_s(fit, name)),
        )
    if "ptu_clock.offset" in own:
        uncertain = float(sigma[own["ptu_clock.offset"]])
        offset = ptu.offset_s + problem.value(fit.change, f"{name}.ptu_clock.offset")
        ptu = replace(ptu, offset_s=offset, sigma_s=max(uncertain, FLOOR_CLOCK_S))
    names, covariance = _covariance(before, fit)
    found = {"orientation": "runway_from_base.x" in own, "position": "ptu_position.x" in own}
    return replace(
        station,
        known=tuple(part for part in PARTS if part in before.known or found.get(part, False)),
        camera_clock=camera,
        ptu_clock=ptu,
        ptu_clock_given=before.ptu_clock_given or "ptu_clock.offset" in own,
        readout_s=station.readout_s + problem.value(fit.change, f"{name}.{READOUT}"),
        readout_sigma_s=float(sigma[own[READOUT]]) if READOUT in own else station.readout_sigma_s,
        covariance_parameters=names,
        covariance=covariance,
    )


def _drifted_s(fit: FlightFit, station: str) -> float:
    """Return one sigma of a camera clock's drift at the flight's ends, s: a rig contains offsets only."""
    drift = f"{station}.camera_clock.drift"
    if drift not in fit.problem.names:
        return 0.0
    t = fit.problem.observations[station].t_s
    return 0.5 * float(t.max() - t.min()) * float(fit.sigma[fit.problem.names.index(drift)])


def _covariance(station: Station, fit: FlightFit) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and matrix: the estimates, with lower limits, and the rig's covariance of the rest."""
    own = [(k, short) for k, short in fit.problem.own(station.name) if short in CALIBRATION_PARAMETERS]
    found = [short for _, short in own]
    # the misfit of an earlier calibration does not outlive it
    stale = "head_from_camera" if station.fixed else "-"
    rest = [
        k for k, short in enumerate(station.covariance_parameters) if short not in found and not short.startswith(stale)
    ]
    places = [k for k, _ in own]
    n, m = len(own), len(rest)
    covariance = np.zeros((n + m, n + m))
    covariance[:n, :n] = fit.covariance[np.ix_(places, places)]
    covariance[n:, n:] = station.covariance[np.ix_(rest, rest)]
    floors = [_FLOORS.get(short.partition(".")[0], 0.0) for short in found]
    covariance[:n, :n] += np.diag(np.square(floors))
    covariance = 0.5 * (covariance + covariance.T)
    names = (*found, *(station.covariance_parameters[k] for k in rest))
    return _with_misfit(station, fit, names, covariance)


def _with_misfit(
    station: Station, fit: FlightFit, names: tuple[str, ...], covariance: FloatArray
) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and matrix with the lasting misfit of a fixed camera's pixels, as an error of its optical axis.

    A camera that does not turn shows the aircraft all over its picture, and where its lens model is wrong its pixels
    are off for seconds: no number of them averages that out. The rotation of the camera in its head, which a fixed
    station does not need, stands for it; the filter considers it and never estimates it.
    """
    sigma_rad = fit.misfit_px.get(station.name, 0.0) / float(station.lens.focal_px.mean())
    if not station.fixed or sigma_rad == 0.0 or any(name.startswith("head_from_camera") for name in names):
        return names, covariance
    n = len(names)
    wider = np.zeros((n + 3, n + 3))
    wider[:n, :n] = covariance
    wider[n:, n:] = sigma_rad**2 * np.eye(3)
    return (*names, *(f"head_from_camera.{axis}" for axis in "xyz")), wider
