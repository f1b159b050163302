"""A tracker for scripts: events in, estimates out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from groundstation.detection.detector_callback import DetectorCallback, for_stations
from groundstation.errors import InputError
from groundstation.messages import (
    Epoch,
    Event,
    FilterReset,
    Frame,
    FrameAngles,
    InitialState,
    Kinematics,
    PixelMeasurement,
    PtuSample,
    StepReport,
    TrackStatus,
)
from groundstation.picture import BgrPicture, Picture, RawPicture
from groundstation.rig.rig import Rig, load_rig
from groundstation.tracking.config import Config, load_config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.warm_up import warm_up

# what a camera shows in `Tracker.step_pair`: a picture, or a pixel (u, v) with or without its sigma (u, v, sigma)
Observation = NDArray[np.uint8] | Picture | Sequence[float]

# wider than any aircraft
_WIDEST_M = 200.0


class Tracker:
    """Tracks one aircraft with the cameras of a rig.

    Events are fed as they come: PTU readings, frames or pixels, and after the last frame of each stereo pair its
    `Epoch`, which is answered by a `TrackEstimate`. Frames are processed once their angles are known, so that the
    answer to an event may come with a later one; events out of order are used at their own time, up to half a second
    late. A `ReferenceFix`, which the recording of a run that learnt from its reference has, changes nothing.

    Parameters
    ----------
    rig : calibrated stations, or a rig file.
    config : tuning, or a file of it (`groundstation config`); None is the default.
    span_m : the aircraft's wing span, m; None if unknown.
    initial : where the aircraft is at the start; None if it is to be found.
    detector : a function in place of the program's detector, or one for each station by name; it is given a picture (h,
        w, 3) uint8 BGR, the box to look at and a `DetectionHint` or None, and returns a sequence of `TargetCandidate`,
        empty if it saw nothing, or None if it did not look.

    Raises
    ------
    InputError : a rig or tuning that cannot be used, or a detector for a station that the rig does not have.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        *,
        config: Config | str | Path | None = None,
        span_m: float | None = None,
        initial: InitialState | None = None,
        detector: DetectorCallback | Mapping[str, DetectorCallback] | None = None,
    ) -> None:
        self.rig = rig if isinstance(rig, Rig) else load_rig(Path(rig))
        tuning = config if isinstance(config, Config) else load_config(None if config is None else Path(config))
        if span_m is not None and not 0.0 < span_m <= _WIDEST_M:
            raise InputError(
                "span_m", got=f"{span_m:g}", wanted=f"a wing span > 0 and at most {_WIDEST_M:g} m, or None"
            )
        warm_up(tuning.detection.detector)
        self._pipeline = Pipeline(
            self.rig,
            tuning,
            span_m=span_m,
            initial=initial,
            callbacks=for_stations(detector, self.rig.names),
        )
        self._sizes = {s.name: s.lens.image_size_px for s in self.rig.stations}
        self._next_epoch = 0
        self._status = TrackStatus.SEARCHING

    @property
    def status(self) -> TrackStatus:
        """The status that was reported last."""
        return self._status

    @property
    def t_s(self) -> float | None:
        """Session time of the newest measurement used, s; None before the first."""
        return self._pipeline.time_s

    def step(self, event: Event) -> StepReport:
        """Process one event; return all reports that are due.

        The ``image`` of a frame may also be an array, (h, w, 3) uint8 BGR or (h, w) grey. Raises `InputError` for
        what is no event, a station that the rig does not have, a picture of another size than the rig states, or a
        value that is not finite.
        """
        event = _as_event(event)
        self._check(event)
        if isinstance(event, (Frame, PixelMeasurement, Epoch)):
            self._next_epoch = max(self._next_epoch, event.epoch + 1)
        return self._noted(self._pipeline.step(event))

    def step_pair(self, t_s: float, seen: Mapping[str, Observation]) -> StepReport:
        """Process what the cameras saw at ``t_s``, s, by station; return all reports that are due.

        A picture is (h, w, 3) uint8 BGR or (h, w) grey, a pixel (u, v) or (u, v, sigma) in px. A station without either
        is left out. Raises `InputError` as `step` does.
        """
        epoch = self._next_epoch
        events = [_event(t_s, station, epoch, observed) for station, observed in seen.items()]
        closing = Epoch(t_s=t_s, epoch=epoch, stations=tuple(seen))
        return _joined([self.step(event) for event in (*events, closing)])

    def finish(self) -> StepReport:
        """Process the events that still wait for others; return their reports."""
        return self._noted(self._pipeline.finish())

    def estimate_at(self, t_s: float) -> Kinematics | None:
        """Return position and velocity at a session time, predicted or smoothed; None without a target.

        Behind the newest measurement it reaches back as far as late ones are used (half a second).
        """
        return self._pipeline.estimate_at(t_s)

    def _noted(self, report: StepReport) -> StepReport:
        """Keep the newest status of a report, and return it."""
        if report.estimates:
            self._status = report.estimates[-1].status
        if report.states:
            self._status = report.states[-1].status
        return report

    def _check(self, event: Event) -> None:
        """Raise `InputError` for an event that the rig does not fit."""
        where = type(event).__name__
        numbers = [event.t_s]
        if isinstance(event, PtuSample):
            numbers += [event.pan_rad, event.tilt_rad]
        elif isinstance(event, FrameAngles):
            numbers += [event.pan_rad, event.tilt_rad, event.sigma_rad, event.delay_s]
        elif isinstance(event, PixelMeasurement):
            if isinstance(event.sigma_px, float | int):
                raise InputError(f"{where}: sigma_px", got=f"{event.sigma_px:g}", wanted="two numbers, of u and of v")
            numbers += [event.u_px, event.v_px, *(event.sigma_px or ())]
            if event.sigma_px is not None and (len(event.sigma_px) != 2 or min(event.sigma_px) <= 0.0):
                raise InputError(f"{where}: sigma_px", got=str(event.sigma_px), wanted="> 0, or None")
        if not np.isfinite(numbers).all():
            raise InputError(where, got=f"a value that is not finite at t_s = {event.t_s:g}", wanted="finite numbers")
        if isinstance(event, FilterReset):
            return
        stations = event.stations if isinstance(event, Epoch) else [getattr(event, "station", self.rig.names[0])]
        for station in stations:
            if station not in self._sizes:
                wanted = "one of " + ", ".join(self._sizes)
                raise InputError(f"{where} at {event.t_s:g} s", got=f"station {station!r}", wanted=wanted)
        if isinstance(event, PtuSample) and self.rig[event.station].fixed:
            raise InputError(where, got=f"angles of {event.station}", wanted="none: the rig says that it is fixed")
        if isinstance(event, Frame) and event.image.size_px != self._sizes[event.station]:
            got, wanted = (f"{w} × {h} px" for w, h in (event.image.size_px, self._sizes[event.station]))
            raise InputError(
                f"picture of {event.station} at {event.t_s:g} s", got=got, wanted=f"{wanted}, as in the rig"
            )


def _as_event(event: Any) -> Event:
    """Return an event, its picture as one where it is an array. Raises `InputError` for anything else."""
    if not isinstance(event, get_args(Event)):
        wanted = ", ".join(kind.__name__ for kind in get_args(Event))
        raise InputError("event", got=type(event).__name__, wanted=f"one of {wanted}")
    image: Any = event.image if isinstance(event, Frame) else None
    if not isinstance(event, Frame) or isinstance(image, Picture):
        return event
    if not isinstance(image, np.ndarray):
        where = f"picture of {event.station} at {event.t_s:g} s"
        raise InputError(where, got=type(image).__name__, wanted="an array (h, w, 3) or (h, w) of uint8")
    return replace(event, image=picture_of(image))


def _event(t_s: float, station: str, epoch: int, observed: Observation) -> Frame | PixelMeasurement:
    """Return what a camera saw as an event."""
    if isinstance(observed, Picture):
        return Frame(t_s=t_s, station=station, epoch=epoch, image=observed)
    if isinstance(observed, np.ndarray) and observed.ndim > 1:
        return Frame(t_s=t_s, station=station, epoch=epoch, image=picture_of(observed))
    if not isinstance(observed, Sequence | np.ndarray) or not 2 <= len(observed) <= 3:
        got = f"{len(observed)} numbers" if isinstance(observed, Sequence | np.ndarray) else type(observed).__name__
        wanted = "a picture, or a pixel (u, v) or (u, v, sigma)"
        raise InputError(f"seen by {station} at {t_s:g} s", got=got, wanted=wanted)
    u, v, *sigma = (float(number) for number in observed)
    return PixelMeasurement(
        t_s=t_s,
        station=station,
        epoch=epoch,
        u_px=u,
        v_px=v,
        sigma_px=(sigma[0], sigma[0]) if sigma else None,
    )


def picture_of(image: NDArray[np.uint8]) -> Picture:
    """Return an array (h, w, 3) uint8 BGR, or (h, w) grey, as a picture; it must not be changed later.

    Raises `InputError` for another shape or type.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        got = f"{image.dtype} {image.shape}"
        raise InputError("picture", got=got, wanted="uint8 (h, w, 3) in the order blue, green, red, or (h, w) grey")
    return BgrPicture(image) if image.ndim == 3 else RawPicture(image, None)


def _joined(reports: Sequence[StepReport]) -> StepReport:
    """Return several reports as one."""
    return StepReport(
        cameras=tuple(c for report in reports for c in report.cameras),
        estimates=tuple(e for report in reports for e in report.estimates),
        events=tuple(e for report in reports for e in report.events),
        states=tuple(s for report in reports for s in report.states),
        initial_pixels=tuple(p for report in reports for p in report.initial_pixels),
        outcomes=tuple(o for report in reports for o in report.outcomes),
    )
