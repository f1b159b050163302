"""The reference receiver of a station file, set up: clock, conversion of its positions, output table."""

import dataclasses
import time
from pathlib import Path

from groundstation.live.input_queue import InputQueue
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.reference_fixes import ReferenceClock, ReferenceConverter
from groundstation.live.reference_table import DgpsTable
from groundstation.live.reference_worker import ReferenceWorker
from groundstation.live.station_file import StationFile
from groundstation.recording.recorder import Recorder
from groundstation.replay.reference_prior import ReferencePrior
from groundstation.session.logs.gps_time import TimeScale, civil_from_unix, gps_from_civil
from groundstation.tracking.config import Config

DGPS_TABLE = "dgps.csv"


def reference_tuning(config: Config, device: ReferenceDevice | None) -> Config:
    """Return the tuning with the station file's uncertainty of the receiver's clock."""
    if device is None or device.clock_sigma_s is None:
        return config
    estimation = dataclasses.replace(config.estimation, reference_clock_sigma_s=device.clock_sigma_s)
    return dataclasses.replace(config, estimation=estimation)


def gps_time_of(monotonic_s: float) -> float:
    """Return the GPS time of an instant of the host's monotonic clock, by its wall clock as it is now."""
    unix_s = time.time() - (time.monotonic() - monotonic_s)
    return gps_from_civil(*civil_from_unix(unix_s), TimeScale.UTC)


class ReferenceReceiver:
    """The worker of a station's reference receiver, if it has one, and its table.

    Parameters
    ----------
    known : of its antenna and clock, as a replay will know it.
    start_s : the session's time zero on the host's monotonic clock.
    folder : where ``dgps.csv`` is written. faults : called if the disk refuses it.
    """

    def __init__(
        self,
        file: StationFile,
        known: ReferencePrior,
        input_queue: InputQueue,
        *,
        start_s: float,
        folder: Path,
        faults: list[str],
    ) -> None:
        self.worker: ReferenceWorker | None = None
        self._table = DgpsTable(folder / DGPS_TABLE, faults)
        device, origin = file.reference, file.origin
        if device is None or origin is None:
            return
        clock = ReferenceClock(gps_time_of(start_s), device.clock_offset_s)
        converter = ReferenceConverter(origin, clock, known.antenna_in_body_m, known.offset_s)
        self.worker = ReferenceWorker(device, converter, input_queue, self._table, start_s=start_s)

    def close(self, recorder: Recorder | None = None) -> None:
        """Close the table and add it to the recording; twice does no harm."""
        content = self._table.close()
        if content is not None and recorder is not None:
            recorder.attach(DGPS_TABLE, content)
