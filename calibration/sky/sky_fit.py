"""All heads of one day together: airliners' paths, the receiver's latency and the Moon are common to them.

An airliner's place is known to tens of metres, its direction therefore to tenths of a degree, and one head alone learns
little. Both heads see the same airliner at the same place, and their relative direction is left with its parallax only:
all heads are solved in one problem.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.flight.problem import left_jacobian
from calibration.information import inverse
from calibration.mount.covariance import BASE, BORESIGHT, whitened
from calibration.mount.fit import MountFit, RejectedSighting, find_outliers
from calibration.mount.parameters import KNOWN_BACKLASH_RAD, KNOWN_SCALE
from calibration.mount.problem import PERIODIC_AXES, Mark, MountProblem
from calibration.robust_fit import (
    FitProblem,
    Linearisation,
    Loss,
    minimise,
    noise_factor,
    pixel_linearisation,
    stacked,
    whitened_length,
    whitening_of,
)
from calibration.stars.head_start import StarFitError
from calibration.stars.joint_night import JointNight
from calibration.stars.station_night import PRIOR_DISTORTION, PRIOR_FOCAL_SHARE, PRIOR_PERIODIC_RAD, StationNight
from calibration.stars.station_night import PRIOR_PRINCIPAL_POINT_SHARE as CENTRE_SHARE
from groundstation.arrays import FloatArray, MaskArray
from groundstation.rig.rig import Station

# one sigma a priori: a pedestal levelled by a bubble, and turned by eye
PRIOR_LEVEL_RAD = float(np.radians(1.0))
PRIOR_HEADING_RAD = float(np.radians(3.0))
# of a head that a workshop or another place has calibrated, where the rig does not state how well
KNOWN_BORESIGHT_RAD = float(np.radians(0.5))
KNOWN_LEAN_RAD = float(np.radians(0.05))
# of a lens that was calibrated, where the rig does not state how well
KNOWN_FOCAL_SHARE, KNOWN_CENTRE_PX = 0.001, 3.0
KNOWN_DISTORTION = {"k1": 0.02, "k2": 0.1, "p1": 0.0005, "p2": 0.0005}
# from degrees to within a sigma; the last fit converges
_ROBUST_ROUNDS, _FINAL_ROUNDS, _FEW_EVALUATIONS = 3, 2, 8
_LEAST_KEPT_SHARE = 0.5
LEAST_PICTURES = 6


def sky_priors(station: Station, stated: Mapping[str, float], marks: Sequence[Mark]) -> dict[str, float]:
    """Return names and prior sigmas of the parameters that a day finds: what the rig states, else what is usual.

    ``stated`` are the sigmas of the station's calibration in its rig, `Rig.station_covariance`: its marginals.
    """
    known = "lens" in station.known
    focal = (KNOWN_FOCAL_SHARE if known else PRIOR_FOCAL_SHARE) * float(station.lens.focal_px.mean())
    centre = KNOWN_CENTRE_PX if known else CENTRE_SHARE * station.lens.image_size_px[0]
    distortion = KNOWN_DISTORTION if known else PRIOR_DISTORTION
    usual = {
        **dict.fromkeys(BORESIGHT, KNOWN_BORESIGHT_RAD),
        **dict.fromkeys(BASE[:2], PRIOR_LEVEL_RAD),
        BASE[2]: PRIOR_HEADING_RAD,
        "pan_scale": KNOWN_SCALE,
        "tilt_scale": KNOWN_SCALE,
        "lean": KNOWN_LEAN_RAD,
        "pan_backlash": KNOWN_BACKLASH_RAD,
        "tilt_backlash": KNOWN_BACKLASH_RAD,
        **dict.fromkeys(PERIODIC_AXES, PRIOR_PERIODIC_RAD),
        **{f"focal.{axis}": focal for axis in "xy"},
        **{f"principal_point.{axis}": centre for axis in "xy"},
        **{f"distortion.{name}": sigma for name, sigma in distortion.items()},
    }
    # heads that were put up since are where their bases are found, not where the rig has them
    chosen = {n: s if n in BASE or not stated.get(n) else float(stated[n]) for n, s in usual.items()}
    for mark in marks:
        for k, name in enumerate(mark.names):
            sigma = float(mark.sigma[min(k, 2)])
            if sigma > 0.0:
                chosen[name] = sigma
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointProblem:
    """The problems of s stations with common names of p parameters; ``columns`` are each station's places in them."""

    problems: tuple[MountProblem, ...]
    names: tuple[str, ...]
    columns: tuple[tuple[int, ...], ...]

    def own(self, change: FloatArray, k: int) -> FloatArray:
        """Return the parameters of one station's problem."""
        return np.asarray(change[list(self.columns[k])])

    def placed(self, part: Linearisation, k: int) -> Linearisation:
        """Return residuals of one station by all parameters."""
        jacobian = np.zeros((len(part.residual), len(self.names)))
        jacobian[:, list(self.columns[k])] = part.jacobian
        return Linearisation(residual=part.residual, jacobian=jacobian)

    def _of_all(self, values: Sequence[FloatArray]) -> FloatArray:
        whole = np.zeros(len(self.names))
        for own, columns in zip(values, self.columns, strict=True):
            whole[list(columns)] = own
        return whole

    @property
    def prior_sigma(self) -> FloatArray:
        """Prior sigmas (p,)."""
        return self._of_all([p.prior_sigma for p in self.problems])

    @property
    def step_scale(self) -> FloatArray:
        """Typical steps (p,)."""
        return self._of_all([p.step_scale for p in self.problems])

    def fit(self, kept: Sequence[MaskArray]) -> FitProblem:
        """Return the fit of the kept sightings of each station."""
        return FitProblem(
            evaluate=lambda at: self.whitened(at, kept), prior_sigma=self.prior_sigma, step_scale=self.step_scale
        )

    def whitened(self, change: FloatArray, kept: Sequence[MaskArray]) -> Linearisation:
        """Return whitened residuals and derivatives of all kept sightings."""
        parts = []
        for k, problem in enumerate(self.problems):
            own = self.own(change, k)
            parts.append(self.placed(whitened(problem, problem.predict(own), kept[k]), k))
        return stacked(parts)

    def robust(self, change: FloatArray) -> FitProblem:
        """Return a fit of all sightings with a loss that outliers hardly draw, its noise as it is at ``change``."""
        whitening = []
        for k, problem in enumerate(self.problems):
            sought = problem.predict(self.own(change, k))
            covariance = problem.covariance_px2(sought.by_angle)
            length = whitened_length(sought.pixel_px - problem.sightings.pixel_px, covariance)
            whitening.append(whitening_of(covariance) / noise_factor(length[sought.usable]))

        def evaluate(at: FloatArray) -> Linearisation:
            parts = []
            for k, problem in enumerate(self.problems):
                seen = problem.sightings.pixel_px
                everything = np.ones(len(seen), dtype=np.bool_)
                part = pixel_linearisation(problem.predict(self.own(at, k)), seen, whitening[k], everything)
                parts.append(self.placed(part, k))
            return stacked(parts)

        return FitProblem(
            evaluate=evaluate, prior_sigma=self.prior_sigma, step_scale=self.step_scale, loss=Loss.SOFT_L1
        )


def joint_problem(problems: Sequence[MountProblem]) -> JointProblem:
    """Return several stations' problems with their marks' parameters in common."""
    names: list[str] = []
    columns = []
    for problem in problems:
        own = [n if n.startswith("mark ") else f"{problem.station.name}.{n}" for n in problem.names]
        names += [n for n in own if n not in names]
        columns.append(tuple(names.index(n) for n in own))
    return JointProblem(problems=tuple(problems), names=tuple(names), columns=tuple(columns))


def solve_sky(joint: JointProblem, start: FloatArray, before: Sequence[Station]) -> JointNight:
    """Solve all stations from a start (p,); raises `StarFitError` where most sightings do not fit."""
    change = start
    for _ in range(_ROBUST_ROUNDS):
        change = minimise(joint.robust(change), change, _FEW_EVALUATIONS).parameters
    kept, reasons = _outliers(joint, change)
    for _ in range(_FINAL_ROUNDS):
        change = minimise(joint.fit(kept), change, _FEW_EVALUATIONS).parameters
        kept, reasons = _outliers(joint, change)
    change = minimise(joint.fit(kept), change).parameters
    for problem, used in zip(joint.problems, kept, strict=True):
        if float(used.mean()) < _LEAST_KEPT_SHARE or int(used.sum()) < LEAST_PICTURES:
            got = f"{int(used.sum())} of {len(used)} pictures whose airliner or Moon fits"
            wanted = f"{LEAST_PICTURES} or more that do: are times and angles those of the pictures?"
            raise StarFitError(f"station {problem.station.name}: got {got}; wanted {wanted}")
    left = joint.whitened(change, kept)
    # a path's deviations of which the sightings say nothing take up no residual
    taken = len(change) - float(np.sum(_prior_share(left, joint.prior_sigma)))
    factor = max(1.0, float(np.sqrt(left.chi_square / max(len(left.residual) - taken, 1.0))))
    known = left.information / factor**2 + np.diag(joint.prior_sigma**-2.0)
    covariance = _turned(joint, change, inverse(known))
    nights = []
    for k, problem in enumerate(joint.problems):
        own, places = joint.own(change, k), list(joint.columns[k])
        fit = MountFit(
            problem=problem,
            change=own,
            covariance=covariance[np.ix_(places, places)],
            held={},
            joint_names=problem.names,
            joint_covariance=covariance[np.ix_(places, places)],
            kept=kept[k],
            rejected=tuple(
                RejectedSighting(label=problem.sightings.label[row], reason=text)
                for row, text in sorted(reasons[k].items())
            ),
            residual_px=problem.sightings.pixel_px - problem.predict(own).pixel_px,
            noise_factor=factor,
            held_out=None,
        )
        nights.append(
            StationNight(before=before[k], fit=fit, pictures=(), unused=(), wrongly_solved=0, reading_factor=1.0)
        )
    return JointNight(
        nights=tuple(nights),
        change=tuple(joint.own(change, k) for k in range(len(nights))),
        columns=joint.columns,
        names=joint.names,
        covariance=covariance,
    )


def _outliers(joint: JointProblem, change: FloatArray) -> tuple[list[MaskArray], list[dict[int, str]]]:
    found = [find_outliers(problem, joint.own(change, k)) for k, problem in enumerate(joint.problems)]
    return [kept for kept, _ in found], [reasons for _, reasons in found]


def _prior_share(left: Linearisation, prior_sigma: FloatArray) -> FloatArray:
    """Return the share (p,) of each parameter's information that is its prior's."""
    prior = prior_sigma**-2.0
    return np.asarray(np.clip(np.diag(inverse(left.information + np.diag(prior))) * prior, 0.0, 1.0))


def _turned(joint: JointProblem, change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance with rotations as small angles about the solution."""
    turned = np.eye(len(change))
    for problem, columns in zip(joint.problems, joint.columns, strict=True):
        for group in (BORESIGHT, BASE):
            block = [columns[problem.names.index(n)] for n in group]
            turned[np.ix_(block, block)] = left_jacobian(change[block])
    return np.asarray(turned @ covariance @ turned.T)
