"""Both detectors of one camera: what either loses the other keeps, and what rests is no aircraft."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import ImageArray
from groundstation.box import Box, shift
from groundstation.detection.candidate_finder import Candidate
from groundstation.detection.pixel_track import PixelTrack
from groundstation.detection.target_confirmation import ConfirmedTarget
from groundstation.messages import Detection, Miss, MissReason, TrackStatus
from groundstation.registration.picture_shift import small_copy
from groundstation.single_camera.channel_target import ChannelTarget
from groundstation.single_camera.channel_view import ChannelView, Look
from groundstation.single_camera.learned_tracker import LearnedPixelTracker
from groundstation.single_camera.pixel_tracker import PixelTracker
from groundstation.single_camera.recognised_search import RecognisedSearch
from groundstation.single_camera.rest_check import RestCheck
from tests.detection.flying import RATE_HZ, SIZE, Film, panorama
from tests.detection.test_birds import PASSING, with_bird
from tests.single_camera.test_target_review import CUT, H, W, scene
from tests.single_camera.test_target_review import RATE_HZ as SCENE_RATE_HZ

_NOTHING = PixelTrack(
    t_s=0.0, status=TrackStatus.LOST, result=Miss(reason=MissReason.NO_REGION), roi=None, predicted_px=None
)


@pytest.fixture
def film(rng: np.random.Generator) -> Film:
    return Film(scene=panorama(rng), rng=rng)


def step(tracker: LearnedPixelTracker | PixelTracker, film: Film, k: int) -> PixelTrack:
    return tracker.step(film.frame(k), k / RATE_HZ) if k else tracker.start(film.frame(0), 0.0, film.box(0))


def off_px(film: Film, k: int, track: PixelTrack) -> float:
    """Return the distance of the target point from the aircraft's middle; infinity without one."""
    if not isinstance(track.result, Detection):
        return np.inf
    return float(np.hypot(*(np.array([track.result.u_px, track.result.v_px]) - film.place(k))))


def test_a_white_aircraft_before_a_white_sky(film: Film) -> None:
    """Expected: eight levels lighter than the sky, in noise of two, it is followed, and nothing else."""
    film.level, film.noise = 8.0, 2.0
    tracker = LearnedPixelTracker(SIZE)
    tracks = [step(tracker, film, k) for k in range(30)]
    off = [off_px(film, k, t) for k, t in enumerate(tracks) if isinstance(t.result, Detection)]
    assert len(off) >= 28
    assert max(off) < 0.6 * film.span_px


def test_the_channel_keeps_what_the_classic_detector_loses(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the classic tracker has no target from frame 20 on, and no search finds one; the point stays."""
    film.speed_px = (2.5, 0.4)
    tracker = LearnedPixelTracker(SIZE)
    for k in range(20):
        step(tracker, film, k)
    monkeypatch.setattr(PixelTracker, "step_prepared", lambda *_: _NOTHING)
    monkeypatch.setattr(PixelTracker, "take", lambda *_: None)
    tracks = [step(tracker, film, k) for k in range(20, 40)]
    assert all(t.status is TrackStatus.TRACKING for t in tracks)
    assert max(off_px(film, k, t) for k, t in enumerate(tracks, 20)) < 0.4 * film.span_px


def test_what_the_channel_does_not_know_is_the_classic_tracker_s(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: where no window shows an aircraft, the track is the classic one's, to the last digit."""
    unseen = Miss(reason=MissReason.LOW_CONTRAST)
    monkeypatch.setattr(ChannelView, "look", lambda *_: (None, unseen))
    monkeypatch.setattr(ChannelView, "likeliest_in", lambda *_: None)
    points = []
    for tracker in (LearnedPixelTracker(SIZE), PixelTracker(SIZE)):
        rng = np.random.default_rng(3)
        film = Film(scene=panorama(rng), rng=rng, span_px=7.0)
        tracks = [step(tracker, film, k) for k in range(20)]
        points.append([(t.status, t.result.u_px) if isinstance(t.result, Detection) else (t.status,) for t in tracks])
    assert points[0] == points[1]
    assert sum(len(p) == 2 for p in points[0]) >= 19


def test_a_sign_at_the_border_after_a_cut(rng: np.random.Generator) -> None:
    """Expected: within 2.2 s of the cut the aircraft, and never the sign again."""
    tracker, held = LearnedPixelTracker((W, H)), []
    for k, (picture, place) in enumerate(scene(rng)):
        track = tracker.step(picture, k / SCENE_RATE_HZ)
        point = track.result.centroid_px if isinstance(track.result, Detection) else None
        held.append("" if point is None else "aircraft" if np.hypot(*(point - place)) < 60.0 else "sign")
    assert held[CUT - 10 : CUT].count("aircraft") >= 8
    after = held[CUT + round(2.2 * SCENE_RATE_HZ) :]
    assert after.count("aircraft") >= 0.95 * len(after)
    assert "sign" not in after


def test_a_bird_in_front(film: Film) -> None:
    """Expected: from half a second after a dark bird of the same size has passed, the aircraft again, to the end."""
    film.level, film.speed_px = 45.0, (1.0, 0.2)
    tracker, off = LearnedPixelTracker(SIZE), []
    for k in range(60):
        u, v = film.place(k)
        away = 6.0 * (k - PASSING)
        image, _ = with_bird(film.frame(k), (u + away, v + 0.3 * away + 4.0), film.span_px, k)
        track = tracker.step(image, k / RATE_HZ) if k else tracker.start(image, 0.0, film.box(0))
        off.append(off_px(film, k, track))
    clear = PASSING + round(film.span_px / 6.0) + round(0.5 * RATE_HZ)
    assert max(off[clear:]) < 0.6 * film.span_px


@pytest.mark.parametrize("corner", [(300.0, 20.0), (300.0, 250.0)])
def test_a_start_on_an_empty_place_is_not_confirmed(film: Film, corner: tuple[float, float]) -> None:
    """Sky, hills: never a point, whatever the box."""
    film.hidden, film.corner = range(1000), corner
    for box in (Box(60.0, 60.0, 100.0, 80.0), Box(200.0, 150.0, 290.0, 210.0)):
        tracker = LearnedPixelTracker(SIZE)
        tracks = [tracker.start(film.frame(0), 0.0, box)]
        tracks += [tracker.step(film.frame(k), k / RATE_HZ) for k in range(1, 12)]
        assert all(isinstance(t.result, Miss) for t in tracks)
        assert not tracker.start_confirmed


class _Sequence:
    """A tracker whose channel finds one thing by searching, and sees it in frames that are not in ``unseen``."""

    def __init__(self, film: Film, monkeypatch: pytest.MonkeyPatch, unseen: range = range(0)) -> None:
        self.film, self.k, self.unseen, self.handed_over = film, 0, unseen, 0
        monkeypatch.setattr(PixelTracker, "step_prepared", lambda *_: _NOTHING)
        monkeypatch.setattr(PixelTracker, "reviewed", lambda _, track, *__: track)
        monkeypatch.setattr(PixelTracker, "take", self._hand_over)
        monkeypatch.setattr(RecognisedSearch, "update", self._find)
        monkeypatch.setattr(ChannelView, "look", self._look)
        self.tracker = LearnedPixelTracker(SIZE)

    def tracks(self, frames: range) -> list[PixelTrack]:
        found = []
        for self.k in frames:
            found.append(self.tracker.step(self.film.frame(self.k), self.k / RATE_HZ))
        return found

    def _hand_over(self, *_: object) -> None:
        self.handed_over += 1

    def _find(self, *_: object) -> ConfirmedTarget:
        (u, v), box = self.film.place(self.k), self.film.box(self.k)
        candidate = Candidate(u_px=u, v_px=v, box=box, score=9.0, moving=False, motion_px_s=None)
        return ConfirmedTarget(candidate=candidate, velocity_px_s=(0.0, 0.0))

    def _look(self, *_: object) -> tuple[None, Detection | Miss]:
        if self.k in self.unseen:
            return None, Miss(reason=MissReason.LOW_CONTRAST)
        (u, v), box = self.film.place(self.k), self.film.box(self.k)
        return None, Detection(
            u_px=u,
            v_px=v,
            covariance_px2=np.eye(2),
            noise_px2=np.eye(2),
            centroid_px=np.array([u, v]),
            box=box,
            area_px=50.0,
            contour_px=np.empty((0, 2), np.float32),
            contrast_to_noise=6.0,
            channel="learned",
            log_odds=6.0,
        )


def on_hills(film: Film, speed_px: float) -> Film:
    film.corner, film.start, film.pan_px, film.speed_px = (300.0, 250.0), (420.0, 480.0), (1.5, 0.0), (speed_px, 0.0)
    return film


def test_what_rests_is_neither_reported_nor_handed_over(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: found by searching and at rest on the hills, no point, and no start of the classic detector."""
    sequence = _Sequence(on_hills(film, 0.0), monkeypatch)
    tracks = sequence.tracks(range(75))
    assert {t.status for t in tracks} <= {TrackStatus.ACQUIRING, TrackStatus.LOST}
    assert not any(isinstance(t.result, Detection) for t in tracks)
    assert sequence.handed_over == 0


def test_what_moves_is_reported_once_that_is_known(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: acquiring while its motion is unknown, seen or not; then tracking, given to the classic detector."""
    sequence = _Sequence(on_hills(film, 4.0), monkeypatch, unseen=range(36, 39))
    tracks = sequence.tracks(range(75))
    status = [t.status for t in tracks]
    reported = status.index(TrackStatus.TRACKING)
    assert set(status[31:reported]) == {TrackStatus.ACQUIRING}
    assert 40 <= reported <= 50
    assert set(status[reported:]) == {TrackStatus.TRACKING}
    assert not any(isinstance(t.result, Detection) for t in tracks[:reported])
    assert sequence.handed_over >= 2


@pytest.mark.parametrize("given", [True, False])
def test_a_given_target_may_rest(film: Film, monkeypatch: pytest.MonkeyPatch, given: bool) -> None:
    """Expected: at rest on the sky's edge and lost by the classic detector, it is kept if it was given, not else."""
    film.speed_px, film.pan_px, film.corner = (0.0, 0.0), (1.0, 0.0), (300.0, 220.0)
    tracker = LearnedPixelTracker(SIZE)
    for k in range(40):
        step(tracker, film, k) if given else tracker.step(film.frame(k), k / RATE_HZ)
    monkeypatch.setattr(PixelTracker, "step_prepared", lambda *_: _NOTHING)
    monkeypatch.setattr(PixelTracker, "take", lambda *_: None)
    tracks = [step(tracker, film, k) for k in range(40, 70)]
    assert all(t.status is TrackStatus.TRACKING for t in tracks[16:]) == given
    assert any(isinstance(t.result, Detection) for t in tracks) == given


def test_a_blurred_picture_does_not_make_things_move(film: Film) -> None:
    """Expected: no new answer where the background cannot be measured and could before."""
    film.hidden, film.corner, film.pan_px = range(1000), (300.0, 250.0), (1.5, 0.0)
    check = RestCheck()
    for k in range(0, 40, 2):
        picture = film.frame(k)
        picture = picture if k < 20 else np.full_like(picture, 128)
        check.update(small_copy(picture), shift(Box(220.0, 180.0, 250.0, 190.0), -1.5 * k, 0.0), k / RATE_HZ)
    assert check.rests is True


def test_two_things_in_one_place_are_left_to_the_classic_tracker(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: half a second without a choice is no loss, and what the channel sees then is not taken; later it is."""
    film.speed_px = (2.5, 0.4)
    tracker = LearnedPixelTracker(SIZE)
    for k in range(30):
        step(tracker, film, k)
    choice = replace(_NOTHING, status=TrackStatus.COASTING, result=Miss(reason=MissReason.AMBIGUOUS))
    monkeypatch.setattr(PixelTracker, "step_prepared", lambda *_: choice)
    monkeypatch.setattr(PixelTracker, "take", lambda *_: None)
    tracks = [step(tracker, film, k) for k in range(30, 60)]
    taken = [t.status is TrackStatus.TRACKING for t in tracks]
    assert not any(taken[:15])
    assert all(taken[16:])


def test_a_bird_s_odds_alone_do_not_take_the_target(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: what the classic detector sees move stays the target, however likely an aircraft is elsewhere."""
    film.speed_px = (2.5, 0.4)
    tracker = LearnedPixelTracker(SIZE)
    for k in range(30):
        step(tracker, film, k)
    look, known = ChannelView.look, ChannelView.odds_at

    def elsewhere(view: ChannelView, target: ChannelTarget, image: ImageArray) -> Look:
        roi, seen = look(view, target, image)
        assert isinstance(seen, Detection)
        return roi, replace(seen, box=shift(seen.box, 80.0, 0.0), centroid_px=seen.centroid_px + (80.0, 0.0))

    monkeypatch.setattr(ChannelView, "look", elsewhere)
    monkeypatch.setattr(ChannelView, "odds_at", lambda *a: known(*a) - 6.0)
    assert max(off_px(film, k, step(tracker, film, k)) for k in range(30, 60)) < 0.4 * film.span_px


def test_the_background_is_that_of_the_box_s_frame(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a camera that turns back and forth, by more than a box at a time, does not make what rests move."""
    film = on_hills(film, 0.0)
    film.pan_px, film.jumps = (0.0, 0.0), {k: (30.0 * (-1.0) ** (k // 6), 0.0) for k in range(6, 200, 6)}
    sequence = _Sequence(film, monkeypatch)
    assert not any(isinstance(t.result, Detection) for t in sequence.tracks(range(90)))
    assert sequence.handed_over == 0


@pytest.mark.parametrize(("pan_px", "speed_px", "rests"), [(0.0, 0.0, True), (1.5, 1.5, False), (1.5, 0.0, True)])
def test_what_moves_with_the_background_rests(film: Film, pan_px: float, speed_px: float, rests: bool) -> None:
    """Expected: a camera that pans over the hills sees things on them rest, and what it follows move."""
    film.hidden, film.corner, film.pan_px = range(1000), (300.0, 250.0), (pan_px, 0.0)
    check = RestCheck()
    for k in range(0, 13, 2):
        assert check.rests is None
        box = shift(Box(220.0, 180.0, 250.0, 190.0), (speed_px - pan_px) * k, 0.0)
        check.update(small_copy(film.frame(k)), box, k / RATE_HZ)
    assert check.rests is rests
