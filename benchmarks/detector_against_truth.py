"""Share of the detector in the track's error: the same filter with true pixels and the detector's measured noise.

    python benchmarks/detector_against_truth.py SESSION… [--draws N]

A rendered session is replayed. Its detections are compared with truth.csv, which gives their noise: per camera and bin
of range, the covariance of their error, and its correlation in time: a share of it decays exponentially, the rest is
white (fitted to the autocorrelation up to one second, both cameras and axes together). Then the session is replayed
again, and every detection is put at the true pixel plus noise without bias drawn from that covariance, once white and
once correlated as measured; all else is unchanged: the same frames, the same PTU readings, the same stated
covariances, the same misses. Printed are the RMSE of both against the truth, by bins of range, and their ratio; of the
drawn ones the root of the mean square over the draws.
"""

import argparse
import csv
import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

from groundstation.detection.detector import Detector
from groundstation.messages import Detection, Frame
from groundstation.replay.replay import ReplayRequest
from groundstation.replay.replay import replay as replay_session
from groundstation.tracking.camera_tracker import CameraTracker

BINS = (0.0, 60.0, 100.0, 150.0, 250.0, 400.0, 700.0)
_LAGS_S = 1.0
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


def step_of(session: Path) -> float:
    """Return the time from frame to frame, s."""
    with (session / "truth.csv").open() as file:
        return float(np.median(np.diff([float(row["t_s"]) for row in csv.DictReader(file)])))


def played(session: Path, change: Callable[[Key, Any], Any]) -> dict[str, Any]:
    """Replay the session, every result of the detector passed through ``change``; return the accuracy."""
    look, detect = CameraTracker.detect, Detector.detect
    now: list[Key] = []

    def noted(self: CameraTracker, record: Frame, *rest: Any) -> Any:
        now[:] = [(record.station, record.epoch)]
        return look(self, record, *rest)

    def changed(self: Detector, *arguments: Any) -> Any:
        result = detect(self, *arguments)
        return change(now[0], result) if now else result

    CameraTracker.detect, Detector.detect = noted, changed  # type: ignore[method-assign, assignment]
    try:
        with tempfile.TemporaryDirectory() as folder:
            result = replay_session(ReplayRequest(session=session, out=Path(folder), rerun=False))
    finally:
        CameraTracker.detect, Detector.detect = look, detect  # type: ignore[method-assign]
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


def lasting(
    found: dict[Key, Detection], truth: dict[Key, np.ndarray], noise: dict[tuple[str, int], np.ndarray], step_s: float
) -> tuple[float, float]:
    """Return the share of the errors' variance that lasts, and its time constant in s."""
    most = round(_LAGS_S / step_s)
    whitened = {}
    for key, detection in found.items():
        if key in truth:
            error = np.array([detection.u_px, detection.v_px]) - truth[key][:2]
            spread = noise[key[0], int(np.digitize(truth[key][2], BINS))]
            whitened[key] = np.linalg.solve(np.linalg.cholesky(spread + 1e-9 * np.eye(2)), error)
    correlation = np.array(
        [
            np.mean([whitened[s, k] * whitened[s, k + lag] for s, k in whitened if (s, k + lag) in whitened])
            for lag in range(1, most + 1)
        ]
    )
    lags_s = step_s * np.arange(1, most + 1)
    (share, time_s), _ = curve_fit(
        lambda t, a, tau: a * np.exp(-t / tau), lags_s, correlation, p0=(0.5, 0.5), bounds=([0.0, step_s], [1.0, 30.0])
    )
    return float(share), float(time_s)


class Noise:
    """Noise of one draw: (2,) of unit covariance for each frame, a share of which lasts."""

    def __init__(self, seed: int, share: float, keep: float) -> None:
        self._generator = np.random.default_rng(seed)
        self._share, self._keep = share, keep
        self._state: dict[str, tuple[int, np.ndarray]] = {}

    def __call__(self, key: Key) -> np.ndarray:
        """Return the next of a camera's frames."""
        station, epoch = key
        last, old = self._state.get(station, (epoch, self._generator.standard_normal(2)))
        kept = self._keep ** (epoch - last)
        slow = kept * old + math.sqrt(1.0 - kept**2) * self._generator.standard_normal(2)
        self._state[station] = (epoch, slow)
        white = self._generator.standard_normal(2)
        return np.asarray(math.sqrt(self._share) * slow + math.sqrt(1.0 - self._share) * white)


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
        step_s = step_of(session)
        share, time_s = lasting(found, truth, noise, step_s)
        print(f"{session.name}: RMSE in m, x/y/z, {options.draws} draws; {share:.2f} of the noise lasts {time_s:.2f} s")
        for kind, part in (("white", 0.0), ("lasting", share)):
            drawn: dict[str, list[np.ndarray]] = {}
            for seed in range(options.draws):
                draw = Noise(seed, part, math.exp(-step_s / time_s))

                def put(key: Key, result: Any, draw: Any = draw, truth: Any = truth, noise: Any = noise) -> Any:
                    if not isinstance(result, Detection) or key not in truth:
                        return result
                    spread = noise.get((key[0], int(np.digitize(truth[key][2], BINS))), result.covariance_px2)
                    u, v = truth[key][:2] + np.linalg.cholesky(spread + 1e-9 * np.eye(2)) @ draw(key)
                    return replace(result, u_px=float(u), v_px=float(v))

                for name, square in squares(played(session, put)).items():
                    drawn.setdefault(name, []).append(square)
            for name, square in ours.items():
                if name in drawn:
                    other = np.mean(drawn[name], axis=0)
                    a, b, r = (" ".join(f"{v:6.3f}" for v in np.sqrt(s)) for s in (square, other, square / other))
                    print(f"  {name:14} detector {a}   drawn {kind:7} {b}   ratio {r}")


if __name__ == "__main__":
    main()
