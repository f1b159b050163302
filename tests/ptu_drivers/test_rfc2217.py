"""Units behind a device server (RFC 2217): pyserial's own server, our simulated units behind it."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundstation.cli.main import main
from ptu_drivers import PanTiltUnit, UnitSettings, open_ptu
from ptu_drivers.errors import LineError
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import AngleSource, NoReading, Reading
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from ptu_drivers.simulated.server import SimulatedServer
from tests.ptu_drivers.rfc2217_server import DeviceServer
from tests.ptu_drivers.served import served

pytestmark = [
    # pyserial's client starts its thread in a way that Python 3.10 began to warn of,
    pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning"),
    # and leaves the socket of a connection that was lost to the garbage collector
    pytest.mark.filterwarnings("ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"),
]

COUNT_RAD = math.radians(FlirModel().arcsec / 3600.0)
# a busy machine's share of a call, beyond the time that the driver states
BUSY_S = 1.0


@pytest.fixture
def flir(tmp_path: Path) -> Iterator[tuple[VirtualLine, SimulatedUnit, DeviceServer]]:
    unit = SimulatedUnit(FlirModel(combined=False, device_clock=False), LineModel(), seed=1)
    with served(unit, tmp_path / "unit") as line, DeviceServer(tmp_path / "unit") as server:
        yield line, unit, server


Flir = tuple[VirtualLine, SimulatedUnit, DeviceServer]


def reading(unit: PanTiltUnit) -> Reading:
    got = unit.read()
    assert isinstance(got, Reading), got
    return got


def lost_and_back(unit: PanTiltUnit, break_it: object, mend: object) -> None:
    """Break the line for a while: no angle in the meantime, no call that hangs, angles within 2 s of its return."""
    assert callable(break_it)
    assert callable(mend)
    break_it()
    stated_s = unit.describe().reply_timeout_s
    reasons, end = set(), time.monotonic() + 0.6
    while time.monotonic() < end or not reasons:
        asked = time.monotonic()
        got = unit.read()
        assert time.monotonic() - asked < stated_s + BUSY_S
        assert isinstance(got, NoReading)
        reasons.add(got.reason)
    assert reasons <= {FailureReason.LINE_LOST, FailureReason.TIMEOUT, FailureReason.TRUNCATED}
    mend()
    back = time.monotonic()
    while isinstance(unit.read(), NoReading):
        assert time.monotonic() - back < 2.0 + BUSY_S
    reading(unit)


def test_probe_positions_and_instants(flir: Flir) -> None:
    _, simulated, server = flir
    with open_ptu(server.url, settings=UnitSettings(reply_timeout_s=1.0)) as unit:
        reported = unit.describe()
        assert (reported.model, reported.serial, reported.details["baud"]) == ("PTU-D48E", "SIM001", "9600")
        unit.move_to(pan_rad=0.3, tilt_rad=-0.1)
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            got = reading(unit)
            for sample, letter in ((got.pan, "P"), (got.tilt, "T")):
                # the truth within 5 sigma of its instant, as it moves
                axis = simulated.flir.axes[letter]
                about = [axis.head(sample.t_s + k * sample.sigma_t_s) * COUNT_RAD for k in (-5, 0, 5)]
                assert min(about) - COUNT_RAD <= sample.angle_rad <= max(about) + COUNT_RAD
                # a network's times: the last byte's is unknown
                assert sample.source in (AngleSource.FIRST_REPLY_BYTE, AngleSource.ROUND_TRIP)
            if abs(got.pan.angle_rad - 0.3) < COUNT_RAD and abs(got.tilt.angle_rad + 0.1) < COUNT_RAD:
                break
        assert got.pan.angle_rad == pytest.approx(0.3, abs=COUNT_RAD)
        assert unit.health().failures == {}


def test_the_speed_of_the_far_port_is_raised_with_the_units_and_found_again(flir: Flir) -> None:
    line, simulated, server = flir
    patient = UnitSettings(baud=115200, reply_timeout_s=1.0)
    with open_ptu(server.url, settings=patient) as unit:
        assert (simulated.baud, line.baud()) == (115200, 115200)
        assert unit.describe().details["baud"] == "115200"
        reading(unit)
    # a unit that was left at another speed is found
    with open_ptu(server.url, settings=UnitSettings(reply_timeout_s=1.0), patience_s=20.0) as unit:
        assert unit.describe().details["baud"] == "115200"
        reading(unit)


def test_the_line_is_lost_and_returns(flir: Flir) -> None:
    _, simulated, server = flir
    with open_ptu(server.url) as unit:
        unit.move_to(pan_rad=2.5)
        lost_and_back(unit, server.pull_out, server.plug_in)
        assert unit.health().reconnects >= 1
        # motion during the outage was halted when the line was back
        assert simulated.flir.axes["P"].speed(time.monotonic() + 1.0) == 0.0


def test_a_connection_that_is_half_open(flir: Flir) -> None:
    _, _, server = flir

    def mend() -> None:
        server.mute = False

    with open_ptu(server.url) as unit:
        lost_and_back(unit, lambda: setattr(server, "mute", True), mend)


def test_pelco_behind_a_device_server(tmp_path: Path) -> None:
    simulated = SimulatedPelco(PelcoModel(baud=4800), seed=1)
    with served(simulated, tmp_path / "unit") as line, DeviceServer(tmp_path / "unit") as server:
        unit = open_ptu(server.url, "pelco-d", UnitSettings(reply_timeout_s=1.0), baud=4800)
        with unit:
            assert line.baud() == 4800
            unit.move_to(pan_rad=0.1)
            end = time.monotonic() + 10.0
            while abs(reading(unit).pan.angle_rad - 0.1) > 2e-4:
                assert time.monotonic() < end
            lost_and_back(unit, server.pull_out, server.plug_in)


# pyserial's reader thread ends with an error where the unit's echo breaks a negotiation; the driver's error counts
@pytest.mark.filterwarnings("ignore:Exception in thread pySerial RFC 2217:pytest.PytestUnhandledThreadExceptionWarning")
def test_no_server_and_a_server_without_rfc_2217(flir: Flir, capsys: pytest.CaptureFixture[str]) -> None:
    line, _, server = flir
    with SimulatedServer(line, 0) as plain, pytest.raises(LineError, match="got Remote does not "):
        open_ptu(plain.url.replace("socket", "rfc2217") + "?timeout=0.2")
    server.pull_out()
    with pytest.raises(LineError, match="wanted a line that is there"):
        open_ptu(server.url)
    assert main(["ptu", "probe", server.url]) == 1
    reported = capsys.readouterr().err
    assert reported.startswith(f"groundstation: {server.url}: got ")
    assert reported.count("\n") == 1
