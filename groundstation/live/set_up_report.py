"""What is said at the start of an operation about what it does with the station's files."""

import time
from collections.abc import Callable

from groundstation.live.devices import drift_notes
from groundstation.live.keep_out_zones import sun_text
from groundstation.live.station_file import StationFile
from groundstation.replay.reference_prior import ReferencePrior
from groundstation.rig.rig import Rig


def report_set_up(
    file: StationFile,
    rig: Rig,
    known: ReferencePrior,
    log: Callable[[str, str], None],
    say: Callable[[str], None],
) -> None:
    """Report and log where the Sun is, and what of the rig is left out, or used for the reference receiver.

    ``known`` of the receiver; ``log`` takes a level and a line.
    """
    for line in drift_notes(file.load_rig()):
        log("warning", line)
    for line in known.notes if file.reference is not None else ():
        say(line)
        log("info", line)
    is_known, text = sun_text(file, rig, time.time())
    if file.sun_angle_rad != 0.0:
        say(text)
        log("info" if is_known else "warning", text)
