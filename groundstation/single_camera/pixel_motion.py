"""How a target moves across one camera's picture: constant velocity, with shake that is measured on the way.

A hand or a pan-tilt unit shakes the picture by amounts that no model foresees, and by other amounts a minute
later. The filter therefore estimates the size of its own innovations and states the error of its prediction.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray

_ACCELERATION_PX_S2 = 60.0  # one sigma of what a steady flight changes
_FIRST_SPEED_PX_S = 60.0
_SHAKE_RATE = 0.25
_CALM_RATE = 0.06
_SLOWING_S = 1.5  # a velocity that nothing confirms fades with this time constant


class PixelMotion:
    """Position and velocity of one target in one picture.

    Both axes have the same noise, so one (2, 2) covariance of position and velocity serves them both.

    Parameters
    ----------
    place_px : (u, v) at the beginning.
    velocity_px_s : (u, v) at the beginning; None if it is not known.
    sigma_px : one sigma of the place.
    least_shake_px, most_shake_px : bounds of the shake per frame, one sigma.
    """

    def __init__(
        self,
        place_px: tuple[float, float],
        velocity_px_s: tuple[float, float] | None,
        *,
        sigma_px: float,
        least_shake_px: float,
        most_shake_px: float,
    ) -> None:
        self.u_px, self.v_px = place_px
        self.du_px_s, self.dv_px_s = velocity_px_s if velocity_px_s is not None else (0.0, 0.0)
        speed_sigma = _FIRST_SPEED_PX_S if velocity_px_s is None else 0.3 * _FIRST_SPEED_PX_S
        self._pp, self._pv, self._vv = sigma_px**2, 0.0, speed_sigma**2
        self._least, self._most = least_shake_px**2, most_shake_px**2
        self._shake = max(self._least, min((0.5 * sigma_px) ** 2, self._most))
        self._before = place_px

    @property
    def sigma_px(self) -> float:
        """One sigma of the place, the same along u and v."""
        return math.sqrt(self._pp)

    @property
    def shake_px(self) -> float:
        """One sigma of what a frame brings beyond constant velocity."""
        return math.sqrt(self._shake)

    def place(self) -> FloatArray:
        """Return the place (2,), u and v in px."""
        return np.array([self.u_px, self.v_px])

    def covariance(self) -> FloatArray:
        """Return the covariance (2, 2) of the place in px²."""
        return self._pp * np.eye(2)

    def predict(self, dt_s: float) -> None:
        """Go on by ``dt_s``."""
        self._before = (self.u_px, self.v_px)
        self.u_px += self.du_px_s * dt_s
        self.v_px += self.dv_px_s * dt_s
        noise = _ACCELERATION_PX_S2**2
        self._pp += 2.0 * dt_s * self._pv + dt_s**2 * self._vv + 0.25 * noise * dt_s**4 + self._shake
        self._pv += dt_s * self._vv + 0.5 * noise * dt_s**3
        self._vv += noise * dt_s**2

    def shift_by(self, shift_px: FloatArray) -> None:
        """Take the measured motion (2,) of the whole picture for the last prediction, in place of the velocity."""
        self.u_px = self._before[0] + float(shift_px[0])
        self.v_px = self._before[1] + float(shift_px[1])

    def coast(self, dt_s: float) -> None:
        """Take note of a frame without a measurement: the velocity is trusted less and less."""
        kept = math.exp(-dt_s / _SLOWING_S)
        self.du_px_s *= kept
        self.dv_px_s *= kept

    def correct(self, place_px: FloatArray, sigma_px: float) -> None:
        """Take a measured place (2,) with one sigma of its noise, and learn how large the shake is."""
        du, dv = float(place_px[0]) - self.u_px, float(place_px[1]) - self.v_px
        surprise = 0.5 * (du * du + dv * dv)
        rate = _SHAKE_RATE if surprise > self._shake else _CALM_RATE
        self._shake = min(max(self._shake + rate * (surprise - self._shake), self._least), self._most)
        total = self._pp + sigma_px**2
        place_gain, speed_gain = self._pp / total, self._pv / total
        self.u_px += place_gain * du
        self.v_px += place_gain * dv
        self.du_px_s += speed_gain * du
        self.dv_px_s += speed_gain * dv
        self._vv -= speed_gain * self._pv
        self._pv *= 1.0 - place_gain
        self._pp *= 1.0 - place_gain
