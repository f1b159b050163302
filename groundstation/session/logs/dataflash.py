"""ArduPilot's onboard log (.bin): the GPS and GPA messages, read by pymavlink's DFReader, with the receiver's times.

GPS has week and milliseconds of the receiver; pymavlink's conversion to UTC is not used.
"""

import contextlib
import io
import math
from pathlib import Path
from typing import Any

from groundstation.errors import LogError, MissingExtraError
from groundstation.files.toml_table import shown
from groundstation.session.logs.fixes import (
    FixQuality,
    Heights,
    LogFix,
    LogOptions,
    ReadingNotes,
    check_count,
    plausible,
    usable_sigma,
)
from groundstation.session.logs.gps_time import DAY_S, WEEK_S, TimeScale

_QUALITY = {3: FixQuality.SINGLE, 4: FixQuality.DGPS, 5: FixQuality.FLOAT, 6: FixQuality.FIX}
_MAX_BYTES = 4_000_000_000
_MAX_WEEK = 10_000
_HEAD_BYTES = 3
# the shortest GPS and GPA of any firmware have more; of shorter ones a file could hold hundreds of thousands
_LEAST_BYTES = {"GPS": 20, "GPA": 20}


def read_dataflash(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read the positions of an onboard log. Raises `LogError` where it is not one."""
    open_log = _opener()
    if path.stat().st_size > _MAX_BYTES:
        raise LogError(path.name, got="a larger file", wanted=f"at most {_MAX_BYTES} bytes of log")
    reported = _Complaints()
    rows = _FixRows(path, options, remarks)
    try:
        with contextlib.redirect_stdout(reported), contextlib.redirect_stderr(reported), open_log(str(path)) as log:
            while (message := log.recv_match(type=["GPS", "GPA"])) is not None:
                rows.take(message)
    except LogError:
        raise
    except Exception as error:
        if not rows.fixes:
            got = f"no onboard log that pymavlink reads ({shown(f'{type(error).__name__}: {error}', 120)})"
            raise LogError(path.name, got=got, wanted="a .bin of ArduPilot") from error
        remarks.note(f"damaged: nothing is read after its {rows.seen}th GPS message")
    if reported.bad:
        remarks.count("stretch that pymavlink could not read", number=reported.bad)
    return rows.fixes


class _Complaints(io.TextIOBase):
    """Counts pymavlink's messages about unreadable sections, of which some have one per byte; stores none."""

    def __init__(self) -> None:
        super().__init__()
        self.bad = 0

    def write(self, text: str) -> int:
        """Take a piece of a line."""
        self.bad += any(words in text for words in ("bad header", "Skipped", "unknown msg"))
        return len(text)


def _opener() -> Any:
    """Return pymavlink's reader without its compiled index, which writes to the terminal on damaged logs."""
    try:
        from pymavlink.DFReader import DFReader_binary
    except ImportError as error:
        raise MissingExtraError("reading ArduPilot logs", "logs") from error

    class Reader(DFReader_binary):  # type: ignore[misc]
        formats: dict[int, Any]

        def __init__(self, name: str) -> None:
            try:
                super().__init__(name)
            except BaseException:
                # pymavlink leaves its file open
                self.filehandle.close()
                raise

        def init_arrays_fast(self, progress_callback: Any = None) -> None:
            self.init_arrays(progress_callback=progress_callback)

        def init_arrays(self, progress_callback: Any = None) -> None:
            self.formats = _Formats(self.formats)
            super().init_arrays(progress_callback=progress_callback)

    return Reader


class _Formats(dict[int, Any]):
    """Descriptions of messages by type; one with an impossibly short message is not used.

    With a damaged length of zero the same message would be read without end.
    """

    def __setitem__(self, kind: int, description: Any) -> None:
        if description.len >= _LEAST_BYTES.get(description.name, _HEAD_BYTES):
            super().__setitem__(kind, description)


class _FixRows:
    """Gathers fixes from messages."""

    def __init__(self, path: Path, options: LogOptions, remarks: ReadingNotes) -> None:
        self._path = path
        self._remarks = remarks
        self._heights = Heights(path, options)
        self._instance = options.instance
        remarks.used.add("instance")
        self._accuracy: dict[int, tuple[float, float]] = {}
        self._undulation: dict[int, float] = {}
        self.fixes: list[LogFix] = []
        self.seen = 0

    def take(self, message: Any) -> None:
        """Take one GPS or GPA message; the GPA of a receiver holds until its next."""
        instance = _number(message, "I")
        receiver = int(instance) if math.isfinite(instance) else 0
        if message.get_type() == "GPA":
            self._accuracy[receiver] = (_number(message, "HAcc"), _number(message, "VAcc"))
            self._undulation[receiver] = _number(message, "Und")
            return
        self.seen += 1
        where = f"GPS message {self.seen}"
        quality = _QUALITY.get(int(status)) if math.isfinite(status := _number(message, "Status")) else None
        if quality is None:
            self._remarks.count("GPS message without a 3-D fix", where)
            return
        if self._instance is None:
            self._instance = receiver
        if receiver != self._instance:
            self._remarks.count(f"GPS message of another receiver than {self._instance}", where)
            return
        fix = self._fix(message, receiver, quality)
        if fix is None:
            self._remarks.count("GPS message without a time", where)
        elif not plausible(fix):
            self._remarks.count("GPS message that is no place on Earth", where)
        else:
            self.fixes.append(fix)
            if len(self.fixes) % 10_000 == 0:
                check_count(self._path, self.fixes)

    def _fix(self, message: Any, receiver: int, quality: FixQuality) -> LogFix | None:
        week, of_week_s = _number(message, "GWk"), _number(message, "GMS") * 1e-3
        if not (0 < week <= _MAX_WEEK and 0.0 <= of_week_s < WEEK_S):
            return None
        horizontal, up = self._accuracy.get(receiver, (math.nan, math.nan))
        day = int(of_week_s // DAY_S)
        und = self._undulation.get(receiver, math.nan)
        # drivers of different receivers write Und with different signs, so that it is shown and not used
        hint = (
            f" that can be trusted (Und = {und:.2f} m, its sign depends on the receiver)" if math.isfinite(und) else ""
        )
        return LogFix(
            day=7 * int(week) + day,
            second=of_week_s - day * DAY_S,
            scale=TimeScale.GPS,
            lat_deg=_number(message, "Lat"),
            lon_deg=_number(message, "Lng"),
            height_m=self._heights.ellipsoid(_number(message, "Alt"), None, hint),
            quality=quality,
            sigma_enu_m=usable_sigma(horizontal / math.sqrt(2.0), horizontal / math.sqrt(2.0), up),
        )


def _number(message: Any, name: str) -> float:
    """Return a field as a number, NaN in here where the message does not have it."""
    value = getattr(message, name, math.nan)
    return float(value) if isinstance(value, int | float) else math.nan
