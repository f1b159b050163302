"""The Alpaca driver drives `alpaca-simulators`, an independent implementation.

It requires astronomy packages of 250 MB, so it is installed in a separate environment (`make peers`) or in
GROUNDSTATION_ALPACA_SIMULATORS. Without it these tests are skipped, or fail (tests/peers.py).
"""

import math
import os
import re
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ptu_drivers import open_ptu
from ptu_drivers.errors import LineError, PtuError
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import Capability, NoReading, Reading
from ptu_drivers.settings import AxisSettings, UnitSettings
from tests.peers import absent

ROOT = Path(__file__).resolve().parents[3]
PATIENT = UnitSettings(reply_timeout_s=2.0)
# what the server's log has, without repeated lines
TRANSCRIPT = """\
GET connected 200
PUT connected 200
GET atpark 200
PUT unpark 200
GET tracking 200
GET canslewaltazasync 200
GET alignmentmode 200
GET name 200
GET driverversion 200
GET devicestate 200
PUT slewtoaltazasync 200
GET devicestate 200
PUT abortslew 200"""

Serve = Callable[..., tuple[str, Path, subprocess.Popen[bytes]]]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Start the simulator with changes to its configuration; gives its address and log."""
    program = os.environ.get("GROUNDSTATION_ALPACA_SIMULATORS", str(ROOT / ".venv-peers/bin/alpaca-simulators"))
    if not Path(program).is_file():
        absent("alpaca-simulators", "make peers")
    running = []

    def start(**changes: float) -> tuple[str, Path, subprocess.Popen[bytes]]:
        home = Path(program).resolve().parent.parent
        (template,) = home.glob("lib/python*/site-packages/alpaca_simulators/config/template.yaml")
        text = template.read_text(encoding="utf-8")
        head, sep, scope = text.partition("  telescope:\n")
        for name, value in changes.items():
            scope, n = re.subn(rf"(\n      {name}: )\S+", rf"\g<1>{value}", scope, count=1)
            assert n == 1
        config = tmp_path / "config.yaml"
        config.write_text(head + sep + scope, encoding="utf-8")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        log = tmp_path / "log"
        arguments = [program, "--host", "127.0.0.1", "--port", str(port), "--config", str(config)]
        with log.open("w") as out:
            running.append(subprocess.Popen(arguments, stdout=out, stderr=out, cwd=tmp_path))
        return f"http://127.0.0.1:{port}", log, running[-1]

    yield start
    for process in running:
        process.terminate()
        process.wait()


def opened(url: str, settings: UnitSettings = PATIENT) -> PanTiltUnit:
    end = time.monotonic() + 60
    while True:
        try:
            return open_ptu(url, "alpaca", settings)
        except LineError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def reading(unit: PanTiltUnit) -> Reading:
    got = unit.read()
    assert isinstance(got, Reading), got
    return got


def until(unit: PanTiltUnit, pan_deg: float, tilt_deg: float) -> None:
    end = time.monotonic() + 30
    while time.monotonic() < end:
        got = reading(unit)
        if math.hypot(math.degrees(got.pan.angle_rad) - pan_deg, math.degrees(got.tilt.angle_rad) - tilt_deg) < 1e-3:
            return
        time.sleep(0.05)
    raise AssertionError(f"not at {pan_deg}, {tilt_deg} but at {got}")


def test_positions_and_halt(serve: Serve) -> None:
    url, log, _ = serve()
    facing_west = UnitSettings(pan=AxisSettings(zero_rad=math.radians(-270.0)), reply_timeout_s=2.0)
    with opened(url, facing_west) as unit:
        unit.move_to(pan_rad=math.radians(10.0), tilt_rad=math.radians(50.0))
        until(unit, 10.0, 50.0)
    with opened(url) as north:
        # the same direction with zero in the north: azimuth 260 is pan 100
        got = reading(north)
        assert math.degrees(got.pan.angle_rad) == pytest.approx(100.0, abs=1e-2)
        north.move_to(pan_rad=math.radians(-120.0))
        time.sleep(0.5)
        north.halt()
        stopped = reading(north)
        time.sleep(0.5)
        assert reading(north).pan.angle_rad == pytest.approx(stopped.pan.angle_rad, abs=1e-4)
        assert abs(math.degrees(stopped.pan.angle_rad) + 120.0) > 20.0
    lines = re.findall(r'"(GET|PUT) /api/v1/telescope/0/(\w+)\S* HTTP/1.1" (\d+)', log.read_text())
    spoken = [" ".join(line) for line in lines]
    once = [line for line, before in zip(spoken, ["", *spoken], strict=False) if line != before]
    assert "\n".join(once[: TRANSCRIPT.count("\n") + 1]) == TRANSCRIPT


def test_rates_of_an_alt_azimuth_mount_and_its_end(serve: Serve) -> None:
    """Its second axis turns declination, which at the pole is altitude; its first one grows the other way there."""
    url, _, server = serve(alignmentmode=0, sitelatitude=90.0, declination=45.0)
    with opened(url) as unit:
        assert Capability.VELOCITY in unit.describe().capabilities
        assert math.degrees(unit.describe().tilt.max_rate_rad_s) == pytest.approx(10.0)
        first = reading(unit)
        for _ in range(10):
            unit.move_at(pan_rad_s=0.0, tilt_rad_s=math.radians(-4.0))
            time.sleep(0.1)
        unit.move_at(pan_rad_s=0.0, tilt_rad_s=0.0)
        time.sleep(0.3)
        second = reading(unit)
        turned = math.degrees(second.tilt.angle_rad - first.tilt.angle_rad)
        assert -7.0 < turned < -3.0
        time.sleep(0.3)
        assert reading(unit).tilt.angle_rad == pytest.approx(second.tilt.angle_rad, abs=1e-4)
        server.kill()
        server.wait()
        assert isinstance(unit.read(), NoReading)
        with pytest.raises(PtuError):
            unit.halt()
