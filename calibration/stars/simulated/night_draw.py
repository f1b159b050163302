"""A night drawn from a seed: two heads with unknown mounts, axes and lenses, the readings of their pictures, times."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.stars.pointing_plan import HeadRange, Pointing, plan_pointings
from calibration.stars.sky import ObservingSite, SkyOverSite
from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_from_vector, rotation_x, wxyz_from_matrix
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import PARTS, ClockModel, Rig, Station

# evenings of a year at a place in central Europe
_FIRST_UTC_S = 1_767_290_400.0
_DAY_S = 86_400.0
_BASELINE_M = 10.77
_HALF_RANGE_DEG = 60.0
_TILT_DEG = (0.0, 58.0)
_PICTURE_EACH_S = 12.0
_MOST_DAYS = 40
# of a picture: half a second at 50 Hz
READINGS = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class NightErrors:
    """One sigma of what is drawn: angles in degrees, scale and focal length as a share, clock in s, pixels in px.

    ``backlash_deg`` and ``sag_deg`` are the values themselves.
    """

    base_deg: float = 1.0
    boresight_deg: float = 0.5
    scale: float = 0.005
    lean_deg: float = 0.05
    backlash_deg: float = 0.01
    sag_deg: float = 0.005
    periodic_deg: float = 0.005
    focal: float = 0.01
    principal_point_px: float = 10.0
    k1: float = 0.1
    clock_s: float = 0.05
    refraction: float = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NightPicture:
    """One exposure: the mean of ``readings`` (2,), rad, the true angles (2,), rad, and the stamp, Unix time."""

    pointing: Pointing
    readings: int
    reading_rad: FloatArray
    angles_rad: FloatArray
    utc_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnNight:
    """A night.

    Attributes
    ----------
    site : where. rig : as it is known before. true_rig : as it is.
    pictures : of each station, by name.
    clock_s : by how much stamps are early. refraction : how much stronger it is, a share.
    """

    site: ObservingSite
    rig: Rig
    true_rig: Rig
    pictures: dict[str, tuple[NightPicture, ...]]
    clock_s: float
    refraction: float


def draw_night(
    seed: int,
    pointings: int = 24,
    errors: NightErrors = NightErrors(),
    step_deg: float = 0.00625,
    fov_deg: float = 10.96,
    true_rig: Rig | None = None,
) -> DrawnNight:
    """Draw a night: ``pointings`` of each of two heads with encoder steps of ``step_deg``.

    With ``true_rig`` its stations are those heads, known before but for their orientation.
    """
    random = np.random.default_rng([seed, 0x57A2])
    site = ObservingSite(
        lat_deg=float(random.uniform(30.0, 60.0)),
        lon_deg=float(random.uniform(-10.0, 30.0)),
        height_m=float(random.uniform(0.0, 900.0)),
        y_axis_azimuth_deg=float(random.uniform(0.0, 360.0)),
        pressure_hpa=980.0,
        air_c=8.0,
    )
    sky = SkyOverSite(site)
    start_s = _dark_evening(sky, random)
    if true_rig is None:
        known = Rig(stations=tuple(drawn_station(name, x, fov_deg, step_deg) for name, x in pedestals()))
        true = replace(known, stations=tuple(with_errors(s, errors, random) for s in known.stations))
    else:
        known, true = replace(true_rig, stations=tuple(map(_disoriented, true_rig.stations))), true_rig
    moon = sky.body("moon", start_s)
    within = HeadRange(pan_deg=(-_HALF_RANGE_DEG, _HALF_RANGE_DEG), tilt_deg=_TILT_DEG)
    pictures = {}
    for station, true_station in zip(known.stations, true.stations, strict=True):
        plan = plan_pointings(station, within, pointings, moon if moon[2] > 0.0 else None)
        pictures[station.name] = _take(plan, true_station, start_s, random)
    return DrawnNight(
        site=site,
        rig=known,
        true_rig=true,
        pictures=pictures,
        clock_s=float(random.normal(0.0, errors.clock_s)),
        refraction=float(random.normal(0.0, errors.refraction)),
    )


def _disoriented(station: Station) -> Station:
    """Return a station of which position and lens are known."""
    return replace(
        station,
        known=("position", "lens"),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]),
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
    )


def pedestals() -> tuple[tuple[str, float], tuple[str, float]]:
    """Return the stations' names and places along the baseline, m."""
    return ("left", -0.5 * _BASELINE_M), ("right", 0.5 * _BASELINE_M)


def _dark_evening(sky: SkyOverSite, random: np.random.Generator) -> float:
    """Return a time at which the Sun is 12° below the horizon."""
    for _ in range(_MOST_DAYS):
        day = _FIRST_UTC_S + _DAY_S * float(random.integers(0, 365))
        for hour in random.permutation(24):
            utc_s = day + 3600.0 * float(hour)
            if sky.body("sun", utc_s)[2] < np.sin(np.radians(-12.0)):
                return utc_s
    raise AssertionError("no night at this place")


def drawn_station(name: str, x_m: float, fov_deg: float, step_deg: float) -> Station:
    """Return a station without errors at a place along the baseline."""
    size = (1280, 960)
    focal = 0.5 * size[0] / np.tan(np.radians(0.5 * fov_deg))
    return Station(
        name=name,
        fixed=False,
        known=("position", "lens"),
        ptu_position_m=np.array([x_m, 0.0, 1.6]),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]),
        camera_in_head_m=np.array([0.0, 0.06, 0.05]),
        lens=Lens(
            image_size_px=size,
            focal_px=np.array([focal, focal]),
            principal_point_px=0.5 * (np.array(size) - 1.0),
            distortion=np.zeros(5),
        ),
        ptu_resolution_rad=float(np.radians(step_deg)),
        ptu_sigma_rad=0.0,
        ptu_clock=ClockModel(),
        camera_clock=None,
        readout_s=0.0,
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
    )


def with_errors(station: Station, errors: NightErrors, random: np.random.Generator) -> Station:
    """Return a station with errors that are drawn."""
    base = rotation_from_vector(np.radians(random.normal(0.0, errors.base_deg, 3)))
    camera = rotation_from_vector(np.radians(random.normal(0.0, errors.boresight_deg, 3))) @ rotation_x(-0.5 * np.pi)
    scale = random.normal(0.0, errors.scale, 2)
    sine, cosine = np.radians(random.normal(0.0, errors.periodic_deg, 2))
    distortion = np.array([random.normal(0.0, errors.k1), 0.0, 0.0, 0.0, 0.0])
    lens = Lens(
        image_size_px=station.lens.image_size_px,
        focal_px=station.lens.focal_px * (1.0 + random.normal(0.0, errors.focal)),
        principal_point_px=station.lens.principal_point_px + random.normal(0.0, errors.principal_point_px, 2),
        distortion=distortion,
    )
    axes = PtuAxes(
        pan_scale=float(scale[0]),
        tilt_scale=float(scale[1]),
        lean_rad=float(np.radians(random.normal(0.0, errors.lean_deg))),
        pan_backlash_rad=float(np.radians(errors.backlash_deg)),
        tilt_backlash_rad=float(np.radians(errors.backlash_deg)),
        pan_sine_rad=float(sine),
        pan_cosine_rad=float(cosine),
        tilt_sag_rad=float(np.radians(random.choice([-1.0, 1.0]) * errors.sag_deg)),
    )
    return replace(
        station,
        known=PARTS,
        runway_from_base_wxyz=wxyz_from_matrix(base),
        head_from_camera_wxyz=wxyz_from_matrix(camera),
        lens=lens,
        ptu_axes=axes,
    )


def _take(
    plan: Sequence[Pointing], station: Station, start_s: float, random: np.random.Generator
) -> tuple[NightPicture, ...]:
    """Return the exposures: the motor stands anywhere within the encoder's step that is read."""
    step = station.ptu_resolution_rad
    taken = []
    for k, pointing in enumerate(plan):
        stands = np.radians([pointing.pan_deg, pointing.tilt_deg]) + random.uniform(-0.5, 0.5, 2) * np.radians(0.1)
        # an encoder without noise reads the same again
        count = READINGS if station.ptu_sigma_rad > 0.0 else 1
        noise = station.ptu_sigma_rad * random.normal(size=(count, 2)) if count > 1 else np.zeros((1, 2))
        reading = (np.round((stands + noise) / step) * step).mean(axis=0)
        angles = station.ptu_axes.angles(float(stands[0]), float(stands[1]), pointing.pan_from, pointing.tilt_from)
        taken.append(
            NightPicture(
                pointing=pointing,
                readings=count,
                reading_rad=reading,
                angles_rad=np.array(angles),
                utc_s=start_s + _PICTURE_EACH_S * k,
            )
        )
    return tuple(taken)
