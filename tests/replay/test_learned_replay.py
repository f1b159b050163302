"""A replay with the learned detector: the bundled landing's first seconds, tracked and recorded like any other."""

from pathlib import Path

import numpy as np

from groundstation.detection_messages import DetectionStatus
from groundstation.replay.replay import ReplayRequest, replay

FROM_S, TO_S = 2.0, 8.0


def test_the_start_of_the_landing(landing_1: Path, tmp_path: Path) -> None:
    """At 500 m and 30 px wide, once it is found each frame is used, and the track is within its sigmas."""
    config = tmp_path / "learned.toml"
    config.write_text('[detection]\ndetector = "learned"\n', encoding="utf-8")
    request = ReplayRequest(
        session=landing_1, out=tmp_path / "out", config=config, from_s=FROM_S, to_s=TO_S, rerun=False, report=False
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
