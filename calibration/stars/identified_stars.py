"""Stars of a night's pictures by name: those of the solver first, then all that a fitted head expects in a picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.mount.problem import Mark, MarkKind, MountSightings
from calibration.stars.night import StarPicture
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_solver import CatalogueStars, SolvedPicture, StarSolver, match_stars
from groundstation.arrays import FloatArray, IntArray, MaskArray
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration_many
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.rig.rig import Station

_FAR_M = 1e8
# stars of chance among n matches: so many times their expected number are needed
_CHANCE_FACTOR = 5.0
_LEAST_STARS = 4
# about a picture's own known stars: noise, and what is left of an unknown lens
_KNOWN_RADIUS_PX = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedPicture:
    """A picture's identified stars: rows of its star images (m,), the stars, their directions (m, 3), runway frame."""

    picture: StarPicture
    image: IntArray
    stars: CatalogueStars
    towards: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyUncertainty:
    """What all pictures of a night share: one sigma of their clock, s, and of the refraction, a share of it.

    ``each_clock`` says that the clock's error is each picture's own, as of pictures whose times are hardly known;
    ``station_clocks`` that it is each station's, as of stations with computers of their own.
    """

    clock_s: float
    refraction: float
    each_clock: bool = False
    station_clocks: bool = False


def by_solver(picture: StarPicture, solved: SolvedPicture, sky: SkyOverSite) -> IdentifiedPicture:
    """Return the solver's own stars of a picture."""
    towards = sky.stars(solved.stars.ra_rad, solved.stars.dec_rad, picture.utc_s)
    return IdentifiedPicture(picture=picture, image=solved.image, stars=solved.stars, towards=towards)


def by_station(
    picture: StarPicture,
    station: Station,
    solver: StarSolver,
    sky: SkyOverSite,
    radius_px: float,
    before: IdentifiedPicture | None,
) -> IdentifiedPicture | None:
    """Return the stars that are where a fitted station expects them, within a radius; None where chance does as well.

    Every star that the camera can see is expected, whether the solver has used it or not. Where stars of the picture
    are known from ``before``, all are expected as far off as these are: by the error of this picture's angles and time.
    """
    seen = picture.seen
    angles = station.ptu_axes.angles(*picture.reading_rad.tolist(), *picture.sense.tolist())
    pose = station.geometry().camera_pose(*angles)
    w, h = station.lens.image_size_px
    corner = float(np.hypot(w, h)) / 2.0 / float(station.lens.focal_px.min())
    axis_icrs = sky.icrs_from_runway(picture.utc_s) @ pose.runway_from_camera[:, 2]
    # aberration and refraction move what is expected by less than 1°
    stars = solver.near(axis_icrs, float(np.arctan(corner)) + np.radians(1.0))
    towards = sky.stars(stars.ra_rad, stars.dec_rad, picture.utc_s)
    expected, inside = expected_pixels(station, angles, towards)
    if before is not None:
        known, _ = expected_pixels(station, angles, before.towards)
        expected = _shifted(expected, known, seen.pixel_px[before.image])
        radius_px = min(radius_px, _KNOWN_RADIUS_PX)
    rows = np.flatnonzero(inside)
    image, star = match_stars(seen, stars.of(rows), expected[rows], radius_px)
    by_chance = len(seen) * len(rows) * np.pi * radius_px**2 / (w * h)
    if len(image) < max(_LEAST_STARS, _CHANCE_FACTOR * by_chance):
        return None
    chosen = rows[star]
    return IdentifiedPicture(picture=picture, image=image, stars=stars.of(chosen), towards=towards[chosen])


def _shifted(expected_px: FloatArray, known_px: FloatArray, seen_px: FloatArray) -> FloatArray:
    """Return pixels (n, 2) moved and turned as known ones (m, 2) have to be to lie where they are seen, (m, 2)."""
    middle = np.median(known_px, axis=0)
    off = np.column_stack([known_px - middle, np.ones(len(known_px))])
    moved = seen_px - known_px
    shift = np.median(moved, axis=0)
    near = np.linalg.norm(moved - shift, axis=1) <= 2.0 * np.median(np.linalg.norm(moved - shift, axis=1)) + 1.0
    if int(near.sum()) < _LEAST_STARS:
        return np.asarray(expected_px + shift)
    linear, *_ = np.linalg.lstsq(off[near], moved[near], rcond=None)
    return np.asarray(expected_px + np.column_stack([expected_px - middle, np.ones(len(expected_px))]) @ linear)


def expected_pixels(
    station: Station, angles: tuple[float, float] | FloatArray, towards: FloatArray
) -> tuple[FloatArray, MaskArray]:
    """Return pixels (n, 2) of directions (n, 3) at pan and tilt, rad, and which are in the picture.

    ``angles`` are those of all, or (n, 2) of each: of a head that turns while a rolling shutter is read out.
    """
    n = len(towards)
    pixel, depth = np.zeros((n, 2)), np.zeros(n)
    project_calibration_many(
        station.geometry().packed,
        station.ptu_position_m + _FAR_M * towards,
        np.array(np.broadcast_to(angles, (n, 2)), dtype=np.float64),
        pixel,
        np.zeros((n, 2, 5)),
        np.zeros((n, 2, CALIBRATION_SIZE)),
        depth,
    )
    w, h = station.lens.image_size_px
    inside = (depth > MIN_DEPTH_M) & np.all((pixel >= 0.0) & (pixel <= (w - 1, h - 1)), axis=1)
    return pixel, inside


def sightings_of(
    found: Sequence[IdentifiedPicture], sky: SkyOverSite, uncertain: SkyUncertainty
) -> tuple[MountSightings, tuple[Mark, ...]]:
    """Return the sightings of all pictures of one head, and the sky as a mark: one, or one for each picture."""
    counts = [len(one.image) for one in found]
    number = np.repeat(np.arange(len(found)), counts)
    names = [one.picture.label for one in found] if uncertain.each_clock else ["sky"]
    marks = tuple(
        Mark(
            name=name,
            kind=MarkKind.SKY,
            place_m=sky.pole(),
            sigma=np.array([uncertain.clock_s, uncertain.refraction, 0.0]),
            runway_from_board=np.eye(3),
        )
        for name in names
    )
    seen = MountSightings(
        reading_rad=np.array([one.picture.reading_rad for one in found])[number],
        sense=np.array([one.picture.sense for one in found])[number],
        pixel_px=np.concatenate([one.picture.seen.pixel_px[one.image] for one in found]),
        sigma_px=np.concatenate([one.picture.seen.sigma_px[one.image] for one in found]),
        pointing=number,
        mark=number if uncertain.each_clock else np.zeros(len(number), dtype=np.int64),
        body_m=np.concatenate([one.towards for one in found]),
        readings=np.array([one.picture.readings for one in found], dtype=np.float64)[number],
        label=tuple(f"{one.picture.label}: star {n}" for one in found for n in one.stars.number.tolist()),
    )
    return seen, marks
