"""The whole jobs of `groundstation calibrate survey` and `check`: files in, a rig, a report and a record out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.landmarks.check import Check, solve_check
from calibration.landmarks.check_history import read_history
from calibration.landmarks.check_record import append_record, check_record, record_path
from calibration.landmarks.check_reference import (
    ComparisonTable,
    find_reference,
    keep_reference,
    other_set_up,
    reference_path,
    refuse_keeping_onto,
    require_new_sightings,
)
from calibration.landmarks.check_report import format_check, write_check_report
from calibration.landmarks.rejection import LandmarkFitError
from calibration.landmarks.survey import Survey, solve_survey, survey_words
from calibration.landmarks.survey_report import format_survey, rig_header, write_survey_report
from calibration.landmarks.systematic_faults import explained
from calibration.rig_output import require_toml_name
from calibration.sightings import Landmark, LandmarkSighting, read_landmarks, read_sightings
from groundstation.errors import GroundstationError, InputError, UsageError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyRequest:
    """Options of a survey; ``free`` is the list of --free, ``report`` a folder or None.

    ``heading_sigma_deg`` : the heads stand as the rig has them but for a common heading; None: orientations are found.
    """

    sightings: Path
    landmarks: Path
    rig: Path
    out: Path
    free: str = ""
    report: Path | None = None
    heading_sigma_deg: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurveyDone:
    """The result, the text for the user, and the files written."""

    survey: Survey
    text: str
    written: tuple[Path, ...]


def run_survey(request: SurveyRequest) -> SurveyDone:
    """Survey, and write the rig; raises `GroundstationError`, one line, and writes nothing where that cannot be."""
    words = survey_words(request.free)
    require_toml_name(request.out)
    # the sightings themselves may be there already
    refuse_keeping_onto(request.out, (request.landmarks, request.rig))
    rig = load_rig(request.rig)
    sightings, landmarks = read_sightings(request.sightings), read_landmarks(request.landmarks)
    heading = None if request.heading_sigma_deg is None else float(np.radians(request.heading_sigma_deg))
    try:
        survey = solve_survey(rig, sightings, landmarks, words, request.sightings, heading)
    except LandmarkFitError as fault:
        raise explained(fault, rig, sightings, landmarks, (request.sightings, request.landmarks)) from fault
    text = format_survey(survey)
    header = rig_header(survey, request.sightings.name, request.landmarks.name)
    _write(request.out, header + rig_to_toml(survey.rig))
    written = [request.out, keep_reference(request.sightings, request.out)]
    if request.report is not None:
        written += write_survey_report(request.report, survey, request.sightings.stem)
    return SurveyDone(survey=survey, text=text, written=tuple(written))


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckRequest:
    """Options of a check; ``out`` None refuses a moved rig, a path corrects it.

    Without a ``reference`` the survey's table next to the rig is used, if it exists; ``none`` uses none. ``keep`` False
    does not put the sightings next to the corrected rig: they are no table that another day can be compared with.
    """

    sightings: Path
    landmarks: Path
    rig: Path
    out: Path | None = None
    reference: Path | None = None
    record: Path | None = None
    report: Path | None = None
    alarm_deg: float = 0.01
    keep: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonOutcome:
    """The text of an independent comparison of a rig with today's sightings, and the stations that fail it."""

    text: str
    against: tuple[str, ...]


Ask = Callable[[Rig, Sequence[LandmarkSighting], Mapping[str, Landmark]], ComparisonOutcome]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckDone:
    """The result and decision: ``good`` where a session may start with the rig, or with the corrected one."""

    check: Check
    text: str
    good: bool
    written: tuple[Path, ...]


def run_check(request: CheckRequest, ask: Ask | None = None) -> CheckDone:
    """Check, decide, write the corrected rig if requested, and always a line of record.

    ``ask`` is a second test of the rig that would be used; if it fails, the rig is refused. Raises
    `GroundstationError`, one line, where the check cannot be made; that is in the record, too.
    """
    record = request.record or record_path(request.rig)
    files = {"rig": request.rig, "sightings": request.sightings, "landmarks": request.landmarks}
    reference = find_reference(request.rig, request.reference)
    if reference.path is not None:
        files["reference"] = reference.path
    sightings: Sequence[LandmarkSighting] = ()
    try:
        if request.out is not None:
            require_toml_name(request.out)
            refuse_keeping_onto(request.out, (request.sightings, request.landmarks, request.rig, request.reference))
        if not 0.0 < request.alarm_deg <= 10.0:
            raise UsageError("--alarm-deg", got=f"{request.alarm_deg:g}", wanted="a number above 0 to 10")
        sightings = read_sightings(request.sightings)
        check, reference = _compared(request, sightings, reference)
        # with --out, a movement has been corrected
        rig = check.rig if request.out is None else check.corrected
        opinion = None if ask is None else ask(rig, sightings, read_landmarks(request.landmarks))
    except GroundstationError as error:
        append_record(record, check_record(files, sightings, None, "refused", str(error)))
        raise
    decision, word = _decide(check, request, opinion)
    written: list[Path] = []
    if request.out is not None and word != "refused":
        _write(request.out, _header(check, request) + rig_to_toml(check.corrected))
        written.append(request.out)
        # a movement is observed by the new sightings only
        table = request.sightings if check.moved or reference.path is None else reference.path
        if request.keep:
            written.append(keep_reference(table, request.out))
    append_record(record, check_record(files, sightings, check, word, decision))
    if request.report is not None:
        name = request.sightings.stem
        history = read_history(record)
        written += write_check_report(request.report, check, request.alarm_deg, decision, name, history)
    first = [reference.note] if opinion is None else [reference.note, opinion.text]
    text = "\n".join([*first, format_check(check, request.alarm_deg, decision)])
    return CheckDone(check=check, text=text, good=word != "refused", written=(*written, record))


def _compared(
    request: CheckRequest, sightings: Sequence[LandmarkSighting], reference: ComparisonTable
) -> tuple[Check, ComparisonTable]:
    """Check against the reference; one of another set-up of the stations is not used, with a note."""
    rig, landmarks = load_rig(request.rig), read_landmarks(request.landmarks)
    kept = reference_path(request.rig)
    if reference.path is None and kept.is_file():
        # the rig itself comes from that table
        require_new_sightings(sightings, read_sightings(kept), request.sightings, kept)
    if reference.path is not None:
        then = read_sightings(reference.path)
        require_new_sightings(sightings, then, request.sightings, reference.path)
        check = solve_check(rig, sightings, landmarks, then, request.sightings, reference.path)
        otherwise = other_set_up(check) if reference.kept else None
        if otherwise is None:
            return check, reference
        note = f"compared with the rig alone: {reference.path.name} is of another set-up, {otherwise}"
        reference = ComparisonTable(path=None, kept=False, note=note)
    return solve_check(rig, sightings, landmarks, (), request.sightings), reference


def _decide(check: Check, request: CheckRequest, opinion: ComparisonOutcome | None) -> tuple[str, str]:
    """Return the decision in words and as one of accepted, corrected, refused."""
    names = ", ".join(m.station for m in check.moved)
    if check.unseen:
        return f"refused: {', '.join(check.unseen)} not checked; look at two landmarks from every station", "refused"
    if check.moved and request.out is None:
        return f"refused: {names} moved; --out FILE writes a corrected rig, or survey again", "refused"
    if opinion is not None and opinion.against:
        found = f"{names} put right" if check.moved else "nothing has moved"
        against = ", ".join(opinion.against)
        return (
            f"refused: {found} by the landmarks, but the runway's corners disagree ({against}); survey again",
            "refused",
        )
    if not check.moved:
        return "accepted: the rig stands as it was calibrated", "accepted"
    return f"corrected: {names} moved; use {request.out.name if request.out else ''}", "corrected"


def _header(check: Check, request: CheckRequest) -> str:
    what = "with " + ", ".join(m.station for m in check.moved) + " as found" if check.moved else "nothing had moved"
    return f"# {request.rig.name!r} checked with {request.sightings.name!r}: {what}\n"


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error
