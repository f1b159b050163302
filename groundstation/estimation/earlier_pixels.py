"""Pixels of a found target in frames before it was found.

A target is found by fixes, which take two cameras, and its tentative track may have taken some of something else. Of
all that a camera showed before the target was found, a candidate is the target's where its state, carried back, is near
enough: where the target is likelier to be seen there than something else that looks like an aircraft, of which the same
frame shows how many there are. Of several the likeliest counts, by place and odds.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.geometry.station import StationGeometry
from groundstation.messages import INITIAL_PIXELS_S, InitialPixel, Kinematics

# the target's own candidate is further away with this probability
_TAIL = 0.01
# log odds beyond which a candidate is no surer to be an aircraft
_SURE_ODDS = 3.0
# one sigma of a candidate of which none is stated, as a share of its width
_UNSTATED_SHARE = 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SearchedFrame:
    """The candidates of one camera's frame that are more likely aircraft than not."""

    t_s: float
    station: str
    candidates: tuple[CameraCandidate, ...]


class EarlierPixels:
    """The candidates of all cameras' last frames, and which of them a found target explains.

    Parameters
    ----------
    stations : geometries by name.
    config : noise of candidates, and how tentative tracks manoeuvre.
    """

    def __init__(self, stations: Mapping[str, StationGeometry], config: InitiationConfig) -> None:
        self._stations, self._config = stations, config
        self._frames: deque[_SearchedFrame] = deque()

    def add(self, station: str, t_s: float, candidates: Sequence[CameraCandidate]) -> None:
        """Add the candidates of a frame."""
        likely = tuple(c for c in candidates if c.odds is not None and c.odds > 0.0)
        if likely:
            self._frames.append(_SearchedFrame(t_s=t_s, station=station, candidates=likely))
        while self._frames and self._frames[0].t_s < t_s - INITIAL_PIXELS_S:
            self._frames.popleft()

    def of(self, t_s: float, target: Kinematics, by_fixes: Sequence[InitialPixel]) -> tuple[InitialPixel, ...]:
        """Return the pixels of a target at ``t_s`` in earlier frames, those of its fixes where it explains no other."""
        found = {(p.t_s, p.station): p for p in by_fixes if t_s - p.t_s <= INITIAL_PIXELS_S}
        for frame in self._frames:
            if not t_s - INITIAL_PIXELS_S <= frame.t_s <= t_s:
                continue
            position, covariance = self._carried(target, frame.t_s - t_s)
            if (candidate := self._explained(frame, position, covariance)) is not None:
                found[frame.t_s, frame.station] = InitialPixel(
                    t_s=frame.t_s,
                    station=frame.station,
                    u_px=float(candidate.pixel[0]),
                    v_px=float(candidate.pixel[1]),
                    sigma_px=self._sigma_px(candidate),
                )
        return tuple(found.values())

    def _carried(self, target: Kinematics, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Return position (3,) and covariance (3, 3) of a target ``dt_s`` later or earlier."""
        P = target.covariance
        cross = dt_s * (P[:3, 3:] + P[3:, :3])
        manoeuvre = self._config.acceleration_psd_m2_s3 * abs(dt_s) ** 3 / 3.0
        position = target.position_runway_m + dt_s * target.velocity_runway_m_s
        return position, P[:3, :3] + cross + dt_s**2 * P[3:, 3:] + manoeuvre * np.eye(3)

    def _explained(self, frame: _SearchedFrame, position: FloatArray, covariance: FloatArray) -> CameraCandidate | None:
        """Return the candidate of a frame that a target at a position is the likeliest to be, None without one."""
        geometry = self._stations[frame.station]
        best: tuple[float, CameraCandidate] | None = None
        w, h = geometry.image_size_px
        for c in frame.candidates:
            seen = geometry.project(position, c.pan_rad, c.tilt_rad)
            if seen is None:
                continue
            J = seen.jacobian[:, :3]
            angles_px = c.angle_sigma_rad * float(geometry.lens.focal_px[0])
            S = J @ covariance @ J.T + np.eye(2) * (self._sigma_px(c) ** 2 + angles_px**2)
            away = c.pixel - seen.pixel
            square = float(away @ np.linalg.solve(S, away))
            likelihood = -0.5 * square - math.log(2.0 * math.pi * math.sqrt(float(np.linalg.det(S))))
            if square > chi_square_limit(_TAIL, 2) or likelihood <= math.log(len(frame.candidates) / (w * h)):
                continue
            score = likelihood + min(c.odds or 0.0, _SURE_ODDS)
            if best is None or score > best[0]:
                best = score, c
        return None if best is None else best[1]

    def _sigma_px(self, c: CameraCandidate) -> float:
        own = c.sigma_px if c.sigma_px is not None else _UNSTATED_SHARE * (c.width_px or 0.0)
        return float(np.hypot(self._config.candidate_sigma_px, own))
