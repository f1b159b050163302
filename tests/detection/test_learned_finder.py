"""Candidates of a whole frame with the learned channel: an aircraft comes before what else stands out."""

import numpy as np

from groundstation.detection.candidate_finder import AcquisitionConfig, CandidateFinder
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.learned_finder import LearnedFinder
from tests.detection.test_learned_detector import SIZE_PX, drawn, picture

LEARNED = DetectionConfig(detector=DetectorKind.LEARNED)
# upper left of a dark disc, px, and its diameter
BALL_PX, BALL_SIZE_PX = (430, 120), 36


def test_an_aircraft_comes_before_what_stands_out_more(rng: np.random.Generator) -> None:
    image, nose = picture(drawn(13), (200, 200), 40.0, rng)
    x0, y0 = BALL_PX
    rows, columns = np.mgrid[0:BALL_SIZE_PX, 0:BALL_SIZE_PX] - 0.5 * (BALL_SIZE_PX - 1)
    image[y0 : y0 + BALL_SIZE_PX, x0 : x0 + BALL_SIZE_PX][np.hypot(rows, columns) < 0.5 * BALL_SIZE_PX] = 10
    classic = CandidateFinder(AcquisitionConfig(), SIZE_PX).find(image, 0.0)
    assert classic[0].u_px > x0
    found = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX).find(image, 0.0)
    assert len(found) == len(classic)
    best, other = found[0], next(c for c in found if c.u_px > x0)
    assert np.hypot(best.u_px - nose[0], best.v_px - nose[1]) < 3.0
    assert 0.7 * 40.0 < best.box.w < 1.3 * 40.0
    assert other.score < 0.3 * best.score
    # what the network does not know can still start a track
    assert other.score > 0.0


def test_a_box_at_the_border_stays_inside(rng: np.random.Generator) -> None:
    image, _ = picture(drawn(13), (0, 0), 60.0, rng)
    finder = LearnedFinder(AcquisitionConfig(), LEARNED, SIZE_PX)
    for t_s in (0.0, 0.3):
        candidates = finder.find(image, t_s)
        assert candidates or t_s > 0.0
        for found in candidates:
            assert 0.0 <= found.box.x0 < found.box.x1 <= SIZE_PX[0]
            assert 0.0 <= found.box.y0 < found.box.y1 <= SIZE_PX[1]
    finder.reset()


def test_a_copy_beyond_the_border_is_no_candidate(rng: np.random.Generator) -> None:
    """Wings that the border cuts go on in the window, where it repeats the picture's last column."""
    image, _ = picture(drawn(13), (280, 200), 90.0, rng)
    for left in (300, 320, 340, 355):
        part = np.ascontiguousarray(image[:, left:])
        size = part.shape[1], part.shape[0]
        for found in LearnedFinder(AcquisitionConfig(), LEARNED, size).find(part, 0.0):
            assert 0.0 <= found.box.x0 < found.box.x1 <= size[0]
            assert 0.0 <= found.u_px <= size[0] - 1.0
