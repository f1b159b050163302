"""Configuration and status of the recorder."""

from dataclasses import dataclass, field
from enum import StrEnum

from groundstation.recording.data_rates import DataRates


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderConfig:
    """Configuration of the recorder.

    Attributes
    ----------
    chunk_bytes, chunk_s : size and age at which a chunk is closed; the most that a killed process loses.
    sync_s : interval between syncs of the file to the disk.
    queue_picture_bytes, queue_items : limits of the queue.
    png_fill : fill level of the queue from which pictures are written uncompressed instead of as PNG.
    keep_free_bytes : free space below which pictures are not recorded.
    stop_free_bytes : free space below which nothing is recorded.
    retry_s : interval between attempts to write after a failure.
    close_s : time limit for the disk on closing.
    refused_close_s : the same for a disk that accepts no data; None for half of ``close_s``.
    patient : adding an event blocks until the disk accepts it, and a fault of the disk is raised; for offline use.
    """

    chunk_bytes: int = 2**20
    chunk_s: float = 0.25
    sync_s: float = 0.5
    queue_picture_bytes: int = 96 * 2**20
    queue_items: int = 30_000
    png_fill: float = 0.2
    keep_free_bytes: int = 2 * 2**30
    stop_free_bytes: int = 200 * 2**20
    retry_s: float = 0.5
    close_s: float = 20.0
    refused_close_s: float | None = None
    patient: bool = False


class RecorderState(StrEnum):
    """State of the recording."""

    RECORDING = "recording"
    NO_PICTURES = "recording without pictures"
    WAITING = "not recording"
    CLOSED = "closed"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderStatus:
    """State of the recording, its reason, and the losses so far.

    ``records_lost`` includes ``events_lost``; both are lost permanently. ``free_bytes`` is the free space of the disk,
    at most a second old; None before the first measurement or if the disk is unavailable. ``rates`` are the data rates
    while tracking and while searching.
    """

    state: RecorderState
    reason: str
    written_bytes: int
    fill: float
    pictures_dropped: int
    records_lost: int
    events_lost: int
    free_bytes: int | None = None
    rates: DataRates = field(default_factory=DataRates)

    @property
    def trouble(self) -> bool:
        """Whether the recording is incomplete or about to become so."""
        well = self.state in (RecorderState.RECORDING, RecorderState.CLOSED)
        return not well or bool(self.pictures_dropped or self.records_lost)

    def line(self) -> str:
        """Return the status as one line of text."""
        text = f"{self.state.value}: {self.reason}" if self.reason else self.state.value
        text += f", {self.written_bytes / 1e6:.1f} MB"
        if self.pictures_dropped:
            text += f", {self.pictures_dropped} pictures dropped"
        if self.records_lost:
            text += f", {self.records_lost} records lost ({self.events_lost} of them events)"
        return text


def left_to_recover(written_bytes: int) -> str:
    """Return advice on a recording that a disk fault ended."""
    return "; see `recover`" if written_bytes else "; nothing could be recorded"


# for offline use: pictures are always compressed
PATIENT = RecorderConfig(patient=True, png_fill=2.0, close_s=120.0)
