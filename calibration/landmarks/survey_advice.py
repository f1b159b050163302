"""The quality of a survey, and ways to improve it, in words."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.information import inverse_with_floor
from calibration.landmarks.fit import information_with
from calibration.landmarks.survey import Survey, inlier_landmarks
from calibration.rig_reach import RANGES_M, approach_point, good_to_m, posed, reach_at, reach_gain, relative_sigma_rad
from groundstation.arrays import FloatArray

_JUDGED_M = 200.0
_SURVEYED_M = 0.005
# a remedy that takes less than this off is not worth a morning
_WORTH = 0.15
# landmarks on one line: the turn about it is so many times less well known than the others, and matters
_ALONE, _MATTERS_RAD = 5.0, float(np.radians(0.03))


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyAdvice:
    """The ``verdict``, one line each; ``next_steps``, the most useful first; ``table`` rows by range as text."""

    verdict: tuple[str, ...]
    next_steps: tuple[str, ...]
    table: tuple[tuple[str, ...], ...]


TABLE_HEAD = ("range", "relative pan", "relative tilt", "across", "along", "up")


def advise_survey(survey: Survey) -> SurveyAdvice:
    """Evaluate a survey: its errors along the runway, its range of use, the next steps."""
    names = [s.name for s in posed(survey.rig)]
    if len(names) < 2:
        verdict = [f"one station with a pose ({', '.join(names) or 'none'}): a position needs two"]
        next_steps = (*_geometry(survey), "sightings of the same landmarks from another station")
        return SurveyAdvice(verdict=tuple(verdict), next_steps=next_steps, table=())
    table = []
    for range_m in RANGES_M:
        reach, pair = reach_at(survey.rig, range_m), relative_sigma_rad(survey.rig, names[0], names[-1], range_m)
        if reach is not None and pair is not None:
            pan, tilt = np.degrees(pair)
            lengths = (f"{value:.3f} m" for value in (reach.across_m, reach.along_m, reach.up_m))
            table.append((f"{range_m:g} m", f"{pan:.4f}°", f"{tilt:.4f}°", *lengths))
    apart = abs(survey.rig[names[0]].ptu_position_m[0] - survey.rig[names[-1]].ptu_position_m[0])
    verdict = []
    if table:
        alongs = ", ".join(f"{row[4]} at {row[0]}" for row in table)
        verdict.append(
            f"bearings of {names[0]} and {names[-1]}, {apart:.2f} m apart, are good to {table[-1][1]} in relative pan "
            f"at {table[-1][0]} (1 sigma); that is along the runway {alongs}"
        )
    good = good_to_m(survey.rig)
    if good:
        reaches = ", ".join(f"{limit:g} m up to {range_m:.0f} m" for limit, range_m in good)
        verdict.append(f"good enough, as far as this calibration goes, for {reaches} of range (1 sigma along)")
    else:
        verdict.append("not good enough for any range")
    steps = [*_geometry(survey), *_remedies(survey)]
    return SurveyAdvice(
        verdict=tuple(verdict),
        next_steps=tuple(steps) or ("nothing is missing; keep the sightings as the reference of `calibrate check`",),
        table=tuple(table),
    )


def _geometry(survey: Survey) -> list[str]:
    """Return the directions that number and positions of landmarks leave undetermined."""
    steps = []
    for name in survey.rig.names:
        if not any(observed.station == name for observed in survey.fit.problem.observations):
            continue
        kept = inlier_landmarks(survey.fit, name)
        if "position" in survey.before[name].known:
            if len(kept) < 3:
                steps.append(f"{name}: a third landmark off the line of the two; a wrong one would not be noticed now")
        elif len(kept) < 4:
            steps.append(f"{name}: a fourth landmark; three just give a pose, and a wrong one would not be noticed")
        turn = survey.fit.block([f"{name}.runway_from_base.{axis}" for axis in "xyz"])
        least, *_, most = np.sqrt(np.linalg.eigvalsh(turn))
        if most > max(_ALONE * least, _MATTERS_RAD):
            steps.append(
                f"{name}: a landmark well off the line of the others: the turn about that line is known to"
                f" {np.degrees(most):.2f} deg only"
            )
    return steps


def _remedies(survey: Survey) -> list[str]:
    """Return the most effective remedy of the error along the runway: the same observations with one error source less.

    The rig states slightly more than the fit (mounts settle), which no observation improves: a remedy reduces the
    rig's variance by as much as the fit's.
    """
    fit, rig = survey.fit, survey.rig
    stated = reach_at(rig, _JUDGED_M)
    problem = fit.problem
    names = [name for name in problem.names if not name.startswith("landmark ")]
    gain = reach_gain(rig, names, approach_point(rig, _JUDGED_M))
    if gain is None or stated is None:
        return []
    along = np.zeros(len(problem.names))
    along[: len(names)] = gain[1]
    along = along @ problem.spread

    def sigma(information: FloatArray) -> float:
        return float(np.sqrt(along @ inverse_with_floor(information) @ along)) * fit.raised

    now, settles = stated.along_m, stated.along_m**2 - sigma(fit.information) ** 2
    data = fit.information - np.diag(problem.known.astype(np.float64))

    def scaled(part: Callable[[str], bool]) -> float:
        """Return the sigma with half the uncertainty before of some parameters."""
        rows = [k for k, name in enumerate(problem.names) if part(name)]
        columns = problem.known & (np.abs(problem.spread[rows]).sum(axis=0) > 0.0) if rows else problem.known & False
        half = np.where(columns, 0.5, 1.0)
        information = half[:, None] * data * half + np.diag(problem.known.astype(np.float64))
        return float(np.sqrt((along * half) @ inverse_with_floor(information) @ (along * half))) * fit.raised

    surveyed = [k for k, name in enumerate(problem.names) if ".ptu_position." in name]
    placed = problem.spread[surveyed].T @ problem.spread[surveyed] / _SURVEYED_M**2
    readings = information_with(problem, fit.unknowns, fit.kept, pixel=0.25, angle=0.25)
    remedies = [
        (sigma(readings), "four times as many readings of each landmark"),
        (scaled(lambda n: n.startswith("landmark ")), "landmark coordinates twice as good, or landmarks twice as far"),
        (
            scaled(lambda n: ".head_from_camera." in n or ".camera_in_head." in n),
            "the camera's mount twice as well known",
        ),
        (
            scaled(lambda n: any(p in n for p in (".focal.", ".principal_point.", ".distortion."))),
            "a lens twice as good",
        ),
        (sigma(fit.information + placed), f"the stations' positions to {1e3 * _SURVEYED_M:g} mm"),
    ]
    whole = [(float(np.sqrt(max(value**2 + settles, 0.0))), text) for value, text in remedies]
    worth = sorted((value, text) for value, text in whole if value < (1.0 - _WORTH) * now)
    return [f"{text}: along, at {_JUDGED_M:g} m, {value:.3f} m instead of {now:.3f} m" for value, text in worth]
