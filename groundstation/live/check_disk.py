"""`groundstation check` of the disk: does it hold what a search takes, of which whole pictures are kept?"""

import os
import shutil
from collections.abc import Mapping

from groundstation.live.check_result import CheckResult, failed, passed
from groundstation.live.station_file import StationFile
from groundstation.recording.recorder_status import RecorderConfig
from groundstation.rig.rig import Rig

_COLOUR_BYTES = 3


def searching_bytes_per_s(file: StationFile, rig: Rig, raw: Mapping[str, bool]) -> float:
    """Return what a recording takes a second while searching: whole pictures, not packed.

    ``raw`` states by station whether a pixel is one byte; a camera without an entry counts as raw.
    """
    pixels = 0
    for station in rig.stations:
        w, h = station.lens.image_size_px
        pixels += w * h * (1 if raw.get(station.name, True) else _COLOUR_BYTES)
    return pixels * file.rate_hz


def check_disk(file: StationFile, rig: Rig, raw: Mapping[str, bool]) -> CheckResult:
    """Compare the free space with the need for the recording time of the station file."""
    if file.record is None:
        return passed("disk: no [record] folder; live will ask for --out")
    place = file.record
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        return failed(f"disk: got {place}, a file; wanted a folder to record in: [record] folder")
    if not os.access(place, os.W_OK | os.X_OK):
        return failed(f"disk: got {place}, which nothing can be written to; wanted a folder to record in")
    rate = searching_bytes_per_s(file, rig, raw)
    free = shutil.disk_usage(place).free
    minutes = max(free - RecorderConfig().keep_free_bytes, 0) / rate / 60.0
    text = (
        f"disk: {free / 1e9:.0f} GB free below {file.record}: {minutes:.0f} min of searching at {rate / 1e6:.0f} MB/s"
    )
    if 60.0 * minutes < file.record_s:
        return failed(f"{text}; wanted {file.record_s / 60.0:g} ([record] minutes), tracking takes far less")
    return passed(text)
