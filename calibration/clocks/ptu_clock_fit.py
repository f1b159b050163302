"""Fit of the offset of a PTU's clock to its camera's: one smooth motion that readings and pictures both observe.

It works on recordings. A camera's clock is fitted to the host's in `groundstation/sources/cameras/host_clock_fit.py`.

Pan and tilt are cubic splines of time; the readings are values of them, the pictures differences of them at later or
earlier times, through a small scale and roll of the camera. For each offset, drift, scale and roll the splines' least
squares are linear and are eliminated (variable projection); the residual is minimised by
`scipy.optimize.least_squares`. Equations: docs/derivation.md, section 19.
"""

from dataclasses import dataclass

import numpy as np

from calibration.clocks.image_motion import ImageMotion
from calibration.clocks.motion_spline import CUBIC, MotionSpline
from calibration.clocks.reading_faults import reading_fault
from calibration.robust_fit import OUTLIER_SIGMA, noise_factor
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

LEAST_PAIRS = 20
LEAST_S = 1.5
_SPACINGS_S = (0.4, 0.2, 0.1, 0.05)
_MOST_KNOTS = 700
_SEARCH_S, _SEARCH_STEP_S = 0.3, 0.02
_VARIANCE_ROUNDS = 4
_BLOCK_S = 1.0
_LEAST_BLOCKS = 8
_DRIFT_SPAN_S = 20.0
_DRIFT_SIGNIFICANT = 4.0
_WORST_SIGMA_S = 0.02
_LEAST_RATE_RAD_S = float(np.radians(0.1))
# what noise alone spans
_NOISES = 10.0


class TimingFitError(GroundstationError):
    """The offset between the clocks is not observable from pictures and readings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimingFit:
    """The result for one station.

    Attributes
    ----------
    offset_s, sigma_s : to be added to the PTU clock's offset: the lag of its readings behind their stamps,
        in the camera's clock, at ``middle_s``.
    drift, drift_sigma : of the offset, s/s; 0 and None where the data do not determine it.
    scale, roll_rad : of the camera, estimated together with it.
    reading_sigma_rad, turn_sigma_rad : scatter of readings and of the pictures' turns about the fit.
    spacing_s : of the splines' knots. ``kept`` (n,): pairs used. ``lasting_factor``: factor of the sigma due to
        correlated errors.
    residual_rad : (n, 2) of the pairs; ``rate_rad_s`` (n,) rate of the head at each.
    """

    offset_s: float
    sigma_s: float
    drift: float
    drift_sigma: float | None
    middle_s: float
    scale: float
    roll_rad: float
    reading_sigma_rad: float
    turn_sigma_rad: float
    spacing_s: float
    kept: MaskArray
    lasting_factor: float
    residual_rad: FloatArray
    rate_rad_s: FloatArray


def solve_timing(name: str, readings: FloatArray, motion: ImageMotion, reading_sigma_rad: float) -> TimingFit:
    """Estimate the offset from readings (m, 3) of session time, pan, tilt and a camera's turns.

    Raises `TimingFitError`, one line, where they do not determine it.
    """
    _require_enough(name, readings, motion, reading_sigma_rad)
    t, first = np.unique(readings[:, 0], return_index=True)
    readings = np.column_stack([t, np.unwrap(readings[first, 1:], axis=0)])
    margin = _SEARCH_S + 0.1
    inside = (motion.from_s - margin >= t[0]) & (motion.to_s + margin <= t[-1])
    near = (readings[:, 0] >= motion.from_s.min() - 1.0) & (readings[:, 0] <= motion.to_s.max() + 1.0)
    readings = readings[near]
    kept = inside & _bracketed(readings[:, 0], motion)
    if kept.sum() < LEAST_PAIRS:
        got = f"{int(kept.sum())} pairs of frames with readings {margin:.1f} s before and after them"
        raise TimingFitError(
            f"station {name}: got {got}; wanted at least {LEAST_PAIRS}: PTU and frames of the same time"
        )
    start = _coarse_offset(readings, motion, kept)
    best: tuple[float, MotionSpline, FloatArray, MaskArray] | None = None
    for spacing in _SPACINGS_S:
        if not _possible(readings, motion, spacing):
            continue
        tried = _solved(readings, motion, kept, start, spacing, reading_sigma_rad)
        if best is not None and tried[0] >= best[0]:
            break
        best = tried
    if best is None:
        raise TimingFitError(f"station {name}: {_no_spacing(readings, motion)}")
    return _answer(name, best[1], best[2], best[3])


def _require_enough(name: str, readings: FloatArray, motion: ImageMotion, sigma_rad: float) -> None:
    where = f"station {name}"
    good = len(motion.from_s)
    if motion.frames < LEAST_PAIRS or (good and np.ptp(motion.to_s) < LEAST_S and good < LEAST_PAIRS):
        got = f"{motion.frames} pairs of frames"
        raise TimingFitError(f"{where}: got {got}; wanted at least {LEAST_PAIRS}, better 20 s of a swinging PTU")
    if good < LEAST_PAIRS:
        got = f"{good} pairs of frames whose motion shows, {motion.plain} without texture, {motion.torn} torn"
        wanted = "a scene with texture all over the picture that stands still: trees, houses, ground, no plain sky"
        raise TimingFitError(f"{where}: got {got}; wanted {wanted}")
    if fault := reading_fault(readings, motion):
        got = f"readings that contradict the pictures as they stand, and agree with them with {fault}"
        wanted = "pan positive to the left and tilt upwards, in degrees, each in its column of ptu.csv, in its clock"
        raise TimingFitError(f"{where}: got {got}; wanted {wanted}")
    moves = np.degrees(np.ptp(_thin(readings)[:, 1:], axis=0)).max()
    seconds = max(float(np.ptp(readings[:, 0])), 1e-9)
    path = float(np.abs(np.diff(_thin(readings)[:, 1:], axis=0)).sum()) / seconds
    if moves < 0.05 or path < _LEAST_RATE_RAD_S or moves < _NOISES * np.degrees(sigma_rad):
        got = f"a PTU that moves {moves:.3f} deg in all, {np.degrees(path):.3f} deg/s on average"
        raise TimingFitError(f"{where}: got {got}; wanted one that swings, 5 deg at 0.3 Hz or so")


def _thin(readings: FloatArray) -> FloatArray:
    """Return readings about 0.2 s apart, so that their noise is no motion."""
    step = max(1, round(0.2 / max(float(np.median(np.diff(readings[:, 0]))), 1e-6)))
    return readings[::step]


def _bracketed(t_s: FloatArray, motion: ImageMotion) -> MaskArray:
    """Return which pairs have no gap in the readings around them."""
    gaps = np.flatnonzero(np.diff(t_s) > 0.25)
    good = np.ones(len(motion.from_s), dtype=np.bool_)
    for k in gaps:
        good &= (motion.to_s + _SEARCH_S < t_s[k]) | (motion.from_s - _SEARCH_S > t_s[k + 1])
    return good


def _coarse_offset(readings: FloatArray, motion: ImageMotion, kept: MaskArray) -> float:
    """Return the offset of a grid at which straight lines between the readings fit the turns best."""
    offsets = np.arange(-_SEARCH_S, _SEARCH_S + 1e-9, _SEARCH_STEP_S)
    misfits = []
    for offset in offsets:
        turned = [
            np.interp(motion.to_s[kept] - offset, readings[:, 0], readings[:, k])
            - np.interp(motion.from_s[kept] - offset, readings[:, 0], readings[:, k])
            for k in (1, 2)
        ]
        misfits.append(float(np.mean(np.minimum(np.abs(motion.turn_rad[kept] - np.stack(turned, axis=1)), 0.05))))
    return float(offsets[int(np.argmin(misfits))])


def _possible(readings: FloatArray, motion: ImageMotion, spacing_s: float) -> bool:
    """Return whether knots so far apart leave readings and pictures something to disagree about."""
    span = float(np.ptp(readings[:, 0]))
    step = float(np.median(np.diff(readings[:, 0])))
    frames = float(np.median(motion.to_s - motion.from_s))
    step = max(step, 0.45 * frames)
    return 2.0 * step <= spacing_s and 4.0 * spacing_s <= span and span / spacing_s <= _MOST_KNOTS


def _no_spacing(readings: FloatArray, motion: ImageMotion) -> str:
    """Return what of readings and pictures leaves no spacing of knots that is possible."""
    step = float(np.median(np.diff(readings[:, 0])))
    frames = float(np.median(motion.to_s - motion.from_s))
    widest = 0.5 * max(_SPACINGS_S)
    if 0.45 * frames > widest:
        return f"got pictures {frames:.2f} s apart; wanted {widest / 0.45:.2f} s or less, better 10 and more a second"
    if step > widest:
        return f"got readings {step:.2f} s apart; wanted {widest:.2f} s or less, better 20 and more a second"
    return f"got readings for too short a time; wanted {LEAST_S:g} s or more"


def _knots(readings: FloatArray, spacing_s: float) -> FloatArray:
    first, last = float(readings[0, 0]), float(readings[-1, 0])
    inner = np.linspace(first, last, max(2, round((last - first) / spacing_s) + 1))
    return np.concatenate([[first] * CUBIC, inner, [last] * CUBIC])


def _solved(
    readings: FloatArray, motion: ImageMotion, kept: MaskArray, start: float, spacing: float, sigma: float
) -> tuple[float, MotionSpline, FloatArray, MaskArray]:
    """Return Bayes' information criterion, the model, its parameters and the pairs used, for one spacing of knots."""
    p = np.array([start, 0.0, 0.0, 0.0])
    knots, extra = _knots(readings, spacing), 0.0
    middle = float(0.5 * (motion.from_s[0] + motion.to_s[-1]))
    kept = kept.copy()
    n = 2 * len(readings)
    for round_ in range(_VARIANCE_ROUNDS):
        used = _pairs(motion, kept)
        model = MotionSpline(
            readings=readings,
            motion=used,
            knots=knots,
            weight_reading=1.0 / sigma,
            weight_turn=1.0 / np.sqrt(used.sigma_rad**2 + extra),
            middle_s=middle,
            with_drift=False,
        )
        p = model.solve(p)
        left = model.residual(p)
        m = 2 * len(used.from_s)
        taken = model.freedom(p)
        off_reading, off_turn = left[:n] * sigma, left[n : n + m] / model.weight_turn.T.ravel()
        criterion = _criterion(model, left, n, m, sigma)
        before, sigma = sigma, float(np.sqrt(np.sum(off_reading**2) / max(n - taken[0], 1.0)))
        white = np.hypot(*left[n : n + m].reshape(2, -1))
        good = white < OUTLIER_SIGMA * noise_factor(white)
        places = np.flatnonzero(kept)
        kept[places[~good]] = False
        # variance beyond the windows' own agreement, the same for all pairs
        variance = float(np.sum(off_turn.reshape(2, -1)[:, good] ** 2)) / max(2 * good.sum() - taken[1], 1.0)
        added, extra = extra, max(variance - float(np.mean(used.sigma_rad[good] ** 2)), 0.0)
        settled = good.all() and abs(sigma - before) < 0.02 * sigma and abs(extra - added) < 0.05 * (variance + extra)
        if settled or round_ == _VARIANCE_ROUNDS - 1:
            return criterion, model, p, kept
    raise TimingFitError("no round was made")


def _criterion(model: MotionSpline, left: FloatArray, n: int, m: int, sigma: float) -> float:
    """Return Bayes' information criterion; the turns scatter no less than the windows' agreement implies."""
    count = 2 * (len(model.knots) - CUBIC - 1)
    readings = n * np.log(np.sum((left[:n] * sigma) ** 2) / n)
    turns = float(np.sum(left[n : n + m] ** 2)) - 2.0 * float(np.sum(np.log(model.weight_turn)))
    return float(readings + turns + count * np.log(n + m))


def _pairs(motion: ImageMotion, kept: MaskArray) -> ImageMotion:
    return ImageMotion(
        from_s=motion.from_s[kept],
        to_s=motion.to_s[kept],
        turn_rad=motion.turn_rad[kept],
        sigma_rad=motion.sigma_rad[kept],
        frames=motion.frames,
        plain=motion.plain,
        torn=motion.torn,
    )


def _answer(name: str, model: MotionSpline, p: FloatArray, kept: MaskArray) -> TimingFit:
    covariance, factor = _covariance(model, p)
    drift, drift_sigma = 0.0, None
    if float(np.ptp(model.motion.from_s)) >= _DRIFT_SPAN_S:
        drifting = MotionSpline(
            **{
                f: getattr(model, f)
                for f in ("readings", "motion", "knots", "weight_reading", "weight_turn", "middle_s")
            },
            with_drift=True,
        )
        q = drifting.solve(p)
        wider, factor_drift = _covariance(drifting, q)
        drift_sigma = float(np.sqrt(wider[1, 1])) * factor_drift
        if abs(q[1]) > _DRIFT_SIGNIFICANT * drift_sigma:
            model, p, covariance, factor, drift = drifting, q, wider, factor_drift, float(q[1])
    sigma = float(np.sqrt(covariance[0, 0])) * factor
    rate = np.linalg.norm(model.motion.turn_rad, axis=1) / (model.motion.to_s - model.motion.from_s)
    if not sigma < _WORST_SIGMA_S:
        got = f"± {1e3 * sigma:.0f} ms, the PTU turning at {np.degrees(rate).max():.2f} deg/s at most"
        raise TimingFitError(f"station {name}: got {got}; wanted a PTU that swings, 5 deg at 0.3 Hz or so")
    if abs(p[0]) > _SEARCH_S + _SEARCH_STEP_S:
        got = f"an offset beyond {_SEARCH_S:g} s"
        raise TimingFitError(f"station {name}: got {got}; wanted clocks that differ less from those of the rig")
    n, m = 2 * len(model.readings), 2 * len(model.motion.from_s)
    left = model.residual(p)
    off = (left[n : n + m] / model.weight_turn.T.ravel()).reshape(2, -1).T
    return TimingFit(
        offset_s=float(p[0]),
        sigma_s=sigma,
        drift=drift,
        drift_sigma=drift_sigma,
        middle_s=model.middle_s,
        scale=float(p[2]),
        roll_rad=float(p[3]),
        reading_sigma_rad=1.0 / model.weight_reading,
        turn_sigma_rad=float(np.sqrt(np.mean(off**2))),
        spacing_s=float(np.median(np.diff(np.unique(model.knots)))),
        kept=kept,
        lasting_factor=factor,
        residual_rad=off,
        rate_rad_s=rate,
    )


def _covariance(model: MotionSpline, p: FloatArray) -> tuple[FloatArray, float]:
    """Return (JᵀJ)⁻¹ of the residuals (4, 4), and the factor of the offset's sigma due to correlated errors.

    Successive turns share a frame, and coding errors persist: turns of one second count as one observation, if their
    scatter exceeds chance.
    """
    jacobian, left = model.jacobian(p), model.residual(p)
    information = jacobian.T @ jacobian + np.diag(1.0 / model.prior() ** 2)
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    n, m = len(model.readings), len(model.motion.from_s)
    times = np.concatenate([np.tile(model.readings[:, 0], 2), np.tile(model.motion.to_s, 2)])
    block = np.floor((times - times.min()) / _BLOCK_S).astype(np.int64)
    blocks = int(block.max()) + 1
    if blocks < _LEAST_BLOCKS:
        return covariance, 1.0
    scores = np.zeros((blocks, 4))
    np.add.at(scores, block, (jacobian * left[:, None])[: 2 * n + 2 * m])
    meat = covariance @ (scores.T @ scores) @ covariance * blocks / (blocks - 1)
    ratio = float(meat[0, 0] / covariance[0, 0])
    return covariance, float(np.sqrt(ratio)) if ratio > 1.0 + 2.0 * np.sqrt(2.0 / blocks) else 1.0
