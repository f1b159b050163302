"""`Rehearsal` with rendered pictures in place of pixels: the detector looks where the heads have turned, too.

Still in virtual time: what a machine cannot render in real time it can rehearse, and the same seed gives the same day.
"""

from collections.abc import Sequence
from functools import partial

from groundstation.arrays import FloatArray
from groundstation.live.input_queue import TimedPicture
from groundstation.rig.rig import Rig
from groundstation.simulation.rehearsal import Rehearsal, RehearsalConfig, RehearsalFault, RehearsalFaultKind
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.trajectory import Trajectory
from groundstation.simulation.world import World
from groundstation.tracking.config import Config


class PictureRehearsal(Rehearsal):
    """One simulated landing in operation, filmed.

    Parameters are `Rehearsal`'s; ``span_m`` is told to the pipeline, as the station file would.
    """

    def __init__(
        self,
        rig: Rig,
        config: Config,
        flight: Trajectory,
        *,
        faults: Sequence[RehearsalFault] = (),
        hardware: RehearsalConfig | None = None,
        seed: int = 0,
        span_m: float | None = None,
    ) -> None:
        super().__init__(rig, config, flight, faults=faults, hardware=hardware, seed=seed, span_m=span_m)
        world = World(trajectory=flight)
        self._cameras = {
            s.name: RenderedCamera(world, s, seed=seed, number=number) for number, s in enumerate(rig.stations)
        }

    def _look(self, name: str, t_s: float, pixel: FloatArray, size: FloatArray) -> None:
        """Film, and hand the picture over later."""
        h = self._hardware
        delay_s = h.frame_delay_s + abs(float(self._random.normal(0.0, h.frame_jitter_s)))
        # whoever reads a camera notices pictures that repeat to the last bit
        if self._is(RehearsalFaultKind.CAMERA_LOST, name, t_s) or self._is(RehearsalFaultKind.CAMERA_FROZEN, name, t_s):
            return
        delay_s += h.late_s * self._is(RehearsalFaultKind.CAMERA_LATE, name, t_s)
        stamp_s = t_s + h.step_s * self._is(RehearsalFaultKind.CAMERA_CLOCK_STEPPED, name, t_s)
        head = self._heads[name]
        picture = self._cameras[name].picture(t_s, *(float(v) for v in (*head.angles, *head.rates)))
        shot = TimedPicture(t_s=stamp_s, arrived_s=t_s + delay_s, station=name, picture=picture)
        self._at(t_s + delay_s, partial(self._deliver, shot))
