"""`calibrate timing --from-flight`: readings at any rate, and a verdict on the figure of interest."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.clocks.calibrate import TimingRequest, calibrate_timing
from calibration.clocks.text_report import format_timing
from calibration.flight.observations import gather_flight
from calibration.flight.problem import FlightProblem, angles_at
from groundstation.session import load_session
from groundstation.simulation import case_b, simulate
from groundstation.simulation.approach import weaving_approach
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.pointing import FirstOrderLoop
from groundstation.simulation.session_folder import write_session_folder
from tests.calibration.flight.flights import CLOCKS, with_clock_sigma

ADMITTED_S = 0.02


@pytest.mark.parametrize(("hz", "missing"), [(10.0, 0.0), (50.0, 0.12)])
def test_clocks_are_estimated_correctly_at_any_rate_of_readings(tmp_path: Path, hz: float, missing: float, rng) -> None:
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


def test_a_path_between_slow_readings_is_estimated_only_where_needed(tmp_path: Path) -> None:
    """Readings at the exposures give the head's angle; with an uncertain clock the motion between them counts."""
    flown = replace(case_b(seed=511, trajectory=weaving_approach(), pointing=FirstOrderLoop()), dgps=DgpsModel())
    write_session_folder(tmp_path / "session", simulate(flown), name="simulated")
    session = load_session(tmp_path / "session")
    data = gather_flight(session, None, None, None)
    assert all(observed.own_readings and observed.curves for observed in data.observations.values())
    held = FlightProblem(
        stations={s.name: s for s in session.rig.stations},
        observations=data.observations,
        track=data.track,
        antenna_in_body_m=np.zeros(3),
        names=("left.runway_from_base.x", "right.camera_clock.offset"),
        prior_sigma=np.full(2, np.inf),
    )
    assert not held.curves("left")
    assert held.curves("right")
    observed = data.observations["left"]
    np.testing.assert_allclose(
        angles_at(replace(observed, curves=held.curves("left")), observed.t_s).angles_rad,
        observed.readings_rad[np.searchsorted(observed.readings_s, observed.t_s - 1e-4)],
        atol=1e-9,
    )
