"""The whole-frame search on synthetic scenes whose answer is known."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_x, rotation_z

SIZE = (640, 480)
FOCAL_PX = 3000.0
HEAD_FROM_CAMERA = rotation_x(-np.pi / 2)


def lens(distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)) -> Lens:
    return Lens(
        image_size_px=SIZE,
        focal_px=np.array([FOCAL_PX, FOCAL_PX]),
        principal_point_px=np.array([319.5, 239.5]),
        distortion=np.array(distortion),
    )


def camera_from_runway(pan_rad: float, tilt_rad: float) -> FloatArray:
    return np.asarray((rotation_z(pan_rad) @ rotation_x(tilt_rad) @ HEAD_FROM_CAMERA).T, np.float64)


def sky(rng: np.random.Generator, size: tuple[int, int] = SIZE, noise: float = 1.5) -> ImageArray:
    """A shaded sky with camera noise."""
    w, h = size
    ramp = np.linspace(150.0, 215.0, h)[:, None] + np.linspace(0.0, 12.0, w)[None, :]
    grey = ramp[:, :, None] + rng.normal(0.0, noise, (h, w, 1))
    return np.clip(grey + np.array([20.0, 5.0, -10.0]), 0, 255).astype(np.uint8)


def put(image: ImageArray, x: int, y: int, w: int, h: int, level: float) -> None:
    """Add an aircraft-like cross of the given box: a wing and a body."""
    for x0, y0, x1, y1 in (
        (x, y + h // 3, x + w, y + h // 3 + max(h // 3, 1)),
        (x + w // 2 - w // 8, y, x + w // 2 + max(w // 8, 1), y + h),
    ):
        part = image[max(y0, 0) : y1, max(x0, 0) : x1]
        part[...] = np.clip(part.astype(np.float64) + level, 0, 255).astype(np.uint8)


def hits(found: tuple[Candidate, ...], u: float, v: float, reach: float) -> list[int]:
    return [i for i, c in enumerate(found) if abs(c.u_px - u) <= reach and abs(c.v_px - v) <= reach]


@pytest.mark.parametrize(
    ("width", "height", "level"),
    [(5, 3, -40.0), (8, 3, 25.0), (30, 8, -12.0), (80, 24, -20.0), (200, 60, 30.0), (320, 90, -50.0)],
)
def test_a_target_in_the_sky_is_the_first_candidate(
    rng: np.random.Generator, width: int, height: int, level: float
) -> None:
    image = sky(rng)
    put(image, 250, 180, width, height, level)
    found = CandidateFinder(AcquisitionConfig(), SIZE).find(image, 0.0)
    assert 0 in hits(found, 250 + width / 2, 180 + height / 2, max(2.5, 0.15 * width))
    assert not found[0].moving


def test_a_small_target_survives_the_reduction_of_a_large_frame(rng: np.random.Generator) -> None:
    image = sky(rng, (1280, 960))
    put(image, 900, 300, 6, 4, -40.0)
    found = CandidateFinder(AcquisitionConfig(), (1280, 960)).find(image, 0.0)
    assert 0 in hits(found, 903, 302, 3.0)


def test_an_empty_sky_has_no_strong_candidate(rng: np.random.Generator) -> None:
    finder = CandidateFinder(AcquisitionConfig(), SIZE)
    for k in range(4):
        found = finder.find(sky(rng), 0.1 * k)
        assert all(c.score < 6.0 for c in found)
        assert len(found) <= 3


def landscape(rng: np.random.Generator) -> ImageArray:
    """A wide textured ground under a sky, with strong static marks, to cut views from."""
    h, w = 700, 1400
    small = rng.uniform(40.0, 150.0, (h // 6, w // 6)).astype(np.float32)
    ground = cv2.GaussianBlur(cv2.resize(small, (w, h), interpolation=cv2.INTER_CUBIC), (0, 0), 1.5)
    for x in range(30, w, 120):
        ground[420:440, x : x + 40] = 230.0
    ground[:200] = np.linspace(170.0, 200.0, 200)[:, None]
    return cv2.cvtColor(np.clip(ground, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


def view(world: ImageArray, pan_rad: float, tilt_rad: float, rng: np.random.Generator) -> ImageArray:
    """What a camera turned by pan and tilt sees of a far landscape (its middle at zero angles)."""
    k = np.array([[FOCAL_PX, 0.0, 319.5], [0.0, FOCAL_PX, 239.5], [0.0, 0.0, 1.0]])
    middle = np.array([[1.0, 0.0, 700.0 - 319.5], [0.0, 1.0, 330.0 - 239.5], [0.0, 0.0, 1.0]])
    # a world pixel is the pixel of an unturned camera, shifted
    unturned_from_turned = camera_from_runway(0.0, 0.0) @ camera_from_runway(pan_rad, tilt_rad).T
    world_from_view = middle @ k @ unturned_from_turned @ np.linalg.inv(k)
    seen = cv2.warpPerspective(world, world_from_view, SIZE, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return np.clip(seen + rng.normal(0.0, 1.0, (*seen.shape[:2], 1)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("known", [True, False], ids=["angles", "pictures"])
def test_a_mover_before_textured_ground_is_found_while_the_camera_turns(rng: np.random.Generator, known: bool) -> None:
    """The angles carry a pixel of noise; the mover crosses at 30 px/s, the camera pans the other way."""
    world = landscape(rng)
    finder = CandidateFinder(AcquisitionConfig(), SIZE, lens() if known else None)
    ranks, rates = [], []
    for k in range(20):
        t_s, pan, tilt = 0.1 * k, 0.0015 * k, 0.0006 * k
        scene = world.copy()
        x = 640 + 3 * k
        put(scene, x, 350, 26, 9, 70.0)
        image = view(scene, pan, tilt, rng)
        noise = rng.normal(0.0, 1.0 / FOCAL_PX, 2)
        found = finder.find(image, t_s, camera_from_runway(pan + noise[0], tilt + noise[1]) if known else None)
        # pan is positive to the left and tilt upwards: the scene moves right and down in the picture
        u = x + 13 - (700.0 - 319.5) + FOCAL_PX * np.tan(pan)
        v = 350 + 4.5 - (330.0 - 239.5) + FOCAL_PX * np.tan(tilt)
        if t_s >= 1.0:
            right = [i for i in hits(found, u, v, 13.0) if found[i].moving]
            ranks.append(right[0] if right else 99)
            rates += [found[i].motion_px_s for i in right[:1] if found[i].motion_px_s is not None]
    assert np.mean(np.array(ranks) < 3) >= 0.9
    assert rates
    np.testing.assert_allclose(np.median(np.array(rates), axis=0), [30.0, 0.0], atol=4.0)


def test_static_marks_on_the_ground_do_not_move_and_score_low(rng: np.random.Generator) -> None:
    world = landscape(rng)
    finder = CandidateFinder(AcquisitionConfig(), SIZE, lens())
    for k in range(15):
        pan, tilt = 0.002 * k, -0.001 * k
        noise = rng.normal(0.0, 1.0 / FOCAL_PX, 2)
        image = view(world, pan, tilt, rng)
        found = finder.find(image, 0.1 * k, camera_from_runway(pan + noise[0], tilt + noise[1]))
        assert not any(c.moving for c in found)
        assert all(c.score < 6.0 for c in found)


def test_a_reset_forgets_the_scene(rng: np.random.Generator) -> None:
    world = landscape(rng)
    finder = CandidateFinder(AcquisitionConfig(), SIZE, lens())
    finder.find(view(world, 0.0, 0.0, rng), 0.0, camera_from_runway(0.0, 0.0))
    finder.reset()
    put(world, 640, 350, 26, 9, 70.0)
    assert not any(c.moving for c in finder.find(view(world, 0.0, 0.0, rng), 0.1, camera_from_runway(0.0, 0.0)))


def test_a_stamp_that_goes_back_starts_afresh(rng: np.random.Generator) -> None:
    world = landscape(rng)
    finder = CandidateFinder(AcquisitionConfig(), SIZE, lens())
    finder.find(view(world, 0.0, 0.0, rng), 5.0, camera_from_runway(0.0, 0.0))
    put(world, 640, 350, 26, 9, 70.0)
    assert not any(c.moving for c in finder.find(view(world, 0.0, 0.0, rng), 4.0, camera_from_runway(0.0, 0.0)))


@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([(64, 48), (333, 251), (640, 512), (900, 700)]),
    most=st.integers(1, 12),
)
def test_candidates_are_sorted_bounded_and_inside_the_image(seed: int, size: tuple[int, int], most: int) -> None:
    rng = np.random.default_rng(seed)
    finder = CandidateFinder(AcquisitionConfig(max_candidates=most), size)
    small = rng.integers(0, 256, (size[1] // 8, size[0] // 8, 3)).astype(np.uint8)
    image = np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    for k in range(3):
        found = finder.find(np.roll(image, 5 * k, axis=1), 0.1 * k)
        assert len(found) <= most
        assert [c.score for c in found] == sorted((c.score for c in found), reverse=True)
        for c in found:
            x, y, (w, h) = c.box.x0, c.box.y0, c.box.size
            assert 0 <= x <= x + w <= size[0]
            assert 0 <= y <= y + h <= size[1]
            assert w > 0
            assert h > 0
            assert 0 <= c.u_px <= size[0] - 1
            assert 0 <= c.v_px <= size[1] - 1


def test_the_same_frames_give_the_same_candidates(rng: np.random.Generator) -> None:
    world = landscape(rng)
    frames = [view(world, 0.001 * k, 0.0, rng) for k in range(4)]
    runs = []
    for _ in range(2):
        finder = CandidateFinder(AcquisitionConfig(), SIZE)
        runs.append([finder.find(f, 0.1 * k) for k, f in enumerate(frames)])
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    "values",
    [{"working_width_px": 10}, {"low_sigma": 5.0}, {"memory_s": 0.0}, {"max_size": 0.0}, {"ground_weight": 2.0}],
)
def test_a_tuning_outside_its_bounds_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(values)).split("_")[0]):
        AcquisitionConfig(**values)  # type: ignore[arg-type]
