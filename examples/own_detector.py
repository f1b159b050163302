"""Put a detector of one's own in place of the program's: here, whatever differs from the sky around it."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

import groundstation

BUNDLED = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"
LEAST_CONTRAST = 20


def differing(
    image: np.ndarray, region: groundstation.Box[int], hint: groundstation.DetectionHint | None
) -> Sequence[groundstation.TargetCandidate] | None:
    """Return what differs from its surroundings in the box; the filter chooses among several.

    The box is the whole picture and the hint is None while no target is tracked.
    """
    part = np.ascontiguousarray(image[region.slices])
    around = cv2.blur(part, (61, 61))
    blue, green, red = cv2.split(cv2.absdiff(part, around))
    differs = (cv2.max(cv2.max(blue, green), red) > LEAST_CONTRAST).astype(np.uint8)
    # a pale wing falls to pieces
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(cv2.dilate(differs, np.ones((7, 25), np.uint8)))
    found = []
    # the first is everything else
    for k, (x, y, w, h, _) in list(enumerate(boxes))[1:]:
        box = slice(y, y + h), slice(x, x + w)
        v, u = np.nonzero(differs[box] * (labels[box] == k))
        width = float(np.ptp(u)) + 1.0
        if len(u) < 12 or width > 200.0:
            continue
        # the target point is the nose, of which this knows only that it is about in the middle
        found.append(
            groundstation.TargetCandidate(
                u_px=region.x0 + float(x) + 0.5 * float(u.min() + u.max()),
                v_px=region.y0 + float(y) + float(v.mean()),
                covariance_px2=np.diag([(0.05 * width + 0.5) ** 2] * 2),
                width_px=width,
                log_odds=min(len(u) / 50.0, 3.0),
            )
        )
    return sorted(found, key=lambda candidate: -candidate.log_odds)[:10]


def main() -> None:
    """Replay four seconds with the function and with the program's detector."""
    np.set_printoptions(suppress=True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--session", type=Path, default=BUNDLED)
    session = parser.parse_args().session

    for name, detector in (("own detector", differing), ("the program's", None)):
        run = groundstation.replay_session(session, from_s=20.0, to_s=24.0, detector=detector)
        found = {station: int(np.isfinite(camera.pixel_px[:, 0]).sum()) for station, camera in run.cameras.items()}
        print(f"{name}: {run.tracking.sum()} of {len(run.t_s)} pairs tracked, pixels found {found}")
        if run.tracking.any():
            sigma = run.covariance_m2[run.tracking][-1].diagonal() ** 0.5
            print(f"  at last {run.position_m[run.tracking][-1].round(2)} ± {sigma.round(2)} m")


if __name__ == "__main__":
    try:
        main()
    except groundstation.InputError as fault:
        sys.exit(f"groundstation: {fault}")
