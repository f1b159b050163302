"""The whole job of `groundstation calibrate flight`: a session in, a better rig out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.flight.covariance import with_covariance
from calibration.flight.fit import SOLUTION_STEPS, FlightFit, FlightFitError, FlightSolution, find_solution
from calibration.flight.html_report import FlightPage, write_flight_page
from calibration.flight.observations import FlightData, gather_flight
from calibration.flight.parameters import (
    AXES,
    KNOWN_POSITION_M,
    POINT_SIGMA_M,
    FreeParameters,
    choose_parameters,
    free_words,
)
from calibration.flight.problem import FlightProblem
from calibration.flight.rig import estimated_clocks, solved_rig
from calibration.flight.start import StartingPoint, find_start
from calibration.flight.text_report import format_flight_report, rig_header
from calibration.flight.verdict import judge_flight
from calibration.rig_output import require_toml_name
from calibration.session_axes import written_axes
from calibration.session_clocks import written_clocks
from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import Session, load_session
from groundstation.session.antenna import antenna_position

# pixels off by more of the picture's width than this are no fit, whatever their number
_WORST_RMS_SHARE = 0.01
_WORST_EXCLUDED_SHARE = 0.4
# a pose of which nothing was known has to come out better than this, one sigma
_WORST_ROTATION_RAD = float(np.radians(2.0))
_WORST_POSITION_M = 10.0
# a pose and its sigma in the rig are not replaced by one flight that deviates this much
_POSES = ("runway_from_base.", "head_from_camera.", "ptu_position.")
_MOST_SIGMAS_OFF = 5.0
# of the mean of an error of the fixes that lasts; one in 5,000 flights by chance
_MOST_SIGMAS_OFFSET = 4.0
_NO_ERROR_M = 1e-3
# parameters freed first, and those only if that is not enough; a lens only with a surveyed position and fixes that are
# not off by metres: otherwise focal length and distance are correlated
_DOUBTED = (("position", "readout", "drift"), ("position", "readout", "drift", "lens"))
_FAR_BETTER = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRequest:
    """Task of a calibration by a flight.

    ``free`` is the list of --free, times are the session's, in s; ``hold`` fixes all known parameters; ``report`` is a
    folder for report.html and its pictures. ``point_sigma_m`` is the 1 sigma of a constant displacement of the observed
    point from the nose along the body, in addition to the offset in session.toml. None
    is `POINT_SIGMA_M` for ``detections`` of a program, and zero for pixels of the session itself.
    """

    session: Path
    out: Path
    rig: Path | None = None
    detections: Path | None = None
    from_s: float | None = None
    to_s: float | None = None
    free: str = ""
    hold: bool = False
    report: Path | None = None
    point_sigma_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightCalibration:
    """The result: the fit, the rig with it, the text for the user, and the files written."""

    fit: FlightFit
    rig: Rig
    report: str
    files: tuple[Path, ...]


def calibrate_flight(
    request: FlightRequest, progress: Callable[[int, int], None] = lambda done, total: None
) -> FlightCalibration:
    """Calibrate, and write the rig file; raises `GroundstationError`, one line, where the flight cannot do it.

    ``progress`` is called with the steps done and their number.
    """
    words = free_words(request.free)
    session = load_session(request.session, request.rig)
    require_toml_name(request.out)
    antenna = antenna_position(session)
    free = _free_parameters(session, words)
    data = gather_flight(session, request.detections, request.from_s, request.to_s)
    start = find_start(_problem(session, data, free))
    notes: list[str] = []
    new = [s.name for s in session.rig.stations if not {"orientation", "position"} <= set(s.known)]
    doubts = bool(new) and not request.hold
    steps = _Steps(progress, SOLUTION_STEPS * (1 + doubts * len(_DOUBTED)) + 1)
    found = find_solution(start.problem, start.change, step=steps)
    if doubts:
        surveyed = all("position" in s.known for s in session.rig.stations)
        lens_shows = surveyed and not found.joint.has_lasting_error
        for doubted in _DOUBTED if lens_shows else _DOUBTED[:1]:
            found, note = _doubted(session, start, found, (*words, *doubted), steps)
            notes += note
    steps.skip_to_last()
    usual_m = POINT_SIGMA_M if request.detections is not None else 0.0
    fit = with_covariance(found, usual_m if request.point_sigma_m is None else request.point_sigma_m)
    steps()
    _require_fit(session, fit)
    clocked = written_clocks(session, solved_rig(session.rig, fit, session.identity), estimated_clocks(fit))
    turned = written_axes(session, clocked.rig)
    rig = turned.rig
    notes += [note for note in (clocked.note, turned.note) if note]
    verdict = judge_flight(rig, fit)
    report = "\n".join([*notes, format_flight_report(session.rig, rig, fit, data.excluded, antenna, verdict)])
    _write(request.out, rig_header(session.name, fit) + rig_to_toml(rig))
    written = [request.out]
    if request.report is not None:
        content = FlightPage(
            session=session.name,
            before=session.rig,
            after=rig,
            fit=fit,
            verdict=verdict,
            notes=notes,
            excluded=data.excluded,
            antenna=antenna,
        )
        written += _write_page(request.report, content)
    return FlightCalibration(fit=fit, rig=rig, report=report, files=tuple(written))


class _Steps:
    """Counts the steps of the calibration, of which some may not be needed."""

    def __init__(self, progress: Callable[[int, int], None], total: int) -> None:
        self._progress, self._done, self._total = progress, 0, total

    def __call__(self) -> None:
        self._done += 1
        self._progress(self._done, self._total)

    def skip_to_last(self) -> None:
        """Leave one step."""
        self._done = self._total - 1


def _write_page(folder: Path, content: FlightPage) -> list[Path]:
    try:
        return write_flight_page(folder, content)
    except OSError as error:
        raise InputError(str(folder), got=os_words(error), wanted="a folder that can be written") from error


def _free_parameters(session: Session, words: Sequence[str]) -> FreeParameters:
    sigma_m = antenna_position(session).sigma_m
    return choose_parameters(session.rig, words, dgps_clock_open=not session.has_clocks, antenna_sigma_m=sigma_m)


def _problem(session: Session, data: FlightData, free: FreeParameters) -> FlightProblem:
    antenna = antenna_position(session).in_body_m
    return FlightProblem(
        stations={s.name: s for s in session.rig.stations},
        observations=data.observations,
        track=data.track,
        antenna_in_body_m=np.zeros(3) if antenna is None else antenna,
        names=free.names,
        prior_sigma=free.prior_sigma,
    )


def _doubted(
    session: Session, start: StartingPoint, held: FlightSolution, words: Sequence[str], step: Callable[[], None]
) -> tuple[FlightSolution, list[str]]:
    """Return a solution with surveyed positions, shutters … free where that improves the fit much, and the reason.

    A station without an earlier calibration has a position from a map or a tape: it is known, but not to a pixel. The
    initial values are those of the first solution: freeing parameters changes no pose's initial value.
    """
    more = _free_parameters(session, words)
    names = held.joint.problem.names
    if set(more.names) <= set(names):
        return held, []
    problem = replace(start.problem, names=more.names, prior_sigma=more.prior_sigma)
    first = np.array([start.problem.value(start.change, name) for name in more.names])
    freed = find_solution(problem, first, held.paths, step)
    better = [
        name
        for name, station in freed.stations.items()
        if station.noise_factor < _FAR_BETTER * held.stations[name].noise_factor
    ]
    if not better:
        return held, []
    return freed, [
        f"note: freed {', '.join(words)}: within {KNOWN_POSITION_M:g} m, 1 % of the focal length and so on, the"
        f" pixels of {', '.join(better)} fit at least {1.0 / _FAR_BETTER:.1f} times as well (--hold keeps them)"
    ]


def _require_fit(session: Session, fit: FlightFit) -> None:
    """Raise `FlightFitError` where the solution is invalid."""
    for name, station in fit.stations.items():
        width = session.rig[name].lens.image_size_px[0]
        usable, kept = int(station.usable.sum()), int(station.kept.sum())
        wanted = "pixels and DGPS of the same flight and aircraft, and a lens and clocks that are right"
        if station.rms_px > _WORST_RMS_SHARE * width:
            got = f"pixels that fit to {station.rms_px:.0f} px only"
            raise FlightFitError(f"station {name}: got {got}; wanted {wanted}")
        if kept < (1.0 - _WORST_EXCLUDED_SHARE) * usable:
            got = f"{usable - kept} of {usable} pixels that do not fit"
            raise FlightFitError(f"station {name}: got {got}; wanted {wanted}")
    for name, sigma, prior in zip(fit.problem.names, fit.sigma, fit.problem.prior_sigma, strict=True):
        limit = {"runway_from_base": _WORST_ROTATION_RAD, "ptu_position": _WORST_POSITION_M}
        worst = next((value for part, value in limit.items() if f".{part}." in name), np.inf)
        if not np.isfinite(prior) and not sigma <= worst:
            unit = f"{np.degrees(sigma):.3g}°" if "runway_from_base" in name else f"{sigma:.3g} m"
            wanted = "a flight that moves more across this station's view, or this part known"
            raise FlightFitError(f"{name}: got ± {unit} from this flight; wanted {wanted}")
    _require_agreement(session, fit)
    off = np.abs(fit.lasting_offset_m) / np.maximum(fit.lasting_sigma_m, _NO_ERROR_M)
    if off.size and float(off.max()) > _MOST_SIGMAS_OFFSET:
        axis = int(np.argmax(off))
        off_m = abs(fit.lasting_offset_m[axis])
        got = f"fixes that are {off_m:.1f} m off in {AXES[axis]} all flight long, {off[axis]:.0f}"
        wanted = "DGPS in the rig's own frame (height over what, which origin?), of the same flight"
        raise FlightFitError(f"DGPS: got {got} of their sigmas; wanted {wanted}")


def _require_agreement(session: Session, fit: FlightFit) -> None:
    """Raise `FlightFitError` where the flight contradicts a pose of the rig and its stated sigma."""
    for k, name in enumerate(fit.problem.names):
        station, _, short = name.partition(".")
        stated = station in session.rig.names and short in session.rig.station_covariance(station).names
        off = abs(fit.change[k]) / fit.problem.prior_sigma[k]
        if stated and short.startswith(_POSES) and off > _MOST_SIGMAS_OFF:
            prior = fit.problem.prior_sigma[k]
            unit = f"{prior:.3g} m" if short.startswith("ptu_position") else f"{np.degrees(prior):.3g}°"
            got = f"{off:.0f} sigmas from the value in {session.rig.path or 'the rig'} (± {unit})"
            wanted = "DGPS in the rig's own frame and of the same flight; or a larger sigma there, if it has moved"
            raise FlightFitError(f"{name}: got {got}; wanted {wanted}")


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error
