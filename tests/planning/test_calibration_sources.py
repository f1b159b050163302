"""Which sources a site needs: better ones reach farther, the least that suffices is named, none where none does."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.planning.calibration_sources import (
    SOURCES,
    calibrated_by,
    format_sources,
    source_forecasts,
)
from groundstation.planning.site import Requirement, Site
from groundstation.planning.site_file import load_site
from tests.conftest import ROOT


def site(*required: Requirement) -> Site:
    one = load_site(ROOT / "docs" / "site-example.toml")
    return replace(one, required=required, step_m=180.0, frame_rate_hz=5.0)


@pytest.mark.parametrize("source", SOURCES, ids=lambda s: s.name)
def test_stations_differ_and_agree_as_the_source_says(source) -> None:
    known = calibrated_by(site().rig, source).calibration_covariance()
    for axis, name in enumerate(("x", "y", "z")):
        places = [known.names.index(f"{station}.runway_from_base.{name}") for station in ("left", "right")]
        P = np.degrees(np.degrees(known.matrix[np.ix_(places, places)]))
        assert P[0, 0] + P[1, 1] - 2.0 * P[0, 1] == pytest.approx(source.relative_deg[axis] ** 2)
        assert P.sum() / 4.0 == pytest.approx(source.common_deg[axis] ** 2)
    # positions are the site's
    assert known.matrix[known.names.index("left.ptu_position.x")][known.names.index("left.ptu_position.x")] == 0.01**2


def test_better_sources_are_asked_for_by_harder_requirements() -> None:
    easy = Requirement(name="easy", sigma_m=(5.0, 60.0, 5.0))
    none = Requirement(name="none", sigma_m=(1e-4, 1e-4, 1e-4))
    found = source_forecasts(site(easy))
    y = np.array([one.forecast.track_sigma_m[-1, 1] for one in found])
    # along the line of sight it hangs on the relative pan
    assert (np.diff(y) < 0.0).all()
    hard = Requirement(name="hard", sigma_m=(5.0, float(0.5 * (y[1] + y[2])), 5.0))
    text = format_sources(site(easy, hard, none), found)
    assert "easy: marks (half an hour: calibrate survey), met at all ranges" in text
    assert "hard: marks and stars (" in text
    assert "none: no calibration is enough for 0.0001/0.0001/0.0001 m" in text


def test_a_site_that_asks_for_nothing_is_told_nothing() -> None:
    assert source_forecasts(site()) == ()
    assert format_sources(site(), ()) == ""


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(ROOT / "docs" / "site-example.toml")]) == 0
    said = capsys.readouterr().out
    assert "calibration that a site needs (positions and clocks as stated):" in said
    assert "  marks and stars: " in said
