"""`groundstation onboard pose --rerun`: what the recording holds, read back with Rerun's own reader."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.pose.pose_files import Runways
from groundstation.onboard.pose_sinks import CAMERA, IMAGE, PLACE, RANGE, REPROJECTION, TIMELINE
from tests.onboard.pose.approaches import LENS, project
from tests.onboard.pose.test_pose_command import run, work

__all__ = ["work"]


class Read:
    """The rows of a recording by entity and component: {step: value}."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        self.blueprints = len(reader.blueprints())
        self.moving: dict[str, list[pa.RecordBatch]] = {}
        for chunk in reader.store(store=reader.recordings()[0]).stream():
            if not chunk.is_static:
                self.moving.setdefault(chunk.entity_path.lstrip("/"), []).append(chunk.to_record_batch())

    def rows(self, entity: str, component: str) -> dict[int, Any]:
        found = {}
        for batch in self.moving.get(entity, []):
            if component in batch.schema.names:
                steps = batch.column(TIMELINE).cast(pa.int64()).to_pylist()
                values = batch.column(component).to_pylist()
                found |= {step: value for step, value in zip(steps, values, strict=True) if value is not None}
        return found


def test_each_pose_is_drawn_at_its_position_in_the_table(
    work: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: one step for each picture; the drawn camera's pixels of the drawn runway are the corners' own."""
    drawn = work["out"].parent / "drawn" / "p.rrd"
    assert run(work) == 0
    alone = work["out"].read_bytes()
    assert run({**work, "rerun": drawn}) == 0
    assert work["out"].read_bytes() == alone
    assert f"wrote {drawn}" in capsys.readouterr().out
    read = Read(drawn)
    assert read.blueprints == 1
    outline = read.rows("threshold/runway", "LineStrips3D:strips")
    assert list(outline) == [0]
    corners = Runways(work["runways"]).find("ABCD", "36").corners_m
    np.testing.assert_allclose(outline[0][0], corners[[0, 1, 2, 3, 0]], atol=1e-3)
    translations = read.rows(CAMERA, "Transform3D:translation")
    quaternions = read.rows(CAMERA, "Transform3D:quaternion")
    places, labels = read.rows(PLACE, "Points3D:positions"), read.rows(PLACE, "Points3D:labels")
    ranges, errors = read.rows(RANGE, "Scalars:scalars"), read.rows(REPROJECTION, "Scalars:scalars")
    with work["out"].open() as stream:
        table = list(csv.DictReader(stream))
    with work["corners"].open() as stream:
        seen = [[float(cell) for cell in row[1:]] for row in list(csv.reader(stream))[1:13]]
    assert list(translations) == list(quaternions) == list(places) == list(ranges) == list(errors) == list(range(12))
    for k, row in enumerate(table[:12]):
        position = np.array([float(row[name]) for name in ("x_m", "y_m", "z_m")])
        np.testing.assert_allclose(translations[k][0], position, atol=1e-3)
        np.testing.assert_allclose(places[k][0], position, atol=1e-3)
        xyzw = np.array(quaternions[k][0])
        R = matrix_from_wxyz(np.array([float(row[name]) for name in ("qw", "qx", "qy", "qz")]))
        drawn_R = matrix_from_wxyz(xyzw[[3, 0, 1, 2]])
        np.testing.assert_allclose(drawn_R, R, atol=1e-5)
        pixels = project(np.array(outline[0][0][:4]), np.array(translations[k][0]), drawn_R, LENS)
        given = np.reshape(seen[k], (4, 2))
        apart = np.linalg.norm(pixels[:, None] - given, axis=2)
        assert apart.min(axis=1).max() < 0.05
        assert labels[k] == [row["filename"]]
        assert ranges[k][0] == pytest.approx(float(row["range_m"]), abs=1e-3)
        assert errors[k][0] == pytest.approx(float(row["reprojection_px"]), abs=1e-3)
    words = read.rows("status", "TextLog:text")
    assert [words[k][0] for k in range(13)] == [f"{row['filename']}: {row['status']}" for row in table]


def test_the_frustum_is_the_lens_and_a_picture_without_a_pose_shows_none(work: dict[str, Path]) -> None:
    """Expected: focal length and principal point (from the picture's corner) as in the file; cleared at step 12."""
    drawn = work["out"].with_suffix(".rrd")
    assert run({**work, "rerun": drawn}) == 0
    read = Read(drawn)
    K = np.array(read.rows(IMAGE, "Pinhole:image_from_camera")[3][0]).reshape(3, 3).T
    np.testing.assert_allclose(np.diag(K), [1400.0, 1390.0, 1.0])
    np.testing.assert_allclose(K[:2, 2], [642.5, 475.5])
    assert read.rows(IMAGE, "Pinhole:resolution")[3][0] == [1280.0, 960.0]
    for entity in (CAMERA, PLACE, RANGE, REPROJECTION):
        assert read.rows(entity, "Clear:is_recursive") == {12: [True]}


def test_a_recording_that_cannot_be_written_is_reported(
    work: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("")
    (tmp_path / "folder.rrd").mkdir()
    link = tmp_path / "link.rrd"
    link.symlink_to(work["corners"])
    before = work["corners"].read_bytes()
    cases = (
        ("taken/p.rrd", 1, "wanted --rerun with a file that can be written"),
        ("taken/deeper/p.rrd", 1, "wanted --rerun with a file that can be written"),
        ("folder.rrd", 1, "folder.rrd: got a folder; wanted --rerun with a file's name"),
        ("link.rrd", 1, "link.rrd: got a file that is read; wanted another --rerun"),
        ("poses.csv", 2, "wanted a name that ends in .rrd"),
    )
    for name, code, reported in cases:
        assert run({**work, "rerun": tmp_path / name}) == code
        error = capsys.readouterr().err
        assert reported in error
        assert "Errno" not in error
    assert run({**work, "out": tmp_path / "same.rrd", "rerun": tmp_path / "same.rrd"}) == 1
    assert "got a file that --out names, too; wanted another --rerun" in capsys.readouterr().err
    assert work["corners"].read_bytes() == before


def test_an_older_recording_stays_where_a_row_cannot_be_made(work: dict[str, Path], tmp_path: Path) -> None:
    older = tmp_path / "p.rrd"
    older.write_bytes(b"yesterday")
    with work["corners"].open("a") as stream:
        stream.write("ABCD_36_1.png,a,2,3,4,5,6,7,8\n")
    assert run({**work, "rerun": older}) == 1
    assert older.read_bytes() == b"yesterday"
