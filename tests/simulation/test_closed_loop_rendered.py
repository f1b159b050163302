"""A landing in operation with pictures, in virtual time: acquired, tracked, and dropped after it has left."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import TrackStatus
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.closed_loop import ClosedLoopConfig, ClosedLoopFault, ClosedLoopFaultKind
from groundstation.simulation.closed_loop_rendered import RenderedClosedLoopSimulation
from groundstation.tracking.config import Config
from tests.live.test_operation import small_rig


class Vanishing:
    """A glide that is over for the cameras at ``gone_s``: the aircraft is nowhere near from then on."""

    def __init__(self, gone_s: float, end_s: float) -> None:
        self._glide = GlideApproach(start_y_m=200.0, end_y_m=80.0, speed_m_s=20.0, aim_y_m=60.0)
        self._gone_s = gone_s
        self.span_s = (0.0, end_s)

    def position(self, t_s: FloatArray) -> FloatArray:
        t = np.asarray(t_s, dtype=np.float64)
        place = np.array(self._glide.position(np.minimum(t, self._gone_s)))
        place[t > self._gone_s] = (0.0, 90_000.0, 9_000.0)
        return place

    def velocity(self, t_s: FloatArray) -> FloatArray:
        return self._glide.velocity(np.minimum(t_s, self._gone_s))


def test_it_is_filmed_found_and_followed_and_not_tracked_where_it_is_not() -> None:
    lost = ClosedLoopFault(kind=ClosedLoopFaultKind.CAMERA_LOST, station="right", from_s=2.2, to_s=2.6)
    hardware = ClosedLoopConfig(frame_rate_hz=10.0)
    day = RenderedClosedLoopSimulation(
        small_rig(), Config(), Vanishing(3.0, 4.2), faults=[lost], hardware=hardware, seed=2, span_m=2.3
    ).run()
    assert day.share(TrackStatus.TRACKING, 1.6, 2.15) == 1.0
    assert day.share(TrackStatus.COASTING, 2.25, 2.55) == 1.0
    assert day.share(TrackStatus.TRACKING, 2.7, 3.0) >= 0.6
    assert day.squared_errors(1.6, 3.0).mean() / 3.0 < 1.5
    assert day.share(TrackStatus.TRACKING, 3.1, 4.2) == 0.0
