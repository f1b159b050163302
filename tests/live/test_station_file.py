"""The station file: its values are used, and a wrong one is reported in one line."""

import math
from pathlib import Path

import pytest

from groundstation.errors import ConfigError
from groundstation.live.devices import camera_of, check_against_rig
from groundstation.live.head_device import head_settings
from groundstation.live.reference_device import ReferenceDevice, sender_networks
from groundstation.live.station_file import load_station
from groundstation.rig.rig import load_rig
from tests.complaints import complaint

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "station-example.toml"
ORIGIN = """[origin]
lat_deg = 47.1
lon_deg = 8.6
height_m = 480
y_axis_azimuth_deg = 35
"""
WHOLE = """
format = "groundstation-station/1"
name = "North field"
rig = "rig.toml"
rate_hz = 25
[target]
span_m = 2.3
antenna_in_body_m = [-0.8, 0, -0.1]
[origin]
lat_deg = 47.1
lon_deg = 8.6
height_m = 480
y_axis_azimuth_deg = 35
[reference]
url = "udp://0.0.0.0:5000"
senders = ["192.168.1.20", "10.0.0.0/8"]
clock_sigma_s = 0.02
learn = false
[record]
folder = "flights"
[pointing]
gain_per_s = 3.0
[search]
azimuth_deg = [-8, 4.5]
[[station]]
name = "left"
camera = "gige:192.168.1.10"
camera_settings = { exposure_s = 0.003, gain = 6.0, pixel_format = "BayerRG8", transfer_s = 0.011 }
ptu = "/dev/ttyUSB0"
ptu_settings = { pan_sign = -1, tilt_zero_deg = 1.5, pan_low_deg = -80, pan_high_deg = 80, baud = 115200, poll_hz = 50 }
park_deg = [0, 20]
[[station]]
name = "right"
camera = "opencv:0"
ptu = "socket://192.168.1.21:4000"
ptu_protocol = "pelco-d"
ptu_options = { address = 2 }
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "station.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_is_read(tmp_path: Path) -> None:
    file = load_station(written(tmp_path, WHOLE))
    assert (file.name, file.rate_hz, file.span_m) == ("North field", 25.0, 2.3)
    assert file.rig == tmp_path / "rig.toml"
    assert file.record == tmp_path / "flights"
    assert file.record_s == 1800.0
    assert file.park_s is None
    assert file.pointing.gain_per_s == 3.0
    assert file.search.azimuth_deg == (-8.0, 4.5)
    assert file.antenna_in_body_m == (-0.8, 0.0, -0.1)
    assert file.origin is not None
    assert (file.origin.lat_deg, file.origin.y_axis_azimuth_deg) == (47.1, 35.0)
    senders = sender_networks(["192.168.1.20/32", "10.0.0.0/8"], "test")
    assert file.reference == ReferenceDevice(url="udp://0.0.0.0:5000", clock_sigma_s=0.02, learn=False, senders=senders)
    left, right = file.stations
    assert left.head is not None
    assert right.head is not None
    settings = head_settings(left.head)
    assert (settings.pan.sign, settings.tilt.sign) == (-1, 1)
    assert settings.tilt.zero_rad == pytest.approx(math.radians(1.5))
    assert settings.pan.high_rad == pytest.approx(math.radians(80))
    assert settings.tilt.high_rad == math.inf
    assert settings.baud == 115200
    assert left.head.poll_s == 0.02
    assert left.head.park_rad == pytest.approx((0.0, math.radians(20)))
    assert (right.head.protocol, right.head.options) == ("pelco-d", {"address": 2})


def test_the_example_of_the_docs_is_one() -> None:
    file = load_station(EXAMPLE)
    assert [s.name for s in file.stations] == ["left", "right"]


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ('format = "groundstation-station/1"', 'format = "other"', "format: got 'other'"),
        ('senders = ["192.168.1.20", "10.0.0.0/8"]', "", "senders: got none for udp://0.0.0.0:5000"),
        ('senders = ["192.168.1.20", "10.0.0.0/8"]', 'senders = "10.0.0.1"', "senders: got '10.0.0.1'"),
        ('senders = ["192.168.1.20", "10.0.0.0/8"]', 'senders = ["10.0.0.1/8"]', "senders: got '10.0.0.1/8'"),
        ('url = "udp://0.0.0.0:5000"', 'url = "udp://*:5000"', "url: got udp://*:5000"),
        ("rate_hz = 25", "rate_hz = 0", "rate_hz: got 0"),
        ("rate_hz = 25", "rate = 25", "rate: got an unknown key"),
        (ORIGIN, ORIGIN + "[safety]\nsun_deg = 5\n", "safety: sun_deg: got an unknown key"),
        (ORIGIN, ORIGIN + "[safety]\nsun_angle_deg = -1\n", "sun_angle_deg: got -1"),
        ("park_deg = [0, 20]", "sectors = 3", "sectors: got 3"),
        ("park_deg = [0, 20]", "sectors = [{ pan_deg = [0, 5] }]", "sectors 1: tilt_deg: got nothing"),
        ("park_deg = [0, 20]", "sectors = [{ pan_deg = [5, 5], tilt_deg = [0, 9] }]", "pan_deg: got [5, 5]"),
        ('name = "right"', 'name = "left"', "two of one name"),
        ("pan_sign = -1", "pan_sign = 2", "pan_sign: got 2"),
        ("pan_low_deg = -80", "pan_low_deg = 81", "pan_low_deg: got 81 and pan_high_deg 80; wanted low below high"),
        (
            "park_deg = [0, 20]",
            "park_deg = [81, 20]",
            "park_deg: got pan 81; wanted between pan_low_deg -80 and pan_high",
        ),
        ("baud = 115200, poll_hz = 50", "baud = 20, poll_hz = 50", "baud: got 20; wanted 0, or 50 and more"),
        ("pan_low_deg = -80", "pan_low = -80", "pan_low: got an unknown key"),
        ("gain_per_s = 3.0", "gain = 3.0", "gain"),
        ("azimuth_deg = [-8, 4.5]", "azimuth_deg = [4.5, -8]", "azimuth_deg"),
        # a compass bearing
        (
            "azimuth_deg = [-8, 4.5]",
            "azimuth_deg = [262, 275]",
            "search: got azimuth_deg = [262.0, 275.0]; wanted a value inside its bounds: "
            "azimuth_deg and elevation_deg must be from -80 to 80",
        ),
        ("azimuth_deg = [-8, 4.5]", "range_m = -5\nlost_s = 3", "search: got range_m = -5.0, lost_s = 3.0; wanted"),
        ("park_deg = [0, 20]", "park_deg = [0]", "park_deg: got [0]"),
        ('camera = "opencv:0"', "", "camera: got nothing"),
        (
            'camera = "opencv:0"',
            'camera = "gigi:192.168.1.11"',
            "camera: got 'gigi:192.168.1.11'; wanted genicam:SERIAL",
        ),
        ('camera = "opencv:0"', 'camera = "gigi:192.168.1.11"', "did you mean gige:192.168.1.11?"),
        (
            'camera = "opencv:0"',
            'camera = "gige:192.168.1.11?foo=1"',
            "station.toml: station 2: camera: got option 'foo'; wanted packet",
        ),
        ('camera = "opencv:0"', 'camera = "basler:1"', "opencv:0, opencv:/dev/video0, rtsp://…"),
        ("learn = false", "learn = 0", "reference: learn: got 0"),
        ('url = "udp://0.0.0.0:5000"', "", "reference: url: got nothing"),
        ("clock_sigma_s = 0.02", "clock_sigma_s = 0", "clock_sigma_s: got 0"),
        ("clock_sigma_s = 0.02", "clock = 1", "clock: got an unknown key"),
        (ORIGIN, "", "origin: got nothing; wanted a table [origin]"),
        (ORIGIN, ORIGIN + "[view]\nbogus = 1\n", "view: got an unknown key"),
        ('folder = "flights"', 'folder = "flights"\nminutes = 0', "minutes: got 0"),
        ("rate_hz = 25", "rate_hz = 25\npark_s = -1", "park_s: got -1"),
        ('ptu = "socket://192.168.1.21:4000"', 'ptu = "/dev/../dev/ttyUSB0"', "as the PTU of left and of right"),
        ('camera = "opencv:0"', 'camera = "gige:192.168.1.10"', "gige:192.168.1.10 as the camera of left and of right"),
        ("lat_deg = 47.1", "lat_deg = 97.1", "origin: lat_deg: got 97.1"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, reported: str) -> None:
    assert old in WHOLE
    with pytest.raises(ConfigError) as fault:
        load_station(written(tmp_path, WHOLE.replace(old, new)))
    assert reported in str(fault.value)
    assert "station.toml" in str(fault.value)
    assert "\n" not in str(fault.value)


def test_it_has_to_fit_the_rig(tmp_path: Path) -> None:
    rig = load_rig(Path(__file__).resolve().parents[2] / "recordings" / "landing-1" / "rig.toml")
    check_against_rig(load_station(written(tmp_path, WHOLE)), rig)
    other = load_station(written(tmp_path, WHOLE.replace('name = "right"', 'name = "north"')))
    with pytest.raises(ConfigError, match=r"got left, north; wanted the stations of rig.toml: left, right"):
        check_against_rig(other, rig)
    without = load_station(written(tmp_path, WHOLE.replace('ptu = "/dev/ttyUSB0"\n', "")))
    with pytest.raises(ConfigError, match="got none; wanted the PTU's URL"):
        check_against_rig(without, rig)


def test_an_unknown_camera_setting(tmp_path: Path) -> None:
    file = load_station(written(tmp_path, WHOLE.replace("gain = 6.0", "gian = 6.0")))
    with pytest.raises(ConfigError, match="gian: got an unknown key"):
        camera_of(file.stations[0], lambda: 0.0, lambda _: None, rate_hz=25.0)


def test_two_addresses_behind_one_server_are_two_heads(tmp_path: Path) -> None:
    server = 'ptu = "socket://192.168.1.21:4000"\nptu_protocol = "pelco-d"'
    text = WHOLE.replace('ptu = "/dev/ttyUSB0"', server + "\nptu_options = { address = 1 }")
    assert len(load_station(written(tmp_path, text)).stations) == 2
    with pytest.raises(ConfigError, match=r"got socket://192\.168\.1\.21:4000 as the PTU of left and of right"):
        load_station(written(tmp_path, text.replace("address = 1", "address = 2")))


@pytest.mark.parametrize(
    ("key", "missing"), [("rig", "rig.toml"), ("config", "night.toml"), ("landing_site", "x.toml")]
)
def test_a_missing_file_is_named_with_the_key(tmp_path: Path, key: str, missing: str) -> None:
    """Expected: station file, key and path in one line, for the rig also where the key is left to its default."""
    text = "".join(line for line in WHOLE.splitlines(keepends=True) if not line.startswith((f"{key} =", "rig =")))
    text = text.replace("[target]", f'{key} = "{missing}"\n[target]' if key != "rig" else "[target]", 1)
    for name in {"rig.toml", "night.toml", "tuning.toml"} - {missing}:
        (tmp_path / name).write_text("", encoding="utf-8")
    path = written(tmp_path, text)
    said = complaint(ConfigError, lambda: load_station(path).load_rig())
    assert said.startswith(f"{path}: {key}: got {tmp_path / missing} (no such file); wanted a file")


def test_a_camera_that_is_not_opened_may_be_a_placeholder(tmp_path: Path) -> None:
    """`calibrate sky` and `calibrate stars` use the file for its rig and site where pictures have been taken."""
    path = written(tmp_path, WHOLE.replace('camera = "opencv:0"', 'camera = "none"'))
    assert load_station(path, opens_cameras=False).stations[1].camera == "none"
    assert "station 2: camera: got 'none'; wanted" in complaint(ConfigError, lambda: load_station(path))
