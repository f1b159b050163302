"""Which of two rows whose times contradict each other is at fault: one time far ahead makes all that follow earlier."""

from dataclasses import dataclass


@dataclass(slots=True)
class RowTimes:
    """The two newest times of a table's rows, in s, and the number of the row that has the newest."""

    newest_s: float | None = None
    row: int = -1
    _before_s: float | None = None

    def add(self, t_s: float, row: int = -1) -> None:
        """Take the time of the next row."""
        self._before_s, self.newest_s, self.row = self.newest_s, t_s, row

    def is_ahead_of(self, t_s: float) -> bool:
        """Return whether the newest row is out of order rather than the next one, whose time ``t_s`` is earlier.

        So it is where ``t_s`` follows the row before the newest, and is nearer to it; of a first row, always.
        """
        if self.newest_s is None or t_s >= self.newest_s:
            return False
        return self._before_s is None or 0.0 < t_s - self._before_s < self.newest_s - t_s
