"""Writing a simulated flight with rendered pictures as a session folder (docs/formats.md).

The folder holds what a receiver would have, faults included; truth.csv and masks.npz hold the exact truth.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.errors import InputError, ScenarioError
from groundstation.files.output_names import below
from groundstation.simulation.device_clocks import device_from_session
from groundstation.simulation.event_faults import DeliveredFrames, Fault, check_faults, delivered_frames, with_faults
from groundstation.simulation.rendered_camera import PictureTruth, RenderedCamera
from groundstation.simulation.session_folder import (
    folder_fault,
    make_session_folder,
    stamp_text,
    write_table,
    write_tables,
)
from groundstation.simulation.simulate import SimulatedFlight

_JPEG_QUALITY = 95


class PictureFormat(StrEnum):
    """How pictures are kept: JPEG frames of quality 95 in an AVI, lossless FFV1 in a Matroska, or PNG files."""

    VIDEO = "video"
    LOSSLESS = "lossless"
    PNG = "png"


def write_rendered_session(
    folder: Path,
    flight: SimulatedFlight,
    cameras: Mapping[str, RenderedCamera],
    *,
    words: Mapping[str, Any],
    faults: Sequence[Fault] = (),
    form: PictureFormat = PictureFormat.VIDEO,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Render a flight and write its session; ``words`` are the top of session.toml; ``progress(done, total)`` in pairs.

    Raises `InputError` if the folder is not empty or cannot be written, `ScenarioError` where a fault cannot be.
    """
    frames = checked_frames(flight, faults)
    span_m = next(iter(cameras.values())).world.airframe.span_m
    tables = {**words, "target": {"span_m": span_m}}
    try:
        make_session_folder(folder)
        write_tables(folder, with_faults(flight, faults), tables)
        columns = ["index", *(f"{n}_t_s" for n in flight.rig.names)]
        write_table(folder / "frames.csv", columns, _frame_rows(flight, frames))
        masks = _film(folder, flight, cameras, frames, form, progress)
        np.savez_compressed(folder / "masks.npz", allow_pickle=False, **masks)
    except (OSError, cv2.error) as fault:
        raise folder_fault(folder, OSError(str(fault))) from fault


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


def _film(
    folder: Path,
    flight: SimulatedFlight,
    cameras: Mapping[str, RenderedCamera],
    frames: Mapping[str, DeliveredFrames],
    form: PictureFormat,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    """Write the pictures of all cameras side by side; return the arrays of masks.npz."""
    count = flight.truth.t_s.size
    masks: dict[str, Any] = {}
    with ExitStack() as opened:
        rate = flight.scenario.frame_hz
        writers = {n: opened.enter_context(_Writer(folder, n, c, form, rate)) for n, c in cameras.items()}
        pool = opened.enter_context(ThreadPoolExecutor(max_workers=len(cameras)))
        for k in range(count):
            jobs = [pool.submit(_take, flight, n, frames[n], k, cameras[n], writers[n]) for n in cameras]
            for name, job in zip(cameras, jobs, strict=True):
                truth = job.result()
                masks[f"{name}_{k:04d}"] = truth.silhouette.astype(np.uint8)
                masks[f"{name}_{k:04d}_xy"] = np.array(truth.corner_px, dtype=np.int32)
            progress(k + 1, count)
    return masks


def _take(
    flight: SimulatedFlight, name: str, frames: DeliveredFrames, k: int, camera: RenderedCamera, writer: "_Writer"
) -> PictureTruth:
    """Write what a camera delivers as number k; return what was truly there to be seen."""
    station = flight.truth.stations[name]

    def exposure(n: int) -> tuple[float, float, float, float, float]:
        (pan, tilt), (pan_rate, tilt_rate) = station.angles_rad[n].tolist(), station.rates_rad_s[n].tolist()
        return float(station.t_s[n]), pan, tilt, pan_rate, tilt_rate

    writer.write(k, camera.picture(*exposure(int(frames.shown[k]))).whole() if frames.there[k] else None)
    return camera.truth(*exposure(k))


class _Writer:
    """One station's pictures by number; a missing one keeps its number."""

    def __init__(self, folder: Path, name: str, camera: RenderedCamera, form: PictureFormat, rate_hz: float) -> None:
        self._form = form
        self._size = camera.station.lens.image_size_px
        self._video: cv2.VideoWriter | None = None
        self._folder = below(folder, name)
        if form is PictureFormat.PNG:
            self._folder.mkdir()
            return
        if form is PictureFormat.VIDEO:
            path, backend, code = below(folder, f"{name}.avi"), cv2.CAP_OPENCV_MJPEG, "MJPG"
        else:
            path, backend, code = below(folder, f"{name}.mkv"), cv2.CAP_FFMPEG, "FFV1"
        # the frame rate is a header's formality: frames.csv rules
        video = cv2.VideoWriter(str(path), backend, cv2.VideoWriter.fourcc(*code), max(rate_hz, 1.0), self._size)
        if not video.isOpened():
            raise InputError(str(path), got=f"an OpenCV that does not write {code}", wanted="another --pictures")
        if form is PictureFormat.VIDEO:
            video.set(cv2.VIDEOWRITER_PROP_QUALITY, _JPEG_QUALITY)
        self._video = video

    def __enter__(self) -> "_Writer":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        if self._video is not None:
            self._video.release()

    def write(self, number: int, image: ImageArray | None) -> None:
        """Write picture ``number``; None is a missing one: black in a video, no file in a folder."""
        if self._video is not None:
            w, h = self._size
            self._video.write(np.zeros((h, w, 3), np.uint8) if image is None else image)
        elif image is not None:
            path = below(self._folder, f"{number:06d}.png")
            good, encoded = cv2.imencode(".png", image)
            if not good:
                raise OSError(f"{path.name}: OpenCV cannot encode it")
            path.write_bytes(encoded.tobytes())
