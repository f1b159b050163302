"""A day drawn from a seed: airliners that pass two heads, the heads' pictures of them, and the receiver's positions."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.sky.adsb import FOOT_M, AdsbReport
from calibration.sky.aircraft_mark import lift_below
from calibration.sky.day import SkyPicture
from calibration.sky.sky_fit import KNOWN_CENTRE_PX, KNOWN_DISTORTION, KNOWN_FOCAL_SHARE
from calibration.sky.sky_objects import SkyObjects
from calibration.stars.simulated.night_draw import NightErrors, drawn_station, pedestals, with_errors
from calibration.stars.sky import ObservingSite
from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef, runway_axes
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_z, wxyz_from_matrix
from groundstation.rig.rig import Rig, Station

_NOON_UTC_S = 1_779_364_800.0
_PASS_EACH_S = 400.0
_HALF_PAN_RAD, _TILT_RAD = float(np.radians(60.0)), (float(np.radians(8.0)), float(np.radians(58.0)))
_STOP_EACH_S, _PICTURE_EACH_S = 18.0, 0.7
# a rig that was calibrated before its heads were put up here: the sigmas are those that the fit takes
DAY_ERRORS = NightErrors(
    base_deg=1.0,
    boresight_deg=0.5,
    scale=0.001,
    lean_deg=0.05,
    backlash_deg=0.01,
    sag_deg=0.02,
    periodic_deg=0.02,
)
_HEADING_DEG = 1.5
_FIELD_DEG, _STEP_DEG = 10.96, 0.00625
_SPAN_M = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AdsbErrors:
    """What is drawn of positions: m, s. ``latency_s`` is the receiver's at most, ``own_latency_s`` an aircraft's."""

    latency_s: float = 2.0
    own_latency_s: float = 0.4
    jitter_s: float = 0.05
    horizontal_m: float = 6.0
    vertical_m: float = 10.0
    lasts_s: float = 100.0
    cpr_m: float = 5.0
    step_m: float = 25.0 * FOOT_M
    antenna_m: float = 8.0
    each_s: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airliner:
    """One airliner: where it is nearest, m, its velocity, m/s, its rate of turn, rad/s, and when it is there."""

    nearest_m: FloatArray
    velocity_m_s: FloatArray
    turn_rad_s: float
    utc_s: float

    def at(self, utc_s: FloatArray) -> FloatArray:
        """Return its places (n, 3), runway frame, m."""
        t = np.asarray(utc_s) - self.utc_s
        speed, heading = float(np.hypot(*self.velocity_m_s[:2])), float(np.arctan2(*self.velocity_m_s[:2]))
        if abs(self.turn_rad_s) < 1e-6:
            level = self.velocity_m_s[:2] * t[:, None]
        else:
            now = heading + self.turn_rad_s * t
            radius = speed / self.turn_rad_s
            level = radius * np.column_stack([np.cos(heading) - np.cos(now), np.sin(now) - np.sin(heading)])
        return np.asarray(self.nearest_m + np.column_stack([level, self.velocity_m_s[2] * t]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnDay:
    """A day: the site, the rig as it is known and as it is, what a calibration gets, and the receiver's latency."""

    site: ObservingSite
    rig: Rig
    true_rig: Rig
    pictures: tuple[SkyPicture, ...]
    reports: dict[str, tuple[AdsbReport, ...]]
    latency_s: float
    refraction: float


def draw_day(
    seed: int,
    passes: int = 5,
    stops: int = 12,
    pictures: int = 3,
    errors: NightErrors = DAY_ERRORS,
    receiver: AdsbErrors = AdsbErrors(),
) -> DrawnDay:
    """Draw a day: each pass is followed by both heads with ``stops`` of each, and ``pictures`` at each stop."""
    random = np.random.default_rng([seed, 0xADB])
    site = ObservingSite(
        lat_deg=float(random.uniform(-60.0, 60.0)),
        lon_deg=float(random.uniform(-180.0, 180.0)),
        height_m=float(random.uniform(0.0, 900.0)),
        y_axis_azimuth_deg=float(random.uniform(0.0, 360.0)),
        pressure_hpa=980.0,
        air_c=8.0,
    )
    known = Rig(stations=tuple(drawn_station(name, x, _FIELD_DEG, _STEP_DEG) for name, x in pedestals()))
    true = replace(known, stations=tuple(_put_up(with_errors(s, errors, random), random) for s in known.stations))
    latency = float(random.uniform(0.0, receiver.latency_s))
    refraction = float(random.normal(0.0, 0.01))
    taken: list[SkyPicture] = []
    reports: dict[str, tuple[AdsbReport, ...]] = {}
    for number in range(passes):
        airliner = _airliner(random, _NOON_UTC_S + _PASS_EACH_S * number)
        times = _visible(airliner, stops)
        for station, before in zip(true.stations, known.stations, strict=True):
            follow = _Follow(airliner=airliner, station=station, before=before, refraction=refraction)
            taken += _pictures(follow, times, pictures, random)
        name = f"{0x3C0000 + number:06x}"
        reports[name] = _reports(name, airliner, times, site, latency, receiver, random)
    return DrawnDay(
        site=site,
        rig=known,
        true_rig=true,
        pictures=tuple(sorted(taken, key=lambda p: p.utc_s)),
        reports=reports,
        latency_s=latency,
        refraction=refraction,
    )


def _put_up(station: Station, random: np.random.Generator) -> Station:
    """Return a station whose head was also turned by eye, with a lens that is known as a calibration leaves it."""
    turn = rotation_z(float(np.radians(random.normal(0.0, _HEADING_DEG))))
    lens = drawn_station(station.name, 0.0, _FIELD_DEG, 0.0).lens
    return replace(
        station,
        runway_from_base_wxyz=wxyz_from_matrix(turn @ matrix_from_wxyz(station.runway_from_base_wxyz)),
        lens=replace(
            lens,
            focal_px=lens.focal_px * (1.0 + random.normal(0.0, KNOWN_FOCAL_SHARE, 2)),
            principal_point_px=lens.principal_point_px + random.normal(0.0, KNOWN_CENTRE_PX, 2),
            distortion=np.array([*random.normal(0.0, list(KNOWN_DISTORTION.values())), 0.0]),
        ),
    )


def _airliner(random: np.random.Generator, utc_s: float) -> Airliner:
    # the heads look at near ones high up and at far ones low down
    aside, away = np.radians(random.uniform(-40.0, 40.0)), 8_000.0 * 6.0 ** random.uniform()
    heading, speed = random.uniform(0.0, 2.0 * np.pi), random.uniform(200.0, 260.0)
    return Airliner(
        nearest_m=np.array([away * np.sin(aside), away * np.cos(aside), random.uniform(8_000.0, 12_000.0)]),
        velocity_m_s=np.array([speed * np.sin(heading), speed * np.cos(heading), random.choice([0.0, 0.0, 5.0])]),
        turn_rad_s=float(random.choice([0.0, 0.0, np.radians(0.3), np.radians(-0.3)])),
        utc_s=utc_s,
    )


def _visible(airliner: Airliner, stops: int) -> FloatArray:
    """Return the times of up to so many stops, each while it is in front of the heads."""
    times = np.asarray(airliner.utc_s + _STOP_EACH_S * (np.arange(4 * stops) - 2 * stops), dtype=np.float64)
    place = airliner.at(times)
    pan = np.arctan2(-place[:, 0], place[:, 1])
    tilt = np.arctan2(place[:, 2], np.hypot(place[:, 0], place[:, 1]))
    good = (np.abs(pan) < _HALF_PAN_RAD) & (tilt > _TILT_RAD[0]) & (tilt < _TILT_RAD[1])
    near = np.flatnonzero(good)
    order = near[np.argsort(np.abs(times[near] - airliner.utc_s), kind="stable")][:stops]
    return np.asarray(np.sort(times[order]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Follow:
    """A head that follows an airliner."""

    airliner: Airliner
    station: Station
    before: Station
    refraction: float


def _pictures(follow: _Follow, times: FloatArray, count: int, random: np.random.Generator) -> list[SkyPicture]:
    station, step = follow.station, follow.station.ptu_resolution_rad
    field = np.array(station.lens.image_size_px) / station.lens.focal_px
    taken = []
    for number, begin in enumerate(times):
        instants = np.asarray(begin + random.uniform(0.0, 0.5) + _PICTURE_EACH_S * np.arange(count), dtype=np.float64)
        places = follow.airliner.at(instants)
        # an operator who sees it in a picture brings it back: it is somewhere in it, whatever the rig says
        aim = aim_at(station.geometry(), places.mean(axis=0))
        if aim is None:
            continue
        off = random.uniform(-0.3, 0.3, 2) * field
        sense = random.choice([-1.0, 1.0], 2)
        stands = np.array(station.ptu_axes.readings(aim.pan_rad, aim.tilt_rad, *sense)) + off
        reading = np.round(stands / step) * step
        angles = station.ptu_axes.angles(float(stands[0]), float(stands[1]), *sense.tolist())
        for k, (utc_s, place) in enumerate(zip(instants.tolist(), places, strict=True)):
            taken.append(
                SkyPicture(
                    label=f"{station.name}-{utc_s:.1f}-{number}-{k}.png",
                    station=station.name,
                    reading_rad=reading,
                    sense=sense,
                    utc_s=utc_s,
                    seen=_seen(follow, place, angles, random),
                )
            )
    return taken


def _seen(follow: _Follow, place: FloatArray, angles: tuple[float, float], random: np.random.Generator) -> SkyObjects:
    """Return what is found in a picture: the airliner mostly, and now and then birds and edges of clouds."""
    station = follow.station
    away = place - station.ptu_position_m
    distance = float(np.linalg.norm(away))
    lifted = (1.0 + follow.refraction) * distance * lift_below(away[None])[0]
    projected = station.geometry().project(place + lifted, *angles)
    w, h = station.lens.image_size_px
    others = random.uniform((0.0, 0.0), (w, h), (int(random.integers(0, 4)), 2))
    rows = [(float(u), float(v), 8.0) for u, v in others]
    if projected is not None and random.uniform() > 0.1:
        extent = float(station.lens.focal_px[0]) * _SPAN_M / distance
        pixel = projected.pixel + random.normal(0.0, np.hypot(0.3, 0.03 * extent), 2)
        if 0.0 <= pixel[0] <= w - 1 and 0.0 <= pixel[1] <= h - 1:
            rows.insert(int(random.integers(0, len(rows) + 1)), (float(pixel[0]), float(pixel[1]), extent))
    table = np.array(rows).reshape(-1, 3)
    return SkyObjects(pixel_px=table[:, :2], sigma_px=np.hypot(0.3, 0.03 * table[:, 2]), extent_px=table[:, 2])


def _reports(
    name: str,
    airliner: Airliner,
    times: FloatArray,
    site: ObservingSite,
    latency_s: float,
    errors: AdsbErrors,
    random: np.random.Generator,
) -> tuple[AdsbReport, ...]:
    """Return what the receiver notes: late places with lasting errors of GNSS, in steps, with later stamps."""
    if not len(times):
        return ()
    t = np.arange(float(times[0]) - 30.0, float(times[-1]) + 40.0, errors.each_s)
    own = random.uniform(0.0, errors.own_latency_s)
    place = airliner.at(t - own)
    forward = airliner.velocity_m_s / np.linalg.norm(airliner.velocity_m_s)
    place = place + random.uniform(-1.0, 1.0) * errors.antenna_m * forward
    sigma = np.array([errors.horizontal_m, errors.horizontal_m, errors.vertical_m])
    place = place + sigma * _lasting(len(t), errors.each_s / errors.lasts_s, random)
    place[:, :2] = np.round(place[:, :2] / errors.cpr_m) * errors.cpr_m
    east_north_up = place @ runway_axes(site.y_axis_azimuth_deg)
    lat, lon, height = geodetic_from_ecef(ecef_from_enu(east_north_up, (site.lat_deg, site.lon_deg, site.height_m)))
    height = np.round(height / errors.step_m) * errors.step_m
    stamps = np.round(t + latency_s + random.exponential(errors.jitter_s, len(t)), 1)
    heard = random.uniform(size=len(t)) > 0.1
    return tuple(
        AdsbReport(
            aircraft=name,
            t_s=float(stamps[k]),
            lat_deg=float(lat[k]),
            lon_deg=float(lon[k]),
            height_m=float(height[k]),
            geometric=True,
        )
        for k in np.flatnonzero(heard)
    )


def _lasting(count: int, share: float, random: np.random.Generator) -> FloatArray:
    """Return a Gauss-Markov sequence (n, 3) of sigma one."""
    keep = float(np.exp(-share))
    fresh = random.normal(size=(count, 3))
    out = np.zeros((count, 3))
    out[0] = fresh[0]
    for k in range(1, count):
        out[k] = keep * out[k - 1] + np.sqrt(1.0 - keep**2) * fresh[k]
    return out
