"""Compile kernels before several workers need them at the same time: `python -m tests.compile_kernels ground|aboard`.

The two halves are two processes, and take turns at the kernels that both need.
"""

import os
import sys
import tempfile

from groundstation.cli.start import ONE_THREAD

os.environ.update(ONE_THREAD | os.environ)

import numpy as np

from tests.compile_once import compile_once


def ground() -> None:
    """Compile those of a replay."""
    from groundstation.detection.config import DetectorKind
    from groundstation.tracking.warm_up import warm_up

    for kind in DetectorKind:
        warm_up(kind)


def aboard() -> None:
    """Compile those of the aircraft's own camera: a pose, with a start and without, and a flight of a few pictures."""
    from groundstation.cli.main import main
    from groundstation.onboard.pose.pose_solver import solve_pose
    from tests.onboard.pose.approaches import pose_on_approach, quaternion, seen

    rng = np.random.default_rng(1)
    pose = pose_on_approach(rng, 500.0)
    picture = seen(rng, pose, 0.5)
    if solve_pose(picture) is None or solve_pose(picture, start=(quaternion(pose), pose[0])) is None:
        sys.exit("no pose was found, so not all of the solver is compiled")
    with tempfile.TemporaryDirectory() as folder:
        nose = f"{folder}/flight"
        fly = ["fly", f"{nose}/nose.avi", "--camera", f"{nose}/nose.toml", "--imu", f"{nose}/imu.csv"]
        for words in (["render", "--out", nose, "--frames", "14"], [*fly, "--out", f"{folder}/fly"]):
            if main(["onboard", *words]):
                sys.exit(f"groundstation onboard {words[0]} failed, so not all of it is compiled")


if __name__ == "__main__":
    compile_once()
    {"ground": ground, "aboard": aboard}[sys.argv[1]]()
