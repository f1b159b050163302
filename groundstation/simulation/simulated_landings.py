"""`groundstation live --simulate`: the whole of a station in operation, with a range that is not there."""

import itertools
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.live.head_device import HeadDevice
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.station_file import StationDevices, StationFile
from groundstation.messages import StepReport
from groundstation.pointing.pilot import PointingConfig
from groundstation.pointing.search_pattern import SearchConfig
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation.airframe import REST_HEIGHT_PER_SPAN
from groundstation.simulation.cases import standard_rig
from groundstation.simulation.flights import FlightModelKind, Shortened, in_wind
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.simulation.simulated_receiver import SIMULATED_ORIGIN
from groundstation.simulation.trajectory import Trajectory

SPAN_M = 2.3
_SPEED_M_S = 20.0
# a lap begins where the aircraft is small, and ends when heads that lost it search the sky again
_START_M, _END_M = 560.0, -500.0
_APPROACH_ENDS_M = 90.0
_GLIDE_RAD = math.radians(3.5)
_LEVEL_FROM_M, _LEVEL_M, _ROUNDED_M = 110.0, 5.0, 1.0
# so many laps differ in a wind, then they come again
_WINDY_LAPS = 8
_LAP_ENDS_S = 1e-6
_BINS_M = (90.0, 100.0, 250.0, 400.0, 600.0)


class Landings:
    """One approach after the other: 20 m/s down a 3.5° glide to 5 m above the runway, level, away over the stations.

    Each leaves the cameras' view as it came into it, in flight: nothing vanishes in front of them.

    Parameters
    ----------
    seconds : how long it goes on.
    laps : what is flown in place of that path, lap after lap and over again; times from the lap's start, s.
    """

    def __init__(self, seconds: float, laps: Sequence[Trajectory] = ()) -> None:
        self._lap_s = (_START_M - _END_M) / _SPEED_M_S
        self._laps = tuple(laps)
        self.span_s = (0.0, seconds)

    def approaching(self, t_s: FloatArray) -> MaskArray:
        """Return at which times (n,) an aircraft is on its way to the runway."""
        t = np.asarray(t_s, dtype=np.float64)
        return np.asarray((t >= 0.0) & (self._y(t) >= _APPROACH_ENDS_M))

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,); before time 0 it is far away."""
        t = np.asarray(t_s, dtype=np.float64)
        y = np.where(t >= 0.0, self._y(t), _START_M - _SPEED_M_S * t)
        there = np.column_stack([np.zeros_like(y), y, self._height(y)])
        for lap, flown in self._windy(t):
            there[lap] = flown.position(t[lap] % self._lap_s)
        return there

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        t, step = np.asarray(t_s, dtype=np.float64), 1e-3
        y = np.where(t >= 0.0, self._y(t), _START_M - _SPEED_M_S * t)
        sink = (self._height(y - step) - self._height(y + step)) / (2.0 * step) * _SPEED_M_S
        speeds = np.column_stack([np.zeros_like(y), np.full_like(y, -_SPEED_M_S), sink])
        for lap, flown in self._windy(t):
            speeds[lap] = flown.velocity(t[lap] % self._lap_s)
        return speeds

    def _windy(self, t_s: FloatArray) -> Iterator[tuple[MaskArray, Trajectory]]:
        """Yield which of the times (n,) are in each lap that has a path of its own."""
        numbers = np.where(t_s >= 0.0, t_s // self._lap_s, -1)
        for number, flown in enumerate(self._laps):
            yield (numbers >= 0) & (numbers % len(self._laps) == number), flown

    def _y(self, t_s: FloatArray) -> FloatArray:
        return np.asarray(_START_M - _SPEED_M_S * (t_s % self._lap_s))

    @staticmethod
    def _height(y_m: FloatArray) -> FloatArray:
        """Return the height: a glide path rounded off into level flight (softplus)."""
        above = math.tan(_GLIDE_RAD) * (y_m - _LEVEL_FROM_M)
        return np.asarray(_LEVEL_M + _ROUNDED_M * np.logaddexp(0.0, above / _ROUNDED_M))


def landings(seconds: float, *, seed: int, wind_m_s: float, aircraft: FlightModelKind) -> Landings:
    """Return the landings in a wind; no two of the first eight are alike.

    Raises `NoFlightModelError` where the aircraft is JSBSim's and JSBSim is not installed.
    """
    if aircraft is FlightModelKind.WAVES and wind_m_s == 0.0:
        return Landings(seconds)
    lap = Landings((_START_M - _END_M) / _SPEED_M_S)
    count = min(_WINDY_LAPS, math.ceil(seconds / lap.span_s[1]))
    rest_m = REST_HEIGHT_PER_SPAN * SPAN_M
    # a lap's last instant is the next one's first: it ends just before
    once = Shortened(whole=lap, duration_s=lap.span_s[1] - _LAP_ENDS_S)
    return Landings(
        seconds,
        [
            in_wind(once, rest_m, seed=seed * _WINDY_LAPS + number + 1, wind_m_s=wind_m_s, aircraft=aircraft)
            for number in range(count)
        ],
    )


def simulated_set_up(folder: Path, rate_hz: float, rig: Rig | None, *, dgps: bool = False) -> StationFile:
    """Write the rig file of a simulated set-up and return its station file; the devices' URLs are links in ``folder``.

    ``dgps`` adds a reference receiver on the aircraft's nose.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # the simulated units have the steps of their encoders, and no other error
    rig = standard_rig() if rig is None else rig
    path = folder / "rig.toml"
    path.write_text(rig_to_toml(rig), encoding="utf-8")
    return StationFile(
        path=folder / "station.toml",
        name="simulated range",
        rig=path,
        config=None,
        rate_hz=rate_hz,
        span_m=SPAN_M,
        record=folder,
        pointing=PointingConfig(),
        search=SearchConfig(),
        stations=tuple(
            StationDevices(
                name=s.name,
                camera="simulated",
                camera_settings={},
                head=None if s.fixed else HeadDevice(url=str(folder / f"ptu-{s.name}"), baud=115200),
            )
            for s in rig.stations
        ),
        reference=ReferenceDevice(url=str(folder / "dgps")) if dgps else None,
        origin=SIMULATED_ORIGIN if dgps else None,
        antenna_in_body_m=(0.0, 0.0, 0.0) if dgps else None,
        # rendered cameras have no lens that the Sun could harm, and the simulated day has no hour
        sun_angle_rad=0.0,
    )


class EstimateKeeper:
    """A sink that keeps time, position and its covariance of each estimate, in flat memory."""

    def __init__(self) -> None:
        self._rows = array("d")

    def write(self, report: StepReport) -> None:
        """Keep the estimates of one report."""
        for estimate in report.estimates:
            if estimate.kinematics is not None:
                self._rows.append(estimate.t_s)
                self._rows.extend(estimate.kinematics.position_runway_m)
                self._rows.extend(estimate.kinematics.covariance[:3, :3].ravel())

    def close(self) -> None:
        """There is nothing to close."""

    def rows(self) -> FloatArray:
        """Return t, x, y, z and the nine covariances of all estimates, (n, 13)."""
        return np.array(self._rows).reshape(-1, 13)


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeRow:
    """Errors of one bin of range: RMSE (3,) in m, ANEES, and of how many answers."""

    from_m: float
    to_m: float
    count: int
    rmse_m: tuple[float, float, float]
    anees: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DayScore:
    """How a simulated day went: errors by range, and the share of pictures with the nose in their central half."""

    rows: tuple[RangeRow, ...]
    central: float
    pictures: int


def score(
    flight: Landings,
    begin_s: float,
    estimates: FloatArray,
    told: Mapping[str, NoseTruth],
    rig: Rig,
    host_begin_s: float,
) -> DayScore:
    """Compare with what truly was.

    Parameters
    ----------
    begin_s, host_begin_s : the flight's time zero, on the session's clock and on the host's.
    estimates : (n, 13) as `EstimateKeeper` keeps them.
    """
    known = estimates[flight.approaching(estimates[:, 0] - begin_s)]
    truth = flight.position(known[:, 0] - begin_s)
    errors = known[:, 1:4] - truth
    covariances = known[:, 4:].reshape(-1, 3, 3)
    squares = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
    rows = []
    for low, high in itertools.pairwise(_BINS_M):
        inside = (truth[:, 1] >= low) & (truth[:, 1] < high)
        if inside.any():
            x, y, z = (float(v) for v in np.sqrt((errors[inside] ** 2).mean(axis=0)))
            row = RangeRow(
                from_m=low,
                to_m=high,
                count=int(inside.sum()),
                rmse_m=(x, y, z),
                anees=float(squares[inside].mean() / 3.0),
            )
            rows.append(row)
    central = []
    for name, pictures in told.items():
        seen = pictures.rows()
        seen = seen[flight.approaching(seen[:, 0] - host_begin_s)]
        size = np.array(rig[name].lens.image_size_px)
        central.append(np.all(np.abs(seen[:, 1:] / size - 0.5) <= 0.25, axis=1))
    looked = np.concatenate(central) if central else np.zeros(0, np.bool_)
    share = float(looked.mean()) if looked.size else 0.0
    return DayScore(rows=tuple(rows), central=share, pictures=int(looked.size))


def format_score(found: DayScore) -> str:
    """Return it as a small table."""
    lines = [f"{'y [m]':>9s} {'answers':>8s} {'RMSE x/y/z [m]':>22s} {'ANEES':>6s}"]
    for row in found.rows:
        x, y, z = row.rmse_m
        lines.append(f"{row.from_m:4.0f}–{row.to_m:<4.0f} {row.count:8d} {x:8.3f}/{y:.3f}/{z:.3f} {row.anees:9.2f}")
    lines.append(
        f"nose in the central half of {100 * found.central:.1f} % of {found.pictures} pictures of the approach"
    )
    return "\n".join(lines)
