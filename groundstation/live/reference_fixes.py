"""Conversion of a receiver's positions for the filter: runway frame, point of the nose, session time."""

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import LogError
from groundstation.messages import DgpsFix, ReferenceFix
from groundstation.session.folder import GeoOrigin
from groundstation.session.logs.fixes import DEFAULT_SIGMA_M, LogFix
from groundstation.session.logs.gps_time import gps_from_civil
from groundstation.session.logs.placement import place_log
from groundstation.session.logs.read import GnssLog

# a radio link takes its time; what seems older, or is of the future, has another clock
_OLDEST_S, _EARLIEST_S = 2.0, -0.5
_AGREEING = 5
# a stamp that goes back shows that the clock was set back, unless the positions overtook each other by this much
_OVERTAKING_S = 0.3
_USUAL_DELIVERY_S = 0.1
# the direction of flight is that of so long, and not known of what hardly moves
_HEADING_S, _MIN_HEADING_SPEED_M_S = 0.5, 2.0


class Refusal(StrEnum):
    """Why a position is not used."""

    FAR = "far from the origin"
    CLOCK = "stamped by another clock"
    REPEATED = "repeated"
    BACKWARDS = "not newer than the last"
    NO_HEADING = "without a direction of flight yet"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvertedFix:
    """A position of the antenna as the table keeps it, and of the nose as the filter takes it, or why it does not."""

    antenna: DgpsFix | None
    nose: ReferenceFix | None
    refusal: Refusal | None


class ReferenceClock:
    """A receiver's UTC as session time.

    Parameters
    ----------
    gps_zero_s : the session's time zero as GPS time, by this machine's clock.
    offset_s : how far the receiver's clock is ahead of this machine's. None supposes that both are right, until its
        positions agree that they are not; then the offset is taken from when they come.

    A link that gets slow makes positions old, and they are used as such; but no link makes stamps go back. After one
    that does the clock counts as set back, until the stamps are again as far ahead of the arrivals as they were.
    """

    def __init__(self, gps_zero_s: float, offset_s: float | None) -> None:
        self._first_offset_s = self.offset_s = 0.0 if offset_s is None else offset_s
        self._gps_zero_s = gps_zero_s
        self._given = offset_s is not None
        self._strange: deque[float] = deque(maxlen=_AGREEING)
        self._last_raw_s = self._last_ahead_s = -math.inf
        # how far stamps were ahead of arrivals before one went back
        self._set_back_from_s: float | None = None
        self.adopted = 0

    def session_s(self, fix: LogFix, arrived_s: float) -> float | None:
        """Return when a position was true, session time, that came at ``arrived_s``; None if that cannot be."""
        raw_s = gps_from_civil(fix.day, fix.second, fix.scale) - self._gps_zero_s
        ahead_s = raw_s - arrived_s
        set_back = self._is_set_back(raw_s, ahead_s)
        self._last_raw_s, self._last_ahead_s = raw_s, ahead_s
        if not set_back and _EARLIEST_S <= self.offset_s - ahead_s <= _OLDEST_S:
            self._strange.clear()
            return raw_s - self.offset_s
        self._strange.append(ahead_s)
        agree = len(self._strange) == _AGREEING and max(self._strange) - min(self._strange) < _OLDEST_S
        if self._given or not agree:
            return None
        self._adopt(max(self._strange) + _USUAL_DELIVERY_S)
        return raw_s - self.offset_s

    def _is_set_back(self, raw_s: float, ahead_s: float) -> bool:
        """Return whether the stamps have gone back, and are not where they were."""
        if self._set_back_from_s is None and raw_s < self._last_raw_s:
            self._set_back_from_s = self._last_ahead_s
            self._strange.clear()
        if self._set_back_from_s is not None and ahead_s > self._set_back_from_s - _OVERTAKING_S:
            self._set_back_from_s = None
        return self._set_back_from_s is not None

    def _adopt(self, offset_s: float) -> None:
        """Take another offset, exactly the first one where the clock has come back to it."""
        came_back = abs(offset_s - self._first_offset_s) < _OVERTAKING_S
        self.offset_s = self._first_offset_s if came_back else offset_s
        self.adopted += 1
        self._strange.clear()
        self._set_back_from_s = None


class ReferenceConverter:
    """Converts positions of a receiver to the runway frame and to session time, one after the other.

    Parameters
    ----------
    origin : of the runway frame.
    clock : of the receiver.
    antenna_in_body_m : (3,) from the nose: forward, right, down; None takes the position for the nose's.
    later_s : delay of the receiver's clock as stated by the rig, in addition.
    """

    def __init__(
        self, origin: GeoOrigin, clock: ReferenceClock, antenna_in_body_m: FloatArray | None, later_s: float = 0.0
    ) -> None:
        self.clock = clock
        self._origin = (origin.lat_deg, origin.lon_deg, origin.height_m)
        self._azimuth_deg = origin.y_axis_azimuth_deg
        self._antenna = None if antenna_in_body_m is None or not np.any(antenna_in_body_m) else antenna_in_body_m
        self._later_s = later_s
        self._newest_s = -math.inf
        self._last_m: FloatArray | None = None
        self._track: deque[tuple[float, FloatArray]] = deque()

    def convert(self, fix: LogFix, arrived_s: float) -> ConvertedFix:
        """Return a position that came at session time ``arrived_s``, converted, or the reason why it is not used."""
        t_s = self.clock.session_s(fix, arrived_s)
        if t_s is None:
            return _refused(Refusal.CLOCK)
        try:
            antenna = place_log(_log_of(fix), self._origin, self._azimuth_deg, 0.0)[0]
        except LogError:
            return _refused(Refusal.FAR)
        antenna = DgpsFix(
            t_s=t_s, position_runway_m=antenna.position_runway_m, sigma_m=antenna.sigma_m, status=antenna.status
        )
        if t_s <= self._newest_s:
            return _refused(Refusal.BACKWARDS)
        self._newest_s = t_s
        place_m = antenna.position_runway_m
        repeated = self._last_m is not None and bool(np.all(place_m == self._last_m))
        self._last_m = place_m
        if repeated:
            return ConvertedFix(antenna=antenna, nose=None, refusal=Refusal.REPEATED)
        nose_m = self._nose(t_s, place_m)
        if nose_m is None:
            return ConvertedFix(antenna=antenna, nose=None, refusal=Refusal.NO_HEADING)
        sigma_m = np.asarray(antenna.sigma_m, dtype=np.float64)
        nose = ReferenceFix(t_s=t_s - self._later_s, position_runway_m=nose_m, sigma_m=sigma_m)
        return ConvertedFix(antenna=antenna, nose=nose, refusal=None)

    def _nose(self, t_s: float, place_m: FloatArray) -> FloatArray | None:
        """Return nose = antenna − R_runway_from_body · antenna_in_body, forward along the last half second's track."""
        if self._antenna is None:
            return place_m
        self._track.append((t_s, place_m))
        while len(self._track) > 2 and self._track[1][0] <= t_s - _HEADING_S:
            self._track.popleft()
        before_s, before_m = self._track[0]
        took_s = t_s - before_s
        way_m = place_m - before_m
        length_m = float(np.linalg.norm(way_m))
        if took_s <= 0.0 or length_m < _MIN_HEADING_SPEED_M_S * took_s or took_s > 4.0 * _HEADING_S:
            return None
        forward = way_m / length_m
        right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
        across = float(np.linalg.norm(right))
        if across < 1e-6:
            return None
        right /= across
        axes = np.column_stack([forward, right, np.cross(forward, right)])
        return np.asarray(place_m - axes @ self._antenna)


def _refused(why: Refusal) -> ConvertedFix:
    return ConvertedFix(antenna=None, nose=None, refusal=why)


def _log_of(fix: LogFix) -> GnssLog:
    """Return one position as a log of one."""
    return GnssLog(
        name="DGPS",
        gps_s=np.zeros(1),
        lat_deg=np.array([fix.lat_deg]),
        lon_deg=np.array([fix.lon_deg]),
        height_m=np.array([fix.height_m]),
        sigma_enu_m=np.array([fix.sigma_enu_m or DEFAULT_SIGMA_M[fix.quality]]),
        covariance_en_m2=np.array([fix.covariance_en_m2]),
        quality=(fix.quality,),
        remarks=(),
    )
