"""How many lost aircraft come into view again: `benchmarks/lost_search.py [--blind 6] [--psd 3] [--flights 200]`.

An aircraft is lost at 400 m and flies on with white acceleration. It can be seen again after ``--blind`` seconds, by
cameras whose heads follow the search at up to 40 degrees a second. One that stays in view for half a second is found.
"""

import argparse
import math
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.messages import Kinematics  # noqa: E402
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern  # noqa: E402
from tests.stereo_rig import make_rig  # noqa: E402

STEP_S, SEEN_S, HEAD_RAD_S = 0.02, 0.5, math.radians(40.0)
# how old the session is at the loss
AGE_S = 1000.0
POSITION_M, VELOCITY_M_S = np.array([0.0, 400.0, 25.0]), np.array([0.0, -15.0, -0.6])
COVARIANCE = np.diag([0.1, 4.0, 0.1, 0.3, 0.3, 0.3])


def is_found(rng: np.random.Generator, blind_s: float, psd_m2_s3: float) -> bool:
    """Return whether one aircraft is found."""
    stations = {s.name: s.geometry() for s in make_rig().stations}
    pattern = SearchPattern(stations, SearchConfig())
    lens = next(iter(stations.values()))
    view = 0.5 * np.array(lens.image_size_px) / lens.lens.focal_px
    pattern.seen(
        AGE_S, Kinematics(position_runway_m=POSITION_M, velocity_runway_m_s=VELOCITY_M_S, covariance=COVARIANCE)
    )
    sigma = np.sqrt(np.diag(COVARIANCE))
    place, speed = POSITION_M + sigma[:3] * rng.normal(size=3), VELOCITY_M_S + sigma[3:] * rng.normal(size=3)
    head, seen_s = POSITION_M[[0, 2]] / POSITION_M[1], 0.0
    for t_s in np.arange(0.0, SearchConfig().lost_s, STEP_S).tolist():
        speed = speed + math.sqrt(psd_m2_s3 * STEP_S) * rng.normal(size=3)
        place = place + STEP_S * speed
        if place[2] < 0.0:
            # it does not fly into the ground
            place[2], speed[2] = 0.0, abs(speed[2])
        aim = pattern.point(AGE_S + t_s)
        wanted = aim[[0, 2]] / max(aim[1], 1.0)
        head = head + np.clip(wanted - head, -HEAD_RAD_S * STEP_S, HEAD_RAD_S * STEP_S)
        inside = place[1] > 20.0 and bool(np.all(np.abs(place[[0, 2]] / place[1] - head) < view))
        seen_s = seen_s + STEP_S if inside and t_s > blind_s else 0.0
        if seen_s >= SEEN_S:
            return True
    return False


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blind", type=float, default=6.0, help="seconds for which nothing is seen")
    parser.add_argument("--psd", type=float, default=3.0, help="of the acceleration, m²/s³, each axis")
    parser.add_argument("--flights", type=int, default=200)
    options = parser.parse_args()
    rng = np.random.default_rng(5)
    found = sum(is_found(rng, options.blind, options.psd) for _ in range(options.flights))
    print(f"{found} of {options.flights} found, {100.0 * found / options.flights:.1f} %")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
