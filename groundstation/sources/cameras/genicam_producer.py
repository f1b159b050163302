"""GenICam cameras through harvesters and any vendor's GenTL producer, a .cti file (extra ``genicam``)."""

import contextlib
import importlib
import logging
import os
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from groundstation.sources.cameras.camera import (
    CameraDevice,
    CameraError,
    CameraLostError,
    CameraSettings,
    GrabbedFrame,
)
from groundstation.sources.cameras.genicam_features import apply_settings
from groundstation.sources.cameras.missing_extra import missing_extra
from groundstation.sources.cameras.pixel_formats import Pixels, pixels_of

# search path for producers, by the GenTL standard
SEARCH_VARIABLE = "GENICAM_GENTL64_PATH"
_BUFFERS = 8

# a producer can be opened once in a process, so that all cameras share it
_lock = threading.RLock()
_open: dict[tuple[Path, ...], tuple[Any, int]] = {}


class GenicamCamera(CameraDevice):
    """One camera of a GenTL producer, streaming.

    Parameters
    ----------
    name : its serial number, GenTL id or user-defined name.
    producers : the .cti files to search.
    """

    def __init__(self, name: str, producers: tuple[Path, ...], settings: CameraSettings) -> None:
        self._where = f"genicam:{name}"
        self._gentl = load_harvesters(self._where)[1]
        self._producers = producers
        self._acquirer: Any = None
        self._incomplete = 0
        harvester = _share(producers)
        try:
            with _lock:
                _refresh(harvester)
                infos = device_infos(harvester)
                index = next((i for i, info in enumerate(infos) if name in info.names), None)
                if index is None:
                    there = ", ".join(info.names[0] for info in infos) or "none"
                    raise CameraError(f"{self._where}: got none of that name (there: {there}); wanted a camera")
                self._acquirer = harvester.create(index)
            features = _NodeMapFeatures(self._acquirer.remote_device.node_map, self._gentl)
            found = apply_settings(features, settings, self._where)
            self.read_back = replace(found, model=infos[index].text or found.model, serial=infos[index].names[0])
            self._count_incomplete(self._acquirer)
            self._acquirer.num_buffers = max(_BUFFERS, self._acquirer.min_num_buffers)
            self._acquirer.start()
        except CameraError:
            self.close()
            raise
        except _faults(self._gentl) as error:
            self.close()
            raise CameraError(
                f"{self._where}: got {_line(error)}; wanted a camera that no other program has"
            ) from error

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame, whole or not."""
        try:
            buffer = self._acquirer.try_fetch(timeout=timeout_s)
            if buffer is None:
                return self._discarded()
            with buffer:
                return self._taken(buffer)
        except self._gentl.TimeoutException:
            return None
        except _faults(self._gentl) as error:
            raise CameraLostError(_line(error)) from error

    def close(self) -> None:
        """Stop and destroy the acquirer, and let the producer go with the last camera."""
        acquirer, self._acquirer = self._acquirer, None
        with _lock:
            if acquirer is not None:
                with contextlib.suppress(*_faults(self._gentl)):
                    acquirer.destroy()
            _unshare(self._producers)

    def _count_incomplete(self, acquirer: Any) -> None:
        """Count the frames that harvesters discards as incomplete."""
        camera = self

        class Discarded(load_harvesters(self._where)[0].Callback):  # type: ignore[misc]
            def emit(self, context: object = None) -> None:
                camera._incomplete += 1

        acquirer.add_callback(acquirer.Events.INCOMPLETE_BUFFER, Discarded())

    def _discarded(self) -> GrabbedFrame | None:
        """Return an incomplete frame, of which nothing is known, where there was one."""
        if not self._incomplete:
            return None
        self._incomplete -= 1
        return GrabbedFrame(frame_id=None, device_ns=None, pixels=None, pattern=None, payload_bytes=0)

    def _taken(self, buffer: Any) -> GrabbedFrame:
        """Copy a frame out of its buffer."""
        device_ns = _device_ns(buffer, self._gentl)
        if device_ns is not None and not self.read_back.device_clock:
            self.read_back = replace(self.read_back, device_clock=True)
        pixels: Pixels | None = None
        payload_bytes = 0
        if buffer.module.is_complete() and buffer.payload.components:
            image = buffer.payload.components[0]
            data = image.data
            pixels = pixels_of(data, image.data_format, (int(image.width), int(image.height)))
            payload_bytes = data.nbytes
        return GrabbedFrame(
            frame_id=int(buffer.module.frame_id),
            device_ns=device_ns,
            pixels=None if pixels is None else pixels.pixels,
            pattern=None if pixels is None else pixels.pattern,
            payload_bytes=payload_bytes,
        )


class DeviceNames:
    """A producer's names of a camera: ``names`` that open it, serial first, and ``text`` that describes it."""

    def __init__(self, properties: Mapping[str, Any]) -> None:
        names = (properties.get(k) for k in ("serial_number", "id_", "user_defined_name"))
        self.names = [str(n) for n in names if n]
        words = (properties.get(k) for k in ("vendor", "model", "tl_type"))
        self.text = " ".join(str(w) for w in words if w)


def device_infos(harvester: Any) -> list[DeviceNames]:
    """Return the cameras of a harvester, in its order."""
    return [DeviceNames(info.property_dict) for info in harvester.device_info_list]


def list_genicam(producers: tuple[Path, ...]) -> list[DeviceNames]:
    """Return the cameras that producers know; raises `CameraError`."""
    gentl = load_harvesters("genicam")[1]
    harvester = _share(producers)
    try:
        with _lock:
            _refresh(harvester)
            return device_infos(harvester)
    except _faults(gentl) as error:
        raise CameraError(f"genicam: got {_line(error)}; wanted a list of cameras") from error
    finally:
        _unshare(producers)


def producers_of(files: list[str], environ: Mapping[str, str]) -> tuple[Path, ...]:
    """Return the .cti files to use: those named, otherwise all on GenTL's search path; raises `CameraError`."""
    if files:
        paths = [Path(f) for f in files]
        for path in paths:
            if not path.is_file():
                raise CameraError(f"{path}: got no such file; wanted a GenTL producer (.cti)")
        return tuple(Path(os.path.realpath(path)) for path in paths)
    folders = [Path(f) for f in environ.get(SEARCH_VARIABLE, "").split(os.pathsep) if f]
    found = tuple(sorted(Path(os.path.realpath(path)) for folder in folders for path in folder.glob("*.cti")))
    if not found:
        wanted = f"?cti=FILE, or {SEARCH_VARIABLE} set as the camera's maker does"
        raise CameraError(f"genicam: got no GenTL producer; wanted {wanted}")
    return found


def load_harvesters(where: str) -> tuple[Any, Any]:
    """Return the modules harvesters.core and genicam.gentl; raises `CameraError` that names the extra."""
    # it writes tracebacks of faults to the terminal, which are events here
    logging.getLogger("harvesters").setLevel(logging.CRITICAL)
    try:
        return importlib.import_module("harvesters.core"), importlib.import_module("genicam.gentl")
    except ImportError as error:
        raise missing_extra(where, "harvesters", "genicam") from error


def _refresh(harvester: Any) -> None:
    """List the cameras again, without affecting running ones.

    harvesters' own update closes every camera, so it needs none running; otherwise its interfaces are queried.
    """
    if not harvester.image_acquirers:
        harvester.update()
        return
    core = load_harvesters("genicam")[0]
    harvester.device_info_list.clear()
    for interface in harvester._ifaces:
        interface.update_device_info_list(harvester.timeout_for_update)
        found = (core.DeviceInfo(module=info, parent=interface) for info in interface.device_info_list)
        harvester.device_info_list.extend(found)


def _share(producers: tuple[Path, ...]) -> Any:
    """Return the harvester of these producers, opened by the first call."""
    core, gentl = load_harvesters("genicam")
    with _lock:
        harvester, users = _open.get(producers, (None, 0))
        if harvester is None:
            harvester = core.Harvester()
            for path in producers:
                try:
                    harvester.add_file(str(path), check_validity=True)
                except _faults(gentl) as error:
                    harvester.reset()
                    raise CameraError(f"{path}: got {_line(error)}; wanted a GenTL producer (.cti)") from error
        _open[producers] = harvester, users + 1
        return harvester


def _unshare(producers: tuple[Path, ...]) -> None:
    """Give a harvester back; the last closes it."""
    with _lock:
        harvester, users = _open[producers]
        if users > 1:
            _open[producers] = harvester, users - 1
            return
        del _open[producers]
        harvester.reset()


class _NodeMapFeatures:
    """Features through GenICam's reference implementation."""

    def __init__(self, node_map: Any, gentl: Any) -> None:
        self._nodes = node_map
        self._faults = _faults(gentl)

    def number(self, name: str) -> float | None:
        value = self._value(name)
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None

    def text(self, name: str) -> str | None:
        value = self._value(name)
        return None if value is None else str(value)

    def write(self, name: str, value: float | str | bool) -> None:
        try:
            node = getattr(self._nodes, name)
            whole = isinstance(node.value, int) and not isinstance(value, bool | str)
            node.value = round(value) if whole and not isinstance(value, str) else value
        except self._faults as error:
            raise CameraError(_line(error)) from error

    def _value(self, name: str) -> Any:
        try:
            return getattr(self._nodes, name).value
        except self._faults:
            return None


def _device_ns(buffer: Any, gentl: Any) -> int | None:
    """Return a frame's stamp in ns; None where the producer has none."""
    with contextlib.suppress(*_faults(gentl)):
        return int(buffer.module.timestamp_ns) or None
    with contextlib.suppress(*_faults(gentl)):
        ticks, frequency = int(buffer.timestamp), int(buffer.timestamp_frequency)
        return ticks * 1_000_000_000 // frequency or None
    return None


def _faults(gentl: Any) -> tuple[type[Exception], ...]:
    """Return what harvesters and the libraries below it raise."""
    genapi = importlib.import_module("genicam.genapi")
    return (
        gentl.GenericException,
        genapi.GenericException,
        AttributeError,
        ValueError,
        RuntimeError,
        OSError,
        TypeError,
    )


def _line(error: Exception) -> str:
    """Return an exception of the library in one line."""
    return " ".join(str(error).split()) or type(error).__name__
