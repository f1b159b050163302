"""A bird in a scene."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.attitude import GRAVITY_M_S2, runway_from_body
from groundstation.simulation.scene_body import PointLight, Skin
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_shape import BirdShape

_MAX_BANK_RAD = math.radians(50.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BirdBody:
    """A bird on a path, or ``offset_m`` (3,) ahead of, right of and above one; its place is the middle of its body.

    ``phase`` is added to that of its cycle; ``sway_m`` and ``sway_s`` are amplitude and period of its drift about its
    place in a flock. It throws no shadow: at its height the penumbra is wider than itself.
    """

    shape: BirdShape
    path: ArcPath
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    phase: float = 0.0
    sway_m: float = 0.0
    sway_s: float = 4.0

    @property
    def reach_m(self) -> float:
        """Largest distance of its corners from its middle, m."""
        return self.shape.reach_m

    @property
    def casts_shadow(self) -> bool:
        """Never."""
        return False

    def place(self, t_s: float) -> FloatArray:
        """Return the middle of its body (3,) m."""
        x, y, z = self.path.place_at(t_s)
        ahead, right, up = self.offset_m
        # three periods without a common multiple, so that no bird moves in a circle
        turn = math.tau * (t_s / self.sway_s + self.phase)
        ahead += self.sway_m * math.sin(turn)
        right += self.sway_m * math.sin(0.73 * turn + 1.0)
        up += self.sway_m * math.sin(1.31 * turn + 2.0)
        heading = self.path.heading_rad + self.path.turn_rate_rad_s * (t_s - self.path.at_s)
        sine, cosine = math.sin(heading), math.cos(heading)
        return np.array([x + ahead * sine + right * cosine, y + ahead * cosine - right * sine, z + up])

    def skin(self, t_s: float) -> Skin:
        """Return its triangles."""
        path = self.path
        heading = path.heading_rad + path.turn_rate_rad_s * (t_s - path.at_s)
        bank = math.atan2(path.speed_m_s * path.turn_rate_rad_s, GRAVITY_M_S2)
        turned = runway_from_body(
            np.array([math.sin(heading), math.cos(heading)]),
            math.atan2(path.climb_m_s, max(path.speed_m_s, 1.0)),
            min(max(bank, -_MAX_BANK_RAD), _MAX_BANK_RAD),
        )
        form = self.shape.at(t_s, self.phase)
        return Skin(
            corners_runway_m=form.corners_body_m @ turned.T + self.place(t_s),
            normals_runway=form.normals_body @ turned.T,
            colours_bgr=self.shape.colours_bgr,
            opacity=self.shape.opacity,
        )

    def lights(self, t_s: float, eye_runway_m: FloatArray) -> tuple[PointLight, ...]:
        """Return none."""
        del t_s, eye_runway_m
        return ()
