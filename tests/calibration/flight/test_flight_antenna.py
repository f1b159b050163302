"""Where the antenna is: a calibration reads it as a replay does, from session.toml, else from the rig."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.clocks.calibrate import TimingRequest, calibrate_timing
from calibration.clocks.text_report import format_timing
from calibration.flight.parameters import KNOWN_ANTENNA_M
from calibration.flight.problem import ANTENNA
from groundstation.estimation.config import EstimationConfig
from groundstation.replay.reference_prior import reference_prior
from groundstation.rig.dgps import RigReference
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.session.antenna import AntennaSource, antenna_position
from groundstation.simulation import Scenario
from tests.calibration.flight.flights import approach, flown, run, turned
from tests.calibration.flight.test_flight import MOUNTS

ANTENNA_M = np.array([-1.2, 0.0, -0.3])
SIGMA_M = np.array([0.02, 0.03, 0.0])


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return approach(3, MOUNTS, antenna_in_body_m=ANTENNA_M, clock_offset_s=0.15)


@pytest.fixture
def folder(tmp_path: Path, scenario: Scenario) -> Path:
    """A flight whose session.toml does not state the antenna, and next to it a rig that does, as an earlier flight."""
    about = flown(tmp_path, scenario) / "session.toml"
    text = about.read_text()
    assert "antenna_in_body_m" in text
    about.write_text(text[: text.index("[target]")])
    known = RigReference(antenna_in_body_m=ANTENNA_M, antenna_sigma_m=SIGMA_M)
    (tmp_path / "known.toml").write_text(rig_to_toml(replace(scenario.rig, reference=known)))
    return tmp_path


def test_mounts_are_as_good_with_the_antenna_of_the_rig(folder: Path, scenario: Scenario) -> None:
    """Bounds of `test_flight.test_mounts_are_found_over_an_approach`; taken for the nose, pans were 0.017° apart."""
    found = run(folder, rig=folder / "known.toml", free="orientation")
    off = {name: np.degrees(turned(found.rig, scenario.true_rig, name)) for name in ("left", "right")}
    assert abs(off["left"][2] - off["right"][2]) < 0.002
    assert max(abs(off[name][0]) for name in off) < 0.005
    assert found.rig.reference is not None
    np.testing.assert_array_equal(found.rig.reference.antenna_in_body_m, ANTENNA_M)
    (line,) = (line for line in found.report.splitlines() if line.startswith("DGPS antenna"))
    assert line.startswith("DGPS antenna: -1.20 forward, 0.00 right, -0.30 down of the nose, in m, by [reference]")
    assert "held, though its sigmas there are 0.02, 0.03, 0 m" in line


def test_an_estimated_antenna_starts_from_the_rig_with_its_sigma(folder: Path) -> None:
    """A sigma of zero states nothing, as in the rig's covariance."""
    found = run(folder, rig=folder / "known.toml", free="orientation,antenna")
    problem = found.fit.problem
    places = [problem.names.index(name) for name in ANTENNA]
    np.testing.assert_array_equal(problem.antenna_in_body_m, ANTENNA_M)
    np.testing.assert_allclose(problem.prior_sigma[places], [0.02, 0.03, KNOWN_ANTENNA_M])
    assert found.rig.reference is not None
    estimated, sigma = found.rig.reference.antenna_in_body_m, found.rig.reference.antenna_sigma_m
    assert estimated is not None
    assert sigma is not None
    # three sigmas; the first two are known better than an approach straight in tells
    assert np.all(np.abs(estimated - ANTENNA_M) < 3.0 * sigma)
    assert np.all(sigma[:2] <= SIGMA_M[:2])
    assert "estimated from there on" in found.report


def test_clocks_by_the_flight_are_estimated_with_the_antenna_of_the_rig(folder: Path) -> None:
    found = calibrate_timing(
        TimingRequest(
            session=folder / "session",
            out=folder / "timed.toml",
            rig=folder / "known.toml",
            pictures=False,
            flight=True,
        )
    )
    assert found.by_flight is not None
    np.testing.assert_array_equal(found.by_flight.problem.antenna_in_body_m, ANTENNA_M)
    assert "DGPS antenna: -1.20 forward" in format_timing(found)


def test_session_toml_has_precedence_and_a_replay_agrees(folder: Path) -> None:
    by_rig = load_session(folder / "session", folder / "known.toml")
    without = load_session(folder / "session")
    about = folder / "session" / "session.toml"
    about.write_text(about.read_text() + "\n[target]\nantenna_in_body_m = [-0.5, 0.0, 0.1]\n")
    by_session = load_session(folder / "session", folder / "known.toml")
    sources = {"rig": AntennaSource.RIG, "none": AntennaSource.NONE, "session": AntennaSource.SESSION}
    for name, session in {"rig": by_rig, "none": without, "session": by_session}.items():
        antenna, prior = antenna_position(session), reference_prior(session, EstimationConfig())
        assert antenna.source is sources[name]
        assert antenna.in_body_m is prior.antenna_in_body_m
        assert set(ANTENNA).isdisjoint(prior.errors.names) == (name == "session")
    np.testing.assert_array_equal(antenna_position(by_session).in_body_m, [-0.5, 0.0, 0.1])
    found = run(folder, rig=folder / "known.toml", free="orientation")
    np.testing.assert_array_equal(found.fit.problem.antenna_in_body_m, [-0.5, 0.0, 0.1])
    assert "by [target] of session.toml; held" in found.report
