"""Fusion of PTU readings, with a distinction between jerks of the PTU and outliers of the encoder.

A reading far from its prediction is not fused at once: it only inflates the covariance of the angles. If the next
reading confirms it (at a rate that the PTU can reach), the axis is re-initialised from the two; if not, the first one
was a spike and is dropped.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.encoder_offset import NO_OFFSET, EncoderOffset
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.variance_check import sigma_of
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.head_rates import HeadRates
from groundstation.messages import PtuSample
from groundstation.rig.rig import Station

# with noise of half a step or more, this many equal readings of both axes exclude chance (< 1e-6)
_FROZEN_READINGS = 15


class _Known(NamedTuple):
    """State of one station's readings; immutable, since snapshots of the late buffer refer to it.

    ``newest_s`` is the time of the newest accepted reading, ``last`` the newest of all and ``same`` the number of equal
    readings before it; ``suspect`` is a reading not yet confirmed; a ``frozen`` encoder repeats one value.
    They are judged and fused without the ``offset`` that pictures have found; ``last`` is as it was read.
    """

    newest_s: float = -math.inf
    last: PtuSample | None = None
    same: int = 0
    suspect: PtuSample | None = None
    frozen: bool = False
    offset: EncoderOffset = NO_OFFSET


_NOTHING = _Known()


class EncoderState(NamedTuple):
    """Snapshot of the feed."""

    spikes: int
    repeats: int
    known: Mapping[str, _Known]


class EncoderFeed:
    """Fuses the readings of all turning stations into the filter; counts rejected ones, and those that repeat."""

    def __init__(self, ekf: StationEkf, stations: Mapping[str, Station], config: EstimationConfig) -> None:
        self.spikes = 0
        self.repeats = 0
        self._ekf = ekf
        self._stations = stations
        self._sigmas_rad = {name: station.angle_sigma_rad for name, station in stations.items()}
        self._max_rate = math.radians(config.ptu_max_rate_deg_s)
        # replaced, never written to: snapshots hold it
        self._known: Mapping[str, _Known] = {}
        self._axis_restarted = False

    def read(self, sample: PtuSample) -> str | None:
        """Fuse one reading, at or after the filter time; return a log line for irregular readings."""
        station = self._stations.get(sample.station)
        if station is None or station.fixed:
            return None
        if sample.sigma_rad is not None:
            # a picture's: of the exposure itself, whatever the clocks; one that the gate refuses is left out. Its rows
            # are exposed before or after the stamp, at which the filter is
            angles = (sample.pan_rad, sample.tilt_rad)
            delay_s = 0.0 if self._ekf.time_s is None else sample.t_s - self._ekf.time_s
            self._ekf.update_encoder(sample.station, angles, sample.sigma_rad, 0.0, delay_s)
            known = self._known.get(sample.station, _NOTHING)
            known = known._replace(offset=EncoderOffset(sample.encoder_off_rad, angles))
            self._known = {**self._known, sample.station: known}
            return None
        before = self._known.get(sample.station, _NOTHING)
        note, known = self._watch_for_standstill(sample, station, before)
        if note is None and not known.frozen:
            note, known = self._judge(known.offset.corrected(sample), station, known)
        self._known = {**self._known, sample.station: known}
        return note

    def _judge(self, sample: PtuSample, station: Station, known: _Known) -> tuple[str | None, _Known]:
        """Fuse a reading after resolving a suspect one before it."""
        note = None
        now_s = self._ekf.time_s
        ahead = 0.0 if now_s is None else max(sample.t_s - now_s, 0.0)
        if known.suspect is not None:
            note = self._settle(known.suspect, sample, ahead)
            known = known._replace(suspect=None)
            if self._axis_restarted:
                # the axis was re-initialised with this reading, which must not be fused twice
                return note, known._replace(newest_s=sample.t_s)
        innovation = self._ekf.update_encoder(
            sample.station,
            (sample.pan_rad, sample.tilt_rad),
            self._sigmas_rad[sample.station],
            station.ptu_clock.sigma_s,
            ahead,
        )
        if innovation.accepted:
            return note, known._replace(newest_s=sample.t_s, suspect=None)
        return note, known._replace(suspect=sample)

    def counts(self) -> dict[str, int]:
        """Return how many readings were rejected as spikes, and how many since they only repeat."""
        return {"ptu_spikes": self.spikes, "ptu_repeats": self.repeats}

    def snapshot(self) -> EncoderState:
        """Return the state of the feed, which belongs to the filter state of the same time."""
        return EncoderState(self.spikes, self.repeats, self._known)

    def restore(self, saved: EncoderState) -> None:
        """Restore a `snapshot`."""
        self.spikes, self.repeats, self._known = saved

    def is_doubtful(self, station: str) -> bool:
        """Return whether the newest reading is suspect: either a jerk or a spike."""
        return self._known.get(station, _NOTHING).suspect is not None

    def is_frozen(self, station: str) -> bool:
        """Return whether a noisy encoder repeats one value, so that its angles are not used."""
        return self._known.get(station, _NOTHING).frozen

    def _watch_for_standstill(self, sample: PtuSample, station: Station, known: _Known) -> tuple[str | None, _Known]:
        """Detect a noisy encoder that repeats one value exactly.

        Noiseless encoders at rest do so in normal operation and are not tested.
        """
        last = known.last
        repeats = last is not None and last.pan_rad == sample.pan_rad and last.tilt_rad == sample.tilt_rad
        same = known.same + 1 if repeats else 0
        frozen = same >= _FROZEN_READINGS and station.ptu_sigma_rad > 0.5 * station.ptu_resolution_rad
        newest_s, note = known.newest_s, None
        self.repeats += frozen
        if frozen and not known.frozen:
            note = f"station {sample.station}: PTU repeats one reading since {_FROZEN_READINGS} readings, not used"
        elif known.frozen and not frozen:
            sigma = self._sigmas_rad[sample.station]
            own = known.offset.corrected(sample)
            self._ekf.set_angles(sample.station, (own.pan_rad, own.tilt_rad), (0.0, 0.0), sigma)
            newest_s = sample.t_s
            note = f"station {sample.station}: PTU readings change again at {sample.t_s:.3f} s"
        return note, _Known(newest_s, sample, same, known.suspect, frozen, known.offset)

    def age_s(self, station: str, t_s: float) -> float:
        """Return the age of the last accepted reading."""
        return t_s - self._known.get(station, _NOTHING).newest_s

    def noise_rad(self, station: str) -> float:
        """Return one sigma of one reading of an angle."""
        return self._sigmas_rad[station]

    def sigma_rad(self, station: str) -> float:
        """Return one sigma of the filter's own angle, the larger of pan and tilt."""
        pan, P = self._ekf.layout.angles[station].start, self._ekf.covariance
        return sigma_of(max(P[pan, pan], P[pan + 1, pan + 1]), f"angles of {station}")

    def rates(self, station: str) -> HeadRates:
        """Return the filter's rates of a head at the filter time; zero of a fixed station."""
        if station not in self._ekf.layout.rates:
            return HeadRates(0.0, 0.0, 0.0)
        where, angles, P = self._ekf.layout.rates[station], self._ekf.layout.angles[station], self._ekf.covariance
        pan_rate, tilt_rate = self._ekf.state[where].tolist()
        variance = max(P[where.start, where.start], P[where.start + 1, where.start + 1])
        pan, tilt = P[angles, where].diagonal().tolist()
        return HeadRates(pan_rate, tilt_rate, sigma_of(variance, f"rates of {station}"), (pan, tilt))

    def _off(self, sample: PtuSample, ahead_s: float) -> float:
        """Return the distance of a reading from its prediction, ``ahead_s`` after the filter time."""
        # includes the rate: a PTU at 45°/s turns by half a degree between two readings
        pan_rate, tilt_rate = self._ekf.state[self._ekf.layout.rates[sample.station]]
        pan, tilt = self._ekf.angles(sample.station)
        pan_off = wrap_rad(sample.pan_rad - pan - ahead_s * pan_rate)
        tilt_off = wrap_rad(sample.tilt_rad - tilt - ahead_s * tilt_rate)
        return float(max(abs(pan_off), abs(tilt_off)))

    def _settle(self, suspect: PtuSample, sample: PtuSample, ahead_s: float) -> str | None:
        """Resolve a suspect reading with the next one, ``ahead_s`` after the filter time."""
        self._axis_restarted = False
        dt = sample.t_s - suspect.t_s
        if dt <= 0.0:
            return None
        pan_rate = wrap_rad(sample.pan_rad - suspect.pan_rad) / dt
        tilt_rate = wrap_rad(sample.tilt_rad - suspect.tilt_rad) / dt
        sigma = self._sigmas_rad[sample.station]
        off, back = self._off(sample, ahead_s), self._off(suspect, ahead_s - dt)
        moved = off > 0.5 * back and max(abs(pan_rate), abs(tilt_rate)) <= self._max_rate
        where = f"station {sample.station}: PTU reading at {suspect.t_s:.3f} s"
        self._axis_restarted = moved
        if moved:
            now = (sample.pan_rad - ahead_s * pan_rate, sample.tilt_rad - ahead_s * tilt_rate)
            self._ekf.set_angles(sample.station, now, (pan_rate, tilt_rate), sigma)
            return f"{where}: a jerk of {math.degrees(back):.3f}°, confirmed by the next reading"
        self.spikes += 1
        return f"{where}: dropped, {math.degrees(back):.3f}° off and not confirmed"
