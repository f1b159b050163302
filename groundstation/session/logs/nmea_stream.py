"""NMEA from a line: the log's reader (`groundstation.session.logs.nmea`), one position at a time."""

from dataclasses import replace
from pathlib import Path

from groundstation.session.logs.fixes import Heights, LogFix, LogOptions, ReadingNotes
from groundstation.session.logs.gps_time import DAY_S, civil_from_unix, date_of
from groundstation.session.logs.nmea import GgaFix, NmeaSentences, ParsedSentences, dated

# a sentence has 82 characters by its standard, and some receivers' twice that
_LONGEST_LINE = 1024
_MOST_SIGMAS = 2


class NmeaStream:
    """Bytes in, positions out.

    A position is complete once its sigmas (GST of the same second) or the next position have arrived, or once
    the line is quiet (`quiet`), whichever is first.

    Parameters
    ----------
    name : of the line, for errors.
    options : information that the receiver lacks; the date is the receiver's own, otherwise that of the host.
    """

    def __init__(self, name: str, options: LogOptions) -> None:
        self.remarks = ReadingNotes(name)
        self._name, self._options = name, options
        self._sentences = NmeaSentences(Heights(Path(name), options), self.remarks)
        self._rest = b""

    def feed(self, data: bytes, utc_s: float) -> list[LogFix]:
        """Return the positions that are complete now; ``utc_s`` is Unix time, good to some hours.

        Raises `LogError` for heights above sea level without a geoid separation; the position is then
        lost, and the next call continues.
        """
        *lines, self._rest = (self._rest + data).split(b"\n")
        # what never ends is no sentence
        self._rest = self._rest[-_LONGEST_LINE:]
        found = self._sentences.found
        fixes: list[LogFix] = []
        for line in lines:
            waiting = len(found.fixes)
            self._sentences.take(line[-_LONGEST_LINE:].decode("ascii", "replace").rstrip("\r"), "")
            if len(found.fixes) > max(waiting, 1):
                fixes += self._complete(utc_s, found.fixes[:-1])
            if found.fixes and any(second == found.fixes[-1].second for _, second in found.sigmas):
                fixes += self._complete(utc_s, list(found.fixes))
        self._forget(found)
        return fixes

    def quiet(self, utc_s: float) -> list[LogFix]:
        """Return the position that waits for its sigmas, when no more data of its second are expected."""
        return self._complete(utc_s, list(self._sentences.found.fixes))

    def _complete(self, utc_s: float, fixes: list[GgaFix]) -> list[LogFix]:
        found = self._sentences.found
        if not fixes:
            return []
        day, second = civil_from_unix(utc_s)
        # the date of the host, moved where midnight is between the two clocks
        day += round((second - fixes[0].second) / DAY_S)
        date = self._options.date or date_of(day)
        part = ParsedSentences(fixes=fixes, dates=found.dates, zda_dates=found.zda_dates, sigmas=found.sigmas)
        done = dated(self._name, part, replace(self._options, date=date), ReadingNotes(self._name))
        found.fixes = found.fixes[len(fixes) :]
        self._forget(found)
        return done

    @staticmethod
    def _forget(found: ParsedSentences) -> None:
        """Keep the newest dates and sigmas only, because a line may run for a day."""
        if len(found.dates) > 1 or len(found.zda_dates) > 1:
            found.dates, found.zda_dates = found.dates[-1:], found.zda_dates[-1:]
            for fix in found.fixes:
                fix.dates_before = (len(found.dates), len(found.zda_dates))
        while len(found.sigmas) > _MOST_SIGMAS:
            found.sigmas.pop(next(iter(found.sigmas)))
