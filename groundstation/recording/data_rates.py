"""Data rates of a recording: while searching, which records whole pictures, and while tracking."""

from dataclasses import dataclass

from groundstation.messages import TrackEstimate, TrackStatus

_TRACKING = (TrackStatus.TRACKING, TrackStatus.COASTING)
# answers further apart than that have nothing to do with each other: a camera was away, the clock began anew
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
        said = [f"{n / s / 1e6:.1f} MB/s while {what} ({s:.0f} s)" for what, n, s in parts if s >= 1.0]
        return ", ".join(said)


class DataRateMeter:
    """Books what is written, answer by answer, in the writer's own order: what waits to be written blurs nothing.

    A chunk is written when it is full or 0.25 s old, so that much of one stretch may be booked to the next.
    """

    def __init__(self) -> None:
        self._rates = DataRates()
        self._last: tuple[float, int] | None = None

    @property
    def rates(self) -> DataRates:
        """What was booked so far."""
        return self._rates

    def answered(self, estimate: TrackEstimate, written_bytes: int) -> None:
        """Book what was written, and the time that went by, since the last answer."""
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
