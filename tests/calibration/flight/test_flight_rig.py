"""The rig that a flight leaves behind: what belongs together stays together, and a replay uses it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.flight.verdict import judge_flight
from groundstation.errors import RigError
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.parameters import ParameterPrior, rig_prior
from groundstation.evaluation.bounds import StationView
from groundstation.evaluation.calibration_bounds import calibration_sensitivities
from groundstation.geometry.aim import aim_at
from groundstation.replay.reference_prior import reference_prior
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.dgps import RigReference
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation import standard_rig
from tests.calibration.flight.flights import approach, calibrated
from tests.calibration.flight.test_flight import MOUNTS
from tests.complaints import complaint


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("flight")
    return folder, calibrated(folder, approach(3, MOUNTS, clock_offset_s=0.15), free="orientation,antenna")


def test_what_stations_share_is_written_and_read(found) -> None:
    folder, result = found
    again = load_rig(folder / "rig.toml")
    names = result.fit.problem.names
    assert set(again.shared_covariance.names) == set(names)
    everything = again.calibration_covariance()
    order = [everything.names.index(name) for name in names]
    sigma = np.sqrt(np.diag(everything.matrix))[order]
    correlation = everything.matrix[np.ix_(order, order)] / np.outer(sigma, sigma)
    # floors make sigmas a little larger, nothing else
    np.testing.assert_allclose(correlation, result.fit.correlation, atol=0.12)
    tilts = [names.index(f"{name}.runway_from_base.x") for name in ("left", "right")]
    assert correlation[tilts[0], tilts[1]] > 0.5


def test_the_filter_starts_from_the_shared_covariance_of_stations(found) -> None:
    """The considered states carry the correlations; a fix is worth more with them than with the stations alone."""
    folder, _ = found
    rig = load_rig(folder / "rig.toml")
    prior = rig_prior(rig)
    assert not [name for name in prior.names if name.startswith("dgps")]
    alone = rig_prior(replace(rig, shared_covariance=ParameterCovariance.nothing()))
    left, right = (prior.names.index(f"{name}.runway_from_base.x") for name in ("left", "right"))
    assert prior.covariance[left, right] > 0.0
    places = [alone.names.index(name) for name in (prior.names[left], prior.names[right])]
    assert alone.covariance[places[0], places[1]] == 0.0
    assert _height_difference(rig, prior) < 0.8 * _height_difference(rig, alone)


def _height_difference(rig: Rig, prior: ParameterPrior) -> float:
    """Return one sigma of by how much two stations disagree about the height of a pixel at 300 m, px."""
    point = np.array([0.0, 300.0, 15.0])
    names = [name for name in prior.names if "runway_from_base" in name]
    order = [prior.names.index(name) for name in names]
    views = []
    for station in rig.stations:
        aim = aim_at(station.geometry(), point)
        views.append(
            StationView(
                geometry=station.geometry(),
                pan_rad=aim.pan_rad,
                tilt_rad=aim.tilt_rad,
                pixel_covariance_px2=np.eye(2),
                angle_sigma_rad=1e-6,
            )
        )
    left, right = calibration_sensitivities(point, views, names)
    row = left[1] - right[1]
    return float(np.sqrt(row @ prior.covariance[np.ix_(order, order)] @ row))


def test_clock_and_antenna_go_to_the_replay(found) -> None:
    folder, result = found
    session = load_session(folder / "session", folder / "rig.toml")
    known = reference_prior(session, EstimationConfig())
    late = result.fit.problem.value(result.fit.change, "dgps_clock.offset")
    assert known.offset_s == pytest.approx(late)
    assert known.errors.names[0] == "dgps_clock.offset"
    assert np.sqrt(known.errors.covariance[0, 0]) < 0.1
    assert known.antenna_in_body_m is not None
    assert len(known.notes) == 2
    # together with the rig's own errors, what is in common comes along, the clock's sign turned
    prior = rig_prior(session.rig, known.errors)
    assert len(set(prior.names)) == len(prior.names)
    table = session.rig.shared_covariance
    tilt, clock = "left.runway_from_base.x", "dgps_clock.offset"
    stated = table.matrix[table.names.index(tilt), table.names.index(clock)]
    assert prior.covariance[prior.names.index(tilt), prior.names.index(clock)] == pytest.approx(-stated, rel=1e-9)


def test_another_recording_has_another_clock(found) -> None:
    folder, _ = found
    session = replace(load_session(folder / "session", folder / "rig.toml"), name="another")
    known = reference_prior(session, EstimationConfig())
    assert known.offset_s == 0.0
    assert known.errors.covariance[0, 0] == EstimationConfig().reference_clock_sigma_s ** 2
    # the aircraft is the same
    assert known.antenna_in_body_m is not None


def test_the_verdict_names_inseparable_parameters_first(found) -> None:
    """Straight in, the log's clock and the antenna's place along the flight are one."""
    lines = found[1].report.partition("verdict:")[2].splitlines()
    first = next(line for line in lines if line.strip())
    assert "cannot separate" in first
    assert "dgps_antenna.x" in found[1].report.partition("verdict:")[2]
    assert "to do next" in found[1].report
    assert "at 100 m" in found[1].report
    assert "at 400 m" in found[1].report


def test_the_report_is_one_page_with_pictures(tmp_path: Path) -> None:
    result = calibrated(tmp_path, approach(5, MOUNTS), free="orientation", report=tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text()
    pictures = sorted(path.stem for path in (tmp_path / "report").glob("*.png"))
    assert pictures == ["correlations", "geometry", "learnt", "over_image", "over_time", "ranges"]
    assert page.count("data:image/png;base64,") == len(pictures)
    assert "http" not in page
    assert all(name in page for name in result.fit.problem.names)
    assert set(result.files) >= {tmp_path / "rig.toml", tmp_path / "report" / "report.html"}


def with_reference(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(standard_rig()) + "\n[reference]\n" + text)
    return path


def test_a_reference_is_written_and_read(tmp_path: Path) -> None:
    known = RigReference(
        session='a "day"',
        offset_s=0.3,
        offset_sigma_s=0.01,
        antenna_in_body_m=np.array([-0.4, 0.0, -0.1]),
        antenna_sigma_m=np.array([0.1, 0.02, 0.03]),
    )
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(replace(standard_rig(), reference=known)))
    again = load_rig(path).reference
    assert again is not None
    assert (again.session, again.offset_s, again.offset_sigma_s) == ('a "day"', 0.3, 0.01)
    np.testing.assert_array_equal(again.antenna_in_body_m, known.antenna_in_body_m)
    np.testing.assert_array_equal(again.antenna_sigma_m, known.antenna_sigma_m)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("clock = 3\n", "an unknown key"),
        ("dgps_clock = { sigma_s = 0.1 }\n", "offset_s: got nothing"),
        ("dgps_clock = { offset_s = 0.1, sigma_s = -1 }\n", "wanted a finite number ≥ 0"),
        ("antenna_sigma_m = [1, 1, 1]\n", "antenna_sigma_m alone"),
        ("antenna_in_body_m = [1, 1]\n", "3 finite numbers"),
    ],
)
def test_a_reference_that_is_none(tmp_path: Path, text: str, message: str) -> None:
    assert message in complaint(RigError, lambda: load_rig(with_reference(tmp_path, text)))


def test_a_cameras_sigma_covers_the_drift_of_its_clock_over_the_flight(tmp_path: Path) -> None:
    """A rig carries offsets alone: at the flight's ends a drift has moved them by half the flight times its sigma.

    The shutter's sigma is carried as it was found, and the filter starts from it.
    """
    scenario = approach(4, MOUNTS)
    result = calibrated(tmp_path, scenario, clocks_sigma_s=0.02, free="orientation,camera_clock,drift,readout")
    fit, again = result.fit, load_rig(tmp_path / "rig.toml")
    for name in again.names:
        offset, drift = (
            float(fit.sigma[fit.problem.names.index(f"{name}.camera_clock.{part}")]) for part in ("offset", "drift")
        )
        t = fit.problem.observations[name].t_s
        clock = again[name].camera_clock
        assert clock is not None
        assert clock.sigma_s == pytest.approx(np.hypot(offset, 0.5 * (t.max() - t.min()) * drift), rel=1e-6)
        place = again.shared_covariance.names.index(f"{name}.camera_clock.offset")
        assert again.shared_covariance.matrix[place, place] == pytest.approx(clock.sigma_s**2, rel=1e-3)
        shutter = float(fit.sigma[fit.problem.names.index(f"{name}.readout")])
        assert again[name].readout_sigma_s == pytest.approx(shutter, rel=1e-12)
        prior = rig_prior(again)
        place = prior.names.index(f"{name}.readout")
        assert prior.covariance[place, place] == pytest.approx(shutter**2, rel=1e-9)


@pytest.mark.parametrize(("sigmas", "words"), [(0.5, "no different from a shutter"), (5.0, "upside down")])
def test_a_shutter_below_zero_is_spoken_of(found, sigmas: float, words: str) -> None:
    """By chance about 0, or with the last row first: without a report the rig would have a negative `readout_s`."""
    _, result = found
    names = result.fit.problem.names
    fit = replace(result.fit, problem=replace(result.fit.problem, names=(*names[:-1], "left.readout")))
    left, right = result.rig.stations
    rig = replace(result.rig, stations=(replace(left, readout_s=-sigmas * float(fit.sigma[-1])), right))
    assert [
        note for note in judge_flight(rig, fit).notes if note.startswith("left.readout is below zero") and words in note
    ]
    assert not [note for note in judge_flight(result.rig, fit).notes if "below zero" in note]
