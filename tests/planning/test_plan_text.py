"""The table of a plan: an empty line before notes and verdicts, and none at its end."""

import numpy as np
import pytest

from groundstation.planning import plan_table
from groundstation.planning.forecast import forecast
from groundstation.planning.plan_table import format_plan
from groundstation.planning.site_file import load_site
from tests.conftest import ROOT


@pytest.mark.parametrize(("notes", "verdicts"), [([], []), (["a note"], []), ([], ["good"]), (["a note"], ["good"])])
def test_notes_and_verdicts_are_separate(
    notes: list[str], verdicts: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    site = load_site(ROOT / "docs" / "site-example.toml")
    site = type("Site", (), {name: getattr(site, name) for name in dir(site) if not name.startswith("__")})()
    site.required = verdicts
    f = forecast(load_site(ROOT / "docs" / "site-example.toml"))
    monkeypatch.setattr(plan_table, "_notes", lambda site, f: notes)
    monkeypatch.setattr(plan_table, "verdict", lambda site, f, wanted: wanted)
    lines = format_plan(site, f).split("\n")
    added = [*notes, *verdicts]
    rows = len(f.range_m) + len(plan_table._HEAD)
    assert lines[3 + rows :] == (["", *added] if added else [])
    assert np.isfinite(f.range_m).all()
