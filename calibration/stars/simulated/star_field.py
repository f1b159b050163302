"""Which stars a simulated camera sees in an exposure, where, and how bright; and what it takes for stars."""

from dataclasses import dataclass

import numpy as np

from calibration.mount.problem import changed_sky
from calibration.stars.identified_stars import expected_pixels
from calibration.stars.simulated.night_draw import NightPicture
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_images import StarImages
from calibration.stars.star_solver import StarSolver
from groundstation.arrays import FloatArray, IntArray
from groundstation.rig.rig import Station

# grey levels of a star of magnitude 6 in an exposure of half a second, as in `star_renderer`
FLUX_OF_SIXTH_MAG = 150.0
_BAND_SIGMA_MAG = 0.25
_NOISE = 3.0
_SPREAD_PX = 0.9
_LEAST_SNR = 5.0
# a share of pictures has clouds, and each a bright thing that is no star now and then
_CLOUDY_SHARE = 0.25
_CLOUD_DEPTH_MAG = 4.0
_STRANGERS = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarField:
    """Stars in one exposure: pixels (n, 2), fluxes (n,), grey levels summed, catalogue numbers (n,)."""

    pixel_px: FloatArray
    flux: FloatArray
    number: IntArray


def star_field(
    picture: NightPicture,
    station: Station,
    solver: StarSolver,
    sky: SkyOverSite,
    late_s: float,
    refraction: float,
    random: np.random.Generator,
) -> StarField:
    """Return what stands in the picture of the true station; the exposure is ``late_s`` after its stamp."""
    pan, tilt = picture.angles_rad.tolist()
    axis = station.geometry().camera_pose(pan, tilt).runway_from_camera[:, 2]
    lens = station.lens
    corner = np.arctan(np.linalg.norm(0.5 * np.array(lens.image_size_px) / lens.focal_px))
    # aberration, refraction and an unknown lens
    stars = solver.near(sky.icrs_from_runway(picture.utc_s) @ axis, float(corner + np.radians(1.5)))
    towards = sky.stars(stars.ra_rad, stars.dec_rad, picture.utc_s + late_s)
    lifted, _ = changed_sky(towards, sky.pole(), np.array([0.0, refraction]))
    pixel, inside = expected_pixels(station, (pan, tilt), lifted)
    inside &= lifted[:, 2] > 0.0
    magnitude = stars.magnitude[inside] + random.normal(0.0, _BAND_SIGMA_MAG, int(inside.sum()))
    magnitude += _clouds(pixel[inside], station.lens.image_size_px, random)
    flux = FLUX_OF_SIXTH_MAG * 10.0 ** (-0.4 * (magnitude - 6.0))
    return StarField(pixel_px=pixel[inside], flux=flux, number=stars.number[inside])


def seen_stars(field: StarField, station: Station, random: np.random.Generator) -> StarImages:
    """Return what a finder makes of a field: stars bright enough, with their noise, and things that are none."""
    area = 4.0 * np.pi * _SPREAD_PX**2
    snr = field.flux / np.sqrt(field.flux + area * _NOISE**2)
    bright = snr > _LEAST_SNR
    sigma = np.hypot(_SPREAD_PX * np.sqrt(1.0 / field.flux + 2.0 * area * _NOISE**2 / field.flux**2), 0.03)[bright]
    w, h = station.lens.image_size_px
    strangers = int(random.poisson(_STRANGERS))
    places = random.uniform((0.0, 0.0), (w - 1.0, h - 1.0), (strangers, 2))
    pixel = field.pixel_px[bright] + sigma[:, None] * random.normal(size=(len(sigma), 2))
    flux = np.concatenate([field.flux[bright], FLUX_OF_SIXTH_MAG * 10.0 ** random.uniform(-0.5, 1.5, strangers)])
    order = np.argsort(-flux, kind="stable")
    return StarImages(
        pixel_px=np.concatenate([pixel, places])[order],
        sigma_px=np.concatenate([sigma, np.full(strangers, 0.05)])[order],
        flux=flux[order],
        spread_px=_SPREAD_PX,
        noise=_NOISE,
    )


def _clouds(pixel_px: FloatArray, size_px: tuple[int, int], random: np.random.Generator) -> FloatArray:
    """Return by how many magnitudes clouds dim pixels (n, 2): a bank that covers a side, in some of the pictures."""
    clear = np.zeros(len(pixel_px))
    if random.uniform() > _CLOUDY_SHARE:
        return clear
    angle = random.uniform(0.0, 2.0 * np.pi)
    along = (pixel_px / np.array(size_px) - 0.5) @ np.array([np.cos(angle), np.sin(angle)])
    edge = random.uniform(-0.7, 0.4)
    return np.asarray(_CLOUD_DEPTH_MAG / (1.0 + np.exp(-(along - edge) / 0.05)))
