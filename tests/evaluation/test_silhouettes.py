"""Pictures of the target in the report: which are kept, how few, and what is drawn over them."""

import base64
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.box import Box
from groundstation.evaluation.silhouette_section import SILHOUETTE_CSS, silhouette_section
from groundstation.evaluation.silhouettes import SHOWN_RANGES, SilhouetteCollector
from groundstation.files.html_page import html_page
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Kinematics,
    StepReport,
    TrackEstimate,
    TrackStatus,
    TriangulationStatus,
)
from groundstation.picture import BgrPicture, PartialPicture, Picture
from groundstation.replay.replay import ReplayRequest, replay
from tests.browser import browser

W, H = 640, 480
PLACES = {"left": np.array([-8.0, 0.0, 0.0]), "right": np.array([8.0, 0.0, 0.0])}
SPAN_PX_M = 4000.0


class CountedPicture(BgrPicture):
    """A picture that counts how often pixels were taken from it."""

    taken = 0

    def _pixels(self, window: Box[int]) -> np.ndarray:
        CountedPicture.taken += 1
        return super()._pixels(window)


def picture(colour: int = 90) -> BgrPicture:
    return CountedPicture(np.full((H, W, 3), colour, np.uint8))


def look(
    station: str, epoch: int, range_m: float, image: Picture | None, status: DetectionStatus = DetectionStatus.OK
) -> CameraReport:
    half = SPAN_PX_M / range_m / 2
    box = Box(320 - half, 240 - half / 4, 320 + half, 240 + half / 4)
    corners = [(box.x0, box.y0), (box.x1, box.y0), (np.nan, np.nan), (box.x1, box.y1), (box.x0, box.y1)]
    found = Detection(
        u_px=321.0,
        v_px=240.0,
        covariance_px2=np.eye(2),
        noise_px2=np.eye(2),
        centroid_px=np.array([320.0, 240.0]),
        box=box,
        area_px=box.area,
        contour_px=np.array(corners, np.float32),
        contrast_to_noise=9.0,
        channel="saturation",
    )
    return CameraReport(
        t_s=0.1 * epoch,
        station=station,
        epoch=epoch,
        status=status,
        result=found,
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.0,
        tilt_rad=0.0,
        innovation=None,
        elapsed_s=0.0,
        image=image,
    )


def pair(
    epoch: int, range_m: float, looks: list[CameraReport], status: TrackStatus = TrackStatus.TRACKING
) -> Iterator[StepReport]:
    """Yield the reports of one pair: frames first, the estimate in a step of its own."""
    for camera in looks:
        yield StepReport(cameras=(camera,))
    place = np.array([0.0, (range_m**2 - 64.0) ** 0.5, 0.0])
    state = Kinematics(position_runway_m=place, velocity_runway_m_s=np.zeros(3), covariance=np.eye(6))
    yield StepReport(
        estimates=(
            TrackEstimate(
                t_s=0.1 * epoch,
                epoch=epoch,
                status=status,
                kinematics=state,
                triangulation_status=TriangulationStatus.OK,
                triangulation=None,
            ),
        )
    )


def collected(ranges_m: np.ndarray) -> SilhouetteCollector:
    collector = SilhouetteCollector(PLACES)
    for epoch, range_m in enumerate(ranges_m):
        for report in pair(epoch, range_m, [look(name, epoch, range_m, picture()) for name in PLACES]):
            collector.write(report)
    collector.close()
    return collector


def test_five_pairs_from_far_to_near_are_shown_evenly_over_the_range() -> None:
    shown = collected(np.geomspace(500.0, 60.0, 400)).shown()
    assert len(shown) == SHOWN_RANGES
    ranges = [silhouettes[0].range_m for silhouettes in shown]
    assert ranges[0] == pytest.approx(500.0, rel=0.01)
    assert ranges[-1] < 60.0 * 2**0.25
    assert all(1.4 < far / near < 2.2 for far, near in pairwise(ranges))
    for silhouettes in shown:
        assert [s.station for s in silhouettes] == ["left", "right"]
        assert len({s.t_s for s in silhouettes}) == 1


def test_a_long_run_takes_few_pixels_and_keeps_few() -> None:
    """Expected: of 3000 pairs, there and back, one for each bin of range: 3 octaves have 12, two cameras each."""
    CountedPicture.taken = 0
    there = np.geomspace(480.0, 60.0, 1500)
    collector = collected(np.concatenate([there, there[::-1]]))
    assert 2 * 12 <= CountedPicture.taken <= 2 * 14
    assert sum(s.pixels.shape[1] > 400 for silhouettes in collector.shown() for s in silhouettes) == 0


def test_kept_pixels_hold_no_picture() -> None:
    """Expected: copies; a view would keep the whole picture in memory."""
    for silhouettes in collected(np.geomspace(500.0, 60.0, 50)).shown():
        for s in silhouettes:
            assert s.pixels.base is None
            assert s.pixels.shape[1] <= 400


def test_a_wide_silhouette_is_kept_in_fewer_pixels() -> None:
    (silhouettes,) = collected(np.array([9.0])).shown()
    assert silhouettes[0].kept.w == W
    assert silhouettes[0].pixels.shape == (300, 400, 3)


def test_a_pair_of_two_cameras_takes_the_place_of_one_camera() -> None:
    collector = SilhouetteCollector(PLACES)
    looks = [[look("left", 0, 100.0, picture())], [look(n, 1, 99.0, picture()) for n in PLACES]]
    for epoch, seen in enumerate(looks):
        for report in pair(epoch, 100.0 - epoch, seen):
            collector.write(report)
    (silhouettes,) = collector.shown()
    assert [(s.station, s.t_s) for s in silhouettes] == [("left", 0.1), ("right", 0.1)]


@pytest.mark.parametrize(
    ("image", "detected", "tracked", "late"),
    [
        (None, DetectionStatus.OK, TrackStatus.TRACKING, 0),
        (picture(), DetectionStatus.GATED, TrackStatus.TRACKING, 0),
        (picture(), DetectionStatus.OK, TrackStatus.COASTING, 0),
        (picture(), DetectionStatus.OK, TrackStatus.TRACKING, 1),
        (PartialPicture((W, H), [], None), DetectionStatus.OK, TrackStatus.TRACKING, 0),
    ],
    ids=["no picture", "refused", "not tracked", "of another pair", "its pixels not recorded"],
)
def test_what_is_not_kept(image: Picture | None, detected: DetectionStatus, tracked: TrackStatus, late: int) -> None:
    collector = SilhouetteCollector(PLACES)
    for report in pair(5, 100.0, [look("left", 5 - late, 100.0, image, detected)], tracked):
        collector.write(report)
    assert [silhouettes for silhouettes in collector.shown() if silhouettes] == []


def test_looking_at_a_picture_is_not_reading_it() -> None:
    """Expected: a recording of the run holds the windows that the detector read, and no others."""
    image = picture()
    collector = SilhouetteCollector(PLACES)
    for report in pair(0, 100.0, [look("left", 0, 100.0, image)]):
        collector.write(report)
    assert len(collector.shown()) == 1
    assert image.read == []
    assert not image.whole_read


def test_the_section_shows_the_pixels_and_what_was_found() -> None:
    """Expected: each picture with its pixels, its outline in two pieces, the point half a pixel on, and its caption."""
    shown = collected(np.array([200.0])).shown()
    section = silhouette_section(shown, tracked=True)
    assert section.count("<svg role='img'") == 2
    assert "left: 200 m, 20 × 5 px" in section
    assert "<h3>200 m, 0.00 s</h3>" in section
    outline = re.findall(r"class='outline' d='([^']*)'", section)
    assert outline == ["M310.5 238.0L330.5 238.0ZM330.5 243.0L310.5 243.0Z"] * 2
    assert "M322.38 240.50L" in section
    data = re.findall(r"data:image/webp;base64,([^']*)'", section)
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(data[0]), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape == shown[0][0].pixels.shape
    assert np.abs(decoded.astype(int) - 90).max() <= 3


def test_a_name_in_the_section_is_text() -> None:
    collector = SilhouetteCollector({"<b>'": np.zeros(3)})
    for report in pair(0, 100.0, [look("<b>'", 0, 100.0, picture())]):
        collector.write(report)
    section = silhouette_section(collector.shown(), tracked=True)
    assert "<b>" not in section
    assert section.count("&lt;b&gt;&#x27;") == 2


def test_without_pictures_there_is_a_line_and_without_a_track_nothing() -> None:
    assert "No pictures" in silhouette_section((), tracked=True)
    assert silhouette_section((), tracked=False) == ""


def test_a_real_browser_decodes_the_pictures(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    section = silhouette_section(collected(np.geomspace(500.0, 60.0, 60)).shown(), tracked=True)
    page.write_text(html_page("Aircraft", section, SILHOUETTE_CSS), encoding="utf-8")
    with browser(tmp_path / "profile") as chromium:
        for width_px in (390, 1440):
            chromium.show(page.as_uri(), width_px)
            assert chromium.complaints() == []
            assert chromium.value("document.documentElement.scrollWidth") <= width_px
            wide = chromium.value("[...document.querySelectorAll('.range svg')].map(p => p.clientWidth)")
            assert len(wide) == 2 * SHOWN_RANGES
            assert min(wide) > 130
            decoded = (
                "Promise.all([...document.querySelectorAll('image')].map(p => { const i = new Image(); "
                "i.src = p.getAttribute('href'); return i.decode().then(() => i.naturalWidth); }))"
            )
            assert min(chromium.value(decoded)) > 20


@pytest.mark.usefixtures("unrendered_figures")
def test_a_replay_puts_them_into_its_report(landing_from_20_s: Path, tmp_path: Path) -> None:
    request = ReplayRequest(session=landing_from_20_s, out=tmp_path, rerun=False, from_s=27.0, to_s=29.5)
    replay(request)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/webp") >= 2
    assert "<figcaption>left: 1" in page
    assert len(page) < 3_000_000
