"""Runways that are not as wide as announced: error along the track, its bound, and consistency, without pictures.

    python benchmarks/onboard_width.py [--flights N] [--first SEED] [--width-sigma SHARE]

Each flight is a nose camera's approach from 330 m to 45 m whose corners are simulated: with noise in each picture, with
errors that last drawn from the modes that the chain states, and of a runway whose width is drawn about the announced
one. Pose solver, inertial filter, consider filters and `LastingErrors` run as in `NoseNavigator`; heights are those of
a navigation 1.5 m off for good with 0.1 m of noise in each picture, or there are none. The bound is that of all that
is unknown together, with all heights up to the moment and a filter whose own height is exact.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.edges.pose import intrinsic_matrix
from groundstation.onboard.pose.inertial_filter import (
    POSITION,
    InertialFilter,
    PoseObservation,
    UpdateOutcome,
)
from groundstation.onboard.pose.pose_solver import PointCorrespondences, solve_pose
from groundstation.onboard.pose.runway import rectangle
from groundstation.onboard.scenes.nose_flight import NoseFlight, nose_flight, nose_setup
from groundstation.onboard.scenes.sequences import SEQUENCES
from groundstation.onboard.visual_inertial.config import ApproachConfig
from groundstation.onboard.visual_inertial.consider_parameters import ConsiderFilterBank
from groundstation.onboard.visual_inertial.corner_errors import systematic_modes, width_mode
from groundstation.onboard.visual_inertial.lasting_errors import KnownHeight, LastingErrors
from groundstation.onboard.visual_inertial.pose_sensitivity import pose_jacobian_of_pixels

PICTURE_PX = 0.3
LASTING_M, NOISE_M = 1.5, 0.1
# of one end of each edge, and of thresholds: less than what the chain allows for, so that the width is what matters
CONFIG = replace(ApproachConfig(), side_sigma_px=0.3, near_sigma_m=0.5, end_sigma_px=0.3, far_end_sigma_px=0.3)
_MODES = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WidthFlight:
    """The end of a flight: error (3,) m of the body's place, its covariance, and the bound along the track, m."""

    error_m: FloatArray
    covariance_m2: FloatArray
    bound_m: float

    @property
    def nees(self) -> float:
        """Return the normalised squared error, of 3."""
        return float(self.error_m @ np.linalg.solve(self.covariance_m2, self.error_m))


class _SeenRunway:
    """Corners of a runway as one flight sees them: wider than announced, and with its own lasting errors."""

    def __init__(self, flight: NoseFlight, width_sigma: float, rng: np.random.Generator) -> None:
        self._flight, self._rng, self._width_sigma = flight, rng, width_sigma
        announced = flight.runway
        self._wider = 1.0 + width_sigma * float(rng.standard_normal())
        self._runway = rectangle(announced.length_m, announced.width_m * self._wider)
        self._errors = rng.standard_normal(_MODES)
        self._kappa = intrinsic_matrix(flight.setup.lens)

    def modes(self, pixels: FloatArray) -> FloatArray:
        """Return the columns (8, 9) of what lasts, the width's last."""
        own = systematic_modes(pixels, self._flight.runway, CONFIG)[:, -_MODES:]
        return np.hstack([own, width_mode(pixels, self._width_sigma)[:, None]])

    def pixels(self, sample: int) -> FloatArray:
        """Return the corners (4, 2) of a picture."""
        pose = self._flight.pose(sample)
        rays = (self._runway.corners_m - pose.camera_threshold_m) @ pose.threshold_from_camera @ self._kappa.T
        exact = rays[:, :2] / rays[:, 2:]
        lasting = (self.modes(exact)[:, :_MODES] @ self._errors).reshape(4, 2)
        return np.asarray(exact + lasting + PICTURE_PX * self._rng.standard_normal((4, 2)))


def flown(seed: int, width_sigma: float, *, heights: bool, seconds: float = 13.0, camera_hz: int = 10) -> WidthFlight:
    """Fly one approach to a runway whose width is known to a share of it, with heights or without."""
    sequence = replace(SEQUENCES[0], seed=seed)
    flight = nose_flight(sequence, nose_setup(sequence, seconds, camera_hz=camera_hz))
    rng = np.random.default_rng([seed, 3])
    seen, setup, motion = _SeenRunway(flight, width_sigma, rng), flight.setup, flight.motion
    kappa, corners = intrinsic_matrix(setup.lens), flight.runway.corners_m
    main = InertialFilter(setup.config, setup.mount)
    bank, learnt = ConsiderFilterBank(setup.config, setup.mount, _MODES + 1), LastingErrors(_MODES + 1, 3.0)
    lasting_m, information = LASTING_M * float(rng.standard_normal()), np.eye(_MODES + 2)
    information[-1, -1] = LASTING_M**-2
    frames, fed = flight.frames, 0
    for sample in frames:
        while fed <= sample:
            main.process_imu(motion.samples[fed])
            bank.process_imu(motion.samples[fed])
            fed += 1
        observation = _observation(seen, sample, kappa, corners, flight)
        if observation is None:
            continue
        innovation = main.update(observation[0])
        bank.update(*observation)
        if not heights or innovation.outcome is not UpdateOutcome.USED:
            continue
        S, known_m = bank.sensitivity(main.navigation), float(motion.position_m[sample, 2]) + lasting_m
        known = KnownHeight(up_m=known_m + NOISE_M * float(rng.standard_normal()), lasting_m=LASTING_M, noise_m=NOISE_M)
        off_m = float(main.navigation.position_m[2]) - known.up_m
        learnt.update(float(motion.t_s[sample]), off_m, S[2], float(main.navigation.P[POSITION, POSITION][2, 2]), known)
        h = np.append(S[2], -1.0)
        information += np.outer(h, h) / NOISE_M**2
    now, last = main.navigation, frames[-1]
    S = bank.sensitivity(now)[:3]
    own, best = now.P[POSITION, POSITION], np.linalg.inv(information)[:-1, :-1]
    learnt_m, covariance_m2 = learnt.corrected(float(motion.t_s[last]), S, own, 2)
    return WidthFlight(
        error_m=now.position_m - learnt_m - motion.position_m[last],
        covariance_m2=covariance_m2,
        bound_m=float(np.sqrt(own[1, 1] + S[1] @ best @ S[1])),
    )


def _observation(
    seen: _SeenRunway, sample: int, kappa: FloatArray, corners: FloatArray, flight: NoseFlight
) -> tuple[PoseObservation, FloatArray] | None:
    """Return a picture's pose as the filter takes it, and what one sigma of each lasting error makes of it."""
    pixels = seen.pixels(sample)
    modes = seen.modes(pixels)
    rows = modes[:, :_MODES].reshape(4, 2, -1)
    independent = PICTURE_PX**2 * np.broadcast_to(np.eye(2), (4, 2, 2))
    whole = independent + rows @ np.swapaxes(rows, 1, 2)
    pose = solve_pose(
        PointCorrespondences(points_m=corners, pixels=pixels, covariance_px2=whole, lens=flight.setup.lens)
    )
    if pose is None:
        return None
    D = pose_jacobian_of_pixels(corners, kappa, pose.position_m, matrix_from_wxyz(pose.runway_from_camera_wxyz), whole)
    if D is None:
        return None
    lasting = D @ modes
    return PoseObservation(
        t_s=float(flight.motion.t_s[sample]),
        position_m=pose.position_m,
        runway_from_camera_wxyz=pose.runway_from_camera_wxyz,
        covariance=PICTURE_PX**2 * D @ D.T,
        lasting=lasting @ lasting.T,
    ), lasting


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--first", type=int, default=41_000, help="seed of the first")
    parser.add_argument("--width-sigma", type=float, default=0.05, help="of the width, as a share of it")
    options = parser.parse_args()
    print(
        "| heights | flights | rms along the track, m | bound, m | over it | NEES (3), band | along the track alone |"
    )
    print("|---|---|---|---|---|---|---|")
    for heights in (False, True):
        seeds = range(options.first, options.first + options.flights)
        found = [flown(seed, options.width_sigma, heights=heights) for seed in seeds]
        rms = float(np.sqrt(np.mean([one.error_m[1] ** 2 for one in found])))
        bound = float(np.sqrt(np.mean([one.bound_m**2 for one in found])))
        nees = float(np.mean([one.nees for one in found])) / 3.0
        low, high = (float(chi2.ppf(p, 3 * len(found))) / (3 * len(found)) for p in (0.025, 0.975))
        own = float(np.mean([one.error_m[1] ** 2 / one.covariance_m2[1, 1] for one in found]))
        print(
            f"| {'known' if heights else 'none'} | {len(found)} | {rms:.2f} | {bound:.2f} | {rms / bound:.2f} "
            f"| {nees:.2f}, {low:.2f}–{high:.2f} | {own:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
