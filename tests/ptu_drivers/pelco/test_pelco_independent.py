"""pyptzcontroller, which shares no code with us, drives the simulated Pelco unit over a pseudo terminal."""

import time
from pathlib import Path

import pytest

from ptu_drivers import open_ptu
from ptu_drivers.messages import Axis, Reading
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from tests.peers import peer_module
from tests.ptu_drivers.served import served, transcript

ptz_control_lib = peer_module("pyptzcontroller", "ptz_control_lib")

# what it sent, and what it was answered
TRANSCRIPT = """\
> FF 01 00 51 00 00 52
< FF 01 00 59 00 00 5A
> FF 01 00 53 00 00 54
< FF 01 00 5B 00 00 5C
> FF 01 00 4B 30 39 B5 FF 01 00 4D 88 86 5C
> FF 01 00 51 00 00 52
< FF 01 00 59 30 39 C3
> FF 01 00 53 00 00 54
< FF 01 00 5B 88 86 6A
> FF 01 00 4D 03 20 71
> FF 01 00 51 00 00 52
< FF 01 00 59 30 39 C3
> FF 01 00 53 00 00 54
< FF 01 00 5B 03 20 7F
> FF 01 00 04 3F 00 44
> FF 01 00 00 00 00 01"""

QUICK = PelcoModel(max_rate_deg_s=2000.0, acceleration_deg_s2=40_000.0)


def words(spoken: str) -> list[str]:
    """Return the frames in order, without how they were grouped."""
    frames = []
    for line in spoken.splitlines():
        data = line.split()[1:]
        frames += [line[0] + " " + " ".join(data[i : i + 7]) for i in range(0, len(data), 7)]
    return frames


def until_at_rest(unit: SimulatedPelco) -> None:
    time.sleep(0.05)
    while any(axis.end_s() > time.monotonic() for axis in unit.axes.values()):
        time.sleep(0.01)


def test_pyptzcontroller_drives_the_simulated_unit(tmp_path: Path) -> None:
    unit = SimulatedPelco(QUICK, seed=1)
    path = tmp_path / "unit"
    with served(unit, path) as line:
        client = ptz_control_lib.PtzControl(str(path), address=1, baudrate=9600)
        assert client.connect()
        assert client.get_position() == (0.0, 0.0)
        client.move_to_pan_tilt(123.45, 10.5)
        until_at_rest(unit)
        assert client.get_position() == (123.45, 10.5)
        client.move_to_pan_tilt(tilt_angle=-8.0)
        until_at_rest(unit)
        assert client.get_position() == (123.45, -8.0)
        # its own numbers: pan clockwise, up is positive
        now = time.monotonic()
        assert unit.head_rad(Axis.PAN, now) == pytest.approx(-2.15461, abs=1e-4)
        assert unit.head_rad(Axis.TILT, now) == pytest.approx(-0.139626, abs=1e-4)
        client.move("left", 63)
        time.sleep(0.1)
        assert unit.axes[Axis.PAN].speed(time.monotonic()) > 0
        client.stop()
        until_at_rest(unit)
        client.disconnect()
    assert words(transcript(line)) == words(TRANSCRIPT)


def test_our_driver_and_the_other_client_agree(tmp_path: Path) -> None:
    unit = SimulatedPelco(QUICK, seed=2)
    path = str(tmp_path / "unit")
    with served(unit, Path(path)):
        client = ptz_control_lib.PtzControl(path)
        assert client.connect()
        client.move_to_pan_tilt(30.0, 20.0)
        until_at_rest(unit)
        client.disconnect()
        with open_ptu(path, "pelco-d") as ours:
            got = ours.read()
            assert isinstance(got, Reading)
            assert got.pan.angle_rad == pytest.approx(-0.523599, abs=1e-4)
            assert got.tilt.angle_rad == pytest.approx(0.349066, abs=1e-4)
            ours.move_to(pan_rad=0.3, tilt_rad=-0.2)
            until_at_rest(unit)
        assert client.connect()
        pan, tilt = client.get_position()
        client.disconnect()
    assert pan == pytest.approx(360 - 17.19, abs=0.011)
    assert tilt == pytest.approx(-11.46, abs=0.011)
