"""Drawing stations: a baseline, heights, heads of several makes, and calibration errors from the stated sigmas."""

import math

import numpy as np

from groundstation.simulation.drawn_stations.station_spec import (
    CalibrationSpec,
    ClockSpec,
    DgpsQuality,
    DgpsSpec,
    HeadSpec,
    StationSpec,
    StationsSpec,
    TimeSpan,
)
from groundstation.simulation.parameter_checks import require_positive

_DEG = math.radians(1.0)
_NAMES = ("left", "right", "third", "fourth")
# share of worlds with two, three and four stations
_COUNTS = (0.65, 0.25, 0.10)
_BASELINE_M = (5.0, 40.0)
_HEIGHT_M = (1.0, 6.0)
_FAR_SHARE = 0.5
_LATE_SHARE = 0.2
_STALL_SHARE = 0.15
# one sigma of a calibration of the middle sort: levelling, orientation by a mark, boresight by stars, surveyed tripod,
# lens by a board; a world's own is a third to three times as good
_MOUNT_RAD = (0.01 * _DEG, 0.01 * _DEG, 0.02 * _DEG)
_BORESIGHT_RAD = (0.008 * _DEG, 0.03 * _DEG, 0.008 * _DEG)
_POSITION_M = (0.01, 0.02, 0.01)
_FOCAL_SHARE, _ASPECT_SHARE, _PRINCIPAL_POINT_PX = 1e-3, 2e-4, 1.0
_QUALITY = (1.0 / 3.0, 3.0)
# encoder steps from none to a geared servo's; 0.00625° is that of the standard site
_STEPS_DEG = (0.0, 0.003, 0.00625, 0.0125, 0.02)
# a clock of a computer without synchronisation; ± 50 ms are three of these sigmas
_CLOCK_SIGMA_S = 0.017
_CLOCK_OFFSET_S = 0.05
_DRIFT_SIGMA_PPM = 15.0


def draw_stations(generator: np.random.Generator, *, duration_s: float = 20.0, span_m: float = 2.3) -> StationsSpec:
    """Draw the stations of a world for a flight from 0 to ``duration_s`` of an aircraft with a wing span."""
    require_positive("draw_stations: duration_s", duration_s)
    require_positive("draw_stations: span_m", span_m)
    count = 2 + int(generator.choice(3, p=_COUNTS))
    places = _places(generator, count)
    quality = math.exp(generator.uniform(math.log(_QUALITY[0]), math.log(_QUALITY[1])))
    synchronised = bool(generator.uniform() < 0.7)
    late = bool(generator.uniform() < _LATE_SHARE)
    stations = []
    for name, place in zip(_NAMES[:count], places, strict=True):
        head = _head(generator, duration_s, late=late)
        stations.append(
            StationSpec(
                name=name,
                position_m=place,
                mount_rad=_normal(generator, (0.3 * _DEG,) * 3),
                boresight_rad=_normal(generator, (0.3 * _DEG,) * 3),
                camera_in_head_m=(
                    generator.uniform(-0.03, 0.03),
                    generator.uniform(0.0, 0.1),
                    generator.uniform(0.0, 0.1),
                ),
                calibration=_calibration(generator, quality),
                head=head,
                ptu_clock=_clock(generator, synchronised=synchronised),
                camera_clock=_clock(generator, synchronised=synchronised),
            )
        )
    return StationsSpec(stations=tuple(stations), dgps=_dgps(generator, duration_s, span_m))


def _places(generator: np.random.Generator, count: int) -> list[tuple[float, float, float]]:
    """Draw the stations' positions: two on either side of the runway's near end, others further on."""
    half_m = 0.5 * generator.uniform(*_BASELINE_M)
    staggered_m = generator.uniform(-3.0, 3.0)
    places = [(side * half_m, 0.5 * side * staggered_m, generator.uniform(*_HEIGHT_M)) for side in (-1.0, 1.0)]
    sides = [1.0, -1.0] if generator.uniform() < 0.5 else [-1.0, 1.0]
    for number in range(count - 2):
        far = number == 0 and generator.uniform() < _FAR_SHARE
        y_m = generator.uniform(250.0, 450.0) if far else generator.uniform(20.0, 150.0)
        x_m = sides[number] * generator.uniform(20.0, 45.0)
        places.append((x_m, y_m, generator.uniform(*_HEIGHT_M)))
    return places


def _normal(generator: np.random.Generator, sigmas: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (generator.normal() * sigma for sigma in sigmas)
    return x, y, z


def _calibration(generator: np.random.Generator, quality: float) -> CalibrationSpec:
    """Draw sigmas about a world's quality (1 is the middle sort, more is worse), and errors from these sigmas."""

    def sigmas(usual: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (s * quality * generator.uniform(0.7, 1.4) for s in usual)
        return x, y, z

    mount, boresight, position = sigmas(_MOUNT_RAD), sigmas(_BORESIGHT_RAD), sigmas(_POSITION_M)
    focal, aspect = _FOCAL_SHARE * quality, _ASPECT_SHARE * quality
    centre = _PRINCIPAL_POINT_PX * quality
    readout = generator.uniform(1e-4, 1e-3)
    return CalibrationSpec(
        mount_sigma_rad=mount,
        mount_error_rad=_normal(generator, mount),
        boresight_sigma_rad=boresight,
        boresight_error_rad=_normal(generator, boresight),
        position_sigma_m=position,
        position_error_m=_normal(generator, position),
        focal_sigma_share=focal,
        focal_error_share=generator.normal() * focal,
        aspect_sigma_share=aspect,
        aspect_error_share=(generator.normal() * aspect, generator.normal() * aspect),
        principal_point_sigma_px=centre,
        principal_point_error_px=(generator.normal() * centre, generator.normal() * centre),
        readout_sigma_s=readout,
        readout_error_s=generator.normal() * readout,
    )


def _clock(generator: np.random.Generator, *, synchronised: bool) -> ClockSpec:
    """Draw a clock with an offset stated to a millisecond, or with a stated sigma only."""
    if synchronised:
        offset_s, sigma_s = generator.uniform(-_CLOCK_OFFSET_S, _CLOCK_OFFSET_S), generator.uniform(2e-4, 2e-3)
    else:
        offset_s, sigma_s = 0.0, _CLOCK_SIGMA_S * generator.uniform(0.3, 1.0)
    return ClockSpec(
        offset_s=offset_s,
        error_s=generator.normal() * sigma_s,
        sigma_s=sigma_s,
        drift_error_ppm=generator.normal() * _DRIFT_SIGMA_PPM,
        drift_sigma_ppm=_DRIFT_SIGMA_PPM,
    )


def _head(generator: np.random.Generator, duration_s: float, *, late: bool) -> HeadSpec:
    step_rad = float(generator.choice(_STEPS_DEG)) * _DEG
    # either the noise is larger than the step, or the step hides noise and play alike: an encoder of stated noise that
    # repeats its reading counts as frozen
    noisy = step_rad == 0.0 or generator.uniform() < 0.5
    if noisy:
        sigma_rad = max(0.6 * step_rad, generator.uniform(0.001, 0.02) * _DEG)
        backlash_rad = generator.uniform(0.0, 0.02) * _DEG
    else:
        sigma_rad, backlash_rad = generator.uniform(0.05, 0.15) * step_rad, generator.uniform(0.0, 0.8) * step_rad
    rate_hz = float(np.exp(generator.uniform(math.log(10.0), math.log(100.0))))
    stalls: tuple[TimeSpan, ...] = ()
    if generator.uniform() < _STALL_SHARE:
        start = generator.uniform(0.2, 0.8) * duration_s
        stalls = (TimeSpan(from_s=start, to_s=start + generator.uniform(0.3, 2.0)),)
    late_sides = [math.copysign(generator.uniform(1.1, 2.5), generator.uniform(-1.0, 1.0)) for _ in range(2)]
    late_s = generator.uniform(0.025, 0.15) * duration_s
    return HeadSpec(
        resolution_rad=step_rad,
        encoder_sigma_rad=sigma_rad,
        rate_hz=rate_hz,
        phase_s=generator.uniform(0.0, 1.0) / rate_hz,
        delay_s=generator.uniform(0.0, 0.03),
        delay_jitter_s=generator.uniform(0.0, 0.01),
        natural_rad_s=generator.uniform(8.0, 25.0),
        damping=generator.uniform(0.6, 1.1),
        command_delay_s=generator.uniform(0.02, 0.12),
        max_rate_rad_s=generator.uniform(0.8, 2.0),
        max_acceleration_rad_s2=generator.uniform(3.0, 15.0),
        backlash_rad=backlash_rad,
        aim_sigma_share=generator.uniform(0.05, 0.45),
        aim_correlation_s=generator.uniform(0.7, 3.0),
        late_s=late_s if late else 0.0,
        late_pan_share=late_sides[0] if late else 0.0,
        late_tilt_share=0.3 * late_sides[1] if late else 0.0,
        stalls=stalls,
    )


def _dgps(generator: np.random.Generator, duration_s: float, span_m: float) -> DgpsSpec | None:
    kind = generator.choice([*DgpsQuality, "none"], p=[0.5, 0.1, 0.25, 0.15])
    if kind == "none":
        return None
    quality = DgpsQuality(str(kind))
    white, wander, rates = {
        DgpsQuality.RTK: (0.015, 0.01, (5.0, 10.0, 20.0)),
        DgpsQuality.FLOAT: (0.05, 0.35, (5.0, 10.0)),
        DgpsQuality.METRE: (0.2, 1.2, (1.0, 5.0, 10.0)),
    }[quality]
    scale = generator.uniform(0.7, 1.5)
    gaps: tuple[TimeSpan, ...] = ()
    if generator.uniform() < 0.25:
        start = generator.uniform(0.1, 0.8) * duration_s
        gaps = (TimeSpan(from_s=start, to_s=start + generator.uniform(1.0, 4.0)),)
    rate_hz = float(generator.choice(rates))
    return DgpsSpec(
        quality=quality,
        rate_hz=rate_hz,
        phase_s=generator.uniform(0.0, 1.0) / rate_hz,
        # heights are twice as uncertain as places: no satellites below
        sigma_m=(white * scale, white * scale, 2.0 * white * scale),
        wander_sigma_m=(wander * scale, wander * scale, 2.0 * wander * scale),
        wander_s=generator.uniform(30.0, 200.0),
        clock_offset_s=generator.uniform(-0.05, 0.4),
        antenna_in_body_m=(-span_m * generator.uniform(0.1, 0.4), 0.0, -span_m * generator.uniform(0.02, 0.08)),
        gaps=gaps,
    )
