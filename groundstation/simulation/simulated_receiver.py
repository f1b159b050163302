"""Simulated reference receiver: NMEA sentences of the aircraft on a pty, as a radio link delivers them."""

import contextlib
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef
from groundstation.session.folder import GeoOrigin
from groundstation.session.logs.gps_time import civil_from_unix, date_of
from groundstation.simulation.trajectory import Trajectory

SIMULATED_ORIGIN = GeoOrigin(lat_deg=47.1, lon_deg=8.6, height_m=480.0, y_axis_azimuth_deg=35.0)
SIMULATED_SEPARATION_M = 47.3
# beyond this distance no sentences are written
_FARTHEST_M = 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverModel:
    """A receiver: fixes a second, delay to the station's end of the line, one sigma level and up, its clock's error.

    ``gone_s`` are stretches of the flight's time in which nothing comes, ``stepped_s`` those in which its clock is
    ahead by so much more: from, to, by.
    """

    rate_hz: float = 5.0
    delivery_s: float = 0.08
    sigma_m: tuple[float, float, float] = (0.015, 0.015, 0.03)
    clock_offset_s: float = 0.0
    gone_s: tuple[tuple[float, float], ...] = ()
    stepped_s: tuple[tuple[float, float, float], ...] = ()


def sentences(utc_s: float, place_m: FloatArray, origin: GeoOrigin, sigma_m: tuple[float, float, float]) -> bytes:
    """Return RMC, GGA and GST of a place (3,) in the runway frame at a Unix time; sigmas east, north, up."""
    azimuth = np.radians(origin.y_axis_azimuth_deg)
    s, c = np.sin(azimuth), np.cos(azimuth)
    enu = place_m @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    ecef = ecef_from_enu(enu, (origin.lat_deg, origin.lon_deg, origin.height_m))
    lat, lon, height = (float(v) for v in geodetic_from_ecef(ecef))
    day, second = civil_from_unix(utc_s)
    hundredths = min(round(100 * second), 8_639_999)
    clock = f"{hundredths // 360_000:02d}{hundredths // 6000 % 60:02d}{hundredths % 6000 / 100:05.2f}"
    where = f"{_minutes(lat, 2)},{'N' if lat >= 0 else 'S'},{_minutes(lon, 3)},{'E' if lon >= 0 else 'W'}"
    date = date_of(day).strftime("%d%m%y")
    level = f"{height - SIMULATED_SEPARATION_M:.4f},M,{SIMULATED_SEPARATION_M:.1f},M"
    bodies = (
        f"GNRMC,{clock},A,{where},0.0,0.0,{date},,,R",
        f"GNGGA,{clock},{where},4,12,0.8,{level},1.0,0000",
        f"GNGST,{clock},0.0,,,,{sigma_m[1]:.4f},{sigma_m[0]:.4f},{sigma_m[2]:.4f}",
    )
    return b"".join(f"${b}*{reduce(lambda a, k: a ^ k, b.encode(), 0):02X}\r\n".encode() for b in bodies)


def _minutes(angle_deg: float, digits: int) -> str:
    """Return an angle as NMEA has it, degrees and minutes, to a tenth of a millimetre."""
    ten_millionths = round(abs(angle_deg) * 60e7)
    degrees, rest = divmod(ten_millionths, 60 * 10**7)
    return f"{degrees:0{digits}d}{rest // 10**7:02d}.{rest % 10**7:07d}"


class SimulatedReceiver:
    """Writes a flight's sentences to a pty until it is stopped.

    Parameters
    ----------
    link : where the pty is found.
    flight : the antenna, on the host's monotonic clock.
    since_s : returns the start time of the flight on that clock.
    """

    def __init__(
        self, link: Path, model: ReceiverModel, flight: Trajectory, since_s: Callable[[], float], seed: int
    ) -> None:
        self._link, self._model, self._flight, self._since_s = link, model, flight, since_s
        self._random = np.random.default_rng(seed)

    def run(self, stop: threading.Event) -> None:
        """Write sentences until stopped; without a reader they are lost."""
        master, slave = os.openpty()
        tty.setraw(slave)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(slave))
        number = 0
        first_s = time.monotonic()
        zero_utc_s = time.time() - time.monotonic()
        try:
            while not stop.is_set():
                # at whole hundredths, as its sentences have them
                t_s = first_s + number / self._model.rate_hz
                t_s += round(t_s + zero_utc_s, 2) - (t_s + zero_utc_s)
                number += 1
                if stop.wait(max(t_s + self._model.delivery_s - time.monotonic(), 0.0)):
                    return
                data = self._reported(t_s, t_s + zero_utc_s)
                if data and select.select([], [master], [], 0)[1]:
                    with contextlib.suppress(OSError):
                        os.write(master, data)
        finally:
            self._link.unlink(missing_ok=True)
            os.close(master)
            os.close(slave)

    def _reported(self, t_s: float, utc_s: float) -> bytes:
        since_s = t_s - self._since_s()
        if any(begin <= since_s < end for begin, end in self._model.gone_s):
            return b""
        place = self._flight.position(np.array([t_s]))[0]
        place = place + self._random.normal(size=3) * self._model.sigma_m
        if float(np.linalg.norm(place)) > _FARTHEST_M:
            return b""
        stepped_s = sum(by for begin, end, by in self._model.stepped_s if begin <= since_s < end)
        return sentences(utc_s + self._model.clock_offset_s + stepped_s, place, SIMULATED_ORIGIN, self._model.sigma_m)
