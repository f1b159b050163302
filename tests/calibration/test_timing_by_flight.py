"""`calibrate timing --from-flight`: readings however slow, and a verdict on the figure that is asked for."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.timing_report import format_timing
from calibration.timing_session import TimingRequest, calibrate_timing
from groundstation.simulation import case_b, simulate
from groundstation.simulation.approach import weaving_approach
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.pointing import FirstOrderLoop
from groundstation.sinks.session_folder import write_session_folder
from tests.calibration.flights import CLOCKS, with_clock_sigma

ADMITTED_S = 0.02


@pytest.mark.parametrize(("hz", "missing"), [(10.0, 0.0), (50.0, 0.12)])
def test_clocks_come_true_however_slow_the_readings_are(tmp_path: Path, hz: float, missing: float, rng) -> None:
    """All clocks are right, and 20 ms is admitted: by straight lines between readings cameras were 4 to 6 sigma off."""
    flown = case_b(seed=511, trajectory=weaving_approach(), pointing=FirstOrderLoop(), ptu_hz=hz)
    flown = replace(flown, dgps=DgpsModel(), rig=with_clock_sigma(flown.rig, ADMITTED_S))
    write_session_folder(tmp_path / "session", simulate(flown), name="simulated")
    head, *rows = (tmp_path / "session" / "ptu.csv").read_text().splitlines()
    rows = [row for row, lost in zip(rows, rng.random(len(rows)) < missing, strict=True) if not lost]
    (tmp_path / "session" / "ptu.csv").write_text("\n".join([head, *rows]) + "\n")
    about = tmp_path / "session" / "session.toml"
    about.write_text(about.read_text() + CLOCKS.format(sigma=ADMITTED_S))
    found = calibrate_timing(
        TimingRequest(session=tmp_path / "session", out=tmp_path / "rig.toml", pictures=False, flight=True)
    )
    fit = found.by_flight
    assert fit is not None
    # four clocks; chance exceeds it in 1 of 10 000
    assert fit.change @ np.linalg.solve(fit.covariance, fit.change) < 23.5

    report = format_timing(found)
    stated = [float(ms) for ms in re.findall(r"PTU against camera [-+.\d]+ \+- ([.\d]+) ms", report)]
    judged = re.search(r"(good|usable|not good enough): PTU against camera to ([.\d]+) ms", report)
    assert judged is not None
    assert len(stated) == 2
    assert float(judged[2]) == max(stated)
    assert judged[1] == "not good enough"
    assert "without --from-flight" in report
