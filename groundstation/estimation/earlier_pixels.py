"""Pixels of a found target in frames before it was found.

A target is found by fixes, which take two cameras, and its tentative track may have taken some of something else. A
Kalman filter goes back in time from the target's state, through all that the cameras showed before it was found. A
candidate is the target's where it is near enough to the state: where the target is likelier to be seen there than
something else that looks like an aircraft, of which the same frame shows how many there are. Of several the likeliest
counts, by place and odds. It updates the state: an aircraft that has just begun to move stood before.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.tentative_track import motion_over
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
        carried = _CarriedTarget(t_s, target, self._config)
        for frame in sorted(self._frames, key=lambda each: -each.t_s):
            if not t_s - INITIAL_PIXELS_S <= frame.t_s <= t_s:
                continue
            carried.go_back_to(frame.t_s)
            if (explained := self._explained(frame, carried)) is not None:
                carried.update(explained)
                found[frame.t_s, frame.station] = InitialPixel(
                    t_s=frame.t_s,
                    station=frame.station,
                    u_px=float(explained.candidate.pixel[0]),
                    v_px=float(explained.candidate.pixel[1]),
                    sigma_px=self._sigma_px(explained.candidate),
                )
        return tuple(sorted(found.values(), key=lambda pixel: pixel.t_s))

    def _explained(self, frame: _SearchedFrame, target: "_CarriedTarget") -> "_Explained | None":
        """Return the candidate of a frame that a target is the likeliest to be, None without one."""
        geometry = self._stations[frame.station]
        best: tuple[float, _Explained] | None = None
        w, h = geometry.image_size_px
        for c in frame.candidates:
            seen = geometry.project(target.x[:3], c.pan_rad, c.tilt_rad)
            if seen is None:
                continue
            angles_px = c.angle_sigma_rad * float(geometry.lens.focal_px[0])
            R = np.eye(2) * (self._sigma_px(c) ** 2 + angles_px**2)
            each = _Explained(candidate=c, residual_px=c.pixel - seen.pixel, jacobian=seen.jacobian[:, :3], noise_px2=R)
            S = each.jacobian @ target.P[:3, :3] @ each.jacobian.T + R
            square = float(each.residual_px @ np.linalg.solve(S, each.residual_px))
            likelihood = -0.5 * square - math.log(2.0 * math.pi * math.sqrt(float(np.linalg.det(S))))
            if square > chi_square_limit(_TAIL, 2) or likelihood <= math.log(len(frame.candidates) / (w * h)):
                continue
            score = likelihood + min(c.odds or 0.0, _SURE_ODDS)
            if best is None or score > best[0]:
                best = score, each
        return None if best is None else best[1]

    def _sigma_px(self, c: CameraCandidate) -> float:
        own = c.sigma_px if c.sigma_px is not None else _UNSTATED_SHARE * (c.width_px or 0.0)
        return float(np.hypot(self._config.candidate_sigma_px, own))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Explained:
    """A candidate as the pixel of a target: its residual (2,), ∂(u, v)/∂(x, y, z) (2, 3), and its noise (2, 2)."""

    candidate: CameraCandidate
    residual_px: FloatArray
    jacobian: FloatArray
    noise_px2: FloatArray


class _CarriedTarget:
    """State (6,) and covariance (6, 6) of a target that is followed back in time."""

    def __init__(self, t_s: float, target: Kinematics, config: InitiationConfig) -> None:
        self._t_s, self._config = t_s, config
        self.x = np.concatenate([target.position_runway_m, target.velocity_runway_m_s])
        self.P = target.covariance.copy()

    def go_back_to(self, t_s: float) -> None:
        """Predict the state to an earlier time."""
        F, Q = motion_over(self._t_s - t_s, self._config.acceleration_psd_m2_s3)
        back = np.linalg.inv(F)
        self.x, self.P, self._t_s = back @ self.x, back @ (self.P + Q) @ back.T, t_s

    def update(self, pixel: _Explained) -> None:
        """Update the state with a pixel. Errors of candidates are correlated: many are hardly better than one."""
        J = np.hstack([pixel.jacobian, np.zeros((2, 3))])
        S = J @ self.P @ J.T + (1.0 + self._config.start_share) * pixel.noise_px2
        K = np.linalg.solve(S, J @ self.P).T
        self.x = self.x + K @ pixel.residual_px
        self.P = self.P - K @ S @ K.T
        self.P = 0.5 * (self.P + self.P.T)
