"""Lens files: written files are read back, by this program and by OpenCV; others are refused in one line."""

import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.errors import IntrinsicsError
from calibration.lens.lens_files import format_of, read_lens, write_lens
from calibration.lens.model import CalibratedLens, without_k3
from calibration.lens.plain_yaml import parse_yaml
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.geometry.camera import Lens
from groundstation.rig.rig import load_rig
from tests.calibration.lens.boards_seen import a_lens, parameters
from tests.complaints import complaint, only

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.283, 0.0739, 0.000193, 1.76e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99, 0.0023, 0.0003, -0.11]
  - [-0.0023, 0.99, 0.0141, 0.0004]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, 0.0, 0.0]
  distortion_model: equidistant
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
"""
ROS = """# by a calibrator
image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [438.783367, 0.000000, 305.593336,
         0.000000, 437.302876, 243.738352, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {0}
"""
ROS_FIVE = "\n  rows: 1\n  cols: 5\n  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]"

finite = st.floats(-10.0, 10.0, allow_subnormal=False)
lenses = st.builds(
    lambda w, h, f, c, k: Lens(
        image_size_px=(w, h), focal_px=np.array(f), principal_point_px=np.array(c), distortion=np.array(k)
    ),
    st.integers(1, 9000),
    st.integers(1, 9000),
    st.tuples(*[st.floats(1.0, 1e5)] * 2),
    st.tuples(*[st.floats(-1e4, 1e4)] * 2),
    st.tuples(*[finite] * 5),
)
roots = st.lists(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9), min_size=9, max_size=9)


@given(lens=lenses, root=roots, form=st.sampled_from(["toml", "opencv", "kalibr"]))
def test_round_trip(lens: Lens, root: list[list[float]], form: str) -> None:
    square = np.array(root) + np.eye(9)
    covariance = square @ square.T
    if form == "kalibr":
        lens.distortion[4] = 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("lens.toml" if form == "toml" else "lens.yaml")
        write_lens(path, CalibratedLens(lens=lens, covariance=covariance), form)
        back = read_lens(path)
        if form == "opencv":
            file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
            assert file.getNode("image_width").real() == lens.image_size_px[0]
            assert np.array_equal(file.getNode("camera_matrix").mat()[:2, 2], lens.principal_point_px)
            assert np.array_equal(file.getNode("distortion_coefficients").mat()[0], lens.distortion)
            file.release()
    assert back.lens.image_size_px == lens.image_size_px
    assert np.array_equal(parameters(back.lens), parameters(lens))
    # Kalibr's file has no place for it
    assert np.array_equal(back.covariance, np.zeros((9, 9)) if form == "kalibr" else covariance)


@given(text=st.text(st.sampled_from("ab:- []!#,\"'\n1.5e%"), max_size=80))
def test_any_text_is_read_or_refused(text: str) -> None:
    with only(IntrinsicsError):
        parse_yaml(text, "x.yaml")


@given(cut=st.integers(0, len(KALIBR)), other=st.sampled_from(["", ":", "[", "-", "\n", "x", "1e999"]))
def test_a_damaged_file_is_read_or_refused(cut: int, other: str) -> None:
    with tempfile.TemporaryDirectory() as folder, only(IntrinsicsError):
        path = Path(folder) / "c.yaml"
        path.write_text(KALIBR[:cut] + other + KALIBR[cut + 1 :])
        read_lens(path, "cam0")


def test_what_others_write(tmp_path: Path) -> None:
    chain, ros, own = tmp_path / "chain.yaml", tmp_path / "ros.yaml", tmp_path / "own.yml"
    chain.write_text(KALIBR)
    lens = read_lens(chain, "cam0").lens
    assert parameters(lens).tolist() == [458.654, 457.296, 367.215, 248.375, -0.283, 0.0739, 0.000193, 1.76e-05, 0.0]
    assert "2 cameras; wanted --name with one of 'cam0', 'cam1'" in complaint(IntrinsicsError, lambda: read_lens(chain))
    assert "'pinhole-equidistant'; wanted pinhole-radtan" in complaint(
        IntrinsicsError, lambda: read_lens(chain, "cam1")
    )
    ros.write_text(ROS.replace("{0}", ROS_FIVE))
    assert read_lens(ros).lens.principal_point_px.tolist() == [305.593336, 243.738352]
    # as OpenCV's sample programs write it
    file = cv2.FileStorage(str(own), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", 640)
    file.write("image_height", 480)
    file.write("camera_matrix", np.array([[700.123456789, 0, 320], [0, 701, 240], [0, 0, 1]]))
    file.write("distortion_coefficients", np.array([[-0.2, 0.1, 1e-5, 0, 0.03]]).T)
    file.release()
    assert parameters(read_lens(own).lens).tolist() == [700.123456789, 701, 320, 240, -0.2, 0.1, 1e-5, 0, 0.03]


def test_a_rig_gives_its_lens(landing_1: Path, tmp_path: Path) -> None:
    rig = load_rig(landing_1 / "rig.toml")
    right = next(s for s in rig.stations if s.name == "right")
    back = read_lens(landing_1 / "rig.toml", "right")
    assert np.array_equal(parameters(back.lens), parameters(right.lens))
    assert "--name with one of 'left', 'right'" in complaint(
        IntrinsicsError, lambda: read_lens(landing_1 / "rig.toml", "x")
    )


def test_a_lens_is_not_written_over_a_rig(landing_1: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_bytes((landing_1 / "rig.toml").read_bytes())
    back = read_lens(rig, "right")
    message = complaint(IntrinsicsError, lambda: write_lens(rig, back, "toml"))
    assert "got a rig file with [[station]], which would be lost; wanted another name" in message
    assert rig.read_bytes() == (landing_1 / "rig.toml").read_bytes()
    for _ in range(2):
        write_lens(tmp_path / "lens.toml", back, "toml")
    assert np.array_equal(parameters(read_lens(tmp_path / "lens.toml").lens), parameters(back.lens))


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (ROS.replace("{0}", "\n  rows: 1\n  cols: 8\n  data: [0, 0, 0, 0, 0, 1, 0, 0]"), "8 coefficients"),
        (ROS.replace("{0}", ROS_FIVE).replace("437.302876", "-437.3"), "a focal length of -437.3 px"),
        (ROS.replace("{0}", ROS_FIVE).replace("305.593336", "1e999"), "9 finite numbers"),
        (ROS.replace("{0}", ROS_FIVE).replace("image_width: 640\n", ""), "2 numbers"),
        (ROS.replace("{0}", ROS_FIVE).replace("plumb_bob", "rational_polynomial"), "plumb_bob"),
        (ROS.replace("{0}", "\n  rows: .inf\n  cols: 5\n  data: [0, 0, 0, 0, 0]"), "rows"),
        ("a: 1\n", "no camera_matrix"),
        ("", "an empty file"),
        ("just words\n", "line 1"),
        ("a: 1\na: 2\n", "twice"),
    ],
)
def test_yaml_that_is_no_lens(tmp_path: Path, text: str, reported: str) -> None:
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    assert reported in complaint(IntrinsicsError, lambda: read_lens(path))


@pytest.mark.parametrize(
    "text", ["focal_px = [1, 2]", "image_size_px = [640.5, 480]\nfocal_px=[1,1]\nprincipal_point_px=[1,1]", "x = 1"]
)
def test_toml_that_is_no_lens(tmp_path: Path, text: str) -> None:
    path = tmp_path / "lens.toml"
    path.write_text(text)
    complaint(InputError, lambda: read_lens(path))


def test_the_format_goes_with_the_suffix() -> None:
    assert format_of(Path("a.toml"), None) == "toml"
    assert format_of(Path("a.yml"), None) == "opencv"
    assert format_of(Path("a.YAML"), "kalibr") == "kalibr"
    for path, form in (("a.txt", None), ("a.toml", "kalibr"), ("a.yaml", "toml")):
        complaint(IntrinsicsError, lambda path=path, form=form: format_of(Path(path), form))


def test_a_lens_without_k3_is_nearly_the_same() -> None:
    lens = a_lens(k3=0.03)
    reduced = without_k3(CalibratedLens(lens=lens, covariance=np.eye(9)))
    points = np.array([[x, y, 1.0] for x in (-0.4, 0.0, 0.45) for y in (-0.3, 0.2)])
    pixels = []
    for each in (lens, reduced.calibrated.lens):
        matrix = np.array(
            [
                [each.focal_px[0], 0, each.principal_point_px[0]],
                [0, each.focal_px[1], each.principal_point_px[1]],
                [0, 0, 1],
            ]
        )
        pixels.append(cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, each.distortion)[0])
    moved = float(np.linalg.norm(pixels[0] - pixels[1], axis=-1).max())
    assert moved < 1.3 * reduced.worst_px < 0.3
    assert reduced.calibrated.lens.distortion[4] == 0.0
    assert np.all(reduced.calibrated.covariance[8] == 0.0)


def test_a_focal_length_in_millimetres_is_not_converted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: a rig file would refuse it as well."""
    (tmp_path / "ros.yaml").write_text(
        ROS.replace("{0}", ROS_FIVE).replace("438.783367", "25").replace("437.302876", "25")
    )
    assert main(["calibrate", "convert-lens", str(tmp_path / "ros.yaml"), str(tmp_path / "lens.toml")]) == 1
    reported = capsys.readouterr().err
    assert "ros.yaml: got a focal length of 25, 25 px; wanted pixels, not mm: at least 0.1 of the picture's" in reported
    assert not (tmp_path / "lens.toml").exists()
