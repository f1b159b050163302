"""What the lenses of a station file are kept out of, from the file to the unit; never silently nothing."""

import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.errors import ConfigError
from groundstation.live import head_device, keep_out_zones
from groundstation.live.head_device import HeadDevice
from groundstation.live.keep_out_unit import KeepOutUnit
from groundstation.live.keep_out_zones import open_station_head, sun_text, with_keep_out
from groundstation.live.station_file import StationFile, load_station
from groundstation.pointing.keep_out import LensAxis
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session.folder import GeoOrigin
from tests.complaints import complaint
from tests.live.test_heads import pan_of, simulated_unit
from tests.live.turning_unit import TurningUnit
from tests.stereo_rig import make_rig

NOON_S = datetime(2026, 6, 21, 11, 26, tzinfo=UTC).timestamp()
ORIGIN = "[origin]\nlat_deg = 47.1\nlon_deg = 8.6\nheight_m = 480\ny_axis_azimuth_deg = 35\n"
CLOSED = "sectors = [{ pan_deg = [20, 40], tilt_deg = [-20, 20] }]\n"


def field(folder: Path, tables: str = "", ptu: str = "/dev/null-", left: str = CLOSED) -> Path:
    (folder / "rig.toml").write_text(rig_to_toml(make_rig()), encoding="utf-8")
    text = f'format = "groundstation-station/1"\nrig = "rig.toml"\n{tables}'
    for name in ("left", "right"):
        text += f'[[station]]\nname = "{name}"\ncamera = "file:{name}.avi"\nptu = "{ptu}{name}"\n'
        text += left if name == "left" else ""
    path = folder / "field.toml"
    path.write_text(text, encoding="utf-8")
    return path


def kept(folder: Path, tables: str, utc_s: float = NOON_S) -> StationFile:
    return with_keep_out(load_station(field(folder, tables)), make_rig(), 1000.0, utc_s)


def test_the_sun_and_sectors_are_passed_to_the_heads(tmp_path: Path) -> None:
    left, right = (s.head for s in kept(tmp_path, ORIGIN + "[safety]\nsun_angle_deg = 12\n").stations)
    assert left is not None
    assert right is not None
    assert left.keep_out is not None
    assert right.keep_out is not None
    assert left.keep_out.sun is not None
    assert left.keep_out.sun.angle_rad == pytest.approx(math.radians(12.0))
    (closed,) = left.keep_out.sectors
    assert closed.pan_rad == pytest.approx((math.radians(20), math.radians(40)))
    assert right.keep_out.sectors == ()
    # the clock that showed 1000 s then is the heads'
    assert left.keep_out.utc_zero_s == NOON_S - 1000.0
    up = left.keep_out.zones(1000.0).sun_runway
    assert up is not None
    # the highest of the year, here
    assert math.degrees(math.asin(up[2])) == pytest.approx(90.0 - 47.1 + 23.4, abs=0.2)
    assert left.keep_out.zones(1000.0 + 12 * 3600.0).sun_runway is None


def test_a_head_opened_by_itself_is_kept_out_by_the_rig_and_place_given(tmp_path: Path, monkeypatch) -> None:
    """Expected: zones by another rig and place than the station file's, which are lost and elsewhere."""
    opened: list[HeadDevice] = []
    monkeypatch.setattr(keep_out_zones, "open_head", lambda name, head, clock: opened.append(head))
    path = field(tmp_path, ORIGIN)
    turned = [replace(s, runway_from_base_wxyz=np.array([0.6, 0.0, 0.0, 0.8])) for s in make_rig().stations]
    other = replace(make_rig(), stations=tuple(turned))
    place = GeoOrigin(lat_deg=-47.0, lon_deg=8.6, height_m=480.0, y_axis_azimuth_deg=0.0)
    for given in ({}, {"rig": other, "origin": place}):
        open_station_head(path, "left", lambda: 0.0, lambda: NOON_S, **given)
    own, asked = (head.keep_out for head in opened)
    assert own is not None
    assert asked is not None
    for keep_out, rig in ((own, make_rig()), (asked, other)):
        wanted = LensAxis.of(rig["left"].geometry()).base_from_runway
        assert np.abs(keep_out.lens.base_from_runway - wanted).max() < 1e-12
    up = asked.zones(0.0).sun_runway
    assert up is not None
    # the lowest of the year, there
    assert math.degrees(math.asin(up[2])) == pytest.approx(90.0 - 47.0 - 23.4, abs=0.2)


def test_left_out_it_is_half_the_field_of_view_and_five_degrees(tmp_path: Path) -> None:
    rig = make_rig()
    lens = rig["right"].lens
    half = math.atan(math.hypot(*(0.5 * n / f for n, f in zip(lens.image_size_px, lens.focal_px, strict=True))))
    right = kept(tmp_path, ORIGIN).stations[1].head
    assert right is not None
    assert right.keep_out is not None
    assert right.keep_out.sun is not None
    assert right.keep_out.sun.angle_rad == pytest.approx(half + math.radians(5.0))


@pytest.mark.parametrize(
    ("tables", "good", "reported"),
    [
        (ORIGIN, True, "the Sun is now at azimuth "),
        ("[safety]\nsun_angle_deg = 0\n", True, "the Sun is not avoided: [safety] sun_angle_deg = 0"),
        ("", False, "the Sun is not avoided: no [origin]"),
    ],
)
def test_an_unavoided_sun_is_reported(tmp_path: Path, tables: str, good: bool, reported: str) -> None:
    file = load_station(field(tmp_path, tables))
    found, words = sun_text(file, make_rig(), NOON_S)
    assert found is good
    assert words.startswith(reported)
    heads = [s.head for s in with_keep_out(file, make_rig(), 0.0, NOON_S).stations]
    for head in heads:
        assert head is not None
        assert head.keep_out is not None
        assert (head.keep_out.sun is not None) is (tables == ORIGIN)


def test_a_clock_that_was_never_set_ends_it(tmp_path: Path) -> None:
    reported = complaint(ConfigError, lambda: kept(tmp_path, ORIGIN, utc_s=1000.0))
    assert "this machine's clock: got 1970-01-01 00:16 UTC; wanted a clock that is set" in reported
    kept(tmp_path, ORIGIN + "[safety]\nsun_angle_deg = 0\n", utc_s=1000.0)


def test_an_angle_needs_a_place(tmp_path: Path) -> None:
    path = field(tmp_path, "[safety]\nsun_angle_deg = 12\n")
    assert "origin: got nothing" in complaint(ConfigError, lambda: load_station(path))


def test_a_head_is_opened_guarded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(head_device, "open_ptu", lambda *_, **__: TurningUnit(0.0, 0.0))
    head = kept(tmp_path, ORIGIN).stations[1].head
    assert head is not None
    assert isinstance(head_device.open_head("right", head, lambda: 1000.0), KeepOutUnit)
    assert isinstance(head_device.open_head("right", replace(head, keep_out=None), lambda: 1000.0), TurningUnit)


def test_moves_by_hand_keep_out_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: into the sector, and through it, refused with exit code 1, and nothing moved; before it, done."""
    path = str(field(tmp_path, "[safety]\nsun_angle_deg = 0\n", ptu=f"{tmp_path}/"))
    with simulated_unit(tmp_path / "left") as server:
        for pan in ("30", "60"):
            assert main(["ptu", "jog", "--station", path, "left", "--pan", pan]) == 1
            assert "wanted a way clear of sector 1 (20.0° outside)" in capsys.readouterr().err
            assert pan_of(server, 1e9) == pytest.approx(0.0, abs=1e-4)
        assert main(["ptu", "jog", "--station", path, "left", "--pan", "5", "--rate", "20"]) == 0
        reported = capsys.readouterr()
        assert "reached" in reported.out
        assert reported.err == ""


def test_moves_by_url_report_the_absence_of_zones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with simulated_unit(tmp_path / "left"):
        assert main(["ptu", "jog", f"{tmp_path}/left", "--pan", "1", "--rate", "20"]) == 0
    assert "nothing keeps the lens from the Sun or closed sectors" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "code", "reported"),
    [
        ([], 2, "got no URL; wanted one, or --station FILE NAME"),
        (["/dev/ttyUSB0", "--station", "FILE", "left"], 2, "got URL and --station"),
        (["--station", "FILE", "left", "--baud", "9600"], 2, "got --baud and --station"),
        (["--station", "FILE", "middle"], 1, "station: got middle; wanted one with a head: left, right"),
    ],
)
def test_what_does_not_go_together_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], code: int, reported: str
) -> None:
    path = str(field(tmp_path, "[safety]\nsun_angle_deg = 0\n"))
    words = [path if word == "FILE" else word for word in more]
    assert main(["ptu", "jog", *words, "--pan", "1"]) == code
    assert reported in capsys.readouterr().err
