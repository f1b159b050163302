"""Survey and check of simulated rigs: do errors come as large as their sigmas say, and are knocks found?

Per rig: a survey by six landmarks (coordinates to 2 cm, 40 to 320 m away), encoders of 0.01° and steps of 0.00625°,
pixels of 0.3 px, mounts off by 0.003°, lenses by 3 px and 1 px, all as the rig says; positions by total station (5 mm)
or not known. Then checks on other mornings, with the survey's sightings as reference and without, of the same rig and
of one whose left base was knocked by 0.01°. Figures in docs/notes/calibration.md.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from landmark_study.simulated import SurveyScene, knocked, look, morning, turned_rad
from parallel_study import StudyRun, add_study_arguments, in_blocks
from scipy.stats import chi2

from calibration.landmarks.check import Check, solve_check
from calibration.landmarks.survey import Survey, solve_survey
from calibration.sightings import LandmarkSighting
from groundstation.rig.rig import Rig

KNOCK_RAD = float(np.radians(0.01))
AXES = ("tilt", "roll", "pan")
# of all the figures that a study prints one in a thousand may be outside by chance
CHANCE = 1e-3
# rigs to a job, some seconds to half a minute
SURVEY_BLOCK, CHECK_BLOCK = 10, 1


def errors(survey: Survey, day: SurveyScene) -> dict[str, float]:
    """Return each station parameter's error over its sigma."""
    found: dict[str, float] = {}
    for station in day.true.stations:
        own = survey.rig[station.name]
        off = {f"runway_from_base.{a}": e for a, e in zip("xyz", turned_rad(own, station), strict=True)}
        off |= {f"ptu_position.{a}": e for a, e in zip("xyz", station.ptu_position_m - own.ptu_position_m, strict=True)}
        off |= {f"focal.{a}": e for a, e in zip("xy", station.lens.focal_px - own.lens.focal_px, strict=True)}
        names = survey.fit.problem.names
        for name, error in off.items():
            if f"{station.name}.{name}" in names:
                found[f"{station.name}.{name}"] = float(error / survey.fit.sigma(f"{station.name}.{name}"))
    return found


def pose_nees(survey: Survey, day: SurveyScene) -> float:
    """Return eᵀC⁻¹e of both stations' orientations and positions."""
    names: list[str] = []
    off: list[float] = []
    for station in day.true.stations:
        own = survey.rig[station.name]
        names += [f"{station.name}.runway_from_base.{a}" for a in "xyz"]
        off += list(turned_rad(own, station))
        names += [f"{station.name}.ptu_position.{a}" for a in "xyz"]
        off += list(station.ptu_position_m - own.ptu_position_m)
    return float(np.array(off) @ np.linalg.solve(survey.fit.block(names), np.array(off)))


def surveyed(total_station: bool, readings: int, seeds: list[int]) -> list[tuple[bool, float, dict[str, float]]]:
    """Return whether sigmas were raised, eᵀC⁻¹e of the poses, and errors over sigmas, of each rig of a block."""
    found = []
    for seed in seeds:
        generator = np.random.default_rng([seed, int(total_station)])
        day = morning(generator, total_station=total_station)
        survey = solve_survey(day.stated, look(day.true, day.stands, generator, readings), day.table)
        found.append((bool(survey.fit.raised > 1.0), pose_nees(survey, day), errors(survey, day)))
    return found


def show_survey(found: Sequence[tuple[bool, float, dict[str, float]]], readings: int, total_station: bool) -> None:
    rigs, raised, nees = len(found), sum(own for own, _, _ in found), [own for _, own, _ in found]
    squares: dict[str, float] = {}
    for _, _, off in found:
        for name, value in off.items():
            squares[name] = squares.get(name, 0.0) + value**2
    n = 12
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], n * rigs) / rigs
    where = "positions by total station" if total_station else "positions not known"
    print(f"survey, {where}: {rigs} rigs, {readings} readings of each landmark, {raised} with raised sigmas")
    print(f"  pose eᵀC⁻¹e {np.mean(nees):.2f} for {n} parameters, bounds {low:.2f} to {high:.2f}")
    each = CHANCE / len(squares)
    low, high = chi2.ppf([each / 2, 1 - each / 2], rigs) / rigs
    values = {name: value / rigs for name, value in squares.items()}
    outside = [name for name, value in values.items() if not low <= value <= high]
    print(
        f"  (error/sigma)² of {len(values)} parameters: {min(values.values()):.2f} to {max(values.values()):.2f}, "
        f"bounds {low:.2f} to {high:.2f}; outside: {', '.join(outside) or 'none'}"
    )


@dataclass(slots=True)
class Count:
    """What checks have answered: alarms of rigs that stand, their statistics, what they see, knocks found by axis."""

    still: int = 0
    alarms: int = 0
    statistic: list[float] = field(default_factory=list)
    sees_deg: list[list[float]] = field(default_factory=list)
    knocks: int = 0
    found: list[int] = field(default_factory=lambda: [0, 0, 0])


def one_morning(
    count: Count,
    day: SurveyScene,
    rig: Rig,
    reference: list[LandmarkSighting],
    readings: int,
    generator: np.random.Generator,
    knocks: bool,
) -> None:
    """Check the rig as it stands, and knocked about each axis."""

    def check(true: Rig) -> Check:
        return solve_check(rig, look(true, day.stands, generator, readings), day.table, reference)

    still = check(day.true)
    count.still += 1
    count.alarms += bool(still.moved)
    count.statistic += [m.statistic for m in still.movements]
    count.sees_deg += [np.degrees(m.detectable_rad).tolist() for m in still.movements]
    if not knocks:
        return
    count.knocks += 1
    for axis in range(3):
        hit = check(knocked(day.true, "left", axis, KNOCK_RAD))
        count.found[axis] += any(m.station == "left" for m in hit.moved)


def checked(mornings: int, knocked_mornings: int, readings: int, seeds: list[int]) -> list[dict[str, Any]]:
    """Return what checks with and without reference answer over a block of rigs, each of which is surveyed once."""
    with_reference, without = Count(), Count()
    for seed in seeds:
        generator = np.random.default_rng([seed, 7])
        day = morning(generator)
        first = look(day.true, day.stands, generator, readings)
        rig = solve_survey(day.stated, first, day.table).rig
        for k in range(mornings):
            one_morning(with_reference, day, rig, first, readings, generator, k < knocked_mornings)
        one_morning(without, day, rig, [], readings, generator, True)
    return [asdict(with_reference), asdict(without)]


def added(counts: Sequence[dict[str, Any]]) -> Count:
    """Return the sum of what `checked` returns of blocks."""
    total = Count()
    for own in (Count(**count) for count in counts):
        total.still += own.still
        total.alarms += own.alarms
        total.statistic += own.statistic
        total.sees_deg += own.sees_deg
        total.knocks += own.knocks
        total.found = [sum(pair) for pair in zip(total.found, own.found, strict=True)]
    return total


def show_check(blocks: Sequence[Sequence[dict[str, Any]]], readings: int) -> None:
    """Print false alarms and knocks found."""
    with_reference, without = (added(counts) for counts in zip(*blocks, strict=True))
    for word, count in (("with", with_reference), ("without", without)):
        print(f"check, {readings} readings of each landmark, {word} reference")
        share, mean = 100 * count.alarms / count.still, float(np.mean(count.statistic))
        print(f"  {count.still} still: {count.alarms} false alarms ({share:.2f} %), statistic {mean:.2f} of 3")
        for axis, name in enumerate(AXES):
            sees = np.median(np.array(count.sees_deg)[:, axis])
            print(f"  0.01° in {name}: found {count.found[axis]} of {count.knocks}; surely sees {sees:.4f}°")


def one_block(job: tuple[str, tuple[Any, ...]]) -> list[Any]:
    """Survey or check a block of rigs."""
    part, arguments = job
    return list(surveyed(*arguments) if part == "survey" else checked(*arguments))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=120)
    parser.add_argument("--mornings", type=int, default=4)
    parser.add_argument("--knocked", type=int, default=1)
    parser.add_argument("--readings", type=int, nargs="+", default=[24, 40])
    add_study_arguments(parser, "survey-and-check")
    options = parser.parse_args()
    readings = options.readings[0]
    survey_blocks, check_blocks = (in_blocks(range(options.rigs), size) for size in (SURVEY_BLOCK, CHECK_BLOCK))
    jobs: dict[str, tuple[str, tuple[Any, ...]]] = {
        f"survey-{total_station}-{block[0]}": ("survey", (total_station, readings, block))
        for total_station in (True, False)
        for block in survey_blocks
    }
    for number in options.readings:
        for block in check_blocks:
            jobs[f"check-{number}-{block[0]}"] = ("check", (options.mornings, options.knocked, number, block))
    values = StudyRun.chosen("survey and check", options).values(one_block, jobs)
    for total_station in (True, False):
        found = [values[f"survey-{total_station}-{block[0]}"] for block in survey_blocks]
        show_survey([rig for block in found for rig in block], readings, total_station)
    for number in options.readings:
        show_check([values[f"check-{number}-{block[0]}"] for block in check_blocks], number)


if __name__ == "__main__":
    main()
