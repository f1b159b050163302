"""The session with exact truth that the experiments share, and results that several of them use."""

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.evaluation.collector import DETECTION_STATUSES, ResultCollector
from groundstation.evaluation.evaluate import Evaluation, evaluate_run
from groundstation.evaluation.run_description import RunDescription
from groundstation.experiments.detection_set_up import DEFAULT, METHODS, OURS, PAPERS_CHOICE, SEED, SWEEP
from groundstation.experiments.detector_outcomes import DetectorOutcome, watch
from groundstation.experiments.truth_scenes import scenes
from groundstation.messages import Event, InitialState
from groundstation.replay.run_pipeline import run_pipeline
from groundstation.session import Session, Truth, load_dgps, load_session, load_truth
from groundstation.sources.external_detections import detection_events
from groundstation.sources.folder_source import LEAD_S, FolderSource, read_frames
from groundstation.sources.ptu_readings import PtuReadings
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

_START_SIGMA_M, _START_SIGMA_M_S = 1.0, 2.0
# with the paper's kind of detector
_PAPER = Config(detection=DEFAULT)
# the compared methods without those of scikit-image, which the paper does not have and which take minutes
PAPER_METHODS_HERE = tuple(name for name in METHODS if not name.startswith("scikit-image"))


class TruthSession:
    """One session with exact truth, or the part of it between two session times.

    Parameters
    ----------
    folder : of the session; it needs pictures, truth.csv, masks.npz and the wing span.
    from_s, to_s : session times; None is the recording's own end.
    say : receives progress messages.
    take_off : such a session of a take-off, for the experiment that has one; None simulates its pixels.
    """

    def __init__(
        self,
        folder: Path,
        from_s: float | None = None,
        to_s: float | None = None,
        say: Callable[[str], None] = lambda words: None,
        *,
        take_off: "TruthSession | None" = None,
    ) -> None:
        self.take_off = take_off
        self.session: Session = load_session(folder)
        self.from_s = -np.inf if from_s is None else from_s
        self.to_s = np.inf if to_s is None else to_s
        self._say = say
        found = load_truth(self.session)
        if found is None:
            raise SessionError(self.session.name, got="no truth.csv", wanted="a rendered session with exact truth")
        self.truth: Truth = found
        if not np.any(self.inside(found.t_s)):
            raise SessionError(
                self.session.name,
                got=f"truth from {found.t_s[0]:g} to {found.t_s[-1]:g} s",
                wanted=f"some from {self.from_s:g} to {self.to_s:g} s",
            )

    def at_most_s(self, seconds: float) -> float:
        """Return the limit of an experiment's duration with its own scenes: the length of the evaluated part."""
        return float(min(seconds, max(self.to_s - self.from_s, 0.3)))

    def inside(self, t_s: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Return which times (n,) are in the evaluated part."""
        return (t_s >= self.from_s) & (t_s <= self.to_s)

    def truth_at(self, t_s: FloatArray) -> FloatArray:
        """Return the true position (n, 3) at times (n,), interpolated linearly."""
        rows = [np.interp(t_s, self.truth.t_s, self.truth.position_runway_m[:, axis]) for axis in range(3)]
        return np.stack(rows, axis=-1)

    def velocity_at(self, t_s: float) -> FloatArray:
        """Return the true velocity (3,) at a time."""
        slope = np.gradient(self.truth.position_runway_m, self.truth.t_s, axis=0)
        return np.array([np.interp(t_s, self.truth.t_s, slope[:, axis]) for axis in range(3)])

    # ------------------------------------------------------------------------------------- detectors
    @cached_property
    def outcomes(self) -> Mapping[str, list[DetectorOutcome]]:
        """Outcomes of each detector of `SWEEP` and of the methods on each picture, by its name."""
        times = read_frames(self.session).epoch_times()
        numbers = np.flatnonzero(self.inside(np.nan_to_num(times, nan=np.inf)))
        chosen = {**SWEEP, **{name: METHODS[name] for name in PAPER_METHODS_HERE if name != OURS}}
        first, last = (int(numbers[0]), int(numbers[-1])) if len(numbers) else (0, -1)
        shown = scenes(self.session, SEED, first_epoch=first, last_epoch=last)
        found = watch(shown, chosen, lambda number: self._say(f"detectors: {number} pictures"))
        if not found[PAPERS_CHOICE]:
            raise SessionError(self.session.name, got="no picture with the aircraft in that part", wanted="some")
        return found

    @cached_property
    def methods(self) -> Mapping[str, list[DetectorOutcome]]:
        """The outcomes of the methods only, this project's first."""
        return {name: self.outcomes[PAPERS_CHOICE if name == OURS else name] for name in PAPER_METHODS_HERE}

    # ---------------------------------------------------------------------------------------- tracks
    @cached_property
    def collected(self) -> ResultCollector:
        """The pipeline over the pictures, started as the paper is, from known position and velocity."""
        limits = [None if np.isinf(v) else float(v) for v in (self.from_s, self.to_s)]
        with FolderSource(self.session, *limits) as source:
            total = source.epoch_count
            collector = ResultCollector()
            pipeline = Pipeline(
                self.session.rig, _PAPER, span_m=self.session.target.span_m, initial=self.start(source.span_s[0])
            )
            outcome = run_pipeline(
                source, pipeline, [collector], lambda done: self._say(f"replay: {done} of {total} pairs")
            )
        if outcome.fault is not None:
            raise outcome.fault
        return collector

    @cached_property
    def evaluation(self) -> Evaluation:
        """The same against truth and DGPS."""
        config = _PAPER
        run_of = RunDescription(
            name=self.session.name,
            phases=self.session.phases,
            antenna_in_body_m=self.session.target.antenna_in_body_m,
            clocks_given=self.session.has_clocks,
            acceleration_psd_m2_s3=config.estimation.acceleration_psd_m2_s3,
        )
        return evaluate_run(
            self.collected,
            run_of,
            rig=self.session.rig,
            config=config.evaluation,
            dgps=load_dgps(self.session),
            truth=self.truth,
        )

    def start(self, t_s: float) -> InitialState:
        """Return where the track starts: the truth's own state with the sigma of a rough DGPS."""
        return InitialState(
            t_s=t_s,
            position_runway_m=self.truth_at(np.array([t_s]))[0],
            velocity_runway_m_s=self.velocity_at(t_s),
            sigma_position_m=np.full(3, _START_SIGMA_M),
            sigma_velocity_m_s=np.full(3, _START_SIGMA_M_S),
        )

    # ----------------------------------------------------------------------------------- pixels only
    @cached_property
    def detected(self) -> dict[str, FloatArray]:
        """The pixels that the pipeline's detector found, by station (n, 3): time, u, v."""
        table, ok = self.collected.cameras(), []
        for k, status in enumerate(DETECTION_STATUSES):
            if status.used:
                ok.append(k)
        found = {}
        for k, name in enumerate(self.collected.stations):
            rows = table[(table["station"] == k) & np.isin(table["status"], ok)]
            found[name] = np.column_stack([rows["t_s"], rows["pixel"].astype(np.float64)])
        if len(found) < len(self.session.rig.names) or not all(len(rows) for rows in found.values()):
            raise SessionError(self.session.name, got="no detection in that part", wanted="some in each camera")
        return found

    @cached_property
    def true_pixels(self) -> dict[str, FloatArray]:
        """The true pixels of visible targets, by station (n, 3): time, u, v."""
        found = {}
        for name in self.session.rig.names:
            rows = self.truth.visible[name] & self.inside(self.truth.t_s)
            found[name] = np.column_stack([self.truth.t_s[rows], self.truth.pixels_px[name][rows]])
        return found

    def events(self, pixels: dict[str, FloatArray]) -> Iterator[Event]:
        """Yield PTU readings, these pixels, and an epoch at each pixel of the first station, in order of time."""
        stamps_s = np.concatenate([rows[:, 0] for rows in pixels.values()])
        readings = PtuReadings(self.session)
        readings.start(float(stamps_s.min()) - LEAD_S, float(stamps_s.max()) + LEAD_S)
        for t_s, event in detection_events(pixels, self.session.rig.names[0]):
            yield from readings.until(t_s)
            yield event
        yield from readings.until(float(stamps_s.max()) + LEAD_S)
        if readings.fault is not None:
            raise readings.fault

    def follow(self, pixels: dict[str, FloatArray], config: Config) -> ResultCollector:
        """Run the pipeline over pixels of another detector."""
        collector = ResultCollector()
        first_s = min(float(rows[0, 0]) for rows in pixels.values())
        pipeline = Pipeline(self.session.rig, config, initial=self.start(first_s))
        outcome = run_pipeline(self.events(pixels), pipeline, [collector], lambda done: None)
        if outcome.fault is not None:
            raise outcome.fault
        return collector
