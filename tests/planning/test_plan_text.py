"""The table of a plan: an empty line before notes and verdicts, and none at its end."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.planning import plan_table
from groundstation.planning.forecast import Forecast, forecast
from groundstation.planning.plan_table import format_plan
from groundstation.planning.site_file import load_site
from tests.conftest import ROOT


@pytest.fixture(scope="module")
def expected() -> Forecast:
    """The forecast of the example, which takes longer than all that is asserted of its text."""
    return forecast(load_site(ROOT / "docs" / "site-example.toml"))


@pytest.mark.parametrize(("notes", "verdicts"), [([], []), (["a note"], []), ([], ["good"]), (["a note"], ["good"])])
def test_notes_and_verdicts_are_separate(
    notes: list[str], verdicts: list[str], expected: Forecast, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = load_site(ROOT / "docs" / "site-example.toml")
    site = type("Site", (), {name: getattr(site, name) for name in dir(site) if not name.startswith("__")})()
    site.required = verdicts
    f = expected
    monkeypatch.setattr(plan_table, "_notes", lambda site, f: notes)
    monkeypatch.setattr(plan_table, "verdict", lambda site, f, wanted: wanted)
    lines = format_plan(site, f).split("\n")
    added = [*notes, *verdicts]
    rows = len(f.range_m) + len(plan_table._HEAD)
    assert lines[3 + rows :] == (["", *added] if added else [])
    assert np.isfinite(f.range_m).all()


@pytest.mark.parametrize(
    ("key", "wrong", "doubt"),
    [
        ("baseline_m = 10.77", "baseline_m = 10770", "! the stations are 10770 m apart: is the site in metres?"),
        ("focal_mm = 25.0", "focal_mm = 0.025", "! left's picture is 179° wide: is its focal length in mm"),
    ],
)
def test_units_that_cannot_be_right_are_told(key: str, wrong: str, doubt: str, tmp_path: Path) -> None:
    text = (ROOT / "docs" / "site-example.toml").read_text(encoding="utf-8")
    assert key in text
    (tmp_path / "site.toml").write_text(text.replace(key, wrong), encoding="utf-8")
    site = load_site(tmp_path / "site.toml")
    assert doubt in format_plan(site, forecast(site))
