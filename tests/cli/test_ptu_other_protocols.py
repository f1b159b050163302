"""`groundstation ptu` with protocols other than FLIR, against simulated units on a pty."""

import time
from pathlib import Path

import pytest

from groundstation.cli.main import main
from ptu_drivers.errors import ProtocolError
from ptu_drivers.simulated.lines import OTHERS, simulated_line
from ptu_drivers.simulated.server import SimulatedServer
from tests.peers import peer_module


@pytest.mark.parametrize("protocol", OTHERS)
def test_probe_and_jog(protocol: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if protocol == "dynamixel":
        peer_module("dynamixel-sdk", "dynamixel_sdk")
    line = simulated_line(protocol, start_s=time.monotonic(), network=False)
    with SimulatedServer(line, tmp_path / "unit"):
        assert main(["ptu", "probe", str(tmp_path / "unit"), "--protocol", protocol, "--seconds", "0.3"]) == 0
        reported = capsys.readouterr().out
        assert f"{protocol}\n" in reported
        assert "can: " in reported
        assert main(["ptu", "jog", str(tmp_path / "unit"), "--protocol", protocol, "--pan", "2", "--tilt", "-1"]) == 0
        assert capsys.readouterr().out.count("reached") == 2


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--fault", "garbage"], "--fault: got garbage for protocol pelco-d; wanted flir"),
        (["--series", "d"], "--series: got d for protocol pelco-d; wanted flir"),
        (["--latency-ms", "1,2"], "--latency-ms: got 1,2 for protocol pelco-d; wanted flir"),
        (["--no-combined"], "--no-combined: got it for protocol pelco-d; wanted flir"),
        (["--banner", "hello"], "--banner: got hello for protocol pelco-d; wanted flir"),
    ],
)
def test_what_only_a_simulated_flir_unit_has_is_refused(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ptu", "simulate", "--protocol", "pelco-d", "--link", str(tmp_path / "unit"), *more]) == 1
    assert capsys.readouterr().err == f"groundstation: {message}\n"


def test_options_reach_the_driver_and_wrong_ones_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = simulated_line("pelco-d", start_s=time.monotonic(), network=False)
    with SimulatedServer(line, tmp_path / "unit"):
        probe = ["ptu", "probe", str(tmp_path / "unit"), "--protocol", "pelco-d"]
        assert main([*probe, "--option", "address=3"]) == 1
        assert "to address 3 at 9600 bit/s" in capsys.readouterr().err
        assert main([*probe, "--option", "adress=3"]) == 1
        assert "got adress; wanted address, baud" in capsys.readouterr().err
        assert main(["ptu", "jog", *probe[2:], "--pan", "1", "--rate", "2"]) == 1
        assert "got a speed for a move to a position" in capsys.readouterr().err
    with pytest.raises(SystemExit) as wrong:
        main([*probe, "--option", "address"])
    assert wrong.value.code == 2
    with pytest.raises(ProtocolError, match=r"got visca; wanted one of pelco-d"):
        simulated_line("visca", start_s=0.0, network=False)
