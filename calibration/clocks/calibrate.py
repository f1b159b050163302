"""The whole job of `groundstation calibrate timing`: a session in, a rig with its clocks out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.clocks.image_motion import StationMotion, gather_motion
from calibration.clocks.ptu_clock_fit import TimingFit, solve_timing
from calibration.clocks.timed_errors import shared_errors, timed_errors
from calibration.flight.covariance import solve_flight
from calibration.flight.fit import FlightFit
from calibration.flight.observations import gather_flight
from calibration.flight.parameters import KNOWN_CLOCK_S, choose_parameters
from calibration.flight.problem import DGPS_OFFSET, FlightProblem
from calibration.flight.rig import estimated_clocks, solved_rig
from calibration.rig_output import require_toml_name
from calibration.session_axes import written_axes
from calibration.session_clocks import written_clocks
from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.rig.rig import ClockModel, Rig, Station
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import Session, load_session
from groundstation.session.antenna import antenna_position

_CLOCKS = ("camera_clock.offset", "ptu_clock.offset", DGPS_OFFSET)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingRequest:
    """Task and data of a calibration of clocks.

    ``pictures``, ``flight``: by image motion, by the aircraft's track, or by both. ``one_ptu_clock``: all PTUs are
    stamped by one clock with one delay, so that only the cameras' clocks differ. Times in s of the session.
    """

    session: Path
    out: Path
    rig: Path | None = None
    detections: Path | None = None
    from_s: float | None = None
    to_s: float | None = None
    pictures: bool = True
    flight: bool = False
    one_ptu_clock: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockDifference:
    """Seconds, with one sigma."""

    value_s: float
    sigma_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimingCalibration:
    """The result.

    Attributes
    ----------
    by_pictures, motions : by station; empty unless pictures were requested.
    by_flight : the solution of the flight with only the clocks free, or None.
    rig : with the estimated clocks; those from the pictures where there are both.
    notes : on what the rig has of the session: its clocks, and the axes that its angles are corrected by.
    """

    session: Session
    by_pictures: dict[str, TimingFit]
    motions: dict[str, StationMotion]
    by_flight: FlightFit | None
    rig: Rig
    notes: tuple[str, ...] = ()

    def flight_ptu(self, name: str) -> ClockDifference | None:
        """Return the lag of a PTU's readings relative to its camera's clock, by the flight."""
        return self._flight({f"{name}.ptu_clock.offset": 1.0, f"{name}.camera_clock.offset": -1.0})

    def flight_cameras(self, first: str, other: str) -> ClockDifference | None:
        """Return the lag of another camera's exposures relative to its clock, in the first's clock, by the flight."""
        return self._flight({f"{other}.camera_clock.offset": 1.0, f"{first}.camera_clock.offset": -1.0})

    def _flight(self, weights: dict[str, float]) -> ClockDifference | None:
        fit = self.by_flight
        if fit is None or not set(weights) & set(fit.problem.names):
            return None
        row = np.array([weights.get(name, 0.0) for name in fit.problem.names])
        return ClockDifference(value_s=float(row @ fit.change), sigma_s=float(np.sqrt(row @ fit.covariance @ row)))


def calibrate_timing(request: TimingRequest, progress: Callable[[int], None] = lambda _: None) -> TimingCalibration:
    """Find the clocks and write the rig file; raises `GroundstationError` where the clocks are not observable."""
    require_toml_name(request.out)
    session = load_session(request.session, request.rig)
    session.rig.require_known()
    flight = _by_flight(session, request) if request.flight else None
    rig, estimated = session.rig, frozenset[str]()
    if flight is not None:
        rig, estimated = solved_rig(rig, flight, session.identity), estimated_clocks(flight)
    fits, motions = {}, {}
    if request.pictures:
        found = gather_motion(session, request.from_s, request.to_s, progress)
        motions = {one.station.name: one for one in found}
        fits = {
            name: solve_timing(name, one.readings, one.motion, one.station.angle_sigma_rad)
            for name, one in motions.items()
        }
        rig = timed_rig(session.rig, fits, request.one_ptu_clock)
        estimated = _timed_clocks(fits, request.one_ptu_clock)
    clocked = written_clocks(session, rig, estimated)
    turned = written_axes(session, clocked.rig)
    _write(request.out, session.name, turned.rig)
    return TimingCalibration(
        session=session,
        by_pictures=fits,
        motions=motions,
        by_flight=flight,
        rig=turned.rig,
        notes=tuple(note for note in (clocked.note, turned.note) if note),
    )


def timed_rig(rig: Rig, fits: dict[str, TimingFit], one_ptu_clock: bool = False) -> Rig:
    """Return the rig with the PTUs' clocks found; with one clock of all PTUs, the first's, and the cameras' by it.

    What these clocks had in common with other parameters belongs to their former values, and goes. Only differences to
    a camera's clock were measured: they have its error in common with it, and what else it is correlated with.
    """
    errors = timed_errors(rig, fits, one_ptu_clock)
    sigmas = errors.sigmas
    timed_names = {f"{name}.offset" for name in _timed_clocks(fits, one_ptu_clock)}
    shared = shared_errors(errors, set(rig.shared_covariance.names) - timed_names)
    rig = replace(rig, shared_covariance=shared)
    reference = next(iter(fits.values())) if one_ptu_clock else None
    stations = []
    for station in rig.stations:
        fit = fits.get(station.name)
        if fit is None:
            stations.append(station)
            continue
        timed = _ptu_timed(station, reference or fit, sigmas[f"{station.name}.ptu_clock.offset"])
        if reference is not None and fit is not reference:
            # the PTU is right by the first camera; this camera's clock shows more by the difference
            camera = station.camera_clock or ClockModel()
            sigma = sigmas[f"{station.name}.camera_clock.offset"]
            later = reference.offset_s - fit.offset_s
            timed = replace(timed, camera_clock=replace(camera, offset_s=camera.offset_s + later, sigma_s=sigma))
        stations.append(timed)
    return replace(rig, stations=tuple(stations))


def _timed_clocks(fits: dict[str, TimingFit], one_ptu_clock: bool) -> frozenset[str]:
    """Return the clocks that `timed_rig` changes."""
    cameras = list(fits)[1:] if one_ptu_clock else []
    return frozenset([*(f"{name}.ptu_clock" for name in fits), *(f"{name}.camera_clock" for name in cameras)])


def _ptu_timed(station: Station, fit: TimingFit, sigma_s: float) -> Station:
    before, drift = station.ptu_clock, fit.drift
    # the drift was found about the middle of the recording, a clock's stands for zero of the device's time
    offset = before.offset_s * (1.0 + drift) + fit.offset_s - drift * fit.middle_s
    scale = (1.0 + before.drift_ppm * 1e-6) * (1.0 + drift)
    clock = ClockModel(offset_s=offset, drift_ppm=(scale - 1.0) * 1e6, sigma_s=sigma_s)
    return replace(station, ptu_clock=clock, ptu_clock_given=True)


def _by_flight(session: Session, request: TimingRequest) -> FlightFit:
    """Return the flight's solution with nothing free but clocks."""
    chosen = choose_parameters(session.rig, ("camera_clock", "ptu_clock"), dgps_clock_open=not session.has_clocks)
    keep = [k for k, name in enumerate(chosen.names) if name.endswith(_CLOCKS)]
    if not session.has_clocks:
        # a common shift of all clocks is the DGPS clock's: the first camera is the session's clock
        keep.remove(chosen.names.index(f"{session.rig.names[0]}.camera_clock.offset"))
    data = gather_flight(session, request.detections, request.from_s, request.to_s)
    antenna = antenna_position(session).in_body_m
    problem = FlightProblem(
        stations={s.name: s for s in session.rig.stations},
        observations=data.observations,
        track=data.track,
        antenna_in_body_m=np.zeros(3) if antenna is None else antenna,
        names=tuple(chosen.names[k] for k in keep),
        # a clock that is exact in the rig is estimated here
        prior_sigma=np.maximum(chosen.prior_sigma[keep], KNOWN_CLOCK_S),
    )
    return solve_flight(problem)


def _write(path: Path, session: str, rig: Rig) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, f"# clocks found in session {session!r}\n" + rig_to_toml(rig))
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error
