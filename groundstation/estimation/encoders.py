"""Feeding PTU readings to the filter, and telling a jerk of the PTU from a wrong reading.

A reading far from its prediction is held back: the filter's angles only get less certain. If the next
reading bears it out (no faster than the PTU can turn), the axis is started anew from the two; if not, the
first was a spike and is dropped.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.ekf import StationEkf
from groundstation.geometry.angles import wrap_rad
from groundstation.messages import PtuSample
from groundstation.rig import Station

# with noise of half a step or more, so many equal readings of both axes do not happen by chance (< 1e-6)
_FROZEN_READINGS = 15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncoderState:
    """Everything that the feed remembers of the readings so far, to go back to."""

    spikes: int
    suspect: Mapping[str, PtuSample]
    newest: Mapping[str, float]
    last: Mapping[str, PtuSample]
    same: Mapping[str, int]
    frozen: frozenset[str]


class EncoderFeed:
    """The readings of all turning stations on their way into one filter; counts what it refuses."""

    def __init__(self, ekf: StationEkf, stations: Mapping[str, Station], config: EstimationConfig) -> None:
        self.spikes = 0
        self._ekf = ekf
        self._stations = stations
        self._sigmas_rad = {name: station.angle_sigma_rad for name, station in stations.items()}
        self._max_rate = math.radians(config.ptu_max_rate_deg_s)
        self._suspect: dict[str, PtuSample] = {}
        self._newest: dict[str, float] = {}
        self._began_anew = False
        self._last: dict[str, PtuSample] = {}
        self._same: dict[str, int] = {}
        self._frozen: set[str] = set()

    def read(self, sample: PtuSample) -> str | None:
        """Fuse one reading, at or after the filter's time; return a line for the log if something was odd."""
        station = self._stations.get(sample.station)
        if station is None or station.fixed:
            return None
        note = self._watch_for_standstill(sample, station)
        if note is not None or sample.station in self._frozen:
            return note
        ahead = sample.t_s - (self._ekf.time_s if self._ekf.time_s is not None else sample.t_s)
        suspect = self._suspect.pop(sample.station, None)
        if suspect is not None:
            note = self._settle(suspect, sample, max(ahead, 0.0))
            if self._began_anew:
                # the axis stands on this very reading now: it must not count twice
                self._newest[sample.station] = sample.t_s
                return note
        innovation = self._ekf.update_encoder(
            sample.station,
            (sample.pan_rad, sample.tilt_rad),
            self._sigmas_rad[sample.station],
            station.ptu_clock.sigma_s,
            max(ahead, 0.0),
        )
        if innovation.accepted:
            self._newest[sample.station] = sample.t_s
        else:
            self._suspect[sample.station] = sample
        return note

    def snapshot(self) -> EncoderState:
        """Return all that is remembered of the readings: it belongs to the filter's time as its state does."""
        return EncoderState(
            spikes=self.spikes,
            suspect=dict(self._suspect),
            newest=dict(self._newest),
            last=dict(self._last),
            same=dict(self._same),
            frozen=frozenset(self._frozen),
        )

    def restore(self, saved: EncoderState) -> None:
        """Remember again what was remembered at a `snapshot`."""
        self.spikes = saved.spikes
        self._suspect, self._newest = dict(saved.suspect), dict(saved.newest)
        self._last, self._same, self._frozen = dict(saved.last), dict(saved.same), set(saved.frozen)

    def is_doubtful(self, station: str) -> bool:
        """Return whether the newest reading is held back, not yet known to be a jerk or a spike."""
        return station in self._suspect

    def is_frozen(self, station: str) -> bool:
        """Return whether a noisy encoder has been repeating one value: its angles are not to be used."""
        return station in self._frozen

    def _watch_for_standstill(self, sample: PtuSample, station: Station) -> str | None:
        """Notice an encoder that repeats itself to the last digit although its readings are noisy.

        A noiseless encoder at rest does that rightly, so it is left alone.
        """
        last = self._last.get(sample.station)
        self._last[sample.station] = sample
        same = last is not None and (last.pan_rad, last.tilt_rad) == (sample.pan_rad, sample.tilt_rad)
        self._same[sample.station] = self._same.get(sample.station, 0) + 1 if same else 0
        noisy = station.ptu_sigma_rad > 0.5 * station.ptu_resolution_rad
        if noisy and self._same[sample.station] >= _FROZEN_READINGS:
            if sample.station not in self._frozen:
                self._frozen.add(sample.station)
                return f"station {sample.station}: PTU repeats one reading since {_FROZEN_READINGS} readings, not used"
        elif sample.station in self._frozen:
            self._frozen.discard(sample.station)
            sigma = self._sigmas_rad[sample.station]
            self._ekf.set_angles(sample.station, (sample.pan_rad, sample.tilt_rad), (0.0, 0.0), sigma)
            self._newest[sample.station] = sample.t_s
            return f"station {sample.station}: PTU readings change again at {sample.t_s:.3f} s"
        return None

    def age_s(self, station: str, t_s: float) -> float:
        """Return how long ago the last believed reading was."""
        return t_s - self._newest.get(station, -math.inf)

    def noise_rad(self, station: str) -> float:
        """Return one sigma of one reading of an angle."""
        return self._sigmas_rad[station]

    def sigma_rad(self, station: str) -> float:
        """Return one sigma of the filter's own angle, the larger of pan and tilt."""
        pan, P = self._ekf.layout.angles[station].start, self._ekf.covariance
        return math.sqrt(max(P[pan, pan], P[pan + 1, pan + 1]))

    def _off(self, sample: PtuSample, ahead_s: float) -> float:
        """Return how far a reading is from where the head was expected at its time, ``ahead_s`` after the filter's."""
        # a head that turns at 45°/s is elsewhere by half a degree from one reading to the next
        pan_rate, tilt_rate = self._ekf.state[self._ekf.layout.rates[sample.station]]
        pan, tilt = self._ekf.angles(sample.station)
        pan_off = wrap_rad(sample.pan_rad - pan - ahead_s * pan_rate)
        tilt_off = wrap_rad(sample.tilt_rad - tilt - ahead_s * tilt_rate)
        return float(max(abs(pan_off), abs(tilt_off)))

    def _settle(self, suspect: PtuSample, sample: PtuSample, ahead_s: float) -> str | None:
        """Decide what the reading before was, now that another is here, ``ahead_s`` after the filter's time."""
        self._began_anew = False
        dt = sample.t_s - suspect.t_s
        if dt <= 0.0:
            return None
        pan_rate = wrap_rad(sample.pan_rad - suspect.pan_rad) / dt
        tilt_rate = wrap_rad(sample.tilt_rad - suspect.tilt_rad) / dt
        sigma = self._sigmas_rad[sample.station]
        off, back = self._off(sample, ahead_s), self._off(suspect, ahead_s - dt)
        moved = off > 0.5 * back and max(abs(pan_rate), abs(tilt_rate)) <= self._max_rate
        where = f"station {sample.station}: PTU reading at {suspect.t_s:.3f} s"
        self._began_anew = moved
        if moved:
            now = (sample.pan_rad - ahead_s * pan_rate, sample.tilt_rad - ahead_s * tilt_rate)
            self._ekf.set_angles(sample.station, now, (pan_rate, tilt_rate), sigma)
            return f"{where}: a jerk of {math.degrees(back):.3f}°, confirmed by the next reading"
        self.spikes += 1
        return f"{where}: dropped, {math.degrees(back):.3f}° off and not confirmed"
