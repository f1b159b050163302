"""`groundstation onboard pose`: the tables, and the messages for bad ones."""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.cli.main import main
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.pose.pose_files import POSE_COLUMNS, Runways
from groundstation.onboard.pose.runway import orders_by_row, rectangle, runway_from_geodetic
from tests.onboard.pose.approaches import LENS, pose_on_approach, project

CAMERA = """image_size_px = [1280, 960]
focal_px = [1400.0, 1390.0]
principal_point_px = [642.0, 475.0]
distortion = [-0.1, 0.03, 1e-3, -5e-4, 0.0]
"""
# 36 heads north-east by the compass: its near threshold is the south-western end, given as C and D
DEG_PER_M = 1.0 / 111_320.0


def corner(north_m: float, east_m: float, height_m: float = 12.0) -> dict[str, dict[str, float]]:
    return {"coordinate": {"latitude": north_m * DEG_PER_M, "longitude": east_m * DEG_PER_M, "altitude": height_m}}


IN_RADIANS = {
    name: corner(float(np.radians(north)), float(np.radians(east)))
    for name, (north, east) in {"A": (900, -15), "B": (900, 15), "C": (0, 15), "D": (0, -15)}.items()
}


def write_runways(path: Path, *, swapped: bool = False) -> Path:
    far, near = (corner(900, -15), corner(900, 15)), (corner(0, 15), corner(0, -15))
    a, b = (near, far) if swapped else (far, near)
    named = dict(zip("ABCD", (*a, *b), strict=True))
    path.write_text(json.dumps({"ABCD": {"36": named}}))
    return path


@pytest.fixture
def work(tmp_path: Path, rng: np.random.Generator) -> dict[str, Path]:
    camera = tmp_path / "nose.toml"
    camera.write_text(CAMERA)
    runways = write_runways(tmp_path / "runways.json")
    runway = Runways(runways).find("ABCD", "36")
    with (tmp_path / "corners.csv").open("w") as stream, (tmp_path / "truth.csv").open("w") as truth_file:
        stream.write("filename," + ",".join(f"{axis}_{name}" for name in "ABCD" for axis in "xy") + "\n")
        for k in range(12):
            truth = pose_on_approach(rng)
            pixels = project(runway.corners_m, *truth, LENS)
            shuffled = pixels[rng.permutation(4)]
            cells = ",".join(f"{value:.6f}" for value in shuffled.ravel())
            stream.write(f"ABCD_36_{k:02d}.png,{cells}\n")
            truth_file.write(",".join(f"{value:.9f}" for value in (*truth[0], *truth[1].ravel())) + "\n")
        stream.write("ABCD_36_99.png,,,,,,,,\n")
    return {"corners": tmp_path / "corners.csv", "runways": runways, "camera": camera, "out": tmp_path / "o" / "p.csv"}


def run(work: dict[str, Path]) -> int:
    return main(["onboard", "pose", *(word for key, path in work.items() for word in (f"--{key}", str(path)))])


def test_poses_of_shuffled_corners(work: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(work) == 0
    assert "13 pictures: 1 no_corners, 12 ok" in capsys.readouterr().out
    with work["out"].open() as stream:
        table = list(csv.DictReader(stream))
    truth = np.loadtxt(work["corners"].parent / "truth.csv", delimiter=",")
    assert tuple(table[0]) == POSE_COLUMNS
    for row, true in zip(table[:12], truth, strict=True):
        got = np.array([float(row[name]) for name in ("x_m", "y_m", "z_m")])
        np.testing.assert_allclose(got, true[:3], atol=0.02)
        assert float(row["range_m"]) == pytest.approx(np.linalg.norm(true[:3]), abs=0.02)
        R = matrix_from_wxyz(np.array([float(row[name]) for name in ("qw", "qx", "qy", "qz")]))
        np.testing.assert_allclose(R, true[3:].reshape(3, 3), atol=1e-4)
        assert float(row["reprojection_px"]) < 1e-3
    assert table[12]["status"] == "no_corners"
    assert not any(table[12][name] for name in POSE_COLUMNS[1:-1])


def test_a_camera_of_another_resolution_is_noted(work: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(work) == 0
    assert "another resolution" not in capsys.readouterr().err
    small = CAMERA.replace("[1280, 960]", "[320, 240]").replace("[642.0, 475.0]", "[160.0, 120.0]")
    work["camera"].write_text(small.replace("[1400.0, 1390.0]", "[350.0, 347.5]"))
    assert run(work) == 0
    printed = capsys.readouterr().err
    assert "12 pictures have corners outside of 320×240 px: is the camera of another resolution?" in printed


def rewrite(table: Path, change: Callable[[float, float], tuple[float, float]]) -> None:
    """Replace each corner (x, y) of a table."""
    rows = list(csv.reader(table.read_text().splitlines()))
    for row in rows[1:]:
        for k in range(1, len(row), 2):
            if row[k]:
                row[k : k + 2] = (f"{value:.6f}" for value in change(float(row[k]), float(row[k + 1])))
    table.write_text("".join(",".join(row) + "\n" for row in rows))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x, y: (y, x), "which no approach is flown with: are x and y exchanged, or is the camera mounted so"),
        (lambda x, y: (x, 960.0 - y), "is y counted upwards from the lowest row, or is the camera mounted so"),
    ],
)
def test_exchanged_and_reversed_columns_are_named(
    work: dict[str, Path],
    capsys: pytest.CaptureFixture[str],
    change: Callable[[float, float], tuple[float, float]],
    words: str,
) -> None:
    work["camera"].write_text(re.sub("distortion.*", "", CAMERA))
    rewrite(work["corners"], change)
    assert run(work) == 1
    printed = capsys.readouterr()
    assert words in printed.err
    assert "corners.csv: doubtful: 12 of 12 pictures" in printed.err
    assert " rolled" in printed.out
    assert " ok" not in printed.out


def test_a_camera_that_is_mounted_sideways_is_no_doubt(
    work: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Its file says so; the picture of 90° to the right has its rows where those of a level one have columns."""
    lens = "image_size_px = [960, 1280]\nfocal_px = [1390.0, 1400.0]\nprincipal_point_px = [485.0, 642.0]\n"
    rewrite(work["corners"], lambda x, y: (960.0 - y, x))
    work["camera"].write_text(lens)
    assert run(work) == 1
    capsys.readouterr()
    work["camera"].write_text(lens + "mount_deg = [-90.0, 0.0, 0.0]\n")
    assert run(work) == 0
    printed = capsys.readouterr()
    assert "doubtful" not in printed.err
    assert " rolled" not in printed.out


def test_which_end_is_near_follows_from_the_runways_name(tmp_path: Path) -> None:
    """Whichever of A B and C D the file calls first."""
    for swapped in (False, True):
        runway = Runways(write_runways(tmp_path / f"{swapped}.json", swapped=swapped)).find("ABCD", "36")
        assert runway.length_m == pytest.approx(900, rel=0.01)
        assert runway.width_m == pytest.approx(30, rel=0.01)
        # y towards who approaches from the south, x to the approaching pilot's left: west
        np.testing.assert_allclose(runway.corners_m[0], [15, 0, 0], atol=0.2)
        np.testing.assert_allclose(runway.corners_m[1], [15, -runway.length_m, 0], atol=0.2)


def test_a_sloping_runway_keeps_z_up() -> None:
    near = np.array([[0.0, -15 * DEG_PER_M, 10.0], [0.0, 15 * DEG_PER_M, 10.0]])
    far = near + [900 * DEG_PER_M, 0.0, 9.0]
    runway = runway_from_geodetic(near, far)
    assert runway.corners_m[1, 2] == pytest.approx(9.0, abs=0.1)
    assert runway.corners_m[:, 0].mean() == pytest.approx(0.0, abs=1e-6)


@given(st.permutations(range(4)), st.integers(0, 10_000))
def test_corners_are_put_in_order(permutation: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    pixels = project(rectangle(900.0, 30.0).corners_m, *pose_on_approach(rng), LENS)
    orders = orders_by_row(pixels[permutation])
    np.testing.assert_array_equal(pixels[permutation][orders[0]], pixels)
    assert len({tuple(order) for order in orders}) == 4


@pytest.mark.parametrize(
    ("file", "text", "reported"),
    [
        ("runways", "{", "no JSON"),
        ("runways", '{"A": {},\n"B" 1}', "runways.json: line 2: got no JSON (Expecting ':' delimiter)"),
        ("runways", "[]", "no table"),
        (
            "runways",
            '{"ABCD": {"18": {}, "18L": {}}}',
            "corners.csv: line 2: got runway '36' of ABCD; wanted one of runways.json: 18, 18L",
        ),
        (
            "runways",
            json.dumps({f"A{k:03d}": {} for k in range(20)}),
            "corners.csv: line 2: got airport 'ABCD'; wanted one of runways.json: A000, A001, A002, A003, A004, A005, "
            "A006, A007, A008, A009, A010, A011 and 8 more",
        ),
        ("runways", "{}", "wanted one of runways.json: nothing"),
        ("runways", '{"ABCD": {"36": {"A": 1}}}', "corner A: got none that can be read"),
        ("camera", "focal_px = 3", "image_size_px: got nothing"),
        ("camera", CAMERA.replace("[1400.0, 1390.0]", "1400.0"), "got 1400.0; wanted 2 finite numbers, [fx, fy]"),
        ("camera", CAMERA + "mount_deg = [1, 2]\n", "mount_deg: got [1, 2]; wanted 3 finite numbers"),
        ("corners", "filename,x_A\n", "wanted a column y_A"),
        ("corners", "filename,x_A,y_A,x_B,y_B,x_C,y_C,x_D,y_D\n\n", "got no row below the header"),
        ("corners", "filename,x_A,y_A,x_B,y_B,x_C,y_C,x_D,y_D\nme.png,1,2,3,4,5,6,7,8\n", "AIRPORT_RUNWAY_"),
        ("corners", "filename,x_A,y_A,x_B,y_B,x_C,y_C,x_D,y_D\nABCD_36_1.png,a,2,3,4,5,6,7,8\n", "x_A = 'a'"),
        (
            "corners",
            "filename,x_A,y_A,x_B,y_B,x_C,y_C,x_D,y_D\nABCD_36_1.png,.4,.5,.5,.5,.6,.4,.3,.7\n",
            "corners.csv: line 2: got corners from 0.3 to 0.7; wanted px, not shares of the picture",
        ),
        (
            "runways",
            json.dumps({"ABCD": {"36": IN_RADIANS}}),
            "ABCD 36: got a runway of 16 m by 0.52 m at latitude 0.0001411; wanted degrees; are these radians?",
        ),
    ],
)
def test_a_file_at_fault_is_one_clear_line(
    work: dict[str, Path], file: str, text: str, reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    work[file].write_text(text)
    assert run(work) == 1
    error = capsys.readouterr().err
    assert reported in error
    assert error.count("\n") == 1
    assert not work["out"].exists()


@pytest.mark.parametrize("file", ["corners", "runways", "camera"])
def test_a_folder_and_a_missing_file_are_distinguished(
    work: dict[str, Path], file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder").mkdir()
    for name, reported in (("folder", "folder: got a folder; wanted"), ("none", "none: got no such file; wanted")):
        assert run({**work, file: tmp_path / name}) == 1
        assert reported in capsys.readouterr().err


def test_an_older_table_stays_where_a_row_cannot_be_made(work: dict[str, Path]) -> None:
    work["out"].parent.mkdir()
    work["out"].write_text("poses of yesterday\n")
    with work["corners"].open("a") as stream:
        stream.write("ABCD_36_1.png,a,2,3,4,5,6,7,8\n")
    assert run(work) == 1
    assert work["out"].read_text() == "poses of yesterday\n"


def test_nothing_that_is_read_is_written_over(work: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    before = work["corners"].read_text()
    assert run({**work, "out": work["corners"]}) == 1
    assert work["corners"].read_text() == before
    assert "another --out" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_reported(work: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    (work["camera"].parent / "taken").write_text("")
    for out in ("taken/p.csv", "taken/deeper/p.csv"):
        assert run({**work, "out": work["camera"].parent / out}) == 1
        reported = capsys.readouterr().err
        assert re.search(
            r"taken\S*: got (Not a directory|File exists); wanted --out with a file that can be ", reported
        )
        assert "Errno" not in reported


def test_the_camera_file_of_the_other_commands_will_do(work: dict[str, Path]) -> None:
    """Expected: the same poses, whatever the other content of the file."""
    assert run(work) == 0
    alone = work["out"].read_bytes()
    more = "mount_deg = [0.0, -3.0, 0.0]\n[runway]\nwidth_m = 30.0\nlength_m = 900.0\n[start]\nheight_m = 9.0\n"
    work["camera"].write_text(CAMERA + more + "[imu]\nforce_noise = 0.01\n")
    assert run(work) == 0
    assert work["out"].read_bytes() == alone


def test_implausible_pixels_give_no_pose_with_a_status(work: dict[str, Path]) -> None:
    work["corners"].write_text(
        "filename,x_A,y_A,x_B,y_B,x_C,y_C,x_D,y_D\nABCD_36_1.png,5,5,5,5,5,5,5,5\nABCD_36_3.png,1e9,1,2,-1e9,3,3,4,4\n"
    )
    assert run(work) == 0
    with work["out"].open() as stream:
        assert {row["status"] for row in csv.DictReader(stream)} <= {"no_pose", "residual", "uncertain"}
