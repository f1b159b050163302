"""How much of the track's error is the detector's: the same filter with true pixels and the detector's measured noise.

    python benchmarks/detector_against_truth.py SESSION… [--draws N]

A rendered session is replayed. Its detections are compared with truth.csv, which gives their noise: per camera and bin
of range, the covariance of their error. Then the session is replayed again, and every detection is put at the true
pixel plus noise drawn from that covariance, white and without bias; nothing else changes: the same frames, the same
PTU readings, the same stated covariances, the same misses. Printed are the RMSE of both against the truth, by bins of
range, and their ratio; of the drawn ones the root of the mean square over the draws.
"""

import argparse
import csv
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.camera_tracker import CameraTracker
from groundstation.detection.detector import Detector
from groundstation.messages import Detection, Frame
from groundstation.replay import ReplayRequest
from groundstation.replay import replay as replay_session

BINS = (0.0, 60.0, 100.0, 150.0, 250.0, 400.0, 700.0)
Key = tuple[str, int]


def true_pixels(session: Path) -> dict[Key, np.ndarray]:
    """Return the true pixel and the range (u, v, y) of each frame in which the target is visible."""
    pixels = {}
    with (session / "truth.csv").open() as file:
        for epoch, row in enumerate(csv.DictReader(file)):
            for station in ("left", "right"):
                if row[f"{station}_u_px"]:
                    values = (row[f"{station}_u_px"], row[f"{station}_v_px"], row["y_m"])
                    pixels[station, epoch] = np.array([float(v) for v in values])
    return pixels


def played(session: Path, change: Callable[[Key, Any], Any]) -> dict[str, Any]:
    """Replay the session, every result of the detector passed through ``change``; return the accuracy."""
    look, detect = CameraTracker.look, Detector.detect
    now: list[Key] = []

    def noted(self: CameraTracker, record: Frame, *rest: Any) -> Any:
        now[:] = [(record.station, record.epoch)]
        return look(self, record, *rest)

    def changed(self: Detector, *arguments: Any) -> Any:
        result = detect(self, *arguments)
        return change(now[0], result) if now else result

    CameraTracker.look, Detector.detect = noted, changed  # type: ignore[method-assign]
    try:
        with tempfile.TemporaryDirectory() as folder:
            result = replay_session(ReplayRequest(session=session, out=Path(folder), rerun=False))
    finally:
        CameraTracker.look, Detector.detect = look, detect  # type: ignore[method-assign]
    accuracy: dict[str, Any] = result.evaluation.summary["accuracy"]["truth"]
    return accuracy


def noise_by_range(found: dict[Key, Detection], truth: dict[Key, np.ndarray]) -> dict[tuple[str, int], np.ndarray]:
    """Return the mean outer product (2, 2) of the detections' errors by camera and bin of range."""
    errors: dict[tuple[str, int], list[np.ndarray]] = {}
    for key, detection in found.items():
        if key in truth:
            error = np.array([detection.u_px, detection.v_px]) - truth[key][:2]
            errors.setdefault((key[0], int(np.digitize(truth[key][2], BINS))), []).append(error)
    return {where: np.mean([np.outer(e, e) for e in those], axis=0) for where, those in errors.items()}


def squares(accuracy: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return squared RMSE (3,) by range, and of y 100–250 m together."""
    out, near, n = {}, np.zeros(3), 0
    for part in accuracy["by_range"]:
        rmse, epochs = part["ekf"]["rmse_m"], part["ekf"]["epochs"]
        if rmse is None or epochs < 10:
            continue
        out[f"y {part['from_m']:.0f}–{part['to_m']:.0f} m"] = np.square(rmse)
        if part["from_m"] in (100.0, 150.0):
            near, n = near + epochs * np.square(rmse), n + epochs
    if n:
        out["y 100–250 m"] = near / n
    return out


def main() -> None:
    """Replay, draw, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sessions", type=Path, nargs="+", metavar="SESSION")
    parser.add_argument("--draws", type=int, default=5)
    options = parser.parse_args()
    for session in options.sessions:
        truth, found = true_pixels(session), dict[Key, Detection]()

        def keep(key: Key, result: Any, found: dict[Key, Detection] = found) -> Any:
            if isinstance(result, Detection):
                found[key] = result
            return result

        ours = squares(played(session, keep))
        noise = noise_by_range(found, truth)
        drawn: dict[str, list[np.ndarray]] = {}
        for seed in range(options.draws):
            generator = np.random.default_rng(seed)

            def put(key: Key, result: Any, generator: Any = generator, truth: Any = truth, noise: Any = noise) -> Any:
                if not isinstance(result, Detection) or key not in truth:
                    return result
                spread = noise.get((key[0], int(np.digitize(truth[key][2], BINS))), result.covariance_px2)
                u, v = truth[key][:2] + generator.multivariate_normal(np.zeros(2), spread)
                return replace(result, u_px=float(u), v_px=float(v))

            for name, square in squares(played(session, put)).items():
                drawn.setdefault(name, []).append(square)
        print(f"{session.name}: RMSE in m, x/y/z; drawn: {options.draws} times")
        for name, square in ours.items():
            if name in drawn:
                other = np.mean(drawn[name], axis=0)
                a, b, r = (" ".join(f"{v:6.3f}" for v in np.sqrt(s)) for s in (square, other, square / other))
                print(f"  {name:14} detector {a}   drawn {b}   ratio {r}")


if __name__ == "__main__":
    main()
