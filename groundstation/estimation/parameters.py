"""The errors of calibration and clocks in the filter state: estimated, or treated as consider parameters.

Each is a difference from the value in the rig file, zero at first, with the covariance that the rig file gives. Names
are ``station.parameter``: those of `groundstation.geometry.calibration`, and for clocks

- ``camera_clock.offset`` in s: the camera's exposures were that much later than their stamps say,
- ``ptu_clock.offset`` in s: likewise for the PTU's readings,
- ``readout`` in s: the shutter takes that much longer from first row to last,
- ``….drift``: how the offset grows, in s/s, from the filter's first instant on,

and for the reference ``dgps_clock.offset``, ``dgps_clock.drift`` and ``dgps_antenna.x``, ``.y``, ``.z`` in m: where the
antenna lies from the nose, forward, right and down, beyond what has been allowed for; ``target.log_span`` is the
logarithm of the aircraft's span over the one that is assumed, always estimated. An error that is *considered* keeps
its value and its variance (Schmidt), and the track's covariance never sinks below what it causes; one that is
*estimated* is learnt as any other state.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import GroundstationError
from groundstation.estimation.state_model import SPAN_WALK_PSD
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import READOUT, ParameterCovariance
from groundstation.rig.rig import Rig

CLOCKS = ("camera_clock", "ptu_clock")
CLOCK_PARTS = ("offset", "drift")
DGPS_CLOCK = "dgps_clock"
LOG_SPAN = "target.log_span"
_STATION_NAMES = frozenset(
    [*CALIBRATION_PARAMETERS, READOUT, *(f"{clock}.{part}" for clock in CLOCKS for part in CLOCK_PARTS)],
)
DGPS_ANTENNA = tuple(f"dgps_antenna.{axis}" for axis in "xyz")
_OTHER_NAMES = frozenset([LOG_SPAN, *(f"{DGPS_CLOCK}.{part}" for part in CLOCK_PARTS), *DGPS_ANTENNA])


class ParameterError(GroundstationError):
    """A carried error has an unknown name, or no covariance that could be one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ParameterPrior:
    """What is known before: ``names`` of m errors, their ``covariance`` (m, m) and ``walk_psd`` (m,).

    ``walk_psd`` is how fast each variance grows by itself, unit²/s: a tripod that settles. Zero for a constant.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    walk_psd: FloatArray

    @classmethod
    def nothing(cls) -> "ParameterPrior":
        """Return the prior of no error: everything is taken as exact."""
        return cls(names=(), covariance=np.zeros((0, 0)), walk_psd=np.zeros(0))

    @classmethod
    def independent(cls, names: Sequence[str], sigmas: Sequence[float]) -> "ParameterPrior":
        """Return constants that have nothing to do with each other; ``sigmas`` (m,) in rad, m, px, s or s/s."""
        spread = np.asarray(sigmas, dtype=np.float64)
        return cls(names=tuple(names), covariance=np.diag(spread**2), walk_psd=np.zeros(len(spread)))

    def __post_init__(self) -> None:
        m = len(self.names)
        if self.covariance.shape != (m, m) or self.walk_psd.shape != (m,):
            got = f"a covariance {self.covariance.shape} and walks {self.walk_psd.shape} for {m} names"
            raise ParameterError(f"got {got}; wanted ({m}, {m}) and ({m},)")
        if len(set(self.names)) < m:
            raise ParameterError(f"got a name twice in {', '.join(self.names)}; wanted each once")

    def joined(self, other: "ParameterPrior") -> "ParameterPrior":
        """Return both together, independent of each other."""
        m, n = len(self.names), len(other.names)
        covariance = np.zeros((m + n, m + n))
        covariance[:m, :m], covariance[m:, m:] = self.covariance, other.covariance
        walks = np.concatenate([self.walk_psd, other.walk_psd])
        return ParameterPrior(names=(*self.names, *other.names), covariance=covariance, walk_psd=walks)

    def with_span(self, sigma: float) -> "ParameterPrior":
        """Return this prior and the span's error with it; ``sigma`` of its logarithm."""
        span = ParameterPrior(names=(LOG_SPAN,), covariance=np.array([[sigma**2]]), walk_psd=np.array([SPAN_WALK_PSD]))
        return self.joined(span)

    def require_stations(self, stations: Sequence[str]) -> None:
        """Raise `ParameterError` unless every name is a parameter of one of ``stations`` or of the reference."""
        for name in self.names:
            station, _, parameter = name.partition(".")
            if name not in _OTHER_NAMES and (station not in stations or parameter not in _STATION_NAMES):
                wanted = f"station.parameter with one of {', '.join(stations)}"
                raise ParameterError(f"got the carried error {name!r}; wanted {wanted}")


def rig_prior(rig: Rig, reference: ParameterPrior | None = None) -> ParameterPrior:
    """Return the rig file's statement of its errors: its covariance tables, the sigmas of its clocks and shutters.

    Clocks that stand in the covariance of the whole rig are correlated with the rest. ``reference`` are the errors of
    reference positions to carry besides; those of them that a flight has found together with the rig, and whose
    variance is the rig's, keep what they have in common with it.
    """
    known = rig.calibration_covariance()
    names, sigmas = [], []
    extra = ParameterPrior.nothing() if reference is None else reference
    together = _found_together(known, extra)
    for station in rig.stations:
        clocks = {"camera_clock": station.camera_clock}
        if not station.fixed:
            clocks["ptu_clock"] = station.ptu_clock
        for clock, model in clocks.items():
            name = f"{station.name}.{clock}.offset"
            if model is not None and model.sigma_s > 0.0 and name not in known.names:
                names.append(name)
                sigmas.append(model.sigma_s)
        name = f"{station.name}.{READOUT}"
        if station.readout_sigma_s > 0.0 and name not in known.names:
            names.append(name)
            sigmas.append(station.readout_sigma_s)
    # a parameter of no variance is exact: carrying it would only cost time
    keep = [
        k for k, name in enumerate(known.names) if known.matrix[k, k] > 0.0 and (_is_stations(name) or name in together)
    ]
    # the rig's DGPS clock is what the log's stamps are ahead of the session, the filter's what they are behind it
    sign = np.array([-1.0 if known.names[k].startswith(DGPS_CLOCK) else 1.0 for k in keep])
    calibration = ParameterPrior(
        names=tuple(known.names[k] for k in keep),
        covariance=known.matrix[np.ix_(keep, keep)] * np.outer(sign, sign),
        walk_psd=np.zeros(len(keep)),
    )
    alone = [k for k, name in enumerate(extra.names) if name not in together]
    rest = ParameterPrior(
        names=tuple(extra.names[k] for k in alone),
        covariance=extra.covariance[np.ix_(alone, alone)],
        walk_psd=extra.walk_psd[alone],
    )
    return calibration.joined(ParameterPrior.independent(names, sigmas)).joined(rest)


def _is_stations(name: str) -> bool:
    return name not in _OTHER_NAMES


def _found_together(known: ParameterCovariance, extra: ParameterPrior) -> frozenset[str]:
    """Return the errors of the reference whose variance is the one that the rig's table gives."""
    found = set()
    for k, name in enumerate(extra.names):
        if name in known.names:
            place = known.names.index(name)
            if np.isclose(known.matrix[place, place], extra.covariance[k, k], rtol=1e-2, atol=0.0):
                found.add(name)
    return frozenset(found)


def time_places(parameters: Mapping[str, int], station: str) -> list[int]:
    """Return the places of all of a station's errors in time: its clocks and its shutter."""
    found = [k for places in clock_places(parameters, station).values() for k in places]
    shutter = parameters.get(f"{station}.{READOUT}")
    return found if shutter is None else [*found, shutter]


def pointing_sigma_rad(P: FloatArray, parameters: Mapping[str, int], station: str) -> float:
    """Return one sigma of the pointing of a camera due to the errors of its mount and boresight, rad.

    The larger of tilt and pan; zero for an exact rig. ``P`` (n, n) is the covariance of the state.
    """
    variance = 0.0
    for axis in ("x", "z"):
        names = (f"{station}.{part}.{axis}" for part in ("runway_from_base", "head_from_camera"))
        places = [parameters[name] for name in names if name in parameters]
        variance = max(variance, sum(float(P[a, b]) for a in places for b in places))
    return math.sqrt(variance)


def clock_places(parameters: Mapping[str, int], station: str) -> dict[str, list[int]]:
    """Return the places of a station's clock errors, by clock; clocks that are not carried are left out."""
    found = {clock: [k for name, k in parameters.items() if name.startswith(f"{station}.{clock}.")] for clock in CLOCKS}
    return {clock: places for clock, places in found.items() if places}
