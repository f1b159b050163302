"""The tables of a finished replay, read back: as they were written, or refused at the first faulty row."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.errors import InputError
from groundstation.messages import Kinematics, TrackEstimate, TrackStatus, TriangulationStatus
from groundstation.replay.run_tables import read_run, read_track
from groundstation.sinks.track_files import TRACK_COLUMNS, write_track

SUMMARY = {"reference": {"noise_sigma_m": [0.01, 0.02, 0.03]}}
EMPTY = "," * 11


def estimates(rng: np.random.Generator, count: int) -> list[TrackEstimate]:
    """Rows at 10 Hz, of which every third has no estimate."""
    rows = []
    for k in range(count):
        root = rng.normal(size=(6, 6))
        known = Kinematics(
            position_runway_m=100.0 * rng.normal(size=3),
            velocity_runway_m_s=rng.normal(size=3),
            covariance=root @ root.T + np.eye(6),
        )
        rows.append(
            TrackEstimate(
                t_s=0.1 * k,
                epoch=k,
                status=TrackStatus.SEARCHING if k % 3 == 0 else TrackStatus.TRACKING,
                kinematics=None if k % 3 == 0 else known,
                triangulation=None,
                triangulation_status=TriangulationStatus.ONE_VIEW,
                latency_s=0.0,
            )
        )
    return rows


def test_a_track_is_read_as_it_was_written(tmp_path: Path, rng: np.random.Generator) -> None:
    rows = estimates(rng, 20)
    write_track(tmp_path / "track.csv", rows)
    track = read_track(tmp_path / "track.csv")
    assert track.t_s == pytest.approx([row.t_s for row in rows])
    assert track.status.tolist() == [row.status.value for row in rows]
    for k, row in enumerate(rows):
        if row.kinematics is None:
            assert not track.known[k]
            assert np.isnan(track.covariance_m2[k]).all()
        else:
            assert track.position_m[k] == pytest.approx(row.kinematics.position_runway_m, abs=1e-6)
            assert track.covariance_m2[k] == pytest.approx(row.kinematics.covariance[:3, :3], rel=1e-6)


def test_a_reference_is_matched_by_its_stamps(tmp_path: Path, rng: np.random.Generator) -> None:
    """Expected: a position at the rows whose stamp both have; none at the others, and stamps of no row are left out."""
    write_track(tmp_path / "track.csv", estimates(rng, 6))
    poses = ["0.100000 1 2 3 0 0 0 1", "0.150000 9 9 9 0 0 0 1", "", "# a remark", "0.500000 4 5 6 0 0 0 1"]
    (tmp_path / "dgps.tum").write_text("\n".join(poses) + "\n")
    run = read_run(tmp_path, "one", SUMMARY)
    assert list(run.references) == ["dgps"]
    at = run.references["dgps"]
    assert at.sigma_m.tolist() == [0.01, 0.02, 0.03]
    assert np.flatnonzero(np.isfinite(at.position_m[:, 0])).tolist() == [1, 5]
    errors = run.errors("dgps")
    assert errors is not None
    assert errors.error_m[5] == pytest.approx(run.track.position_m[5] - [4.0, 5.0, 6.0])
    P = run.track.covariance_m2[5] + np.diag([1e-4, 4e-4, 9e-4])
    assert errors.nees()[5] == pytest.approx(errors.error_m[5] @ np.linalg.inv(P) @ errors.error_m[5] / 3.0)
    assert run.errors("truth") is None


@pytest.mark.parametrize("noise", [None, "x", [1.0], [True, -1.0, None], [float("nan"), 1.0, 1.0]])
def test_an_unusable_noise_of_the_reference_is_replaced(
    tmp_path: Path, rng: np.random.Generator, noise: object
) -> None:
    write_track(tmp_path / "track.csv", estimates(rng, 3))
    (tmp_path / "dgps.tum").write_text("0.1 1 2 3 0 0 0 1\n")
    sigma_m = read_run(tmp_path, "one", {"reference": {"noise_sigma_m": noise}}).references["dgps"].sigma_m
    assert sigma_m[0] == 0.02
    assert np.all(sigma_m > 0.0)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (f"1{EMPTY},,tracking\n1{EMPTY},,tracking", "line 3: got t_s = 1, the same time as the row before"),
        (f"1{EMPTY},,landed", "line 2: got status 'landed'; wanted searching, acquiring"),
        ("1,x" + "," * 12 + "lost", "line 2: got x_m = 'x'; wanted a finite number"),
    ],
)
def test_a_faulty_row_of_a_track_is_named(tmp_path: Path, rows: str, message: str) -> None:
    (tmp_path / "track.csv").write_text(",".join(TRACK_COLUMNS) + f"\n{rows}\n")
    with pytest.raises(InputError, match=r"track\.csv") as raised:
        read_track(tmp_path / "track.csv")
    assert message in str(raised.value)


def test_a_covariance_that_cannot_be_inverted_counts_as_unknown(tmp_path: Path) -> None:
    row = "1,2,3,4,0,0,0,1,2,0,1,0,1,tracking"
    (tmp_path / "track.csv").write_text(",".join(TRACK_COLUMNS) + f"\n{row}\n")
    track = read_track(tmp_path / "track.csv")
    assert track.known.tolist() == [True]
    assert np.isnan(track.covariance_m2).all()


@pytest.mark.parametrize("line", ["1 2 3", "1 2 3 4 0 0 0 nan", "1 2 3 4 0 0 0 1e13", "a b c d e f g h", "0 " * 40_000])
def test_a_faulty_line_of_a_trajectory_is_named(tmp_path: Path, rng: np.random.Generator, line: str) -> None:
    write_track(tmp_path / "track.csv", estimates(rng, 3))
    (tmp_path / "truth.tum").write_text(f"0 1 2 3 0 0 0 1\n{line}\n")
    with pytest.raises(InputError, match=r"truth\.tum: line 2: got .*; wanted t x y z qx qy qz qw"):
        read_run(tmp_path, "one", SUMMARY)


@settings(max_examples=50)
@given(text=st.text(alphabet="0123456789.-e, \nabx#", max_size=200))
def test_any_text_is_read_or_refused_in_words(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    folder = tmp_path_factory.mktemp("any")
    refused: list[str] = []
    for track, trajectory in ((text, ""), (f"1{EMPTY},,tracking", text)):
        (folder / "track.csv").write_text(",".join(TRACK_COLUMNS) + f"\n{track}\n")
        (folder / "truth.tum").write_text(trajectory)
        try:
            read_run(folder, "one", SUMMARY)
        except InputError as error:
            refused.append(str(error))
    assert all("\n" not in reported and "got" in reported for reported in refused)
