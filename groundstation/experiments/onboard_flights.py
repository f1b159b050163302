"""Nose camera and inertial unit together on rendered approaches: error, consistency, and three ways to find corners."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.edges.pose import Attitude, nose_pose
from groundstation.onboard.pose.inertial_filter import rotation_vector
from groundstation.onboard.scenes.flight import Sensors
from groundstation.onboard.scenes.nose_flight import (
    CAMERA_PITCH_DEG,
    NoseFlight,
    navigation_poses,
    nose_flight,
    nose_setup,
)
from groundstation.onboard.scenes.sequences import SEQUENCES
from groundstation.onboard.visual_inertial.config import ApproachConfig, CornerMethod
from groundstation.onboard.visual_inertial.lasting_errors import KnownHeight
from groundstation.onboard.visual_inertial.nose_navigator import NoseNavigator
from groundstation.onboard.visual_inertial.nose_report import NoseReport

_SEED_STEP = 70_000
_LONGEST_S = 13.0
_SHORTEST_S = 1.2  # edges followed for six pictures, then four poses, before there is a fix
_SCENES = {"day": 0, "haze, sand": 1, "dusk, turbulence": 2, "night": 3}
_MOUNT = Attitude(pitch_rad=float(np.radians(CAMERA_PITCH_DEG)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedFlight:
    """A flight as it was followed: distance (n,) and times (n,) of the fixes, errors and sigmas (n, 3) m, NEES (n,).

    ``nees`` is of position and attitude, six degrees of freedom; ``attitude_rad`` (n, 3) its second part's error;
    ``outcomes`` counts what became of every picture.
    """

    t_s: FloatArray
    error_m: FloatArray
    sigma_m: FloatArray
    attitude_rad: FloatArray
    nees: FloatArray
    nees_position: FloatArray
    outcomes: Mapping[str, int]


def follow(flight: NoseFlight, pictures: list[ImageArray], config: ApproachConfig | None = None) -> FollowedFlight:
    """Run the chain over a flight whose pictures are rendered, and compare it with the truth."""
    setup, motion = flight.setup, flight.motion
    navigator = NoseNavigator(flight.runway, setup.lens, setup.mount, config)
    attitude, place = navigation_poses(flight, np.random.default_rng([flight.sequence.seed, 5]))
    rows, outcomes, fed, sensors = [], dict[str, int](), 0, Sensors()
    for sample, picture in zip(flight.frames, pictures, strict=True):
        while fed <= sample:
            navigator.process_imu(motion.samples[fed])
            fed += 1
        roll, pitch, yaw = (float(angle) for angle in attitude[sample])
        reported = nose_pose(place[sample], Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw), _MOUNT)
        height = KnownHeight(
            up_m=float(place[sample, 2]),
            lasting_m=max(sensors.position_bias_m[2], 1e-3),
            noise_m=sensors.position_noise_m[2],
        )
        report = navigator.update(float(motion.t_s[sample]), picture, reported, height)
        outcomes[report.outcome] = outcomes.get(report.outcome, 0) + 1
        if report.fix is not None:
            rows.append(_compared(flight, sample, report))
    if not rows:
        return FollowedFlight(
            t_s=np.zeros(0), error_m=np.zeros((0, 3)), sigma_m=np.zeros((0, 3)), attitude_rad=np.zeros((0, 3)),
            nees=np.zeros(0), nees_position=np.zeros(0), outcomes=outcomes,
        )  # fmt: skip
    t, error, sigma, turn, nees, nees_position = (np.array(column) for column in zip(*rows, strict=True))
    return FollowedFlight(
        t_s=t, error_m=error, sigma_m=sigma, attitude_rad=turn, nees=nees, nees_position=nees_position,
        outcomes=outcomes,
    )  # fmt: skip


def _compared(
    flight: NoseFlight, sample: int, report: NoseReport
) -> tuple[float, FloatArray, FloatArray, FloatArray, float, float]:
    """Return time, error, sigma, attitude error, NEES of the pose and of the position."""
    fix = report.fix
    if fix is None:
        raise ValueError("got a report without a fix")
    error = flight.pose(sample).camera_threshold_m - fix.position_m
    turn = rotation_vector(flight.motion.runway_from_body[sample] @ matrix_from_wxyz(fix.runway_from_body_wxyz).T)
    both, P = np.concatenate([error, turn]), fix.covariance
    return (
        report.t_s, error, np.sqrt(np.diag(P)[:3]), turn,
        float(both @ np.linalg.solve(P[:6, :6], both)), float(error @ np.linalg.solve(P[:3, :3], error)),
    )  # fmt: skip


def flights(recorded: TruthSession) -> Findings:
    """One approach in each light, and the day's with three ways to find corners."""
    seconds = max(recorded.at_most_s(_LONGEST_S), _SHORTEST_S)
    rows: list[list[Cell]] = []
    followed: dict[str, FollowedFlight] = {}
    for name, number in _SCENES.items():
        sequence = replace(SEQUENCES[number], seed=SEQUENCES[number].seed + _SEED_STEP)
        flight = nose_flight(sequence, nose_setup(sequence, seconds))
        pictures = [picture for _, picture in flight.pictures()]
        for method in CornerMethod if name == "day" else (CornerMethod.EDGES,):
            one = follow(flight, pictures, ApproachConfig(corners=method))
            rows.append(_row(name, method, one, len(pictures)))
            if method is CornerMethod.EDGES:
                followed[name] = one
    table = ResultTable(
        name="nose_flights",
        title="Nose camera and inertial unit: error against the exact flight",
        columns=("light", "corners", "pictures", "used", "x m", "y m", "z m", "attitude °", "NEES (6)", "NEES (3)"),
        rows=rows,
        notes=(
            "Root mean square over the second half of each approach, from 190 m to 45 m before the threshold; one "
            "approach each. NEES would be 6 and 3 on average over many approaches if the covariance is right; one "
            "approach's errors last, so its mean scatters. Edges: tracked edges with measured thresholds; sides: all "
            "four sides measured again; susan: the paper's corners.",
        ),
    )
    figure = PaperFigure(
        name="nose_flights",
        title="Position from nose camera and inertial unit",
        caption="Errors with ±2σ of each approach, and its NEES of six degrees of freedom.",
        draw=lambda path: _draw(followed, path),
    )
    text = (
        "The paper's aircraft was flown in FlightGear; ours is rendered with distractors, and its corners are measured."
    )
    return Findings(tables=(table,), figures=(figure,), differences=(text,))


def _row(name: str, method: CornerMethod, one: FollowedFlight, pictures: int) -> list[Cell]:
    used = one.outcomes.get("used", 0) + one.outcomes.get("started", 0)
    half = len(one.t_s) // 2
    if len(one.t_s) == 0:
        return [name, method.value, pictures, used, *[None] * 6]
    rms = np.sqrt((one.error_m[half:] ** 2).mean(axis=0))
    turn = float(np.degrees(np.sqrt((one.attitude_rad[half:] ** 2).sum(axis=1).mean())))
    nees = [float(values[half:].mean()) for values in (one.nees, one.nees_position)]
    return [name, method.value, pictures, used, *(float(value) for value in rms), turn, *nees]


def _draw(followed: Mapping[str, FollowedFlight], path: Path) -> None:
    figure, axes = plots.blank(4, max(len(followed), 1), (3.6 * max(len(followed), 1), 9.0))
    for column, (name, one) in enumerate(followed.items()):
        panels = axes[column :: len(followed)]
        panels[0].set_title(name, fontsize=9)
        for axis, ax in enumerate(panels[:3]):
            sigma = 2.0 * one.sigma_m[:, axis]
            ax.fill_between(one.t_s, -sigma, sigma, color=plots.COLOURS[0], alpha=0.15, lw=0)
            ax.plot(one.t_s, one.error_m[:, axis], color=plots.COLOURS[0], lw=1)
            ax.set_ylabel(f"error in {'xyz'[axis]}, m")
        if len(one.t_s):
            panels[3].semilogy(one.t_s, one.nees, color=plots.COLOURS[3], lw=1)
        panels[3].axhline(6.0, color=plots.COLOURS[6], ls="--", lw=1)
        panels[3].set_ylabel("NEES (6)")
        panels[3].set_xlabel("s")
    plots.save(figure, path)
