"""The verdict on a flight's calibration: undetermined parameters, quality, next steps."""

from dataclasses import dataclass

import numpy as np

from calibration.flight.fit import FlightFit
from calibration.flight.observability import (
    CorrelatedParameters,
    advice_for,
    correlated_parameters,
    unobservable_parameters,
)
from calibration.flight.problem import SLOW_S
from calibration.flight.quality import RangeQuality, range_qualities
from groundstation.rig.covariance import READOUT
from groundstation.rig.rig import Rig

_MOST = 8
_MOST_CONDITION = 1e10
# errors that last raise a sigma so much where labels, lens or target point are off in a pattern
_LASTING = 3.0
_GROSS_SHARE = 0.05
# of the sigma stated with the pixels; and of pixels without a sigma
_MOST_NOISE, _WORST_LABELS_PX = 3.0, 4.5
# significant deviations from the prior
_NOTED, _CONTRADICTED = 3.0, 4.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightVerdict:
    """Text for the user; each list may be empty.

    ``summary`` one sentence; ``apart`` inseparable or undetermined parameters; ``notes``; ``next_steps``.
    """

    summary: str
    apart: tuple[str, ...]
    notes: tuple[str, ...]
    next_steps: tuple[str, ...]
    correlated_parameters: tuple[CorrelatedParameters, ...]
    ranges: tuple[RangeQuality, ...]


def judge_flight(after: Rig, fit: FlightFit) -> FlightVerdict:
    """Evaluate a fit and the resulting rig."""
    mixed, weak, ranges = correlated_parameters(fit), unobservable_parameters(fit), range_qualities(after, fit)
    apart = [f"cannot separate: {c.words}" for c in mixed[:_MOST]]
    if len(mixed) > _MOST:
        apart.append(f"and {len(mixed) - _MOST} more such combinations (see the correlations)")
    if weak:
        apart.append("hardly improved by this flight: " + ", ".join(weak))
    wanted = [c.advice for c in mixed] + [advice_for([name]) for name in weak]
    if not wanted and not _good_everywhere(ranges):
        wanted.append(advice_for([name for name in fit.problem.names if "runway_from_base" in name]))
    steps = [*dict.fromkeys(wanted), *_of_residuals(fit)]
    if _far_off(fit, _CONTRADICTED) or _misfits(fit):
        steps.insert(0, "look at the frame and the clock of the DGPS, and at what the rig states: one of them is wrong")
    if not steps:
        steps.append("nothing: use the rig, and look at a landmark with check before each session")
    return FlightVerdict(
        summary=_summary(fit, mixed, weak, ranges),
        apart=tuple(apart),
        notes=(*_notes(fit), *_of_shutters(after, fit), *_of_slow_readings(fit)),
        next_steps=tuple(steps),
        correlated_parameters=tuple(mixed),
        ranges=tuple(ranges),
    )


def range_lines(ranges: tuple[RangeQuality, ...]) -> list[str]:
    """Return a line for each range."""
    lines = []
    for q in ranges:
        calibration = " / ".join(f"{v:.3f}" for v in q.calibration_m)
        noise = " / ".join(f"{v:.3f}" for v in q.noise_m)
        beyond = "" if q.flown else ", not flown"
        lines.append(f"at {q.range_m:.0f} m{beyond}: {calibration} m; noise of one fix {noise} m")
    return lines


def _good_everywhere(ranges: list[RangeQuality]) -> bool:
    return all(q.good for q in ranges)


def _summary(fit: FlightFit, mixed: list[CorrelatedParameters], weak: list[str], ranges: list[RangeQuality]) -> str:
    doubted = {name for c in mixed for name in c.members} | set(weak)
    alone = len(fit.problem.names) - len(doubted)
    known = f"{alone} of {len(fit.problem.names)} parameters are determined by themselves"
    good = [q for q in ranges if q.good]
    if not ranges:
        return known + "; the accuracy of a fix cannot be stated for one station"
    if contradicted := _far_off(fit, _CONTRADICTED):
        return f"not to be trusted: the flight contradicts what was known of {', '.join(contradicted)}; {known}"
    if misfits := _misfits(fit):
        return f"not to be trusted: {'; '.join(misfits)}; {known}"
    if len(good) == len(ranges):
        reach = f"good enough at all ranges looked at, to {ranges[-1].range_m:.0f} m"
    elif good:
        reach = f"good enough at {', '.join(f'{q.range_m:.0f}' for q in good)} m"
    else:
        reach = "not good enough at any range looked at"
    if len(good) < len(ranges):
        bad = ", ".join(f"{q.range_m:.0f}" for q in ranges if not q.good)
        reach += f"; at {bad} m the calibration is off by more than one fix's noise"
    return f"{reach}; {known}" + (", the others in combinations only" if doubted else "")


def _notes(fit: FlightFit) -> list[str]:
    condition = f"condition {fit.condition:.1e}, reduced chi-square {fit.reduced_chi_square:.2f}"
    lines = [condition + (": badly conditioned" if fit.condition > _MOST_CONDITION else "")]
    lines += [f"{name} is {off:.0f} sigmas from what was known before" for name, off in _far_off(fit, _NOTED).items()]
    return lines


def _of_shutters(after: Rig, fit: FlightFit) -> list[str]:
    """Return the meaning of a negative shutter time: chance about a global one, or a picture that is upside down."""
    lines = []
    for k, name in enumerate(fit.problem.names):
        station, _, short = name.partition(".")
        if short != READOUT or after[station].readout_s >= 0.0:
            continue
        sigma = float(fit.sigma[k])
        found = f"{name} is below zero, {1e3 * after[station].readout_s:.2f} +- {1e3 * sigma:.2f} ms: "
        chance = after[station].readout_s > -_NOTED * sigma
        lines.append(
            found
            + (
                "no different from a shutter that exposes all rows at once"
                if chance
                else "its last row is exposed first, as where a picture is upside down"
            )
        )
    return lines


def _of_slow_readings(fit: FlightFit) -> list[str]:
    """Return whose readings are so slow that a head's way between them is a matter of how smooth it is taken to be."""
    lines = []
    for name, observed in fit.problem.observations.items():
        if len(observed.readings_s) > 1 and fit.problem.curves(name):
            step = float(np.median(np.diff(observed.readings_s)))
            if step > SLOW_S:
                lines.append(
                    f"the PTU of {name} was read every {1e3 * step:.0f} ms only: between readings its head is taken to"
                    " move as smoothly as the readings do, and the sigmas include the uncertainty of that"
                )
    return lines


def _far_off(fit: FlightFit, sigmas: float) -> dict[str, float]:
    """Return the parameters far from their values before, and the deviations in sigmas."""
    prior = fit.problem.prior_sigma
    off = np.abs(fit.change) / np.where(np.isfinite(prior), prior, np.inf)
    return {fit.problem.names[k]: float(off[k]) for k in np.flatnonzero(off > sigmas)}


def _misfits(fit: FlightFit) -> list[str]:
    """Return which stations' pixels fit far worse than pixels are found or labelled."""
    words = []
    for name, station in fit.stations.items():
        given = fit.problem.observations[name].sigma_given
        if station.noise_factor > _MOST_NOISE if given else station.rms_px > _WORST_LABELS_PX:
            words.append(f"the pixels of {name} fit to {station.rms_px:.1f} px only")
    return words


def _of_residuals(fit: FlightFit) -> list[str]:
    steps = []
    for name, station in fit.stations.items():
        usable, kept = int(station.usable.sum()), int(station.kept.sum())
        if usable - kept > _GROSS_SHARE * usable:
            steps.append(f"look at what station {name} saw: {usable - kept} of {usable} pixels do not fit")
    if float(fit.lasting_factor.max(initial=1.0)) > _LASTING:
        steps.append(
            "look at the residuals over time and over the picture: they last, as those of a wrong lens, a shifted"
            " target point or a camera that moved do; sigmas allow for it"
        )
    return steps
