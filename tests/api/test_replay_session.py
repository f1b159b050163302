"""The library's public names: a session in, arrays out, as the page says and as the files have it."""

import csv
import re
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import groundstation
from groundstation.api.replay_session import CameraSeries, ReplayedSession, replay_session
from groundstation.errors import InputError
from tests.session.folder import Tiny

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "python.md").read_text(encoding="utf-8")

pytestmark = pytest.mark.usefixtures("unrendered_figures")


def test_the_arrays_are_those_of_the_files(landing_from_20_s: Path, classic_tuning: Path, tmp_path: Path) -> None:
    run = replay_session(landing_from_20_s, out=tmp_path, config=classic_tuning, from_s=20.0, to_s=22.4)
    with (tmp_path / "track.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert run.name == "landing-1"
    assert [row["status"] for row in rows] == list(run.status)
    assert np.allclose([float(row["t_s"]) for row in rows], run.t_s, atol=1e-5)
    known = [k for k, row in enumerate(rows) if row["x_m"]]
    assert len(known) > 5
    np.testing.assert_allclose(
        [[float(rows[k][f"{axis}_m"]) for axis in "xyz"] for k in known], run.position_m[known], atol=1e-4
    )
    assert np.isnan(run.position_m[[k for k in range(len(rows)) if k not in known]]).all()
    assert run.covariance_m2.shape == (len(rows), 3, 3)
    assert set(run.cameras) == {"left", "right"}
    for camera in run.cameras.values():
        n = len(camera.t_s)
        assert camera.pixel_px.shape == (n, 2)
        assert camera.covariance_px2.shape == (n, 2, 2)
        assert np.isfinite(camera.pixel_px[camera.accepted]).all()
        assert {len(getattr(camera, item.name)) for item in fields(camera)} == {n}
    assert run.summary["counts"]["track"]["tracking"] == run.tracking.sum()
    assert run.fault is None


def test_nothing_is_kept_without_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = replay_session(str(Tiny(rows=4).write(tmp_path / "session")))
    assert len(run.t_s) == 4
    assert not run.tracking.any()
    assert [path.name for path in tmp_path.iterdir()] == ["session"]


def test_a_path_that_is_no_session_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="wanted a session folder"):
        replay_session(tmp_path / "none")


def test_pandas_is_named_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = replay_session(Tiny(rows=4).write(tmp_path / "session"))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match="pip install pandas"):
        run.to_pandas()


def test_pandas_gets_a_row_for_each_pair(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    table = replay_session(Tiny(rows=4).write(tmp_path / "session")).to_pandas()
    assert list(table.columns)[:5] == ["t_s", "status", "x_m", "vx_m_s", "sigma_x_m"]
    assert len(table) == 4


def test_the_page_lists_each_name() -> None:
    for kind in (ReplayedSession, CameraSeries):
        section = PAGE.partition("is a `ReplayedSession`")[2].partition("\n## ")[0]
        named = set(
            re.findall(
                r"`([a-z_0-9]+)`",
                " ".join(line.split("|")[1] for line in section.splitlines() if line.startswith("| `")),
            )
        )
        assert {item.name for item in fields(kind)} <= named
    assert {"ReplayedSession", "CameraSeries", "replay_session"} <= set(groundstation.__all__)
    assert groundstation.replay_session is replay_session
