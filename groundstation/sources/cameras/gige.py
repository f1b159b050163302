"""GigE Vision cameras through viva-genicam: no vendor's software, no driver (extra ``gige``)."""

import contextlib
import importlib
import ipaddress
from dataclasses import replace
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
from groundstation.sources.cameras.pixel_formats import pixels_of

_DISCOVERY_MS = 500
# bootstrap register of GigE Vision: ticks of the timestamp per second, 64 bits
_TICK_FREQUENCY = 0x093C
_LEAST_PACKET, _LARGEST_PACKET = 576, 65535


class GigeCamera(CameraDevice):
    """One GigE Vision camera, opened at an address and streaming.

    Parameters
    ----------
    address : IPv4 address of the camera.
    packet_bytes : bytes per packet; None for the largest that the way carries.
    """

    def __init__(self, address: str, settings: CameraSettings, packet_bytes: int | None = None) -> None:
        self._where = f"gige:{address}"
        self._viva = load_viva(self._where)
        self._camera = self._connect(address)
        self._stream: Any = None
        try:
            features = _VivaFeatures(self._camera)
            read_back = apply_settings(features, settings, self._where)
            self._tick_hz = self._tick_frequency(features)
            self.read_back = replace(read_back, device_clock=self._tick_hz is not None)
            self._stream = self._camera.stream(
                packet_size=packet_bytes, auto_packet_size=packet_bytes is None, deliver_incomplete=True
            )
            self._stream.__enter__()
        except self._viva.GenicamError as error:
            self.close()
            raise CameraError(f"{self._where}: got {error}; wanted a camera that streams") from error
        except CameraError:
            self.close()
            raise

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame, whole or not."""
        try:
            frame = self._stream.next_frame(max(int(timeout_s * 1000), 1))
        except self._viva.TransportError as error:
            if "timeout" in str(error):
                if self._camera.control_state is not self._viva.ControlState.HELD:
                    raise CameraLostError("the camera does not answer any more, or someone else has it") from error
                return None
            raise CameraLostError(str(error)) from error
        except self._viva.GenicamError as error:
            raise CameraLostError(str(error)) from error
        if frame is None:
            raise CameraLostError("the camera has ended its stream")
        device_ns = None
        if frame.ts_dev is not None and self._tick_hz is not None:
            device_ns = frame.ts_dev * 1_000_000_000 // self._tick_hz
        grab = GrabbedFrame(frame_id=frame.block_id, device_ns=device_ns, pixels=None, pattern=None, payload_bytes=0)
        if not frame.is_complete:
            return grab
        data = frame.to_numpy()
        # padding and packing are gone, and colours have become RGB, whatever was sent
        pixel_format = "RGB8" if data.ndim == 3 else frame.pixel_format.removesuffix("Packed").removesuffix("p")
        pixels = pixels_of(data, pixel_format, (frame.width, frame.height))
        return GrabbedFrame(
            frame_id=frame.block_id,
            device_ns=device_ns,
            pixels=pixels.pixels,
            pattern=pixels.pattern,
            payload_bytes=data.nbytes,
        )

    def close(self) -> None:
        """Stop the stream and release the camera, as far as it still responds."""
        if self._stream is not None:
            with contextlib.suppress(self._viva.GenicamError, OSError):
                self._stream.__exit__(None, None, None)
        with contextlib.suppress(self._viva.GenicamError, OSError):
            self._camera.close()

    def _connect(self, address: str) -> Any:
        found = discover_gige(loopback=ipaddress.ip_address(address).is_loopback)
        here = next((info for info in found if info.ip == address), None)
        if here is None:
            others = ", ".join(info.ip for info in found) or "none"
            raise CameraError(f"{self._where}: got no answer (GigE cameras that answer: {others}); wanted a camera")
        try:
            return self._viva.connect_gige(here)
        except self._viva.GenicamError as error:
            raise CameraError(f"{self._where}: got {error}; wanted a camera that no other program controls") from error

    def _tick_frequency(self, features: "_VivaFeatures") -> int | None:
        """Return the ticks per second of the camera's clock; None where it has none."""
        for name in ("GevTimestampTickFrequency", "TimestampTickFrequency"):
            ticks = features.number(name)
            if ticks:
                return int(ticks)
        return int.from_bytes(self._camera.read_register(_TICK_FREQUENCY, 8), "big") or None


def discover_gige(*, loopback: bool) -> list[Any]:
    """Return the GigE Vision cameras that respond: objects with ip, mac, manufacturer, model."""
    viva = load_viva("gige")
    try:
        return list(viva.discover(timeout_ms=_DISCOVERY_MS, all=loopback))
    except viva.GenicamError as error:
        raise CameraError(f"gige: got {error}; wanted a network to look for cameras in") from error


def load_viva(where: str) -> Any:
    """Return the library; raises `CameraError` that names the extra."""
    try:
        return importlib.import_module("viva_genicam")
    except ImportError as error:
        raise missing_extra(where, "viva-genicam", "gige") from error


def checked_address(address: str) -> str:
    """Return an IPv4 address; raises `CameraError` where it is not one."""
    try:
        return str(ipaddress.IPv4Address(address))
    except ValueError as error:
        raise CameraError(f"gige:{address}: got {address!r}; wanted an IPv4 address") from error


def checked_packet(text: str) -> int:
    """Return a packet size in bytes; raises `CameraError`."""
    if not text.isdecimal() or not _LEAST_PACKET <= int(text) <= _LARGEST_PACKET:
        wanted = f"{_LEAST_PACKET} to {_LARGEST_PACKET} bytes"
        raise CameraError(f"gige: packet: got {text!r}; wanted {wanted}")
    return int(text)


class _VivaFeatures:
    """Features through viva-genicam."""

    def __init__(self, camera: Any) -> None:
        self._camera = camera
        self._viva = importlib.import_module("viva_genicam")

    def number(self, name: str) -> float | None:
        text = self.text(name)
        try:
            return None if text is None else float(text)
        except ValueError:
            return None

    def text(self, name: str) -> str | None:
        try:
            return str(self._camera.get(name))
        except self._viva.GenApiError:
            return None

    def write(self, name: str, value: float | str | bool) -> None:
        try:
            kind = self._camera.node_info(name).kind
            if isinstance(value, bool):
                self._camera.set_bool(name, value)
            elif isinstance(value, str):
                self._camera.set_enum(name, value)
            elif kind == "Integer":
                self._camera.set_integer(name, round(value))
            else:
                self._camera.set_float(name, float(value))
        except self._viva.GenicamError as error:
            raise CameraError(str(error)) from error
