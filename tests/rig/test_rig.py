import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from groundstation.errors import RigError
from groundstation.geometry.calibration import perturbed_station
from groundstation.rig.rig import ClockModel, load_rig
from tests.complaints import complaint, only
from tests.mutation import damaged
from tests.session.folder import rig_text

LANDING_RIG = (Path(__file__).resolve().parents[2] / "recordings" / "landing-1" / "rig.toml").read_text()


def load(folder: Path, text: str | bytes):
    path = folder / "rig.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_rig(path)


def edited(folder: Path, old: str, new: str) -> str:
    """The error message for a rig with one value changed."""
    text = rig_text(["left", "right"])
    assert old in text
    message = complaint(RigError, lambda: load(folder, text.replace(old, new, 1)))
    assert message.startswith(str(folder / "rig.toml"))
    return message


def test_the_bundled_rig(landing_1: Path) -> None:
    rig = load_rig(landing_1 / "rig.toml")
    left = rig["left"]
    assert rig.names == ("left", "right")
    assert left.lens.image_size_px == (1280, 960)
    assert np.isclose(np.linalg.norm(left.head_from_camera_wxyz), 1.0, atol=1e-15)
    assert np.isclose(left.ptu_resolution_rad, np.radians(0.00625))
    assert left.ptu_clock == ClockModel(sigma_s=0.0005)
    assert left.camera_clock is None
    rig.require_known()


def test_defaults(tmp_path: Path) -> None:
    left = load(tmp_path, rig_text(["left", "right"]))["left"]
    assert np.isclose(left.ptu_sigma_rad, left.ptu_resolution_rad / np.sqrt(12))
    assert left.ptu_clock == ClockModel()
    assert left.readout_s == 0.0
    assert left.lens.distortion.tolist() == [0.0] * 5
    assert left.camera_in_head_m.tolist() == [0.0] * 3
    assert left.known == ("position", "orientation", "lens")


def test_clocks_and_covariance(tmp_path: Path) -> None:
    more = "ptu_clock = { offset_s = 0.037, drift_ppm = 20 }\ncamera_clock = { offset_s = -0.02 }\n"
    more += '[station.covariance]\nparameters = ["focal.x", "ptu_position.z"]\nmatrix = [[4e-8, 2e-6], [2e-6, 1e-4]]\n'
    station = load(tmp_path, rig_text(["left", "right"], more={"right": more}))["right"]
    assert station.ptu_clock == ClockModel(offset_s=0.037, drift_ppm=20.0)
    assert station.ptu_clock.session_from_device(100.0) == pytest.approx(100.039)
    assert station.camera_clock == ClockModel(offset_s=-0.02)
    assert station.covariance_parameters == ("focal.x", "ptu_position.z")
    assert station.covariance[1, 1] == 1e-4


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("stereo-ptu-rig/1", "stereo-ptu-rig/2", "format: got 'stereo-ptu-rig/2'; wanted 'stereo-ptu-rig/1'"),
        ('format = "stereo-ptu-rig/1"', "", "format: got nothing; wanted a string"),
        ("[[station]]", "[station]", "got "),
        ('name = "left"', "", "station 1: name: got nothing; wanted a string"),
        ('name = "left"', 'name = "../up"', "station 1: name: got '../up'; wanted letters, digits, - and _"),
        ('name = "left"', 'name = "right"', "station: got two stations named 'right'; wanted names that differ"),
        (
            "focal_px = [300.0, 300.0]",
            "focal_px = [300.0, -1.0]",
            "focal_px: got [300.0, -1.0]; wanted two numbers > 0",
        ),
        # a wide lens, and that of 25 mm with its millimetres
        *(
            (
                "focal_px = [300.0, 300.0]",
                f"focal_px = [{f}, {f}]",
                f"focal_px: got [{f}, {f}]; wanted pixels, not mm: at least 0.1 of the picture's 64 × 48 px",
            )
            for f in (6.3, 0.025)
        ),
        (
            "[31.5, 23.5]",
            "[0.5, 0.49]",
            "principal_point_px: got [0.5, 0.49]; wanted pixels, not shares of the picture",
        ),
        ("ptu_resolution_deg = 0.00625", "ptu_resolution_deg = 22.5", "got 22.5; wanted a finite number ≥ 0 ≤ 5"),
        (
            "ptu_resolution_deg",
            "ptu_sigma_deg = 36\nptu_resolution_deg",
            "ptu_sigma_deg: got 36; wanted a finite number",
        ),
        (
            "ptu_resolution_deg",
            "camera_in_head_m = [11, 64, 47]\nptu_resolution_deg",
            "camera_in_head_m: got [11.0, 64.0, 47.0]; wanted metres from the axes, at most 5",
        ),
        (
            "ptu_resolution_deg",
            "readout_s = 33\nptu_resolution_deg",
            "readout_s: got 33; wanted seconds, at most 1 either",
        ),
        (
            "ptu_resolution_deg",
            "distortion = [0.0004, -0.0003, -0.212, 0.63, 0.0]\nptu_resolution_deg",
            "distortion: got p1 = -0.212 and p2 = 0.63, which displace a corner by",
        ),
        (
            "ptu_resolution_deg",
            "covariance = { parameters = ['runway_from_base.z'], matrix = [[400.0]] }\nptu_resolution_deg",
            "matrix: got a variance of 400 for runway_from_base.z; wanted rad² of at most 1",
        ),
        (
            "focal_px",
            "focal_length_px",
            "station left: focal_length_px: got an unknown key; wanted one of camera_clock",
        ),
        (
            "[0.70710678, -0.70710678, 0.0, 0.0]",
            "[0.7, -0.70710678, 0.0, 0.0]",
            "head_from_camera_wxyz: got length 0.99",
        ),
        ("[1.0, 0.0, 0.0, 0.0]", "[1e300, 1e300, 0.0, 0.0]", "wanted a unit quaternion w, x, y, z"),
        (
            "[1.0, 0.0, 0.0, 0.0]",
            "[1.0, 0.0, 0.0]",
            "runway_from_base_wxyz: got [1.0, 0.0, 0.0]; wanted 4 finite numbers",
        ),
        (
            "ptu_position_m = [-5.0,",
            "ptu_position_m = [1e300,",
            "station left: ptu_position_m: got [1e+300, 0.0, 1.5]; wanted metres, at most 100000 of the threshold",
        ),
        ("[64, 48]", "[64.5, 48]", "image_size_px: got [64.5, 48.0]; wanted two whole numbers of pixels"),
        ("[64, 48]", "[64, 1e9]", "image_size_px: got"),
        (
            "[31.5, 23.5]",
            "[5000, 23.5]",
            "principal_point_px: got [5000.0, 23.5]; wanted a point in the picture of 64 × 48",
        ),
        ("0.00625", "-0.00625", "ptu_resolution_deg: got -0.00625; wanted a finite number ≥ 0"),
        ("fixed = false", 'fixed = "no"', "fixed: got 'no'; wanted true or false"),
        ("fixed = false", 'known = ["place"]', "known: got ['place']; wanted a list of position, orientation, lens"),
        ("fixed = false", "ptu_clock = 3", "ptu_clock: got 3; wanted a table"),
        (
            "fixed = false",
            "ptu_clock = { offset = 1 }",
            "ptu_clock: offset: got an unknown key; wanted one of drift_ppm",
        ),
        ("fixed = false", "ptu_clock = { drift_ppm = -2e6 }", "drift_ppm: got -2e+06; wanted at most 10000 either way"),
        ("fixed = false", "ptu_position_m = [1,2,3]", "got not TOML"),
    ],
)
def test_a_fault_names_station_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert message in edited(tmp_path, old, new)


def test_distortion_of_a_lens_without_a_focal_length_is_read(tmp_path: Path) -> None:
    """Expected: read, as a start for a calibration: what it displaces follows from the focal length alone."""
    text = rig_text(["left", "right"])
    line = next(line for line in text.splitlines() if line.startswith("focal_px"))
    known = 'known = ["position"]\ndistortion = [-0.26, 0.07, -0.0001, 0.0002, 0.0]'
    left = load(tmp_path, text.replace(line, known, 1))["left"]
    assert left.lens.distortion.tolist() == [-0.26, 0.07, -0.0001, 0.0002, 0.0]


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ("[[1, 0]]", "matrix: got 1 rows; wanted 2 rows"),
        ("[[1, 0], [0]]", "matrix row 2: row: got [0]; wanted 2 finite numbers"),
        ("[[-1, 0], [0, 1]]", "got a negative variance; wanted a covariance"),
        ("[[1, 0.5], [0.4, 1]]", "got an unsymmetric matrix"),
        ("[[1e-8, 2e-6], [2e-6, 1e-4]]", "got a covariance larger than its variances allow"),
        ("[[0, 1e-9], [1e-9, 1]]", "got a covariance larger than its variances allow"),
        ("7", "matrix: got 7; wanted 2 rows"),
    ],
)
def test_a_covariance_that_is_none(tmp_path: Path, matrix: str, message: str) -> None:
    new = f'fixed = false\ncovariance = {{ parameters = ["focal.x", "focal.y"], matrix = {matrix} }}'
    assert message in edited(tmp_path, "fixed = false", new)


def test_a_covariance_without_a_positive_eigenvalue_everywhere(tmp_path: Path) -> None:
    matrix = "[[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]"
    names = '["ptu_position.x", "ptu_position.y", "ptu_position.z"]'
    new = f"fixed = false\ncovariance = {{ parameters = {names}, matrix = {matrix} }}"
    assert "a negative variance along some direction" in edited(tmp_path, "fixed = false", new)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ('["pan"]', "covariance: parameters: got 'pan'; wanted one of runway_from_base.x, runway_from_base.y, "),
        ('["focal.x", "focal.x"]', "covariance: parameters: got 'focal.x' twice; wanted names that differ"),
        ('"focal.x"', "covariance: parameters: got 'focal.x'; wanted a list of at most"),
    ],
)
def test_a_covariance_without_parameters(tmp_path: Path, parameters: str, message: str) -> None:
    new = f"fixed = false\ncovariance = {{ parameters = {parameters}, matrix = [[1]] }}"
    assert message in edited(tmp_path, "fixed = false", new)


def with_shared(parameters: list[str], matrix: str, more: str = "") -> str:
    own = 'covariance = { parameters = ["focal.x"], matrix = [[9]] }\n' + more
    return rig_text(["left", "right"], more={"left": own}) + (
        f"\n[covariance]\nparameters = {parameters}\nmatrix = {matrix}\n"
    )


def test_what_stations_share(tmp_path: Path) -> None:
    """Two pans that are only known together are in the rig's own table, next to a station's own covariance."""
    pans = ["left.runway_from_base.z", "right.runway_from_base.z"]
    rig = load(tmp_path, with_shared(pans, "[[4e-8, 3.9e-8], [3.9e-8, 4e-8]]"))
    everything = rig.calibration_covariance()
    assert everything.names == ("left.focal.x", *pans)
    np.testing.assert_array_equal(everything.matrix, [[9, 0, 0], [0, 4e-8, 3.9e-8], [0, 3.9e-8, 4e-8]])
    assert load(tmp_path, rig_text(["left", "right"])).calibration_covariance().names == ()


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["left.focal.x"], "covariance: got a variance of 1 for 'left.focal.x'; wanted 9, as its station gives"),
        (["third.focal.x"], "got 'third.focal.x'; wanted station.parameter with one of left, right"),
        (["focal.x"], "got 'focal.x'; wanted station.parameter with one of left, right"),
        (["left.pan"], "got 'left.pan'; wanted one of runway_from_base.x"),
    ],
)
def test_what_stations_cannot_share(tmp_path: Path, names: list[str], message: str) -> None:
    assert message in complaint(RigError, lambda: load(tmp_path, with_shared(names, "[[1]]")))


def test_a_covariance_printed_with_six_digits_is_one(tmp_path: Path, rng: np.random.Generator) -> None:
    scale = np.array([1e-5, 1e-5, 1e-2, 3.0])
    # three directions for four parameters: singular, as when two of them are only known together
    factor = scale[:, None] * rng.normal(size=(4, 3))
    rows = [[float(f"{v:.6g}") for v in row] for row in factor @ factor.T]
    names = '["focal.x", "focal.y", "distortion.k1", "distortion.k2"]'
    more = f"covariance = {{ parameters = {names}, matrix = {rows} }}"
    assert load(tmp_path, rig_text(["left", "right"], more={"left": more}))["left"].covariance.shape == (4, 4)


def test_a_changed_station_projects_as_its_changed_geometry(landing_1: Path, rng: np.random.Generator) -> None:
    station = load_rig(landing_1 / "rig.toml")["left"]
    change = rng.normal(0.0, 1.0, 21) * np.r_[[1e-3] * 3, [0.1] * 3, [1e-3] * 3, [0.01] * 3, [5.0] * 4, [0.01] * 5]
    changed = station.changed(change)
    expected = perturbed_station(station.geometry(), change)
    np.testing.assert_allclose(changed.geometry().packed[:33], expected.packed[:33], atol=1e-12)
    assert (changed.name, changed.ptu_clock, changed.covariance_parameters) == ("left", station.ptu_clock, ())


def test_a_rig_without_orientation_sends_to_calibration(tmp_path: Path) -> None:
    text = rig_text(["left", "right"], more={"left": 'known = ["position"]'})
    left, right = text.split('name = "right"')
    left = "\n".join(line for line in left.splitlines() if "_wxyz" not in line)
    text = f'{left}\nname = "right"{right}'
    rig = load(tmp_path, text)
    assert rig["left"].known == ("position", "lens")
    with pytest.raises(RigError, match=r"station left: got known = .*a calibrated orientation .*calibrate flight"):
        rig.require_known()
    rig.require_known(["position"])


def test_a_fixed_station_needs_no_mounting(tmp_path: Path) -> None:
    text = rig_text(["left", "right"], fixed=["right"])
    head, tail = text.rsplit("head_from_camera_wxyz", 1)
    rig = load(tmp_path, head + tail.split("\n", 1)[1])
    assert rig["right"].fixed
    assert np.allclose(rig["right"].head_from_camera_wxyz, [0.5**0.5, -(0.5**0.5), 0, 0])


def test_a_station_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="got no station 'third'; wanted one of left, right"):
        load(tmp_path, rig_text(["left", "right"]))["third"]


@settings(max_examples=150)
@example(b"\xef\xbb\xbf" + LANDING_RIG.encode())  # a byte order mark is no fault
@given(st.one_of(st.binary(max_size=100), damaged(LANDING_RIG), damaged(rig_text(["left", "right"]))))
def test_arbitrary_bytes_raise_only_project_errors(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    with only(RigError):
        rig = load(tmp_path_factory.getbasetemp(), content)
        assert len(rig.stations) == len(tomllib.loads(content.decode("utf-8-sig"))["station"])
        for station in rig.stations:
            assert np.isclose(np.linalg.norm(station.head_from_camera_wxyz), 1.0)
            assert np.all(station.lens.focal_px > 0)
