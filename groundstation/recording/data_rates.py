"""Data rates of a recording: while searching, when whole pictures are recorded, and while tracking."""

from dataclasses import dataclass

from groundstation.messages import TrackEstimate, TrackStatus

_TRACKING = (TrackStatus.TRACKING, TrackStatus.COASTING)
# estimates further apart belong to different stretches: a camera was lost, or the clock was reset
_PAUSE_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DataRates:
    """Bytes written and seconds flown while ``tracking`` (or coasting) and while ``searching`` (anything else)."""

    tracking_bytes: int = 0
    tracking_s: float = 0.0
    searching_bytes: int = 0
    searching_s: float = 0.0

    def line(self) -> str:
        """Return the rates as one line of text; "" before the first figures."""
        parts = (
            ("tracking", self.tracking_bytes, self.tracking_s),
            ("searching", self.searching_bytes, self.searching_s),
        )
        texts = [f"{n / s / 1e6:.1f} MB/s while {what} ({s:.0f} s)" for what, n, s in parts if s >= 1.0]
        return ", ".join(texts)


class DataRateMeter:
    """Counts bytes and seconds from estimate to estimate, in the order in which they are written.

    A chunk is written when it is full or 0.25 s old, so that up to 0.25 s of data count for the next status.
    """

    def __init__(self) -> None:
        self._rates = DataRates()
        self._last: tuple[float, int] | None = None

    @property
    def rates(self) -> DataRates:
        """The rates so far."""
        return self._rates

    def add_estimate(self, estimate: TrackEstimate, written_bytes: int) -> None:
        """Add the bytes written and the time since the previous estimate."""
        last, self._last = self._last, (estimate.t_s, written_bytes)
        if last is None or not 0.0 < estimate.t_s - last[0] < _PAUSE_S:
            return
        span_s, took = estimate.t_s - last[0], written_bytes - last[1]
        was = self._rates
        if estimate.status in _TRACKING:
            self._rates = DataRates(
                tracking_bytes=was.tracking_bytes + took,
                tracking_s=was.tracking_s + span_s,
                searching_bytes=was.searching_bytes,
                searching_s=was.searching_s,
            )
        else:
            self._rates = DataRates(
                tracking_bytes=was.tracking_bytes,
                tracking_s=was.tracking_s,
                searching_bytes=was.searching_bytes + took,
                searching_s=was.searching_s + span_s,
            )
