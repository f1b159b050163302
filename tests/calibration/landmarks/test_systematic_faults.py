"""A survey whose whole table is wrong is called that: axes, units, columns; no two landmarks are blamed for it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from landmark_study.simulated import SurveyScene, look, morning

from calibration.landmarks.rejection import LandmarkFitError
from calibration.landmarks.survey import solve_survey
from calibration.landmarks.systematic_faults import explained
from calibration.sightings import Landmark, LandmarkSighting
from tests.complaints import complaint

FILES = (Path("sightings.csv"), Path("landmarks.csv"))
Sightings = list[LandmarkSighting]


def explanation(day: SurveyScene, seen: Sightings, marks: dict[str, Landmark]) -> str:
    """Return the message of a survey that has to fail."""

    def survey() -> None:
        try:
            solve_survey(day.stated, seen, marks)
        except LandmarkFitError as fault:
            raise explained(fault, day.stated, seen, marks, FILES) from fault

    return complaint(LandmarkFitError, survey)


def moved(day: SurveyScene, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Landmark]:
    return {name: replace(one, place=change(np.array(one.place))) for name, one in day.table.items()}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p * [1, 1, -1], "with z reversed"),
        (lambda p: p[[1, 0, 2]], "with x and y exchanged; wanted x to the right"),
        (lambda p: p / 0.3048, "with places in feet; wanted m"),
        (lambda p: 1000.0 * p, "with places in mm; wanted m"),
    ],
)
def test_a_table_of_landmarks(rng: np.random.Generator, change: Callable[[np.ndarray], np.ndarray], words: str) -> None:
    day = morning(rng)
    text = explanation(day, look(day.true, day.stands, rng, 4), moved(day, change))
    assert text.startswith("landmarks.csv: got landmarks that contradict the sightings as they stand, but that fit")
    assert words in text


def in_pixels(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[LandmarkSighting], LandmarkSighting]:
    return lambda one: replace(one, pixel_px=change(one.pixel_px))


def in_angles(factor: float) -> Callable[[LandmarkSighting], LandmarkSighting]:
    return lambda one: replace(one, pan_rad=factor * one.pan_rad, tilt_rad=factor * one.tilt_rad)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (in_pixels(lambda uv: uv[::-1]), "with u and v exchanged"),
        (in_pixels(lambda uv: np.array([uv[0], 959.0 - uv[1]])), "with v counted from below"),
        (in_pixels(lambda uv: uv / 2.0), "with pixels of a picture 0.5 times as wide as the lens's"),
        (in_angles(float(np.radians(1.0))), "with angles in radians; wanted deg"),
        (in_angles(1.0 / 0.9), "with angles in gradians"),
        (lambda one: replace(one, pan_rad=one.tilt_rad, tilt_rad=one.pan_rad), "with pan and tilt exchanged"),
        (lambda one: replace(one, pan_rad=-one.pan_rad), "with pan reversed"),
        (
            lambda one: replace(one, station="left" if one.station == "right" else "right"),
            "with the stations left and right exchanged",
        ),
    ],
)
def test_a_table_of_sightings(
    rng: np.random.Generator, change: Callable[[LandmarkSighting], LandmarkSighting], words: str
) -> None:
    day = morning(rng)
    seen = [change(one) for one in look(day.true, day.stands, rng, 4)]
    text = explanation(day, seen, dict(day.table))
    assert text.startswith("sightings.csv: got sightings that contradict the marks as they stand, but that fit (to 0.0")
    assert words in text


def test_stations_whose_places_are_found_may_be_exchanged(rng: np.random.Generator) -> None:
    """Nothing contradicts their places then, but their names."""
    day = morning(rng, total_station=False)
    seen = look(day.true, day.stands, rng, 4)
    assert not any("doubtful" in note for note in solve_survey(day.stated, seen, day.table).notes)
    exchanged = [replace(one, station="left" if one.station == "right" else "right") for one in seen]
    notes = solve_survey(day.stated, exchanged, day.table).notes
    doubts = [note for note in notes if note.startswith("doubtful: left is at x = ")]
    assert len(doubts) == 1, notes
    assert "to the right of right" in doubts[0]
    assert "as seen along +y, towards the approaching aircraft" in doubts[0]
    assert doubts[0].endswith("are the stations exchanged in the sightings?")


def test_one_station_of_two_is_named(rng: np.random.Generator) -> None:
    day = morning(rng)
    seen = [
        replace(one, pixel_px=np.array([1279.0, 959.0]) - one.pixel_px) if one.station == "right" else one
        for one in look(day.true, day.stands, rng, 4)
    ]
    text = explanation(day, seen, dict(day.table))
    assert "sightings that contradict the marks of station right as they stand" in text
    assert "with pictures upside down" in text


def test_names_that_are_mixed_up_are_no_axis_and_no_single_mistake(rng: np.random.Generator) -> None:
    """Nothing explains them, so that no two landmarks are blamed, and no axis."""
    day = morning(rng)
    names = dict(zip(day.table, [*list(day.table)[2:], *list(day.table)[:2]], strict=True))
    seen = [replace(one, landmark=names[one.landmark]) for one in look(day.true, day.stands, rng, 4)]
    text = explanation(day, seen, dict(day.table))
    assert "as they stand" not in text
    assert "one of" not in text


def test_one_wrong_landmark_is_left_to_the_survey(rng: np.random.Generator) -> None:
    """Of three, with places that are known, it cannot be told which; no axis is blamed for it."""
    day = morning(rng)
    few = {name: day.table[name] for name in ("m0", "m1", "m4")}
    seen = look(day.true, {name: day.stands[name] for name in few}, rng, 4)
    wrong = few | {"m1": replace(few["m1"], place=np.array(few["m1"].place) + [0.0, 0.0, 2.0])}
    assert "contradict each other" in explanation(day, seen, wrong)


def test_three_landmarks_are_no_evidence_of_an_exchange(rng: np.random.Generator) -> None:
    """They fit any station whose place is free: two pairs of names mixed up at left are not right's."""
    day = morning(rng, total_station=False)
    mixed = {"m0": "m1", "m1": "m0", "m2": "m5", "m5": "m2"}
    seen = [
        replace(one, landmark=mixed.get(one.landmark, one.landmark)) if one.station == "left" else one
        for one in look(day.true, day.stands, rng, 4)
        if one.station == "left" or one.landmark in ("m0", "m3", "m4")
    ]
    text = explanation(day, seen, dict(day.table))
    assert "exchanged" not in text
    assert "station left" in text


def test_an_exchange_shows_though_one_station_saw_few(rng: np.random.Generator) -> None:
    """Two landmarks of one are too few to be judged; the other's six fit only in its place."""
    day = morning(rng)
    few = ("m0", "m3")
    seen = [
        replace(one, station="left" if one.station == "right" else "right")
        for one in look(day.true, day.stands, rng, 4)
        if one.station == "left" or one.landmark in few
    ]
    assert "with the stations left and right exchanged" in explanation(day, seen, dict(day.table))
