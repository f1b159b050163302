"""The autopilot file: what it means, and the errors for files that are none."""

from pathlib import Path

import pytest

from groundstation.autopilot.settings import AutopilotMode, load_autopilot
from groundstation.errors import ConfigError

_WHOLE = """format = "groundstation-autopilot/1"
url = "udpout:10.0.0.7:14550"
mode = "odometry"
rate_hz = 30
delay_s = 0.05
link_delay_s = 0.02
reference_in_body_m = [-0.4, 0.0, 0.1]
geoid_separation_m = 47.2
system_id = 9
target_system = 3
signing_key = "key"
"""


def test_a_whole_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "autopilot.toml"
    path.write_text(_WHOLE)
    found = load_autopilot(path)
    assert found.mode is AutopilotMode.ODOMETRY
    assert found.period_s == pytest.approx(1.0 / 30.0)
    assert found.assumed_delay_s == 0.05
    assert found.reference_in_body_m == (-0.4, 0.0, 0.1)
    assert found.signing_key == tmp_path / "key"
    assert (found.system_id, found.component_id, found.target_system) == (9, 197, 3)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mode", '"gps"'),
        ("rate_hz", "100"),
        ("delay_s", "0.5"),
        ("system_id", "1.5"),
        ("target_system", "300"),
        ("geoid_separation_m", "nan"),
        ("reference_in_body_m", "[1, 2]"),
        ("reference_in_body_m", "[1e6, 0, 0]"),
        ("url", "3"),
        ("colour", '"red"'),
    ],
)
def test_a_wrong_value_is_refused_by_the_name_of_its_key(tmp_path: Path, key: str, value: str) -> None:
    lines = [line for line in _WHOLE.splitlines() if not line.startswith(f"{key} ")]
    path = tmp_path / "autopilot.toml"
    path.write_text("\n".join([*lines, f"{key} = {value}"]))
    with pytest.raises(ConfigError, match=key):
        load_autopilot(path)
