"""The Rerun recording: what it holds, row by row, read back with Rerun's own reader."""

import os
import subprocess
import sys
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rerun as rr

from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.messages import StepReport
from groundstation.picture import PartialPicture, PicturePart
from groundstation.rig.rig import Rig
from groundstation.viewer import picture_channel as rerun_pictures
from groundstation.viewer.camera_channel import CameraChannel
from groundstation.viewer.media import EmbeddedVideo, Media, RecordedWindows
from groundstation.viewer.rerun_sink import (
    AxisErrors,
    ImageFolder,
    ReferenceLine,
    ReferenceTracks,
    RerunSink,
    VideoAsset,
)
from tests.viewer.recording import Recording, documented_entities
from tests.viewer.synthetic import LOST_BY_BOTH, SEARCHING_PAIRS, STATIONS, Landing

ROOT = Path(__file__).resolve().parents[2]
PAIRS = 332


@pytest.fixture(scope="module")
def landing() -> Landing:
    return Landing(ROOT / "recordings" / "landing-1")


@pytest.fixture(scope="module")
def reports(landing: Landing) -> list[StepReport]:
    return list(landing.reports())


@pytest.fixture(scope="module")
def recording(landing: Landing, reports: list[StepReport], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("rerun") / "session.rrd"
    videos = {name: VideoAsset(path=landing.folder / f"{name}.mp4") for name in STATIONS}
    sink = RerunSink(path, landing.rig, session_name="landing", media=videos)
    for report in reports:
        sink.write(report)
    errors = AxisErrors(
        against="truth",
        t_s=np.array(landing.track_t_s),
        error_m=landing.errors_m(),
        sigma_m=np.array(landing.sigma_m),
    )
    truth = ReferenceLine(name="truth", t_s=landing.truth["t_s"], position_runway_m=landing.truth_m)
    heard = (landing.dgps["t_s"] < 10.0) | (landing.dgps["t_s"] > 12.0)
    dgps = ReferenceLine(name="dgps", t_s=landing.dgps["t_s"][heard], position_runway_m=landing.dgps_m[heard])
    smoothed = ReferenceLine(name="smoothed", t_s=landing.truth["t_s"], position_runway_m=landing.truth_m + 0.1)
    sink.write_reference(ReferenceTracks(lines=(truth, dgps, smoothed), errors=errors))
    sink.close()
    return Recording(path)


@pytest.fixture
def few(reports: list[StepReport]) -> Iterator[list[StepReport]]:
    return iter([reports[20:25]]).__next__()


def _verify(path: Path) -> None:
    command = [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(path)]
    done = subprocess.run(
        command, env={**os.environ, "RERUN_ANALYTICS": "0"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_rerun_itself_finds_no_fault(recording: Recording) -> None:
    _verify(recording.path)
    assert recording.blueprints >= 1


def test_the_entities_are_those_of_the_documentation(recording: Recording) -> None:
    documented = set()
    for entity in documented_entities():
        documented |= {entity.replace("<station>", s) for s in STATIONS} if "<station>" in entity else {entity}
    found = {e for e in (*recording.moving, *recording.static) if not e.startswith("/__properties")}
    assert found == documented


def test_each_frame_refers_to_its_own_picture_in_the_video(recording: Recording, landing: Landing) -> None:
    for name in STATIONS:
        video = rr.AssetVideo(path=landing.folder / f"{name}.mp4")
        expected = [[int(t)] for t in video.read_frame_timestamps_nanos()]
        assert recording.column(f"/cameras/{name}/image", "VideoFrameReference:timestamp") == expected
        stamps_ns = np.round(landing.frames[f"{name}_t_s"] * 1e9).astype(int).tolist()
        assert recording.times_ns(f"/cameras/{name}/image") == stamps_ns


def test_the_video_is_in_the_file_once_and_unchanged(recording: Recording, landing: Landing) -> None:
    blobs = [b for b in recording.static["/cameras/left/image"] if "AssetVideo:blob" in b.schema.names]
    assert len(blobs) == 1
    contents = blobs[0].column("AssetVideo:blob")[0].values.flatten().to_numpy().tobytes()
    assert contents == (landing.folder / "left.mp4").read_bytes()


def test_a_miss_clears_the_overlay_and_keeps_the_region(recording: Recording) -> None:
    for entity, component in (("target", "Points2D:positions"), ("contour", "LineStrips2D:strips")):
        rows = recording.column(f"/cameras/left/image/{entity}", component)
        assert len(rows) == PAIRS
        assert all(rows[n] == [] for n in LOST_BY_BOTH)
        assert rows[LOST_BY_BOTH.stop]
    regions = recording.column("/cameras/left/image/roi", "Boxes2D:half_sizes")
    assert all(len(regions[n]) == (n >= SEARCHING_PAIRS) for n in range(PAIRS))  # type: ignore[arg-type]


def test_the_target_is_drawn_half_a_pixel_off_because_rerun_counts_from_the_corner(
    recording: Recording, reports: list[StepReport]
) -> None:
    drawn = recording.column("/cameras/right/image/target", "Points2D:positions")[100]
    result = reports[100].cameras[1].result
    np.testing.assert_allclose(drawn, [[result.u_px + 0.5, result.v_px + 0.5]], rtol=1e-6)  # type: ignore[arg-type, union-attr]


def test_the_frustum_turns_with_the_angles(recording: Recording, reports: list[StepReport], landing: Landing) -> None:
    """The chain of named frames, runway to base to head to camera, is the pose by the conventions."""
    stands = [(name, _still(recording, f"/world/stations/left/{name}")) for name in ("base", "camera")]
    assert [(name, row["parent"], row["child"]) for name, row in stands] == [
        ("base", "runway", "left.base"),
        ("camera", "left.head", "left.camera"),
    ]
    base, camera = (row for _, row in stands)
    head = "/world/stations/left/head"
    turns = recording.column(head, "Transform3D:quaternion")
    for n in (0, 200, PAIRS - 1):
        assert recording.column(head, "Transform3D:parent_frame")[n] == ["left.base"]
        assert recording.column(head, "Transform3D:child_frame")[n] == ["left.head"]
        report = reports[n].cameras[0]
        assert report.pan_rad is not None
        assert report.tilt_rad is not None
        pose = landing.stations["left"].camera_pose(report.pan_rad, report.tilt_rad)
        runway_from_head = base["turn"] @ _matrix(turns[n][0])  # type: ignore[index]
        place = base["place"] + runway_from_head @ camera["place"]
        np.testing.assert_allclose(place, pose.position_runway_m, rtol=1e-6)
        np.testing.assert_allclose(runway_from_head @ camera["turn"], pose.runway_from_camera, atol=1e-6)


def test_the_picture_and_the_scene_hang_in_the_same_frames(recording: Recording) -> None:
    pinhole = _still(recording, "/world/stations/right/camera", "Pinhole")
    assert (pinhole["parent"], pinhole["child"]) == ("right.camera", "right.image")
    world = _still(recording, "/world")
    assert (world["parent"], world["child"]) == ("tf#/", "runway")


def _still(recording: Recording, entity: str, archetype: str = "Transform3D") -> dict[str, Any]:
    """The static transform of an entity: parent, child, place and turn."""
    found: dict[str, Any] = {}
    names = {"parent_frame": "parent", "child_frame": "child", "translation": "place", "quaternion": "turn"}
    for batch in recording.static[entity]:
        for column, name in names.items():
            if f"{archetype}:{column}" in batch.schema.names:
                found[name] = batch.column(f"{archetype}:{column}")[0].as_py()[0]
    if "turn" in found:
        found["turn"] = _matrix(found["turn"])
    return found


def _matrix(xyzw: Sequence[float]) -> FloatArray:
    x, y, z, w = xyzw
    return matrix_from_wxyz(np.array([w, x, y, z]))


def test_rates_are_angle_differences_over_time_across_flushes(recording: Recording) -> None:
    angles = np.array(recording.column("/plots/ptu/left/pan", "Scalars:scalars"))[:, 0]
    rates = np.array(recording.column("/plots/ptu/left/pan_rate", "Scalars:scalars"))[:, 0]
    times_s = np.array(recording.times_ns("/plots/ptu/left/pan")) * 1e-9
    np.testing.assert_allclose(rates, np.diff(angles) / np.diff(times_s), rtol=1e-4, atol=1e-6)


def test_the_track_has_a_marker_an_ellipsoid_and_a_stroke_for_each_step(recording: Recording) -> None:
    tracked = PAIRS - SEARCHING_PAIRS
    assert sum(len(row) for row in recording.column("/aircraft/ekf", "Points3D:positions")) == tracked  # type: ignore[arg-type, misc]
    assert len(recording.times_ns("/aircraft/ekf/path")) == tracked - 1
    assert len(recording.times_ns("/aircraft/ekf/ellipsoid")) == PAIRS
    assert 28 <= len(recording.times_ns("/aircraft/ekf/ellipsoids")) <= 34


def test_ellipsoids_are_three_sigma(recording: Recording, landing: Landing) -> None:
    sizes = recording.column("/aircraft/ekf/ellipsoid", "Ellipsoids3D:half_sizes")[SEARCHING_PAIRS]
    np.testing.assert_allclose(np.sort(sizes[0]), np.sort(3 * landing.sigma_m[0]), rtol=1e-5)  # type: ignore[index]


def test_used_and_refused_innovations_are_separate_between_their_bounds(recording: Recording) -> None:
    used = np.array(recording.column("/plots/nis/left", "Scalars:scalars"))
    refused = np.array(recording.column("/plots/nis/left/refused", "Scalars:scalars"))
    assert used.max() < 13.8 <= refused.min()
    bounds = np.array(recording.column("/plots/nis/bounds", "Scalars:scalars"))
    np.testing.assert_allclose(bounds, np.tile([0.050636, 7.377759], (len(bounds), 1)), rtol=1e-5)


def test_errors_have_their_two_sigma_bounds(recording: Recording, landing: Landing) -> None:
    for axis, name in enumerate("xyz"):
        rows = np.array(recording.column(f"/plots/error/{name}", "Scalars:scalars"))
        np.testing.assert_allclose(rows[:, 0], landing.errors_m()[:, axis])
        np.testing.assert_allclose(rows[:, 1], 2 * np.array(landing.sigma_m)[:, axis])
        np.testing.assert_allclose(rows[:, 2], -rows[:, 1])


def test_a_reference_is_drawn_with_its_gaps(recording: Recording) -> None:
    def strips(name: str) -> list[object]:
        batches = recording.static[f"/aircraft/{name}/path"]
        return next(b for b in batches if "LineStrips3D:strips" in b.schema.names)["LineStrips3D:strips"][0].as_py()  # type: ignore[no-any-return]

    assert len(strips("truth")) == 1
    assert len(strips("dgps")) == 2


def test_statuses_are_written_where_they_change(recording: Recording) -> None:
    states = [row[0] for row in recording.column("/status/track", "StateChange:state")]  # type: ignore[index]
    assert states == ["searching", "tracking", "coasting", "tracking"]
    assert recording.text("/log/right")[2] == "right: miss, low_contrast (contrast to noise 1.4, wanted 3)"
    assert "no camera sees the target: coasting" in recording.text("/log/track")


def test_only_session_time_orders_the_recording(recording: Recording) -> None:
    fields = {n for batches in recording.moving.values() for b in batches for n in b.schema.names if ":" not in n}
    assert fields == {"rerun.controls.RowId", "session_time"}


def _write(path: Path, rig: Rig, few: list[StepReport], **options: object) -> Recording:
    sink = RerunSink(path, rig, session_name="few", **options)  # type: ignore[arg-type]
    for report in few:
        sink.write(report)
    sink.close()
    _verify(path)
    return Recording(path)


def test_a_session_without_pictures_has_its_overlay_alone(
    tmp_path: Path, landing: Landing, few: list[StepReport]
) -> None:
    recording = _write(tmp_path / "few.rrd", landing.rig, few)
    assert "/cameras/left/image" not in recording.moving
    assert len(recording.times_ns("/cameras/left/image/target")) == len(few)


def test_pictures_of_a_folder_are_stored_unchanged(tmp_path: Path, landing: Landing, few: list[StepReport]) -> None:
    files = {}
    for number in (20, 21, 23):  # 22 is missing, 24 was never exposed
        files[number] = tmp_path / f"{number:06d}.png"
        cv2.imwrite(str(files[number]), np.full((12, 16, 3), number, np.uint8))
    recording = _write(tmp_path / "few.rrd", landing.rig, few, media={"left": ImageFolder(files=files)})
    blobs = recording.column("/cameras/left/image", "EncodedImage:blob")
    assert [bytes(row[0]) for row in blobs] == [p.read_bytes() for p in files.values()]  # type: ignore[index]


def test_of_a_recorded_picture_the_windows_that_were_kept_are_shown(
    tmp_path: Path, landing: Landing, few: list[StepReport], monkeypatch: pytest.MonkeyPatch
) -> None:
    part = PicturePart(x=600, y=400, pixels=np.full((100, 250, 3), 200, np.uint8))
    picture = PartialPicture((1280, 960), [part], None)
    seen = [replace(r, cameras=tuple(replace(c, image=picture) for c in r.cameras)) for r in few]
    media: dict[str, Media] = {name: RecordedWindows() for name in STATIONS}
    recording = _write(tmp_path / "few.rrd", landing.rig, seen, media=media)
    blobs = recording.column("/cameras/left/image", "EncodedImage:blob")
    assert len(blobs) == len(few)
    shown = cv2.imdecode(np.frombuffer(bytes(blobs[0][0]), np.uint8), cv2.IMREAD_COLOR)  # type: ignore[index]
    assert shown is not None
    assert shown.shape == (960, 1280, 3)
    bright = np.zeros((960, 1280), dtype=np.bool_)
    bright[400:500, 600:850] = True
    inside = cv2.erode(bright.astype(np.uint8), np.ones((17, 17))) > 0
    outside = cv2.dilate(bright.astype(np.uint8), np.ones((17, 17))) == 0
    assert np.abs(shown[inside].astype(int) - 200).max() <= 3
    assert np.abs(shown[outside].astype(int) - 40).max() <= 3
    monkeypatch.setattr(rerun_pictures, "MAX_PICTURE_BYTES", 1)
    full = _write(tmp_path / "full.rrd", landing.rig, seen, media=media)
    assert len(full.column("/cameras/left/image", "EncodedImage:blob")) == 1
    assert [t for t in full.text("/log/track") if "no more pictures" in t and "left" in t]


def test_a_picture_that_is_gone_is_named(tmp_path: Path, landing: Landing, few: list[StepReport]) -> None:
    gone = tmp_path / "000020.png"
    sink = RerunSink(
        tmp_path / "few.rrd", landing.rig, session_name="few", media={"left": ImageFolder(files={20: gone})}
    )
    with pytest.raises(SessionError, match=r"000020\.png"):
        sink.write(few[0])
    sink.close()


def test_a_video_that_cannot_be_embedded_is_left_out_and_logged(
    tmp_path: Path, landing: Landing, few: list[StepReport]
) -> None:
    broken = tmp_path / "left.mp4"
    broken.write_bytes(b"no video at all")
    recording = _write(tmp_path / "few.rrd", landing.rig, few, media={"left": VideoAsset(path=broken)})
    assert any("no pictures of left" in line for line in recording.text("/log/track"))
    assert len(recording.times_ns("/plots/ptu/left/pan")) == len(few)


def test_a_frame_refers_to_the_videos_own_number_where_the_session_gives_one(
    tmp_path: Path, landing: Landing, few: list[StepReport]
) -> None:
    """Expected: of pairs 20 to 24 the video's frames 23, 24 and 26; of 22 it has none, and 99 is beyond its end."""
    numbers = {20: 23, 21: 24, 23: 26, 24: 99}
    stamps_ns = np.arange(30) * 100_000_000
    own = VideoAsset(path=landing.folder / "left.mp4", frame_timestamps_ns=stamps_ns, frame_numbers=numbers)
    recording = _write(tmp_path / "few.rrd", landing.rig, few, media={"left": own})
    shown = recording.column("/cameras/left/image", "VideoFrameReference:timestamp")
    assert shown == [[2_300_000_000], [2_400_000_000], [2_600_000_000]]
    assert "left: 2 frames are not in the video" in recording.text("/log/track")


def test_frames_beyond_the_video_have_no_picture_and_the_log_counts_them(
    tmp_path: Path, landing: Landing, few: list[StepReport]
) -> None:
    short = VideoAsset(path=landing.folder / "left.mp4", frame_timestamps_ns=np.arange(22) * 100_000_000)
    recording = _write(tmp_path / "few.rrd", landing.rig, few, media={"left": short})
    assert len(recording.times_ns("/cameras/left/image")) == 2
    assert "left: 3 frames are not in the video" in recording.text("/log/track")


def test_a_run_without_any_report_is_a_sound_file(tmp_path: Path, landing: Landing) -> None:
    recording = _write(tmp_path / "none.rrd", landing.rig, [])
    assert recording.moving == {}


def test_more_than_two_stations(tmp_path: Path, landing: Landing, few: list[StepReport]) -> None:
    third = replace(landing.rig["left"], name="third", ptu_position_m=np.array([0.0, -3.0, 2.0]))
    rig = Rig(stations=(*landing.rig.stations, third))
    wide = [replace(r, cameras=(*r.cameras, replace(r.cameras[0], station="third"))) for r in few]
    recording = _write(tmp_path / "three.rrd", rig, wide)
    assert len(recording.times_ns("/world/stations/third/head")) == len(few)


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path, landing: Landing) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match="wanted a file that can be written"):
        RerunSink(tmp_path / "file" / "session.rrd", landing.rig, session_name="x")


def test_a_report_does_not_keep_its_picture_alive(landing: Landing, few: list[StepReport]) -> None:
    channel = CameraChannel(landing.stations["left"], EmbeddedVideo())
    image = np.zeros((4, 4, 3), np.uint8)
    alive = weakref.ref(image)
    channel.add(replace(few[0].cameras[0], image=image))
    del image
    assert len(channel) == 1
    assert alive() is None
