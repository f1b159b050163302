"""`groundstation live --simulate`: the whole of a station in operation, with a range that is not there."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.live.simulated_range import PictureTold
from groundstation.live.station_file import HeadDevice, StationDevices, StationFile
from groundstation.messages import StepReport, TrackEstimate
from groundstation.pointing import PointingConfig
from groundstation.rig import Rig
from groundstation.rig_toml import rig_to_toml
from groundstation.search_pattern import SearchConfig
from groundstation.simulation.approach import Flare, Glide
from groundstation.simulation.cases import standard_rig
from groundstation.simulation.trajectory import Trajectory

SPAN_M = 2.3
_GONE_M = np.array([0.0, 20_000.0, 500.0])
_PTU_SIGMA_RAD = math.radians(0.005)
_BINS_M = (60.0, 100.0, 250.0, 400.0, 600.0)


class Landings:
    """One landing after the other: 20 m/s down a 3.5° glide, flare, roll out, and gone until the next begins.

    Parameters
    ----------
    seconds : how long it goes on.
    """

    def __init__(self, seconds: float, pause_s: float = 4.0) -> None:
        slope = math.radians(3.5)
        flare = Flare.meeting(110.0, 60.0, slope)
        self._one: Trajectory = Glide(
            start_y_m=500.0, end_y_m=90.0, speed_m_s=20.0, slope_rad=slope, aim_y_m=60.0, flare=flare
        )
        self._flown_s = self._one.span_s[1]
        self._lap_s = self._flown_s + pause_s
        self.span_s = (0.0, seconds)

    def flying(self, t_s: float) -> bool:
        """Return whether there is an aircraft at a time."""
        return t_s >= 0.0 and t_s % self._lap_s < self._flown_s

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""
        t = np.asarray(t_s, dtype=np.float64)
        lap = t % self._lap_s
        here = (t >= 0.0) & (lap < self._flown_s)
        return np.where(here[:, None], self._one.position(np.minimum(lap, self._flown_s)), _GONE_M)

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        return self._one.velocity(np.minimum(np.asarray(t_s, dtype=np.float64) % self._lap_s, self._flown_s))


def simulated_set_up(folder: Path, rate_hz: float, rig: Rig | None) -> StationFile:
    """Write the rig file of a simulated set-up and return its station file; the PTUs' URLs are links in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = standard_rig(sigma_rad=_PTU_SIGMA_RAD) if rig is None else rig
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
    )


class EstimateKeeper:
    """A sink that keeps estimates that have a position, for the comparison with the truth."""

    def __init__(self) -> None:
        self.estimates: list[TrackEstimate] = []

    def write(self, report: StepReport) -> None:
        """Keep the estimates of one report."""
        self.estimates += [e for e in report.estimates if e.kinematics is not None]

    def close(self) -> None:
        """There is nothing to close."""


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
    estimates: Sequence[TrackEstimate],
    told: dict[str, list[PictureTold]],
    rig: Rig,
    host_begin_s: float,
) -> DayScore:
    """Compare with what truly was.

    Parameters
    ----------
    begin_s, host_begin_s : the flight's time zero, on the session's clock and on the host's.
    """
    rows = []
    known = [e for e in estimates if e.kinematics is not None and flight.flying(e.t_s - begin_s)]
    t_s = np.array([e.t_s for e in known]) - begin_s
    truth = flight.position(t_s) if len(known) else np.zeros((0, 3))
    errors, squares = np.zeros((len(known), 3)), np.zeros(len(known))
    for k, estimate in enumerate(known):
        if estimate.kinematics is not None:
            errors[k] = estimate.kinematics.position_runway_m - truth[k]
            squares[k] = errors[k] @ np.linalg.solve(estimate.kinematics.covariance[:3, :3], errors[k])
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
    central = [
        abs(p.u_px / w - 0.5) <= 0.25 and abs(p.v_px / h - 0.5) <= 0.25
        for name, pictures in told.items()
        for (w, h) in [rig[name].lens.image_size_px]
        for p in pictures
        if flight.flying(p.t_s - host_begin_s)
    ]
    return DayScore(rows=tuple(rows), central=float(np.mean(central)) if central else 0.0, pictures=len(central))


def format_score(found: DayScore) -> str:
    """Return it as a small table."""
    lines = [f"{'y [m]':>9s} {'answers':>8s} {'RMSE x/y/z [m]':>22s} {'ANEES':>6s}"]
    for row in found.rows:
        x, y, z = row.rmse_m
        lines.append(f"{row.from_m:4.0f}–{row.to_m:<4.0f} {row.count:8d} {x:8.3f}/{y:.3f}/{z:.3f} {row.anees:9.2f}")
    lines.append(f"nose in the central half of {100 * found.central:.1f} % of {found.pictures} pictures")
    return "\n".join(lines)
