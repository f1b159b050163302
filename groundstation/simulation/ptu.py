"""A pan-tilt unit's readings: sampled at its own rate, noisy, in steps, and some time on the way."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import PtuSample
from groundstation.rig.rig import Station
from groundstation.simulation.device_clocks import stated_times
from groundstation.simulation.parameter_checks import require, require_finite, require_not_negative, require_positive
from groundstation.simulation.pointing import IdealPointing, PointingHistory, PointingModel

MAX_READINGS = 2_000_000
MAX_RATE_HZ = 1000.0
# ten bytes at 115,200 baud take somewhat longer
MESSAGE_S = 5e-4


class StampedAt(StrEnum):
    """Instant of a reading's stamp: when the unit samples its encoders, or when the message arrives."""

    SAMPLING = "sampling"
    ARRIVAL = "arrival"


@dataclass(frozen=True, slots=True, kw_only=True)
class PtuModel:
    """Parameters of a pan-tilt unit that no rig file has; its steps, noise and clock are the true rig's.

    Attributes
    ----------
    pointing : how the head follows the target.
    rate_hz, phase_s : readings are sampled at phase + k / rate of true session time.
    delay_s, delay_jitter_s : a reading arrives delay + U(0, jitter) later, never before the one before it.
    stamped : when it gets its stamp.
    """

    pointing: PointingModel = field(default_factory=IdealPointing)
    rate_hz: float = 50.0
    phase_s: float = 0.0
    delay_s: float = 0.0
    delay_jitter_s: float = 0.0
    stamped: StampedAt = StampedAt.SAMPLING

    def __post_init__(self) -> None:
        require_positive("PtuModel: rate_hz", self.rate_hz)
        require_finite("PtuModel: phase_s", self.phase_s)
        usual = self.rate_hz <= MAX_RATE_HZ
        require(usual, "PtuModel: rate_hz", got=self.rate_hz, wanted=f"at most {MAX_RATE_HZ:g} Hz")
        require_not_negative("PtuModel: delay_s", self.delay_s)
        require_not_negative("PtuModel: delay_jitter_s", self.delay_jitter_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedReadings:
    """Readings of one unit: ``samples`` by time, and when each arrived (n,), true session time in s."""

    samples: tuple[PtuSample, ...]
    arrival_s: FloatArray


def read_ptu(
    model: PtuModel,
    true: Station,
    stated: Station,
    history: PointingHistory,
    span_s: tuple[float, float],
    generator: np.random.Generator,
) -> SimulatedReadings:
    """Sample a unit's encoders over a span of true session time, s; stamps are as the user's rig maps them."""
    ideal = true.ptu_axes.is_ideal_apart_from_lean and stated.ptu_axes.is_ideal_apart_from_lean
    what = f"station {true.name}: ptu_axes"
    require(ideal, what, got="an error of zero, scale or backlash", wanted="none: only a lean is simulated")
    first = np.ceil((span_s[0] - model.phase_s) * model.rate_hz - 1e-9)
    last = np.floor((span_s[1] - model.phase_s) * model.rate_hz + 1e-9)
    count = int(last - first) + 1
    wanted = f"at most {MAX_READINGS}"
    require(count <= MAX_READINGS, f"station {true.name}: rate_hz", got=f"{count} readings", wanted=wanted)
    t = (first + np.arange(count)) / model.rate_hz + model.phase_s
    angles = history.at(t).encoder_rad + generator.normal(size=(count, 2)) * true.ptu_sigma_rad
    angles = quantise(angles, true.ptu_resolution_rad)
    arrival = t + model.delay_s
    if model.delay_jitter_s:
        arrival = _in_line(arrival + generator.uniform(size=count) * model.delay_jitter_s)
    stamped = arrival if model.stamped is StampedAt.ARRIVAL else t
    stamps = stated_times(stamped, true.ptu_clock, stated.ptu_clock)
    samples = tuple(
        PtuSample(t_s=float(at), station=true.name, pan_rad=float(pan), tilt_rad=float(tilt))
        for at, (pan, tilt) in zip(stamps, angles, strict=True)
    )
    return SimulatedReadings(samples=samples, arrival_s=arrival)


def _in_line(arrival_s: FloatArray) -> FloatArray:
    """Return arrivals (n,) in the order in which they were sent: a serial line has one message at a time."""
    earliest = MESSAGE_S * np.arange(arrival_s.size)
    return np.asarray(np.maximum.accumulate(arrival_s - earliest) + earliest)


def quantise(angles_rad: FloatArray, resolution_rad: float) -> FloatArray:
    """Round angles to whole steps of an encoder; a resolution of 0 has no steps."""
    if resolution_rad == 0:
        return angles_rad
    return np.asarray(resolution_rad * np.round(angles_rad / resolution_rad))
