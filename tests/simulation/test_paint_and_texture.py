"""Paint on a runway has the requested sizes, and textures the requested contrast."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.errors import ScenarioError
from groundstation.simulation.scenery.ground_kernels import ground
from groundstation.simulation.scenery.runway_paint import RunwayPaint
from groundstation.simulation.scenery.scenery import Marking, RunwayLook, Scenery, Skyline
from groundstation.simulation.scenery.tones import tables_of, tones_of
from tests.complaints import complaint

FINE_M = 0.01


def greens(scenery: Scenery, points: np.ndarray) -> np.ndarray:
    """Return how green the ground is at points (n, 2), m, seen closely along the runway."""
    tones, tables, colour, room = tones_of(scenery), tables_of(scenery), np.empty(3), np.empty(3)
    found = []
    for x, y in points.tolist():
        ground(tones, tables, x, y, 0.0, 1.0, FINE_M, FINE_M, colour, room)
        found.append(float(colour[1]))
    return np.array(found)


def along(x: float, length_m: float) -> np.ndarray:
    y = np.arange(100.0, 100.0 + length_m, 0.1)
    return np.column_stack([np.full(y.size, x), y])


@pytest.mark.parametrize(
    ("paint", "painted_m"), [(RunwayPaint(), 6.0), (RunwayPaint(dash_length_m=3.0, dash_width_m=1.0), 3.0)]
)
def test_dashes_are_as_long_as_asked_for(paint: RunwayPaint, painted_m: float) -> None:
    look = RunwayLook(marking=Marking.CENTRE, texture=0.0, paint=paint)
    shown = greens(Scenery(runway=look), along(0.0, paint.dash_every_m)) > 150.0
    assert shown.sum() * 0.1 == pytest.approx(painted_m, abs=0.2)
    aside = greens(Scenery(runway=look), along(0.4, paint.dash_every_m)) > 150.0
    assert aside.any() == (paint.dash_width_m > 0.8)


def test_dashes_begin_where_asked_for() -> None:
    look = RunwayLook(marking=Marking.CENTRE, texture=0.0, paint=RunwayPaint(dash_from_y_m=104.0))
    shown = greens(Scenery(runway=look), along(0.0, 14.0)) > 150.0
    assert along(0.0, 14.0)[np.flatnonzero(shown)[0], 1] == pytest.approx(104.0, abs=0.2)


def test_texture_is_a_factor_on_what_varies() -> None:
    points = np.column_stack([np.full(300, 40.0), np.linspace(50.0, 400.0, 300)])
    plain = Scenery(ground_texture=0.0)
    spread = [greens(replace(plain, ground_texture=factor), points).std() for factor in (0.0, 0.5, 1.0)]
    assert spread[0] == 0.0
    assert spread[2] == pytest.approx(2.0 * spread[1])
    strong = tones_of(Scenery(skyline=Skyline(hills_texture=2.0, trees_texture=0.5))).skyline
    standard = tones_of(Scenery()).skyline
    assert strong.hills_fine.g == 2.0 * standard.hills_fine.g
    assert strong.trees_fine.g == 0.5 * standard.trees_fine.g


def test_paint_that_cannot_be_is_refused() -> None:
    reported = complaint(ScenarioError, lambda: RunwayPaint(dash_length_m=20.0))
    assert "dash_length_m: got 20; wanted at most dash_every_m = 14" in reported
    assert "ground_texture: got -1.0" in complaint(ScenarioError, lambda: Scenery(ground_texture=-1.0))
