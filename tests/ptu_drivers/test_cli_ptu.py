"""`groundstation ptu`: what a user sees of a unit, and of a line that is none."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundstation.cli import main
from ptu_drivers.simulated_flir import FlirModel
from ptu_drivers.simulated_line import VirtualLine
from ptu_drivers.simulated_server import SimulatedServer
from ptu_drivers.simulated_unit import LineModel, SimulatedUnit


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """A unit on a TCP port: without a serial line's times."""
    unit = SimulatedUnit(FlirModel(), LineModel(baud=0, latency_s=(0.0, 0.001)))
    with SimulatedServer(VirtualLine(unit, 0, start_s=time.monotonic()), 0) as server:
        yield server.url


def test_probe(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "probe", url, "--seconds", "0.5", "--tilt-limits=-10,20"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"PTU-D48E SIM001 on {url}, flir\n")
    for part in (
        "-174.002 …  174.002 deg",
        "-10.000 …   20.000 deg",
        "readings/s",
        "doubts: none",
        "device clock",
        "#",
    ):
        assert part in said


def test_monitor(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "monitor", url, "--seconds", "1.2"]) == 0
    said = capsys.readouterr().out
    assert "pan    0.0000  tilt" in said
    assert "to the limits 174.00 deg below" in said


def test_jog(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "jog", url, "--pan", "3", "--tilt", "-2", "--rate", "20", "--back"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 4
    assert all("reached" in row for row in rows)
    assert rows[0].startswith("pan     2.99") or rows[0].startswith("pan     3.00")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--pan", "1000"], "pan: got 1000.0000 deg; the upper limit is 174.0021 deg (unit)"),
        (["--pan", "5", "--pan-limits=-1,1"], "pan: got 5.0000 deg; the upper limit is 1.0000 deg (settings)"),
        (["--tilt", "5", "--rate", "99"], "tilt: got 99.0000 deg/s; the maximum speed is 51.4286 deg/s (unit)"),
        ([], "jog: got no angle; wanted --pan, --tilt or both"),
    ],
)
def test_refused_with_the_limits_name(
    url: str, more: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ptu", "jog", url, *more]) == 1
    assert capsys.readouterr().err == f"groundstation: {message}\n"


def test_no_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ptu", "probe", str(tmp_path / "none")]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "wanted a line that is there" in said


def test_without_pyserial_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    assert main(["ptu", "probe", "/dev/ttyUSB0"]) == 1
    assert "pip install 'groundstation[ptu]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [["simulate"], ["simulate", "--link", "x", "--latency-ms", "8,2"], ["jog", "x", "--pan", "far"], ["probe"], []],
)
def test_wrong_usage(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["ptu", *arguments])
    assert left.value.code == 2
    assert "usage" in capsys.readouterr().err


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
