"""A detector's nose has a persistent offset, for which the clocks of a flight account."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.simulation import StationErrors
from tests.calibration.flight.flights import approach, calibrated, run

OFF_M, SIGMA_M = 0.06, 0.05
LOG = "dgps_clock.offset"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight whose pixels are of a point ahead of the session's nose, the DGPS in time."""
    folder = tmp_path_factory.mktemp("seen")
    errors = {"left": StationErrors(mount_rad=np.radians([0.02, 0.0, -0.03]))}
    calibrated(folder, approach(5, errors, antenna_in_body_m=np.array([-OFF_M, 0.0, 0.0])), free="orientation")
    about = folder / "session" / "session.toml"
    lines = [line for line in about.read_text().splitlines() if not line.startswith("antenna_in_body_m")]
    about.write_text("\n".join(lines) + "\n")
    return folder


def test_a_logs_lag_follows_the_displacement_of_the_point(flown: Path) -> None:
    """Without it a sigma of a fraction of a millisecond, milliseconds off; with it a consistent sigma."""
    blind = run(flown, free="orientation").fit
    aware = run(flown, free="orientation", point_sigma_m=SIGMA_M).fit
    place = blind.problem.names.index(LOG)
    np.testing.assert_array_equal(aware.change, blind.change)
    trajectory = approach(5, {}).trajectory
    speed = float(np.linalg.norm(trajectory.velocity(np.array([np.mean(trajectory.span_s)]))))
    assert abs(blind.change[place]) > 4.0 * blind.sigma[place]
    assert abs(aware.change[place]) < 2.0 * aware.sigma[place]
    added_s = float(np.sqrt(aware.sigma[place] ** 2 - blind.sigma[place] ** 2))
    # it flies slower where it is near, where the information is largest
    assert SIGMA_M / speed < added_s < 1.25 * SIGMA_M / speed
    assert abs(blind.change[place]) == pytest.approx(OFF_M / SIGMA_M * added_s, abs=3.0 * blind.sigma[place])


def test_mounts_hardly_care(flown: Path) -> None:
    blind = run(flown, free="orientation").fit
    aware = run(flown, free="orientation", point_sigma_m=SIGMA_M).fit
    for k, name in enumerate(blind.problem.names):
        if "runway_from_base" in name:
            assert aware.sigma[k] < 1.2 * blind.sigma[k] + np.radians(0.0005), name


def test_an_estimated_antenna_absorbs_the_points_displacement(flown: Path) -> None:
    fits = [run(flown, free="orientation,antenna", point_sigma_m=sigma).fit for sigma in (0.0, SIGMA_M)]
    np.testing.assert_array_equal(fits[0].covariance, fits[1].covariance)


def test_pixels_that_a_program_found_are_doubted_and_those_of_the_session_are_not(flown: Path, tmp_path: Path) -> None:
    rows = (flown / "session" / "detections.csv").read_text().splitlines()
    found = tmp_path / "detections.csv"
    found.write_text("\n".join([rows[0] + ",status", *(row + ",ok" for row in rows[1:])]) + "\n")
    assert run(flown, free="orientation").fit.point_sigma_m == 0.0
    assert run(flown, free="orientation", detections=found).fit.point_sigma_m == SIGMA_M
