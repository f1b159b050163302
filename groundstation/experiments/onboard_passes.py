"""The runway-pose paper's own flight: several lengthwise passes over a runway, figures 4 to 7 of the first of them."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.onboard_pose import DIFFERENCES, FlightErrors, follow
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.onboard.pose.inertial_filter import ATTITUDE, POSITION, VELOCITY
from groundstation.onboard.pose.simulated_approach import default_setup
from groundstation.onboard.pose.simulated_passes import RacetrackPattern, fly_passes

_SEED, _FLIGHTS = 43, 4
# of a shorter part of the recording, one flight of two short rounds: enough to try it
_MANY_BEYOND_S = 15.0
_SHORT = RacetrackPattern(count=2, from_m=700.0, leg_m=600.0, turn_rad_s=0.4, high_m=50.0)
# seen again after a round, the first pictures still bring the state back
_BACK_S = 1.0
_Span = tuple[float, float]


def passes(recorded: TruthSession) -> Findings:
    """Each pass with its pictures, errors, steps and innovations, and the drift since the pass before."""
    whole = recorded.at_most_s(_MANY_BEYOND_S) == _MANY_BEYOND_S
    course, flights = (RacetrackPattern(), _FLIGHTS) if whole else (_SHORT, 1)
    setup = default_setup(0.5)
    done = []
    for k in range(flights):
        approach, spans = fly_passes(setup, course, np.random.default_rng([_SEED, k]))
        done.append((follow(setup, approach), _seen_spans(approach.t_s[sorted(approach.seen)], spans)))
    band = chi_square_quantile([0.025, 0.975], 6 * flights) / flights
    table = ResultTable(
        name="runway_passes",
        title="Several lengthwise passes in one flight",
        columns=_COLUMNS,
        rows=[_row(f"pass {k + 1}", [(one, seen[k]) for one, seen in done]) for k in range(course.count)],
        notes=(
            f"Flights: {flights}, each of {course.count} passes, the inertial filter carried on through all of it: from"
            f" {course.from_m:g} m before the threshold along the runway, and round.",
            "Astray, 1σ and NEES before: just before the runway is seen again after a round. "
            "The rest from a second after that to the last picture of the pass.",
            f"95 % band of the NEES of one epoch's mean: {band[0]:.2f} to {band[1]:.2f}.",
        ),
    )
    return Findings(tables=(table,), figures=_figures(*done[0]), differences=(*DIFFERENCES, *_OWN_DIFFERENCES))


_COLUMNS = (
    *("pass", "pictures", "x m", "y m", "z m", "attitude °", "position in ±2σ %", "attitude in ±2σ %", "NEES (6)"),
    *("steps, median", "steps, most", "innovations in ±2σ %"),
    *("without runway s", "astray m", "1σ m", "NEES before (6)"),
)
_OWN_DIFFERENCES = (
    "The paper's pilot flew several lengthwise passes by hand; ours follow a race track, three rounds in gusts.",
)


def _seen_spans(seen_s: FloatArray, spans: list[_Span]) -> list[_Span]:
    """Return when each pass's first and last picture with the whole runway was taken."""
    begins = [0.0, *(0.5 * (before[1] + after[0]) for before, after in itertools.pairwise(spans)), np.inf]
    groups = [seen_s[(seen_s >= low) & (seen_s < high)] for low, high in itertools.pairwise(begins)]
    return [(float(group[0]), float(group[-1])) for group in groups]


def _row(name: str, flown: list[tuple[FlightErrors, _Span]]) -> list[Cell]:
    """Return one pass over all flights."""
    error, inside, nees, steps, consistent, pictures = [], [], [], [], [], 0
    lost: list[list[float]] = []
    for one, (low, high) in flown:
        used = (one.t_s >= low + _BACK_S) & (one.t_s <= high)
        error.append(one.error[used])
        inside.append(np.abs(one.error[used]) < 2.0 * one.sigma[used])
        nees.append(one.nees[used])
        steps.append(one.steps[(one.steps[:, 0] >= low) & (one.steps[:, 0] <= high), 1])
        fed = (one.innovations[:, 0] >= low + _BACK_S) & (one.innovations[:, 0] <= high)
        consistent.append(np.abs(one.innovations[fed, 1:]) < 2.0 * one.innovation_sigmas[fed])
        pictures += int(((one.innovations[:, 0] >= low) & (one.innovations[:, 0] <= high)).sum())
        before = np.flatnonzero(one.t_s < low)
        earlier = one.innovations[one.innovations[:, 0] < low, 0]
        if len(before) and len(earlier):
            k = before[-1]
            away, sigma = (float(np.linalg.norm(v[k, POSITION])) for v in (one.error, one.sigma))
            lost.append([low - float(earlier[-1]), away, sigma, float(one.nees[k])])
    every, in_2 = np.concatenate(error), np.concatenate(inside)
    rms = np.sqrt((every**2).mean(axis=0))
    count = np.concatenate(steps)
    gone: list[Cell] = [None] * 4
    if lost:
        mean = np.array(lost).mean(axis=0)
        far = float(np.sqrt((np.array(lost)[:, 1] ** 2).mean()))
        gone = [float(mean[0]), far, float(mean[2]), float(mean[3])]
    return [
        name, pictures, *(float(v) for v in rms[POSITION]), float(np.degrees(rms[ATTITUDE]).max()),
        100.0 * float(in_2[:, POSITION].mean()), 100.0 * float(in_2[:, ATTITUDE].mean()),
        float(np.concatenate(nees).mean()), float(np.median(count)), float(count.max()),
        100.0 * float(np.concatenate(consistent).mean()), *gone,
    ]  # fmt: skip


def _figures(one: FlightErrors, seen: list[_Span]) -> tuple[PaperFigure, ...]:
    """Return the paper's figures of one flight."""
    return (
        PaperFigure(
            name="passes_path", title="Figures 4 and 5 (left): paths",
            caption="Estimated and actual path from above and from the side, and position over time; tinted while the "
            "whole runway is in the picture.",
            draw=lambda path: _draw_paths(one, seen, path),
        ),
        PaperFigure(
            name="passes_steps", title="Figure 5 (right): iterations",
            caption="Steps of Levenberg-Marquardt on the paper's cost, each fifth picture of the flight.",
            draw=lambda path: _draw_steps(one, seen, path),
        ),
        PaperFigure(
            name="passes_errors", title="Figure 6: errors of velocity and attitude",
            caption="Errors with ±2σ; tinted while the whole runway is in the picture.",
            draw=lambda path: _draw_errors(one, seen, path),
        ),
        PaperFigure(
            name="passes_innovations", title="Figure 7: innovations",
            caption="Innovations of position and attitude with ±2σ; those beyond the axes are the first of a pass.",
            draw=lambda path: _draw_innovations(one, seen, path),
        ),
    )  # fmt: skip


def _tint(ax: Any, seen: list[_Span]) -> None:
    for low, high in seen:
        ax.axvspan(low, high, color=plots.COLOURS[2], alpha=0.12, lw=0)


def _draw_paths(one: FlightErrors, seen: list[_Span], path: Path) -> None:
    figure, axes = plots.blank(2, 2, (10.0, 6.0))
    true = one.approach.position_m
    for ax, axis in zip(axes[:2], (0, 2), strict=True):
        ax.plot(true[:, 1], true[:, axis], "--", color=plots.COLOURS[6], lw=1, label="actual")
        ax.plot(one.estimate_m[:, 1], one.estimate_m[:, axis], color=plots.COLOURS[0], lw=1, label="estimated")
        ax.set_xlabel("y in m")
        ax.set_ylabel(f"{'xyz'[axis]} in m")
    axes[0].legend(frameon=False, fontsize=8)
    for ax, axis in zip(axes[2:], (0, 1), strict=True):
        ax.plot(one.approach.t_s, true[:, axis], "--", color=plots.COLOURS[6], lw=1)
        ax.plot(one.t_s, one.estimate_m[:, axis], color=plots.COLOURS[0], lw=1)
        _tint(ax, seen)
        ax.set_xlabel("s")
        ax.set_ylabel(f"{'xyz'[axis]} in m")
    plots.save(figure, path)


def _draw_steps(one: FlightErrors, seen: list[_Span], path: Path) -> None:
    figure, (ax,) = plots.blank(1, 1, (6.5, 3.0))
    _tint(ax, seen)
    ax.plot(one.steps[:, 0], one.steps[:, 1], ".", color=plots.COLOURS[0])
    ax.set_xlabel("s")
    ax.set_ylabel("steps")
    plots.save(figure, path)


def _draw_errors(one: FlightErrors, seen: list[_Span], path: Path) -> None:
    figure, axes = plots.blank(3, 2, (10.0, 6.0))
    for column, (part, unit, scale) in enumerate(((VELOCITY, "m/s", 1.0), (ATTITUDE, "°", float(np.degrees(1.0))))):
        for k in range(3):
            ax = axes[2 * k + column]
            sigma = 2.0 * scale * one.sigma[:, part][:, k]
            ax.fill_between(one.t_s, -sigma, sigma, color=plots.COLOURS[0], alpha=0.15, lw=0)
            ax.plot(one.t_s, scale * one.error[:, part][:, k], color=plots.COLOURS[0], lw=1)
            _tint(ax, seen)
            ax.set_ylabel(f"{'xyz'[k]}, {unit}")
    plots.save(figure, path)


def _draw_innovations(one: FlightErrors, seen: list[_Span], path: Path) -> None:
    figure, axes = plots.blank(3, 2, (10.0, 6.0))
    t = one.innovations[:, 0]
    for column, (unit, scale) in enumerate((("m", 1.0), ("°", float(np.degrees(1.0))))):
        for k in range(3):
            ax, part = axes[2 * k + column], 3 * column + k
            sigma = 2.0 * scale * one.innovation_sigmas[:, part]
            ax.plot(t, scale * one.innovations[:, 1 + part], ".", ms=2, color=plots.COLOURS[0])
            for sign in (-1.0, 1.0):
                ax.plot(t, sign * sigma, ".", ms=1, color=plots.COLOURS[3])
            # the first picture of a pass is hundreds of metres off, and would hide the rest
            most = 3.0 * float(np.quantile(np.abs(scale * one.innovations[:, 1 + part]), 0.97))
            ax.set_ylim(-most, most)
            _tint(ax, seen)
            ax.set_ylabel(f"{'position' if column == 0 else 'attitude'} {'xyz'[k]}, {unit}")
    plots.save(figure, path)
