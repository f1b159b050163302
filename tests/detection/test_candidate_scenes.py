"""The whole-frame search on painted scenes: what must be found, what must not, and what always holds."""

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_z

SIZE = (640, 480)
LENS = Lens(
    image_size_px=SIZE, focal_px=np.array([2600.0, 2600.0]), principal_point_px=np.array([319.5, 239.5]),
    distortion=np.zeros(5),
)  # fmt: skip
INTRINSICS = np.array([[2600.0, 0.0, 319.5], [0.0, 2600.0, 239.5], [0.0, 0.0, 1.0]])
# optical axis along runway +y: x right, y down, z forward
LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
NOISE = 1.5


def finder(size: tuple[int, int] = SIZE, lens: Lens | None = LENS) -> CandidateFinder:
    return CandidateFinder(AcquisitionConfig(), size, lens)


def noisy(image: FloatArray, rng: np.random.Generator) -> ImageArray:
    """Blur as a lens does, add noise, and quantise; grey becomes three equal channels."""
    seen = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0.0, NOISE, image.shape)
    return np.repeat(np.clip(np.round(seen), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def sky(size: tuple[int, int] = SIZE) -> FloatArray:
    """Brighter towards the ground, and a little to one side."""
    x, y = np.meshgrid(np.linspace(0, 1, size[0]), np.linspace(0, 1, size[1]))
    return 150.0 + 60.0 * y + 15.0 * x


def with_aircraft(image: FloatArray, centre: tuple[float, float], span_px: float, contrast: float) -> FloatArray:
    """Paint a wing, a body and a tail, seen from ahead."""
    u, v = centre
    shape = np.zeros_like(image)
    shift = 4

    def bar(x0: float, y0: float, x1: float, y1: float) -> None:
        a = (round((u + x0 * span_px) * 2**shift), round((v + y0 * span_px) * 2**shift))
        b = (round((u + x1 * span_px) * 2**shift), round((v + y1 * span_px) * 2**shift))
        cv2.rectangle(shape, a, b, 1.0, cv2.FILLED, cv2.LINE_AA, shift)

    bar(-0.5, -0.05, 0.5, 0.03)
    bar(-0.07, -0.1, 0.07, 0.12)
    bar(-0.18, -0.18, 0.18, -0.14)
    return image + contrast * shape


def panorama(rng: np.random.Generator) -> FloatArray:
    """A wide strip of ground with texture of several sizes, and bright paint on it."""
    h, w = 900, 1400
    ground = 100.0 + sum(cv2.GaussianBlur(rng.normal(0.0, 12.0 * s, (h, w)), (0, 0), float(s)) for s in (2, 4, 8))
    for x in range(100, w, 170):
        cv2.rectangle(ground, (x, 430), (x + 40, 440), 190.0, cv2.FILLED)
    return np.asarray(ground, np.float64)


def turned(pan_deg: float) -> FloatArray:
    """Return camera_from_runway after a turn to the left."""
    return LEVEL @ rotation_z(math.radians(pan_deg)).T


def view(scene: FloatArray, camera_from_runway: FloatArray) -> FloatArray:
    """Render the strip, which is infinitely far away and centred on the runway's direction."""
    h, w = scene.shape
    strip = np.array([[2600.0, 0.0, w / 2], [0.0, 2600.0, h / 2], [0.0, 0.0, 1.0]])
    strip_from_pixel = strip @ LEVEL @ camera_from_runway.T @ np.linalg.inv(INTRINSICS)
    return cv2.warpPerspective(scene, strip_from_pixel, SIZE, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def hits(found: tuple[Candidate, ...], centre: tuple[float, float], reach_px: float) -> list[int]:
    return [i for i, c in enumerate(found) if math.hypot(c.u_px - centre[0], c.v_px - centre[1]) <= reach_px]


@pytest.mark.parametrize("span_px", [5.0, 12.0, 30.0, 80.0, 160.0, 320.0])
@pytest.mark.parametrize("contrast", [-45.0, 40.0])
def test_finds_an_aircraft_in_the_sky_at_once(span_px: float, contrast: float, rng: np.random.Generator) -> None:
    """One frame is enough, from 5 px to half the frame, dark or bright; the box covers the wings."""
    centre = (270.0, 200.0)
    found = finder().find(noisy(with_aircraft(sky(), centre, span_px, contrast), rng), 0.0, None)
    right = hits(found, centre, max(0.25 * span_px, 3.0))
    assert right
    assert right[0] == 0
    assert span_px / 2.0 <= found[right[0]].box.w <= 2.0 * span_px + 6.0


def test_a_wide_image_is_searched_reduced_and_results_are_in_its_own_pixels(rng: np.random.Generator) -> None:
    """In 1280 x 960 a target of 30 px has its centre within 2 px."""
    centre = (901.0, 333.0)
    lens = Lens(
        image_size_px=(1280, 960),
        focal_px=np.array([6684.3, 6680.9]),
        principal_point_px=np.array([646.8, 471.4]),
        distortion=np.zeros(5),
    )
    image = noisy(with_aircraft(sky((1280, 960)), centre, 30.0, -40.0), rng)
    found = finder((1280, 960), lens).find(image, 0.0, None)
    assert hits(found, centre, 2.0)[:1] == [0]


def test_an_empty_sky_has_no_candidate_with_a_targets_score(rng: np.random.Generator) -> None:
    """Over several frames the best of nothing stays below half of a faint target's score."""
    empty = [c.score for i in range(8) for c in finder().find(noisy(sky(), rng), 0.1 * i, None)]
    target = finder().find(noisy(with_aircraft(sky(), (300.0, 220.0), 30.0, -20.0), rng), 0.0, None)
    assert max(empty, default=0.0) < 0.5 * target[0].score


def test_finds_a_mover_on_textured_ground_from_a_turning_camera(rng: np.random.Generator) -> None:
    """Among texture and paint of its own contrast, only motion against the turning scene identifies the target."""
    scene, search = panorama(rng), finder()
    good = 0
    for i in range(16):
        rotation = turned(0.2 * math.sin(0.5 * i))
        centre = (220.0 + 9.0 * i, 250.0 + 2.0 * i)
        image = noisy(with_aircraft(view(scene, rotation), centre, 60.0, 60.0), rng)
        # angles are read with 0.01 deg of noise
        read = turned(0.2 * math.sin(0.5 * i) + rng.normal(0.0, 0.01))
        found = search.find(image, 0.1 * i, read)
        right = hits(found, centre, 15.0)
        good += bool(i >= 6 and right and right[0] < 3 and found[right[0]].moving)
    assert good >= 9


def test_finds_a_mover_without_angles(rng: np.random.Generator) -> None:
    """The camera's turn is then read from the pictures; of what moves the target is best.

    Without a horizon, smooth ground may pass for sky, so paint on it may score as well as the target.
    """
    scene, search = panorama(rng), finder(lens=None)
    good = 0
    for i in range(16):
        centre = (220.0 + 9.0 * i, 250.0 + 2.0 * i)
        image = noisy(with_aircraft(view(scene, turned(0.02 * i)), centre, 60.0, 60.0), rng)
        found = search.find(image, 0.1 * i, None)
        moving = tuple(c for c in found if c.moving)
        good += i >= 6 and hits(moving, centre, 15.0)[:1] == [0]
    assert good >= 9


def test_a_static_scene_does_not_move_when_the_camera_turns(rng: np.random.Generator) -> None:
    """Ground and paint seen from a turning camera with noisy angles: hardly anything is called moving."""
    scene, search = panorama(rng), finder()
    moving = []
    for i in range(14):
        pan_deg = 0.25 * math.sin(0.6 * i)
        read = turned(pan_deg + rng.normal(0.0, 0.01))
        moving.append(sum(c.moving for c in search.find(noisy(view(scene, turned(pan_deg)), rng), 0.1 * i, read)))
    assert np.mean(moving) < 0.5


def test_reset_forgets_the_earlier_frames(rng: np.random.Generator) -> None:
    """The first frame after a reset has nothing to be compared with, so nothing moves."""
    scene, search = panorama(rng), finder()
    for i in range(8):
        search.find(
            noisy(with_aircraft(view(scene, LEVEL), (200.0 + 20.0 * i, 250.0), 60.0, 60.0), rng), 0.1 * i, LEVEL
        )
    search.reset()
    found = search.find(noisy(with_aircraft(view(scene, LEVEL), (400.0, 250.0), 60.0, 60.0), rng), 0.8, LEVEL)
    assert not any(c.moving for c in found)


@pytest.mark.parametrize("size", [(640, 480), (321, 243), (1280, 960), (64, 48)])
def test_candidates_are_sorted_bounded_and_inside_the_image(size: tuple[int, int], rng: np.random.Generator) -> None:
    """On rough pictures of any size, several frames long."""
    search = finder(size, None)
    rough = cv2.GaussianBlur(rng.normal(0.0, 1.0, (size[1], size[0])), (0, 0), 3.0)
    for i in range(4):
        base = 128.0 + 200.0 * np.roll(rough, 3 * i, axis=1)
        found = search.find(noisy(base, rng), 0.2 * i, None)
        assert len(found) <= AcquisitionConfig().max_candidates
        assert [c.score for c in found] == sorted((c.score for c in found), reverse=True)
        for c in found:
            x, y, (w, h) = c.box.x0, c.box.y0, c.box.size
            assert w > 0
            assert h > 0
            assert x >= 0
            assert y >= 0
            assert x + w <= size[0]
            assert y + h <= size[1]
            assert x - 1.0 <= c.u_px <= x + w
            assert y - 1.0 <= c.v_px <= y + h
            assert c.score > 0
            assert math.isfinite(c.score)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_flat_picture_has_no_candidates(level: int) -> None:
    """Black, grey and white; a closed shutter is no target."""
    search = finder(lens=None)
    image = np.full((480, 640, 3), level, np.uint8)
    assert [search.find(image, 0.2 * i, None) for i in range(3)] == [(), (), ()]


def test_the_same_frames_give_the_same_candidates(rng: np.random.Generator) -> None:
    """Two finders with equal input have equal output."""
    scene = panorama(rng)
    frames = [noisy(with_aircraft(view(scene, LEVEL), (200.0 + 9.0 * i, 250.0), 60.0, 60.0), rng) for i in range(5)]
    first, second = finder(), finder()
    for i, image in enumerate(frames):
        assert first.find(image, 0.2 * i, LEVEL) == second.find(image, 0.2 * i, LEVEL)


def test_a_picture_is_left_as_it_was(rng: np.random.Generator) -> None:
    """The frame belongs to others too."""
    image = noisy(with_aircraft(sky(), (300.0, 200.0), 40.0, -40.0), rng)
    before = image.copy()
    finder().find(image, 0.0, LEVEL)
    assert np.array_equal(image, before)


def test_finds_the_aircraft_of_a_recorded_approach(landing_1: Path) -> None:
    """A pale aircraft of 30 px, 518 m away: among the best three in at least 90 % of the first 20 frames."""
    with (landing_1 / "truth.csv").open() as file:
        truth = [(float(r["left_u_px"]), float(r["left_v_px"])) for r in csv.DictReader(file)][:20]
    video = cv2.VideoCapture(str(landing_1 / "left.mp4"))
    search = finder((1280, 960), None)
    good = 0
    for i, centre in enumerate(truth):
        read, image = video.read()
        assert read
        right = hits(search.find(np.asarray(image, np.uint8), 0.1 * i, None), centre, 10.0)
        good += bool(right and right[0] < 3)
    assert good >= 18
