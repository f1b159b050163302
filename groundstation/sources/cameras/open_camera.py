"""Cameras opened by URL: `genicam:SERIAL?cti=FILE`, `gige:ADDRESS`, `opencv:0`, `rtsp://…`, `file:PATH`."""

import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, unquote

from groundstation.files.nearest_word import nearest_word
from groundstation.sources.cameras.camera import (
    CameraDevice,
    CameraError,
    CameraEvent,
    CameraSettings,
    CameraSupervision,
    CameraTiming,
    Clock,
)
from groundstation.sources.cameras.genicam_producer import GenicamCamera, load_harvesters, producers_of
from groundstation.sources.cameras.gige import GigeCamera, checked_address, checked_packet, load_viva
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.sources.cameras.opencv_capture import FileCamera, OpencvCamera

_SCHEMES = ("genicam", "gige", "opencv", "file")
_STREAMS = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp")
WANTED = "genicam:SERIAL?cti=FILE, gige:ADDRESS, opencv:0, opencv:/dev/video0, rtsp://…, http://… or file:PATH"
_OPTIONS = {"genicam": {"cti"}, "gige": {"packet"}}


class CameraUrlError(CameraError):
    """A text is no camera's URL; ``got`` and ``wanted`` are for those who know where the text stands."""

    def __init__(self, got: str, wanted: str, where: str = "camera") -> None:
        super().__init__(f"{where}: got {got}; wanted {wanted}")
        self.got, self.wanted = got, wanted


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraUrl:
    """A camera's parsed address: ``scheme``, ``place``, and options that may be repeated."""

    url: str
    scheme: str
    place: str
    options: Mapping[str, list[str]]


def parse_camera_url(url: str) -> CameraUrl:
    """Parse a URL; raises `CameraUrlError` where it is not that of a camera."""
    scheme, colon, rest = url.partition(":")
    scheme = scheme.lower()
    if colon and scheme in _STREAMS:
        if not rest.startswith("//") or not rest.strip("/"):
            raise CameraUrlError(repr(url), f"{scheme}://HOST/…")
        return CameraUrl(url=url, scheme=scheme, place=url, options={})
    if not colon or scheme not in _SCHEMES:
        hint = nearest_word(scheme, (*_SCHEMES, *_STREAMS))
        meant = f"; did you mean {hint}:{rest}?" if hint else ""
        raise CameraUrlError(repr(url), f"{WANTED}{meant}")
    # a file's name may hold a question mark
    place, mark, query = (rest, "", "") if scheme in ("file", "opencv") else rest.partition("?")
    place = unquote(place.removeprefix("//") if scheme != "opencv" else place)
    try:
        options = parse_qs(query, keep_blank_values=True, strict_parsing=bool(mark))
    except ValueError as error:
        raise CameraUrlError(repr(url), "KEY=VALUE after the question mark") from error
    able = _OPTIONS.get(scheme, set())
    unknown = sorted(set(options) - able)
    if unknown:
        wanted = ", ".join(sorted(able)) or "no options"
        raise CameraUrlError(f"option {unknown[0]!r}", wanted, f"camera {scheme}:{place}")
    if not place:
        raise CameraUrlError(repr(url), f"a place behind {scheme}:, as in {WANTED}")
    return CameraUrl(url=url, scheme=scheme, place=place, options=options)


def open_camera(
    url: str,
    settings: CameraSettings,
    *,
    clock: Clock,
    on_event: Callable[[CameraEvent], None],
    timing: CameraTiming | None = None,
    care: CameraSupervision | None = None,
    name: str | None = None,
    environ: Mapping[str, str] | None = None,
) -> LiveCamera:
    """Return a camera that opens on ``with``.

    Parameters
    ----------
    clock : the host's monotonic clock, s, in which all frames are stamped.
    on_event : called with each event as it happens, on the camera's thread.
    name : used in frames and events; default the URL.
    environ : environment with GenTL's search path; default the process's own.

    Raises `CameraError` at once for an invalid URL or a missing extra, on ``with`` for a camera that is
    missing or refuses its settings.
    """
    connect = _connector(parse_camera_url(url), settings, clock, os.environ if environ is None else environ)
    return LiveCamera(name or url, connect, timing or CameraTiming(), care or CameraSupervision(), clock, on_event)


def _connector(
    url: CameraUrl, settings: CameraSettings, clock: Clock, environ: Mapping[str, str]
) -> Callable[[], CameraDevice]:
    """Return the function that opens the device; errors in the URL are raised now."""
    if url.scheme == "gige":
        load_viva(url.url)
        address = checked_address(url.place)
        packet = checked_packet(url.options["packet"][-1]) if "packet" in url.options else None
        return lambda: GigeCamera(address, settings, packet)
    if url.scheme == "genicam":
        load_harvesters(url.url)
        producers = producers_of(list(url.options.get("cti", [])), environ)
        return lambda: GenicamCamera(url.place, producers, settings)
    if url.scheme == "file":
        if not Path(url.place).is_file():
            raise CameraError(f"{url.url}: got no such file; wanted a video")
        pause = threading.Event()
        return lambda: FileCamera(url.place, settings, url.url, clock, pause.wait)
    source = int(url.place) if url.scheme == "opencv" and url.place.isdecimal() else url.place
    return lambda: OpencvCamera(source, settings, url.url)
