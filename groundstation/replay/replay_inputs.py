"""What a replay reads before its first frame: session, tuning, references, and notes on them."""

import os
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, RigError, SessionError
from groundstation.files.toml_table import load_toml
from groundstation.integrity.lines_of_sight import KnownPositions
from groundstation.messages import DgpsFix, ReferenceFix
from groundstation.replay.recording_replay import load_replay_config
from groundstation.replay.reference_prior import ReferencePrior, reference_prior
from groundstation.replay.replay_request import ReplayRequest
from groundstation.rig.rig_notes import rig_notes
from groundstation.rig.stations_apart import require_one_sight
from groundstation.session import Session, Truth, load_dgps, load_session, load_truth
from groundstation.session.time_units import TIME_UNITS_S
from groundstation.sources.recorrection import without_axes_now
from groundstation.sources.reference_fixes import reference_fixes
from groundstation.tracking.config import Config, with_weights

_MIN_BASELINE_M = 0.1
_CLOCKS_APART_S = 0.2
# units that the times of a reference may be in by mistake; its positions are then further apart than a receiver's are
# in seconds, and not closer than a receiver's or a simulation's in that unit
_MOST_APART_S = 9.0
_LEAST_APART_S = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayInputs:
    """The inputs of a replay; ``notes`` are faults of the references and assumptions on clocks, one line each.

    ``other_weights`` is whether the request's weights are not those that the tuning names.
    """

    session: Session
    config: Config
    dgps: tuple[DgpsFix, ...]
    truth: Truth | None
    prior: ReferencePrior
    notes: tuple[str, ...]
    other_weights: bool


def load_inputs(request: ReplayRequest) -> ReplayInputs:
    """Load the inputs; raises `InputError` if the session cannot be tracked.

    A damaged reference table does not stop the replay: its rows before the fault are used.
    """
    session = _usable_session(request)
    tuning = load_replay_config(session, request.config)
    config = with_weights(tuning, request.weights)
    broken: list[SessionError] = []
    table_notes: list[str] = []
    dgps = load_dgps(session, broken.append, table_notes.append)
    notes = _unstated(session) + rig_notes(session.rig) + _without_use(request, session)
    notes += [f"{fault}; rows of DGPS before that: {len(dgps)}" for fault in broken]
    broken.clear()
    truth = load_truth(session, broken.append, table_notes.append)
    notes += table_notes
    notes += [f"{fault}; rows of truth before that: {0 if truth is None else len(truth.t_s)}" for fault in broken]
    notes += _clock_notes(session) + _axes_notes(session)
    prior = reference_prior(session, config.estimation)
    notes += prior.notes
    return ReplayInputs(
        session=session,
        config=config,
        dgps=dgps,
        truth=truth,
        prior=prior,
        notes=tuple(notes),
        other_weights=config != tuning,
    )


def _unstated(session: Session) -> list[str]:
    """Return a note where session.toml is empty, as by mistake; it may be."""
    if load_toml(session.folder / "session.toml", SessionError):
        return []
    return ["session.toml is empty: the aircraft's span, the place on Earth and the phases are unknown"]


def _without_use(request: ReplayRequest, session: Session) -> list[str]:
    """Return a note on each option that acts on pictures, where the session has pixels instead of them."""
    if not session.detections_only:
        return []
    of_pictures = {"--weights": request.weights, "--panorama": request.panorama, "--stars": request.stars}
    return [
        f"{option} is not used: the session has detections.csv, and no pictures"
        for option, given in of_pictures.items()
        if given is not None
    ]


def learning_fixes(request: ReplayRequest, inputs: ReplayInputs) -> list[ReferenceFix]:
    """Return the DGPS positions that update the filter, up to ``learn_until_s``; none without it."""
    if request.learn_until_s is None:
        return []
    prior = inputs.prior
    fixes = reference_fixes(inputs.dgps, prior.antenna_in_body_m, request.learn_until_s, prior.offset_s)
    if not fixes:
        got = f"no DGPS fix up to {request.learn_until_s:g} s" if inputs.dgps else "no DGPS at all"
        raise SessionError(inputs.session.name, got=got, wanted="some, for --learn-until")
    return fixes


def known_positions(inputs: ReplayInputs, span_s: tuple[float, float]) -> list[KnownPositions]:
    """Return where truth, or else the DGPS log, has the aircraft while there are pictures, ``span_s``.

    A log may be of the whole flight, most of which no camera sees.
    """
    if inputs.truth is not None:
        name, t_s, position_m = "truth.csv", inputs.truth.t_s, inputs.truth.position_runway_m
    else:
        name = "the DGPS log"
        t_s = np.array([fix.t_s for fix in inputs.dgps]) - inputs.prior.offset_s
        position_m = np.array([fix.position_runway_m for fix in inputs.dgps]).reshape(-1, 3)
    pictured = (t_s >= span_s[0]) & (t_s <= span_s[1])
    if np.count_nonzero(pictured) < 2:
        return []
    return [KnownPositions(name=name, t_s=t_s[pictured], position_m=position_m[pictured])]


def reference_time_notes(request: ReplayRequest, inputs: ReplayInputs, span_s: tuple[float, float]) -> list[str]:
    """Return a note on each reference whose times are not those of the pictures, ``span_s``.

    A part of a session that was asked for may lie outside of its reference, whatever the clock's offset; times that
    would be of the pictures in another unit are told there, too.
    """
    part = request.from_s is not None or request.to_s is not None
    dgps = np.array([fix.t_s for fix in inputs.dgps])
    notes = _time_notes("DGPS", dgps, span_s, inputs.config.evaluation.max_offset_s, part=part)
    if inputs.truth is not None:
        notes += _time_notes("truth", inputs.truth.t_s, span_s, 0.0, part=part)
    return notes


def _time_notes(name: str, times: FloatArray, span_s: tuple[float, float], most_s: float, *, part: bool) -> list[str]:
    """Return a note on a reference's times; ``most_s`` is the largest offset of its clock."""
    if len(times) < 1:
        return []

    def inside(times_s: FloatArray) -> int:
        return int(np.count_nonzero((times_s >= span_s[0] - most_s) & (times_s <= span_s[1] + most_s)))

    here, there = (f"{a:.1f} to {b:.1f} s" for a, b in (span_s, (times.min(), times.max())))
    common = f"{name}: its times, {there}, have {'hardly anything' if inside(times) else 'nothing'} in common"
    apart = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    for unit, in_s in TIME_UNITS_S.items():
        if apart * in_s > _LEAST_APART_S and apart > _MOST_APART_S and inside(times * in_s) > inside(times):
            return [f"{common} with the pictures', {here}, and would in {unit}: t_s is in seconds"]
    if part or (times.min() <= span_s[1] + most_s and times.max() >= span_s[0] - most_s):
        return []
    return [f"{common} with the pictures', {here}: seconds of this session?"]


def _usable_session(request: ReplayRequest) -> Session:
    """Load the session; raises if it cannot be tracked or if the output would overwrite it."""
    session = load_session(request.session, request.rig)
    if len(session.rig.stations) < 2:
        raise RigError(session.rig.path, got="one station", wanted="two or more: one alone gives no distance")
    session.rig.require_known()
    if request.detector is None and not session.detections_only:
        # another detector may find what has no outline, as a lamp
        require_one_sight(session.rig, session.target.span_m)
    places = np.array([s.ptu_position_m for s in session.rig.stations])
    if float(np.ptp(places, axis=0).max()) < _MIN_BASELINE_M:
        raise RigError(session.rig.path, got="all stations in one place", wanted="stations that stand apart")
    if os.path.realpath(request.out) == os.path.realpath(request.session):
        got = "the session folder itself"
        raise InputError(str(request.out), got=got, wanted="another folder: results would replace recordings")
    return session


def _axes_notes(session: Session) -> list[str]:
    """Return a note on stations whose recorded axes the rig in use does not have: angles become readings."""
    recorded = session.recorded
    if recorded is None or not recorded.rig_replaced:
        return []
    names = without_axes_now(recorded.rig, session.rig, session.applied_axes)
    if not names:
        return []
    return [
        f"the rig has no ptu_axes of {', '.join(names)}, the recording's has: the devices' readings are used as angles;"
        " is the rig of a folder that an earlier version converted?"
    ]


def _clock_notes(session: Session) -> list[str]:
    """Return a note for each station whose camera and PTU clock offsets differ implausibly."""
    notes = []
    for station in session.rig.stations:
        camera = station.camera_clock.offset_s if station.camera_clock is not None else 0.0
        if not station.fixed and session.has_clocks and abs(camera - station.ptu_clock.offset_s) > _CLOCKS_APART_S:
            notes.append(
                f"station {station.name}: [clocks] moves its camera by {camera:g} s, and its PTU is moved by "
                f"{station.ptu_clock.offset_s:g} s (ptu_clock in the rig): is that meant?"
            )
    return notes
