"""Choice of the parameters that a flight estimates, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.flight.problem import ANTENNA, DGPS_OFFSET
from groundstation.arrays import FloatArray
from groundstation.errors import InputError, UsageError
from groundstation.rig.rig import ClockModel, Rig, Station

AXES = ("x", "y", "z")
FREE_WORDS = (
    "orientation",
    "position",
    "boresight",
    "camera_clock",
    "drift",
    "ptu_clock",
    "readout",
    "lens",
    "antenna",
)
# one sigma a priori, of parameters that are freed although known, without a sigma in the rig
KNOWN_ROTATION_RAD = float(np.radians(1.0))
KNOWN_POSITION_M = 0.3
KNOWN_CLOCK_S = 0.1
KNOWN_DRIFT = 5e-5
KNOWN_READOUT_S = 0.02
KNOWN_FOCAL_SHARE = 0.01
KNOWN_PRINCIPAL_POINT_PX = 10.0
KNOWN_DISTORTION = 0.02
KNOWN_ANTENNA_M = 0.5
DGPS_CLOCK_S = 1.0
# a detector's nose is off the nose by 2 % of the width of a silhouette
POINT_SIGMA_M = 0.05
# no flight vouches for less: a mount settles, gears play, stamps are rounded
FLOOR_ROTATION_RAD = float(np.radians(0.0002))
FLOOR_POSITION_M = 0.002
FLOOR_CLOCK_S = 0.0002


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeParameters:
    """Names of p parameters and one sigma (p,) known before, infinite where nothing is."""

    names: tuple[str, ...]
    prior_sigma: FloatArray


def free_words(text: str) -> tuple[str, ...]:
    """Return the words of --free; raises `InputError` for an unknown one."""
    words = tuple(word.strip() for word in text.split(",") if word.strip())
    for word in words:
        if word not in FREE_WORDS:
            raise UsageError("--free", got=repr(word), wanted="some of " + ", ".join(FREE_WORDS))
    return words


def choose_parameters(
    rig: Rig, words: Sequence[str], dgps_clock_open: bool, antenna_sigma_m: FloatArray | None = None
) -> FreeParameters:
    """Return the parameters left open by the rig's ``known`` and the sigmas of its clocks, and those of ``words``.

    ``dgps_clock_open`` where the relation of the log's clock to the session's is unknown; ``antenna_sigma_m`` (3,) of
    the antenna's position, where it is stated: a zero states nothing, as in a covariance. Raises `InputError` where
    there is nothing to estimate.
    """
    # marginals: the fits of flight, mount and sky take priors that are independent of each other
    chosen: dict[str, float] = {}
    for station in rig.stations:
        sigmas = rig.station_covariance(station.name).sigmas
        chosen.update({f"{station.name}.{name}": s for name, s in _of_station(station, sigmas, words).items()})
    if "antenna" in words:
        stated = np.zeros(3) if antenna_sigma_m is None else antenna_sigma_m
        chosen.update({name: float(s) or KNOWN_ANTENNA_M for name, s in zip(ANTENNA, stated, strict=True)})
    if not chosen:
        got = "a rig without unknown parameters"
        raise InputError(rig.path or "rig", got=got, wanted="--free LIST with some of " + ", ".join(FREE_WORDS))
    if dgps_clock_open:
        chosen[DGPS_OFFSET] = DGPS_CLOCK_S
    return FreeParameters(names=tuple(chosen), prior_sigma=np.array(list(chosen.values()), dtype=np.float64))


def _of_station(station: Station, sigmas: Mapping[str, float], words: Sequence[str]) -> dict[str, float]:
    """Return a station's parameters and prior sigmas; ``sigmas`` are those that the rig states, if any, not zero."""
    chosen: dict[str, float] = {}
    groups = (
        ("runway_from_base", "orientation", KNOWN_ROTATION_RAD),
        ("ptu_position", "position", KNOWN_POSITION_M),
    )
    for group, part, sigma in groups:
        if part not in station.known:
            chosen.update({f"{group}.{axis}": np.inf for axis in AXES})
        elif part in words:
            chosen.update({f"{group}.{axis}": sigmas.get(f"{group}.{axis}") or sigma for axis in AXES})
    if "boresight" in words:
        for axis in AXES:
            name = f"head_from_camera.{axis}"
            chosen[name] = sigmas.get(name) or KNOWN_ROTATION_RAD
    if "lens" in words:
        lens = [(f"focal.{axis}", KNOWN_FOCAL_SHARE * float(station.lens.focal_px[0])) for axis in "xy"]
        lens += [(f"principal_point.{axis}", KNOWN_PRINCIPAL_POINT_PX) for axis in "xy"]
        lens += [(f"distortion.{name}", KNOWN_DISTORTION) for name in ("k1", "k2")]
        chosen.update({name: sigmas.get(name) or sigma for name, sigma in lens})
    clocks = {"camera_clock": station.camera_clock or ClockModel()}
    if not station.fixed:
        clocks["ptu_clock"] = station.ptu_clock
    for clock, model in clocks.items():
        if model.sigma_s > 0.0 or clock in words:
            # naming a parameter overrides the rig's value of it
            chosen[f"{clock}.offset"] = max(model.sigma_s, KNOWN_CLOCK_S if clock in words else 0.0)
    if "drift" in words:
        chosen["camera_clock.drift"] = KNOWN_DRIFT
    if "readout" in words:
        chosen["readout"] = station.readout_sigma_s or KNOWN_READOUT_S
    return chosen
