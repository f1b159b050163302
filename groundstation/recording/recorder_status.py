"""The recorder's tuning, and what it says of itself."""

from dataclasses import dataclass, field
from enum import StrEnum

from groundstation.recording.recorder_rates import RecordingRates


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderConfig:
    """Tuning of the recorder.

    Attributes
    ----------
    chunk_bytes, chunk_s : a chunk is closed when it has so much, or is so old; what a killed process loses at most.
    sync_s : so often what is written is brought onto the disk itself.
    queue_picture_bytes, queue_items : so much may wait for the disk.
    png_fill : from this share of a full queue on pictures are no longer packed as PNG.
    keep_free_bytes : with less free space pictures are no longer recorded.
    stop_free_bytes : with less free space nothing is, until there is more again.
    retry_s : a disk that took nothing is tried again after so long.
    close_s : closing waits so long for the disk.
    patient : whoever hands over waits for the disk, and a fault of the disk is raised: for work that is not live.
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
    patient: bool = False


class RecorderState(StrEnum):
    """How recording goes."""

    RECORDING = "recording"
    NO_PICTURES = "recording without pictures"
    WAITING = "not recording"
    CLOSED = "closed"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderStatus:
    """How recording goes, why, and what it has cost so far.

    ``events_lost`` are among ``records_lost``; both are lost for good, not merely late. ``free_bytes`` of the disk were
    free when last looked, a second ago at most; None before the first look, or where the disk is gone. ``rates`` says
    what was written while tracking and while searching.
    """

    state: RecorderState
    reason: str
    written_bytes: int
    fill: float
    pictures_dropped: int
    records_lost: int
    events_lost: int
    free_bytes: int | None = None
    rates: RecordingRates = field(default_factory=RecordingRates)

    @property
    def trouble(self) -> bool:
        """Whether the recording lacks something, or soon will."""
        well = self.state in (RecorderState.RECORDING, RecorderState.CLOSED)
        return not well or bool(self.pictures_dropped or self.records_lost)

    def line(self) -> str:
        """Return it as one line for a person."""
        text = f"{self.state.value}: {self.reason}" if self.reason else self.state.value
        text += f", {self.written_bytes / 1e6:.1f} MB"
        if self.pictures_dropped:
            text += f", {self.pictures_dropped} pictures dropped"
        if self.records_lost:
            text += f", {self.records_lost} records lost ({self.events_lost} of them events)"
        return text


def left_to_recover(written_bytes: int) -> str:
    """Return what is to be done about a recording that the disk ended."""
    return "; see `recover`" if written_bytes else "; nothing could be recorded"


# nothing waits longer than its picture takes to be packed
PATIENT = RecorderConfig(patient=True, png_fill=2.0, close_s=120.0)
