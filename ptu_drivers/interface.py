"""Interface of all pan-tilt units, independent of the protocol."""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from ptu_drivers.health import Health
from ptu_drivers.messages import NoReading, Reading, UnitDescription


class PanTiltUnit(ABC):
    """An opened and probed pan-tilt unit, a context manager that halts it on exit.

    Methods may be called from several threads; there is one exchange on the line at a time. No method waits longer than
    `describe().reply_timeout_s` for the line, except `halt`, `home` and `close`, whose docstrings state their time. The
    bound is that of the whole call, however slowly a reply arrives.
    """

    @abstractmethod
    def describe(self) -> UnitDescription:
        """Return the result of the probe, without traffic."""

    @abstractmethod
    def read(self) -> Reading | NoReading:
        """Query the position of both axes.

        Returns
        -------
        `Reading` : angles with the instants at which they were valid, or
        `NoReading` : the reason. A doubtful reply is discarded and counted, never returned. Line faults are
            not raised: each further call continues the recovery, and angles are returned again when the line is back.

        Raises
        ------
        LineError : the unit was closed by its user.
        """

    @abstractmethod
    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        """Start to turn to a position, rad, and return when the unit has acknowledged; `None` leaves an axis unchanged.

        A new target replaces the old one in motion. With `rate_rad_s` both axes use that speed, otherwise the unit's
        own (as set by the last call that named one, or as it was found). Ends motion by rate.

        Raises
        ------
        LimitError : beyond a limit or a speed bound; nothing was sent. NaN is beyond every limit.
        RefusedError : the unit refused it. NoAnswerError, LineError : it is unknown whether it moves; it is halted as
            soon as the line is back.
        """

    @abstractmethod
    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        """Turn at a rate, rad/s, until the next command; a driver stops at its limits by itself.

        To be repeated within `UnitSettings.watchdog_s`, else the watchdog halts the unit. If the host itself falls
        silent, the unit stops as stated in `describe().lease`.

        Raises
        ------
        LimitError : faster than allowed (a rate below the slowest is refused too, 0 is not). UnsupportedError.
        RefusedError, NoAnswerError, LineError : as `move_to`.
        """

    @abstractmethod
    def halt(self) -> None:
        """Stop both axes now, and return when the unit has acknowledged.

        It has priority over every other call: another thread's exchange on the line is aborted (its `read` returns
        `NoReading`, its move raises `NoAnswerError`), and the halt is sent before any query. It is repeated over
        line faults within the time of three exchanges.

        Raises
        ------
        NoAnswerError, LineError : not acknowledged; halted again when the line is back.
        """

    @abstractmethod
    def home(self) -> None:
        """Reset and home the unit; takes up to `UnitSettings.homing_timeout_s`. Angles are absent meanwhile.

        Raises
        ------
        UnsupportedError, RefusedError, NoAnswerError, LineError.
        """

    @abstractmethod
    def health(self) -> Health:
        """Return the counts until now; no traffic."""

    @abstractmethod
    def close(self) -> None:
        """Halt and close the line, within the time of three exchanges; never raises; a second call has no effect.

        `health().halt_owed` states afterwards whether the halt was not acknowledged.
        """

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
