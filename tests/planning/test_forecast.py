"""The forecast against closed forms and against what is known of such stations; its reader against slips of the pen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from groundstation.errors import InputError, RigError, SiteError
from groundstation.planning.forecast import Forecast, forecast, site_map
from groundstation.planning.observer import Observer
from groundstation.planning.plan_table import format_plan, plan_csv, verdict
from groundstation.planning.site import Site
from groundstation.planning.site_file import load_site
from groundstation.rig.rig import ClockModel, Rig
from tests.complaints import complaint, only
from tests.mutation import damaged
from tests.stereo_rig import make_rig

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "site-example.toml"
# 0.5 px, quantisation alone, nothing else wrong
EXACT = """
baseline_m = 10.77
height_m = 1.5
[camera]
focal_px = 6667
image_size_px = [1280, 960]
pixel_sigma_px = 0.5
[ptu]
resolution_deg = 0.00625
sigma_deg = 0
[aircraft]
span_m = 2.3
speed_m_s = 25
touchdown_y_m = 60
acceleration_psd_m2_s3 = [0.05, 0.1, 0.05]
[range]
from_m = 100
to_m = 600
step_m = 100
"""


def load(folder: Path, text: str | bytes) -> Site:
    path = folder / "site.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_site(path)


def at(f: Forecast, y_m: float, values: np.ndarray) -> np.ndarray:
    return values[int(np.flatnonzero(f.range_m == y_m)[0])]


def with_calibration(folder: Path, keys: str, more: str = "") -> Forecast:
    return forecast(load(folder, EXACT + f"[calibration]\n{keys}\n{more}"))


# ------------------------------------------------------------------------------------------------ figures
def test_noise_alone_meets_the_known_table(tmp_path: Path) -> None:
    f = forecast(load(tmp_path, EXACT))
    for y_m, fix, track in (
        (100.0, (0.006, 0.107, 0.006), (0.004, 0.046, 0.004)),
        (200.0, (0.0115, 0.43, 0.019), (0.007, 0.13, 0.009)),
        (400.0, (0.023, 1.71, 0.086), (0.0125, 0.38, 0.022)),
    ):
        np.testing.assert_allclose(at(f, y_m, f.fix_noise_m), fix, rtol=0.05, atol=0.0006)
        np.testing.assert_allclose(at(f, y_m, f.track_noise_m), track, rtol=0.06, atol=0.0006)
    np.testing.assert_array_equal(f.fix_noise_m, f.fix_sigma_m)
    assert f.groups == ("pixel noise", "encoder noise")
    # (0.5 px / f)² against quantisation²
    pixels = (0.5 / 6667) ** 2 / ((0.5 / 6667) ** 2 + np.radians(0.00625) ** 2 / 12)
    np.testing.assert_allclose(f.share[:, 1, 0], pixels, rtol=1e-3)


def test_silhouette_picture_and_turning(tmp_path: Path) -> None:
    f = forecast(load(tmp_path, EXACT))
    assert at(f, 200.0, f.silhouette_px) == pytest.approx(2.3 * 6667 / 200, rel=0.01)
    assert at(f, 200.0, f.field_m) == pytest.approx(1280 * 200 / 6667, rel=0.01)
    # seen from half a baseline aside the direction turns at v·(b/2)/y²; the descent turns tilt less
    assert at(f, 200.0, f.turn_rad_s) == pytest.approx(25 * 5.385 / 200**2, rel=0.02)
    assert at(f, 200.0, f.stations) == 2


def test_a_pan_of_a_hundredth_of_a_degree(tmp_path: Path) -> None:
    """Two pans of 0.01°/√2 make 0.01° between them: 0.65 m at 200 m, tracked or not, and it is called by its name."""
    f = with_calibration(tmp_path, f"mount_pan_deg = {0.01 / 2**0.5}")
    floor = np.sqrt(f.fix_sigma_m**2 - f.fix_noise_m**2)
    assert at(f, 200.0, floor)[1] == pytest.approx(0.65, rel=0.01)
    assert at(f, 400.0, floor)[1] == pytest.approx(2.6, rel=0.01)
    assert at(f, 200.0, f.track_sigma_m)[1] == pytest.approx(0.65, rel=0.05)
    assert f.groups[int(np.argmax(at(f, 200.0, f.share)[1]))] == "mount pan"


def test_clocks_move_the_point_along_the_track(tmp_path: Path) -> None:
    """10 ms between the stations are 10 ms/√2 each, and their mean is 5 ms of flight; a late PTU does the same."""
    f = with_calibration(tmp_path, "camera_camera_s = 0.01")
    floor = np.sqrt(f.fix_sigma_m**2 - f.fix_noise_m**2)
    assert at(f, 200.0, floor)[1] == pytest.approx(25 * 0.005, rel=0.05)
    late = with_calibration(tmp_path, "camera_ptu_s = 0.02")
    floor = np.sqrt(late.fix_sigma_m**2 - late.fix_noise_m**2)
    assert at(late, 200.0, floor)[1] == pytest.approx(25 * 0.02 / 2**0.5, rel=0.05)
    assert set(late.groups) == {"pixel noise", "encoder noise", "PTU clock"}


def test_whose_clock_is_late(tmp_path: Path) -> None:
    """A PTU's late camera alone has no effect, because its angles give the motion; a fixed one is off by J·v."""
    late = ClockModel(sigma_s=0.01)
    site = load(tmp_path, EXACT)
    rig = Rig(
        stations=tuple(replace(s, camera_clock=late, ptu_clock=late) for s in make_rig().stations),
    )
    point, velocity = np.array([0.0, 300.0, 12.0]), np.array([1.0, -25.0, -1.0])
    observer = Observer(replace(site, rig=rig))
    assert observer.sources.names[:2] == ("left.camera_clock", "left.ptu_clock")
    left = observer.observations(point, velocity)[0]
    projected = left.view.geometry.project(point, left.view.pan_rad, left.view.tilt_rad)
    assert projected is not None
    moved = projected.jacobian[:, :3] @ velocity
    np.testing.assert_allclose(left.by_source[:, 0], 0.0, atol=1e-9 * np.abs(moved).max())
    np.testing.assert_allclose(left.by_source[:, 1], moved)
    np.testing.assert_array_equal(left.by_source[:, 2:], 0.0)
    still = Rig(stations=tuple(replace(s, fixed=True) for s in rig.stations))
    fixed = Observer(replace(site, rig=still))
    assert fixed.sources.names == ("left.camera_clock", "right.camera_clock")
    left = fixed.observations(point, velocity)[0]
    projected = left.view.geometry.project(point, 0.0, 0.0)
    assert projected is not None
    np.testing.assert_allclose(left.by_source[:, 0], projected.jacobian[:, :3] @ velocity)
    assert left.turn_rad_s == 0.0
    assert fixed.observations(np.array([200.0, 300.0, 12.0]), velocity) == [], "outside the picture of a fixed camera"


def test_shares_add_up(tmp_path: Path) -> None:
    f = forecast(load_site(EXAMPLE))
    np.testing.assert_allclose(f.share.sum(axis=2), 1.0)
    assert f.share.min() >= 0.0
    assert np.all(f.fix_sigma_m >= f.fix_noise_m)
    assert np.all(f.track_noise_m <= f.fix_noise_m * (1 + 1e-9))


def test_a_narrow_aircraft_is_not_followed(tmp_path: Path) -> None:
    text = EXACT.replace("pixel_sigma_px = 0.5", "pixel_sigma_px = 0.5\nmin_silhouette_px = 40")
    f = forecast(load(tmp_path, text))
    np.testing.assert_array_equal(f.track_known, f.range_m <= 2.3 * 6667 / 40)
    assert f.fix_known.all()


def test_the_bundled_rig_by_its_name(tmp_path: Path, landing_1: Path) -> None:
    rig = f'rig = "{landing_1 / "rig.toml"}"\n[aircraft]\nspan_m = 2.3\nspeed_m_s = 25\n'
    site = load(tmp_path, rig)
    assert site.rig.names == ("left", "right")
    assert Observer(site).sources.groups == ("PTU clock", "PTU clock")
    # the site's own calibration takes the place of the rig's
    site = load(tmp_path, rig + "[calibration]\nmount_pan_deg = 0.02\n")
    assert Observer(site).sources.groups == ("mount pan", "mount pan")
    assert forecast(replace(site, step_m=300.0)).fix_known.all()


def test_the_map_is_lowest_between_the_stations(tmp_path: Path) -> None:
    sigma = site_map(load(tmp_path, EXACT), np.array([-20.0, 0.0, 20.0]), np.array([60.0, 300.0]))
    assert sigma.shape == (2, 3)
    assert sigma[0, 1] == sigma.min()
    np.testing.assert_allclose(sigma[:, 0], sigma[:, 2], rtol=1e-6)


# ------------------------------------------------------------------------------------------------- words
def test_what_it_is_good_enough_for(tmp_path: Path) -> None:
    wanted = "[required_sigma_m]\nall = [1, 9, 1]\nsome = [1, 0.6, 1]\nnone = [1, 0.001, 1]\n"
    site = load(tmp_path, EXACT + "[calibration]\nmount_pan_deg = 0.007\n" + wanted)
    f = forecast(site)
    assert verdict(site, f, site.required[0]) == "good enough for all (1/9/1 m) at all ranges"
    words = verdict(site, f, site.required[1])
    assert words == "good enough for some (1/0.6/1 m) at 100 m; at 200 m y is 0.65 m, mostly mount pan"
    assert verdict(site, f, site.required[2]).startswith("not good enough for none (1/0.001/1 m): at 100 m y is ")
    text = format_plan(site, f)
    assert text.count("\n") >= 12
    assert "y: mount pan" in text
    assert all(len(line) <= 120 for line in text.splitlines())


def test_an_aircraft_wider_than_the_picture_is_good_enough_for_nothing(tmp_path: Path) -> None:
    """Expected: at 100 m a span of 2.3 m and 6667 px of focal length are 153 px; 20 times as much is too large."""
    text = EXACT.replace("image_size_px = [1280, 960]", "image_size_px = [140, 105]")
    site = load(tmp_path, text + "[required_sigma_m]\nflare = [1, 900, 1]\n")
    reported = format_plan(site, forecast(site))
    assert "the aircraft fills the picture at 100 m: a shorter focal length" in reported
    assert "good enough for flare (1/900/1 m) at 200-600 m; " in reported


def test_an_invisible_target_is_reported(tmp_path: Path) -> None:
    text = EXACT.replace("pixel_sigma_px = 0.5", "min_silhouette_px = 500")
    site = load(tmp_path, text + "[required_sigma_m]\nflare = [1, 1, 1]\n")
    reported = format_plan(site, forecast(site))
    assert "! narrower than 500 px at 100-600 m: not expected to be found" in reported
    assert "not good enough for flare (1/1/1 m): it is never followed by two stations" in reported
    assert "the mounting is taken as exact" in reported


def test_the_table_as_csv(tmp_path: Path) -> None:
    text = EXACT.replace("pixel_sigma_px = 0.5", "min_silhouette_px = 40")
    lines = plan_csv(forecast(load(tmp_path, text))).splitlines()
    head = lines[0].split(",")
    assert head[:3] == ["range_m", "stations", "fix_noise_sigma_x_m"]
    assert len(lines) == 7
    far = dict(zip(head, lines[-1].split(","), strict=True))
    assert far["track_sigma_y_m"] == ""
    assert float(far["fix_sigma_y_m"]) > 3


# ------------------------------------------------------------------------------------------------- input
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("baseline_m = 10.77", "", "got no stations; wanted one of rig, baseline_m, [[station]]"),
        ("baseline_m = 10.77", 'baseline_m = 1\nrig = "r"', "got rig and baseline_m; wanted one of rig, baseline_m, "),
        ("baseline_m", "baseline", "baseline: got an unknown key; wanted one of aircraft, baseline_m"),
        ("baseline_m = 10.77", "baseline_m = 0", "baseline_m: got 0; wanted a finite number ≥ 0.01"),
        ("baseline_m = 10.77", 'format = "x/2"\nbaseline_m = 1', "format: got 'x/2'; wanted 'groundstation-site/1'"),
        ("focal_px = 6667", "", "camera: focal_mm: got nothing; wanted a finite number > 0"),
        ("focal_px = 6667", "focal_px = 1\nfocal_mm = 2", "focal_px: got it together with focal_mm or pixel_um"),
        (
            "focal_px = 6667",
            "focal_mm = 25000\npixel_um = 3.75",
            "camera: focal_mm: got 25000; wanted a finite number > 0",
        ),
        (
            "focal_px = 6667",
            "focal_mm = 25\npixel_um = 0.00375",
            "camera: pixel_um: got 0.00375; wanted a finite number > 0, 0.3 to 200 µm; is it in mm?",
        ),
        ("focal_px = 6667", "focal_mm = 25\npixel_um = 3750", "pixel_um: got 3750; wanted a finite number > 0, 0.3 to"),
        ("focal_px = 6667", "focal_mm = 25000\npixel_um = 3.75", "0.5 to 10000 mm; is it in µm?"),
        ("focal_px = 6667", "focal_mm = 9\npixel_um = 1e9", "focal_mm: got 9e-06 pixels of 1e+09 µm; wanted 1 to 10"),
        ("[1280, 960]", "[1280, 960.5]", "image_size_px: got [1280.0, 960.5]; wanted two whole numbers"),
        ("sigma_deg = 0", "sigma = 0", "ptu: sigma: got an unknown key; wanted one of resolution_deg, sigma_deg"),
        ("span_m = 2.3", "span_m = -1", "aircraft: span_m: got -1; wanted a finite number ≥ 0.01 ≤ 200"),
        ("[0.05, 0.1, 0.05]", "[0.05, -0.1, 0.05]", "wanted three numbers from 0 to a million"),
        ("from_m = 100", "from_m = 600", "range: to_m: got 600; wanted a finite number > 600"),
        ("step_m = 100", "step_m = 1e-3", "step_m: got 0.001; wanted at least 2.5: 200 ranges"),
        ("speed_m_s = 25", "speed_m_s = 0.1", "frame_rate_hz: got 30, 150000 frames in all; wanted at most 20000"),
        ("[range]", "[calibration]\nmount_pan_deg = 11\n[range]", "mount_pan_deg: got 11; wanted a finite number ≥ 0"),
        (
            "[range]",
            "[calibration]\npan_deg = 1\n[range]",
            "calibration: pan_deg: got an unknown key; wanted one of bo",
        ),
        ("[range]", "[required_sigma_m]\nx = [1, 0, 1]\n[range]", "x: got [1.0, 0.0, 1.0]; wanted 1 sigma of x, y, z"),
    ],
)
def test_a_fault_names_table_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in EXACT
    reported = complaint(SiteError, lambda: load(tmp_path, EXACT.replace(old, new, 1)))
    assert message in reported
    assert reported.startswith(str(tmp_path / "site.toml"))


@pytest.mark.parametrize(
    ("stations", "message"),
    [
        ("[[station]]\nposition_m = [0, 0, 1]\n", "station: got 1 of them; wanted 2 to 64 [[station]] tables"),
        (
            '[[station]]\nname = "a"\nposition_m = [0, 0, 1]\n' * 2,
            "name: got 'a'; wanted letters, digits, - and _, dif",
        ),
        ("[[station]]\nposition_m = [0, 0]\n" * 2, "station 1: position_m: got [0, 0]; wanted 3 finite numbers"),
        ("[[station]]\nposition_m = [0, 0, 1e9]\n" * 2, "wanted three numbers of at most 20000 m"),
        ("height_m = 2\n[[station]]\nposition_m = [0, 0, 1]\n", "height_m: got it together with [[station]]; wanted"),
    ],
)
def test_stations_that_are_none(tmp_path: Path, stations: str, message: str) -> None:
    text = EXACT.replace("baseline_m = 10.77\nheight_m = 1.5\n", stations)
    assert message in complaint(SiteError, lambda: load(tmp_path, text))


def test_a_rig_has_its_own_lens_and_encoders(tmp_path: Path) -> None:
    both = EXACT.replace("baseline_m = 10.77\nheight_m = 1.5\n", 'rig = "rig.toml"\n')
    assert "it together with rig; wanted one of them" in complaint(SiteError, lambda: load(tmp_path, both))
    alone = 'rig = "rig.toml"\n[aircraft]\nspan_m = 2\nspeed_m_s = 20\n'
    assert "rig.toml: got no such file" in complaint(RigError, lambda: load(tmp_path, alone))


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@example(EXACT.replace("height_m = 1.5", "height_m = 1000").encode())
@example(EXACT.replace("baseline_m = 10.77", "baseline_m = 0.01").encode())
@given(st.one_of(damaged(EXACT), damaged(EXAMPLE.read_text(encoding="utf-8"))))
def test_arbitrary_files_raise_only_project_errors(tmp_path: Path, content: bytes) -> None:
    with only(InputError):
        site = load(tmp_path, content)
        # few frames: it is the arithmetic that is tried
        f = forecast(replace(site, frame_rate_hz=1.0, step_m=(site.to_m - site.from_m) / 3))
        assert np.isfinite(f.track_sigma_m).all()
        assert format_plan(site, f)


def test_the_units_numbers_are_in_radians(tmp_path: Path) -> None:
    (left, right) = load(tmp_path, EXACT.replace("sigma_deg = 0", "sigma_deg = 0.02")).rig.stations
    for station in (left, right):
        assert station.ptu_sigma_rad == pytest.approx(np.radians(0.02))
        assert station.ptu_resolution_rad == pytest.approx(np.radians(0.00625))


def test_a_rig_with_a_pose_unknown_is_refused(tmp_path: Path, landing_1: Path) -> None:
    text = (landing_1 / "rig.toml").read_text(encoding="utf-8")
    open_pose = text.replace('name = "left"\n', 'name = "left"\nknown = ["lens"]\n')
    (tmp_path / "rig.toml").write_text(open_pose, encoding="utf-8")
    with pytest.raises(RigError, match="wanted a calibrated position and orientation"):
        load(tmp_path, 'rig = "rig.toml"\n[aircraft]\nspan_m = 2.3\nspeed_m_s = 25\n')
