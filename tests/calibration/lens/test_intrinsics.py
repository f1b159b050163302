"""Pictures in, lens out; and the messages where the pictures do not give one."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.errors import IntrinsicsError
from calibration.lens.boards import parse_board
from calibration.lens.intrinsics import Intrinsics, calibrate_intrinsics
from calibration.lens.model import PARAMETERS, CalibratedLens
from calibration.lens.rig import write_rig_with_lens
from calibration.lens.view_choice import Choice
from calibration.pictures import GreyPicture, read_pictures
from groundstation.cli.main import main
from groundstation.geometry.camera import Lens
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from tests.calibration.lens.boards_seen import Pose, a_lens, a_pose, parameters, render
from tests.calibration.mount.mounts import plain_station
from tests.complaints import complaint

pytestmark = pytest.mark.usefixtures("unrendered_pictures")

CHARUCO = "charuco:7x5:0.04:0.03"
LENS = a_lens((480, 360), focal_px=520.0)
CHESS_LENS = Lens(
    image_size_px=LENS.image_size_px,
    focal_px=LENS.focal_px,
    principal_point_px=LENS.principal_point_px,
    distortion=LENS.distortion,
)


@pytest.fixture(scope="module")
def shots() -> list[GreyPicture]:
    """Twelve pictures of the ChArUco board, one more out of focus, one taken twice."""
    rng = np.random.default_rng(7)
    board = parse_board(CHARUCO)
    poses = [a_pose(rng, board, LENS) for _ in range(12)]
    taken = [GreyPicture(name=f"{i:02d}.png", grey=render(rng, board, LENS, p)) for i, p in enumerate(poses)]
    turned = Pose(rotation=np.array([0.3, -0.2, 0.1]), translation_m=np.array([-0.15, -0.1, 0.36]))
    taken.append(GreyPicture(name="soft.png", grey=render(rng, board, LENS, turned, blur_px=1.8)))
    return [*taken, GreyPicture(name="twice.png", grey=taken[2].grey)]


@pytest.fixture(scope="module")
def found(shots: list[GreyPicture]) -> Intrinsics:
    return calibrate_intrinsics(shots, parse_board(CHARUCO))


def held_to(error: np.ndarray, sigma: np.ndarray, usual: Sequence[float]) -> None:
    """Hold errors and sigmas of PARAMETERS to sigmas written down here, measured on the same pictures."""
    assert np.all(np.abs(error) < 4.0 * np.array(usual))
    assert np.all(sigma < 1.5 * np.array(usual))
    assert np.all(sigma > np.array(usual) / 1.5)


def _folder(path: Path, shots: list[GreyPicture]) -> Path:
    path.mkdir(exist_ok=True)
    for shot in shots:
        assert cv2.imwrite(str(path / shot.name), shot.grey)
    return path


def test_rendered_pictures_give_the_lens(shots: list[GreyPicture], found: Intrinsics) -> None:
    error = parameters(found.fit.lens) - parameters(LENS)
    # a rendered corner's error is not quite white, so the sigmas are a little small
    assert np.all(np.abs(error) < 4.0 * found.fit.sigma)
    assert np.all(np.abs(error[:2]) < 0.005 * LENS.focal_px)
    # the errors were 0.9 of these at most; each k by itself is hardly known, for the others make up for it
    held_to(error, found.fit.sigma, (0.86, 0.78, 1.16, 0.86, 0.015, 0.176, 3.8e-4, 4.0e-4, 0.61))
    assert found.fit.rms_px < found.held_out.rms_px < 0.25
    reported = {v.name: v.choice for v in found.verdicts}
    assert reported["soft.png"] is Choice.BLURRED
    assert {reported["twice.png"], reported["02.png"]} == {Choice.ALIKE, Choice.USED}
    assert list(reported) == [s.name for s in shots]


def test_plain_opencv_finds_the_same_in_the_same_pictures(shots: list[GreyPicture], found: Intrinsics) -> None:
    """OpenCV from end to end: its detector's corners, its `calibrateCamera`, in the pictures that were used."""
    used = {v.name for v in found.verdicts if v.choice is Choice.USED}
    board = cv2.aruco.CharucoBoard((7, 5), 0.04, 0.03, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    detector = cv2.aruco.CharucoDetector(board)
    points, pixels = [], []
    for shot in shots:
        if shot.name in used:
            corners, ids, _, _ = detector.detectBoard(shot.grey)
            on_board, in_picture = board.matchImagePoints(corners, ids)
            points.append(on_board)
            pixels.append(in_picture)
    _, matrix, distortion, _, _ = cv2.calibrateCamera(points, pixels, LENS.image_size_px, np.eye(3), np.zeros(5))
    plain = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.reshape(-1)])
    assert np.all(np.abs(parameters(found.fit.lens) - plain) < found.fit.sigma)
    # measured: 3e-5 px and 3e-5 of the k apart at most, as two minimisers of the same squares end
    assert np.abs(parameters(found.fit.lens) - plain).max() < 1e-3


def test_a_chessboard_gives_the_lens(rng: np.random.Generator) -> None:
    board = parse_board("chessboard:7x5:0.04")
    poses = [a_pose(rng, board, CHESS_LENS, tilt_deg=35.0, fill=0.5) for _ in range(12)]
    taken = [GreyPicture(name=f"{i:02d}.png", grey=render(rng, board, CHESS_LENS, p)) for i, p in enumerate(poses)]
    found = calibrate_intrinsics(taken, board, held=frozenset({"k3"}))
    error = parameters(found.fit.lens) - parameters(CHESS_LENS)
    assert np.all(np.abs(error[:4]) < 4.0 * found.fit.sigma[:4])
    # the errors were 2.1 of these at most; k3 is held
    held_to(error[:8], found.fit.sigma[:8], (0.35, 0.33, 0.26, 0.21, 7.8e-4, 3.3e-3, 6.7e-5, 7.4e-5))
    message = complaint(IntrinsicsError, lambda: calibrate_intrinsics(taken[:1], parse_board("chessboard:8x6:0.04")))
    assert "chessboard:7x5" in message


def test_the_command_writes_lens_and_report(
    shots: list[GreyPicture], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = _folder(tmp_path / "shots", shots)
    out, report = tmp_path / "left.toml", tmp_path / "report"
    arguments = ["calibrate", "intrinsics", str(folder), "--board", CHARUCO, "--out", str(out), "--report", str(report)]
    assert main(arguments) == 0
    reported = capsys.readouterr().out
    for part in ("Held-out error", "correlate by", "next:", "soft.png: blurred", f"wrote {out}"):
        assert part in reported
    page = (report / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 4
    assert "http" not in page
    kalibr = tmp_path / "cam.yaml"
    assert main(["calibrate", "convert-lens", str(out), str(kalibr), "--format", "kalibr"]) == 1
    assert "k3 = 0" in capsys.readouterr().err
    assert not kalibr.exists()
    assert main(["calibrate", "convert-lens", str(out), str(kalibr), "--format", "kalibr", "--refit"]) == 0
    reported = capsys.readouterr().out
    assert "a pixel moves by at most" in reported
    assert "the lens's covariance is not carried" in reported
    assert main(["calibrate", "convert-lens", str(kalibr), str(tmp_path / "again.yaml"), "--format", "kalibr"]) == 0
    assert main(["calibrate", "convert-lens", str(out), str(tmp_path / "cv.yaml")]) == 0
    assert "covariance" not in capsys.readouterr().out


def test_the_command_writes_a_whole_rig_and_never_a_lens_over_one(
    shots: list[GreyPicture], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The lens of one station is new, with its covariance; a rig under --out without --rig is refused, and stays."""
    folder, given = _folder(tmp_path / "shots", shots), tmp_path / "rig.toml"
    left, right = plain_station(), plain_station(name="right", ptu_position_m=np.array([5.0, 0.0, 1.6]))
    given.write_text(rig_to_toml(Rig(stations=(left, right))))
    before = given.read_bytes()
    arguments = ["calibrate", "intrinsics", str(folder), "--board", CHARUCO]
    assert main([*arguments, "--out", str(given)]) == 1
    assert "rig.toml: got a rig file with [[station]]" in capsys.readouterr().err
    for wrong in (["--rig", str(given)], ["--station", "left"], ["--rig", str(given), "--station", "left"]):
        out = tmp_path / ("x.yaml" if len(wrong) == 4 else "x.toml")
        assert main([*arguments, *wrong, "--out", str(out)]) == 2
    out = tmp_path / "better.toml"
    assert main([*arguments, "--rig", str(given), "--station", "middle", "--out", str(out)]) == 1
    assert "--station with one of left, right" in capsys.readouterr().err
    assert main([*arguments, "--rig", str(given), "--station", "right", "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "next: right was aimed with its lens of before" in printed.out
    w, h = right.lens.image_size_px
    doubt = f"doubtful: got pictures of 480×360 px; wanted {w}×{h} px, which right has in {given}"
    assert doubt in printed.err
    assert given.read_bytes() == before
    rig = load_rig(out)
    assert rig["left"].lens.image_size_px == left.lens.image_size_px
    assert rig["right"].ptu_position_m.tolist() == [5.0, 0.0, 1.6]
    found = rig["right"].lens
    assert found.image_size_px == (480, 360)
    np.testing.assert_allclose(found.focal_px, LENS.focal_px, rtol=0.005)
    assert set(rig["right"].covariance_parameters) == set(PARAMETERS)
    place = rig["right"].covariance_parameters.index("focal.x")
    assert 0.0 < rig["right"].covariance[place, place] < (0.005 * 520.0) ** 2


def test_another_lens_leaves_the_rest_of_the_rig_unchanged(tmp_path: Path) -> None:
    """Own and shared covariance lose the entries of the lens, and nothing else; the file is read back."""
    names = ("head_from_camera.x", "focal.x", "camera_in_head.y")
    own = np.array([[4e-8, 1e-5, 1e-8], [1e-5, 9.0, 0.0], [1e-8, 0.0, 1e-6]])
    left = plain_station(covariance_parameters=names, covariance=own)
    right = plain_station(name="right")
    together = ("left.head_from_camera.x", "right.head_from_camera.x", "left.focal.x", "left.camera_clock.offset")
    matrix = np.diag([4e-8, 5e-8, 9.0, 1e-6])
    matrix[0, 1] = matrix[1, 0] = 2e-8
    matrix[0, 2] = matrix[2, 0] = 1e-5
    rig = Rig(stations=(left, right), shared_covariance=ParameterCovariance(names=together, matrix=matrix))
    covariance = np.diag([1.0, 1.0, 2.0, 2.0, 1e-6, 1e-4, 1e-8, 1e-8, 0.0])
    covariance[0, 1] = covariance[1, 0] = 0.9
    write_rig_with_lens(tmp_path / "out.toml", rig, "left", CalibratedLens(lens=LENS, covariance=covariance))
    found = load_rig(tmp_path / "out.toml")
    assert found["left"].covariance_parameters == ("head_from_camera.x", "camera_in_head.y", *PARAMETERS[:8])
    np.testing.assert_array_equal(found["left"].covariance[:2, :2], own[np.ix_([0, 2], [0, 2])])
    np.testing.assert_array_equal(found["left"].covariance[2:, 2:], covariance[:8, :8])
    assert not found["left"].covariance[:2, 2:].any()
    assert found.shared_covariance.names == (*together[:2], together[3])
    np.testing.assert_array_equal(found.shared_covariance.matrix, matrix[np.ix_([0, 1, 3], [0, 1, 3])])
    assert found["right"].lens.focal_px.tolist() == right.lens.focal_px.tolist()


def test_three_views_are_too_few(shots: list[GreyPicture]) -> None:
    message = complaint(IntrinsicsError, lambda: calibrate_intrinsics(shots[:3], parse_board(CHARUCO)))
    assert message.startswith("the pictures: got 3 usable views of 3 pictures; wanted at least 6 that differ")


def test_views_all_alike_are_too_few(shots: list[GreyPicture]) -> None:
    same = [GreyPicture(name=f"{i}.png", grey=shots[0].grey) for i in range(8)]
    message = complaint(IntrinsicsError, lambda: calibrate_intrinsics(same, parse_board(CHARUCO)))
    assert "got 1 usable view of 8 pictures (7 nearly the same as another)" in message


@pytest.mark.parametrize("spec", ["charuco:7x5:0.04:0.03:DICT_6X6_50", "chessboard:9x6:0.04", "charuco:11x8:0.04:0.03"])
def test_a_wrong_board_gives_no_lens(shots: list[GreyPicture], spec: str) -> None:
    complaint(
        IntrinsicsError, lambda: calibrate_intrinsics(shots[:2] if "chess" in spec else shots[:8], parse_board(spec))
    )


def test_pictures_without_a_board(rng: np.random.Generator) -> None:
    noise = [GreyPicture(name="n.png", grey=rng.integers(0, 255, (120, 160)).astype(np.uint8))]
    message = complaint(IntrinsicsError, lambda: calibrate_intrinsics(noise, parse_board(CHARUCO)))
    assert message.startswith("the pictures: got no charuco:7x5 in any of 1")
    assert "none" in complaint(IntrinsicsError, lambda: calibrate_intrinsics([], parse_board(CHARUCO)))


def test_files_that_are_no_pictures(shots: list[GreyPicture], tmp_path: Path) -> None:
    folder = _folder(tmp_path / "shots", shots[:1])
    assert cv2.imwrite(str(folder / "other.png"), shots[1].grey[:100])
    message = complaint(IntrinsicsError, lambda: list(read_pictures([folder])))
    assert "got 480x100 px; wanted 480x360 px, as 00.png has" in message
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "bare").mkdir()
    for name in ("text.png", "empty.mp4", "bare", "missing.png"):
        assert name in complaint(IntrinsicsError, lambda name=name: list(read_pictures([tmp_path / name])))


def test_a_video_is_read_like_pictures(shots: list[GreyPicture], tmp_path: Path) -> None:
    path = tmp_path / "board.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (480, 360))
    for shot in shots[:4]:
        writer.write(cv2.cvtColor(shot.grey, cv2.COLOR_GRAY2BGR))
    writer.release()
    pictures = list(read_pictures([path]))
    assert [p.name for p in pictures] == [f"board.avi frame {i}" for i in range(4)]
    assert pictures[0].grey.shape == (360, 480)


@pytest.mark.parametrize(
    "spec",
    ["", "charuco", "charuco:8x6:0.04", "charuco:8x6:0.04:0.05", "charuco:8by6:0.04:0.03", "chessboard:2x2:0.04",
     "chessboard:8x6:nan", "chessboard:8x6:-1", "charuco:8x6:0.04:0.03:DICT_9", "charuco:30x30:0.04:0.03", "x:8x6:1\n"],
)  # fmt: skip
def test_a_board_that_cannot_be(spec: str) -> None:
    assert complaint(IntrinsicsError, lambda: parse_board(spec)).startswith("--board: got ")


@pytest.mark.parametrize("spec", ["charuco:7x5:40:30", "chessboard:8x6:30", "chessboard:8x6:2.5"])
def test_squares_in_millimetres_are_refused_with_a_hint(spec: str) -> None:
    message = complaint(IntrinsicsError, lambda: parse_board(spec))
    assert message == f"--board: got '{spec}'; wanted edges in m, above 0.0001 and up to 2 (40 mm are 0.04)"
    assert parse_board("chessboard:8x6:2").square_m == 2.0
