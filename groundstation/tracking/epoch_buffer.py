"""The pixels of one epoch, collected for its estimate: views to triangulate, and the stations that were accepted."""

from dataclasses import dataclass

from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.messages import Epoch, Triangulation, TriangulationStatus

_KEPT_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EpochView:
    """One camera's target pixel with its station's angles, and whether the filter accepted it as the target's.

    ``cut`` marks an accepted pixel of a silhouette that the border cuts: a camera sees the target, but not where it is.
    ``labelled`` marks pixels of a detections-only session, which belong to an epoch by their time. A station that is
    not ``trusted`` is monitored, but excluded from the triangulation.
    """

    t_s: float
    epoch: int
    station: str
    view: TriangulationView
    accepted: bool
    labelled: bool
    trusted: bool = True
    cut: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EpochViews:
    """All pixels of one epoch.

    ``views`` are those not used by an earlier epoch. ``accepted`` names the stations whose pixel the filter
    accepted, in this epoch or, with labelled pixels, close in time; ``seen`` also those with a cut silhouette.
    ``arrived_s`` is the stopwatch at the arrival of the epoch's first frame, None without a frame.
    """

    views: tuple[EpochView, ...]
    accepted: frozenset[str]
    arrived_s: float | None
    seen: frozenset[str] = frozenset()

    def triangulate(self, residual_gate_sigma: float) -> tuple[TriangulationStatus, Triangulation | None]:
        """Triangulate the trusted views; status ``residual`` if the rays miss each other by more than their noise."""
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
    """Buffers views until their epoch is closed, for at most two seconds."""

    def __init__(self, labelled_window_s: float) -> None:
        self._window_s = labelled_window_s
        self._views: list[EpochView] = []
        self._arrived: dict[int, float] = {}
        self._used: set[int] = set()

    def arrived(self, epoch: int, stopwatch_s: float) -> None:
        """Store the arrival time of the first record of an epoch."""
        self._arrived.setdefault(epoch, stopwatch_s)

    def add(self, view: EpochView) -> None:
        """Add the view of one camera."""
        self._views.append(view)

    def close(self, epoch: Epoch) -> EpochViews:
        """Return the views of an epoch; discard them and all older ones."""
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
        # a labelled pixel is triangulated once; a single one remains available for the next epoch
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
        return EpochViews(
            views=(*own, *fresh),
            accepted=frozenset(v.station for v in seen if v.accepted),
            arrived_s=arrived,
            seen=frozenset(v.station for v in seen if v.accepted or v.cut),
        )
