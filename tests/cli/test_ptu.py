"""`groundstation ptu`: the output for a unit, and for a line that is not one."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundstation.cli.main import main
from ptu_drivers import NoReading, Reading, open_ptu
from ptu_drivers.errors import LineError
from ptu_drivers.flir.unit import FlirUnit
from ptu_drivers.health import FailureReason, UnitState
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer
from tests.ptu_drivers.served import served


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """A unit on a TCP port: without a serial line's times."""
    unit = SimulatedUnit(FlirModel(), LineModel(baud=0, latency_s=(0.0, 0.001)))
    with SimulatedServer(VirtualLine(unit, 0, start_s=time.monotonic()), 0) as server:
        yield server.url


def test_probe(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "probe", url, "--seconds", "0.5", "--tilt-limits=-10,20"]) == 0
    reported = capsys.readouterr().out
    assert reported.startswith(f"PTU-D48E SIM001 on {url}, flir\n")
    for part in (
        "-174.002 …  174.002 deg",
        "-10.000 …   20.000 deg",
        "readings/s",
        "failures: none",
        "device clock",
        "#",
    ):
        assert part in reported


def test_monitor(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "monitor", url, "--seconds", "1.2"]) == 0
    reported = capsys.readouterr().out
    assert "pan    0.0000  tilt" in reported
    assert "to the limits 174.00 deg below" in reported


def test_jog(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "jog", url, "--pan", "3", "--tilt", "-2", "--rate", "20", "--back"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 4
    assert all("reached" in row for row in rows)
    assert rows[0].startswith("pan ")
    assert float(rows[0].split()[1]) == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--pan", "1000"], "pan: got 1000.0000 deg; the upper limit is 174.0021 deg (unit)"),
        (["--pan", "5", "--pan-limits=-1,1"], "pan: got 5.0000 deg; the upper limit is 1.0000 deg (settings)"),
        (["--tilt", "5", "--rate", "99"], "tilt: got 99.0000 deg/s; the maximum speed is 51.4286 deg/s (unit)"),
    ],
)
def test_refused_with_the_limits_name(
    url: str, more: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ptu", "jog", url, *more]) == 1
    # before the first move it is reported that the Sun is unknown
    assert capsys.readouterr().err.splitlines()[-1] == f"groundstation: {message}"


def test_without_an_angle_it_is_wrong_usage(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "jog", url]) == 2
    assert capsys.readouterr().err == "groundstation: jog: got no angle; wanted --pan, --tilt or both\n"


def test_no_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "probe", str(tmp_path / "none")]) == 1
    reported = capsys.readouterr().err
    assert reported.count("\n") == 1
    assert "wanted a line that is there" in reported


def test_what_is_no_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: a file, a folder or a link to itself in place of the device is named, without pyserial's words."""
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name, got in (("file", "a file"), ("loop", "a link that leads to itself"), (".", "a folder")):
        url = str(tmp_path / name)
        assert main(["ptu", "probe", url]) == 1
        wanted = "a serial port or a pty, as /dev/ttyUSB0"
        assert capsys.readouterr().err == f"groundstation: {url}: got {got}; wanted {wanted}\n"


@pytest.mark.parametrize("url", ["socket://x", "socket://:4000", "socket://x:y", "rfc2217://x:99999"])
def test_a_network_line_without_host_and_port(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "probe", url]) == 1
    wanted = url.split(":")[0] + "://HOST:PORT"
    assert capsys.readouterr().err == f"groundstation: {url}: got no host and port; wanted {wanted}\n"


def test_without_pyserial_the_message_states_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    assert main(["ptu", "probe", "/dev/ttyUSB0"]) == 1
    error = capsys.readouterr().err
    assert error == "groundstation: a serial line needs a package that is not installed: pip install pyserial\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["probe", "x", "--baud", "-5"],
        ["probe", "x", "--baud", "0"],
        ["probe", "x", "--baud", "fast"],
        ["simulate"],
        ["simulate", "--link", "x", "--latency-ms", "8,2"],
        ["simulate", "--link", "x", "--latency-ms=-1,2"],
        ["simulate", "--link", "x", "--backlash-deg", "nan"],
        ["jog", "x", "--pan", "far"],
        [],
    ],
)
def test_wrong_usage(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["ptu", *arguments])
    assert left.value.code == 2
    assert "usage" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--baud", "12345"], "baud: got 12345; wanted 600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200"),
        (["--baud", "99999999999"], "baud: got 99999999999; wanted a serial line's speed, 50 to 10000000 bit/s"),
        (["--option", "patience_s=abc"], "flir option patience_s: got 'abc'; wanted a number"),
        (["--option", "nope=1"], "options: got nope; wanted what flir has: patience_s, query"),
        (["--option", "query=best"], "query: got best; wanted auto, "),
        (
            ["--protocol", "pelco-d", "--option", "address=abc"],
            "Pelco option address: got 'abc'; wanted a whole number",
        ),
        (["--protocol", "pelco-d", "--option", "address=1.5"], "Pelco option address: got 1.5; wanted a whole number"),
        (["--protocol", "pelco-d", "--option", "address=300"], "Pelco option address: got 300; wanted 1 to 255"),
        (["--protocol", "pelco-p", "--option", "baud=0"], "Pelco option baud: got 0; wanted a serial line's speed"),
        (["--protocol", "pelco-d", "--option", "pan_sign=true"], "option pan_sign: got True; wanted a whole number"),
        (["--protocol", "pelco-d", "--option", "speeds_deg_s=3"], "got 3; wanted a table of numbers by number"),
        (["--protocol", "pelco-d", "--option", "max_rate_deg_s=nan"], "got nan; wanted a number"),
        (["--protocol", "dynamixel", "--option", "torque_off=3"], "torque_off: got 3; wanted true or false"),
        (["--protocol", "dynamixel", "--option", "pan_id=x"], "Dynamixel option pan_id: got 'x'; wanted a whole"),
        (["--protocol", "alpaca", "--option", "device=x"], "Alpaca option device: got 'x'; wanted a whole number"),
        (["--protocol", "alpaca", "--option", "port=1"], "Alpaca options: got port; wanted device, altitude_low_deg"),
    ],
)
def test_nonsense_is_named_before_the_line_is_opened(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ptu", "probe", str(tmp_path / "none"), *more]) == 1
    reported = capsys.readouterr().err
    assert message in reported
    assert reported.count("\n") == 1


def test_a_speed_on_a_network_line_is_refused(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "probe", url, "--baud", "9600"]) == 1
    assert f"{url}: got 9600 baud; wanted no speed: only serial lines have one" in capsys.readouterr().err


class _Stubborn(SimulatedUnit):
    """Refuses every other speed."""

    def _obey(self, command: bytes, t_s: float) -> None:
        super()._obey(b"Z1" if command.startswith(b"@(") else command, t_s)


def test_a_unit_that_does_not_follow_a_speed_change_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with served(_Stubborn(), tmp_path / "unit"):
        assert main(["ptu", "probe", str(tmp_path / "unit"), "--baud", "57600", "--seconds", "0.2"]) == 0
    reported = capsys.readouterr()
    assert reported.err == f"groundstation: {tmp_path / 'unit'}: baud 9600; the unit did not follow to 57600\n"
    assert "baud: 9600; the unit did not follow to 57600" in reported.out


def test_waiting_for_the_first_angle_ends(
    url: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    silent = NoReading(reason=FailureReason.TIMEOUT, state=UnitState.RESYNCHRONISING, t_s=0.0)
    monkeypatch.setattr(FlirUnit, "read", lambda _unit: silent)
    assert main(["ptu", "jog", url, "--pan", "1", "--patience", "0.2"]) == 1
    assert (
        capsys.readouterr().err
        == f"groundstation: {url}: got no angle in 0.2 s (timeout, resynchronising); wanted one\n"
    )


def test_a_link_that_is_served_is_not_taken_and_a_dead_one_is(tmp_path: Path) -> None:
    link = tmp_path / "unit"
    with served(SimulatedUnit(), link):
        there = link.readlink()
        with pytest.raises(LineError, match="got a link that a running simulated unit serves; wanted another path"):
            SimulatedServer(VirtualLine(SimulatedUnit(), start_s=time.monotonic()), link)
        assert link.readlink() == there
        with open_ptu(str(link)) as unit:
            assert isinstance(unit.read(), Reading)
    assert not link.is_symlink()
    # left behind by a killed program: a link to nowhere, or to a pty that another program has by now
    master, slave = os.openpty()
    for dead in ("/dev/pts/none", os.ttyname(slave)):
        link.symlink_to(dead)
        with served(SimulatedUnit(), link):
            assert link.is_char_device()
            assert str(link.readlink()) != dead
        assert not link.is_symlink()
    os.close(master)
    os.close(slave)
    # what is not a simulator's is left alone
    (tmp_path / "notes").write_text("kept")
    link.symlink_to(tmp_path / "notes")
    with pytest.raises(LineError, match="File exists"):
        SimulatedServer(VirtualLine(SimulatedUnit(), start_s=time.monotonic()), link)
    assert link.read_text() == "kept"


def test_a_port_in_use_is_reported(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    port = url.rpartition(":")[2]
    assert main(["ptu", "simulate", "--tcp", port]) == 1
    assert f"port {port}: got Address already in use; wanted a free port" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["ptu", "simulate", "--tcp", "99999"])
    assert ended.value.code == 2
    assert "wanted a free port" in capsys.readouterr().err


def test_simulate_ends_on_a_signal_and_takes_its_link_with_it(tmp_path: Path) -> None:
    link = tmp_path / "unit"
    command = [sys.executable, "-m", "groundstation", "ptu", "simulate", "--link", str(link), "--series", "d"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == f"PTU-D46 simulated at {link}\n"
        assert link.is_symlink()
        child.terminate()
        assert child.wait(10) == 0
    assert not link.is_symlink()
