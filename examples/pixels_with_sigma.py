"""Track with two fixed cameras and pixels that another program has found, each with its own sigma."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import groundstation

BUNDLED = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"
RATE_HZ = 15.0


def made_up_pixels(rig: groundstation.Rig, point_m: np.ndarray, random: np.random.Generator) -> dict[str, list[float]]:
    """Return what a detector would give for a point: u, v, sigma of each camera that sees it."""
    pixels = {}
    for station in rig.stations:
        seen = station.geometry().project(point_m, 0.0, 0.0)
        if seen is not None:
            # the right camera is out of focus
            sigma = 0.5 if station.name == "left" else 2.0
            pixels[station.name] = [*(seen.pixel + random.normal(0.0, sigma, 2)), sigma]
    return pixels


def main() -> None:
    """Track an approach of six seconds and print the errors with their sigmas."""
    random = np.random.default_rng(1)
    # the bundled rig as if its heads were clamped where they look along the runway
    turning = groundstation.load_rig(BUNDLED / "rig.toml")
    rig = replace(turning, stations=tuple(replace(station, fixed=True) for station in turning.stations))
    tracker = groundstation.Tracker(rig, span_m=2.3)
    for k in range(int(6.0 * RATE_HZ)):
        t_s = k / RATE_HZ
        point = np.array([0.5 * np.sin(t_s), 400.0 - 12.0 * t_s, 2.0 + 0.3 * t_s])
        for estimate in tracker.step_pair(t_s, made_up_pixels(rig, point, random)).estimates:
            if k % 15 == 0 and estimate.kinematics is not None:
                error = estimate.kinematics.position_runway_m - point
                sigma = estimate.kinematics.covariance[:3, :3].diagonal() ** 0.5
                print(f"{estimate.t_s:5.2f} s {estimate.status}: error {error.round(2)} m, sigma {sigma.round(2)} m")


if __name__ == "__main__":
    main()
