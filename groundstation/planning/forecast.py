"""Expected accuracy over range, and its error budget (docs/derivation.md, section 11)."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.evaluation.calibration_bounds import ConsiderBound, fix_consider, track_consider
from groundstation.planning.observer import Observation, Observer
from groundstation.planning.site import Site

PIXEL_NOISE, ENCODER_NOISE = "pixel noise", "encoder noise"
# where the aircraft is before it is first seen, and how fast, 1 sigma
_PRIOR_POSITION_M, _PRIOR_VELOCITY_M_S = 10.0, 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forecast:
    """Expected accuracy at each of n ranges; rows of ``fix_…`` hold where ``fix_known``, of ``track_…`` likewise.

    Attributes
    ----------
    range_m : (n,) y, rising.
    fix_noise_m, fix_sigma_m : (n, 3) 1 sigma of x, y, z of one pair of frames: noise only, and with the calibration.
    track_noise_m, track_sigma_m : (n, 3) the same of a track that began at the far end.
    groups : words for the parts of the error; pixel and encoder noise are the first two.
    share : (n, 3, groups) part of the variance of each axis, of the track where known, else of one fix.
    silhouette_px, field_m : (n,) the smallest silhouette and picture width of the stations that look at it.
    turn_rad_s : (n,) the fastest turning rate of any PTU.
    stations : (n,) how many stations can look at it.
    """

    range_m: FloatArray
    fix_known: MaskArray
    fix_noise_m: FloatArray
    fix_sigma_m: FloatArray
    track_known: MaskArray
    track_noise_m: FloatArray
    track_sigma_m: FloatArray
    groups: tuple[str, ...]
    share: FloatArray
    silhouette_px: FloatArray
    field_m: FloatArray
    turn_rad_s: FloatArray
    stations: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """A track down the glide: its bound, and the range (k,) of each frame with whether a fix was had by then (k,)."""

    bound: ConsiderBound
    y_m: FloatArray
    began: MaskArray


def forecast(site: Site, track: Track | None = None) -> Forecast:
    """Compute the forecast of a site; ``track`` is its `track_down` where that is known, the same for every step."""
    observer = Observer(site)
    covariance = observer.sources.covariance
    groups = (PIXEL_NOISE, ENCODER_NOISE, *dict.fromkeys(observer.sources.groups))
    if track is None:
        track = track_down(site)
    ranges_m = site.ranges_m()
    n = len(ranges_m)
    known = {"fix": np.zeros(n, dtype=bool), "track": np.zeros(n, dtype=bool)}
    noise, total = ({kind: np.zeros((n, 3)) for kind in known} for _ in range(2))
    share = np.zeros((n, 3, len(groups)))
    seen = np.zeros((n, 4))
    for row, y_m in enumerate(ranges_m):
        point = site.aircraft.position_m(float(y_m))
        observations = observer.observations(point, site.aircraft.velocity_m_s(float(y_m)))
        if observations:
            seen[row] = (
                len(observations),
                min(s.silhouette_px for s in observations),
                min(s.field_m for s in observations),
                max(s.turn_rad_s for s in observations),
            )
        fix = fix_consider(observer.information(point, observations))
        if fix is None:
            continue
        frame = int(np.argmin(np.abs(track.y_m - y_m)))
        bounds = {"fix": fix}
        if track.began[frame]:
            whole = track.bound
            bounds["track"] = ConsiderBound(noise=whole.noise[frame, :3, :3], sensitivity=whole.sensitivity[frame, :3])
        for kind, bound in bounds.items():
            known[kind][row] = True
            noise[kind][row] = np.sqrt(np.diag(bound.noise))
            total[kind][row] = np.sqrt(np.diag(bound.covariance(covariance)))
        best = bounds.get("track", fix)
        share[row] = _shares(
            best, covariance, observer.sources.groups, groups, _pixel_part(point, observations, fix.noise)
        )
    return Forecast(
        range_m=ranges_m,
        fix_known=known["fix"],
        fix_noise_m=noise["fix"],
        fix_sigma_m=total["fix"],
        track_known=known["track"],
        track_noise_m=noise["track"],
        track_sigma_m=total["track"],
        groups=groups,
        share=share,
        stations=seen[:, 0],
        silhouette_px=seen[:, 1],
        field_m=seen[:, 2],
        turn_rad_s=seen[:, 3],
    )


def track_down(site: Site) -> Track:
    """Follow the aircraft down from the far end at the frame rate, from where it is wide enough to be found."""
    observer = Observer(site)
    path_per_s = -float(site.aircraft.velocity_m_s(site.to_m)[1])
    t_s = np.arange(0.0, (site.to_m - site.from_m) / path_per_s + 1.0 / site.frame_rate_hz, 1.0 / site.frame_rate_hz)
    y_m = site.to_m - path_per_s * t_s
    joint, fixed = [], []
    for y in y_m:
        point = site.aircraft.position_m(float(y))
        observations = observer.observations(point, site.aircraft.velocity_m_s(float(y)))
        wide = [s for s in observations if s.silhouette_px >= site.min_silhouette_px]
        joint.append(observer.information(point, wide))
        fixed.append(len(wide) > 1)
    psd = np.array(site.aircraft.acceleration_psd_m2_s3)
    bound = track_consider(t_s, np.array(joint), psd, _PRIOR_POSITION_M, _PRIOR_VELOCITY_M_S)
    return Track(bound=bound, y_m=y_m, began=np.logical_or.accumulate(fixed))


def _pixel_part(point: FloatArray, observations: list[Observation], noise: FloatArray) -> FloatArray:
    """Return the part (3,) of a fix's noise variance that the pixels make; the encoders make the rest."""
    part = np.zeros((3, 3))
    for s in observations:
        projected = s.view.geometry.project(point, s.view.pan_rad, s.view.tilt_rad)
        if projected is None:
            continue
        J, by_angle = projected.jacobian[:, :3], projected.jacobian[:, 3:]
        R = s.view.pixel_covariance_px2
        weighted = np.linalg.solve(R + s.view.angle_sigma_rad**2 * by_angle @ by_angle.T, J)
        part += weighted.T @ R @ weighted
    return np.asarray(np.diag(noise @ part @ noise) / np.diag(noise), dtype=np.float64)


def _shares(
    bound: ConsiderBound,
    covariance: FloatArray,
    source_groups: tuple[str, ...],
    groups: tuple[str, ...],
    pixel_part: FloatArray,
) -> FloatArray:
    """Return the part (3, groups) of each axis's variance; what groups share by correlation is halved."""
    S = bound.sensitivity
    # row sums of S ∘ (S P): one column for each source, adding up to the floor's diagonal
    by_source = S * (S @ covariance)
    variance = np.diag(bound.noise)
    parts = np.zeros((3, len(groups)))
    parts[:, 0], parts[:, 1] = variance * pixel_part, variance * (1.0 - pixel_part)
    for k, name in enumerate(source_groups):
        parts[:, groups.index(name)] += by_source[:, k]
    return parts / np.maximum(parts.sum(axis=1, keepdims=True), 1e-300)


def site_map(site: Site, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    """Return 1 sigma (rows of y, columns of x) in m of the worst axis of one fix, with the calibration.

    At the height of the glide path; NaN where no two stations look.
    """
    observer = Observer(site)
    sigma = np.full((len(y_m), len(x_m)), np.nan)
    for i, y in enumerate(y_m):
        velocity = site.aircraft.velocity_m_s(float(y))
        for j, x in enumerate(x_m):
            point = site.aircraft.position_m(float(y), float(x))
            bound = fix_consider(observer.information(point, observer.observations(point, velocity)))
            if bound is not None:
                sigma[i, j] = np.sqrt(np.diag(bound.covariance(observer.sources.covariance)).max())
    return sigma
