"""A flight that contradicts the rig's stated sigmas ends without a rig; a misfit never reduces a sigma."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.flight.fit import FlightFitError
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation import StationErrors
from tests.calibration.flight.flights import approach, calibrated, run

STATED = float(np.radians(0.1))
NAMES = tuple(f"runway_from_base.{axis}" for axis in "xyz")


def stating(rig: Rig, sigma_rad: float) -> Rig:
    """Return the rig with stated sigmas of its mounts."""
    covariance = sigma_rad**2 * np.eye(3)
    stations = (replace(s, covariance_parameters=NAMES, covariance=covariance) for s in rig.stations)
    return replace(rig, stations=tuple(stations))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight by a rig whose mounts are off by as much as it states."""
    folder = tmp_path_factory.mktemp("contradicted")
    errors = {"left": StationErrors(mount_rad=np.radians([0.08, 0.05, -0.06]))}
    calibrated(folder, approach(8, errors), free="orientation")
    return folder


def together(rig: Rig) -> Rig:
    """Return the rig with all that its stations state in its own table."""
    nothing = {"covariance_parameters": (), "covariance": np.zeros((0, 0))}
    stations = tuple(replace(s, **nothing) for s in rig.stations)
    return replace(rig, stations=stations, shared_covariance=rig.calibration_covariance())


def with_rig(flown: Path, sigma_rad: float, shared: bool = False) -> Path:
    rig = stating(load_session(flown / "session").rig, sigma_rad)
    rig = together(rig) if shared else rig
    path = flown / f"stated{sigma_rad:.4f}{shared}.toml"
    path.write_text(rig_to_toml(rig))
    return path


@pytest.fixture
def shifted(flown: Path, request: pytest.FixtureRequest):
    """The same session with its DGPS moved by so many metres."""
    path = flown / "session" / "dgps.csv"
    before = path.read_text()
    head, *rows = before.splitlines()
    moved = []
    for row in rows:
        t, x, y, z, *rest = row.split(",")
        place = (float(v) + by for v, by in zip((x, y, z), request.param, strict=True))
        moved.append(",".join([t, *(f"{v:.4f}" for v in place), *rest]))
    path.write_text("\n".join([head, *moved]) + "\n")
    yield flown
    path.write_text(before)


def test_what_the_rig_states_is_not_contradicted_by_its_own_flight(flown: Path) -> None:
    found = run(flown, rig=with_rig(flown, STATED), free="orientation")
    assert "not to be trusted" not in found.report


@pytest.mark.parametrize("shared", [False, True], ids=["own table", "rig's table"])
@pytest.mark.parametrize("shifted", [(0.4, 0.0, 0.0), (1.0, 0.0, 0.5)], indirect=True)
def test_dgps_of_another_frame_gives_no_rig(shifted: Path, shared: bool) -> None:
    """40 cm aside are fitted to the pixels by a roll that the rig's sigmas exclude, whichever table states them."""
    (shifted / "rig.toml").unlink(missing_ok=True)
    wanted = r"runway_from_base\..: got .* sigmas from the value in .*; wanted DGPS in the rig's own frame"
    with pytest.raises(FlightFitError, match=wanted):
        run(shifted, rig=with_rig(shifted, STATED, shared), free="orientation")
    assert not (shifted / "rig.toml").exists()


@pytest.mark.parametrize("shifted", [(0.0, 6.0, 0.0)], indirect=True)
def test_a_misfit_is_no_noise_of_a_fix(shifted: Path) -> None:
    """6 m along fit to several px only, where nothing was stated: that makes no range good."""
    bad = run(shifted, free="orientation")
    assert max(station.rms_px for station in bad.fit.stations.values()) > 3.0
    assert "not to be trusted: the pixels of left fit to" in bad.report
    assert "use the rig" not in bad.report
