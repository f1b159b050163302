"""What the cameras saw in one epoch, gathered for its answer: views to triangulate, and who was believed."""

from dataclasses import dataclass

from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.messages import Epoch, Triangulation, TriangulationStatus

_KEPT_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EpochView:
    """One camera's target pixel with its station's angles, and whether the filter accepted it.

    ``labelled`` marks pixels of a detections-only session, which belong to an epoch by their time. A station that is
    not ``trusted`` is watched, and takes no part in the baseline.
    """

    t_s: float
    epoch: int
    station: str
    view: TriangulationView
    accepted: bool
    labelled: bool
    trusted: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EpochPage:
    """What was seen for one epoch.

    ``views`` are those not yet used by an earlier epoch. ``accepted`` names the stations whose pixel the filter
    accepted, in this epoch or, with labelled pixels, close in time. ``arrived_s`` is the stopwatch at the epoch's
    first frame, None if it had none.
    """

    views: tuple[EpochView, ...]
    accepted: frozenset[str]
    arrived_s: float | None

    def triangulate(self, residual_gate_sigma: float) -> tuple[TriangulationStatus, Triangulation | None]:
        """Return the baseline's answer; ``residual`` where the rays do not meet within their noise."""
        trusted = [v.view for v in self.views if v.trusted]
        if len(trusted) < 2:
            return TriangulationStatus.ONE_VIEW, None
        point = triangulate(trusted)
        if point is None:
            return TriangulationStatus.RESIDUAL, None
        if point.residual_sigma > residual_gate_sigma:
            return TriangulationStatus.RESIDUAL, point
        return TriangulationStatus.OK, point


class EpochBuffer:
    """Views by epoch until the epoch is answered; keeps no more than a moment's worth."""

    def __init__(self, labelled_window_s: float) -> None:
        self._window_s = labelled_window_s
        self._views: list[EpochView] = []
        self._arrived: dict[int, float] = {}
        self._used: set[int] = set()

    def arrived(self, epoch: int, stopwatch_s: float) -> None:
        """Note when the first record of an epoch came in."""
        self._arrived.setdefault(epoch, stopwatch_s)

    def add(self, view: EpochView) -> None:
        """Take one camera's view."""
        self._views.append(view)

    def close(self, epoch: Epoch) -> EpochPage:
        """Return an epoch's views and forget it and what is older."""
        own = [v for v in self._views if not v.labelled and v.epoch == epoch.epoch]
        near = {
            v.station: v
            for v in sorted(self._views, key=lambda v: v.t_s)
            if v.labelled and abs(v.t_s - epoch.t_s) <= self._window_s
        }
        arrived = self._arrived.pop(epoch.epoch, None)
        for old in [e for e in self._arrived if e < epoch.epoch - 100]:
            del self._arrived[old]
        seen = (*own, *near.values())
        # a labelled pixel is triangulated once; alone it may still meet another station's in the next epoch
        fresh = tuple(v for v in near.values() if id(v) not in self._used)
        if len(fresh) >= 2:
            self._used |= {id(v) for v in fresh}
        self._views = [
            v
            for v in self._views
            if (v.t_s > epoch.t_s - self._window_s if v.labelled else v.epoch != epoch.epoch)
            and v.t_s > epoch.t_s - _KEPT_S
        ]
        self._used &= {id(v) for v in self._views}
        return EpochPage(
            views=(*own, *fresh), accepted=frozenset(v.station for v in seen if v.accepted), arrived_s=arrived
        )
