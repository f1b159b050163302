"""A log of inertial samples in other units is refused with the unit; one in the right ones is read."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.onboard.visual_inertial.inertial_unit_file import SAMPLE_COLUMNS, UnitLogError, read_samples
from tests.complaints import complaint

TIMES_S = np.arange(0.0, 20.0, 0.05)
RADIAN = float(np.radians(1.0))


def log(folder: Path, *, rates: float = 1.0, angles: float = 1.0, times: float = 1.0) -> Path:
    """A flight that rolls and pitches slowly, with noise of attitude and rate, in units so many times as large."""
    generator = np.random.default_rng(5)
    roll, pitch = 6.0 * np.sin(0.7 * TIMES_S), 3.0 * np.cos(0.9 * TIMES_S)
    rate_x, rate_y = np.gradient(roll, TIMES_S), np.gradient(pitch, TIMES_S)
    names = (*SAMPLE_COLUMNS, "roll_deg", "pitch_deg", "yaw_deg")
    rows = [",".join(names)]
    for k, t_s in enumerate(TIMES_S):
        measured = np.array([rate_x[k], rate_y[k], 0.0]) + generator.normal(0.3, 0.5, 3)
        attitude = np.array([roll[k], pitch[k], 0.0]) + generator.normal(0.0, 0.25, 3)
        rows.append(",".join(f"{v:.9g}" for v in (times * t_s, 0.1, 0.2, -9.8, *measured * rates, *attitude * angles)))
    (folder / "imu.csv").write_text("\n".join(rows) + "\n")
    return folder / "imu.csv"


def test_a_log_in_the_right_units_is_read(tmp_path: Path) -> None:
    assert len(read_samples(log(tmp_path))) == len(TIMES_S)


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ({"rates": RADIAN}, "rate_x_deg_s: got an attitude that changes 5"),
        ({"rates": RADIAN}, "times as fast; are the rates in rad/s?; wanted rates in deg/s and angles in deg"),
        ({"angles": RADIAN}, "times as fast; is it in rad?; wanted rates in deg/s and angles in deg"),
        (
            {"times": 1e6},
            "t_s: got samples 50000 s apart in the median; are the times in microseconds?; wanted seconds",
        ),
        ({"times": 1e3}, "t_s: got samples 50 s apart in the median; are the times in milliseconds?; wanted seconds"),
    ],
)
def test_a_log_in_other_units_is_refused(tmp_path: Path, units: dict[str, float], words: str) -> None:
    assert words in complaint(UnitLogError, lambda: read_samples(log(tmp_path, **units)))


def test_a_first_sample_from_before_the_clock_was_set_costs_nothing(tmp_path: Path) -> None:
    """Expected: read, as a gap of decades takes no memory, and refused by its units as any other."""
    path = log(tmp_path, rates=RADIAN)
    names, first, *others = path.read_text().splitlines()
    later = [f"{1.7e9 + float(line.split(',', 1)[0]):.3f},{line.split(',', 1)[1]}" for line in others]
    path.write_text("\n".join([names, first, *later]) + "\n")
    assert "are the rates in rad/s?" in complaint(UnitLogError, lambda: read_samples(path))
