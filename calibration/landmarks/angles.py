"""Weights of a station's readings of landmarks: angles by its axes' calibration, variances that count repeats."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sightings import LandmarkSighting
from groundstation.arrays import FloatArray
from groundstation.rig.rig import Station

_HARMONICS = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkObservations:
    """One station's n observations of landmarks, of one day.

    Attributes
    ----------
    today : whether the mount may have moved since the other observations, or since the rig was calibrated.
    landmark : (n,) index of each observation's landmark in the problem's list.
    angles_rad : (n, 2) pan and tilt, by the rig's `ptu_axes`; zero of a fixed station.
    pixel_px : (n, 2) u, v.
    pixel_variance : (n,) of each axis, px²; ``angle_variance`` (n,) of each angle, rad².
    """

    station: str
    today: bool
    landmark: NDArray[np.int64]
    angles_rad: FloatArray
    pixel_px: FloatArray
    pixel_variance: FloatArray
    angle_variance: FloatArray
    sightings: tuple[LandmarkSighting, ...]

    def __len__(self) -> int:
        return len(self.landmark)


def gather_observations(
    sightings: Sequence[LandmarkSighting], station: Station, landmarks: Mapping[str, int], *, today: bool = False
) -> LandmarkObservations:
    """Return the observations of one station in a table of sightings; ``landmarks`` maps a name to its position."""
    own = tuple(s for s in sightings if s.station == station.name)
    angles = np.zeros((len(own), 2))
    if not station.fixed:
        axes = station.ptu_axes
        for k, s in enumerate(own):
            angles[k] = axes.angles(s.pan_rad, s.tilt_rad, s.pan_from, s.tilt_from)
    stops = stops_of(own, station)
    pixel = np.array([s.pixel_px for s in own]).reshape(-1, 2)
    return LandmarkObservations(
        station=station.name,
        today=today,
        landmark=np.array([landmarks[s.landmark] for s in own], dtype=np.int64),
        angles_rad=angles,
        pixel_px=pixel,
        pixel_variance=np.array([s.sigma_px**2 for s in own]) * _copies(pixel, stops),
        angle_variance=_angle_variance(station, stops),
        sightings=own,
    )


def stops_of(sightings: Sequence[LandmarkSighting], station: Station) -> NDArray[np.int64]:
    """Return for each sighting (n,) the number of its stop: the PTU stands, one landmark is seen again and again."""
    within = 8.0 * station.angle_sigma_rad + station.ptu_resolution_rad
    numbers = np.zeros(len(sightings), dtype=np.int64)
    for k in range(1, len(sightings)):
        a, b = sightings[k - 1], sightings[k]
        apart = max(abs(a.pan_rad - b.pan_rad), abs(a.tilt_rad - b.tilt_rad))
        stands = a.landmark == b.landmark and (station.fixed or apart <= within)
        numbers[k] = numbers[k - 1] + (0 if stands else 1)
    return numbers


def lasting_variance(step_rad: float, sigma_rad: float) -> float:
    """Return the variance, rad², of a step's error that reading again does not average out.

    An axis that stands anywhere within a step and is read with noise sigma: the mean reading is off by
    (s/π) Σ (−1)^k/k · exp(−2π²k²σ²/s²) · sin(2πkx/s); its mean square is s²/12 without noise, and almost nothing
    once the noise reaches half a step.
    """
    if step_rad <= 0.0:
        return 0.0
    k = np.arange(1, _HARMONICS + 1)
    shares = np.exp(-((2.0 * np.pi * k * sigma_rad / step_rad) ** 2)) / k**2
    return float(min(step_rad**2 / (2.0 * np.pi**2) * shares.sum(), step_rad**2 / 12.0))


def reading_variances(station: Station) -> tuple[float, float]:
    """Return the variance, rad², of an angle's error that lasts while a head is at rest, and of each reading's own."""
    # of no noise at all the sum over harmonics is an even twelfth of the step
    lasting = (
        lasting_variance(station.ptu_resolution_rad, station.ptu_sigma_rad)
        if station.ptu_sigma_rad > 0.0
        else station.ptu_resolution_rad**2 / 12.0
    )
    return lasting, max(station.angle_sigma_rad**2 - lasting, 0.0)


def _angle_variance(station: Station, stops: NDArray[np.int64]) -> FloatArray:
    """Return each observation's variance such that the mean over a stop has the correct variance."""
    if station.fixed:
        return np.zeros(len(stops))
    lasting, fleeting = reading_variances(station)
    return np.asarray(fleeting + lasting * np.bincount(stops)[stops])


def _copies(pixel_px: FloatArray, stops: NDArray[np.int64]) -> FloatArray:
    """Return the number (n,) of copies of each observation's pixel in its stop: the same picture counts once."""
    if not len(stops):
        return np.zeros(0)
    key = np.column_stack([stops, pixel_px])
    _, place, counts = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(counts[place.ravel()], dtype=np.float64)
