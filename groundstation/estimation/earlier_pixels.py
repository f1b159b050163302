"""Pixels of a found target in frames before it was found.

A target is found by fixes, which take two cameras, and its tentative track may have taken some of something else. A
Kalman filter goes back in time from the target's state, through all that the cameras showed before it was found. A
candidate is the target's where it is near enough to the state: where the target is likelier to be seen there than
something else that looks like an aircraft, of which the same frame shows how many there are. Of several the likeliest
counts, by place and odds; its pixel updates the state: an aircraft that has just begun to move stood before.
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
from groundstation.estimation.variance_check import sigma_of
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.geometry.station import StationGeometry
from groundstation.messages import INITIAL_PIXELS_S, InitialPixel, Kinematics

# the target's own candidate is farther away with a probability of 0.001; what else the frame shows decides before that.
# 0.01 costs five of 53 validate worlds a pixel and gains none, as errors of candidates are larger than stated
_GATE = chi_square_limit(0.001, 2)
# newest frames that are gone back through, which takes 0.15 ms each: five seconds of two cameras at 30 Hz
_MOST_FRAMES = 300
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
        self._frames: deque[_SearchedFrame] = deque(maxlen=_MOST_FRAMES)

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
        focal_px, (w, h) = float(geometry.lens.focal_px[0]), geometry.image_size_px
        least = math.log(len(frame.candidates) / (w * h))
        seen: dict[tuple[float, float], _Expected | None] = {}
        best: tuple[float, _Explained] | None = None
        for c in frame.candidates:
            angles = c.pan_rad, c.tilt_rad
            if angles not in seen:
                seen[angles] = target.expected(geometry, *angles)
            if (expected := seen[angles]) is None:
                continue
            noise_px2 = self._sigma_px(c) ** 2 + (c.angle_sigma_rad * focal_px) ** 2
            away = c.pixel - expected.pixel
            square, determinant = expected.distance(away, noise_px2)
            likelihood = -0.5 * square - math.log(2.0 * math.pi * sigma_of(determinant, "earlier pixel"))
            if square > _GATE or likelihood <= least:
                continue
            score = likelihood + min(c.odds or 0.0, _SURE_ODDS)
            if best is None or score > best[0]:
                found = _Explained(candidate=c, residual_px=away, jacobian=expected.jacobian, noise_px2=noise_px2)
                best = score, found
        return None if best is None else best[1]

    def _sigma_px(self, c: CameraCandidate) -> float:
        own = c.sigma_px if c.sigma_px is not None else _UNSTATED_SHARE * (c.width_px or 0.0)
        return float(np.hypot(self._config.candidate_sigma_px, own))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Explained:
    """A candidate as the pixel of a target: residual (2,), ∂(u, v)/∂(x, y, z) (2, 3), variance of u and of v."""

    candidate: CameraCandidate
    residual_px: FloatArray
    jacobian: FloatArray
    noise_px2: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Expected:
    """Where a camera shows a target: pixel (2,), ∂(u, v)/∂(x, y, z) (2, 3), covariance (2, 2) by its position."""

    pixel: FloatArray
    jacobian: FloatArray
    covariance_px2: FloatArray

    def distance(self, away_px: FloatArray, noise_px2: float) -> tuple[float, float]:
        """Return the squared distance of a pixel that is ``away_px`` (2,), in sigmas, and the determinant of S, px⁴."""
        (a, b), (_, c) = self.covariance_px2.tolist()
        a, c = a + noise_px2, c + noise_px2
        (u, v), determinant = away_px.tolist(), a * c - b * b
        return (c * u * u - 2.0 * b * u * v + a * v * v) / determinant, determinant


class _CarriedTarget:
    """State (6,) and covariance (6, 6) of a target that is followed back in time."""

    def __init__(self, t_s: float, target: Kinematics, config: InitiationConfig) -> None:
        self._t_s, self._psd, self._start_share = t_s, config.acceleration_psd_m2_s3, config.start_share
        self.x = np.concatenate([target.position_runway_m, target.velocity_runway_m_s])
        self.P = target.covariance.copy()

    def go_back_to(self, t_s: float) -> None:
        """Predict the state to an earlier time: F⁻¹ x and F⁻¹ (P + Q) F⁻ᵀ; F⁻¹ is F over the negative time."""
        dt_s = self._t_s - t_s
        if dt_s == 0.0:
            return
        back, negative = motion_over(-dt_s, self._psd)
        # F⁻¹ Q F⁻ᵀ is the negative of Q over the negative time
        self.x, self.P, self._t_s = back @ self.x, back @ self.P @ back.T - negative, t_s

    def expected(self, geometry: StationGeometry, pan_rad: float, tilt_rad: float) -> _Expected | None:
        """Return where a camera at these angles shows the target; None behind it."""
        seen = geometry.project(self.x[:3], pan_rad, tilt_rad)
        if seen is None:
            return None
        J = seen.jacobian[:, :3]
        return _Expected(pixel=seen.pixel, jacobian=J, covariance_px2=J @ self.P[:3, :3] @ J.T)

    def update(self, pixel: _Explained) -> None:
        """Update the state with a pixel. Errors of candidates are correlated: many are hardly better than one."""
        J = pixel.jacobian
        S = J @ self.P[:3, :3] @ J.T
        S[0, 0] += (1.0 + self._start_share) * pixel.noise_px2
        S[1, 1] += (1.0 + self._start_share) * pixel.noise_px2
        K = np.linalg.solve(S, J @ self.P[:3]).T
        self.x = self.x + K @ pixel.residual_px
        P = self.P - K @ S @ K.T
        self.P = 0.5 * (P + P.T)
