"""One camera in pixels: found, tracked, lost, found again; and never a target where there is none."""

import cv2
import numpy as np
import pytest

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.detection.image_conditioning import ImageConditioner, noise_of
from groundstation.detection.pixel_track import PixelTrack
from groundstation.messages import Detection, Miss, MissReason, TrackStatus
from groundstation.registration.picture_shift import is_cut, picture_shift, small_copy
from groundstation.single_camera.pixel_motion import PixelMotion
from groundstation.single_camera.pixel_tracker import PixelTracker
from tests.detection.flying import RATE_HZ, SIZE, Film, panorama

NOWHERE = Box(0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def film(rng: np.random.Generator) -> Film:
    return Film(scene=panorama(rng), rng=rng)


def watch(film: Film, frames: int, *, started: bool = False) -> list[PixelTrack]:
    tracker = PixelTracker(SIZE)
    tracks = []
    for k in range(frames):
        image = film.frame(k)
        if started and k == 0:
            tracks.append(tracker.start(image, 0.0, film.box(0)))
        else:
            tracks.append(tracker.step(image, k / RATE_HZ))
    return tracks


def off_px(film: Film, k: int, track: PixelTrack) -> float:
    """Return the distance of the target point from the aircraft's middle; infinity without one."""
    if not isinstance(track.result, Detection):
        return np.inf
    return float(np.hypot(*(np.array([track.result.u_px, track.result.v_px]) - film.place(k))))


def hits(film: Film, tracks: list[PixelTrack], first: int = 0) -> list[bool]:
    reach = 0.6 * film.span_px
    return [off_px(film, k, t) < reach for k, t in enumerate(tracks) if k >= first]


def wrong(film: Film, tracks: list[PixelTrack]) -> list[int]:
    return [
        k
        for k, t in enumerate(tracks)
        if isinstance(t.result, Detection) and off_px(film, k, t) > max(film.span_px, 10.0)
    ]


# ---------------------------------------------------------------------------------------------- following
@pytest.mark.parametrize("level", [-70.0, 45.0])
@pytest.mark.parametrize("span_px", [7.0, 26.0, 90.0])
def test_follows_the_object_in_the_box(film: Film, span_px: float, level: float) -> None:
    """Dark or bright, 7 to 90 px, before the sky: seen in every frame."""
    film.span_px, film.level = span_px, level
    tracks = watch(film, 25, started=True)
    assert all(hits(film, tracks))
    assert {t.status for t in tracks} == {TrackStatus.TRACKING}


def test_the_box_covers_the_silhouette(film: Film) -> None:
    """Expected: as wide as the wings to a few px, and the target point in it."""
    for track in watch(film, 15, started=True)[5:]:
        assert isinstance(track.result, Detection)
        x, y, (w, h) = track.result.box.x0, track.result.box.y0, track.result.box.size
        assert w == pytest.approx(film.span_px, abs=6.0)
        assert x <= track.result.u_px <= x + w
        assert y <= track.result.v_px <= y + h
        assert track.roi is not None
        assert track.roi.x0 <= x
        assert x + w <= track.roi.x1


def test_a_shaking_camera(film: Film) -> None:
    """Steps of up to 12 px that no model foresees."""
    film.jumps = {k: tuple(film.rng.uniform(-12, 12, 2)) for k in range(3, 30)}
    tracks = watch(film, 30, started=True)
    assert sum(hits(film, tracks)) >= 29
    assert not wrong(film, tracks)


@pytest.mark.parametrize("jump", [(70.0, 0.0), (-45.0, 30.0)])
def test_a_camera_that_is_knocked(film: Film, jump: tuple[float, float]) -> None:
    """Expected: seen in the very frame after the jump, at its new place."""
    film.jumps = {12: jump}
    tracks = watch(film, 16, started=True)
    assert all(hits(film, tracks, 12))


def test_a_pan_along_the_hills(film: Film) -> None:
    """The aircraft flies low over textured ground and the camera goes with it."""
    film.pan_px, film.speed_px, film.start, film.level = (6.0, 0.0), (7.0, 0.5), (420.0, 380.0), 90.0
    tracks = watch(film, 40, started=True)
    assert sum(hits(film, tracks)) >= 39
    assert not wrong(film, tracks)


def test_hidden_and_seen_again(film: Film) -> None:
    """Expected: coasting without a point while it is hidden, tracking again within ten frames after."""
    film.hidden = range(20, 35)
    tracks = watch(film, 50, started=True)
    assert all(isinstance(t.result, Miss) for t in tracks[20:35])
    assert {t.status for t in tracks[20:35]} == {TrackStatus.COASTING}
    assert all(hits(film, tracks, 45))
    assert not wrong(film, tracks)


def test_gone_for_good(film: Film) -> None:
    """Expected: coasting, after three seconds lost, then searching; never a point of anything else."""
    film.hidden = range(15, 1000)
    words = [t.status for t in watch(film, 125, started=True)]
    assert words[:15] == [TrackStatus.TRACKING] * 15
    end = words.index(TrackStatus.LOST)
    assert set(words[15:end]) == {TrackStatus.COASTING}
    assert end == pytest.approx(15 + 3.0 * RATE_HZ, abs=2)
    assert set(words[end + 1 :]) <= {TrackStatus.SEARCHING, TrackStatus.ACQUIRING}


def test_a_cut_to_another_aircraft(film: Film, rng: np.random.Generator) -> None:
    """Expected: within half a second the new one is followed."""
    after = Film(scene=np.asarray(255 - panorama(rng), np.uint8), rng=rng, start=(600.0, 250.0), span_px=40.0)
    tracker = PixelTracker(SIZE)
    tracker.start(film.frame(0), 0.0, film.box(0))
    for k in range(1, 10):
        tracker.step(film.frame(k), k / RATE_HZ)
    tracks = [tracker.step(after.frame(k), (10 + k) / RATE_HZ) for k in range(20)]
    assert all(hits(after, tracks, 15))
    assert not wrong(after, tracks)


def test_a_faint_start_proves_itself(film: Film) -> None:
    """Expected: what hardly shows in the box is acquiring without a point for some frames, then tracking there."""
    film.level, film.noise, film.span_px = -9.0, 3.0, 26.0
    tracks = watch(film, 25, started=True)
    words = [t.status for t in tracks]
    begun = words.index(TrackStatus.TRACKING)
    assert 3 <= begun <= 8
    assert set(words[:begun]) == {TrackStatus.ACQUIRING}
    assert all(isinstance(t.result, Miss) for t in tracks[:begun])
    assert not wrong(film, tracks)


@pytest.mark.parametrize("corner", [(300.0, 20.0), (300.0, 250.0)])
def test_a_start_on_an_empty_place(film: Film, corner: tuple[float, float]) -> None:
    """Sky, hills: never a point, whatever the box."""
    film.hidden, film.corner = range(1000), corner
    for box in (Box(60.0, 60.0, 100.0, 80.0), Box(200.0, 150.0, 290.0, 210.0)):
        tracker = PixelTracker(SIZE)
        tracks = [tracker.start(film.frame(0), 0.0, box)]
        tracks += [tracker.step(film.frame(k), k / RATE_HZ) for k in range(1, 12)]
        assert all(isinstance(t.result, Miss) for t in tracks)
        assert not tracker.start_confirmed


# ---------------------------------------------------------------------------------------------- searching
def test_finds_without_a_start(film: Film) -> None:
    """Expected: searching, acquiring over several frames, then tracking within half a second."""
    tracks = watch(film, 25)
    words = [t.status for t in tracks]
    begun = words.index(TrackStatus.TRACKING)
    assert 3 <= begun <= 15
    assert words[0] is TrackStatus.SEARCHING
    assert TrackStatus.ACQUIRING in words[:begun]
    assert all(t.result == Miss(reason=MissReason.NOT_ACQUIRED) for t in tracks[:begun])
    assert all(hits(film, tracks, begun))


def test_an_empty_sky_gives_no_target(film: Film) -> None:
    film.hidden, film.corner = range(1000), (300.0, 20.0)
    assert all(isinstance(t.result, Miss) for t in watch(film, 30))


def test_what_shows_in_two_frames_is_no_target(film: Film) -> None:
    """A bird through the corner, a glint."""
    film.hidden = range(10, 1000)
    tracker = PixelTracker(SIZE)
    for k in range(30):
        image = film.frame(0 if k in (5, 6) else 20)
        assert isinstance(tracker.step(image, k / RATE_HZ).result, Miss)


def test_reset_forgets_the_target(film: Film) -> None:
    tracker = PixelTracker(SIZE)
    assert tracker.start(film.frame(0), 0.0, film.box(0)).status is TrackStatus.TRACKING
    tracker.reset()
    assert tracker.step(film.frame(1), 1 / RATE_HZ).status is TrackStatus.SEARCHING


def test_the_same_film_gives_the_same_track(film: Film) -> None:
    images = [film.frame(k) for k in range(12)]
    copies = [i.copy() for i in images]
    first, second = (follow(images) for _ in range(2))
    assert first == second
    assert all(np.array_equal(a, b) for a, b in zip(images, copies, strict=True))


def follow(images: list[ImageArray]) -> list[tuple[float, ...]]:
    tracker = PixelTracker(SIZE)
    tracks = [tracker.step(image, k / RATE_HZ) for k, image in enumerate(images)]
    return [t.result.box if isinstance(t.result, Detection) else NOWHERE for t in tracks]


# ---------------------------------------------------------------------------------------- poor pictures
def test_strong_noise(film: Film) -> None:
    """A target of 12 px in noise of 8 grey levels."""
    film.noise, film.span_px = 8.0, 12.0
    tracks = watch(film, 30, started=True)
    assert sum(hits(film, tracks)) >= 29
    assert not wrong(film, tracks)


def test_a_small_picture_gives_results_in_its_own_pixels(film: Film) -> None:
    """240 x 180 px: the target of 6 px is within 1.5 px of its place."""
    film.span_px = 12.0
    tracker = PixelTracker((240, 180))
    for k in range(20):
        image = np.asarray(cv2.resize(film.frame(k), (240, 180), interpolation=cv2.INTER_AREA), np.uint8)
        half = Box(*(0.5 * edge for edge in film.box(k)))
        track = tracker.start(image, 0.0, half) if k == 0 else tracker.step(image, k / RATE_HZ)
        assert isinstance(track.result, Detection)
        assert np.hypot(*(track.result.centroid_px - 0.5 * film.place(k))) < 1.5
        assert track.result.box.w == pytest.approx(6.0, abs=2.5)
        assert track.predicted_px is not None
        assert np.hypot(*(track.predicted_px - 0.5 * film.place(k))) < 8.0


@pytest.mark.parametrize("sigma", [2.0, 8.0])
def test_noise_is_measured(sigma: float, rng: np.random.Generator) -> None:
    picture = np.clip(panorama(rng) + rng.normal(0.0, sigma, (700, 1400, 3)), 0, 255).astype(np.uint8)
    assert noise_of(picture) == pytest.approx(sigma, rel=0.2)


def test_an_ordinary_picture_is_passed_on_unchanged(film: Film) -> None:
    image = film.frame(0)
    assert ImageConditioner(SIZE).prepare(image) is image


# ------------------------------------------------------------------------------------------------- parts
@pytest.mark.parametrize("step", [(0, 0), (8, -4), (-37, 22)])
def test_the_picture_s_own_motion(step: tuple[int, int], film: Film) -> None:
    """Whole steps of the view over the hills are found to 0.5 px; the aircraft does not disturb."""
    film.corner, film.jumps, film.noise = (300.0, 240.0), {1: (-step[0], -step[1])}, 1.0
    shift = picture_shift(small_copy(film.frame(0)), small_copy(film.frame(1)), film.box(0))
    assert shift is not None
    assert shift == pytest.approx(step, abs=0.5)


def test_an_even_sky_gives_no_motion(film: Film) -> None:
    film.corner, film.jumps = (300.0, 20.0), {1: (9.0, 0.0)}
    assert picture_shift(small_copy(film.frame(0)), small_copy(film.frame(1)), film.box(0)) is None


def test_a_pan_is_no_cut(film: Film, rng: np.random.Generator) -> None:
    film.jumps = {1: (60.0, 5.0)}
    first, panned = small_copy(film.frame(0)), small_copy(film.frame(1))
    other = small_copy(np.asarray(255 - film.frame(2), np.uint8))
    assert not is_cut(first, panned)
    assert is_cut(first, other)


def motion() -> PixelMotion:
    return PixelMotion((10.0, 20.0), None, sigma_px=3.0, least_shake_px=2.0, most_shake_px=20.0)


def test_constant_velocity_is_learnt(rng: np.random.Generator) -> None:
    """90 px/s seen with 0.5 px of noise: predicted to 1 px after one second."""
    filter_ = motion()
    for k in range(1, 31):
        filter_.predict(1 / 30)
        filter_.correct(np.array([10.0 + 3.0 * k, 20.0]) + rng.normal(0.0, 0.5, 2), 0.5)
    filter_.predict(1 / 30)
    assert filter_.place() == pytest.approx([103.0, 20.0], abs=1.0)
    assert filter_.sigma_px < 4.0


def test_shake_widens_the_prediction_and_calm_narrows_it(rng: np.random.Generator) -> None:
    filter_ = motion()
    calm = filter_.shake_px
    for _ in range(20):
        filter_.predict(1 / 30)
        filter_.correct(np.array([10.0, 20.0]) + rng.normal(0.0, 12.0, 2), 0.5)
    shaken = filter_.shake_px
    for _ in range(120):
        filter_.predict(1 / 30)
        filter_.correct(np.array([10.0, 20.0]), 0.5)
    assert shaken > 2.0 * calm
    assert filter_.shake_px == pytest.approx(2.0)


def test_the_picture_s_motion_takes_the_place_of_the_velocity() -> None:
    filter_ = PixelMotion((10.0, 20.0), (300.0, 0.0), sigma_px=3.0, least_shake_px=2.0, most_shake_px=20.0)
    filter_.predict(0.1)
    assert filter_.place() == pytest.approx([40.0, 20.0])
    filter_.shift_by(np.array([-7.0, 2.0]))
    assert filter_.place() == pytest.approx([3.0, 22.0])
