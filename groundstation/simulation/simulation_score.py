"""Score of a simulated station: errors of its estimates by range, and how well its heads kept the nose in view."""

import itertools
from array import array
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import StepReport
from groundstation.rig.rig import Rig
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.simulation.repeated_landings import RepeatedLandings

_BINS_M = (90.0, 100.0, 250.0, 400.0, 600.0)


class EstimateRecorder:
    """A sink that records time, position and position covariance of each estimate, in flat memory."""

    def __init__(self) -> None:
        self._rows = array("d")

    def write(self, report: StepReport) -> None:
        """Record the estimates of one report."""
        for estimate in report.estimates:
            if estimate.kinematics is not None:
                self._rows.append(estimate.t_s)
                self._rows.extend(estimate.kinematics.position_runway_m)
                self._rows.extend(estimate.kinematics.covariance[:3, :3].ravel())

    def close(self) -> None:
        """Do nothing; the rows stay readable."""

    def rows(self) -> FloatArray:
        """Return t, x, y, z and the nine covariances of all estimates, (n, 13)."""
        return np.array(self._rows).reshape(-1, 13)


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeBinErrors:
    """Errors of one range bin: RMSE (3,) in m, ANEES, and the number of estimates."""

    from_m: float
    to_m: float
    count: int
    rmse_m: tuple[float, float, float]
    anees: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationScore:
    """Errors by range, and the share of pictures with the nose in their central half."""

    rows: tuple[RangeBinErrors, ...]
    central: float
    pictures: int


def score(
    flight: RepeatedLandings,
    begin_s: float,
    estimates: FloatArray,
    nose_truths: Mapping[str, NoseTruth],
    rig: Rig,
    host_begin_s: float,
) -> SimulationScore:
    """Compare the estimates and the pointing with the truth.

    Parameters
    ----------
    begin_s, host_begin_s : the flight's time zero, on the session's clock and on the host's.
    estimates : (n, 13) as returned by `EstimateRecorder.rows`.
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
            row = RangeBinErrors(
                from_m=low,
                to_m=high,
                count=int(inside.sum()),
                rmse_m=(x, y, z),
                anees=float(squares[inside].mean() / 3.0),
            )
            rows.append(row)
    central = []
    for name, pictures in nose_truths.items():
        seen = pictures.rows()
        seen = seen[flight.approaching(seen[:, 0] - host_begin_s)]
        size = np.array(rig[name].lens.image_size_px)
        central.append(np.all(np.abs(seen[:, 1:] / size - 0.5) <= 0.25, axis=1))
    looked = np.concatenate(central) if central else np.zeros(0, np.bool_)
    share = float(looked.mean()) if looked.size else 0.0
    return SimulationScore(rows=tuple(rows), central=share, pictures=int(looked.size))


def format_score(found: SimulationScore) -> str:
    """Return the score as a text table."""
    lines = [f"{'y [m]':>9s} {'answers':>8s} {'RMSE x/y/z [m]':>22s} {'ANEES':>6s}"]
    for row in found.rows:
        x, y, z = row.rmse_m
        lines.append(f"{row.from_m:4.0f}–{row.to_m:<4.0f} {row.count:8d} {x:8.3f}/{y:.3f}/{z:.3f} {row.anees:9.2f}")
    lines.append(
        f"nose in the central half of {100 * found.central:.1f} % of {found.pictures} pictures of the approach"
    )
    return "\n".join(lines)
