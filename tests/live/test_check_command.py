"""`groundstation check`, with and without `--move`, on whole stations: videos as cameras, simulated units on ptys."""

import math
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.live import check
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from ptu_drivers.simulated.axis import SimulatedAxis
from tests.live.test_heads import COUNT_RAD, pan_of, simulated_unit
from tests.session.folder import SIZE, write_video
from tests.simulation.small_site import small_rig

HALF_A_DEGREE = math.radians(0.5) / COUNT_RAD


def field(folder: Path, rig: Rig, safety: str = "[safety]\nsun_angle_deg = 0\n") -> Path:
    """Write rig, videos and the station file; the units' links are left and right in the same folder."""
    (folder / "rig.toml").write_text(rig_to_toml(rig), encoding="utf-8")
    text = 'format = "groundstation-station/1"\nrig = "rig.toml"\nrate_hz = 5\n' + safety
    for name in rig.names:
        write_video(folder / f"{name}.avi", range(40))
        text += f'[[station]]\nname = "{name}"\ncamera = "file:{folder}/{name}.avi"\nptu = "{folder}/{name}"\n'
        text += "ptu_settings = { baud = 115200 }\n"
    (folder / "field.toml").write_text(text, encoding="utf-8")
    return folder / "field.toml"


def test_intact_stations_pass_and_turn_only_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: each line ok and exit code 0; heads stay, and with --move go half a degree on both axes and back."""
    # how long an answer takes here depends on what else the machine does
    monkeypatch.setattr(check, "_SLOW_S", 10.0)
    targets: list[float] = []
    move_to = SimulatedAxis.move_to

    def recorded(axis: SimulatedAxis, t_s: float, target: float, rate: float | None = None) -> None:
        targets.append(target)
        move_to(axis, t_s, target, rate)

    monkeypatch.setattr(SimulatedAxis, "move_to", recorded)
    known = {"covariance_parameters": ("focal.x", "focal.y"), "covariance": 0.01 * np.eye(2)}
    rig = small_rig(size_px=SIZE)
    path = field(tmp_path, replace(rig, stations=tuple(replace(s, **known) for s in rig.stations)))
    with ExitStack() as stack:
        servers = [stack.enter_context(simulated_unit(tmp_path / name)) for name in rig.names]
        assert main(["check", str(path), "--for", "0.5"]) == 0
        reported = capsys.readouterr().out.splitlines()
        assert [line.split()[0] for line in reported[:8]] == ["ok"] * 8
        assert not any("turned" in line for line in reported)
        assert targets == []
        assert main(["check", str(path), "--for", "0.5", "--move"]) == 0
        reported = capsys.readouterr().out.splitlines()
        assert [line.split()[0] for line in reported[:10]] == ["ok"] * 10
        for name in rig.names:
            assert sum(f"{name} PTU: turned by 0.5° and back" in line for line in reported) == 1
        assert max(targets) == pytest.approx(HALF_A_DEGREE, abs=1.0)
        assert sorted(round(t / HALF_A_DEGREE) for t in targets) == [0] * 4 + [1] * 4
        # braking takes the last counts
        assert [pan_of(server, 1e9) for server in servers] == pytest.approx([0.0, 0.0], abs=1.0)
