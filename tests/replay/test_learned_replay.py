"""A replay with the learned detector: the bundled landing's first seconds, tracked and recorded like any other."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.bank.frame_outcomes import frame_outcomes
from groundstation.bank.session_truth import SessionTruth
from groundstation.cli.main import main
from groundstation.detection_messages import DetectionStatus
from groundstation.evaluation.collector import DETECTION_STATUSES
from groundstation.files import channel_weights
from groundstation.files.channel_weights import WEIGHTS
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_session

pytestmark = pytest.mark.usefixtures("unrendered_figures")

FROM_S, TO_S = 2.0, 8.0


def test_the_start_of_the_landing(lossless_landing: Path, tmp_path: Path) -> None:
    """At 500 m and 30 px wide, once it is found each frame is used, and the track is within its sigmas."""
    config = tmp_path / "learned.toml"
    config.write_text('[detection]\ndetector = "learned"\n', encoding="utf-8")
    request = ReplayRequest(
        session=lossless_landing,
        out=tmp_path / "out",
        config=config,
        from_s=FROM_S,
        to_s=TO_S,
        rerun=False,
        report=False,
    )
    result = replay(request)
    assert result.fault is None
    text = (tmp_path / "out" / "detections.csv").read_text(encoding="utf-8")
    rows = [line.split(",") for line in text.splitlines()[1:]]
    column = text.splitlines()[0].split(",").index("status")
    used = [row[column] == DetectionStatus.OK.value for row in rows]
    # the search takes a second and a half; from then on every frame
    first = used.index(True)
    assert first < 0.5 * len(rows)
    assert np.mean(used[first:]) > 0.95
    total = result.evaluation.summary["accuracy"]["truth"]["total"]["ekf"]
    assert total["epochs"] > 20
    assert np.all(np.array(total["rmse_m"]) < [0.1, 4.0, 0.25])
    # the frames by which it was found have its pixels, in both tables, and are no measurements of the filter
    initial = [row for row in rows if row[column] == DetectionStatus.INITIAL.value]
    assert {row[1] for row in initial} == {"left", "right"}
    assert len(initial) >= 6
    assert all(float(row[0]) < float(rows[first][0]) for row in initial)
    assert len({(row[0], row[1]) for row in rows}) == len(rows)
    assert [float(row[0]) for row in rows] == sorted(float(row[0]) for row in rows)
    table = result.evaluation.cameras
    found = table[table["status"] == DETECTION_STATUSES.index(DetectionStatus.INITIAL)]
    assert len(found) == len(initial)
    assert not found["accepted"].any()
    truth = SessionTruth(load_session(lossless_landing))
    outcomes = {(o.station, o.pair): o for o in frame_outcomes(truth, result.evaluation)}
    judged = [outcomes[result.evaluation.stations[row["station"]], int(row["epoch"])] for row in found]
    assert all(o.initial for o in judged)
    assert np.mean([o.hit for o in judged]) > 0.9


def test_an_aircraft_that_stands_across_the_border_is_kept_until_it_takes_off(
    shared_data: Path, tmp_path: Path
) -> None:
    """Expected: both cameras see it cut by the border for two seconds, so that it has no fix, and it is one track."""
    session = shared_data / "takeoff-away"
    request = ReplayRequest(session=session, out=tmp_path / "out", to_s=4.5, rerun=False, report=False)
    result = replay(request)
    starts = [text for _, _, text in result.evaluation.events if text.startswith("target acquired")]
    assert len(starts) == 1
    assert result.evaluation.events[-1][2] == "acquiring → tracking"
    outcomes = frame_outcomes(SessionTruth(load_session(session)), result.evaluation)
    last = result.evaluation.epochs["epoch"].max()
    visible = [o for o in outcomes if o.visible and o.pair <= last]
    assert not any(o.wrong for o in visible)
    assert np.mean([o.hit for o in visible]) > 0.95
    cut = result.evaluation.cameras["status"] == DETECTION_STATUSES.index(DetectionStatus.CUT)
    assert np.count_nonzero(cut) > 20


def other_weights(folder: Path) -> Path:
    """The program's weights with another hash: a letter of the program that wrote them is changed."""
    content = WEIGHTS.read_bytes()
    assert content.count(b"pytorch") == 1
    path = folder / "own.onnx"
    path.write_bytes(content.replace(b"pytorch", b"pytorcH"))
    return path


def test_own_weights_are_named_by_their_hash(
    landing_1: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording made with them is replayed with them alone, and says so."""
    own, recording = other_weights(tmp_path), tmp_path / "own.mcap"
    span = ["--from", "2", "--to", "2.3", "--no-rerun"]
    words = ["replay", str(landing_1), "--out", str(tmp_path / "out"), *span, "--weights", str(own)]
    assert main([*words, "--record", str(recording)]) == 0
    again = ["replay", str(recording), "--out", str(tmp_path / "again"), "--no-rerun"]
    capsys.readouterr()
    assert main([*again, "--weights", str(own)]) == 0
    assert "the same track as was recorded, bit for bit: 3 epochs" in capsys.readouterr().out
    monkeypatch.setattr(channel_weights, "_own", {})
    assert main([*again[:3], str(tmp_path / "third"), "--no-rerun"]) == 1
    reported = capsys.readouterr().err
    assert "which is not of this program's weights; wanted the option --weights" in reported
    # the program's own are others: another tuning, and no comparison with what was recorded
    assert main([*again[:3], str(tmp_path / "fourth"), "--no-rerun", "--weights", str(WEIGHTS)]) == 0
    assert "as was recorded" not in capsys.readouterr().out


def test_a_file_that_is_no_network_is_refused_before_anything_is_written(
    landing_1: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "wrong.onnx"
    wrong.write_bytes(b"junk")
    out = tmp_path / "out"
    assert main(["replay", str(landing_1), "--out", str(out), "--weights", str(wrong)]) == 1
    assert "wrong.onnx: got" in capsys.readouterr().err
    assert not out.exists()
