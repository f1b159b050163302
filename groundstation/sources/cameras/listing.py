"""Which cameras there are, by every way that is installed."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from groundstation.sources.cameras.camera import CameraError
from groundstation.sources.cameras.genicam_producer import list_genicam, producers_of
from groundstation.sources.cameras.gige import discover_gige


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraListing:
    """``cameras`` are URL and description of each; ``notices`` state where the search was not possible, and why."""

    cameras: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]


def list_cameras(producers: list[str], environ: Mapping[str, str], devices: Path) -> CameraListing:
    """Search for cameras: GigE Vision on every network, GenTL producers, Linux's video devices below ``devices``."""
    cameras: list[tuple[str, str]] = []
    notices: list[str] = []
    try:
        for info in discover_gige(loopback=True):
            cameras.append((f"gige:{info.ip}", " ".join(w for w in (info.manufacturer, info.model, info.mac) if w)))
    except CameraError as error:
        notices.append(str(error))
    try:
        for path in producers_of(producers, environ):
            for names in list_genicam((path,)):
                cameras.append((f"genicam:{names.names[0]}?cti={path}", names.text))
    except CameraError as error:
        notices.append(str(error))
    for device in sorted(devices.glob("video*")):
        cameras.append((f"opencv:{device}", "a video device"))
    return CameraListing(cameras=tuple(cameras), notices=tuple(notices))
