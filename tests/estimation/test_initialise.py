"""From candidates to a track: aircraft are found, trees and chance pairings are not."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.initial_fix import Fix
from groundstation.estimation.initialise import TrackInitiator
from groundstation.estimation.tentative_track import InitiatedTarget
from groundstation.messages import Kinematics
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

    def sight(self, t: float, point: np.ndarray, width_m: float = SPAN_M, score: float = 10.0) -> list[CameraCandidate]:
        out = []
        for name, geometry in self.geometries.items():
            pan, tilt = aim(geometry, np.array([0.0, 300.0, 15.0]))
            projection = geometry.project(point, pan, tilt)
            assert projection is not None
            out.append(
                CameraCandidate(
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
        if found:
            break
    assert found
    error = found[0].kinematics.position_runway_m - glide(t)
    assert float(error @ np.linalg.solve(found[0].kinematics.covariance[:3, :3], error)) < 25
    assert np.linalg.norm(error[[0, 2]]) < 1.0


def test_static_objects_are_never_acquired(rng: np.random.Generator) -> None:
    scene = Scene(rng)
    things = [np.array([rng.uniform(-20, 20), rng.uniform(150, 400), 1.0]) for _ in range(5)]
    for k in range(200):
        sightings = [s for thing in things for s in scene.sight(k * 0.1, thing, width_m=1.5)]
        assert scene.initiator.step(k * 0.1, sightings) == ()


def test_random_candidates_are_never_acquired(rng: np.random.Generator) -> None:
    """Ten random candidates in each image, 200 pairs."""
    scene = Scene(rng)
    for k in range(200):
        sightings = []
        for name in scene.geometries:
            for _ in range(10):
                sightings.append(
                    CameraCandidate(
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
        assert scene.initiator.step(k * 0.1, sightings) == ()


@pytest.mark.parametrize(("width_m", "fits"), [(0.3, False), (1.5, True), (2.3, True), (9.0, False)])
def test_size_distinguishes_an_aircraft_from_other_flying_objects(
    rng: np.random.Generator, width_m: float, fits: bool
) -> None:
    scene = Scene(rng)
    assert bool(scene.initiator.fixes(scene.sight(0.0, glide(5.0), width_m=width_m))) is fits


def test_one_camera_alone_does_not_acquire(rng: np.random.Generator) -> None:
    scene = Scene(rng)
    for k in range(50):
        left = [s for s in scene.sight(k * 0.1, glide(k * 0.1)) if s.station == "left"]
        assert scene.initiator.step(k * 0.1, left) == ()


def fits_lifted(scene: Scene, off_px: float) -> bool:
    """Return whether a pair is taken whose right sighting is ``off_px`` below its place."""
    left, right = scene.sight(0.0, glide(5.0))
    return bool(scene.initiator.fixes([left, replace(right, pixel=right.pixel + [0.0, off_px])]))


@pytest.mark.parametrize(("off_px", "fits"), [(0.0, True), (5.0, True), (-5.0, True), (10.0, False), (-10.0, False)])
def test_a_pair_needs_rays_that_meet(rng: np.random.Generator, off_px: float, fits: bool) -> None:
    """Epipolar agreement: beyond the gate in v the same two sightings are refused, and by nothing but the gate."""
    assert fits_lifted(Scene(rng), off_px) is fits
    assert fits_lifted(Scene(rng, config=InitiationConfig(residual_gate_sigma=1e6)), off_px)


def begun(config: InitiationConfig) -> tuple[Kinematics, list[Fix]]:
    """Return a start, and the fixes of its last epoch; the same draws whatever the tuning."""
    scene = Scene(np.random.default_rng(11), config=config)
    for k in range(30):
        sightings = scene.sight(0.1 * k, glide(0.1 * k))
        found = scene.initiator.step(0.1 * k, sightings)
        if found:
            return found[0].kinematics, scene.initiator.fixes(sightings)
    raise AssertionError("no target was found")


def test_a_start_is_as_uncertain_as_errors_that_last_make_it() -> None:
    """Expected: the velocity's covariance times the share, the newest fix's added to the position as often; no tie."""
    one, fixes = begun(InitiationConfig(start_share=1.0))
    four, _ = begun(InitiationConfig(start_share=4.0))
    default, _ = begun(InitiationConfig())
    assert len(fixes) == 1
    np.testing.assert_array_equal(four.covariance, default.covariance)
    for attribute in ("position_runway_m", "velocity_runway_m_s"):
        np.testing.assert_array_equal(getattr(four, attribute), getattr(one, attribute))
    P, wider = one.covariance, four.covariance
    np.testing.assert_allclose(wider[3:, 3:], 4.0 * P[3:, 3:], rtol=1e-12)
    np.testing.assert_allclose(wider[:3, :3] - P[:3, :3], 3.0 * fixes[0].covariance_m2, rtol=1e-9)
    assert not P[:3, 3:].any()
    assert not P[3:, :3].any()
    further, _ = begun(InitiationConfig(start_share=1.0, start_position_sigma_m=1.5))
    np.testing.assert_allclose(further.covariance[:3, :3] - P[:3, :3], (1.5**2 - 0.5**2) * np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(further.covariance[3:, 3:], P[3:, 3:])


@pytest.mark.parametrize(
    ("point", "width_m", "why"),
    [
        ((0.0, 300.0, 15.0), 2.3, ""),
        ((0.0, 300.0, -3.05), 2.3, ""),  # within three sigmas of the lowest
        ((0.0, 300.0, -8.0), 2.3, "below the ground"),
        ((0.0, 7.0, 3.0), 2.3, "nearer than any target"),
        ((0.0, 9.5, 3.0), 2.3, ""),
        ((0.0, 3200.0, 120.0), 2.3, "farther than any target"),
        ((0.0, 1500.0, 390.0), 2.3, ""),
        ((0.0, 1500.0, 420.0), 2.3, "higher than any target"),
        ((0.0, 300.0, 15.0), 2.3 * 2.6, "too wide"),
        ((0.0, 300.0, 15.0), 2.3 / 3.2, "too narrow"),
    ],
)
def test_only_plausible_aircraft_are_fixes(point: tuple[float, ...], width_m: float, why: str) -> None:
    scene = Scene(np.random.default_rng(3))
    place, found = np.array(point), []
    for name, geometry in scene.geometries.items():
        pan, tilt = aim(geometry, place)
        projection = geometry.project(place, pan, tilt)
        assert projection is not None
        found.append(
            CameraCandidate(
                t_s=0.0,
                station=name,
                pixel=projection.pixel,
                width_px=width_m * 6667.0 / projection.depth_m,
                score=10.0,
                pan_rad=pan,
                tilt_rad=tilt,
                angle_sigma_rad=3e-5,
            )
        )
    fixes = scene.initiator.fixes(found)
    assert len(fixes) == (not why), why
    if fixes:
        assert fixes[0].position_m == pytest.approx(place, abs=1e-3 * place[1])


@pytest.mark.parametrize(("factor", "fits"), [(1.9, True), (2.2, False)])
def test_two_cameras_measure_equal_widths_of_an_object(factor: float, fits: bool) -> None:
    scene = Scene(np.random.default_rng(3), span_m=None)
    left, right = scene.sight(0.0, glide(5.0))
    assert left.width_px is not None
    # the same object except for the factor
    same = replace(right, width_px=left.width_px * factor)
    assert bool(scene.initiator.fixes([left, same])) is fits


def test_a_fuselage_is_narrower_than_the_span_allows() -> None:
    """Expected: a third of the given span is a fix where the channel sees an aircraft in both cameras, only there."""
    scene = Scene(np.random.default_rng(3), span_m=1.6)
    narrow = scene.sight(0.0, np.array([0.0, 250.0, 12.0]), width_m=0.55)
    for odds, fits in (((1.0, 1.0), True), ((1.0, -1.0), False), ((1.0, None), False), ((None, None), False)):
        seen = [replace(s, odds=o) for s, o in zip(narrow, odds, strict=True)]
        assert bool(scene.initiator.fixes(seen)) is fits
    # not whatever is narrow
    assert not scene.initiator.fixes(with_odds(scene.sight(0.0, np.array([0.0, 250.0, 12.0]), width_m=0.25), 3.0))


@pytest.mark.parametrize("second", ["right", "third"])
def test_widths_are_compared_at_each_camera_s_own_range(second: str) -> None:
    """A camera 100 m down the runway is half as far from the aircraft, and shows it twice as wide."""
    stations = {s.name: s.geometry() for s in make_rig(("left", second)).stations}
    initiator = TrackInitiator(stations, InitiationConfig(), None)
    point, seen = np.array([1.0, 195.0, 9.0]), []
    for name, geometry in stations.items():
        pan, tilt = aim(geometry, point)
        projection = geometry.project(point, pan, tilt)
        assert projection is not None
        seen.append(
            CameraCandidate(
                t_s=0.0,
                station=name,
                pixel=projection.pixel,
                width_px=2.0 * 6667.0 / projection.depth_m,
                score=10.0,
                pan_rad=pan,
                tilt_rad=tilt,
                angle_sigma_rad=3e-5,
            )
        )
    assert len(initiator.fixes(seen)) == 1


@pytest.mark.parametrize(("speed_m_s", "found"), [(25.0, True), (1.0, False), (200.0, False)])
def test_a_target_flies_as_fast_as_aircraft_do(speed_m_s: float, found: bool) -> None:
    """Expected: nothing slower than 2 m/s, however long it is watched, nothing faster than 150 m/s."""
    scene = Scene(np.random.default_rng(5))
    starts = [
        scene.initiator.step(0.1 * k, scene.sight(0.1 * k, glide(0.1 * k, speed_m_s=speed_m_s))) for k in range(15)
    ]
    assert any(starts) is found


def test_a_target_is_initiated_after_enough_fixes_over_enough_time_without_a_gap() -> None:
    def first(config: InitiationConfig, dt_s: float, missing: tuple[int, ...] = ()) -> int:
        scene = Scene(np.random.default_rng(7), config=config)
        for k in range(40):
            # confirmed, so that only the number of detections decides
            seen = [] if k in missing else scene.sight(dt_s * k, glide(dt_s * k))
            sightings = [replace(s, labelled=True) for s in seen]
            if scene.initiator.step(dt_s * k, sightings):
                return k
        raise AssertionError("no target was found")

    assert first(InitiationConfig(hits=6), 0.1) == 5
    assert first(InitiationConfig(hits=9), 0.1) == 8
    # the sixth fix is younger than that
    assert first(InitiationConfig(hits=6, min_age_s=0.75), 0.1) == 8
    # four misses in a row are borne, five are not: it begins again
    assert first(InitiationConfig(hits=6), 0.1, (3, 4, 5, 6)) == 9
    assert first(InitiationConfig(hits=6), 0.1, (3, 4, 5, 6, 7)) == 13


def first_of(scene: Scene, paths: list[tuple[Callable[[float], np.ndarray], float]]) -> Kinematics | None:
    """Return the first start within 2 s of several objects, each by its path and its score."""
    for k in range(20):
        sightings = [s for path, score in paths for s in scene.sight(0.1 * k, path(0.1 * k), score=score)]
        found = scene.initiator.step(0.1 * k, sightings)
        if found:
            return found[0].kinematics
    return None


@pytest.mark.parametrize(("least_m_s", "found"), [(2.0, True), (6.0, False)])
def test_what_creeps_is_no_target_however_surely_it_moves(least_m_s: float, found: bool) -> None:
    """Expected: across the line of sight 3.5 m/s show at once, and are too slow where targets are faster than that."""

    def across(t_s: float) -> np.ndarray:
        return np.array([-3.0 + 3.5 * t_s, 300.0, 15.0])

    scene = Scene(np.random.default_rng(5), config=InitiationConfig(min_speed_m_s=least_m_s))
    assert (first_of(scene, [(across, 10.0)]) is not None) is found


@pytest.mark.parametrize(("score", "found"), [(3.5, False), (4.5, True)])
def test_a_target_has_about_the_contrast_of_its_rivals(score: float, found: bool) -> None:
    """Expected: nothing of less than 0.4 of the clearest object's score; alone the faint one is accepted."""
    tree = np.array([15.0, 320.0, 4.0])
    paths = [(glide, score), (lambda _: tree, 10.0)]
    assert (first_of(Scene(np.random.default_rng(5)), paths) is not None) is found  # type: ignore[arg-type]
    assert first_of(Scene(np.random.default_rng(5)), [(glide, 3.5)]) is not None


def test_what_jumps_about_is_no_target() -> None:
    """Expected: by the mean square of its steps, which of an aircraft is about one for each of three coordinates."""
    jumpy = InitiationConfig(max_link_square=0.05)
    assert first_of(Scene(np.random.default_rng(5), config=jumpy), [(glide, 10.0)]) is None
    assert first_of(Scene(np.random.default_rng(5)), [(glide, 10.0)]) is not None


def with_odds(seen: list[CameraCandidate], odds: float) -> list[CameraCandidate]:
    return [replace(s, odds=odds) for s in seen]


def first_found(
    scene: Scene, place: Callable[[float], np.ndarray], odds: float, known: Kinematics | None = None
) -> tuple[float, InitiatedTarget] | None:
    """Return when a single object is confirmed within 10 s of 10 Hz, and what it is taken for."""
    for k in range(100):
        t = k * 0.1
        found = scene.initiator.step(t, with_odds(scene.sight(t, place(t)), odds), known)
        if found:
            return t, found[0]
    return None


def standing(t: float) -> np.ndarray:
    return np.array([1.0, 200.0, 0.5])


def test_an_aircraft_that_stands_is_found_by_what_it_looks_like(rng: np.random.Generator) -> None:
    found = first_found(Scene(rng), standing, 4.0)
    assert found is not None
    t, target = found
    assert t <= 0.5
    assert target.recognised
    assert not target.moving
    assert target.odds == pytest.approx(4.0)
    error = target.kinematics.position_runway_m - standing(t)
    assert float(error @ np.linalg.solve(target.kinematics.covariance[:3, :3], error)) < 25


def test_one_camera_that_recognises_it_is_not_sufficient(rng: np.random.Generator) -> None:
    scene = Scene(rng)
    for k in range(100):
        left, right = scene.sight(k * 0.1, standing(k * 0.1))
        seen = [replace(left, odds=5.0), replace(right, odds=-1.0)]
        assert scene.initiator.step(k * 0.1, seen) == ()


def test_ground_next_to_an_aircraft_does_not_speak_against_it(rng: np.random.Generator) -> None:
    """Expected: of two features as near to the track, the one that the channel recognises is the aircraft's."""

    def next_to_it(t: float) -> np.ndarray:
        return standing(t) + [0.1, 0.3, 0.0]

    found = of_several(Scene(rng), [(standing, 10.0, 4.0), (next_to_it, 10.0, -np.inf)], None)
    assert len(found) == 1
    assert found[0].recognised
    assert found[0].odds == pytest.approx(4.0)


def test_what_is_taken_for_something_else_must_move_for_longer(rng: np.random.Generator) -> None:
    """Expected: a bird is not found at once, and an aircraft unlike those of the training is found all the same."""
    at_once, later = (first_found(Scene(rng), glide, odds) for odds in (2.2, -8.0))
    assert at_once is not None
    assert later is not None
    assert at_once[0] < 1.5
    assert later[0] >= 2.0
    assert later[1].moving
    assert not later[1].recognised


def test_the_unlikelier_it_is_the_longer_it_must_move(rng: np.random.Generator) -> None:
    """Expected: 2 s and half a second for each unit of log odds below 2, at most 9 s."""
    for odds, age_s in ((1.9, 2.05), (0.0, 3.0), (-4.0, 5.0), (-30.0, 9.0)):
        found = first_found(Scene(rng), glide, odds)
        assert found is not None
        assert age_s - 1e-9 <= found[0] <= age_s + 0.11
        assert len(found[1].pixels) == 2 * (round(10.0 * found[1].age_s) + 1)


@pytest.mark.parametrize("weighed", [False, True])
def test_what_no_window_was_laid_on_waits_where_the_channel_weighs_others(
    rng: np.random.Generator, weighed: bool
) -> None:
    """Expected: 2 s; at once by a detector without such a channel."""
    scene = Scene(rng)
    other = replace(scene.sight(0.0, standing(0.0))[0], odds=4.0)
    found_s = math.inf
    for k in range(50):
        t = k * 0.1
        seen = [*scene.sight(t, glide(t)), *([replace(other, t_s=t)] if weighed and k == 0 else [])]
        if scene.initiator.step(t, seen):
            found_s = t
            break
    assert found_s == pytest.approx(2.05, abs=0.06) if weighed else found_s < 1.5


def test_a_target_that_is_tracked_already_is_not_returned(rng: np.random.Generator) -> None:
    known = Kinematics(
        position_runway_m=standing(0.0), velocity_runway_m_s=np.zeros(3), covariance=np.diag([0.1, 1.0, 0.1, 1, 1, 1])
    )
    assert first_found(Scene(rng), standing, 4.0, known) is None
    elsewhere = replace(known, position_runway_m=standing(0.0) + [0.0, 100.0, 0.0])
    assert first_found(Scene(rng), standing, 4.0, elsewhere) is not None


def of_several(
    scene: Scene, objects: list[tuple[Callable[[float], np.ndarray], float, float | None]], known: Kinematics | None
) -> tuple[InitiatedTarget, ...]:
    """Return what is confirmed after 3 s of objects, each by its path, its score and its log odds."""
    found: tuple[InitiatedTarget, ...] = ()
    for k in range(30):
        t = k * 0.1
        seen = [replace(s, odds=odds) for path, score, odds in objects for s in scene.sight(t, path(t), score=score)]
        found = scene.initiator.step(t, seen, known)
    return found


def test_what_is_recognised_and_moves_comes_first_whatever_stands_out_more(rng: np.random.Generator) -> None:
    """Expected: an aircraft that lands before two parked ones, one of them the target, that are clearer by far."""
    known = Kinematics(
        position_runway_m=standing(0.0), velocity_runway_m_s=np.zeros(3), covariance=np.diag([0.1, 1.0, 0.1, 1, 1, 1])
    )

    def second(t: float) -> np.ndarray:
        return np.array([-9.0, 150.0, 0.5])

    found = of_several(Scene(rng), [(standing, 10.0, 4.0), (second, 10.0, 4.0), (glide, 3.0, 4.0)], known)
    assert [(f.recognised, f.moving) for f in found] == [(True, True), (True, False)]
    assert np.linalg.norm(found[0].kinematics.position_runway_m[[0, 2]] - glide(2.9)[[0, 2]]) < 1.0
    assert found[0].age_s == pytest.approx(2.9, abs=0.2)


def test_of_two_that_are_recognised_the_likelier_comes_first_whatever_stands_out_more(rng: np.random.Generator) -> None:
    """Expected: so far as odds tell aircraft from other things; of two that are sure the clearer one."""

    def second(t: float) -> np.ndarray:
        return np.array([-9.0, 150.0, 0.5])

    for first, odds_of_other, at in ((2.9, 2.6, standing), (6.0, 4.0, second)):
        found = of_several(Scene(rng), [(standing, 3.0, first), (second, 10.0, odds_of_other)], None)
        assert len(found) >= 2
        assert np.linalg.norm(found[0].kinematics.position_runway_m[[0, 2]] - at(2.9)[[0, 2]]) < 1.0


def test_clutter_that_the_channel_doubts_hides_nothing_that_moves(rng: np.random.Generator) -> None:
    """Expected: what moves starts by a twentieth of the clutter's score, as proposals unknown to the channel have."""
    found = of_several(Scene(rng), [(standing, 10.0, 0.5), (glide, 0.5, None)], None)
    assert [(f.recognised, f.moving) for f in found] == [(False, True)]
    assert of_several(Scene(rng), [(standing, 10.0, None), (glide, 0.5, None)], None) == ()


def test_what_was_given_up_as_false_is_not_found_again_by_what_was_known_of_it(rng: np.random.Generator) -> None:
    scene = Scene(rng)
    found = of_several(scene, [(standing, 10.0, 4.0)], None)
    assert len(found) == 1
    scene.initiator.discard(found[0].kinematics)
    t = 3.0
    assert scene.initiator.step(t, with_odds(scene.sight(t, standing(t)), 4.0)) == ()
