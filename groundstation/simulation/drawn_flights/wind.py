"""Effect of gusts on a flight: displacement and rotation of the aircraft."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.drawn_flights.flight_spec import FlightSpec
from groundstation.simulation.drawn_flights.profile import smooth_step
from groundstation.simulation.path_deviation import GustModel

_PATH_STREAM, _WOBBLE_STREAM = 311, 312
# a seventh of the shortest time constant in here
_STEP_S = 0.03
# along and up, as shares of the sideways gusts; near the ground Dryden's vertical turbulence is the weakest
_GUST_SHARES = (1.0, 0.6, 0.7)
# below this height of the wheels gusts push less and less, as nothing pushes an aircraft aside on its wheels
_GUST_HEIGHT_M = 12.0
_WOBBLE_HEIGHT_M = 1.5
# no gust moves the aircraft further than this, so that none pushes it under the runway from within the height above
_MOST_M = 8.0
# the short-period motion of a light aircraft: 0.7 Hz, lightly damped
_WOBBLE = GustModel(sigma_m_s2=(1.0, 1.0, 1.0), correlation_s=0.4, hold_rad_s=4.5, damping=0.4)
_PITCH_AND_YAW_SHARE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindEffects:
    """At n times: ``moved_m`` (n, 3) in the runway frame; ``held_m_s2`` (n, 3) by which the pilot holds against it;
    ``turned_rad`` (n, 3) about the body's x, y, z.
    """

    moved_m: FloatArray
    held_m_s2: FloatArray
    turned_rad: FloatArray


def wind_effects(spec: FlightSpec, seed: int, t_s: FloatArray, height_m: FloatArray) -> WindEffects:
    """Draw what gusts do at evenly spaced times (n,), with the wheels at heights (n,): nothing on the ground."""
    low = smooth_step(height_m / _GUST_HEIGHT_M)[:, None]
    just_off = smooth_step(height_m / _WOBBLE_HEIGHT_M)[:, None]
    still = np.zeros((t_s.size, 3))
    moved, held, turned = still, still, still
    span = (float(t_s[0]), float(t_s[-1]))
    if spec.gust_m_s2 > 0.0:
        x, y, z = (share * spec.gust_m_s2 for share in _GUST_SHARES)
        model = GustModel(sigma_m_s2=(x, y, z))
        drawn = model.draw(np.random.default_rng([seed, _PATH_STREAM]), span, _STEP_S)
        off, rate = drawn.position(t_s), drawn.velocity(t_s)
        moved = low * _MOST_M * np.tanh(off / _MOST_M)
        held = -low * (model.hold_rad_s**2 * off + 2.0 * model.damping * model.hold_rad_s * rate)
    if spec.wobble_rad > 0.0:
        unit = _WOBBLE.stationary_covariance[0, 0] ** 0.5
        drawn = _WOBBLE.draw(np.random.default_rng([seed, _WOBBLE_STREAM]), span, _STEP_S)
        sigma = spec.wobble_rad * np.array([1.0, _PITCH_AND_YAW_SHARE, _PITCH_AND_YAW_SHARE])
        turned = just_off * drawn.position(t_s) * (sigma / unit)
    return WindEffects(moved_m=moved, held_m_s2=held, turned_rad=turned)
