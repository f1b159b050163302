"""From candidates to a track: aircraft are found, trees and chance pairings are not."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.initialise import Sighting, TrackInitiator
from tests.stereo_rig import aim, glide, make_rig

SIGMA_PX = 0.7
SPAN_M = 2.3


class Scene:
    def __init__(
        self,
        generator: np.random.Generator,
        span_m: float | None = SPAN_M,
        config: InitiationConfig | None = None,
    ) -> None:
        self.rig = make_rig()
        self.geometries = {s.name: s.geometry() for s in self.rig.stations}
        self.generator = generator
        self.initiator = TrackInitiator(self.geometries, config or InitiationConfig(), span_m)

    def sight(self, t: float, point: np.ndarray, width_m: float = SPAN_M, score: float = 10.0) -> list[Sighting]:
        out = []
        for name, geometry in self.geometries.items():
            pan, tilt = aim(geometry, np.array([0.0, 300.0, 15.0]))
            projection = geometry.project(point, pan, tilt)
            assert projection is not None
            out.append(
                Sighting(
                    t_s=t,
                    station=name,
                    pixel=projection.pixel + self.generator.normal(0, SIGMA_PX, 2),
                    width_px=width_m * 6667.0 / projection.depth_m * self.generator.uniform(0.8, 1.1),
                    score=score,
                    pan_rad=pan,
                    tilt_rad=tilt,
                    angle_sigma_rad=3e-5,
                )
            )
        return out


def test_an_approaching_aircraft_is_acquired_among_static_clutter(rng: np.random.Generator) -> None:
    """Within 2 s at 450 m, with six trees in each picture, five of them brighter than the aircraft."""
    scene = Scene(rng)
    trees = [np.array([rng.uniform(-30, 30), rng.uniform(200, 500), 2.0]) for _ in range(6)]
    found = None
    for k in range(20):
        t = k * 0.1
        sightings = scene.sight(t, glide(t), score=8.0)
        for tree in trees:
            sightings += scene.sight(t, tree, width_m=2.0, score=12.0)
        found = scene.initiator.step(t, sightings)
        if found is not None:
            break
    assert found is not None
    error = found.position_runway_m - glide(t)
    assert float(error @ np.linalg.solve(found.covariance[:3, :3], error)) < 25
    assert np.linalg.norm(error[[0, 2]]) < 1.0


def test_static_things_are_never_acquired(rng: np.random.Generator) -> None:
    scene = Scene(rng)
    things = [np.array([rng.uniform(-20, 20), rng.uniform(150, 400), 1.0]) for _ in range(5)]
    for k in range(200):
        sightings = [s for thing in things for s in scene.sight(k * 0.1, thing, width_m=1.5)]
        assert scene.initiator.step(k * 0.1, sightings) is None


def test_random_candidates_are_never_acquired(rng: np.random.Generator) -> None:
    """Ten random candidates in each image, 200 pairs."""
    scene = Scene(rng)
    for k in range(200):
        sightings = []
        for name in scene.geometries:
            for _ in range(10):
                sightings.append(
                    Sighting(
                        t_s=k * 0.1,
                        station=name,
                        pixel=rng.uniform([0, 0], [1279, 959]),
                        width_px=rng.uniform(10, 80),
                        score=5.0,
                        pan_rad=0.0,
                        tilt_rad=0.05,
                        angle_sigma_rad=3e-5,
                    )
                )
        assert scene.initiator.step(k * 0.1, sightings) is None


@pytest.mark.parametrize(("width_m", "fits"), [(0.3, False), (1.5, True), (2.3, True), (9.0, False)])
def test_size_tells_an_aircraft_from_what_else_flies(rng: np.random.Generator, width_m: float, fits: bool) -> None:
    scene = Scene(rng)
    assert bool(scene.initiator.fixes(scene.sight(0.0, glide(5.0), width_m=width_m))) is fits


def test_one_camera_alone_acquires_nothing(rng: np.random.Generator) -> None:
    scene = Scene(rng)
    for k in range(50):
        left = [s for s in scene.sight(k * 0.1, glide(k * 0.1)) if s.station == "left"]
        assert scene.initiator.step(k * 0.1, left) is None


def fits_lifted(scene: Scene, off_px: float) -> bool:
    """Return whether a pair is taken whose right sighting is ``off_px`` below its place."""
    left, right = scene.sight(0.0, glide(5.0))
    return bool(scene.initiator.fixes([left, replace(right, pixel=right.pixel + [0.0, off_px])]))


@pytest.mark.parametrize(("off_px", "fits"), [(0.0, True), (5.0, True), (-5.0, True), (10.0, False), (-10.0, False)])
def test_a_pair_is_two_views_of_one_thing_only_where_its_rays_meet(
    rng: np.random.Generator, off_px: float, fits: bool
) -> None:
    """Epipolar agreement: beyond the gate in v the same two sightings are refused, and by nothing but the gate."""
    assert fits_lifted(Scene(rng), off_px) is fits
    assert fits_lifted(Scene(rng, config=InitiationConfig(residual_gate_sigma=1e6)), off_px)
