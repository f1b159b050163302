"""The ground paper's section 5.3: landing and take-off online, with 110 ms of latency compensated by constant speed."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.detection_set_up import SEED
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.messages import Event, InitialState, StepReport
from groundstation.rig.rig import Rig
from groundstation.simulation import case_b, simulate
from groundstation.simulation.take_off import take_off
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

DELAY_S = 0.11
_SETTLING_S = 2.0
_WAYS = {
    "late": "EKF, as it is when it arrives",
    "constant": "EKF, constant speed for 110 ms",
    "cv_t": "CV_T off line, not late",
}
_PAPER = {
    ("landing", "constant"): "about 110 ms late; better than CV_T",
    ("take-off", "constant"): "y 15.1831 m; the predecessor's worst 29.12 m",
}
_TAKE_OFF_PIXELS = (
    "The take-off is simulated at the level of pixels (case B: 0.5 px, encoder steps of 0.00625°, 4 m/s² from 300 m). "
)


def online(recorded: TruthSession) -> Findings:
    """Estimates of the aircraft's position 110 ms after the pictures (figure 14, table 5)."""
    take_off = _simulated_take_off() if recorded.take_off is None else _filmed(recorded.take_off)
    flights = {"landing": _filmed(recorded), "take-off": take_off}
    rows: list[list[Cell]] = []
    for flight, found in flights.items():
        for way, words in _WAYS.items():
            e = found[way][:, 1:]
            rms: list[Cell] = [float(v) for v in np.sqrt((e**2).mean(axis=0))] if len(e) else [None] * 3
            worst: list[Cell] = [float(v) for v in np.abs(e).max(axis=0)] if len(e) else [None] * 3
            rows.append([flight, words, len(e), *rms, *worst, _PAPER.get((flight, way), "")])
    table = ResultTable(
        name="online",
        title="Table 5: root mean square error on line",
        columns=(
            *("flight", "answer", "pairs", "RMSE x m", "y m", "z m"),
            *("worst x m", "y m", "z m", "paper"),
        ),
        rows=rows,
        notes=(
            "Each answer of the EKF is compared with where the aircraft is 110 ms after the pair's exposure. Of the "
            "paper's table only the figures in its text are quoted; its rows are not available.",
        ),
    )
    figure = PaperFigure(
        name="online",
        title="Figure 14: landing and take-off, 110 ms late",
        caption="Error along the runway of each answer, by way of making up for the delay.",
        draw=lambda path: _draw(flights, path),
    )
    differences = (
        "The delay is put in: answers for a pair are taken to arrive 110 ms after it. The paper measured 80 ms of work "
        "and pictures and 30 ms of radio; our own latency is in the report of each replay.",
        "Constant speed is what our own filter assumes, too: asked for a later time it gives the same position, for "
        "the true delay, and with a covariance.",
        "The landing's pixels are those that our detector found in the recording. "
        + (_TAKE_OFF_PIXELS if recorded.take_off is None else "So are the take-off's, rendered as well. ")
        + "Calibration and clocks are exact; the paper's 15 m hold what its rig and DGPS were off by.",
    )
    return Findings(tables=(table,), figures=(figure,), differences=differences)


def _filmed(recorded: TruthSession) -> dict[str, FloatArray]:
    pixels = recorded.detected
    first_s = min(float(rows[0, 0]) for rows in pixels.values())
    last_s = float(recorded.truth.t_s[recorded.inside(recorded.truth.t_s)].max())
    return _answers(
        recorded.session.rig,
        recorded.events(pixels),
        recorded.start(first_s),
        recorded.truth_at,
        (first_s, last_s),
    )


def _simulated_take_off() -> dict[str, FloatArray]:
    flight = simulate(case_b(seed=SEED, trajectory=take_off()))
    path = flight.scenario.trajectory
    start = InitialState(
        t_s=path.span_s[0],
        position_runway_m=flight.truth.position_runway_m[0],
        velocity_runway_m_s=flight.truth.velocity_runway_m_s[0],
        sigma_position_m=np.full(3, 1.0),
        sigma_velocity_m_s=np.full(3, 1.0),
    )
    return _answers(flight.rig, flight.events, start, path.position, path.span_s)


def _answers(
    rig: Rig,
    events: Iterable[Event],
    start: InitialState,
    truth_at: Callable[[FloatArray], FloatArray],
    span_s: tuple[float, float],
) -> dict[str, FloatArray]:
    """Return by method the time and the error of each estimate, (n, 4), without the first seconds."""
    pipeline = Pipeline(rig, Config(), initial=start)
    found: dict[str, list[FloatArray]] = {way: [] for way in _WAYS}

    def take(report: StepReport) -> None:
        for e in report.estimates:
            late_s = e.t_s + DELAY_S
            if e.kinematics is None or e.t_s < span_s[0] + _settling(span_s) or late_s > span_s[1]:
                continue
            k = e.kinematics
            there, then = truth_at(np.array([e.t_s, late_s]))
            found["late"].append(np.array([e.t_s, *(k.position_runway_m - then)]))
            constant = k.position_runway_m + DELAY_S * k.velocity_runway_m_s
            found["constant"].append(np.array([e.t_s, *(constant - then)]))
            if e.triangulation is not None:
                found["cv_t"].append(np.array([e.t_s, *(e.triangulation.midpoint_runway_m - there)]))

    for event in events:
        take(pipeline.step(event))
    take(pipeline.finish())
    return {way: np.array(rows).reshape(-1, 4) for way, rows in found.items()}


def _settling(span_s: tuple[float, float]) -> float:
    """Return how long the filter is left to settle: of a short part only a third."""
    return min(_SETTLING_S, (span_s[1] - span_s[0]) / 3.0)


def _draw(flights: dict[str, dict[str, FloatArray]], path: Path) -> None:
    figure, panels = plots.blank(2, 1, (9.0, 6.4))
    for ax, (flight, found) in zip(panels, flights.items(), strict=True):
        for k, (way, words) in enumerate(_WAYS.items()):
            style = "." if way == "cv_t" else "-"
            ax.plot(found[way][:, 0], found[way][:, 2], style, ms=3, lw=1.1, color=plots.COLOURS[k], label=words)
        ax.set_title(flight, fontsize=10)
        ax.set_xlabel("time in s")
        ax.set_ylabel("error in y, m")
    panels[0].legend(frameon=False, fontsize=8, ncols=2)
    plots.save(figure, path)
