"""Writing a simulated flight with rendered pictures as a session folder (docs/formats.md).

The folder holds what a receiver would have, faults included; truth.csv and masks.npz hold the exact truth.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from groundstation.errors import ScenarioError, os_words
from groundstation.files.output_names import below
from groundstation.simulation.device_clocks import device_from_session
from groundstation.simulation.event_faults import DeliveredFrames, Fault, check_faults, delivered_frames, with_faults
from groundstation.simulation.parameter_checks import require_fraction
from groundstation.simulation.picture_writer import PictureCoding, PictureFormat, PictureWriter, picture_writer
from groundstation.simulation.rendered_camera import RenderedCamera, Shot
from groundstation.simulation.session_folder import (
    folder_fault,
    new_session_folder,
    stamp_text,
    target_table,
    write_table,
    write_tables,
)
from groundstation.simulation.silhouette_archive import write_silhouettes
from groundstation.simulation.simulate import SimulatedFlight
from groundstation.sources.visibility_table import FrameVisibility, write_visibility

# of the random numbers that choose which frames are lost
_LOST_STREAM = 302


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraRecording:
    """Format of one camera's stored pictures, and ``lost_share``, the share of them that is lost, at random."""

    coding: PictureCoding = field(default_factory=PictureCoding)
    lost_share: float = 0.0

    def __post_init__(self) -> None:
        require_fraction("CameraRecording: lost_share", self.lost_share)


def write_rendered_session(
    folder: Path,
    flight: SimulatedFlight,
    cameras: Mapping[str, RenderedCamera],
    *,
    words: Mapping[str, Any],
    faults: Sequence[Fault] = (),
    form: PictureFormat = PictureFormat.JPEG,
    recordings: Mapping[str, CameraRecording] | None = None,
    texts: Mapping[str, str] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Render a flight and write its session; ``words`` are the top of session.toml; ``progress(done, total)`` in pairs.

    ``recordings`` by station say more than ``form``, which is of all stations; ``texts`` are further files by name.
    The folder is there once it is whole, and not before.

    Raises `InputError` if the folder is not empty or cannot be written, `ScenarioError` where a fault cannot be.
    """
    if recordings is None:
        recordings = {name: CameraRecording(coding=PictureCoding(form=form)) for name in flight.rig.names}
    frames = _with_losses(flight, checked_frames(flight, faults), recordings)
    span_m = next(iter(cameras.values())).world.airframe.span_m
    tables = {**words, "target": {"span_m": span_m, **target_table(flight)}}
    try:
        with new_session_folder(folder) as draft:
            write_tables(draft, with_faults(flight, faults), tables)
            columns = ["index", *(f"{n}_t_s" for n in flight.rig.names)]
            write_table(draft / "frames.csv", columns, _frame_rows(flight, frames))
            filmed = _film(draft, flight, cameras, frames, recordings, progress)
            write_silhouettes(draft / "masks.npz", filmed.masks)
            write_visibility(draft, filmed.visibility)
            for name, text in (texts or {}).items():
                below(draft, name).write_text(text, encoding="utf-8", newline="\n")
    except (OSError, cv2.error) as fault:
        # a draft's name says nothing to the user
        got = os_words(fault)
        raise folder_fault(folder, OSError(got)) from fault


def checked_frames(flight: SimulatedFlight, faults: Sequence[Fault]) -> dict[str, DeliveredFrames]:
    """Return what each camera delivers.

    Raises `ScenarioError` where a fault has no device, or a camera's stamps step back: frames.csv is in order.
    """
    check_faults(flight, faults)
    frames = {name: delivered_frames(flight, name, faults) for name in flight.rig.names}
    for name, own in frames.items():
        if np.any(np.diff(own.t_s[own.there]) <= 0):
            where = f"fault of the camera of {name}"
            raise ScenarioError(where, got="stamps that step back", wanted="a smaller step, or one forward")
    return frames


def _frame_rows(flight: SimulatedFlight, frames: Mapping[str, DeliveredFrames]) -> Iterator[list[str]]:
    stamps = {n: device_from_session(flight.rig[n].camera_clock, own.t_s) for n, own in frames.items()}
    for k in range(flight.truth.t_s.size):
        yield [str(k), *(stamp_text(float(stamps[n][k])) if frames[n].there[k] else "" for n in frames)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Filmed:
    """The arrays of masks.npz and the rows of visibility.csv."""

    masks: dict[str, Any]
    visibility: list[tuple[int, str, FrameVisibility]]


def _with_losses(
    flight: SimulatedFlight, frames: Mapping[str, DeliveredFrames], recordings: Mapping[str, CameraRecording]
) -> dict[str, DeliveredFrames]:
    """Return the frames that are delivered after random losses."""
    left = {}
    for number, (name, own) in enumerate(frames.items()):
        generator = np.random.default_rng([flight.scenario.seed, _LOST_STREAM, number])
        lost = generator.uniform(size=own.there.size) < recordings[name].lost_share
        left[name] = replace(own, there=own.there & ~lost)
    return left


def _film(
    folder: Path,
    flight: SimulatedFlight,
    cameras: Mapping[str, RenderedCamera],
    frames: Mapping[str, DeliveredFrames],
    recordings: Mapping[str, CameraRecording],
    progress: Callable[[int, int], None],
) -> _Filmed:
    """Write the pictures of all cameras side by side."""
    count = flight.truth.t_s.size
    filmed = _Filmed(masks={}, visibility=[])
    with ExitStack() as opened:
        rate = flight.scenario.frame_hz
        writers = {
            n: opened.enter_context(picture_writer(folder, n, c.station.lens.image_size_px, recordings[n].coding, rate))
            for n, c in cameras.items()
        }
        pool = opened.enter_context(ThreadPoolExecutor(max_workers=len(cameras)))
        for k in range(count):

            def take(name: str, number: int = k) -> Shot:
                return _take(flight, name, frames[name], number, cameras[name], writers[name])

            # the first pictures compile: in this thread, so that an interrupt ends it
            for name, shot in zip(cameras, map(take, cameras) if k == 0 else pool.map(take, cameras), strict=True):
                filmed.masks[f"{name}_{k:04d}"] = shot.truth.silhouette.astype(np.uint8)
                filmed.masks[f"{name}_{k:04d}_xy"] = np.array(shot.truth.corner_px, dtype=np.int32)
                filmed.visibility.append((k, name, _visibility(shot)))
            progress(k + 1, count)
    return filmed


def _take(
    flight: SimulatedFlight, name: str, frames: DeliveredFrames, k: int, camera: RenderedCamera, writer: PictureWriter
) -> Shot:
    """Write the frame that a camera delivers as number k; return its truth."""
    station = flight.truth.stations[name]

    def exposure(n: int) -> tuple[float, float, float, float, float]:
        (pan, tilt), (pan_rate, tilt_rate) = station.angles_rad[n].tolist(), station.rates_rad_s[n].tolist()
        return float(station.t_s[n]), pan, tilt, pan_rate, tilt_rate

    shot, shown = camera.film(*exposure(k)), int(frames.shown[k])
    picture = shot.picture if shown == k else camera.picture(*exposure(shown))
    writer.write(k, picture.whole() if frames.there[k] else None)
    return shot


def _visibility(shot: Shot) -> FrameVisibility:
    truth = shot.truth
    return FrameVisibility(
        width_px=truth.width_px, in_view=truth.share_in_view, unhidden=truth.visible_share, snr=shot.snr
    )
