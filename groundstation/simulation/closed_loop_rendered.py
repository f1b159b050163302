"""Closed-loop simulation in virtual time with rendered pictures, on which the detector runs."""

from collections.abc import Sequence
from functools import partial

from groundstation.arrays import FloatArray
from groundstation.live.input_queue import TimedPicture
from groundstation.rig.rig import Rig
from groundstation.simulation.closed_loop import (
    ClosedLoopConfig,
    ClosedLoopFault,
    ClosedLoopFaultKind,
    ClosedLoopSimulation,
)
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.trajectory import Trajectory
from groundstation.tracking.config import Config


class RenderedClosedLoopSimulation(ClosedLoopSimulation):
    """One simulated landing in operation, filmed.

    Parameters are `ClosedLoopSimulation`'s; ``span_m`` is passed to the pipeline.
    """

    def __init__(
        self,
        rig: Rig,
        config: Config,
        flight: Trajectory,
        *,
        faults: Sequence[ClosedLoopFault] = (),
        hardware: ClosedLoopConfig | None = None,
        seed: int = 0,
        span_m: float | None = None,
    ) -> None:
        super().__init__(rig, config, flight, faults=faults, hardware=hardware, seed=seed, span_m=span_m)
        world = RenderedScene(trajectory=flight)
        self._cameras = {
            s.name: RenderedCamera(world, s, seed=seed, number=number) for number, s in enumerate(rig.stations)
        }

    def _look(self, name: str, t_s: float, pixel: FloatArray, size: FloatArray) -> None:
        """Render a picture, and deliver it later."""
        h = self._hardware
        delay_s = h.frame_delay_s + abs(float(self._random.normal(0.0, h.frame_jitter_s)))
        # a camera reader discards pictures that are bitwise repeated
        if self._is(ClosedLoopFaultKind.CAMERA_LOST, name, t_s) or self._is(
            ClosedLoopFaultKind.CAMERA_FROZEN, name, t_s
        ):
            return
        delay_s += h.late_s * self._is(ClosedLoopFaultKind.CAMERA_LATE, name, t_s)
        stamp_s = t_s + h.step_s * self._is(ClosedLoopFaultKind.CAMERA_CLOCK_STEPPED, name, t_s)
        head = self._heads[name]
        picture = self._cameras[name].picture(t_s, *(float(v) for v in (*head.angles, *head.rates)))
        shot = TimedPicture(t_s=stamp_s, arrived_s=t_s + delay_s, station=name, picture=picture)
        self._at(t_s + delay_s, partial(self._deliver, shot))
