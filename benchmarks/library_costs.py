"""Geodesy, rotations and dual quaternions of this project against libraries: differences, and time as a ratio.

python benchmarks/library_costs.py
"""

import statistics
import sys
import timeit
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymap3d
from pytransform3d import transformations
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.geometry import dual_quaternion, geodesy, rotation  # noqa: E402

PLACES = 200_000
ORIGIN = (45.0, 7.0, 100.0)
M_PER_DEG = 111e3


def microseconds(call: Callable[[], object], number: int) -> float:
    """Return the median time of a call, five repetitions."""
    return statistics.median(timeit.repeat(call, number=number, repeat=5)) / number * 1e6


def compare(name: str, own: Callable[[], object], library: Callable[[], object], number: int = 500) -> None:
    """Print both times and their ratio."""
    ours, theirs = microseconds(own, number), microseconds(library, number)
    print(f"{name:<34}{ours:>9.1f} µs{theirs:>9.1f} µs   library / own {theirs / ours:5.2f}")


def compare_geodesy(rng: np.random.Generator) -> None:
    """Print differences and round trips over the whole Earth, heights of -1 to 100 km, and times."""
    lat = np.degrees(np.arcsin(rng.uniform(-1.0, 1.0, PLACES)))
    lon, height = rng.uniform(-180.0, 180.0, PLACES), rng.uniform(-1e3, 1e5, PLACES)
    ecef = geodesy.ecef_from_geodetic(lat, lon, height)
    theirs = np.stack(pymap3d.geodetic2ecef(lat, lon, height), axis=-1)
    print(f"earth-centred, largest difference {np.abs(ecef - theirs).max():.1e} m")
    for name, back in (("own", geodesy.geodetic_from_ecef(ecef)), ("pymap3d", pymap3d.ecef2geodetic(*ecef.T))):
        off = np.abs(np.asarray(back[0]) - lat).max() * M_PER_DEG
        print(
            f"there and back, {name}: latitude {off:.1e} m, height {np.abs(np.asarray(back[2]) - height).max():.1e} m"
        )
    for count, number in ((1, 300), (1_000, 50)):
        place, at = (lat[:count], lon[:count], height[:count]), ecef[:count]
        compare(
            f"geodetic to earth-centred, {count}",
            lambda place=place: geodesy.ecef_from_geodetic(*place),  # type: ignore[misc]
            lambda place=place: np.stack(pymap3d.geodetic2ecef(*place), axis=-1),  # type: ignore[misc]
            number,
        )
        compare(
            f"earth-centred to geodetic, {count}",
            lambda at=at: geodesy.geodetic_from_ecef(at),  # type: ignore[misc]
            lambda at=at: pymap3d.ecef2geodetic(*at.T),  # type: ignore[misc]
            number,
        )


def compare_rotations(rng: np.random.Generator) -> None:
    """Print the times of one conversion."""
    q, vector = rng.normal(size=4), rng.normal(size=3)
    q /= np.linalg.norm(q)
    matrix = rotation.matrix_from_wxyz(q)
    compare(
        "matrix from quaternion",
        lambda: rotation.matrix_from_wxyz(q),
        lambda: Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix(),
    )
    compare(
        "quaternion from matrix",
        lambda: rotation.wxyz_from_matrix(matrix),
        lambda: Rotation.from_matrix(matrix).as_quat(canonical=True)[[3, 0, 1, 2]],
    )
    compare(
        "matrix from rotation vector",
        lambda: rotation.rotation_from_vector(vector),
        lambda: Rotation.from_rotvec(vector).as_matrix(),
    )


def compare_dual_quaternions(rng: np.random.Generator) -> None:
    """Print the times of one operation."""
    q, v = rng.normal(size=(2, 4)), rng.normal(size=(3, 3))
    q /= np.linalg.norm(q, axis=1)[:, None]
    a, b = dual_quaternion.from_pose(q[0], v[0]), dual_quaternion.from_pose(q[1], v[1])
    compare(
        "dual quaternions' product",
        lambda: dual_quaternion.multiply(a, b),
        lambda: transformations.concatenate_dual_quaternions(a, b),
    )
    compare(
        "moved point",
        lambda: dual_quaternion.transform_point(a, v[2]),
        lambda: transformations.dq_prod_vector(a, v[2]),
    )
    pose = np.concatenate([v[0], q[0]])
    compare(
        "dual quaternion from pose",
        lambda: dual_quaternion.from_pose(q[0], v[0]),
        lambda: transformations.dual_quaternion_from_pq(pose),
    )


def main() -> None:
    """Print all comparisons."""
    rng = np.random.default_rng(1)
    compare_geodesy(rng)
    compare_rotations(rng)
    compare_dual_quaternions(rng)


if __name__ == "__main__":
    main()
